//! Times each way to draw a view, so that the fastest can be chosen.

use std::time::Instant;

use sg_raster::render::Projection;
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;

use crate::error::GpuError;
use crate::renderer::Renderer;
use crate::settings::{Rasterizer, Settings};

/// Timed pictures of each candidate; the least time counts.
const TIMED: usize = 2;

/// Share of the time of tiles that another rasterizer may take at most to replace them in a headset.
const FASTER: f64 = 0.75;

/// A way to draw, with its measured time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// Projection and order.
    pub projection: Projection,
    /// Method of blending.
    pub rasterizer: Rasterizer,
    /// Seconds of a picture of all cameras: device time, or time from submission to end without timestamps. Infinite before
    /// the measurement.
    pub seconds: f64,
    /// Those of them that grow with pixels, if the device has timestamps.
    pub pixel_seconds: Option<f64>,
}

/// A trial under way. Each step draws one picture and waits for it. So a loop with other duties makes one step at a time.
///
/// The first picture of a candidate compiles its pipelines and grows its lists; it is not timed.
#[derive(Debug, Clone, PartialEq)]
pub struct Trial {
    candidates: Vec<Candidate>,
    pictures: usize,
}

impl Trial {
    /// A trial of these projections with every rasterizer that `renderer` can use for them, or with `given` alone.
    #[must_use]
    pub fn new(renderer: &Renderer, projections: &[Projection], given: Option<Rasterizer>) -> Self {
        let usable = |rasterizer: &Rasterizer| *rasterizer == Rasterizer::Tiles || renderer.blends_quads();
        let given = given.filter(usable);
        let candidates = projections.iter().flat_map(|projection| {
            let rasterizers: Vec<Rasterizer> = match (projection, given) {
                // Rays need tiles.
                (Projection::PerRay, _) => vec![Rasterizer::Tiles],
                (Projection::Affine, Some(given)) => vec![given],
                (Projection::Affine, None) => Rasterizer::ALL.into_iter().filter(usable).collect(),
            };
            rasterizers.into_iter().map(|rasterizer| Candidate {
                projection: *projection,
                rasterizer,
                seconds: f64::INFINITY,
                pixel_seconds: None,
            })
        });
        Self { candidates: candidates.collect(), pictures: 0 }
    }

    /// Draws one picture of `cameras` with the settings of the next candidate. Returns whether the trial is over.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn step(
        &mut self,
        renderer: &mut Renderer,
        cameras: &[Camera],
        look: &Appearance,
        settings: Settings,
    ) -> Result<bool, GpuError> {
        let (at, timed) = (self.pictures / (TIMED + 1), !self.pictures.is_multiple_of(TIMED + 1));
        let Some(candidate) = self.candidates.get_mut(at) else { return Ok(true) };
        let Candidate { projection, rasterizer, .. } = *candidate;
        let settings = Settings { projection, rasterizer, ..settings };
        if timed {
            let began = Instant::now();
            renderer.draw(cameras, look, settings)?;
            let (stats, _) = renderer.finish()?;
            let seconds = stats.device_seconds.unwrap_or_else(|| began.elapsed().as_secs_f64());
            if seconds < candidate.seconds {
                candidate.seconds = seconds;
                let share = stats.seconds.and_then(|s| s.pixel_share());
                candidate.pixel_seconds = share.map(|share| share * seconds);
            }
        } else {
            renderer.draw_complete(cameras, look, settings)?;
        }
        self.pictures += 1;
        Ok(self.is_over())
    }

    /// Whether every candidate has its time.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.pictures >= (TIMED + 1) * self.candidates.len()
    }

    /// All candidates in the order of the trial.
    #[must_use]
    pub fn candidates(&self) -> &[Candidate] {
        &self.candidates
    }

    /// The measured candidate to draw a headset's pictures with: tiles, unless another one takes less than three quarters of their
    /// time. Tiles skip what the lenses hide and give depths for every pixel without further passes, which the trial does not
    /// measure. `None` for a projection outside the trial.
    #[must_use]
    pub fn preferred(&self, projection: Projection) -> Option<Candidate> {
        let fastest = self.fastest(projection)?;
        let tiles = self.candidates.iter().find(|c| c.projection == projection && c.rasterizer == Rasterizer::Tiles);
        Some(tiles.filter(|tiles| fastest.seconds >= FASTER * tiles.seconds).copied().unwrap_or(fastest))
    }

    /// The fastest measured candidate of a projection; the first one before any measurement. `None` for a projection
    /// outside the trial.
    #[must_use]
    pub fn fastest(&self, projection: Projection) -> Option<Candidate> {
        let of_it = self.candidates.iter().filter(|c| c.projection == projection);
        of_it.min_by(|a, b| a.seconds.total_cmp(&b.seconds)).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_headset_prefers_tiles_unless_another_rasterizer_is_much_faster() {
        let candidate = |rasterizer, seconds| Candidate {
            projection: Projection::Affine,
            rasterizer,
            seconds,
            pixel_seconds: None,
        };
        let chosen = |quads: f64, tiles: f64| {
            let candidates = vec![candidate(Rasterizer::Quads, quads), candidate(Rasterizer::Tiles, tiles)];
            Trial { candidates, pictures: 6 }.preferred(Projection::Affine).unwrap().rasterizer
        };
        assert_eq!(chosen(0.009, 0.006), Rasterizer::Tiles);
        assert_eq!(chosen(0.005, 0.006), Rasterizer::Tiles);
        assert_eq!(chosen(0.004, 0.006), Rasterizer::Quads);
        let given = Trial { candidates: vec![candidate(Rasterizer::Bands, 0.01)], pictures: 3 };
        assert_eq!(given.preferred(Projection::Affine).unwrap().rasterizer, Rasterizer::Bands);
        assert!(given.preferred(Projection::PerRay).is_none());
    }
}
