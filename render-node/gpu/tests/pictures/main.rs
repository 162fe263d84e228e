//! Pictures against closed forms, against a second implementation, and level against level.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a test fails by panicking and says what it measured")]

mod allocations;
mod cases;
mod closed_form;
mod depths;
mod editing;
mod foveation;
mod gpu;
mod gpu_state;
mod hard_cases;
mod large;
mod meshes;
mod motion;
mod oracle;
mod per_ray;
mod picking;
mod present;
mod quality;
mod scenes;
mod staged;
mod steady;
mod structure;
#[path = "../support/mod.rs"]
mod support;
