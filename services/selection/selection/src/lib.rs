//! Selecting in scenes of Gaussians: strokes, steps, operations, sessions and previews.
//!
//! [`space`] (what selections share) → [`session`] (steps in, mask out; [`preview`] while a stroke is drawn), which
//! [`refinement`] sharpens. A step is a stroke, one of the [`operations`], which look at the scene through
//! [`surroundings`], or a [`tuning`] of the walk. [`strokes`] and [`brush`] say what was brushed over, [`metrics`] how well
//! a mask agrees with a truth.

#![cfg_attr(test, allow(clippy::print_stdout, reason = "tests print what they measure"))]

pub mod brush;
pub mod metrics;
pub mod operations;
pub mod preview;
pub mod refinement;
pub mod session;
pub mod space;
pub mod steps;
pub mod strokes;
pub mod surroundings;
pub mod tuning;

#[cfg(test)]
mod hard_scenes;
#[cfg(test)]
mod scenarios;
