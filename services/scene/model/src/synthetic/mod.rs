//! Synthetic scenes and points for tests, benches and examples; deterministic by seed.

use crate::model::{BaseUnit, Gaussians, Scene, ShadingColumns};
pub mod samples;

use glam::{DVec3, Vec3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A unit of the given Gaussians with an identity transform.
pub fn unit_of(gaussians: Gaussians) -> BaseUnit {
    BaseUnit { palette: Vec3::ONE, ..BaseUnit::new("unit", gaussians) }
}

/// A generator of one seed.
pub fn generator(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

fn uniform(r: &mut ChaCha8Rng) -> f32 {
    r.random_range(-1.0..1.0)
}

/// `n` Gaussians uniform in a cube with random shapes and normals.
pub fn random_unit(n: usize, seed: u64) -> BaseUnit {
    let mut r = generator(seed);
    let mut g = Gaussians::default();
    let mut shading = ShadingColumns::default();
    for _ in 0..n {
        g.position.push(Vec3::new(uniform(&mut r), uniform(&mut r), uniform(&mut r)));
        g.rotation.push(std::array::from_fn(|_| uniform(&mut r)));
        g.log_scale.push(Vec3::new(uniform(&mut r) - 4.0, uniform(&mut r) - 4.0, uniform(&mut r) - 4.0));
        g.opacity_logit.push(uniform(&mut r));
        shading.normal.push(Vec3::new(uniform(&mut r), uniform(&mut r), uniform(&mut r)).normalize());
        shading.offset_color.push(Vec3::ZERO);
        shading.ambient.push(0.3);
        shading.diffuse.push(0.6);
        shading.specular.push(0.1);
        shading.shininess.push(8.0);
    }
    g.shading = Some(shading);
    unit_of(g)
}

/// Flat Gaussians on a surface: positions and unit normals.
pub fn surface_unit(points: &[(Vec3, Vec3)], thickness: f32) -> BaseUnit {
    let mut g = Gaussians::default();
    let mut shading = ShadingColumns::default();
    for &(p, n) in points {
        let q = glam::Quat::from_rotation_arc(Vec3::Z, n);
        g.position.push(p);
        g.rotation.push([q.w, q.x, q.y, q.z]);
        g.log_scale.push(Vec3::new(thickness, thickness, 0.3 * thickness).ln());
        g.opacity_logit.push(2.0);
        shading.normal.push(n);
        shading.offset_color.push(Vec3::ZERO);
        shading.ambient.push(0.3);
        shading.diffuse.push(0.6);
        shading.specular.push(0.1);
        shading.shininess.push(8.0);
    }
    g.shading = Some(shading);
    let mut unit = unit_of(g);
    unit.oriented_normals = true;
    unit
}

/// Half the length of the vessel of [`vessel_and_sac`].
pub const HALF_LENGTH: f32 = 2.5;

/// A straight vessel along x with a spherical sac on its side, `n` Gaussians on the surface of the union. The sac is
/// about a quarter of the surface.
///
/// Returns the scene and the mask of Gaussians that belong to the sac.
pub fn vessel_and_sac(n: usize, seed: u64) -> (Scene, Vec<bool>) {
    let mut r = generator(seed);
    let tube = 0.12_f32;
    let (centre, radius) = (Vec3::new(0.0, 0.0, 0.36), 0.30_f32);
    let tube_area = 2.0 * std::f32::consts::PI * tube * 2.0 * HALF_LENGTH;
    let ball_area = 4.0 * std::f32::consts::PI * radius * radius;
    let mut points = Vec::new();
    let mut sac = Vec::new();
    while points.len() < n {
        let (p, normal, is_sac) = if r.random_range(0.0..tube_area + ball_area) < tube_area {
            let angle = r.random_range(0.0..std::f32::consts::TAU);
            let normal = Vec3::new(0.0, angle.cos(), angle.sin());
            (normal * tube + Vec3::X * HALF_LENGTH * uniform(&mut r), normal, false)
        } else {
            let z = uniform(&mut r);
            let angle = r.random_range(0.0..std::f32::consts::TAU);
            let ring = (1.0 - z * z).sqrt();
            let normal = Vec3::new(ring * angle.cos(), ring * angle.sin(), z);
            (centre + normal * radius, normal, true)
        };
        // Keep samples on the surface of the union.
        let inside = if is_sac { (p.y * p.y + p.z * p.z).sqrt() < tube } else { (p - centre).length() < radius };
        if !inside {
            points.push((p, normal));
            sac.push(is_sac);
        }
    }
    let spacing = ((tube_area + ball_area) / n as f32).sqrt();
    (Scene::compose(vec![surface_unit(&points, 0.6 * spacing)], None), sac)
}

/// A polyline in normalized coordinates from points of the scene frame.
pub fn normalized(scene: &Scene, points: &[Vec3]) -> Vec<[f64; 3]> {
    points.iter().map(|p| scene.bounds.normalize(p.as_dvec3()).to_array()).collect()
}

/// A scene of bare points: small isotropic Gaussians without shading.
pub fn point_scene(points: &[[f32; 3]]) -> Scene {
    let g = Gaussians {
        position: points.iter().copied().map(Vec3::from_array).collect(),
        rotation: vec![[1.0, 0.0, 0.0, 0.0]; points.len()],
        log_scale: vec![Vec3::splat(-4.0); points.len()],
        opacity_logit: vec![0.0; points.len()],
        ..Gaussians::default()
    };
    Scene::compose(vec![unit_of(g)], None)
}

/// Uniform points in the unit cube.
pub fn random_points(n: usize, seed: u64) -> Vec<[f32; 3]> {
    let mut r = generator(seed);
    (0..n).map(|_| std::array::from_fn(|_| r.random_range(0.0..1.0))).collect()
}

/// The same as [`random_points`] in f64.
pub fn random_points_f64(n: usize, seed: u64) -> Vec<[f64; 3]> {
    random_points(n, seed).into_iter().map(|p| p.map(f64::from)).collect()
}

/// Distance of a point to a segment, written out for comparisons.
pub fn segment_distance(p: DVec3, a: DVec3, b: DVec3) -> f64 {
    let ab = b - a;
    let length_squared = ab.length_squared();
    let t = if length_squared > 0.0 { ((p - a).dot(ab) / length_squared).clamp(0.0, 1.0) } else { 0.0 };
    (p - (a + ab * t)).length()
}

/// Whether a point is in the tube of a brush stroke, written out for comparisons. `factors` scales the radius at each sample.
///
/// The tube is a ball at each sample. Along each segment it has the radius at the nearest point.
pub fn in_tube(p: DVec3, samples: &[DVec3], radius: f64, factors: &[f64]) -> bool {
    let ball = |(s, f): (&DVec3, &f64)| (p - *s).length() < radius * f;
    let segment = |(s, f): (&[DVec3], &[f64])| {
        let length = (s[1] - s[0]).length();
        let along = (p - s[0]).dot((s[1] - s[0]) / length) / length;
        let along = if length > 0.0 { along.clamp(0.0, 1.0) } else { 0.0 };
        (p - s[0].lerp(s[1], along)).length() < radius * ((1.0 - along) * f[0] + along * f[1])
    };
    samples.iter().zip(factors).any(ball) || samples.windows(2).zip(factors.windows(2)).any(segment)
}

/// A scene of units with these names and numbers of Gaussians, scattered through the box from 0 to 10 on each axis.
pub fn test_scene(units: &[(&str, usize)]) -> Scene {
    let mut seed = 7_u32;
    let mut random = move || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (seed >> 8) as f32 / (1 << 24) as f32
    };
    let units = units.iter().enumerate().map(|(k, &(name, n))| BaseUnit {
        palette: Vec3::new(0.25 * (k + 1) as f32 % 1.0, 0.5, 0.75),
        oriented_normals: true,
        ..BaseUnit::new(
            name,
            Gaussians {
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
        )
    });
    Scene::compose(units.collect(), None)
}
