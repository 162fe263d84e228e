//! Headset and hands: the mathematics of holding a scene, and sessions under a real OpenXR runtime.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a test fails by panicking and says what it measured")]

mod eye;
mod holding;
mod pointing;
