//! The fast rasterizer: the projection, shading and order of the reference, blended in f32, eight pixels at a time.
//! Two cut-offs have a known error.
//!
//! - **α below min(cut, o/ratio) is not drawn.** The second arm keeps faint Gaussians whole: a Gaussian of any opacity loses
//!   at most 1/ratio of its mass. With a fixed cut alone a fog of o = 0.004 loses a quarter at 1/1024 and everything at
//!   1/255.
//! - **A row of a tile stops when all its transmittances are below `stop`.** Later layers change a pixel by less
//!   than that times their brightness.
//!
//! Depth keys are full f32. Positions are relative to the tile before they become f32. The ellipse is evaluated in
//! Cholesky form ([`Ellipse`]). Within a tile |u| and |v| grow by at most 60 because of the dilation, in
//! previews by 110. The error of the exponent in f32 is therefore 1e-5, or 2e-5, for any length and distance.

use std::time::Instant;

use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::model::Scene;
use wide::f32x8;

use crate::cutoffs::Limits;
use crate::depth::near_to_far;
use crate::footprint::{Shape, footprints};
use crate::foveation::{BLOCK, BLOCKS, Foveation, Periphery, first_block, in_blocks};
use crate::image::Image;
use crate::lanes::{LANES, exp2};
use crate::project::Ellipse;
use crate::raster::{TilePixels, draw};
use crate::ray_consistent::Pinhole;
use crate::ray_consistent::splat_f32::{Narrow, Ray};
use crate::report::{Culled, Report};
use crate::tiles::TILE;

/// Draws a checked scene.
pub(crate) fn render(
    scene: &Scene,
    appearance: &Appearance,
    camera: &Camera,
    (limits, foveation): (Limits, Option<Foveation>),
) -> (Image, Report) {
    let (splats, mut report) = splats(scene, appearance, camera, limits);
    let background = appearance.background;
    let periphery = foveation.map(|foveation| Periphery::of(camera, foveation));
    let image = draw(
        [camera.width, camera.height],
        &splats,
        Drawn::level,
        |corner, list| {
            if periphery.is_some_and(|periphery| periphery.has(corner)) {
                let blocks = Tile::blend_blocks(&splats, list, corner, limits.stop).composite(background);
                return std::array::from_fn(|k| blocks[TILE * (k / TILE / BLOCK) + k % TILE / BLOCK]);
            }
            Tile::blend(&splats, list, corner, limits.stop).composite(background)
        },
        &mut report,
    );
    (image, report)
}

/// The splats of a picture from near to far.
pub(crate) fn splats(scene: &Scene, appearance: &Appearance, camera: &Camera, limits: Limits) -> (Vec<Drawn>, Report) {
    let began = Instant::now();
    let pinhole = Pinhole::of(camera);
    let (splats, mut report) = footprints(scene, appearance, camera, |_, footprint| {
        let order = footprint.order as f32;
        let drawn = match &footprint.shape {
            Shape::Ellipse(ellipse) => {
                let splat = Splat::of(ellipse, footprint.opacity, footprint.color, limits);
                if !ellipse.reaches(f64::from(splat.radius), pinhole.size) {
                    return Err(Culled::Outside);
                }
                Drawn::Ellipse(splat)
            }
            Shape::Rays(splat) => Drawn::Rays(Box::new(Ray::of(splat, limits, &pinhole)?)),
        };
        let finite = order.is_finite() && drawn.color().is_finite();
        if finite { Ok((order, drawn)) } else { Err(Culled::NotFinite) }
    });
    report.seconds.preprocess = began.elapsed().as_secs_f64();
    let began = Instant::now();
    let order = near_to_far(splats.iter().map(|(order, _)| *order));
    let splats = order.par_iter().filter_map(|i| splats.get(*i as usize).map(|(_, drawn)| drawn.clone())).collect();
    report.seconds.sort = began.elapsed().as_secs_f64();
    (splats, report)
}

/// A Gaussian ready to blend.
#[derive(Debug, Clone)]
pub(crate) enum Drawn {
    Ellipse(Splat),
    Rays(Box<Ray>),
}

impl Drawn {
    /// Gaussians of a list between two tests for finished rows.
    pub(crate) const GROUP: usize = 16;

    pub(crate) fn color(&self) -> Vec3 {
        match self {
            Self::Ellipse(splat) => splat.color,
            Self::Rays(ray) => ray.color,
        }
    }

    /// An ellipse, and the level of it that holds all drawn pixels.
    pub(crate) fn level(&self) -> (Ellipse, f64) {
        match self {
            Self::Ellipse(splat) => (splat.ellipse, f64::from(splat.radius)),
            Self::Rays(ray) => (ray.reach, 1.0),
        }
    }

    /// The splat, where its footprint is an ellipse.
    pub(crate) fn ellipse(&self) -> Option<&Splat> {
        match self {
            Self::Ellipse(splat) => Some(splat),
            Self::Rays(_) => None,
        }
    }

    pub(crate) fn is_by_rays(&self) -> bool {
        matches!(self, Self::Rays(_))
    }

    /// The same as blocks of pixels see it, in units of blocks.
    pub(crate) fn in_blocks(&self) -> Self {
        match self {
            Self::Ellipse(splat) => Self::Ellipse(splat.in_blocks()),
            Self::Rays(ray) => Self::Rays(Box::new(ray.in_blocks())),
        }
    }
}

/// A Gaussian whose footprint is an ellipse: α = 2^(log₂o − u² − v²) with u and v scaled by √(½·log₂e).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Splat {
    pub(crate) ellipse: Ellipse,
    /// √(½·log₂e) / ρ.
    pub(crate) per_column: f32,
    /// √(½·log₂e) / σ.
    pub(crate) per_row: f32,
    pub(crate) log_opacity: f32,
    /// log₂ of the opacity over the cut.
    pub(crate) range: f32,
    /// Standard deviations at which α reaches the cut.
    pub(crate) radius: f32,
    pub(crate) color: Vec3,
}

impl Splat {
    pub(crate) fn of(ellipse: &Ellipse, opacity: f64, color: DVec3, limits: Limits) -> Self {
        let unit = (0.5 * std::f64::consts::LOG2_E).sqrt();
        let range = (opacity / limits.cut).max(limits.ratio).log2();
        Self {
            ellipse: *ellipse,
            per_column: (unit / ellipse.along_row) as f32,
            per_row: (unit / ellipse.over_rows) as f32,
            log_opacity: opacity.log2() as f32,
            range: range as f32,
            radius: (range * (2.0 * std::f64::consts::LN_2)).sqrt() as f32,
            color: color.as_vec3(),
        }
    }

    /// The rows of a tile that the level at the cut reaches, from the place of the tile's first pixel.
    #[inline]
    pub(crate) fn rows(&self, [x, y]: [f64; 2]) -> impl Iterator<Item = SplatRow> {
        let e = &self.ellipse;
        let dy = y - e.center.y;
        // u and v at the first pixel, in f64 because the centre may be far away; from there on differences are small.
        let u0 = ((x - e.center.x - e.slope * dy) * f64::from(self.per_column)) as f32;
        let v0 = (dy * f64::from(self.per_row)) as f32;
        let u_per_row = (e.slope * f64::from(self.per_column)) as f32;
        let reach = f64::from(self.radius) * e.over_rows;
        // Rows within the level, at least; the casts saturate.
        let from = (-dy - reach).max(0.0) as usize;
        let to = ((reach - dy).max(-1.0) + 1.0) as usize;
        let (per_row, log_opacity, cut) = (self.per_row, self.log_opacity, self.log_opacity - self.range);
        (from..to.min(TILE)).filter_map(move |row| {
            let v = v0 + per_row * row as f32;
            let peak = log_opacity - v * v;
            (peak >= cut).then_some(SplatRow { row, u: u0 - u_per_row * row as f32, v, peak, cut })
        })
    }

    /// u and α at one vector of pixels of a row; `None` where all are below the cut.
    #[inline]
    pub(crate) fn alpha(&self, row: &SplatRow, half: usize) -> Option<(f32x8, f32x8)> {
        let column = f32x8::new([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]) * f32x8::splat(self.per_column);
        let u = column + f32x8::splat(row.u + self.per_column * LANES as f32 * half as f32);
        let power = f32x8::splat(row.peak) - u * u;
        let drawn = power.simd_ge(f32x8::splat(row.cut));
        drawn.any().then(|| (u, exp2(power).fast_min(f32x8::ONE) & drawn))
    }

    /// The same as blocks of pixels see it, in units of blocks.
    fn in_blocks(&self) -> Self {
        let unit = (0.5 * std::f64::consts::LOG2_E).sqrt();
        let (ellipse, log_factor) = in_blocks(&self.ellipse);
        Self {
            ellipse,
            per_column: (unit / ellipse.along_row) as f32,
            per_row: (unit / ellipse.over_rows) as f32,
            log_opacity: self.log_opacity + log_factor as f32,
            ..*self
        }
    }
}

/// A row of a tile's pixels that a splat reaches.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SplatRow {
    pub(crate) row: usize,
    /// u at its first pixel, scaled.
    u: f32,
    /// v, scaled.
    pub(crate) v: f32,
    /// log₂ of the highest α on it.
    peak: f32,
    /// log₂ of the α that is not drawn.
    cut: f32,
}

/// Vectors of a row.
pub(crate) const HALVES: usize = TILE / LANES;

/// One row of pixels while it is blended.
#[derive(Clone, Copy)]
struct Line {
    transmittance: [f32x8; HALVES],
    red: [f32x8; HALVES],
    green: [f32x8; HALVES],
    blue: [f32x8; HALVES],
    /// Whether every transmittance is below the stop.
    finished: bool,
}

/// A tile while it is blended.
pub(crate) struct Tile([Line; TILE]);

impl Tile {
    pub(crate) fn blend(splats: &[Drawn], list: &[u32], [x0, y0]: [usize; 2], stop: f32) -> Self {
        let zero = [f32x8::ZERO; HALVES];
        let line = Line { transmittance: [f32x8::ONE; HALVES], red: zero, green: zero, blue: zero, finished: false };
        let tile = Self([line; TILE]);
        let first = DVec2::new(x0 as f64 + 0.5, y0 as f64 + 0.5);
        tile.through(splats, list, stop, |tile, splat| tile.add(splat, first))
    }

    /// As [`Self::blend`] by blocks of pixels, each as one pixel of the tile's first rows and columns.
    fn blend_blocks(splats: &[Drawn], list: &[u32], corner: [usize; 2], stop: f32) -> Self {
        let zero = [f32x8::ZERO; HALVES];
        let line = Line { transmittance: zero, red: zero, green: zero, blue: zero, finished: true };
        let mut tile = Self([line; TILE]);
        for line in tile.0.iter_mut().take(BLOCKS) {
            // Of two vectors of pixels the first has all blocks.
            line.transmittance[0] = f32x8::ONE;
            line.finished = false;
        }
        let first = first_block(corner);
        tile.through(splats, list, stop, |tile, splat| tile.add(&splat.in_blocks(), first))
    }

    /// Blends a list by `add` until all rows are finished.
    fn through(mut self, splats: &[Drawn], list: &[u32], stop: f32, add: impl Fn(&mut Self, &Drawn)) -> Self {
        // A test for finished rows costs about as much as blending one, so test once for several Gaussians.
        for group in list.chunks(Drawn::GROUP) {
            group.iter().filter_map(|k| splats.get(*k as usize)).for_each(|splat| add(&mut self, splat));
            if self.finish(stop) {
                break;
            }
        }
        self
    }

    /// Marks finished rows; whether all are.
    fn finish(&mut self, stop: f32) -> bool {
        let stop = f32x8::splat(stop);
        let mut all = true;
        for line in &mut self.0 {
            let [a, b] = line.transmittance;
            line.finished = a.fast_max(b).simd_lt(stop).all();
            all &= line.finished;
        }
        all
    }

    /// Blends one Gaussian over the tile whose first pixel's centre is given.
    fn add(&mut self, splat: &Drawn, first: DVec2) {
        match splat {
            Drawn::Ellipse(splat) => self.add_ellipse(splat, first.to_array()),
            Drawn::Rays(ray) => self.add_rays(&Narrow::of(ray, first)),
        }
    }

    fn add_ellipse(&mut self, splat: &Splat, first: [f64; 2]) {
        for row in splat.rows(first) {
            let line = &mut self.0[row.row];
            if line.finished {
                continue;
            }
            for k in 0..HALVES {
                let Some((_, alpha)) = splat.alpha(&row, k) else { continue };
                let weight = alpha * line.transmittance[k];
                line.red[k] += weight * f32x8::splat(splat.color.x);
                line.green[k] += weight * f32x8::splat(splat.color.y);
                line.blue[k] += weight * f32x8::splat(splat.color.z);
                line.transmittance[k] -= weight;
            }
        }
    }

    /// Blends one Gaussian that each ray evaluates.
    fn add_rays(&mut self, splat: &Narrow) {
        let color = splat.color.to_array().map(f32x8::splat);
        for (row, line) in self.0.iter_mut().enumerate().take(splat.rows.end).skip(splat.rows.start) {
            if line.finished {
                continue;
            }
            for k in 0..HALVES {
                let Some((_, alphas)) = splat.meet(row, k * LANES) else { continue };
                let weight = f32x8::new(alphas) * line.transmittance[k];
                line.red[k] += weight * color[0];
                line.green[k] += weight * color[1];
                line.blue[k] += weight * color[2];
                line.transmittance[k] -= weight;
            }
        }
    }

    pub(crate) fn composite(&self, background: Vec3) -> TilePixels {
        let mut pixels = [[0.0; 4]; TILE * TILE];
        for (line, pixels) in self.0.iter().zip(pixels.chunks_mut(TILE)) {
            for (k, pixels) in pixels.chunks_mut(LANES).enumerate() {
                let t = line.transmittance[k];
                let over = |sum: f32x8, behind: f32| (sum + t * f32x8::splat(behind)).to_array();
                let red = over(line.red[k], background.x);
                let green = over(line.green[k], background.y);
                let blue = over(line.blue[k], background.z);
                let alpha = (f32x8::ONE - t).to_array();
                for ((((pixel, r), g), b), a) in pixels.iter_mut().zip(red).zip(green).zip(blue).zip(alpha) {
                    *pixel = [r, g, b, a];
                }
            }
        }
        pixels
    }
}
