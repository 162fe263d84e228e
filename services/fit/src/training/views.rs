//! Pictures to train on: a volume or a mesh seen by ray marching from all sides.

use std::cmp::Ordering;
use std::f64::consts::PI;

use glam::{BVec3, DMat3, DQuat, DVec3};
use rand::seq::SliceRandom as _;
use rand::{RngExt as _, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sg_raster::image::Image;
use sg_raster::volume::{fast_march, march, region};
use sg_scene::appearance::{Appearance, Clip};
use sg_scene::camera::{Camera, LightMode};
use sg_scene::model::Scene;
use sg_scene::view::FIELD_OF_VIEW;
use sg_volume::{Bounds, Classifier, ScalarFieldRef};

/// Voxels between two samples of a ray; of a mesh, 1/256 of its diagonal.
const STEP: f64 = 0.5;

/// Distance of a camera over the one from which the box just fills the picture.
const MARGIN: f64 = 1.02;

/// Greatest angle between the light and the direction to the eye, in radians.
const LIGHT_ANGLE: f64 = 1.2;

/// Opacity of a faded base unit.
const FADED: f32 = 0.2;

/// Voxels or tetrahedra drawn at random in search of a shown one. Where those are rarer, a cut goes through the middle of their box.
const CUT_TRIALS: usize = 10_000;

/// One picture to train on, or to measure with.
#[derive(Debug, Clone)]
pub struct TrainingView {
    /// The camera, with its light and background.
    pub camera: Camera,
    /// Factors on the opacities of the base units, 0 to 1; those that are missing are 1.
    pub opacities: Vec<f32>,
    /// What takes parts of the scene away.
    pub clips: Vec<Clip>,
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
        Self { views: 96, held_out: 8, size: 512, seed: 0 }
    }
}

impl TrainingView {
    /// The appearance of a scene in this view.
    #[must_use]
    pub fn appearance(&self, scene: &Scene) -> Appearance {
        let mut appearance = Appearance::of(scene);
        appearance.light = self.camera.light;
        appearance.background = self.camera.background();
        for (base, factor) in appearance.base.iter_mut().zip(&self.opacities) {
            base.opacity *= factor;
            base.visible &= *factor > 0.0;
        }
        appearance.clips.extend(self.clips.iter().cloned());
        appearance
    }
}

/// Renders the views of a volume: those to train on in random order, and those to measure with. `progress` gets
/// the number of finished views and of all.
///
/// Cameras stand around what the transfer function shows, framed. A third of the views has a light beside the eye, so that
/// normals and shading factors are learnt apart from colours. A third has a white background, on which dark borders of
/// what is shown are seen. Half of the views show edits, since a picture of the whole scene says nothing about what it
/// hides: single base units, faded ones, and cuts.
#[must_use]
pub fn volume_views<'a>(
    field: impl Into<ScalarFieldRef<'a>>,
    classifier: &Classifier,
    options: &ViewOptions,
    mut progress: impl FnMut(usize, usize),
) -> (Vec<TrainingView>, Vec<TrainingView>) {
    let field = field.into();
    let mut random = ChaCha8Rng::seed_from_u64(options.seed ^ 0x7261_696e);
    let units = classifier.unit_count();
    // Cameras depend on the volume alone, so scenes of any number of Gaussians are measured by the same pictures.
    let frame = field.visible_bounds(classifier);
    let mut plans = Vec::with_capacity(options.views);
    for (k, direction) in directions(options.views, &mut random).into_iter().enumerate() {
        let unit = k / 8 % units;
        let others = |factor: f32, rest: f32| (0..units).map(|k| if k == unit { factor } else { rest }).collect();
        let (opacities, clips): (Vec<f32>, _) = match k % 8 {
            1 | 5 if units > 1 => (others(1.0, 0.0), Vec::new()),
            3 => (others(FADED, 1.0), Vec::new()),
            7 => (Vec::new(), vec![cut((field, classifier), &frame, direction, &mut random)]),
            _ => (Vec::new(), Vec::new()),
        };
        let light = (k % 3 == 2).then(|| beside(-direction, &mut random));
        let mut camera = camera(&frame, direction, light, options.size);
        if k / 2 % 3 == 1 {
            camera.background = [1.0; 3];
        }
        plans.push((camera, opacities, clips));
    }
    let held_out: Vec<Camera> = directions(options.held_out, &mut random)
        .into_iter()
        .map(|direction| camera(&frame, direction, None, options.size))
        .collect();
    let of = plans.len() + held_out.len();
    let mut done = 0;
    let mut finished = |view: TrainingView| {
        done += 1;
        progress(done, of);
        view
    };
    // Each set of opacities has blocks and a table of its own, made once.
    plans.sort_by(|a, b| a.1.partial_cmp(&b.1).unwrap_or(Ordering::Equal));
    let mut training = Vec::with_capacity(plans.len());
    for plans in plans.chunk_by(|a, b| a.1 == b.1) {
        let opacities = plans.first().map_or_else(Vec::new, |plan| plan.1.clone());
        let mut marcher = field.marcher(classifier.with_opacities(opacities.clone()), STEP);
        for (camera, _, clips) in plans {
            marcher = marcher.clipped(clips.iter().map(region).collect());
            let reference = fast_march(&marcher, camera);
            training.push(finished(TrainingView {
                camera: camera.clone(),
                opacities: opacities.clone(),
                clips: clips.clone(),
                reference,
            }));
        }
    }
    training.shuffle(&mut random);
    let marcher = field.marcher(classifier.clone(), STEP);
    let held_out = held_out.into_iter().map(|camera| {
        let reference = march(&marcher, &camera);
        finished(TrainingView { camera, opacities: Vec::new(), clips: Vec::new(), reference })
    });
    let held_out = held_out.collect();
    (training, held_out)
}

/// A plane, askew, through a voxel or tetrahedron that the transfer function shows. It takes away the nearer side to the eye.
fn cut(
    (field, classifier): (ScalarFieldRef<'_>, &Classifier),
    frame: &Bounds,
    direction: DVec3,
    random: &mut ChaCha8Rng,
) -> Clip {
    let mut even = |reach: f64| random.random_range(-reach..reach);
    let normal = (direction + DVec3::new(even(0.4), even(0.4), even(0.4))).normalize();
    let mut elements = (0..CUT_TRIALS).map(|_| field.element(random.random_range(0..field.elements())));
    let shown = elements.find(|(_, raw)| classifier.opacity(*raw) > 0.0);
    let through = shown.map_or(0.5 * (frame.min + frame.max), |(place, _)| place);
    Clip::plane(through, normal)
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
