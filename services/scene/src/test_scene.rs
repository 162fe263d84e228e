//! Scenes for tests, made without files.

use glam::{DMat4, Vec3};

use crate::model::{BaseUnit, Convention, Gaussians, Scene, ShadingColumns, ShadingModel};

/// A scene of units with these names and numbers of Gaussians, scattered through the box from 0 to 10 on each axis.
pub(crate) fn test_scene(units: &[(&str, usize)]) -> Scene {
    let mut seed = 7_u32;
    let mut random = move || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (seed >> 8) as f32 / (1 << 24) as f32
    };
    let units = units.iter().enumerate().map(|(k, &(name, n))| BaseUnit {
        name: name.to_owned(),
        file: None,
        gaussians: Gaussians {
            position: (0..n).map(|_| 10.0 * Vec3::new(random(), random(), random())).collect(),
            rotation: vec![[1.0, 0.0, 0.0, 0.0]; n],
            log_scale: vec![Vec3::splat(-2.0); n],
            opacity_logit: vec![0.5; n],
            shading: Some(ShadingColumns {
                offset_color: vec![Vec3::ZERO; n],
                normal: vec![Vec3::Z; n],
                ambient: vec![0.3; n],
                diffuse: vec![0.6; n],
                specular: vec![0.1; n],
                shininess: vec![8.0; n],
            }),
            ..Gaussians::default()
        },
        first: 0,
        palette: Vec3::new(0.25 * (k + 1) as f32 % 1.0, 0.5, 0.75),
        opacity: 1.0,
        transform: DMat4::IDENTITY,
        convention: Convention::Ours,
        shading: ShadingModel::Paper,
        oriented_normals: true,
        transfer_function: None,
    });
    Scene::compose(units.collect(), None)
}
