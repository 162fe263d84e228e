//! Interactive selection in scenes of Gaussians: strokes, operations, sessions and previews.
//!
//! - [`selection_index`]: a scene prepared for selections, shared by all sessions.
//! - [`session`]: steps in, mask out; [`preview`] while a stroke is drawn; [`refinement`] of the boundary.
//! - [`steps`]: a [stroke](strokes), an [operation](operations), or [walk parameters](tuning).
//! - [`brush`]: Gaussians under a stroke. [`operation_context`]: the scene data of operations.
//! - [`mask_agreement`]: agreement of a mask with the ground truth.

#![cfg_attr(test, allow(clippy::print_stdout, reason = "tests print what they measure"))]

pub mod brush;
pub mod mask_agreement;
pub mod operation_context;
pub mod operations;
pub mod preview;
pub mod refinement;
pub mod selection_index;
pub mod session;
pub mod steps;
pub mod strokes;
pub mod tuning;

#[cfg(test)]
mod hard_scenes;
#[cfg(test)]
mod scenarios;
