//! Where Gaussians are: edits move, turn and scale them.
//!
//! The state holds one map for each set of Gaussians that moved together. A command composes its map with theirs in f64. The
//! present geometry is made of the file's columns by these maps alone ([`super::placed_scene::PlacedScene`]). So many small
//! moves do not add up rounding errors, and undo restores every bit.

use std::sync::Arc;

use glam::DVec3;
use sg_scene::framing::robust_bounds;
use sg_scene::mask::Mask;
use sg_scene::model::{Scene, SceneBox};
use sg_scene::similarity::Similarity;

/// Gaussians that were moved together.
#[derive(Debug, Clone, PartialEq)]
pub struct Placement {
    /// From their place in the file, in the scene frame, to their present place.
    pub map: Similarity,
    /// The Gaussians.
    pub members: Arc<Mask>,
}

/// The middle of some Gaussians: that of the box that frames them, else of their finite centres. `None` where all of them are
/// without a finite centre.
#[must_use]
pub fn middle(scene: &Scene, members: &Mask) -> Option<DVec3> {
    let bounds = robust_bounds(scene, members).or_else(|| {
        let centers = members.ones().filter_map(|i| scene.position(i)).filter(|p| p.is_finite());
        centers.fold(None, |sides: Option<SceneBox>, p| {
            Some(sides.map_or(SceneBox { min: p, max: p }, |b| SceneBox { min: b.min.min(p), max: b.max.max(p) }))
        })
    });
    bounds.map(|b| 0.5 * (b.min + b.max))
}

/// Whether two lists of placements are equal, without a look at masks that are the same allocation.
pub(super) fn same(a: &Arc<[Placement]>, b: &Arc<[Placement]>) -> bool {
    let part = |(a, b): (&Placement, &Placement)| {
        a.map == b.map && (Arc::ptr_eq(&a.members, &b.members) || a.members == b.members)
    };
    Arc::ptr_eq(a, b) || (a.len() == b.len() && a.iter().zip(b.iter()).all(part))
}
