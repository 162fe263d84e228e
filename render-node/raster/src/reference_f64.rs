//! The reference of all other backends and quality levels.
//!
//! EWA with 0.3 px dilation, rays where that does not hold ([`crate::footprint`]), α ≤ 1, no early stop. The order is
//! [`crate::nearness::order`] with ties by index. All sums are in f64. A Gaussian extends out to α = δ with δ = 2⁻³³ / (N·max(1, c_max)). N is the
//! number of Gaussians, c_max the greatest component of any color or of the background. A missing layer of α < δ
//! changes a pixel by at most δ·c_max, all of them by at most 2⁻³³. That is 1/256 of the last bit of an f32 between
//! ½ and 1.

use std::time::Instant;

use glam::{DVec2, DVec3};
use rayon::prelude::*;
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::model::Scene;

use crate::cutoffs::{faintest, radius};
use crate::footprint::{Footprint, Shape, footprints};
use crate::image::Image;
use crate::project::Ellipse;
use crate::raster::{TilePixels, draw};
use crate::ray_consistent::Pinhole;
use crate::report::{Culled, Report};
use crate::tiles::TILE;

/// Draws a checked scene.
pub(crate) fn render(scene: &Scene, appearance: &Appearance, camera: &Camera) -> (Image, Report) {
    let began = Instant::now();
    let (all, mut report) = footprints(scene, appearance, camera, |_, footprint| Ok(footprint));
    let background = appearance.background.as_dvec3();
    let brightest = all.iter().fold(0.0, |m: f64, p| m.max(p.color.max_element()));
    let faintest = faintest(all.len(), brightest, appearance.background);
    let pinhole = Pinhole::of(camera);
    let mut splats = Vec::with_capacity(all.len());
    for footprint in all {
        let radius = radius(footprint.opacity, faintest);
        match footprint.level(radius, &pinhole) {
            Some(level) => splats.push(Splat { footprint, level, radius }),
            None => report.count(Culled::Outside),
        }
    }
    report.drawn = splats.len();
    report.seconds.preprocess = began.elapsed().as_secs_f64();
    let began = Instant::now();
    // The list is in index order and the sort is stable: ties stay by index.
    splats.par_sort_by(|a, b| a.footprint.order.total_cmp(&b.footprint.order));
    report.seconds.sort = began.elapsed().as_secs_f64();
    let image = draw(
        [camera.width, camera.height],
        &splats,
        |s| s.level,
        |corner, list| tile(&splats, list, corner, background),
        &mut report,
    );
    (image, report)
}

struct Splat {
    footprint: Footprint,
    /// An ellipse and its level that hold the radius.
    level: (Ellipse, f64),
    /// Radius in standard deviations.
    radius: f64,
}

fn tile(splats: &[Splat], list: &[u32], [x0, y0]: [usize; 2], background: DVec3) -> TilePixels {
    let mut transmittance = [1.0_f64; TILE * TILE];
    let mut color = [DVec3::ZERO; TILE * TILE];
    for splat in list.iter().filter_map(|k| splats.get(*k as usize)) {
        let Footprint { color: c, opacity, .. } = splat.footprint;
        let e = match &splat.footprint.shape {
            Shape::Ellipse(ellipse) => ellipse,
            Shape::Rays(ray) => {
                let limit = splat.radius * splat.radius;
                for (k, (t, sum)) in transmittance.iter_mut().zip(&mut color).enumerate() {
                    let meeting = ray.meet(DVec2::new((x0 + k % TILE) as f64 + 0.5, (y0 + k / TILE) as f64 + 0.5));
                    if meeting.distance_squared <= limit {
                        let alpha = ray.alpha(meeting);
                        *sum += *t * alpha * c;
                        *t *= 1.0 - alpha;
                    }
                }
                continue;
            }
        };
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
