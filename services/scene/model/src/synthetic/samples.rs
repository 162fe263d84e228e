//! Generated Gaussians for tests.

use glam::{DMat4, DVec3, Vec3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::model::{BaseUnit, ExtraColumn, ExtraValues, Gaussians, Harmonics, Scene, ShadingColumns};

fn vec3(random: &mut ChaCha8Rng, low: f32, high: f32) -> Vec3 {
    Vec3::from_array(std::array::from_fn(|_| random.random_range(low..high)))
}

/// Gaussians drawn from harmonics of a degree, with an extra column.
pub fn harmonic(n: usize, degree: u8, seed: u64) -> Gaussians {
    let mut r = ChaCha8Rng::seed_from_u64(seed);
    let terms = (usize::from(degree) + 1).pow(2) - 1;
    Gaussians {
        position: (0..n).map(|_| vec3(&mut r, -5.0, 5.0)).collect(),
        rotation: (0..n).map(|_| std::array::from_fn(|_| r.random_range(-2.0..2.0))).collect(),
        log_scale: (0..n).map(|_| vec3(&mut r, -8.0, 0.0)).collect(),
        opacity_logit: (0..n).map(|_| r.random_range(-4.0..6.0)).collect(),
        shading: None,
        harmonics: Some(Harmonics {
            degree,
            dc: (0..n).map(|_| vec3(&mut r, -1.5, 1.5).to_array()).collect(),
            rest: (0..n * terms).map(|_| vec3(&mut r, -1.0, 1.0).to_array()).collect(),
        }),
        extra: vec![ExtraColumn {
            name: "state".to_owned(),
            values: ExtraValues::U8((0..n).map(|i| (i % 7) as u8).collect()),
        }],
        antialiased: seed % 2 == 1,
    }
}

/// Editable Gaussians with an extra column.
pub fn editable_columns(n: usize, seed: u64) -> Gaussians {
    let mut g = harmonic(n, 0, seed);
    let mut r = ChaCha8Rng::seed_from_u64(seed ^ 0xed17);
    g.harmonics = None;
    g.extra = vec![ExtraColumn {
        name: "semantic_id".to_owned(),
        values: ExtraValues::I16((0..n).map(|i| i as i16 - 3).collect()),
    }];
    g.shading = Some(ShadingColumns {
        offset_color: (0..n).map(|_| vec3(&mut r, 0.05, 0.5)).collect(),
        normal: (0..n).map(|_| vec3(&mut r, -1.0, 1.0).normalize_or_zero()).collect(),
        ambient: (0..n).map(|_| r.random_range(0.0..1.0)).collect(),
        diffuse: (0..n).map(|_| r.random_range(0.0..1.0)).collect(),
        specular: (0..n).map(|_| r.random_range(0.0..4.0)).collect(),
        shininess: (0..n).map(|_| r.random_range(1.0..40.0)).collect(),
    });
    g
}

/// A base unit at its place.
pub fn unit(name: &str, gaussians: Gaussians) -> BaseUnit {
    let palette = Vec3::new(0.25, 0.5, 0.125);
    BaseUnit { palette, oriented_normals: true, ..BaseUnit::new(name, gaussians) }
}

/// One editable unit.
pub fn editable(n: usize, seed: u64) -> Scene {
    Scene::compose(vec![unit("bone", editable_columns(n, seed))], None)
}

/// An editable unit and one drawn from harmonics, the second turned, moved and half as opaque.
pub fn two_units(n: usize) -> Scene {
    let mut second = unit("skin / outer", harmonic(n, 1, 9));
    second.transform = DMat4::from_scale_rotation_translation(
        DVec3::splat(2.0),
        glam::DQuat::from_rotation_z(0.7),
        DVec3::new(1.0, -2.0, 0.5),
    );
    second.opacity = 0.5;
    second.palette = Vec3::ZERO;
    second.oriented_normals = false;
    second.transfer_function = Some("tf.json".into());
    Scene::compose(vec![unit("bone", editable_columns(n, 8)), second], None)
}
