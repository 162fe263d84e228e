//! A scene of so many Gaussians for renderers, made in memory.

use glam::{DMat4, Quat, Vec3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sg_scene::model::{BaseUnit, Convention, Gaussians, Harmonics, Scene, ShadingColumns, ShadingModel};

/// The source of the Gaussians' colours.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Look {
    /// Blinn-Phong attributes.
    Lit,
    /// Harmonics of degree 0. Every renderer of splats draws them.
    Plain,
}

/// Flat Gaussians on four nested wrinkled shells, the outer ones fainter. The scene looks like a fit of a volume.
#[must_use]
pub fn shells(n: usize, look: Look) -> Scene {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut uniform = |low: f32, high: f32| low + (high - low) * rng.random::<f32>();
    let mut g = Gaussians::default();
    let mut shading = ShadingColumns::default();
    let mut harmonics = Harmonics::default();
    for i in 0..n {
        let shell = (i % 4) as f32;
        let z = uniform(-1.0, 1.0);
        let (sin, cos) = uniform(0.0, std::f32::consts::TAU).sin_cos();
        let ring = (1.0 - z * z).sqrt();
        let d = Vec3::new(ring * cos, ring * sin, z);
        let radius = (0.4 + 0.2 * shell) * (1.0 + 0.1 * (9.0 * d.x).sin() * (7.0 * d.y).cos());
        let q = Quat::from_rotation_arc(Vec3::Z, d);
        let size = (2.5 * radius / (n as f32 / 4.0).sqrt()).ln();
        g.position.push(radius * d);
        g.rotation.push([q.w, q.x, q.y, q.z]);
        g.log_scale.push(
            Vec3::new(size, size, size - 1.2) + Vec3::new(uniform(-0.4, 0.4), uniform(-0.4, 0.4), uniform(-0.4, 0.4)),
        );
        g.opacity_logit.push(2.0 - 1.2 * shell + uniform(-1.0, 1.0));
        shading.offset_color.push(0.3 * (Vec3::ONE + d));
        shading.normal.push(d);
        shading.ambient.push(0.3);
        shading.diffuse.push(0.6);
        shading.specular.push(0.3);
        shading.shininess.push(20.0);
        harmonics.dc.push(d.to_array());
    }
    match look {
        Look::Lit => g.shading = Some(shading),
        Look::Plain => g.harmonics = Some(harmonics),
    }
    let unit = BaseUnit {
        name: "shells".into(),
        file: None,
        gaussians: g,
        first: 0,
        palette: Vec3::new(0.3, 0.2, 0.1),
        opacity: 1.0,
        transform: DMat4::IDENTITY,
        convention: Convention::Ours,
        shading: ShadingModel::Paper,
        oriented_normals: true,
        transfer_function: None,
        values: None,
    };
    Scene::compose(vec![unit], None)
}
