//! The twin of [`record`](super::record) in f64: each pixel blends all Gaussians, without any cut-off.
//!
//! Its work is pixels times Gaussians, so it is for tests and measurements.

use glam::{DVec2, DVec3};
use rayon::prelude::*;
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::model::Scene;

use super::tile::SUMS;
use super::{GradientError, Gradients, background, by_attributes, check_trainable, projected};
use crate::project::Ellipse;
use crate::shading::Look;

/// Pixels handled by one task.
const CHUNK: usize = 64;

struct Layer {
    index: u32,
    ellipse: Ellipse,
    look: Look,
}

impl Layer {
    /// Distances in standard deviations along the row and over the rows.
    fn distances(&self, at: DVec2) -> (f64, f64) {
        let e = &self.ellipse;
        let d = at - e.center;
        ((d.x - e.slope * d.y) / e.along_row, d.y / e.over_rows)
    }

    fn alpha(&self, (u, v): (f64, f64)) -> f64 {
        self.look.opacity * (-0.5 * (u * u + v * v)).exp()
    }
}

/// Layers from near to far.
fn layers(scene: &Scene, appearance: &Appearance, camera: &Camera) -> Vec<Layer> {
    let (mut found, _) =
        projected(scene, appearance, camera, |index, order, ellipse, look| Ok((order, Layer { index, ellipse, look })));
    // Ties stay by index.
    found.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    found.into_iter().map(|(_, layer)| layer).collect()
}

/// Centre of pixel `k`.
fn center(camera: &Camera, k: usize) -> DVec2 {
    let width = camera.width as usize;
    DVec2::new((k % width) as f64 + 0.5, (k / width) as f64 + 0.5)
}

/// R, G, B over the background and A = 1 − transmittance of each pixel.
///
/// # Errors
/// [`GradientError`], as [`record`](super::record).
pub fn picture(scene: &Scene, appearance: &Appearance, camera: &Camera) -> Result<Vec<[f64; 4]>, GradientError> {
    check_trainable(scene, appearance, camera)?;
    let (layers, background) = (layers(scene, appearance, camera), background(appearance));
    let pixel = |k: usize| {
        let at = center(camera, k);
        let (mut color, mut transmittance) = (DVec3::ZERO, 1.0);
        for layer in &layers {
            let alpha = layer.alpha(layer.distances(at));
            color += transmittance * alpha * layer.look.color;
            transmittance *= 1.0 - alpha;
        }
        let DVec3 { x, y, z } = color + transmittance * background;
        [x, y, z, 1.0 - transmittance]
    };
    Ok((0..camera.width as usize * camera.height as usize).into_par_iter().map(pixel).collect())
}

/// Derivatives of the loss by the attributes of all Gaussians, from those by the pixels.
///
/// # Errors
/// [`GradientError`], as [`record`](super::record) and [`Recording::gradients`](super::Recording::gradients).
pub fn gradients(
    scene: &Scene,
    appearance: &Appearance,
    camera: &Camera,
    by_pixel: &[[f64; 4]],
) -> Result<Gradients, GradientError> {
    check_trainable(scene, appearance, camera)?;
    let expected = camera.width as usize * camera.height as usize;
    if by_pixel.len() != expected {
        return Err(GradientError::Pixels { found: by_pixel.len(), expected });
    }
    let (layers, background) = (layers(scene, appearance, camera), background(appearance));
    let parts: Vec<Vec<[f64; SUMS]>> = by_pixel
        .par_chunks(CHUNK)
        .enumerate()
        .map(|(chunk, by_pixel)| {
            let mut sums = vec![[0.0; SUMS]; layers.len()];
            for (k, by) in by_pixel.iter().enumerate() {
                add_pixel(&layers, center(camera, chunk * CHUNK + k), background, by, &mut sums);
            }
            sums
        })
        .collect();
    let mut sums = vec![[0.0; SUMS]; layers.len()];
    for part in parts {
        for (sum, part) in sums.iter_mut().zip(part) {
            sum.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
        }
    }
    let drawn = layers.iter().zip(sums).map(|(layer, sums)| (layer.index, layer.ellipse, sums));
    Ok(by_attributes(scene, appearance, camera, drawn))
}

fn add_pixel(layers: &[Layer], at: DVec2, background: DVec3, by: &[f64; 4], sums: &mut [[f64; SUMS]]) {
    let [red, green, blue, by_coverage] = *by;
    let by_color = DVec3::new(red, green, blue);
    let mut transmittance = 1.0;
    let before: Vec<f64> = layers
        .iter()
        .map(|layer| {
            let before = transmittance;
            transmittance *= 1.0 - layer.alpha(layer.distances(at));
            before
        })
        .collect();
    let (mut behind, mut coverage) = (background, 0.0);
    for ((layer, before), sums) in layers.iter().zip(before).zip(sums).rev() {
        let (u, v) = layer.distances(at);
        let alpha = layer.alpha((u, v));
        let contrast = layer.look.color - behind;
        let g = before * alpha * (contrast.dot(by_color) + (1.0 - coverage) * by_coverage);
        let [r, green, b] = (before * alpha * by_color).to_array();
        let terms = [g, g * u, g * v, g * u * u, g * u * v, g * v * v, r, green, b];
        sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
        behind += alpha * contrast;
        coverage += alpha * (1.0 - coverage);
    }
}
