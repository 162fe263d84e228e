//! Counts and times of a picture.

use serde::Serialize;

/// Counts and seconds of one picture.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Report {
    /// Gaussians in the scene.
    pub gaussians: usize,
    /// Gaussians that reach at least one pixel's neighbourhood.
    pub drawn: usize,
    /// Gaussians with a NaN or infinite attribute. No picture shows them.
    pub dropped_non_finite: usize,
    /// Gaussians of hidden units.
    pub hidden: usize,
    /// Gaussians that a clip plane or box takes away.
    pub clipped: usize,
    /// Gaussians of opacity 0.
    pub transparent: usize,
    /// Gaussians whose centre is not in front of the near plane.
    pub culled_near: usize,
    /// Gaussians whose footprint misses the picture.
    pub culled_outside: usize,
    /// Pairs of a Gaussian and a 16 × 16 tile that were blended.
    pub tile_pairs: u64,
    /// Wall time of each stage.
    pub seconds: StageSeconds,
}

/// Wall seconds of each stage of one picture.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct StageSeconds {
    /// Projection and shading of every Gaussian.
    pub preprocess: f64,
    /// Ordering by depth.
    pub sort: f64,
    /// Lists of Gaussians for each tile.
    pub bin: f64,
    /// Blending.
    pub raster: f64,
    /// The whole picture.
    pub total: f64,
}

/// Why a Gaussian is not drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Culled {
    NotFinite,
    Hidden,
    Clipped,
    Transparent,
    Near,
    Outside,
}

impl Report {
    pub(crate) fn count(&mut self, culled: Culled) {
        let counter = match culled {
            Culled::NotFinite => &mut self.dropped_non_finite,
            Culled::Hidden => &mut self.hidden,
            Culled::Clipped => &mut self.clipped,
            Culled::Transparent => &mut self.transparent,
            Culled::Near => &mut self.culled_near,
            Culled::Outside => &mut self.culled_outside,
        };
        *counter += 1;
    }

    pub(crate) fn add_counts(&mut self, other: &Self) {
        self.drawn += other.drawn;
        self.dropped_non_finite += other.dropped_non_finite;
        self.hidden += other.hidden;
        self.clipped += other.clipped;
        self.transparent += other.transparent;
        self.culled_near += other.culled_near;
        self.culled_outside += other.culled_outside;
    }
}
