//! Gradients of a picture by the attributes of its Gaussians, for training (Kerbl et al. 2023, section 4; iVR-GS for the shading).
//!
//! [`record`] draws a picture in the affine projection. [`Recording::gradients`] takes the derivatives of a number, the loss, by
//! the picture's RGB and A. It returns those by position, rotation, scale, opacity and all shading attributes. For a pixel
//! with layers of colours cᵢ and opacities αᵢ from near to far, Tᵢ = Π_{j<i}(1 − αⱼ) and the colour Bᵢ of all that lies behind:
//!
//! - ∂C/∂cᵢ = Tᵢ·αᵢ
//! - ∂C/∂αᵢ = Tᵢ·(cᵢ − Bᵢ)
//!
//! Bᵢ is summed from the back. So nothing divides by 1 − α, and opaque layers keep their derivatives. Blending and its
//! derivatives are in f32, eight pixels at a time. All that is once a Gaussian is in f64.
//!
//! A Gaussian that is large for its depth is taken by the affine projection, although
//! [`render`](crate::render::render) evaluates it by rays. Pictures for training show the whole scene from outside, where
//! there is none. The cut-off of [`Limits`] leaves the tails out: with 1/255 the derivatives by place and scale would lose up to a fifth.
//!
//! [`exact`] is the twin in f64 without any cut-off. Tests compare it with central differences of its own picture.

mod attributes;
mod cut;
pub mod exact;
mod lighting;
mod tile;

use std::time::Instant;

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use sg_scene::appearance::{Appearance, PixelFilter, ShadingTerm};
use sg_scene::camera::Camera;
use sg_scene::model::{BaseUnit, Scene};

use crate::cutoffs::Limits;
use crate::depth::near_to_far;
use crate::image::Image;
use crate::project::{Dilation, Ellipse, place, project};
use crate::raster::draw_row;
use crate::ray_consistent::Pinhole;
use crate::render::{RenderError, check};
use crate::report::{Culled, Report};
use crate::shading::Look;
use crate::splat_f32::{Drawn, Splat, Tile};
use crate::tiles::{Batch, Grid, TILE, TileRow};

use attributes::UnitChain;
use tile::{SUMS, TileDerivatives, sums_of_tile};

/// A picture that has no gradients.
#[derive(Debug, thiserror::Error)]
pub enum GradientError {
    /// The picture itself is not possible.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// A base unit without shading attributes.
    #[error("base unit `{0}` has no shading attributes; only editable Gaussians are trained")]
    Unlit(String),
    /// Edits that change colours or opacities of single Gaussians.
    #[error(
        "the appearance has edits, a map of colours or a part of the shading; train the scene as its file shows it"
    )]
    Edited,
    /// A preview, which stands for a larger picture.
    #[error("a preview is not trained on; use a picture at its own size")]
    Preview,
    /// The derivatives are of another picture.
    #[error("{found} derivatives for {expected} pixels")]
    Pixels {
        /// Derivatives given.
        found: usize,
        /// Pixels of the picture.
        expected: usize,
    },
}

/// Derivatives of the loss by the stored columns of one Gaussian.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct GaussianGradient {
    /// By the position, local frame.
    pub position: DVec3,
    /// By the quaternion `[w, x, y, z]` as stored, of any length.
    pub rotation: [f64; 4],
    /// By the logarithms of the scales.
    pub log_scale: DVec3,
    /// By the logit of the opacity.
    pub opacity_logit: f64,
    /// By the offset colour Δc.
    pub offset_color: DVec3,
    /// By the normal as stored.
    pub normal: DVec3,
    /// By the ambient factor ka.
    pub ambient: f64,
    /// By the diffuse factor kd.
    pub diffuse: f64,
    /// By the specular factor ks.
    pub specular: f64,
    /// By the specular exponent β.
    pub shininess: f64,
    /// Length of the derivative by its place on the picture, per pixel: the measure by which 3DGS densifies.
    pub on_screen: f64,
}

/// Derivatives of the loss by everything that a scene's file holds.
#[derive(Debug, Clone, PartialEq)]
pub struct Gradients {
    /// One for each Gaussian in scene order; zeros where it is not drawn.
    pub gaussians: Vec<GaussianGradient>,
    /// By the palette colour of each base unit.
    pub palettes: Vec<DVec3>,
}

/// A drawn picture and all that its gradients need.
pub struct Recording<'a> {
    scene: &'a Scene,
    appearance: &'a Appearance,
    camera: &'a Camera,
    stop: f32,
    /// From near to far.
    splats: Vec<Drawn>,
    /// Scene-wide indices of those.
    indices: Vec<u32>,
    lists: Vec<(Batch, Vec<TileRow>)>,
    /// The picture.
    pub image: Image,
    /// Counts and times.
    pub report: Report,
}

/// Draws a scene and keeps what its gradients need. The near distance of the camera has no effect.
///
/// # Errors
/// [`GradientError`]: the picture is not possible, or it has parts that training does not know.
pub fn record<'a>(
    scene: &'a Scene,
    appearance: &'a Appearance,
    camera: &'a Camera,
    limits: Limits,
) -> Result<Recording<'a>, GradientError> {
    check_trainable(scene, appearance, camera)?;
    let clock = Instant::now();
    let size = [camera.width, camera.height];
    let extent = Pinhole::of(camera).size;
    let (found, mut report) = projected(scene, appearance, camera, |index, order, ellipse, look| {
        let splat = Splat::of(&ellipse, look.opacity, look.color, limits);
        if !ellipse.reaches(f64::from(splat.radius), extent) {
            return Err(Culled::Outside);
        }
        let (order, drawn) = (order as f32, Drawn::Ellipse(splat));
        if order.is_finite() && drawn.color().is_finite() { Ok((index, order, drawn)) } else { Err(Culled::NotFinite) }
    });
    report.seconds.preprocess = clock.elapsed().as_secs_f64();
    let clock = Instant::now();
    let order = near_to_far(found.iter().map(|(_, order, _)| *order));
    let (splats, indices): (Vec<Drawn>, Vec<u32>) =
        order.iter().filter_map(|k| found.get(*k as usize)).map(|(index, _, drawn)| (drawn.clone(), *index)).unzip();
    report.seconds.sort = clock.elapsed().as_secs_f64();
    let grid = Grid::of(camera.width, camera.height);
    let mut image = Image { width: size[0], height: size[1], rgba: Vec::new() };
    let mut pixels = vec![[0.0; 4]; size[0] as usize * size[1] as usize];
    let width = size[0] as usize;
    let mut lists = Vec::new();
    for batch in grid.batches(&splats, Drawn::level) {
        let clock = Instant::now();
        let rows = grid.bin(&batch, &splats, Drawn::level);
        report.seconds.bin += clock.elapsed().as_secs_f64();
        report.tile_pairs += rows.iter().map(TileRow::pairs).sum::<u64>();
        let clock = Instant::now();
        let tile = |corner: [usize; 2], list: &[u32]| {
            Tile::blend(&splats, list, corner, limits.stop).composite(appearance.background)
        };
        pixels
            .par_chunks_mut(TILE * width)
            .enumerate()
            .skip(batch.rows.start)
            .zip(&rows)
            .for_each(|((row, pixels), tiles)| draw_row(row, pixels, width, tiles, &tile));
        report.seconds.raster += clock.elapsed().as_secs_f64();
        lists.push((batch, rows));
    }
    image.rgba = pixels.into_flattened();
    Ok(Recording { scene, appearance, camera, stop: limits.stop, splats, indices, lists, image, report })
}

impl Recording<'_> {
    /// Derivatives of the loss by the attributes of all Gaussians. `by_pixel` has those by R, G, B and A of each pixel, rows from the
    /// top. The result does not depend on the number of threads.
    ///
    /// # Errors
    /// [`GradientError::Pixels`] if there is not one for each pixel.
    pub fn gradients(&self, by_pixel: &[[f32; 4]]) -> Result<Gradients, GradientError> {
        let expected = self.image.width as usize * self.image.height as usize;
        if by_pixel.len() != expected {
            return Err(GradientError::Pixels { found: by_pixel.len(), expected });
        }
        let mut sums = vec![[0.0_f64; SUMS]; self.splats.len()];
        for (batch, rows) in &self.lists {
            let parts: Vec<Vec<[f32; SUMS]>> = rows
                .par_iter()
                .enumerate()
                .map(|(row, tiles)| self.sums_of_row(batch.rows.start + row, tiles, by_pixel))
                .collect();
            // In the order of the lists, whatever thread made them.
            for (tiles, parts) in rows.iter().zip(parts) {
                for (splat, part) in tiles.tiles().flat_map(|(_, list)| list).zip(parts) {
                    let sum = &mut sums[*splat as usize];
                    sum.iter_mut().zip(part).for_each(|(sum, part)| *sum += f64::from(part));
                }
            }
        }
        let ellipses = self.splats.iter().map(|drawn| drawn.level().0);
        let drawn =
            self.indices.iter().copied().zip(ellipses.zip(sums)).map(|(index, (ellipse, sums))| (index, ellipse, sums));
        Ok(by_attributes(self.scene, self.appearance, self.camera, drawn))
    }

    fn sums_of_row(&self, row: usize, tiles: &TileRow, by_pixel: &[[f32; 4]]) -> Vec<[f32; SUMS]> {
        let tiles: Vec<(usize, &[u32])> = tiles.tiles().collect();
        let (width, background) = (self.image.width as usize, self.appearance.background);
        let parts: Vec<Vec<[f32; SUMS]>> = tiles
            .into_par_iter()
            .map(|(column, list)| {
                let corner = [column * TILE, row * TILE];
                let derivatives = TileDerivatives::of(by_pixel, width, corner);
                sums_of_tile(&self.splats, list, corner, (self.stop, background), &derivatives)
            })
            .collect();
        parts.concat()
    }
}

/// Places, shades and projects all Gaussians by the affine projection; `keep` gets index, order, ellipse and look.
fn projected<T: Send>(
    scene: &Scene,
    appearance: &Appearance,
    camera: &Camera,
    keep: impl Fn(u32, f64, Ellipse, Look) -> Result<T, Culled> + Sync,
) -> (Vec<T>, Report) {
    let pinhole = Pinhole::of(camera);
    place(scene, appearance, camera, |index, placed| {
        let (ellipse, opacity) = project(&placed, pinhole.focal, pinhole.principal, Dilation::round(pinhole.dilation))?;
        keep(index, placed.center.z, ellipse, Look { opacity, ..placed.look })
    })
}

/// From derivatives by ellipses and colours on the picture to those by attributes. Each drawn Gaussian comes once.
fn by_attributes(
    scene: &Scene,
    appearance: &Appearance,
    camera: &Camera,
    drawn: impl Iterator<Item = (u32, Ellipse, [f64; SUMS])>,
) -> Gradients {
    let mut slots: Vec<Option<(Ellipse, [f64; SUMS])>> = vec![None; scene.len()];
    for (index, ellipse, sums) in drawn {
        if let Some(slot) = slots.get_mut(index as usize) {
            *slot = Some((ellipse, sums));
        }
    }
    let mut gradients = Gradients { gaussians: Vec::with_capacity(scene.len()), palettes: Vec::new() };
    for (unit, base) in scene.units.iter().zip(&appearance.base) {
        let chain = UnitChain::new(unit, *base, appearance, camera);
        let slots = slots.get(unit.range()).unwrap_or_default();
        let found: Vec<(GaussianGradient, DVec3)> = slots
            .par_iter()
            .enumerate()
            .with_min_len(256)
            .map(|(i, slot)| {
                slot.as_ref().and_then(|(ellipse, sums)| chain.gradient(i, ellipse, sums)).unwrap_or_default()
            })
            .collect();
        // In the order of the Gaussians: f64 sums depend on it.
        gradients.palettes.push(found.iter().map(|(_, by_palette)| *by_palette).sum());
        gradients.gaussians.extend(found.into_iter().map(|(gradient, _)| gradient));
    }
    gradients
}

fn check_trainable(scene: &Scene, appearance: &Appearance, camera: &Camera) -> Result<(), GradientError> {
    check(scene, appearance, camera)?;
    if let Some(unit) = scene.units.iter().find(|u| u.gaussians.shading.is_none()) {
        return Err(GradientError::Unlit(unit.name.clone()));
    }
    let Appearance { units, overlay, colors, occlusion, term, .. } = appearance;
    if !units.is_empty() || overlay.is_some() || colors.is_some() || occlusion.is_some() || *term != ShadingTerm::Full {
        return Err(GradientError::Edited);
    }
    if camera.preview_scale < 1.0 { Err(GradientError::Preview) } else { Ok(()) }
}

/// Whether opacities make up for the dilation of a unit's Gaussians.
fn is_compensated(unit: &BaseUnit, appearance: &Appearance) -> bool {
    match appearance.filter {
        PixelFilter::Plain => false,
        PixelFilter::Compensated => true,
        PixelFilter::FromFile => unit.gaussians.antialiased,
    }
}

/// The background in f64.
fn background(appearance: &Appearance) -> DVec3 {
    let Vec3 { x, y, z } = appearance.background;
    DVec3::new(f64::from(x), f64::from(y), f64::from(z))
}

#[cfg(test)]
mod tests;
