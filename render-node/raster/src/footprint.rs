//! What a Gaussian covers in the affine mode: an ellipse where that projection holds, and meetings with rays where it does not.
//!
//! The affine projection takes the perspective at a Gaussian's center for all of it. Beside the eye its ellipses grow
//! without a bound and cover the picture. So rays evaluate Gaussians that are large for their depth or near the eye
//! ([`perspective`]), as in the ray-consistent mode. All are in one order ([`order`]). Near the eye that order and the dilation of
//! ellipses are close to those of rays.

use glam::{DVec2, DVec3};
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::model::Scene;

use crate::nearness::{dilation_slope, order, perspective, size_of};
use crate::project::{Dilation, Ellipse, place, project};
use crate::ray_consistent::{Pinhole, RaySplat};
use crate::report::{Culled, Report};

/// Shape of a Gaussian on the picture.
#[derive(Debug)]
pub(crate) enum Shape {
    Ellipse(Ellipse),
    Rays(Box<RaySplat>),
}

/// One projected and shaded Gaussian.
#[derive(Debug)]
pub(crate) struct Footprint {
    pub(crate) shape: Shape,
    /// By which they are ordered.
    pub(crate) order: f64,
    /// RGB, at least 0.
    pub(crate) color: DVec3,
    /// Above 0, at most 1.
    pub(crate) opacity: f64,
}

/// Projects and shades all Gaussians in index order. `keep` narrows each drawn one to a rasterizer's form, or culls it; it gets
/// the scene-wide index.
pub(crate) fn footprints<T: Send>(
    scene: &Scene,
    appearance: &Appearance,
    camera: &Camera,
    keep: impl Fn(u32, Footprint) -> Result<T, Culled> + Sync,
) -> (Vec<T>, Report) {
    let pinhole = Pinhole::of(camera);
    let slopes = pinhole.slopes();
    place(scene, appearance, camera, |index, placed| {
        let order = order(placed.center, pinhole.near);
        let footprint = match perspective(placed.center, size_of(&placed.rows), pinhole.near) {
            None => {
                let dilation = Dilation::at(pinhole.dilation, dilation_slope(placed.center, slopes, pinhole.near));
                let (ellipse, opacity) = project(&placed, pinhole.focal, pinhole.principal, dilation)?;
                Footprint { shape: Shape::Ellipse(ellipse), order, color: placed.look.color, opacity }
            }
            Some(perspective) => {
                let splat = RaySplat::of(index, &placed, &pinhole, perspective)?;
                let (color, opacity) = (splat.color, splat.opacity);
                Footprint { shape: Shape::Rays(Box::new(splat)), order, color, opacity }
            }
        };
        keep(index, footprint)
    })
}

impl Footprint {
    /// An ellipse, and its level in standard deviations that holds all pixels within `radius` standard deviations. `None` if it
    /// misses the picture.
    pub(crate) fn level(&self, radius: f64, pinhole: &Pinhole) -> Option<(Ellipse, f64)> {
        let level = match &self.shape {
            Shape::Ellipse(ellipse) => (*ellipse, radius),
            Shape::Rays(splat) => (splat.reach(radius, pinhole)?, 1.0),
        };
        level.0.reaches(level.1, pinhole.size).then_some(level)
    }

    /// The opacity at pixel coordinates.
    pub(crate) fn alpha(&self, at: DVec2) -> f64 {
        match &self.shape {
            Shape::Ellipse(e) => {
                let d = at - e.center;
                let (u, v) = ((d.x - e.slope * d.y) / e.along_row, d.y / e.over_rows);
                (self.opacity * (-0.5 * (u * u + v * v)).exp()).min(1.0)
            }
            Shape::Rays(splat) => splat.alpha(splat.meet(at)),
        }
    }
}
