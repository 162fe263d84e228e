//! Direct volume rendering by ray marching (Levoy 1988; Max 1995).
//!
//! The image is the reference for Gaussians of the same volume. Rays run front to back with post-classification. The step
//! length corrects the opacities. A ray stops at a transmittance of 1e-5.

use glam::{DMat4, DVec3, Vec3};
use rayon::prelude::*;

use crate::classifier::Classifier;
use crate::field::Field;
use crate::opacity::correct_opacity;

/// A pinhole camera: x right, y down, z forward; the first pixel's centre at (0.5, 0.5).
#[derive(Debug, Clone, PartialEq)]
pub struct Pinhole {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// Focal lengths in pixels.
    pub focal: [f64; 2],
    /// Principal point in pixels.
    pub center: [f64; 2],
    /// World to camera, affine.
    pub world_to_camera: DMat4,
}

/// Lighting of samples.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub enum Lighting {
    /// The unchanged colour of the transfer function.
    #[default]
    Unlit,
    /// Blinn–Phong with a white light at the eye and the normal −∇v/|∇v|.
    /// `c = ka·c + kd·max(n·l,0)·c + ks·max(n·h,0)^β`, clamped to `[0, 1]`.
    Headlight {
        /// Ambient factor.
        ambient: f32,
        /// Diffuse factor.
        diffuse: f32,
        /// Specular factor.
        specular: f32,
        /// Specular exponent.
        shininess: f32,
    },
}

/// An image, row by row: RGB composited over the background, A = 1 − transmittance.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// `width · height` pixels.
    pub pixels: Vec<[f32; 4]>,
}

/// Renders a volume. `step` is the sampling distance in units of the smallest voxel spacing; ½ is a good value.
#[must_use]
pub fn render(
    field: &Field,
    classifier: &Classifier,
    camera: &Pinhole,
    lighting: Lighting,
    background: Vec3,
    step: f64,
) -> Image {
    let marcher = RayMarcher {
        field,
        classifier,
        lighting,
        step: step.max(1e-3) * field.grid().spacing().min_element(),
        reference: field.grid().reference_length(),
    };
    let camera_to_world = camera.world_to_camera.inverse();
    let eye = camera_to_world.transform_point3(DVec3::ZERO);
    let pixels = (0..camera.width * camera.height)
        .into_par_iter()
        .map(|i| {
            let x = ((i % camera.width) as f64 + 0.5 - camera.center[0]) / camera.focal[0];
            let y = ((i / camera.width) as f64 + 0.5 - camera.center[1]) / camera.focal[1];
            let direction = camera_to_world.transform_vector3(DVec3::new(x, y, 1.0)).normalize();
            let (color, transmittance) = marcher.ray(eye, direction);
            let c = color + background * transmittance as f32;
            [c.x, c.y, c.z, 1.0 - transmittance as f32]
        })
        .collect();
    Image { width: camera.width, height: camera.height, pixels }
}

struct RayMarcher<'a> {
    field: &'a Field,
    classifier: &'a Classifier,
    lighting: Lighting,
    step: f64,
    reference: f64,
}

impl RayMarcher<'_> {
    /// Premultiplied colour and transmittance along a ray of unit direction.
    fn ray(&self, eye: DVec3, direction: DVec3) -> (Vec3, f64) {
        let grid = self.field.grid();
        let (start, along) = (grid.to_voxel(eye), grid.vector_to_voxel(direction));
        let high = DVec3::from_array(grid.dims().map(|d| d as f64 - 0.5));
        let Some((near, far)) = intersect_box(start, along, DVec3::splat(-0.5), high) else {
            return (Vec3::ZERO, 1.0);
        };
        let steps = ((far - near) / self.step).ceil();
        let mut color = Vec3::ZERO;
        let mut transmittance = 1.0_f64;
        for k in 0..steps as u64 {
            let from = near + k as f64 * self.step;
            let length = self.step.min(far - from);
            let at = start + along * (from + 0.5 * length);
            let Some(value) = self.field.sample(at) else { continue };
            let (sample, opacity) = self.classifier.evaluate(value);
            if opacity <= 0.0 {
                continue;
            }
            let alpha = correct_opacity(f64::from(opacity), length, self.reference);
            color += (transmittance * alpha) as f32 * self.shade(sample, at, direction);
            transmittance *= 1.0 - alpha;
            if transmittance < 1e-5 {
                break;
            }
        }
        (color, transmittance)
    }

    fn shade(&self, color: Vec3, at: DVec3, direction: DVec3) -> Vec3 {
        let Lighting::Headlight { ambient, diffuse, specular, shininess } = self.lighting else { return color };
        let normal = -self.field.gradient(at).normalize_or_zero();
        // The light is at the eye, so l, v and h are equal.
        let facing = normal.dot(-direction.as_vec3()).max(0.0);
        let shine = if facing > 0.0 { specular * facing.powf(shininess) } else { 0.0 };
        (color * (ambient + diffuse * facing) + shine).clamp(Vec3::ZERO, Vec3::ONE)
    }
}

/// The interval of a ray inside an axis-aligned box, in front of its start.
fn intersect_box(start: DVec3, along: DVec3, low: DVec3, high: DVec3) -> Option<(f64, f64)> {
    let (mut near, mut far) = (0.0_f64, f64::INFINITY);
    for k in 0..3 {
        if along[k] == 0.0 {
            if start[k] < low[k] || start[k] > high[k] {
                return None;
            }
            continue;
        }
        let (a, b) = ((low[k] - start[k]) / along[k], (high[k] - start[k]) / along[k]);
        near = near.max(a.min(b));
        far = far.min(a.max(b));
    }
    (near < far && far.is_finite()).then_some((near, far))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Grid;
    use crate::transfer::{ControlPoint, Scale, TransferFunction, Units};
    use crate::volume::Volume;

    fn slab(opacity: f32) -> (Field, Classifier) {
        let grid = Grid::unit([16, 16, 16]).unwrap();
        let field = Volume::new(grid, vec![1_u8; 16 * 16 * 16].into(), None).unwrap().to_field();
        let f = TransferFunction {
            domain: [0.0, 1.0],
            units: Units::Raw,
            scale: Scale::Linear,
            variable: None,
            points: vec![ControlPoint { value: 1.0, color: [1.0, 0.5, 0.0], opacity }],
            base_units: Vec::new(),
        };
        let classifier = f.classifier(field.range()).unwrap();
        (field, classifier)
    }

    fn axis_camera() -> Pinhole {
        // Looks along +z from far away through the middle of the grid.
        let world_to_camera = DMat4::from_translation(DVec3::new(-7.5, -7.5, 1000.0));
        Pinhole { width: 1, height: 1, focal: [1.0; 2], center: [0.5; 2], world_to_camera }
    }

    #[test]
    fn a_homogeneous_slab_has_the_analytic_opacity_for_any_step() {
        let (field, classifier) = slab(0.02);
        let want = correct_opacity(f64::from(0.02_f32), 16.0, field.grid().reference_length());
        for step in [0.1, 0.5, 0.7, 3.0] {
            let p = render(&field, &classifier, &axis_camera(), Lighting::Unlit, Vec3::ZERO, step).pixels[0];
            assert!((f64::from(p[3]) - want).abs() < 1e-5, "step {step}: {} {want}", p[3]);
            assert!((p[0] - p[3]).abs() < 1e-5 && (p[1] - 0.5 * p[3]).abs() < 1e-5 && p[2] == 0.0);
        }
    }

    #[test]
    fn rays_that_miss_show_the_background() {
        let (field, classifier) = slab(1.0);
        let mut camera = axis_camera();
        camera.center = [1e3, 0.5];
        let p = render(&field, &classifier, &camera, Lighting::Unlit, Vec3::new(0.1, 0.2, 0.3), 0.5).pixels[0];
        assert_eq!(p, [0.1, 0.2, 0.3, 0.0]);
    }
}
