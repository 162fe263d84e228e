//! The fast rasterizer of the ray-consistent mode: rays in f32, eight at a time, with the cut-offs of
//! [`crate::splat_f32`].
//!
//! A tile of 16 × 16 pixels has one order: the depth on the ray that meets each Gaussian best within the tile. Each
//! ray sorts its layers again. A layer stays in the sort window until no later layer can lie before it, or until
//! the window is full. A Gaussian that lies deeper than a whole window of later ones is blended too early. That
//! happens where long thin Gaussians cross at random.
//!
//! Linear functions of the pixel are evaluated in f64 at a tile's first pixel. f32 holds only differences within
//! the tile.

use std::ops::Range;
use std::time::Instant;

use glam::{DVec2, Vec3};
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::model::Scene;
use wide::f32x8;

use super::{Fading, Linear, Pinhole, RaySplat, splats};
use crate::cutoffs::Limits;
use crate::foveation::scaled;
use crate::image::Image;
use crate::lanes::{LANES, exp2};
use crate::nearness::{FADE_WIDTH, NEAR_BLUR};
use crate::project::Ellipse;
use crate::raster::{TilePixels, draw};
use crate::report::{Culled, Report};
use crate::tiles::TILE;

/// Draws a checked scene; on each ray `WINDOW` layers are put in order.
pub(crate) fn render<const WINDOW: usize>(
    scene: &Scene,
    appearance: &Appearance,
    camera: &Camera,
    limits: Limits,
) -> (Image, Report) {
    let began = Instant::now();
    let pinhole = Pinhole::of(camera);
    let (splats, mut report) = splats(scene, appearance, camera, |s| Ray::of(&s, limits, &pinhole));
    report.seconds.preprocess = began.elapsed().as_secs_f64();
    let background = appearance.background;
    let image = draw(
        [camera.width, camera.height],
        &splats,
        |s| (s.reach, 1.0),
        |corner, list| tile::<WINDOW>(&splats, list, corner, limits.stop, background),
        &mut report,
    );
    (image, report)
}

/// A Gaussian ready to blend: α = 2^(log₂o − fall·s/(a² + s)).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ray {
    toward: Linear,
    across: Linear,
    over: Linear,
    depth_scale: f64,
    fading: Option<Fading>,
    /// Level 1 holds all pixels that are drawn.
    pub(crate) reach: Ellipse,
    /// ½·log₂e·|u|².
    fall: f32,
    log_opacity: f32,
    /// log₂ of the opacity over the cut.
    range: f32,
    pub(crate) color: Vec3,
}

impl Ray {
    pub(crate) fn of(splat: &RaySplat, limits: Limits, pinhole: &Pinhole) -> Result<Self, Culled> {
        let range = (splat.opacity / limits.cut).max(limits.ratio).log2();
        let radius = (range * (2.0 * std::f64::consts::LN_2)).sqrt();
        let reach = splat.reach(radius, pinhole).filter(|e| e.reaches(1.0, pinhole.size)).ok_or(Culled::Outside)?;
        let color = splat.color.as_vec3();
        if !color.is_finite() {
            return Err(Culled::NotFinite);
        }
        Ok(Self {
            toward: splat.toward,
            across: splat.across,
            over: splat.over,
            depth_scale: splat.depth_scale,
            fading: splat.fading,
            reach,
            // Beyond this nothing but its centre would be drawn, and infinity times zero is not a number.
            fall: (0.5 * std::f64::consts::LOG2_E * splat.eye_squared).min(1e30) as f32,
            log_opacity: splat.opacity.log2() as f32,
            range: range as f32,
            color,
        })
    }

    /// The same for rays through the middles of blocks of pixels, in units of blocks.
    pub(crate) fn in_blocks(&self) -> Self {
        let fading = self.fading.map(|f| Fading { right: f.right.in_blocks(), down: f.down.in_blocks(), ..f });
        Self {
            toward: self.toward.in_blocks(),
            across: self.across.in_blocks(),
            over: self.over.in_blocks(),
            reach: scaled(&self.reach),
            fading,
            ..*self
        }
    }

    /// Depth on the ray through the pixel of a tile that lies nearest to the Gaussian's middle.
    fn depth(&self, first: DVec2) -> f32 {
        self.depth_at(self.reach.center.clamp(first, first + (TILE - 1) as f64))
    }

    /// About the least depth on rays of the tile: that at the corners of what it may touch there.
    fn nearest(&self, first: DVec2) -> f32 {
        let half = self.reach.half_size(1.0);
        let last = first + (TILE - 1) as f64;
        let low = (self.reach.center - half).clamp(first, last);
        let high = (self.reach.center + half).clamp(first, last);
        let corners = [low, DVec2::new(high.x, low.y), DVec2::new(low.x, high.y), high];
        corners.into_iter().map(|corner| self.depth_at(corner)).fold(self.depth(first), f32::min)
    }

    fn depth_at(&self, pixel: DVec2) -> f32 {
        let a = self.toward.at(pixel).max(0.0);
        let (u, v) = (self.across.at(pixel), self.over.at(pixel));
        (self.depth_scale * (a / (a * a + u * u + v * v))) as f32
    }
}

/// A Gaussian over one tile, everything relative to the tile's first pixel.
pub(crate) struct Narrow {
    /// a at the first pixel, per column, per row.
    toward: [f32; 3],
    across: [f32; 3],
    /// V at the first pixel and per row.
    over: [f32; 2],
    depth_scale: f32,
    fall: f32,
    peak: f32,
    cut: f32,
    pub(crate) color: Vec3,
    fading: Option<NarrowFading>,
    /// Least depth of this one and of all that come after it.
    nearest: f32,
    /// Rows that it may touch.
    pub(crate) rows: Range<usize>,
}

/// [`Fading`] over one tile.
struct NarrowFading {
    scale: f32,
    right: [f32; 3],
    down: [f32; 3],
    near: f32,
}

impl NarrowFading {
    /// The share beyond the near distance of eight rays, from their x and y, depths and a² + s.
    fn share(&self, [right, down]: [f32x8; 2], depth: f32x8, whole: f32x8) -> f32x8 {
        let near = f32x8::splat(self.near) / (f32x8::ONE + right * right + down * down).sqrt();
        let width = f32x8::ONE / (f32x8::splat(self.scale) * whole.sqrt()).fast_max(f32x8::splat(f32::MIN_POSITIVE));
        let blur = f32x8::splat(NEAR_BLUR as f32) * near;
        // In units of the larger one: the squares of very large and small lengths leave f32.
        let larger = width.fast_max(blur).fast_max(f32x8::splat(f32::MIN_POSITIVE));
        let (width, blur) = (width / larger, blur / larger);
        let ahead = (depth - near) / larger / (width * width + blur * blur).sqrt();
        let half = f32x8::splat(0.5);
        let y = (ahead * f32x8::splat((0.5 / FADE_WIDTH) as f32) + half).fast_max(f32x8::ZERO).fast_min(f32x8::ONE);
        y * y * y * (y * (f32x8::splat(6.0) * y - f32x8::splat(15.0)) + f32x8::splat(10.0))
    }
}

impl Narrow {
    pub(crate) fn of(splat: &Ray, first: DVec2) -> Self {
        let at = |l: &Linear| [l.at(first) as f32, l.per_x as f32, l.per_y as f32];
        let [v, _, v_per_row] = at(&splat.over);
        // Rows within the level, at least; the casts saturate.
        let dy = first.y - splat.reach.center.y;
        let tall = splat.reach.over_rows;
        Self {
            toward: at(&splat.toward),
            across: at(&splat.across),
            over: [v, v_per_row],
            depth_scale: splat.depth_scale as f32,
            fall: splat.fall,
            peak: splat.log_opacity,
            cut: splat.log_opacity - splat.range,
            color: splat.color,
            fading: splat.fading.as_ref().map(|f| NarrowFading {
                scale: f.scale as f32,
                right: at(&f.right),
                down: at(&f.down),
                near: f.near as f32,
            }),
            nearest: splat.nearest(first),
            rows: (-dy - tall).max(0.0) as usize..((tall - dy).max(-1.0) + 1.0) as usize,
        }
    }

    /// Depths and opacities along eight rays of a row of the tile, from a column on. `None` if it is drawn on none.
    pub(crate) fn meet(&self, row: usize, column: usize) -> Option<([f32; LANES], [f32; LANES])> {
        let (row, column) = (row as f32, column as f32);
        let lanes = f32x8::new([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
        let along = |[at, per_column, per_row]: [f32; 3]| {
            lanes * f32x8::splat(per_column) + f32x8::splat(at + per_row * row + per_column * column)
        };
        let (a, u) = (along(self.toward), along(self.across));
        let [v, v_per_row] = self.over;
        let v = v + v_per_row * row;
        let s = u * u + f32x8::splat(v * v);
        let inverse = f32x8::ONE / (a * a + s);
        let ahead = a.simd_gt(f32x8::ZERO);
        // Only of one that fades does the line behind the eye count.
        let met = if self.fading.is_some() { s * inverse } else { ahead.select(s * inverse, f32x8::ONE) };
        let power = f32x8::splat(self.peak) - f32x8::splat(self.fall) * met;
        let drawn = power.simd_ge(f32x8::splat(self.cut));
        if !drawn.any() {
            return None;
        }
        let depth = f32x8::splat(self.depth_scale) * a * inverse;
        let mut alpha = exp2(power) & drawn;
        if let Some(fading) = &self.fading {
            alpha *= fading.share([along(fading.right), along(fading.down)], depth, a * a + s);
        }
        Some(((depth & ahead).to_array(), alpha.fast_min(f32x8::ONE).to_array()))
    }
}

/// The layers of one ray: the nearest are blended, up to `WINDOW` layers stay sorted by depth.
#[derive(Clone, Copy)]
struct Pixel<const WINDOW: usize> {
    /// A ring, sorted by depth: depth, opacity, place in the tile's list.
    waiting: [(f32, f32, u32); WINDOW],
    first: usize,
    count: usize,
    transmittance: f32,
    /// Transmittance of all layers so far, including the sort window.
    through: f32,
    color: Vec3,
}

impl<const WINDOW: usize> Pixel<WINDOW> {
    const CLEAR: Self = Self {
        waiting: [(0.0, 0.0, 0); WINDOW],
        first: 0,
        count: 0,
        transmittance: 1.0,
        through: 1.0,
        color: Vec3::ZERO,
    };

    /// Nothing in front of the background again.
    fn clear(&mut self) {
        (self.first, self.count, self.color) = (0, 0, Vec3::ZERO);
        (self.transmittance, self.through) = (1.0, 1.0);
    }

    /// Takes one more layer up, behind those of equal depth. If there is no room, it blends the nearest. If less than `stop` is
    /// seen through all waiting layers, a layer behind them would only take a nearer one's place.
    fn push(&mut self, depth: f32, alpha: f32, item: u32, (list, stop): (&[Narrow], f32)) {
        let deepest = self.waiting[(self.first + self.count.max(1) - 1) % WINDOW].0;
        if self.through < stop && self.count > 0 && depth >= deepest {
            return;
        }
        self.through *= 1.0 - alpha;
        if self.count == WINDOW {
            self.pop(list);
        }
        let mut place = self.count;
        while place > 0 {
            let before = self.waiting[(self.first + place - 1) % WINDOW];
            if before.0 <= depth {
                break;
            }
            self.waiting[(self.first + place) % WINDOW] = before;
            place -= 1;
        }
        self.waiting[(self.first + place) % WINDOW] = (depth, alpha, item);
        self.count += 1;
    }

    /// Blends all layers before a depth.
    fn pop_before(&mut self, depth: f32, list: &[Narrow]) {
        while self.count > 0 && self.waiting[self.first].0 < depth {
            self.pop(list);
        }
    }

    /// Blends the nearest layer.
    fn pop(&mut self, list: &[Narrow]) {
        let (_, alpha, item) = self.waiting[self.first];
        self.first = (self.first + 1) % WINDOW;
        self.count -= 1;
        let weight = alpha * self.transmittance;
        self.color += weight * list.get(item as usize).map_or(Vec3::ZERO, |n| n.color);
        self.transmittance -= weight;
    }
}

fn tile<const WINDOW: usize>(
    splats: &[Ray],
    list: &[u32],
    [x0, y0]: [usize; 2],
    stop: f32,
    background: Vec3,
) -> TilePixels {
    let first = DVec2::new(x0 as f64 + 0.5, y0 as f64 + 0.5);
    // Depths are at least 0, so that their bits order as they do; ties by index.
    let mut order: Vec<u64> = list
        .iter()
        .filter_map(|k| Some(u64::from(splats.get(*k as usize)?.depth(first).to_bits()) << 32 | u64::from(*k)))
        .collect();
    order.sort_unstable();
    let mut list: Vec<Narrow> = order
        .into_iter()
        .filter_map(|key| splats.get(key as u32 as usize))
        .map(|splat| Narrow::of(splat, first))
        .collect();
    list.iter_mut().rev().fold(f32::INFINITY, |least, n| {
        n.nearest = n.nearest.min(least);
        n.nearest
    });
    let mut pixels = [[0.0; 4]; TILE * TILE];
    let mut line = [Pixel::<WINDOW>::CLEAR; TILE];
    for (row, out) in pixels.chunks_mut(TILE).enumerate() {
        line.iter_mut().for_each(Pixel::clear);
        for (item, splat) in list.iter().enumerate() {
            // Once for several Gaussians: layers before all coming ones are blended, and a row may be finished.
            if item % 8 == 0 {
                line.iter_mut().for_each(|p| p.pop_before(splat.nearest, &list));
                if line.iter().all(|p| p.transmittance < stop) {
                    break;
                }
            }
            if !splat.rows.contains(&row) {
                continue;
            }
            for (half, pixels) in line.chunks_mut(LANES).enumerate() {
                let Some((depths, alphas)) = splat.meet(row, half * LANES) else { continue };
                for ((pixel, depth), alpha) in pixels.iter_mut().zip(depths).zip(alphas) {
                    if alpha > 0.0 && pixel.transmittance >= stop {
                        pixel.push(depth, alpha, item as u32, (&list, stop));
                    }
                }
            }
        }
        for (pixel, out) in line.iter_mut().zip(out) {
            while pixel.count > 0 {
                pixel.pop(&list);
            }
            let over = pixel.color + pixel.transmittance * background;
            *out = [over.x, over.y, over.z, 1.0 - pixel.transmittance];
        }
    }
    pixels
}
