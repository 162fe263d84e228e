//! A second renderer, written from the definition alone: matrices as in the textbook, every pixel asks every Gaussian,
//! nothing is bounded. It knows ambient-only scenes with identity transforms.

use glam::{DMat2, DMat3, DQuat, DVec2, DVec3};
use sg_raster::image::Image;
use sg_scene::camera::Camera;

use crate::scenes::Blob;

struct Projected {
    z: f64,
    mean: DVec2,
    conic: DMat2,
    opacity: f64,
    color: DVec3,
}

fn project(blob: &Blob, camera: &Camera) -> Option<Projected> {
    let view = camera.view();
    let w = DMat3::from_mat4(view);
    let t = view.transform_point3(blob.position.as_dvec3());
    if t.z <= 1e-6 {
        return None;
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
    let (a, b, c) = (c.x_axis.x + 0.3, c.x_axis.y, c.y_axis.y + 0.3);
    let det = a * c - b * b;
    Some(Projected {
        z: t.z,
        mean: DVec2::new(fx * t.x / t.z + camera.cx, fy * t.y / t.z + camera.cy),
        conic: DMat2::from_cols(DVec2::new(c, -b) / det, DVec2::new(-b, a) / det),
        opacity: 1.0 / (1.0 + (-f64::from(blob.logit)).exp()),
        color: blob.color.as_dvec3().clamp(DVec3::ZERO, DVec3::ONE),
    })
}

pub(crate) fn draw(blobs: &[Blob], camera: &Camera, background: DVec3) -> Image {
    let mut list: Vec<Projected> = blobs.iter().filter_map(|b| project(b, camera)).collect();
    list.sort_by(|a, b| a.z.total_cmp(&b.z));
    let mut rgba = Vec::new();
    for y in 0..camera.height {
        for x in 0..camera.width {
            let pixel = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let (mut t, mut c) = (1.0, DVec3::ZERO);
            for g in &list {
                let d = pixel - g.mean;
                let alpha = (g.opacity * (-0.5 * d.dot(g.conic * d)).exp()).min(1.0);
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
