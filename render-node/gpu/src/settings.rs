//! Settings of a renderer and of a picture.

use sg_raster::foveation::Foveation;
use sg_raster::render::{Projection, Quality};

use crate::sort_window::SortWindow;
use crate::stats::PassSeconds;

/// Method of blending splats.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Rasterizer {
    /// Compute shaders blend one list for each tile of 16 × 16 pixels.
    #[default]
    Tiles,
    /// The fixed function blends a quadrilateral for each splat.
    Quads,
    /// Quadrilaterals in five bands, near to far. Between bands, saturated pixels are marked in depth, so that later splats are
    /// rejected early. Solid surfaces gain from this. Transparent scenes pay one depth test for each fragment.
    Bands,
}

impl Rasterizer {
    /// All rasterizers.
    pub const ALL: [Self; 3] = [Self::Tiles, Self::Quads, Self::Bands];
}

/// Settings of a picture.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Settings {
    /// Error bound. Only the CPU draws `Exact`; devices draw `Standard` in its place.
    pub quality: Quality,
    /// Method of blending.
    pub rasterizer: Rasterizer,
    /// Whether both eyes use the colors of the point between them. This saves one of two evaluations of the shading.
    pub shared_shading: bool,
    /// Projection and order of Gaussians. [`Projection::PerRay`] always uses tiles.
    pub projection: Projection,
    /// Whether the view moves: a picture with the cut-offs of [`sg_raster::Limits::MOTION`], and in the affine projection with an
    /// order of depths rounded to 2⁻¹² of themselves. Both replace those of the quality.
    pub in_motion: bool,
    /// Half resolution of tiles far from the optical axis, in the affine projection.
    pub foveation: Option<Foveation>,
    /// Whether to make [`crate::Renderer::depths`] as well. [`PassSeconds`] leaves out the time of the separate depth passes.
    pub depths: bool,
}

impl Settings {
    /// The effective rasterizer: the ray-consistent mode needs tiles.
    pub(super) fn rasterizer(&self) -> Rasterizer {
        if self.sort_window().is_some() { Rasterizer::Tiles } else { self.rasterizer }
    }

    /// The sort window of each ray in the ray-consistent mode.
    pub(super) fn sort_window(&self) -> Option<SortWindow> {
        match (self.projection, self.quality) {
            (Projection::Affine, _) => None,
            (Projection::PerRay, Quality::Fast) => Some(SortWindow { layers: 32, late_parts: 32 }),
            (Projection::PerRay, _) => Some(SortWindow { layers: 32, late_parts: 256 }),
        }
    }
}

/// Limits of a renderer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Options {
    /// Whether to store shading columns and harmonics in half precision (relative error 2⁻¹¹).
    pub half: bool,
    /// Whether pictures are f16 rather than f32: half the bytes, relative error 2⁻¹². Blending itself stays in f32.
    pub half_pictures: bool,
    /// Capacity of the list of pairs of a Gaussian and a tile, 16 bytes each. Longer lists are blended in windows.
    pub listed_pairs: u32,
    /// Whether one multiview pass blends the quadrilaterals of two parallel eyes, if the device supports it. By default
    /// graphics cards do and software devices do not: lavapipe of Mesa 22.3 draws the right eye wrongly.
    pub multiview: Option<bool>,
    /// Whether the lanes of a tile copy its splats to workgroup memory before they blend them, in the affine projection. The picture is
    /// the same to the last bit. By default graphics cards do and software devices do not: barriers cost them more.
    pub staged_blending: Option<bool>,
}

impl Default for Options {
    fn default() -> Self {
        Self { half: false, half_pictures: false, listed_pairs: 1 << 23, multiview: None, staged_blending: None }
    }
}

/// Counts and times of the newest measured picture.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct FrameStats {
    /// Number of Gaussians that may reach a picture.
    pub listed: u32,
    /// Number of pairs of a Gaussian and a tile over all views; 0 for quadrilaterals.
    pub tile_pairs: u32,
    /// Number of Gaussians in view that rays evaluate in the affine projection, over all views: those near the eye or large for
    /// their depth.
    pub by_rays: u32,
    /// Device time of each pass, if the device has timestamps.
    pub seconds: Option<PassSeconds>,
    /// Number of the measured picture, as [`crate::Renderer::draw`] counts from 1; 0 before the first one.
    pub picture: u64,
    /// Seconds from the begin of its first timed pass to the end of its last one, if the device has timestamps.
    pub device_seconds: Option<f64>,
}
