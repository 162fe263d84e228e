//! Scenes made in memory.

use glam::{DMat4, DVec3, Vec3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sg_raster::render::{Quality, Rendered, render};
use sg_scene::appearance::Appearance;
use sg_scene::camera::{Camera, Light};
use sg_scene::model::{BaseUnit, Gaussians, Scene, ShadingColumns};

/// One Gaussian that is drawn in exactly its colour: ka = 1, nothing else.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Blob {
    pub(crate) position: Vec3,
    pub(crate) log_scale: Vec3,
    pub(crate) rotation: [f32; 4],
    pub(crate) logit: f32,
    pub(crate) color: Vec3,
}

impl Default for Blob {
    fn default() -> Self {
        Self {
            position: Vec3::new(0.0, 0.0, 2.0),
            log_scale: Vec3::splat(0.1_f32.ln()),
            rotation: [1.0, 0.0, 0.0, 0.0],
            logit: logit(0.5),
            color: Vec3::new(1.0, 0.5, 0.25),
        }
    }
}

pub(crate) fn logit(opacity: f32) -> f32 {
    (opacity / (1.0 - opacity)).ln()
}

pub(crate) fn unit(name: &str, blobs: &[Blob]) -> BaseUnit {
    let n = blobs.len();
    let column = |x: f32| vec![x; n];
    let gaussians = Gaussians {
        position: blobs.iter().map(|b| b.position).collect(),
        rotation: blobs.iter().map(|b| b.rotation).collect(),
        log_scale: blobs.iter().map(|b| b.log_scale).collect(),
        opacity_logit: blobs.iter().map(|b| b.logit).collect(),
        shading: Some(ShadingColumns {
            offset_color: blobs.iter().map(|b| b.color).collect(),
            normal: vec![Vec3::ZERO; n],
            ambient: column(1.0),
            diffuse: column(0.0),
            specular: column(0.0),
            shininess: column(1.0),
        }),
        ..Gaussians::default()
    };
    BaseUnit { oriented_normals: true, ..BaseUnit::new(name, gaussians) }
}

pub(crate) fn scene(blobs: &[Blob]) -> Scene {
    Scene::compose(vec![unit("blobs", blobs)], None)
}

/// A camera at the origin that looks along +z, with its principal point in the middle.
pub(crate) fn camera(focal: f64, width: u32, height: u32) -> Camera {
    Camera {
        width,
        height,
        fx: focal,
        fy: focal,
        cx: 0.5 * f64::from(width),
        cy: 0.5 * f64::from(height),
        world_to_camera: DMat4::IDENTITY.to_cols_array(),
        background: [0.0; 3],
        light: Light::default(),
        near: 0.0,
        preview_scale: 1.0,
    }
}

pub(crate) fn draw(scene: &Scene, camera: &Camera, quality: Quality) -> Rendered {
    render(scene, &Appearance::of(scene), camera, quality).unwrap()
}

fn uniform(rng: &mut ChaCha8Rng, low: f32, high: f32) -> f32 {
    low + (high - low) * rng.random::<f32>()
}

pub(crate) fn uniform3(rng: &mut ChaCha8Rng, low: f32, high: f32) -> Vec3 {
    Vec3::new(uniform(rng, low, high), uniform(rng, low, high), uniform(rng, low, high))
}

pub(crate) fn any_rotation(rng: &mut ChaCha8Rng) -> [f32; 4] {
    std::array::from_fn(|_| uniform(rng, -1.0, 1.0))
}

pub(crate) fn seeded(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

/// Gaussians of all sizes and opacities in a box in front of the camera.
pub(crate) fn cloud(n: usize, seed: u64) -> Vec<Blob> {
    let mut rng = seeded(seed);
    (0..n)
        .map(|_| Blob {
            position: uniform3(&mut rng, -1.0, 1.0) + Vec3::new(0.0, 0.0, 3.0),
            log_scale: uniform3(&mut rng, -6.0, -2.5),
            rotation: any_rotation(&mut rng),
            logit: uniform(&mut rng, -4.0, 5.0),
            color: uniform3(&mut rng, 0.0, 1.0),
        })
        .collect()
}

/// Flat Gaussians on a closed wrinkled surface, as a fit of a volume gives them.
pub(crate) fn surface(n: usize, seed: u64) -> Vec<Blob> {
    let mut rng = seeded(seed);
    (0..n)
        .map(|_| {
            let d = uniform3(&mut rng, -1.0, 1.0).try_normalize().unwrap_or(Vec3::X);
            let r = 0.8 + 0.15 * (7.0 * d.x).sin() * (5.0 * d.y).cos();
            let q = glam::Quat::from_rotation_arc(Vec3::Z, d);
            let size = (2.0 / (n as f32).sqrt()).ln();
            Blob {
                position: d * r + Vec3::new(0.0, 0.0, 3.0),
                log_scale: Vec3::new(size, size, size - 1.5) + 0.3 * uniform3(&mut rng, -1.0, 1.0),
                rotation: [q.w, q.x, q.y, q.z],
                logit: uniform(&mut rng, 0.0, 5.0),
                color: 0.5 + 0.5 * d,
            }
        })
        .collect()
}

/// Large faint Gaussians, everywhere.
pub(crate) fn fog(n: usize, opacity: f32, seed: u64) -> Vec<Blob> {
    let mut rng = seeded(seed);
    (0..n)
        .map(|_| Blob {
            position: uniform3(&mut rng, -1.0, 1.0) + Vec3::new(0.0, 0.0, 3.0),
            log_scale: uniform3(&mut rng, -2.5, -1.2),
            rotation: any_rotation(&mut rng),
            logit: logit(opacity),
            color: uniform3(&mut rng, 0.2, 1.0),
        })
        .collect()
}

/// A camera that looks at the middle of those boxes from the side.
pub(crate) fn side_view(width: u32, height: u32, fov_y_degrees: f64) -> Camera {
    let target = DVec3::new(0.0, 0.0, 3.0);
    let eye = target + DVec3::new(1.6, -0.9, -2.2);
    Camera { background: [0.1, 0.2, 0.3], ..Camera::look_at(eye, target, DVec3::NEG_Y, fov_y_degrees, width, height) }
}

/// The same Gaussians with the middle of their box at the origin.
pub(crate) fn around_the_eye(blobs: Vec<Blob>) -> Vec<Blob> {
    blobs.into_iter().map(|b| Blob { position: b.position - 3.0 * Vec3::Z, ..b }).collect()
}

/// So many small Gaussians in a cube before the camera, without columns that nothing needs.
pub(crate) fn crowd(n: usize) -> Scene {
    let mut one = unit("crowd", &[]);
    let place = |k: usize, step: f64| ((k as f64 * step).fract() - 0.5) as f32;
    let g = &mut one.gaussians;
    g.shading = None;
    // A lattice that fills a cube evenly (Roberts 2018).
    g.position = (0..n)
        .map(|k| Vec3::new(place(k, 0.819_172_513), place(k, 0.671_043_607), 3.0 + place(k, 0.549_700_478)))
        .collect();
    g.rotation = vec![[1.0, 0.0, 0.0, 0.0]; n];
    g.log_scale = vec![Vec3::splat(2e-3_f32.ln()); n];
    g.opacity_logit = vec![logit(0.2); n];
    one.palette = Vec3::new(0.2, 0.6, 0.9);
    Scene::compose(vec![one], None)
}
