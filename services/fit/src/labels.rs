//! Labels of Gaussians from a label volume in the same world frame.

use glam::DVec3;
use sg_scene::model::Scene;
use sg_volume::{Bounds, Volume};

/// The label volume does not fit the scene.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LabelError {
    /// The label volume fills another box.
    #[error(
        "the labels fill the box {} to {}, the scene's volume {} to {}: give a label volume of the same place and spacing",
        .labels.min, .labels.max, .scene.min, .scene.max
    )]
    BoxMismatch {
        /// Box of the labels.
        labels: Bounds,
        /// Box of the scene.
        scene: Bounds,
    },
    /// A value is not an integer of 32 bits.
    #[error("voxel {voxel} has the value {value}: labels are whole numbers within 32 bits")]
    NotInteger {
        /// Index of the voxel.
        voxel: usize,
        /// Its value.
        value: f64,
    },
}

/// The label of the nearest voxel to each Gaussian's centre, in scene order. The label volume must fill the scene's box to
/// within one of its voxels. Its resolution may differ from that of the scene's volume.
///
/// # Errors
/// [`LabelError`].
pub fn labels_of(scene: &Scene, labels: &Volume) -> Result<Vec<i32>, LabelError> {
    let grid = labels.grid();
    let (found, wanted) = (grid.bounds(), Bounds { min: scene.bounds.min, max: scene.bounds.max });
    let slack = grid.spacing().max_element();
    let apart = |a: DVec3, b: DVec3| (a - b).abs().max_element();
    if apart(found.min, wanted.min) > slack || apart(found.max, wanted.max) > slack {
        return Err(LabelError::BoxMismatch { labels: found, scene: wanted });
    }
    (0..scene.len())
        .map(|i| {
            let voxel = grid.nearest(scene.position(i).unwrap_or(wanted.min));
            let value = labels.scalars().get(voxel).unwrap_or(f64::NAN);
            let whole = value.fract() == 0.0 && (f64::from(i32::MIN)..=f64::from(i32::MAX)).contains(&value);
            if whole { Ok(value as i32) } else { Err(LabelError::NotInteger { voxel, value }) }
        })
        .collect()
}
