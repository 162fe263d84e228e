//! Scene files for tests that start processes.

#[allow(dead_code, reason = "each test binary uses what it needs")]
pub(crate) mod random_actions;

use std::fmt::Write as _;
use std::path::Path;

use glam::Vec3;
use sg_scene::model::{BaseUnit, Gaussians, Scene, ShadingColumns};

/// Writes a 3DGS file of `n` Gaussians on a spiral; its only base unit is called after the file.
pub(crate) fn write_ply(path: &Path, n: usize) {
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex {n}\n");
    for name in "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3".split(' ') {
        writeln!(text, "property float {name}").unwrap();
    }
    text.push_str("end_header\n");
    for i in 0..n {
        let t = i as f64 / n as f64;
        let (x, y, z) = ((40.0 * t).cos(), (40.0 * t).sin(), 3.0 * t);
        writeln!(text, "{x} {y} {z} {t} 0.5 0.1 1.5 -3 -3 -3 1 0 0 0").unwrap();
    }
    std::fs::write(path, text).unwrap();
}

/// A scene of one base unit with shading columns.
#[allow(dead_code, reason = "each test binary uses what it needs")]
pub(crate) fn shaded_scene(n: usize) -> Scene {
    let at = |i: usize, k: f32| (i as f32 * k).sin();
    let unit = BaseUnit {
        palette: Vec3::new(0.8, 0.7, 0.6),
        oriented_normals: true,
        ..BaseUnit::new(
            "spiral",
            Gaussians {
                position: (0..n).map(|i| Vec3::new(at(i, 0.1), at(i, 0.37), at(i, 0.71))).collect(),
                rotation: vec![[1.0, 0.0, 0.0, 0.0]; n],
                log_scale: vec![Vec3::splat(-4.0); n],
                opacity_logit: (0..n).map(|i| at(i, 0.9)).collect(),
                shading: Some(ShadingColumns {
                    offset_color: vec![Vec3::splat(0.1); n],
                    normal: vec![Vec3::Z; n],
                    ambient: vec![0.3; n],
                    diffuse: vec![0.6; n],
                    specular: vec![0.2; n],
                    shininess: vec![16.0; n],
                }),
                ..Gaussians::default()
            },
        )
    };
    Scene::compose(vec![unit], None)
}
