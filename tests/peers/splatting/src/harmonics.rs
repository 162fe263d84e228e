//! Colour by spherical harmonics up to degree 3, as 3DGS has them.

use wgpu_3dgs_viewer::core::PlyGaussianPod;
use wgpu_3dgs_viewer::core::glam::Vec3;

/// Colour seen along the unit vector `d` from the eye to the Gaussian: RGB, not below 0.
pub(crate) fn color(g: &PlyGaussianPod, d: Vec3) -> Vec3 {
    let flat = Vec3::from_array(g.color) * 0.282_094_79 + 0.5;
    if g.sh.iter().all(|&x| x == 0.0) {
        return flat.max(Vec3::ZERO);
    }
    let (x, y, z) = (d.x, d.y, d.z);
    let (xx, yy, zz) = (x * x, y * y, z * z);
    let basis = [
        -0.488_602_5 * y,
        0.488_602_5 * z,
        -0.488_602_5 * x,
        1.092_548_4 * x * y,
        -1.092_548_4 * y * z,
        0.315_391_57 * (2.0 * zz - xx - yy),
        -1.092_548_4 * x * z,
        0.546_274_2 * (xx - yy),
        -0.590_043_6 * y * (3.0 * xx - yy),
        2.890_611_4 * x * y * z,
        -0.457_045_8 * y * (4.0 * zz - xx - yy),
        0.373_176_33 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        -0.457_045_8 * x * (4.0 * zz - xx - yy),
        1.445_305_7 * z * (xx - yy),
        -0.590_043_6 * x * (xx - 3.0 * yy),
    ];
    let of = |k: usize| Vec3::new(g.sh[k], g.sh[k + 15], g.sh[k + 30]);
    basis.iter().enumerate().fold(flat, |sum, (k, &b)| sum + b * of(k)).max(Vec3::ZERO)
}
