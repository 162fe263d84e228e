//! Two resolutions in one picture: all pixels about the optical axis, blocks of 2 × 2 pixels outside.
//!
//! Fixed foveation, as of Vlachos, "Advanced VR Rendering", GDC 2015. Far from its axis, a lens shows a lower resolution than a flat
//! picture has there. A tile is coarse if all of it lies beyond the eccentricity. In a coarse tile each block of
//! 2 × 2 pixels is evaluated once, at the block's middle, and all four pixels get its color. Lists, order, cut-offs and stop are those
//! of the whole picture. So the pixels of all other tiles stay the same to the last bit.

use glam::{DVec2, Vec2};
use sg_scene::camera::Camera;

use crate::project::Ellipse;
use crate::tiles::TILE;

/// Edge in pixels of a block with one evaluation.
pub const BLOCK: usize = 2;

/// Blocks along the edge of a tile.
pub(crate) const BLOCKS: usize = TILE / BLOCK;

/// Where a picture has half the resolution.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize)]
pub struct Foveation {
    degrees: u8,
}

impl Foveation {
    /// Half resolution beyond so many degrees from the optical axis, 1 to 89. `None` for other numbers.
    #[must_use]
    pub fn beyond(degrees: u8) -> Option<Self> {
        (1..90).contains(&degrees).then_some(Self { degrees })
    }

    /// Degrees from the optical axis up to which all pixels are evaluated.
    #[must_use]
    pub fn degrees(self) -> u8 {
        self.degrees
    }

    /// Whether a pixel of a camera's picture lies in a coarse tile. The first pixel is `[0, 0]`.
    #[must_use]
    pub fn is_coarse(self, camera: &Camera, [x, y]: [u32; 2]) -> bool {
        Periphery::of(camera, self).has([x, y].map(|at| at as usize / TILE * TILE))
    }

    /// The squared slope of rays at that eccentricity, in f32 as the shader compares it.
    #[must_use]
    pub fn squared_slope(self) -> f32 {
        let slope = f64::from(self.degrees).to_radians().tan();
        (slope * slope) as f32
    }
}

/// The foveation of one eye.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Periphery {
    squared_slope: f32,
    focal: Vec2,
    principal: Vec2,
}

impl Periphery {
    pub(crate) fn of(camera: &Camera, foveation: Foveation) -> Self {
        Self {
            squared_slope: foveation.squared_slope(),
            focal: Vec2::new(camera.fx as f32, camera.fy as f32),
            principal: Vec2::new(camera.cx as f32, camera.cy as f32),
        }
    }

    /// Whether the tile with this first pixel is coarse: the twin of `block_edge` in `blend_tiles.wgsl`.
    pub(crate) fn has(&self, first: [usize; 2]) -> bool {
        let first = Vec2::from(first.map(|x| x as f32));
        let nearest = self.principal.clamp(first, first + TILE as f32);
        let slope = (nearest - self.principal) / self.focal;
        slope.length_squared() >= self.squared_slope
    }
}

/// Variance in square pixels that the mean of a block's four pixels adds to a footprint.
pub const BLOCK_VARIANCE: f64 = 0.25;

/// A footprint as blocks see it: the mean of a block's four pixels, in units of blocks, and log₂ of the factor on its opacity.
///
/// The mean widens a footprint by [`BLOCK_VARIANCE`]. Its opacity falls as its area grows. The Cholesky form of `Σ + w·I`, with
/// `g = 1 + w/σ²`: slope/g, σ²·g and ρ² + w·(1 + slope²/g).
pub(crate) fn in_blocks(ellipse: &Ellipse) -> (Ellipse, f64) {
    let Ellipse { center, slope, along_row, over_rows } = *ellipse;
    let g = 1.0 + BLOCK_VARIANCE / (over_rows * over_rows);
    let h = 1.0 + BLOCK_VARIANCE * (1.0 + slope * slope / g) / (along_row * along_row);
    let scale = 1.0 / BLOCK as f64;
    let mean = Ellipse {
        center: center * scale,
        slope: slope / g,
        along_row: along_row * h.sqrt() * scale,
        over_rows: over_rows * g.sqrt() * scale,
    };
    (mean, -0.5 * (g * h).log2())
}

/// Coordinates of a block from those of a pixel.
pub(crate) fn scaled(ellipse: &Ellipse) -> Ellipse {
    let Ellipse { center, slope, along_row, over_rows } = *ellipse;
    let scale = 1.0 / BLOCK as f64;
    Ellipse { center: center * scale, slope, along_row: along_row * scale, over_rows: over_rows * scale }
}

/// The middle of the first block of a tile with this first pixel, in blocks.
pub(crate) fn first_block([x, y]: [usize; 2]) -> DVec2 {
    DVec2::new((x / BLOCK) as f64 + 0.5, (y / BLOCK) as f64 + 0.5)
}

#[cfg(test)]
mod tests {
    use glam::{DMat2, DVec3};
    use sg_scene::appearance::Appearance;
    use sg_scene::framing;
    use sg_scene::synthetic::test_scene;

    use super::*;
    use crate::counts::{Counting, count};
    use crate::image::Image;
    use crate::image_error::Difference;
    use crate::render::{Options, Quality, render};

    /// Σ of an ellipse.
    fn covariance(e: &Ellipse) -> DMat2 {
        let c = e.over_rows * e.over_rows;
        let b = e.slope * c;
        DMat2::from_cols(DVec2::new(e.along_row * e.along_row + e.slope * b, b), DVec2::new(b, c))
    }

    #[test]
    fn a_block_sees_the_mean_of_its_pixels() {
        let ellipse = Ellipse { center: DVec2::new(7.0, 3.0), slope: -0.8, along_row: 0.6, over_rows: 1.7 };
        let (mean, log_factor) = in_blocks(&ellipse);
        let whole = covariance(&ellipse);
        let wide = whole + BLOCK_VARIANCE * DMat2::IDENTITY;
        assert!((4.0 * covariance(&mean) - wide).to_cols_array().iter().all(|x| x.abs() < 1e-12));
        assert_eq!(mean.center, DVec2::new(3.5, 1.5));
        // Opacity times area stays.
        assert!((log_factor.exp2() - (whole.determinant() / wide.determinant()).sqrt()).abs() < 1e-12);
    }

    #[test]
    fn tiles_wholly_beyond_the_eccentricity_are_coarse() {
        let any = Camera::look_at(DVec3::ONE, DVec3::ZERO, DVec3::Z, 60.0, 320, 320);
        let camera = Camera { fx: 100.0, fy: 100.0, cx: 104.0, cy: 96.0, ..any };
        assert!(Foveation::beyond(0).is_none() && Foveation::beyond(90).is_none());
        let foveation = Foveation::beyond(45).unwrap();
        // 45 degrees are 100 pixels: up to x = 204 and down to y = 196.
        assert!(!foveation.is_coarse(&camera, [207, 96]) && foveation.is_coarse(&camera, [208, 96]));
        assert!(!foveation.is_coarse(&camera, [104, 207]) && foveation.is_coarse(&camera, [104, 208]));
        assert!(!foveation.is_coarse(&camera, [104, 0]) && foveation.is_coarse(&camera, [0, 0]));
    }

    /// Decibels of some pixels of a picture.
    fn decibels(a: &Image, b: &Image, of: impl Fn([u32; 2]) -> bool) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        for (k, (a, b)) in a.rgba.chunks_exact(4).zip(b.rgba.chunks_exact(4)).enumerate() {
            if of([k as u32 % 256, k as u32 / 256]) {
                sum += a.iter().zip(b).take(3).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
                count += 3.0;
            }
        }
        -10.0 * (sum / count).log10()
    }

    #[test]
    fn the_middle_stays_and_the_periphery_has_the_means_of_blocks() {
        let scene = test_scene(&[("vessel", 3000), ("cloud", 2000)]);
        let look = Appearance::of(&scene);
        let camera = Camera { near: 0.0, ..framing::default_camera(&scene, 256, 200) };
        let foveation = Foveation::beyond(8).unwrap();
        let options = |foveation| Options { foveation, ..Options::default() };
        let draw = |foveation| render(&scene, &look, &camera, options(foveation)).unwrap().image;
        let [whole, foveated] = [None, Some(foveation)].map(draw);
        let coarse = |at| foveation.is_coarse(&camera, at);
        let middle = decibels(&foveated, &whole, |at| !coarse(at));
        assert_eq!(middle, f64::INFINITY);
        // The mean of each block of the whole picture.
        let pixel = |image: &Image, x: usize, y: usize, k: usize| image.rgba[4 * (y * 256 + x) + k];
        let mut means = whole.clone();
        for (at, value) in means.rgba.iter_mut().enumerate() {
            let (x, y, k) = (at / 4 % 256 / 2 * 2, at / 1024 / 2 * 2, at % 4);
            *value = [[0, 0], [1, 0], [0, 1], [1, 1]].iter().map(|d| pixel(&whole, x + d[0], y + d[1], k)).sum::<f32>()
                / 4.0;
        }
        let [to_means, to_whole] = [&means, &whole].map(|image| decibels(&foveated, image, coarse));
        assert!(to_means > 40.0 && to_whole > 25.0, "{to_means:.1}, {to_whole:.1} dB");
        // Blocks are of one colour.
        let block = |x: usize, y: usize| [0, 1, 2, 3].map(|k| pixel(&foveated, x, y, k));
        assert!(coarse([1, 1]) && block(0, 0) == block(1, 1));
        // The reference has every pixel.
        let exact = Options { quality: Quality::Exact, ..options(Some(foveation)) };
        let [a, b] = [exact, Quality::Exact.into()].map(|o| render(&scene, &look, &camera, o).unwrap().image);
        assert!(Difference::between(&a, &b).unwrap().psnr_db.is_infinite());
    }

    #[test]
    fn a_coarse_tile_counts_a_quarter() {
        let scene = test_scene(&[("cloud", 2000)]);
        let look = Appearance::of(&scene);
        let camera = framing::default_camera(&scene, 250, 201);
        let of = |foveation| {
            count(&scene, &look, std::slice::from_ref(&camera), Counting { foveation, ..Counting::default() }).unwrap()
        };
        let [whole, coarse] = [None, Foveation::beyond(1)].map(of);
        assert_eq!((whole.tile_pairs, whole.listed, whole.samples), (coarse.tile_pairs, coarse.listed, 250 * 201));
        let share = coarse.evaluated as f64 / whole.evaluated as f64;
        assert!((0.2..0.45).contains(&share) && coarse.samples < whole.samples * 2 / 5, "{share}");
        assert!(coarse.in_step < whole.in_step / 2 && coarse.in_step_in_blocks > coarse.in_step / 4);
        assert_eq!(whole.in_step_in_blocks, 0);
    }
}
