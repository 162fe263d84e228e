//! The state of a renderer on a graphics device between pictures: looks, eyes, sizes, windows, the device itself.

use std::sync::Arc;

use glam::{DMat4, DQuat, DVec3, Vec3};
use sg_gpu::backend::{Backend, Engine};
use sg_gpu::{DeviceClass, Gpu, GpuError, Options, Rasterizer, Renderer, Settings};
use sg_raster::image::Image;
use sg_raster::image_error::Difference;
use sg_raster::render::Quality::{Exact, Standard};
use sg_raster::render::{Projection, render};
use sg_scene::appearance::{Appearance, Clip, Overlay, UnitAppearance};
use sg_scene::camera::Camera;
use sg_scene::mask::Mask;
use sg_scene::model::Scene;
use sg_scene::tone::Tone;

use crate::cases;
use crate::scenes::{camera, cloud, crowd, scene, side_view, surface};
use crate::support::device;

fn with(rasterizer: Rasterizer) -> Settings {
    Settings { rasterizer, ..Settings::default() }
}

/// The camera with its eye moved to its right, and turned about its own vertical.
fn eye(camera: &Camera, right: f64, turn: f64) -> Camera {
    let moved = DMat4::from_quat(DQuat::from_rotation_y(turn))
        * DMat4::from_translation(DVec3::new(-right, 0.0, 0.0))
        * camera.view();
    Camera { world_to_camera: moved.transpose().to_cols_array(), ..camera.clone() }
}

fn decibel(image: &Image, want: &Image) -> f64 {
    Difference::between(image, want).unwrap().footprint_psnr_db
}

#[test]
fn two_eyes_drawn_together_equal_each_drawn_alone() {
    let Some(gpu) = device() else { return };
    let scene = scene(&surface(8000, 3));
    let appearance = Appearance::of(&scene);
    let middle = side_view(160, 120, 50.0);
    let mut renderer = Renderer::new(&gpu, &scene).unwrap();
    let by_ray = Settings { projection: Projection::PerRay, ..Settings::default() };
    for settings in [with(Rasterizer::Tiles), by_ray, with(Rasterizer::Quads), with(Rasterizer::Bands)] {
        // Parallel axes share an order, canted ones have one each.
        for turn in [0.0, 0.1] {
            let eyes = [eye(&middle, -0.03, turn), eye(&middle, 0.03, -turn)];
            let (pair, _) = renderer.picture(&eyes, &appearance, settings).unwrap();
            for (camera, image) in eyes.iter().zip(&pair) {
                let (alone, _) = renderer.picture(std::slice::from_ref(camera), &appearance, settings).unwrap();
                let largest = Difference::between(image, &alone[0]).unwrap().max_error;
                assert!(largest < 2e-5, "{settings:?}, turned {turn}: {largest}");
            }
            assert!(decibel(&pair[0], &pair[1]) < 40.0, "the eyes see different pictures");
        }
    }
}

/// Pixels of both eyes that are more than one buffer holds are collected one eye after the other.
#[test]
fn eyes_too_large_to_be_drawn_together_are_drawn_alone() {
    let Some(gpu) = device() else { return };
    let scene = scene(&surface(40, 3));
    let appearance = Appearance::of(&scene);
    // On a device whose bindings hold 128 MiB, as lavapipe's do, 9.1 million pixels are too many and half of them are not.
    let middle = side_view(2064, 2208, 50.0);
    let eyes = [eye(&middle, -0.03, 0.0), eye(&middle, 0.03, 0.0)];
    let mut renderer = Renderer::new(&gpu, &scene).unwrap();
    let (pair, _) = renderer.picture(&eyes, &appearance, with(Rasterizer::Tiles)).unwrap();
    let (alone, _) = renderer.picture(&eyes[1..], &appearance, with(Rasterizer::Tiles)).unwrap();
    assert!(Difference::between(&pair[1], &alone[0]).unwrap().max_error < 2e-5);
    if gpu.is_software() {
        let huge = [side_view(4128, 2208, 50.0)];
        let refused = renderer.picture(&huge, &appearance, with(Rasterizer::Tiles)).unwrap_err();
        assert!(refused.to_string().contains("in one buffer"), "{refused}");
    }
}

/// Many Gaussians at one depth: their order is the scene's, for both eyes and from picture to picture.
#[test]
fn equal_depths_keep_their_order_in_both_eyes() {
    let Some(gpu) = device() else { return };
    let mut blobs = cloud(3000, 21);
    for blob in &mut blobs {
        blob.position.z = 3.0;
        blob.logit = 3.0;
    }
    let scene = scene(&blobs);
    let appearance = Appearance::of(&scene);
    let front = Camera::look_at(DVec3::ZERO, DVec3::Z, DVec3::NEG_Y, 50.0, 120, 90);
    let eyes = [eye(&front, -0.03, 0.0), eye(&front, 0.03, 0.0)];
    let mut renderer = Renderer::new(&gpu, &scene).unwrap();
    for rasterizer in Rasterizer::ALL {
        let (first, _) = renderer.picture(&eyes, &appearance, with(rasterizer)).unwrap();
        let (again, _) = renderer.picture(&eyes, &appearance, with(rasterizer)).unwrap();
        assert_eq!(first, again, "the same picture to the last bit");
        for (camera, image) in eyes.iter().zip(&first) {
            let exact = render(&scene, &appearance, camera, Exact).unwrap().image;
            assert!(decibel(image, &exact) > 60.0);
        }
    }
}

#[test]
fn shading_shared_by_both_eyes_is_an_approximation_of_known_error() {
    let Some(gpu) = device() else { return };
    let mut scene = scene(&surface(8000, 5));
    let unit = &mut scene.units[0];
    if let Some(shading) = &mut unit.gaussians.shading {
        for (n, p) in shading.normal.iter_mut().zip(&unit.gaussians.position) {
            *n = (*p - 3.0 * Vec3::Z).normalize();
        }
        shading.diffuse.fill(0.5);
        shading.ambient.fill(0.3);
        shading.specular.fill(0.4);
        shading.shininess.fill(30.0);
    }
    let appearance = Appearance::of(&scene);
    let middle = side_view(160, 120, 50.0);
    let eyes = [eye(&middle, -0.03, 0.0), eye(&middle, 0.03, 0.0)];
    let mut renderer = Renderer::new(&gpu, &scene).unwrap();
    let (own, _) = renderer.picture(&eyes, &appearance, Settings::default()).unwrap();
    let shared = Settings { shared_shading: true, ..Settings::default() };
    let (shared, _) = renderer.picture(&eyes, &appearance, shared).unwrap();
    for k in 0..2 {
        let d = Difference::between(&shared[k], &own[k]).unwrap();
        println!("eye {k}: shared shading {:.1} dB, max {:.4}", d.footprint_psnr_db, d.max_error);
        assert!(d.footprint_psnr_db > 35.0 && d.max_error > 0.0 && d.coverage_error < 1e-6, "{d:?}");
    }
}

/// A stroke that changes k Gaussians sends words of the mask, never the mask or the scene.
#[test]
fn a_change_of_a_selection_sends_the_words_that_changed() {
    let Some(gpu) = device() else { return };
    let scene = scene(&cloud(20_000, 6));
    let camera = [side_view(96, 64, 40.0)];
    let mut renderer = Renderer::new(&gpu, &scene).unwrap();
    let mut look = Appearance::of(&scene);
    let picture = |renderer: &mut Renderer, look: &Appearance| {
        let (images, _) = renderer.picture(&camera, look, Settings::default()).unwrap();
        let exact = render(&scene, look, &camera[0], Standard).unwrap().image;
        assert!(decibel(&images[0], &exact) > 70.0);
        renderer.appearance_bytes()
    };
    picture(&mut renderer, &look);
    assert_eq!(picture(&mut renderer, &look), 0, "nothing changed, nothing is sent");
    let highlight = |mask: Mask| Overlay { mask: Arc::new(mask), color: Vec3::X, mix: 0.7, opacity: 1.0 };
    let mut mask = Mask::from_fn(20_000, |i| i % 3 == 0);
    look.overlay = Some(highlight(mask.clone()));
    assert_eq!(picture(&mut renderer, &look), 8 * 20_000_u64.div_ceil(64), "the whole mask once");
    mask.set(1, true);
    mask.set(19_999, true);
    look.overlay = Some(highlight(mask.clone()));
    assert_eq!(picture(&mut renderer, &look), 16, "two words");
    // A unit takes the first slot; the highlight moves behind it.
    let unit = |color| UnitAppearance {
        mask: Arc::new(mask.clone()),
        color,
        opacity: 0.5,
        visible: true,
        tone: Tone::NEUTRAL,
    };
    look.units = vec![unit(Some(Vec3::Y))];
    picture(&mut renderer, &look);
    look.units = vec![UnitAppearance { visible: false, ..unit(None) }];
    assert!(picture(&mut renderer, &look) <= 8 * 20_000_u64.div_ceil(64) + 64, "a table, and a mask of another place");
    look.units.clear();
    look.overlay = None;
    picture(&mut renderer, &look);
}

/// Shown colours and occlusion share a buffer.
#[test]
fn shown_colours_and_occlusion_take_turns() {
    let Some(gpu) = device() else { return };
    let mut scene = scene(&surface(4000, 3));
    scene.units[0].palette = Vec3::splat(0.4);
    let camera = [side_view(96, 64, 40.0)];
    let mut renderer = Renderer::new(&gpu, &scene).unwrap();
    let plain = Appearance::of(&scene);
    let colors: Arc<[Vec3]> = (0..scene.len()).map(|i| Vec3::splat((i % 5) as f32 / 5.0)).collect();
    let occlusion: Arc<[f32]> = (0..scene.len()).map(|i| (i % 4) as f32 / 4.0).collect();
    let occluded = Appearance { occlusion: Some(occlusion), ..plain.clone() };
    let shown = Appearance { colors: Some(Arc::clone(&colors)), ..occluded.clone() };
    let colored = Appearance { occlusion: None, ..shown.clone() };
    for look in [&plain, &occluded, &shown, &occluded, &colored, &shown, &plain, &occluded] {
        let (images, _) = renderer.picture(&camera, look, Settings::default()).unwrap();
        let want = render(&scene, look, &camera[0], Standard).unwrap().image;
        assert!(decibel(&images[0], &want) > 70.0);
    }
    renderer.picture(&camera, &occluded, Settings::default()).unwrap();
    assert_eq!(renderer.appearance_bytes(), 0, "nothing changed, nothing is sent");
    let (with, without) =
        (render(&scene, &occluded, &camera[0], Standard), render(&scene, &plain, &camera[0], Standard));
    assert!(decibel(&with.unwrap().image, &without.unwrap().image) < 40.0, "occlusion is seen");
}

/// More pairs than are listed at once: the picture is the same in windows.
#[test]
fn pairs_beyond_the_list_are_blended_in_windows() {
    let Some(gpu) = device() else { return };
    let scene = scene(&cloud(3000, 8));
    let appearance = Appearance::of(&scene);
    let middle = side_view(160, 120, 60.0);
    let options = Options { listed_pairs: 1024, ..Options::default() };
    let mut renderer = Renderer::with_options(&gpu, &scene, options).unwrap();
    // Canted eyes have an order and lists each.
    for turn in [0.0, 0.2] {
        let eyes = [eye(&middle, -0.03, turn), eye(&middle, 0.03, -turn)];
        let (whole, _) = Renderer::new(&gpu, &scene).unwrap().picture(&eyes, &appearance, Settings::default()).unwrap();
        let (windows, drawn) = renderer.picture(&eyes, &appearance, Settings::default()).unwrap();
        assert!(drawn.tile_pairs > 10 * 1024, "{drawn:?}");
        assert_eq!(windows, whole);
    }
    // Each window is in the order of the rays; from one to the next the order is that of the eye's distance.
    let by_ray = Settings { projection: Projection::PerRay, ..Settings::default() };
    let (whole, _) =
        Renderer::new(&gpu, &scene).unwrap().picture(std::slice::from_ref(&middle), &appearance, by_ray).unwrap();
    let (windows, drawn) = renderer.picture(std::slice::from_ref(&middle), &appearance, by_ray).unwrap();
    let kept = decibel(&windows[0], &whole[0]);
    println!("{} pairs by ray in windows of 1024: {kept:.1} dB", drawn.tile_pairs);
    assert!(drawn.tile_pairs > 5 * 1024 && kept > 40.0, "{kept}");
    let huge = [side_view(1024, 768, 30.0)];
    let refused = renderer.picture(&huge, &appearance, Settings::default()).unwrap_err();
    assert!(refused.to_string().contains("draw it with quadrilaterals"), "{refused}");
}

/// Half precision halves the size of shading columns and harmonics. Its error is far below the levels' promise.
#[test]
fn half_precision_is_worth_its_error() {
    let Some(gpu) = device() else { return };
    for case in cases::all().iter().filter(|c| ["paper", "harmonics of degree 3"].contains(&c.name)) {
        let picture = |half| {
            let options = Options { half, ..Options::default() };
            let mut renderer = Renderer::with_options(&gpu, &case.scene, options).unwrap();
            let cameras = std::slice::from_ref(&case.camera);
            let (mut images, _) = renderer.picture(cameras, &case.appearance, Settings::default()).unwrap();
            (images.remove(0), renderer.column_bytes())
        };
        let ((full, bytes), (half, fewer)) = (picture(false), picture(true));
        println!("{}: {bytes} bytes to {fewer}, {:.1} dB", case.name, decibel(&half, &full));
        assert!(decibel(&half, &full) > 60.0);
        let shapes = 48 * case.scene.len() as u64;
        assert!(2 * (fewer - shapes) <= bytes - shapes + 8);
    }
}

#[test]
fn a_lost_device_is_reported_and_a_new_one_draws_the_same() {
    let Some(gpu) = device() else { return };
    let scene = scene(&cloud(2000, 9));
    let appearance = Appearance::of(&scene);
    let camera = [side_view(64, 48, 40.0)];
    let mut renderer = Renderer::new(&gpu, &scene).unwrap();
    let (before, _) = renderer.picture(&camera, &appearance, Settings::default()).unwrap();
    gpu.lose();
    let error = renderer.picture(&camera, &appearance, Settings::default()).unwrap_err();
    assert!(matches!(error, GpuError::Lost { .. }), "{error}");
    assert!(error.to_string().contains("open it again"));
    drop(renderer);
    let gpu = Gpu::open(DeviceClass::Any).unwrap();
    let mut renderer = Renderer::new(&gpu, &scene).unwrap();
    let (after, _) = renderer.picture(&camera, &appearance, Settings::default()).unwrap();
    assert_eq!(before, after);
}

/// The engine outlives its device, draws the reference on the CPU, and needs no device for the CPU backend.
#[test]
fn an_engine_opens_a_lost_device_again() {
    if device().is_none() {
        return;
    }
    let scene = scene(&cloud(2000, 9));
    let look = Appearance::of(&scene);
    let view = side_view(64, 48, 40.0);
    let mut engine = Engine::new(scene.clone(), Backend::Gpu, None).unwrap();
    assert!(["tiles", "quads", "bands"].iter().any(|r| engine.name().ends_with(r)), "{}", engine.name());
    let before = engine.draw(&look, &view, Standard).unwrap();
    assert!(before.report.drawn > 0 && before.report.gaussians == 2000);
    engine.gpu().unwrap().lose();
    let after = engine.draw(&look, &view, Standard).unwrap();
    assert_eq!(before.image, after.image);
    assert!(engine.take_fallback_error().is_none(), "a device came back");
    engine.gpu().unwrap().lose();
    let lost = engine.gpu().unwrap().clone();
    let (gpu, left) = engine.leave(&look, std::slice::from_ref(&view), Standard).unwrap().unwrap();
    assert!(!gpu.is(&lost) && !gpu.is_lost() && lost.is_lost(), "left on the device opened anew");
    assert_eq!(left.iter().map(|t| [t.width(), t.height()]).collect::<Vec<_>>(), [[64, 48]]);
    assert!(engine.leave(&look, std::slice::from_ref(&view), Exact).unwrap().is_none(), "the cores draw it");
    let reference = render(&scene, &look, &view, Exact).unwrap().image;
    assert_eq!(engine.draw(&look, &view, Exact).unwrap().image, reference);
    let mut cores = Engine::new(scene.clone(), Backend::Cpu, Some(Rasterizer::Quads)).unwrap();
    assert_eq!(cores.name(), "cpu");
    let want = render(&scene, &look, &view, Standard).unwrap().image;
    assert_eq!(cores.draw(&look, &view, Standard).unwrap().image, want);
}

/// The same Gaussians, every third of them elsewhere, turned and larger.
fn moved(scene: &Scene) -> Scene {
    let mut moved = scene.clone();
    let rows: Vec<usize> = (0..scene.len()).step_by(3).collect();
    let turn = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 0.7);
    let map = DMat4::from_scale_rotation_translation(DVec3::splat(1.3), turn, DVec3::new(0.2, -0.1, 0.15));
    assert!(moved.units[0].gaussians.transform(&rows, &map));
    moved
}

/// Pictures of moved Gaussians are those of a renderer that has known no other place of them.
#[test]
fn a_renderer_shows_the_same_gaussians_elsewhere_as_a_new_one_does() {
    let Some(gpu) = device() else { return };
    let scene = scene(&surface(3000, 5));
    let (elsewhere, view) = (moved(&scene), [side_view(96, 64, 40.0)]);
    let hidden = Arc::new(Mask::from_fn(scene.len(), |i| i % 5 == 0));
    let mut look = Appearance::of(&scene);
    look.units =
        vec![UnitAppearance { mask: hidden, color: Some(Vec3::X), opacity: 0.5, visible: true, tone: Tone::NEUTRAL }];
    let mut renderer = Renderer::new(&gpu, &scene).unwrap();
    for settings in [with(Rasterizer::Tiles), with(Rasterizer::Quads)] {
        if settings.rasterizer != Rasterizer::Tiles && !renderer.blends_quads() {
            continue;
        }
        let (before, _) = renderer.picture(&view, &look, settings).unwrap();
        assert!(renderer.show(&elsewhere).unwrap());
        let (after, _) = renderer.picture(&view, &look, settings).unwrap();
        let (fresh, _) = Renderer::new(&gpu, &elsewhere).unwrap().picture(&view, &look, settings).unwrap();
        assert!(after == fresh && after != before, "{settings:?}");
        assert!(renderer.show(&scene).unwrap());
        assert_eq!(renderer.picture(&view, &look, settings).unwrap().0, before, "{settings:?}: and back");
    }
    let other = crate::scenes::scene(&surface(2999, 5));
    assert!(!renderer.show(&other).unwrap(), "another number of Gaussians needs another renderer");
    assert_eq!(renderer.gaussians(), 3000);
}

/// An engine on the cores, and one on a device, draw moved Gaussians where they are.
#[test]
fn an_engine_follows_moved_gaussians() {
    let scene = Arc::new(scene(&surface(2000, 7)));
    let elsewhere = Arc::new(moved(&scene));
    let (look, view) = (Appearance::of(&scene), side_view(64, 48, 40.0));
    let want = render(&elsewhere, &look, &view, Exact).unwrap().image;
    for backend in [Backend::Cpu, Backend::Gpu] {
        if backend == Backend::Gpu && device().is_none() {
            continue;
        }
        let mut engine = Engine::new(Arc::clone(&scene), backend, Some(Rasterizer::Tiles)).unwrap();
        let before = engine.draw(&look, &view, Standard).unwrap().image;
        engine.show(&elsewhere).unwrap();
        assert!(std::ptr::eq(engine.scene(), &*elsewhere), "{backend:?}");
        let after = engine.draw(&look, &view, Standard).unwrap().image;
        assert!(decibel(&after, &want) > 50.0 && decibel(&before, &want) < 40.0, "{backend:?}");
        engine.show(&scene).unwrap();
        assert_eq!(engine.draw(&look, &view, Standard).unwrap().image, before, "{backend:?}");
    }
}

/// A colour of trained splats is no flat disc: light and dark places stay where they are, by a palette as by a unit's colour.
#[test]
fn a_recoloured_trained_splat_keeps_its_texture() {
    let mut unit = sg_scene::synthetic::samples::unit("splat", sg_scene::synthetic::samples::harmonic(600, 2, 11));
    let edge = Scene::compose(vec![unit.clone()], None).bounds.longest_edge() as f32;
    unit.gaussians.log_scale.iter_mut().for_each(|s| *s = Vec3::splat((0.06 * edge).ln()));
    unit.gaussians.opacity_logit.iter_mut().for_each(|o| *o = 4.0);
    let scene = Scene::compose(vec![unit], None);
    let view = sg_scene::framing::default_camera(&scene, 96, 96);
    let own = Appearance::of(&scene);
    let red = Vec3::new(0.8, 0.1, 0.1);
    let mut palette = own.clone();
    palette.base[0].palette = red;
    let mut unit = own.clone();
    let all = Arc::new(Mask::full(scene.len()));
    unit.units = vec![UnitAppearance { mask: all, color: Some(red), opacity: 1.0, visible: true, tone: Tone::NEUTRAL }];
    let picture = |look: &Appearance| render(&scene, look, &view, Exact).unwrap().image;
    let (own, palette, unit) = (picture(&own), picture(&palette), picture(&unit));
    assert_eq!(palette, unit, "a palette and a unit's colour do the same");
    let covered = |k: usize| own.rgba[4 * k + 3] > 0.9;
    let brightness = |image: &Image, k: usize| {
        let [r, g, b] = [0, 1, 2].map(|c| f64::from(image.rgba[4 * k + c]));
        0.2126 * r + 0.7152 * g + 0.0722 * b
    };
    let places: Vec<usize> = (0..96 * 96).filter(|k| covered(*k)).collect();
    assert!(places.len() > 500, "{}", places.len());
    for k in &places {
        let [r, g] = [0, 1].map(|c| unit.rgba[4 * k + c]);
        assert!(r > 4.0 * g, "{k}: {r} {g} has the hue of the colour");
    }
    let mean = |image: &Image| places.iter().map(|k| brightness(image, *k)).sum::<f64>() / places.len() as f64;
    let (a, b) = (mean(&own), mean(&unit));
    let sum = |f: &dyn Fn(f64, f64) -> f64| {
        places.iter().map(|k| f(brightness(&own, *k) - a, brightness(&unit, *k) - b)).sum::<f64>()
    };
    let correlation = sum(&|x, y| x * y) / (sum(&|x, _| x * x) * sum(&|_, y| y * y)).sqrt();
    let contrast = (sum(&|_, y| y * y) / places.len() as f64).sqrt() / b;
    assert!(correlation > 0.9 && contrast > 0.05, "correlation {correlation}, contrast {contrast}");
}

#[test]
fn impossible_pictures_are_refused_with_a_reason() {
    let Some(gpu) = device() else { return };
    let scene = scene(&cloud(10, 9));
    let appearance = Appearance::of(&scene);
    let camera = side_view(64, 48, 40.0);
    let mut renderer = Renderer::new(&gpu, &scene).unwrap();
    let mut refused = |cameras: &[Camera], look: &Appearance| {
        renderer.picture(cameras, look, Settings::default()).unwrap_err().to_string()
    };
    assert!(refused(&[], &appearance).contains("no camera"));
    let other = Camera { width: 65, ..camera.clone() };
    assert!(refused(&[camera.clone(), other], &appearance).contains("one size"));
    let lost = Appearance { background: Vec3::NAN, ..appearance.clone() };
    assert!(refused(std::slice::from_ref(&camera), &lost).contains("background"));
    if gpu.is_software() {
        let large = Camera { width: 8192, height: 4096, ..camera.clone() };
        assert!(refused(&[large], &appearance).contains("with quadrilaterals"));
    }
    // And it still draws.
    assert!(renderer.picture(&[camera], &appearance, Settings::default()).is_ok());
}

/// A column of 20 million is longer than one binding of a software device. A picture of all of them is more than it can list.
#[test]
#[ignore = "takes a minute and 8 GB"]
fn ten_and_twenty_million_are_drawn_or_refused_in_words() {
    let Some(gpu) = device() else { return };
    let front = camera(600.0, 640, 640);
    for (n, eyes) in [(20_000_000, vec![0.0]), (10_000_000, vec![-0.032, 0.032])] {
        let scene = crowd(n);
        let cameras: Vec<Camera> = eyes.iter().map(|x| eye(&front, *x, 0.0)).collect();
        let mut renderer = Renderer::new(&gpu, &scene).unwrap();
        println!("{n}: {} bytes of columns", renderer.column_bytes());
        let mut look = Appearance::of(&scene);
        let began = std::time::Instant::now();
        match renderer.picture(&cameras, &look, with(Rasterizer::Quads)) {
            Ok((images, drawn)) => {
                println!("{n}: all drawn in {:?}: {drawn:?}", began.elapsed());
                assert!(images.iter().all(|i| i.rgba.iter().all(|x| x.is_finite())));
            }
            Err(error) => {
                println!("{error}");
                assert!(matches!(error, GpuError::TooMany { .. }), "{error}");
            }
        }
        look.clips = vec![Clip::plane(DVec3::new(0.3, 0.0, 0.0), DVec3::X)];
        let mut renderer = Renderer::new(&gpu, &scene).unwrap();
        let (images, drawn) = renderer.picture(&cameras, &look, Settings::default()).unwrap();
        println!("{n}: a part: {drawn:?}");
        for (camera, image) in cameras.iter().zip(&images) {
            let want = render(&scene, &look, camera, Standard).unwrap().image;
            println!("{n}: {:.1} dB from the cores' picture", decibel(image, &want));
            assert!(decibel(image, &want) > 60.0);
        }
    }
}

/// Of Gaussians that rays evaluate a device holds a limited number. More are an error, as other limits are.
#[test]
fn more_gaussians_near_the_eye_than_fit_are_refused_in_words() {
    let Some(gpu) = device() else { return };
    let mut scene = crowd((1 << 20) + 5000);
    let g = &mut scene.units[0].gaussians;
    g.log_scale.fill(Vec3::splat(-1.0));
    g.opacity_logit.fill(3.0);
    let mut look = Appearance::of(&scene);
    let view = [camera(16.0, 16, 16)];
    let mut renderer = Renderer::new(&gpu, &scene).unwrap();
    let error = renderer.picture(&view, &look, Settings::default()).unwrap_err();
    println!("{error}");
    assert!(matches!(error, GpuError::TooManyNear { capacity: 0x10_0000, .. }), "{error}");
    // A part fits, and all of it is counted.
    let mask = Arc::new(Mask::from_fn(scene.len(), |i| i % 2 == 0));
    look.units = vec![UnitAppearance { mask, color: None, opacity: 1.0, visible: false, tone: Tone::NEUTRAL }];
    let (images, drawn) = renderer.picture(&view, &look, Settings::default()).unwrap();
    assert!(drawn.by_rays > 500_000 && drawn.by_rays == drawn.listed, "{drawn:?}");
    let want = render(&scene, &look, &view[0], Standard).unwrap().image;
    assert!(decibel(&images[0], &want) > 60.0);
}

/// A software device leaves a loop after 65,535 rounds: a tile with a longer list is blended in stretches.
#[test]
fn a_hundred_thousand_layers_are_all_blended() {
    let Some(gpu) = device() else { return };
    let mut scene = crowd(100_000);
    let g = &mut scene.units[0].gaussians;
    for (k, p) in g.position.iter_mut().enumerate() {
        *p = Vec3::new(0.0, 0.0, 2.0 + 1e-5 * k as f32);
    }
    // Fainter in all than any level stops at, and the farthest fifth widest.
    g.opacity_logit.fill(-11.0);
    g.log_scale.iter_mut().skip(80_000).for_each(|s| *s = Vec3::splat(-1.5));
    let look = Appearance::of(&scene);
    let view = [camera(60.0, 16, 16)];
    let mut renderer = Renderer::new(&gpu, &scene).unwrap();
    let want = render(&scene, &look, &view[0], Exact).unwrap().image;
    for rasterizer in Rasterizer::ALL {
        let (images, _) = renderer.picture(&view, &look, with(rasterizer)).unwrap();
        println!("{rasterizer:?}: {:.1} dB", decibel(&images[0], &want));
        assert!(decibel(&images[0], &want) > 50.0);
    }
}
