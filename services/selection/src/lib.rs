//! Selecting in scenes of Gaussians: Super-Gaussians, their graph, random walks, brushes.
//!
//! From a scene to a mask:
//! [`geometry`] (points, features, neighbour graph) → [`clustering`] (Super-Gaussians) → [`cluster_graph`] →
//! [`space`] (what selections share) → [`session`] (steps in, mask out; [`preview`] while a stroke is drawn), which
//! [`refinement`] sharpens. A step is a stroke, one of the [`operations`], which look at the scene through
//! [`surroundings`], or a [`tuning`] of the walk. [`walk`] solves random walks on any weighted
//! graph, [`strokes`] and [`brush`] say what was brushed over, [`metrics`] how well a mask agrees with a truth.

#![cfg_attr(test, allow(clippy::print_stdout, reason = "tests print what they measure"))]

pub mod assignment;
pub mod bridges;
pub mod brush;
pub mod cache;
pub mod cluster_graph;
pub mod clustering;
pub mod euclidean;
pub mod features;
pub mod geometry;
pub mod merge;
pub mod metrics;
pub mod neighbours;
pub mod operations;
pub mod polyline;
pub mod preview;
pub mod progress;
pub mod refinement;
pub mod seeds;
pub mod session;
pub mod shortest;
pub mod space;
pub mod steps;
pub mod strokes;
pub mod surroundings;
pub mod tree;
pub mod tuning;
pub mod vertices;
pub mod walk;

#[cfg(test)]
mod hard_scenes;
#[cfg(test)]
mod scenarios;
#[cfg(test)]
mod test_scenes;
