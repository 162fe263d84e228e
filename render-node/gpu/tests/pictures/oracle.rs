//! A second renderer, written from the definition alone: matrices as in the textbook, every pixel asks every Gaussian,
//! nothing is bounded. It knows ambient-only scenes with identity transforms.
//!
//! A Gaussian whose size is below a tenth of its depth, and far enough from the eye, is the ellipse of the affine projection.
//! Rays meet the others. Between a tenth and a fifth the perspective within it grows from none to all. Within 96 near distances
//! the order is by distance and the dilation is an angle; from 768 on they are view z and 0.3 px².

use glam::{DMat2, DMat3, DQuat, DVec2, DVec3};
use sg_raster::image::Image;
use sg_scene::camera::Camera;

use crate::scenes::Blob;

struct Projected {
    order: f64,
    shape: Shape,
    opacity: f64,
    color: DVec3,
}

enum Shape {
    Ellipse { mean: DVec2, conic: DMat2 },
    Rays(Met),
}

/// A Gaussian as rays meet it.
pub(crate) struct Met {
    center: DVec3,
    /// Inverse of the covariance with the dilation.
    precision: DMat3,
    perspective: f64,
    fades: bool,
    near: f64,
}

impl Met {
    /// Of a Gaussian with all its perspective.
    pub(crate) fn new(blob: &Blob, camera: &Camera) -> Self {
        let center = camera.view().transform_point3(blob.position.as_dvec3());
        let [w, x, y, z] = blob.rotation.map(f64::from);
        let q = DMat3::from_mat4(camera.view()) * DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
        let dilation = 0.3 * center.length_squared() / (camera.fx * camera.fy);
        let squares = (2.0 * blob.log_scale.as_dvec3()).exp();
        let sigma = q * DMat3::from_diagonal(squares) * q.transpose() + DMat3::from_diagonal(DVec3::splat(dilation));
        let size = (squares.element_sum() + dilation).sqrt();
        let fades = center.length() < 1.47 * camera.near + 8.35 * size;
        Self { center, precision: sigma.inverse(), perspective: 1.0, fades, near: camera.near }
    }

    /// Place of the maximum on the ray (z = 1) in its unit, and exp(−½d²) times the share beyond the near distance.
    pub(crate) fn on(&self, ray: DVec3) -> (f64, f64) {
        let toward = self.precision * self.center;
        let whole = ray.dot(self.precision * ray);
        let t = ray.dot(toward) / whole;
        if !self.fades && t <= 0.0 {
            return (0.0, (-0.5 * self.center.dot(toward)).exp());
        }
        // With u·w = |u|·a and s = |w|² − a²: what is left of the perspective within it.
        let eye = self.center.dot(toward);
        let along = ray.dot(toward) / eye.sqrt();
        let across = whole - along * along;
        let d2 = if self.perspective < 1.0 {
            let middle = (self.center / self.center.z).dot(toward) / eye.sqrt();
            let along = middle + self.perspective * (along - middle);
            eye * across / (along * along + self.perspective * across)
        } else {
            eye * across / whole
        };
        let near = self.near / ray.length();
        let x = (t - near) / (1.0 / whole).sqrt().hypot(0.2 * near);
        let y = if self.fades { (x / 4.7 + 0.5).clamp(0.0, 1.0) } else { 1.0 };
        (t.max(0.0), y.powi(3) * (6.0 * y * y - 15.0 * y + 10.0) * (-0.5 * d2).exp())
    }
}

/// The ray, with z = 1, through pixel coordinates.
pub(crate) fn ray(camera: &Camera, pixel: DVec2) -> DVec3 {
    ((pixel - DVec2::new(camera.cx, camera.cy)) / DVec2::new(camera.fx, camera.fy)).extend(1.0)
}

fn project(blob: &Blob, camera: &Camera) -> Projected {
    let view = camera.view();
    let w = DMat3::from_mat4(view);
    let t = view.transform_point3(blob.position.as_dvec3());
    let size = (2.0 * blob.log_scale.as_dvec3()).exp().element_sum().sqrt();
    let opacity = 1.0 / (1.0 + (-f64::from(blob.logit)).exp());
    let color = blob.color.as_dvec3().clamp(DVec3::ZERO, DVec3::ONE);
    let as_rays = ((768.0 * camera.near / t.length()).ln() / 8.0_f64.ln()).clamp(0.0, 1.0);
    let order = t.z + as_rays * (t.length() - t.z);
    let near = t.length() < 1.47 * camera.near + 8.35 * size;
    if near || size >= 0.1 * t.z {
        let perspective = if near || t.z <= 0.1 * t.length() { 1.0 } else { (size / (0.1 * t.z) - 1.0).min(1.0) };
        let shape = Shape::Rays(Met { perspective, ..Met::new(blob, camera) });
        return Projected { order, shape, opacity, color };
    }
    let [qw, qx, qy, qz] = blob.rotation.map(f64::from);
    let q = DQuat::from_xyzw(qx, qy, qz, qw);
    let r = DMat3::from_quat(if q.length() == 0.0 { DQuat::IDENTITY } else { q.normalize() });
    let s2 = DMat3::from_diagonal((2.0 * blob.log_scale.as_dvec3()).exp());
    let sigma = r * s2 * r.transpose();
    let (fx, fy) = (camera.fx, camera.fy);
    // The Jacobian with a zero third row, so that the upper left 2 × 2 block is the picture's covariance.
    let j = DMat3::from_cols(
        DVec3::new(fx / t.z, 0.0, 0.0),
        DVec3::new(0.0, fy / t.z, 0.0),
        DVec3::new(-fx * t.x / (t.z * t.z), -fy * t.y / (t.z * t.z), 0.0),
    );
    let c = j * w * sigma * w.transpose() * j.transpose();
    // The dilation as an angle, at the nearest place of the picture.
    let corner = |x: u32, y: u32| ray(camera, DVec2::new(f64::from(x), f64::from(y))).truncate();
    let slope = (t.truncate() / t.z).clamp(corner(0, 0), corner(camera.width, camera.height)) * as_rays.sqrt();
    let spread = 0.3 * (1.0 + slope.length_squared());
    let (a, c, b) = (
        c.x_axis.x + spread * (1.0 + slope.x * slope.x),
        c.y_axis.y + spread * (1.0 + slope.y * slope.y),
        c.x_axis.y + spread * slope.x * slope.y,
    );
    let det = a * c - b * b;
    let mean = DVec2::new(fx * t.x / t.z + camera.cx, fy * t.y / t.z + camera.cy);
    let conic = DMat2::from_cols(DVec2::new(c, -b) / det, DVec2::new(-b, a) / det);
    Projected { order, shape: Shape::Ellipse { mean, conic }, opacity, color }
}

pub(crate) fn draw(blobs: &[Blob], camera: &Camera, background: DVec3) -> Image {
    let mut list: Vec<Projected> = blobs.iter().map(|b| project(b, camera)).collect();
    list.sort_by(|a, b| a.order.total_cmp(&b.order));
    let mut rgba = Vec::new();
    for y in 0..camera.height {
        for x in 0..camera.width {
            let pixel = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let (mut t, mut c) = (1.0, DVec3::ZERO);
            for g in &list {
                let seen = match &g.shape {
                    Shape::Ellipse { mean, conic } => (-0.5 * (pixel - mean).dot(*conic * (pixel - mean))).exp(),
                    Shape::Rays(met) => met.on(ray(camera, pixel)).1,
                };
                let alpha = (g.opacity * seen).min(1.0);
                c += t * alpha * g.color;
                t *= 1.0 - alpha;
            }
            c += t * background;
            rgba.extend([c.x as f32, c.y as f32, c.z as f32, (1.0 - t) as f32]);
        }
    }
    Image { width: camera.width, height: camera.height, rgba }
}

/// Greatest difference of any number of two pictures.
pub(crate) fn distance(a: &Image, b: &Image) -> f32 {
    assert_eq!((a.width, a.height), (b.width, b.height));
    a.rgba.iter().zip(&b.rgba).fold(0.0, |m, (x, y)| if (x - y).is_nan() { f32::NAN } else { m.max((x - y).abs()) })
}
