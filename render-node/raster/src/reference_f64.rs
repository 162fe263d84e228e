//! The reference of all other backends and quality levels.
//!
//! EWA with 0.3 px dilation, near plane z > 1e-6, no Jacobian clamp, α ≤ 1, no early stop. The order is view z with
//! ties by index. All sums are in f64. A Gaussian extends out to α = δ with δ = 2⁻³³ / (N·max(1, c_max)). N is the
//! number of Gaussians, c_max the greatest component of any color or of the background. A missing layer of α < δ
//! changes a pixel by at most δ·c_max, all of them by at most 2⁻³³. That is 1/256 of the last bit of an f32 between
//! ½ and 1.

use std::time::Instant;

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::model::Scene;

use crate::image::Image;
use crate::project::{Projected, project};
use crate::raster::{TilePixels, draw};
use crate::report::{Culled, Report};
use crate::tiles::{TILE, picture_size};

/// Draws a checked scene.
pub(crate) fn render(scene: &Scene, appearance: &Appearance, camera: &Camera) -> (Image, Report) {
    let began = Instant::now();
    let (all, mut report) = project(scene, appearance, camera, Ok);
    let background = appearance.background.as_dvec3();
    let brightest = all.iter().fold(0.0, |m: f64, p| m.max(p.color.max_element()));
    let faintest = faintest(all.len(), brightest, appearance.background);
    let size = picture_size(camera.width, camera.height);
    let mut splats = Vec::with_capacity(all.len());
    for projected in all {
        let splat = Splat { radius: radius(projected.opacity, faintest), projected };
        if projected.ellipse.reaches(splat.radius, size) {
            splats.push(splat);
        } else {
            report.count(Culled::Outside);
        }
    }
    report.drawn = splats.len();
    report.seconds.preprocess = began.elapsed().as_secs_f64();
    let began = Instant::now();
    // The list is in index order and the sort is stable: ties stay by index.
    splats.par_sort_by(|a, b| a.projected.depth.total_cmp(&b.projected.depth));
    report.seconds.sort = began.elapsed().as_secs_f64();
    let image = draw(
        [camera.width, camera.height],
        &splats,
        |s| (s.projected.ellipse, s.radius),
        |corner, list| tile(&splats, list, corner, background),
        &mut report,
    );
    (image, report)
}

struct Splat {
    projected: Projected,
    /// Radius in standard deviations.
    radius: f64,
}

/// δ for `count` Gaussians with the greatest color component `brightest`.
pub(crate) fn faintest(count: usize, brightest: f64, background: Vec3) -> f64 {
    let brightest = background.as_dvec3().abs().max_element().max(1.0).max(brightest);
    (-33.0_f64).exp2() / (count.max(1) as f64 * brightest)
}

/// Radius in standard deviations at which a Gaussian of peak `opacity` has faded to `faintest`.
pub(crate) fn radius(opacity: f64, faintest: f64) -> f64 {
    (2.0 * (opacity / faintest).ln()).max(0.0).sqrt()
}

fn tile(splats: &[Splat], list: &[u32], [x0, y0]: [usize; 2], background: DVec3) -> TilePixels {
    let mut transmittance = [1.0_f64; TILE * TILE];
    let mut color = [DVec3::ZERO; TILE * TILE];
    for splat in list.iter().filter_map(|k| splats.get(*k as usize)) {
        let Projected { ellipse: e, color: c, opacity, .. } = splat.projected;
        for (row, (line_t, line_c)) in transmittance.chunks_mut(TILE).zip(color.chunks_mut(TILE)).enumerate() {
            let dy = (y0 + row) as f64 + 0.5 - e.center.y;
            let v = dy / e.over_rows;
            let reach = splat.radius * splat.radius - v * v;
            if reach < 0.0 {
                continue;
            }
            // Pixels whose centres lie within the level; the casts saturate at the tile's edges.
            let middle = e.center.x + e.slope * dy - x0 as f64 - 0.5;
            let half = e.along_row * reach.sqrt();
            let from = (middle - half).ceil().max(0.0) as usize;
            let to = ((middle + half).floor() + 1.0).max(0.0) as usize;
            for (x, (t, sum)) in line_t.iter_mut().zip(line_c).enumerate().take(to).skip(from) {
                let u = (x as f64 - middle) / e.along_row;
                let alpha = (opacity * (-0.5 * (u * u + v * v)).exp()).min(1.0);
                *sum += *t * alpha * c;
                *t *= 1.0 - alpha;
            }
        }
    }
    std::array::from_fn(|k| {
        let (t, sum) = (transmittance[k], color[k]);
        let [r, g, b] = (sum + t * background).to_array();
        [r as f32, g as f32, b as f32, (1.0 - t) as f32]
    })
}
