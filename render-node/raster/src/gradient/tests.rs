use glam::{DMat4, DQuat, Vec3};
use rand::{RngExt as _, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sg_scene::appearance::Clip;
use sg_scene::camera::LightMode;
use sg_scene::framing::default_camera;
use sg_scene::model::{ShadingColumns, ShadingModel};
use sg_scene::synthetic::test_scene;

use super::*;
use crate::image_error::Difference;
use crate::render::{Quality, render};

/// Two units of Gaussians with all attributes at random; the second one is mirrored and stretched.
fn scene(n: usize, size: f32, seed: u64) -> Scene {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut scene = test_scene(&[("one", n / 2), ("two", n - n / 2)]);
    for unit in &mut scene.units {
        let gaussians = &mut unit.gaussians;
        let n = gaussians.len();
        let mut column = |low: f32, high: f32| (0..n).map(|_| random.random_range(low..high)).collect::<Vec<f32>>();
        let vectors = |a: Vec<f32>, b: Vec<f32>, c: Vec<f32>| {
            a.into_iter().zip(b).zip(c).map(|((a, b), c)| Vec3::new(a, b, c)).collect::<Vec<Vec3>>()
        };
        let (a, b, c) = (size.ln() - 0.7, size.ln() + 0.7, 1.0);
        gaussians.log_scale = vectors(column(a, b), column(a, b), column(a, b));
        gaussians.rotation = (0..n)
            .map(|_| ())
            .zip(vectors(column(-c, c), column(-c, c), column(-c, c)))
            .map(|((), v)| [0.7, v.x, v.y, v.z])
            .collect();
        gaussians.opacity_logit = column(-2.0, 2.0);
        // Normals look at the eye, which is at the side of −y: away from the kink of max(n·l, 0).
        let normal = vectors(column(-0.5, 0.5), column(-1.0, -0.7), column(-0.5, 0.5));
        gaussians.shading = Some(ShadingColumns {
            offset_color: vectors(column(-0.2, 0.2), column(-0.2, 0.2), column(-0.2, 0.1)),
            normal,
            ambient: column(0.2, 0.4),
            diffuse: column(0.2, 0.5),
            specular: column(0.05, 0.15),
            shininess: column(1.5, 9.0),
        });
        unit.palette = Vec3::new(0.4, 0.5, 0.6);
    }
    let turn = DQuat::from_rotation_z(0.2) * DQuat::from_rotation_x(-0.1);
    scene.units[1].transform = DMat4::from_quat(turn)
        * DMat4::from_scale(DVec3::new(-1.1, 0.9, 1.0))
        * DMat4::from_translation(DVec3::new(-9.0, 0.5, 0.3));
    scene
}

/// Two planes and the outside of a box, all through the middle of the scene.
fn cuts(scene: &Scene) -> Vec<Clip> {
    let middle = sg_scene::framing::visible_box(scene);
    let middle = 0.5 * (middle.min + middle.max);
    let corner = Clip::between(middle + DVec3::new(0.1, -9.0, -9.0), middle + DVec3::splat(9.0), false);
    vec![Clip::plane(middle, DVec3::new(1.0, -0.5, 2.0)), corner]
}

fn weights(camera: &Camera, seed: u64) -> Vec<[f64; 4]> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    (0..camera.width * camera.height).map(|_| std::array::from_fn(|_| random.random_range(-1.0..1.0))).collect()
}

fn loss_of(scene: &Scene, appearance: &Appearance, camera: &Camera, weights: &[[f64; 4]]) -> f64 {
    let picture = exact::picture(scene, appearance, camera).unwrap();
    picture.iter().zip(weights).map(|(p, w)| p.iter().zip(w).map(|(p, w)| p * w).sum::<f64>()).sum()
}

/// A number of a scene that can be changed: its name, its place, and its derivative.
type Number =
    (&'static str, fn(&mut Scene, usize, usize, usize) -> &mut f32, fn(&GaussianGradient, usize) -> f64, usize);

fn shading(scene: &mut Scene, unit: usize) -> &mut ShadingColumns {
    scene.units[unit].gaussians.shading.as_mut().unwrap()
}

const NUMBERS: [Number; 10] = [
    ("position", |s, u, i, k| &mut s.units[u].gaussians.position[i][k], |g, k| g.position[k], 3),
    ("rotation", |s, u, i, k| &mut s.units[u].gaussians.rotation[i][k], |g, k| g.rotation[k], 4),
    ("log_scale", |s, u, i, k| &mut s.units[u].gaussians.log_scale[i][k], |g, k| g.log_scale[k], 3),
    ("opacity_logit", |s, u, i, _| &mut s.units[u].gaussians.opacity_logit[i], |g, _| g.opacity_logit, 1),
    ("offset_color", |s, u, i, k| &mut shading(s, u).offset_color[i][k], |g, k| g.offset_color[k], 3),
    ("normal", |s, u, i, k| &mut shading(s, u).normal[i][k], |g, k| g.normal[k], 3),
    ("ambient", |s, u, i, _| &mut shading(s, u).ambient[i], |g, _| g.ambient, 1),
    ("diffuse", |s, u, i, _| &mut shading(s, u).diffuse[i], |g, _| g.diffuse, 1),
    ("specular", |s, u, i, _| &mut shading(s, u).specular[i], |g, _| g.specular, 1),
    ("shininess", |s, u, i, _| &mut shading(s, u).shininess[i], |g, _| g.shininess, 1),
];

/// The derivative of the loss by a number, by central differences. The step is the one that an f32 really makes.
fn central(number: impl Fn(&mut Scene) -> &mut f32, scene: &Scene, loss: impl Fn(&Scene) -> f64) -> f64 {
    let at = |step: f32| {
        let mut moved = scene.clone();
        *number(&mut moved) += step;
        (f64::from(*number(&mut moved)), loss(&moved))
    };
    let ((low, before), (high, after)) = (at(-1e-3), at(1e-3));
    (after - before) / (high - low)
}

#[test]
fn derivatives_are_those_of_central_differences_for_every_attribute() {
    for model in [ShadingModel::Paper, ShadingModel::IvrgsTrain, ShadingModel::IvrgsViewer] {
        for mode in [LightMode::Headlight, LightMode::Direction] {
            let mut scene = scene(10, 0.7, 3);
            scene.units.iter_mut().for_each(|unit| unit.shading = model);
            let camera = default_camera(&scene, 22, 18);
            let mut appearance = Appearance::of(&scene);
            appearance.background = Vec3::new(0.9, 0.3, 0.1);
            appearance.light.mode = mode;
            appearance.light.direction = [0.5, -2.0, 0.7];
            appearance.base[1].opacity = 0.8;
            appearance.base[0].multipliers = [1.1, 0.9, 1.2, 0.8];
            // One unit of each pixel filter; at this size the dilation is a good part of the Gaussians.
            scene.units[1].gaussians.antialiased = true;
            if mode == LightMode::Direction {
                // Two planes and the outside of a box, across Gaussians.
                appearance.clips = cuts(&scene);
            }
            let weights = weights(&camera, 5);
            let found = exact::gradients(&scene, &appearance, &camera, &weights).unwrap();
            let loss = |scene: &Scene| loss_of(scene, &appearance, &camera, &weights);
            for (name, number, derivative, count) in NUMBERS {
                let greatest =
                    found.gaussians.iter().flat_map(|g| (0..count).map(|k| derivative(g, k).abs())).fold(0.0, f64::max);
                assert!(greatest > 1e-4, "{model:?} {mode:?} {name}: {greatest}");
                for unit in 0..2 {
                    for i in 0..scene.units[unit].gaussians.len() {
                        for k in 0..count {
                            let want = central(|s| number(s, unit, i, k), &scene, loss);
                            let got = derivative(&found.gaussians[scene.units[unit].first + i], k);
                            let close = (got - want).abs() <= 2e-5 * greatest;
                            assert!(close, "{model:?} {mode:?} {name} {unit} {i} {k}: {got} {want} of {greatest}");
                        }
                    }
                }
            }
            for unit in 0..2 {
                for k in 0..3 {
                    let moved = |step: f32| {
                        let mut appearance = appearance.clone();
                        appearance.base[unit].palette[k] += step;
                        let palette = f64::from(appearance.base[unit].palette[k]);
                        (palette, loss_of(&scene, &appearance, &camera, &weights))
                    };
                    let ((low, before), (high, after)) = (moved(-1e-3), moved(1e-3));
                    let (got, want) = (found.palettes[unit][k], (after - before) / (high - low));
                    assert!((got - want).abs() <= 1e-6 * (1.0 + want.abs()), "palette {unit} {k}: {got} {want}");
                }
            }
        }
    }
}

/// Length of the difference over the length of what is right, for each attribute.
fn errors(found: &Gradients, exact: &Gradients) -> Vec<(&'static str, f64)> {
    let error = |derivative: fn(&GaussianGradient, usize) -> f64, count: usize| {
        let (mut off, mut all) = (0.0, 0.0);
        for (a, b) in found.gaussians.iter().zip(&exact.gaussians) {
            for k in 0..count {
                off += (derivative(a, k) - derivative(b, k)).powi(2);
                all += derivative(b, k).powi(2);
            }
        }
        (off / all).sqrt()
    };
    NUMBERS.iter().map(|(name, _, derivative, count)| (*name, error(*derivative, *count))).collect()
}

#[test]
fn the_fast_derivatives_are_those_of_the_twin() {
    let mut scene = scene(1500, 0.25, 9);
    scene.units[0].gaussians.antialiased = true;
    let camera = default_camera(&scene, 75, 61);
    let mut appearance = Appearance::of(&scene);
    appearance.background = Vec3::new(0.2, 0.7, 0.4);
    let weights = weights(&camera, 6);
    let exact = exact::gradients(&scene, &appearance, &camera, &weights).unwrap();
    let by_pixel: Vec<[f32; 4]> = weights.iter().map(|w| w.map(|x| x as f32)).collect();
    let reference = render(&scene, &appearance, &camera, Quality::Exact).unwrap().image;
    for (limits, decibels, bound) in [(Limits::STANDARD, 50.0, 0.005), (Limits::FAST, 40.0, 0.05)] {
        let recording = record(&scene, &appearance, &camera, limits).unwrap();
        let difference = Difference::between(&recording.image, &reference).unwrap();
        assert!(difference.footprint_psnr_db > decibels, "{difference:?}");
        let found = recording.gradients(&by_pixel).unwrap();
        for (name, error) in errors(&found, &exact) {
            assert!(error < bound, "{name}: {error}");
        }
        // The same on any number of threads, to the last bit.
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert_eq!(pool.install(|| recording.gradients(&by_pixel).unwrap()), found);
    }
}

#[test]
fn opaque_layers_keep_their_derivatives() {
    // The front layer has opacity 1 in f32. A rule that divides by 1 − α has no answer for it.
    let mut scene = test_scene(&[("wall", 2)]);
    let gaussians = &mut scene.units[0].gaussians;
    gaussians.position = vec![Vec3::new(5.0, 2.0, 5.0), Vec3::new(5.0, 8.0, 5.0)];
    gaussians.log_scale = vec![Vec3::new(0.6, 0.3, 0.1); 2];
    gaussians.rotation = vec![[0.9, 0.2, -0.3, 0.1]; 2];
    gaussians.opacity_logit = vec![40.0, 3.0];
    let camera = default_camera(&scene, 32, 32);
    let appearance = Appearance::of(&scene);
    let weights = vec![[1.0, -0.5, 0.25, 0.5]; 32 * 32];
    let exact = exact::gradients(&scene, &appearance, &camera, &weights).unwrap();
    let by_pixel: Vec<[f32; 4]> = weights.iter().map(|w| w.map(|x| x as f32)).collect();
    let found = record(&scene, &appearance, &camera, Limits::STANDARD).unwrap().gradients(&by_pixel).unwrap();
    for (name, error) in errors(&found, &exact) {
        assert!(error < 0.01, "{name}: {error}");
    }
    let loss = |scene: &Scene| loss_of(scene, &appearance, &camera, &weights);
    for k in 0..3 {
        let want = central(|s| &mut s.units[0].gaussians.position[0][k], &scene, loss);
        let got = found.gaussians[0].position[k];
        assert!((got - want).abs() < 0.01 * exact.gaussians[0].position.length(), "{k}: {got} {want}");
    }
}

#[test]
fn what_cannot_be_trained_is_refused() {
    let mut scene = test_scene(&[("one", 3)]);
    let camera = default_camera(&scene, 8, 8);
    let appearance = Appearance::of(&scene);
    let recording = record(&scene, &appearance, &camera, Limits::FAST).unwrap();
    assert!(matches!(recording.gradients(&[[0.0; 4]]), Err(GradientError::Pixels { found: 1, expected: 64 })));
    let edited = Appearance { term: ShadingTerm::Normal, ..appearance.clone() };
    assert!(matches!(record(&scene, &edited, &camera, Limits::FAST), Err(GradientError::Edited)));
    let preview = Camera { preview_scale: 0.5, ..camera.clone() };
    assert!(matches!(record(&scene, &appearance, &preview, Limits::FAST), Err(GradientError::Preview)));
    scene.units[0].gaussians.shading = None;
    assert!(matches!(record(&scene, &appearance, &camera, Limits::FAST), Err(GradientError::Unlit(_))));
}

#[test]
fn what_is_not_finite_has_no_derivatives_and_spoils_none() {
    let mut scene = scene(40, 0.5, 11);
    scene.units[0].gaussians.position[3].x = f32::NAN;
    scene.units[0].gaussians.log_scale[4].y = f32::INFINITY;
    let camera = default_camera(&scene, 32, 32);
    let appearance = Appearance::of(&scene);
    let found = record(&scene, &appearance, &camera, Limits::FAST).unwrap().gradients(&[[1.0; 4]; 32 * 32]).unwrap();
    assert_eq!([3, 4].map(|i| found.gaussians[i]), [GaussianGradient::default(); 2]);
    assert!(found.gaussians.iter().all(|g| g.position.is_finite() && g.log_scale.is_finite() && g.normal.is_finite()));
}
