//! Interactive selection in scenes of Gaussians: strokes, operations, sessions and previews.
//!
//! - [`selection_index`]: a scene prepared for selections, shared by all sessions.
//! - [`answers`]: one stroke answered at every scale.
//! - [`session`]: steps in, mask out; [`preview`] while a stroke is drawn; [`refinement`] of the boundary.
//! - [`steps`]: a [stroke](strokes), an [operation](operations), or [walk parameters](tuning).
//! - [`brush`]: Gaussians under a stroke. [`operation_context`]: the scene data of operations.
//! - [`mask_agreement`]: agreement of a mask with the ground truth.
//!
//! # Example
//!
//! One walk stroke on a synthetic vessel with a sac selects Gaussians of the sac:
//!
//! ```
//! use std::sync::Arc;
//!
//! use glam::Vec3;
//! use sg_clusters::cluster_graph::{ClusterGraph, GraphForm};
//! use sg_clusters::clustering::{ClusteringOptions, cluster};
//! use sg_clusters::geometry::{Geometry, GeometryOptions};
//! use sg_clusters::progress::Silent;
//! use sg_scene::synthetic::{normalized, vessel_and_sac};
//! use sg_selection::mask_agreement::Agreement;
//! use sg_selection::selection_index::{SelectionIndex, WalkOptions};
//! use sg_selection::session::SelectionSession;
//! use sg_selection::strokes::{Kind, Mode, Stroke};
//!
//! let (scene, sac) = vessel_and_sac(4000, 3);
//! let geometry = Geometry::of_scene(&scene, GeometryOptions::default(), &Silent)?;
//! let options = ClusteringOptions { max_clusters: 200, ..ClusteringOptions::default() };
//! let (clustering, _) = cluster(&geometry, &options, &Silent)?;
//! let graph = ClusterGraph::new(&geometry, &clustering, GraphForm::Contact)?;
//! let index = SelectionIndex::of_clusters(&scene, &clustering, &graph, WalkOptions::default());
//!
//! let mut session = SelectionSession::new(Arc::new(index));
//! session.add_stroke(Stroke {
//!     mode: Mode::Walk,
//!     kind: Kind::Foreground,
//!     radius: 0.03,
//!     points: normalized(&scene, &[Vec3::new(0.0, 0.0, 0.66)]),
//!     pressure: Vec::new(),
//!     depth: None,
//! })?;
//! let mask = session.mask();
//! let agreement = Agreement::of((0..scene.len()).map(|g| (mask.get(g), sac[g])));
//! assert!(mask.count() > 0 && agreement.precision > 0.5);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![cfg_attr(test, allow(clippy::print_stdout, reason = "tests print what they measure"))]

pub mod answers;
pub mod brush;
pub mod cluster_members;
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
