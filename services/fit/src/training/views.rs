//! Pictures to train on: a volume seen by ray marching from all sides.

use std::f64::consts::PI;

use glam::{BVec3, DMat3, DQuat, DVec3, Vec3};
use rand::seq::SliceRandom as _;
use rand::{RngExt as _, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use sg_raster::image::Image;
use sg_scene::appearance::Appearance;
use sg_scene::camera::{Camera, LightMode};
use sg_scene::model::Scene;
use sg_scene::view::FIELD_OF_VIEW;
use sg_volume::dvr::{Illumination, Lighting, Material, Pinhole, RayMarcher};
use sg_volume::{Bounds, Classifier, Field};

use crate::direct::SURFACE_SHADING;

/// Voxels between two samples of a ray.
const STEP: f64 = 0.5;

/// Distance of a camera over the one from which the box just fills the picture.
const MARGIN: f64 = 1.02;

/// Greatest angle between the light and the direction to the eye, in radians.
const LIGHT_ANGLE: f64 = 1.2;

/// One picture to train on, or to measure with.
#[derive(Debug, Clone)]
pub struct TrainingView {
    /// The camera, with its light and background.
    pub camera: Camera,
    /// The base unit that it shows alone; `None` for the whole scene.
    pub unit: Option<usize>,
    /// The picture that Gaussians should give.
    pub reference: Image,
}

/// The views of a volume.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViewOptions {
    /// Pictures to train on.
    pub views: usize,
    /// Pictures to measure with: of the whole scene, from directions of their own, under a light at the eye.
    pub held_out: usize,
    /// Pixels along each edge.
    pub size: u32,
    /// Seed of the directions and lights.
    pub seed: u64,
}

impl Default for ViewOptions {
    fn default() -> Self {
        Self { views: 64, held_out: 8, size: 256, seed: 0 }
    }
}

impl TrainingView {
    /// The appearance of a scene in this view.
    #[must_use]
    pub fn appearance(&self, scene: &Scene) -> Appearance {
        let mut appearance = Appearance::of(scene);
        appearance.light = self.camera.light;
        appearance.background = self.camera.background();
        if let Some(shown) = self.unit {
            appearance.base.iter_mut().enumerate().for_each(|(unit, base)| base.visible = unit == shown);
        }
        appearance
    }
}

/// Renders the views of a volume: those to train on in random order, and those to measure with. `progress` gets
/// the number of finished views and of all.
///
/// Cameras stand around what the transfer function shows, framed. A quarter of the views has a light beside the eye, so that normals and shading
/// factors are learnt apart from colours. Where there are several base units, half of the views show one of them alone: a
/// picture of the whole scene says nothing about what it hides, and edits show that.
#[must_use]
pub fn volume_views(
    field: &Field,
    classifier: &Classifier,
    options: &ViewOptions,
    mut progress: impl FnMut(usize, usize),
) -> (Vec<TrainingView>, Vec<TrainingView>) {
    let mut random = ChaCha8Rng::seed_from_u64(options.seed ^ 0x7261_696e);
    let units = classifier.unit_count();
    let marchers: Vec<RayMarcher> = std::iter::once(classifier.clone())
        .chain((0..units).filter(|_| units > 1).map(|unit| classifier.only(unit)))
        .map(|classifier| RayMarcher::new(field, classifier, STEP))
        .collect();
    let frame = visible_box(field, classifier);
    let of = options.views + options.held_out;
    let mut done = 0;
    let mut view = |direction: DVec3, unit: Option<usize>, light: Option<DVec3>| {
        let camera = camera(&frame, direction, light, options.size);
        let marcher = unit.map_or(0, |unit| unit + 1);
        let reference = marchers.get(marcher).map(|marcher| march(marcher, &camera));
        done += 1;
        progress(done, of);
        reference.map(|reference| TrainingView { camera, unit, reference })
    };
    let mut training = Vec::with_capacity(options.views);
    for (k, direction) in directions(options.views, &mut random).into_iter().enumerate() {
        let unit = (units > 1 && k % 2 == 1).then_some(k / 2 % units);
        let light = (k % 8 >= 6).then(|| beside(-direction, &mut random));
        training.extend(view(direction, unit, light));
    }
    let held_out: Vec<DVec3> = directions(options.held_out, &mut random);
    let held_out = held_out.into_iter().filter_map(|direction| view(direction, None, None)).collect();
    training.shuffle(&mut random);
    (training, held_out)
}

/// The picture of a volume that its Gaussians should give: with the shading of clear boundaries everywhere, and the light and
/// background of the camera.
#[must_use]
pub fn march(marcher: &RayMarcher, camera: &Camera) -> Image {
    let pinhole = Pinhole {
        width: camera.width as usize,
        height: camera.height as usize,
        focal: [camera.fx, camera.fy],
        center: [camera.cx, camera.cy],
        world_to_camera: camera.view(),
    };
    let (ambient, diffuse, specular, shininess) = SURFACE_SHADING;
    let illumination = match camera.light.mode {
        LightMode::Headlight => Illumination::Headlight,
        LightMode::Direction => Illumination::Direction(Vec3::from_array(camera.light.direction)),
    };
    let lighting = Lighting::Lit(Material { ambient, diffuse, specular, shininess }, illumination);
    let picture = marcher.picture(&pinhole, lighting, camera.background());
    Image { width: camera.width, height: camera.height, rgba: picture.pixels.into_flattened() }
}

/// A camera that frames a box from a direction.
fn camera(frame: &Bounds, direction: DVec3, light: Option<DVec3>, size: u32) -> Camera {
    let up = if direction.z.abs() > 0.99 { DVec3::Y } else { DVec3::Z };
    let middle = 0.5 * (frame.min + frame.max);
    let right = direction.cross(up).normalize();
    let down = direction.cross(right);
    let slope = (0.5 * FIELD_OF_VIEW.to_radians()).tan();
    // A corner at (x, y, z) beside the middle is within the picture from a distance of max(|x|, |y|)/slope − z on.
    let needed = (0..8).map(|k| {
        let corner = DVec3::select(BVec3::new(k & 1 > 0, k & 2 > 0, k & 4 > 0), frame.max, frame.min) - middle;
        corner.dot(right).abs().max(corner.dot(down).abs()) / slope - corner.dot(direction)
    });
    let distance = MARGIN * needed.fold(f64::MIN_POSITIVE, f64::max);
    let mut camera = Camera::look_at(middle - distance * direction, middle, up, FIELD_OF_VIEW, size, size);
    if let Some(light) = light {
        camera.light.mode = LightMode::Direction;
        camera.light.direction = light.as_vec3().to_array();
    }
    camera
}

/// The box of the voxels that the transfer function shows. Cameras depend on the volume alone, so scenes of any number of
/// Gaussians, at any stage, are measured by the same pictures.
fn visible_box(field: &Field, classifier: &Classifier) -> Bounds {
    let grid = field.grid();
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (min, max) = (0..grid.len())
        .into_par_iter()
        .filter(|i| classifier.opacity(field.raw(*i)) > 0.0)
        .fold(
            || none,
            |(min, max), i| {
                let voxel = grid.voxel(i).as_dvec3();
                (min.min(voxel), max.max(voxel))
            },
        )
        .reduce(|| none, |a, b| (a.0.min(b.0), a.1.max(b.1)));
    if !min.is_finite() {
        return grid.bounds();
    }
    let corners = (0..8).map(|k| {
        let corner = DVec3::select(BVec3::new(k & 1 > 0, k & 2 > 0, k & 4 > 0), max + 0.5, min - 0.5);
        grid.to_world(corner)
    });
    let (min, max) = corners.fold(none, |(min, max), corner| (min.min(corner), max.max(corner)));
    Bounds { min, max }
}

/// Even directions over the sphere (a Fibonacci lattice), turned at random.
fn directions(n: usize, random: &mut ChaCha8Rng) -> Vec<DVec3> {
    let turn = DMat3::from_quat(
        DQuat::from_xyzw(
            random.random_range(-1.0..1.0),
            random.random_range(-1.0..1.0),
            random.random_range(-1.0..1.0),
            random.random_range(0.1..1.0),
        )
        .normalize(),
    );
    let golden = PI * (3.0 - 5.0_f64.sqrt());
    (0..n)
        .map(|k| {
            let z = 1.0 - (2.0 * k as f64 + 1.0) / n as f64;
            let (sin, cos) = (golden * k as f64).sin_cos();
            turn * DVec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z)
        })
        .collect()
}

/// A direction within [`LIGHT_ANGLE`] of `to_eye`.
fn beside(to_eye: DVec3, random: &mut ChaCha8Rng) -> DVec3 {
    let (angle, around) = (random.random_range(0.2..LIGHT_ANGLE), random.random_range(0.0..2.0 * PI));
    let (right, up) = to_eye.any_orthonormal_pair();
    to_eye * angle.cos() + (right * around.cos() + up * around.sin()) * angle.sin()
}
