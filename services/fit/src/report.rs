//! Counts, quality measures and times of a direct start.

use serde::Serialize;
use sg_scene::model::Scene;

use glam::Vec3;

use crate::shape::Splat;

/// A scene and the report of its creation.
#[derive(Debug, Clone, PartialEq)]
pub struct DirectStart {
    /// The scene; its box is the volume's.
    pub scene: Scene,
    /// Counts and times.
    pub report: Report,
}

/// Counts, quality measures and times of a direct start.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// Gaussians made.
    pub gaussians: usize,
    /// Largest requested number of Gaussians.
    pub budget: usize,
    /// Seed of the placement.
    pub seed: u64,
    /// Voxels of the volume.
    pub voxels: usize,
    /// Voxels with an opacity above 0.
    pub visible_voxels: usize,
    /// Voxels that are NaN or infinite (NaN counts as transparent).
    pub non_finite_voxels: usize,
    /// Visible voxels outside the ranges of all base units; they belong to the nearest unit.
    pub voxels_outside_base_units: usize,
    /// Share of the importance within two standard deviations of its Gaussian.
    pub importance_captured: f64,
    /// The base units, in order.
    pub units: Vec<UnitReport>,
    /// Wall time by stage.
    pub seconds: Seconds,
}

/// One base unit of a direct start.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct UnitReport {
    /// Its name.
    pub name: String,
    /// Its label, if the base units are labels; 0 for the voxels without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub label: Option<i32>,
    /// Gaussians made.
    pub gaussians: usize,
    /// Those that the transfer function hides.
    pub hidden: usize,
    /// Voxels with an opacity above 0.
    pub visible_voxels: usize,
    /// Its share of the importance of all units.
    pub importance_share: f64,
    /// Share of its importance within two standard deviations of its Gaussian.
    pub importance_captured: f64,
    /// Mean of shortest axis / middle axis.
    pub mean_flattening: f64,
    /// Mean surfaceness of the Gaussians: 0 homogeneous or noise, 1 a clear boundary.
    pub mean_surfaceness: f64,
    /// Median opacity.
    pub median_opacity: f64,
    /// Median standard deviation of the middle axis, in units of the smallest voxel spacing.
    pub median_scale_voxels: f64,
    /// Palette colour, RGB.
    pub palette: [f32; 3],
}

/// Wall time by stage, all units together.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Seconds {
    /// Transfer function on every voxel, and smoothing.
    pub classify: f64,
    /// Visibility and importance of the voxels.
    pub importance: f64,
    /// Sampling and relaxation of the centres.
    pub placement: f64,
    /// Axes, opacities, colours and normals.
    pub shape: f64,
    /// The whole direct start.
    pub total: f64,
}

impl UnitReport {
    pub(crate) fn new(
        name: &str,
        splats: &[Splat],
        edge: f64,
        share: f64,
        visible_voxels: usize,
        palette: Vec3,
    ) -> Self {
        let visible: Vec<&Splat> = splats.iter().filter(|s| s.opacity > 0.0).collect();
        let n = visible.len().max(1) as f64;
        let mean = |f: &dyn Fn(&Splat) -> f64| visible.iter().map(|s| f(s)).sum::<f64>() / n;
        let median = |f: &dyn Fn(&Splat) -> f64| {
            let mut values: Vec<f64> = visible.iter().map(|s| f(s)).collect();
            values.sort_by(f64::total_cmp);
            values.get(values.len() / 2).copied().unwrap_or(0.0)
        };
        let weight: f64 = splats.iter().map(|s| s.weight).sum();
        let captured: f64 = splats.iter().map(|s| s.captured * s.weight).sum();
        Self {
            name: name.to_owned(),
            label: None,
            gaussians: splats.len(),
            hidden: splats.len() - visible.len(),
            visible_voxels,
            importance_share: share,
            importance_captured: if weight > 0.0 { captured / weight } else { 0.0 },
            mean_flattening: mean(&|s| s.scale.z / s.scale.y),
            mean_surfaceness: mean(&|s| f64::from(s.surfaceness)),
            median_opacity: median(&|s| s.opacity),
            median_scale_voxels: median(&|s| s.scale.y) / edge,
            palette: palette.to_array(),
        }
    }
}
