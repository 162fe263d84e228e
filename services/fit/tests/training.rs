//! Training on pictures of a volume: gains, determinism, single base units, and bad input.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test that cannot be set up fails")]

use std::ops::ControlFlow;

use sg_fit::training::{
    TrainingError, TrainingOptions, TrainingReport, TrainingView, ViewOptions, train, volume_views,
};
use sg_fit::{Options, direct_start};
use sg_raster::image::Image;
use sg_raster::volume::march;
use sg_scene::camera::LightMode;
use sg_scene::model::Scene;
use sg_volume::dvr::RayMarcher;
use sg_volume::phantom::{VesselTree, transfer_function};
use sg_volume::transfer::BaseUnitRange;
use sg_volume::{Field, TransferFunction};

const VIEWS: ViewOptions = ViewOptions { views: 16, held_out: 4, size: 96, seed: 3 };

fn phantom() -> Field {
    VesselTree::new().rasterize(48, 2).unwrap().volume().unwrap().to_field()
}

fn started(
    field: &Field,
    function: &TransferFunction,
    gaussians: usize,
) -> (Scene, Vec<TrainingView>, Vec<TrainingView>) {
    let options = Options { gaussians, ..Options::default() };
    let scene = direct_start(field, function, &options, |_| {}).unwrap().scene;
    let classifier = function.classifier(field.range()).unwrap();
    let (views, held_out) = volume_views(field, &classifier, &VIEWS, |_, _| {});
    (scene, views, held_out)
}

fn trained(scene: &mut Scene, views: &[TrainingView], held_out: &[TrainingView], iterations: usize) -> TrainingReport {
    let options = TrainingOptions { iterations, measure_every: 40, ..TrainingOptions::default() };
    train(scene, views, held_out, &options, |_, _| ControlFlow::Continue(())).unwrap()
}

#[test]
fn training_makes_held_out_pictures_better() {
    let field = phantom();
    let (mut scene, views, held_out) = started(&field, &transfer_function(), 1200);
    let start = scene.clone();
    let report = trained(&mut scene, &views, &held_out, 240);
    let (first, result) = (report.measurements[0], report.result);
    assert!(result.footprint_psnr_db > first.footprint_psnr_db + 2.0, "{first:?} {result:?}");
    assert!(result.ssim > first.ssim, "{first:?} {result:?}");
    assert_eq!((scene.len(), scene.bounds), (start.len(), start.bounds));
    for (unit, before) in scene.units.iter().zip(&start.units) {
        let (gaussians, shading) = (&unit.gaussians, unit.gaussians.shading.as_ref().unwrap());
        assert_eq!(unit.palette, before.palette, "the palette is the person's");
        for i in 0..gaussians.len() {
            let color = unit.palette + shading.offset_color[i];
            assert!(color.min_element() > -1e-5 && color.max_element() < 1.0 + 1e-5, "{color}");
            assert!(gaussians.position[i].is_finite() && gaussians.log_scale[i].is_finite());
            let normal = shading.normal[i].length();
            assert!(normal == 0.0 || (normal - 1.0).abs() < 1e-4, "{normal}");
            assert!(shading.ambient[i] >= 0.0 && shading.diffuse[i] >= 0.0 && shading.specular[i] >= 0.0);
            assert!((1.0..200.5).contains(&shading.shininess[i]), "{}", shading.shininess[i]);
        }
    }
}

#[test]
fn a_run_of_steps_gives_one_scene_on_any_number_of_threads() {
    let field = phantom();
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let (mut scene, views, held_out) = started(&field, &transfer_function(), 600);
            trained(&mut scene, &views, &held_out, 40);
            scene
        })
    };
    assert_eq!(with(1), with(3));
}

#[test]
fn views_show_edits_and_other_lights_too() {
    let field = phantom();
    let mut function = transfer_function();
    let [low, high] = function.domain;
    let border = 0.6 * (high - low) + low;
    function.base_units = vec![
        BaseUnitRange { name: "faint".to_owned(), range: [low, border] },
        BaseUnitRange { name: "bright".to_owned(), range: [border, high] },
    ];
    let (scene, views, held_out) = started(&field, &function, 800);
    let of = |opacities: &[f32]| views.iter().filter(|view| view.opacities == opacities).count();
    assert_eq!([of(&[]), of(&[1.0, 0.0]), of(&[0.0, 1.0]), of(&[0.2, 1.0]), of(&[1.0, 0.2])], [10, 2, 2, 1, 1]);
    let is_clipped = |view: &&TrainingView| !view.clips.is_empty();
    assert_eq!(views.iter().filter(is_clipped).filter(|view| view.opacities.is_empty()).count(), 2);
    assert_eq!(views.iter().filter(is_clipped).count(), 2);
    assert_eq!(views.iter().filter(|view| view.camera.light.mode == LightMode::Direction).count(), 5);
    assert_eq!(views.iter().filter(|view| view.camera.background == [1.0; 3]).count(), 6);
    let is_plain = |view: &TrainingView| view.opacities.is_empty() && view.clips.is_empty();
    assert!(held_out.iter().all(|view| is_plain(view) && view.camera.light.mode == LightMode::Headlight));
    let alone = views.iter().find(|view| view.opacities == [1.0, 0.0]).unwrap();
    let appearance = alone.appearance(&scene);
    assert_eq!(appearance.base.iter().map(|base| base.visible).collect::<Vec<_>>(), [true, false]);
    // The references show the edits. What they leave covers no more than the whole.
    let coverage = |picture: &Image| picture.pixels().map(|pixel| f64::from(pixel[3])).sum::<f64>();
    let marcher = RayMarcher::new(&field, function.classifier(field.range()).unwrap(), 0.5);
    for view in views.iter().filter(|view| !is_plain(view)) {
        let whole = march(&marcher, &view.camera);
        assert!(coverage(&view.reference) > 0.0, "{:?} {:?}", view.opacities, view.clips);
        assert!(coverage(&view.reference) < coverage(&whole) + 1.0, "{:?} {:?}", view.opacities, view.clips);
        let change = whole.rgba.iter().zip(&view.reference.rgba).map(|(a, b)| f64::from((a - b).abs())).sum::<f64>();
        assert!(change > 1.0, "{change} {:?} {:?}", view.opacities, view.clips);
    }
}

#[test]
fn a_run_ends_at_its_target_or_when_it_is_told_to() {
    let field = phantom();
    let (mut scene, views, held_out) = started(&field, &transfer_function(), 600);
    let start = scene.clone();
    let options =
        TrainingOptions { iterations: 400, measure_every: 20, target_psnr_db: Some(1.0), ..TrainingOptions::default() };
    let report = train(&mut scene, &views, &held_out, &options, |_, _| ControlFlow::Continue(())).unwrap();
    assert_eq!(report.iterations, 20);
    let mut scene = start.clone();
    let report = train(&mut scene, &views, &held_out, &options, |_, _| ControlFlow::Break(())).unwrap();
    assert_eq!((report.iterations, report.measurements.len()), (0, 1));
    assert_eq!(scene, start);
}

#[test]
fn what_cannot_be_trained_on_is_refused_and_changes_nothing() {
    let field = phantom();
    let (mut scene, views, held_out) = started(&field, &transfer_function(), 300);
    let start = scene.clone();
    let options = TrainingOptions { iterations: 10, ..TrainingOptions::default() };
    let mut run = |views: &[TrainingView], held_out: &[TrainingView]| {
        let refused = train(&mut scene, views, held_out, &options, |_, _| ControlFlow::Continue(())).unwrap_err();
        assert_eq!(scene, start);
        refused
    };
    assert!(matches!(run(&[], &held_out), TrainingError::NoView));
    assert!(matches!(run(&views, &[]), TrainingError::NoView));
    let mut broken = views.clone();
    broken[2].reference.rgba[7] = f32::NAN;
    assert!(matches!(run(&broken, &held_out), TrainingError::NotFinite(2)));
    let mut small = held_out.clone();
    small[1].camera.width = 50;
    assert!(matches!(run(&views, &small), TrainingError::Size { index: 17, .. }));
}
