//! The reference of the view-consistent mode: every ray in f64, every pixel sorted by itself, ties by index.
//!
//! Gaussians are followed as far as in the affine reference ([`crate::reference_f64`]), and leave out as little.

use std::time::Instant;

use glam::{DVec2, DVec3};
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::model::Scene;

use super::{Pinhole, RaySplat, splats};
use crate::cutoffs::{faintest, radius};
use crate::image::Image;
use crate::project::Ellipse;
use crate::raster::{TilePixels, draw};
use crate::report::{Culled, Report};
use crate::tiles::TILE;

/// Draws a checked scene.
pub(crate) fn render(scene: &Scene, appearance: &Appearance, camera: &Camera) -> (Image, Report) {
    let (bounded, mut report) = bounded(scene, appearance, camera);
    let background = appearance.background.as_dvec3();
    let image = draw(
        [camera.width, camera.height],
        &bounded,
        |b| (b.reach, 1.0),
        |corner, list| tile(&bounded, list, corner, background),
        &mut report,
    );
    (image, report)
}

/// A Gaussian and the pixels that it may show in.
#[derive(Debug)]
pub(crate) struct Bounded {
    pub(crate) splat: RaySplat,
    /// Level 1 holds all pixels within `limit`.
    pub(crate) reach: Ellipse,
    /// Greatest d² that is followed.
    limit: f64,
}

/// All that may show, in index order.
pub(crate) fn bounded(scene: &Scene, appearance: &Appearance, camera: &Camera) -> (Vec<Bounded>, Report) {
    let began = Instant::now();
    let (all, mut report) = splats(scene, appearance, camera, Ok);
    let brightest = all.iter().fold(0.0, |m: f64, s| m.max(s.color.max_element()));
    let faintest = faintest(all.len(), brightest, appearance.background);
    let pinhole = Pinhole::of(camera);
    let mut bounded = Vec::with_capacity(all.len());
    for splat in all {
        let radius = radius(splat.opacity, faintest);
        match splat.reach(radius, &pinhole) {
            Some(reach) if reach.reaches(1.0, pinhole.size) => {
                bounded.push(Bounded { splat, reach, limit: radius * radius });
            }
            _ => report.count(Culled::Outside),
        }
    }
    report.drawn = bounded.len();
    report.seconds.preprocess = began.elapsed().as_secs_f64();
    (bounded, report)
}

/// The layers of one ray.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Layer {
    pub(crate) depth: f64,
    pub(crate) alpha: f64,
    /// Index in the input list.
    pub(crate) item: u32,
}

/// Fills `layers` with the layers along the ray through pixel coordinates, near to far. `list` is in index order.
pub(crate) fn layers_at(bounded: &[Bounded], list: &[u32], pixel: DVec2, layers: &mut Vec<Layer>) {
    layers.clear();
    for (item, Bounded { splat, limit, .. }) in list.iter().filter_map(|k| Some((*k, bounded.get(*k as usize)?))) {
        let meeting = splat.meet(pixel);
        if meeting.distance_squared <= *limit && meeting.share > 0.0 {
            layers.push(Layer { depth: meeting.depth, alpha: splat.alpha(meeting), item });
        }
    }
    // Stable: ties stay by index.
    layers.sort_by(|a, b| a.depth.total_cmp(&b.depth));
}

fn tile(bounded: &[Bounded], list: &[u32], [x0, y0]: [usize; 2], background: DVec3) -> TilePixels {
    let mut layers = Vec::with_capacity(list.len());
    std::array::from_fn(|k| {
        let pixel = DVec2::new((x0 + k % TILE) as f64 + 0.5, (y0 + k / TILE) as f64 + 0.5);
        layers_at(bounded, list, pixel, &mut layers);
        let (mut transmittance, mut sum) = (1.0, DVec3::ZERO);
        for layer in &layers {
            let color = bounded.get(layer.item as usize).map_or(DVec3::ZERO, |b| b.splat.color);
            sum += transmittance * layer.alpha * color;
            transmittance *= 1.0 - layer.alpha;
        }
        let [r, g, b] = (sum + transmittance * background).to_array();
        [r as f32, g as f32, b as f32, (1.0 - transmittance) as f32]
    })
}
