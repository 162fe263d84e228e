//! The effects of units, masks, lights and transforms on a picture.

use std::sync::Arc;

use glam::{DMat4, DQuat, DVec3, Vec3};
use sg_raster::render::Quality::{Exact, Fast, Standard};
use sg_raster::render::{Options, Projection, RenderError, render};
use sg_scene::appearance::{Appearance, Clip, Overlay, PixelFilter, ShadingTerm, UnitAppearance};
use sg_scene::camera::{Camera, LightMode};
use sg_scene::mask::Mask;
use sg_scene::model::{Harmonics, Scene, ShadingModel};
use sg_scene::tone::Tone;

use crate::scenes::{Blob, camera, logit, scene, unit};

/// One Gaussian in the middle of the picture, with all shading attributes, α = 0.5 there.
fn lit(model: ShadingModel) -> Scene {
    let mut one = unit("lit", &[Blob::default()]);
    one.palette = Vec3::new(0.2, 0.3, 0.1);
    one.shading = model;
    let shading = one.gaussians.shading.as_mut().unwrap();
    shading.offset_color = vec![Vec3::new(0.3, 0.1, 0.0)];
    // 60° from the eye's direction −z, towards +x.
    shading.normal = vec![Vec3::new(0.866_025_4, 0.0, -0.5)];
    shading.ambient = vec![0.2];
    shading.diffuse = vec![0.6];
    shading.specular = vec![0.4];
    shading.shininess = vec![2.0];
    Scene::compose(vec![one], None)
}

/// Colour of the Gaussian in the middle pixel: the composite over black divided by α.
fn color(scene: &Scene, appearance: &Appearance) -> [f32; 3] {
    let [r, g, b, a] = middle(scene, appearance);
    [r / a, g / a, b / a]
}

fn middle(scene: &Scene, appearance: &Appearance) -> [f32; 4] {
    let camera = camera(80.0, 33, 33);
    let exact = render(scene, appearance, &camera, Exact).unwrap().image.pixel(16, 16).unwrap();
    for quality in [Standard, Fast] {
        let other = render(scene, appearance, &camera, quality).unwrap().image.pixel(16, 16).unwrap();
        close(&other, &exact);
    }
    exact
}

fn close(got: &[f32], want: &[f32]) {
    assert!(got.iter().zip(want).all(|(g, w)| (g - w).abs() < 2e-6), "{got:?} is not {want:?}");
}

fn edit(mask: &[bool], color: Option<Vec3>, opacity: f32) -> UnitAppearance {
    let mask = Arc::new(Mask::from_fn(mask.len(), |i| mask[i]));
    UnitAppearance { mask, color, opacity, visible: true, tone: Tone::NEUTRAL }
}

#[test]
fn each_model_under_the_headlight() {
    // c_d = (0.5, 0.4, 0.1); n·l = n·h = ½.
    for (model, highlight) in
        [(ShadingModel::Paper, 0.1), (ShadingModel::IvrgsTrain, 0.1), (ShadingModel::IvrgsViewer, 0.06)]
    {
        let scene = lit(model);
        let want = [0.5, 0.4, 0.1].map(|c| (0.2 + 0.6 * 0.5) * c + highlight);
        close(&color(&scene, &Appearance::of(&scene)), &want);
    }
}

#[test]
fn a_directional_light_and_its_multipliers() {
    let scene = lit(ShadingModel::Paper);
    let mut appearance = Appearance::of(&scene);
    appearance.light.mode = LightMode::Direction;
    // Any length; along the normal, so n·l = 1, and h lies 30° from n.
    appearance.light.direction = [1.732_050_8, 0.0, -1.0];
    close(&color(&scene, &appearance), &[0.5, 0.4, 0.1].map(|c| 0.8 * c + 0.4 * 0.75));
    // Scene light times base unit: ka·0.5·4, kd·2·0.25, ks·0.5·0.5, β·2·0.5.
    (appearance.light.ka, appearance.light.kd, appearance.light.ks, appearance.light.shininess) = (0.5, 2.0, 0.5, 2.0);
    appearance.base[0].multipliers = [4.0, 0.25, 0.5, 0.5];
    close(&color(&scene, &appearance), &[0.5, 0.4, 0.1].map(|c| (0.4 + 0.3) * c + 0.1 * 0.75));
    // From behind: nothing diffuse; h = (l + v)/|l + v| has n·h = (−1 + ½)/|…| < 0.
    appearance.light.direction = [-1.732_050_8, 0.0, 1.0];
    close(&color(&scene, &appearance), &[0.5, 0.4, 0.1].map(|c| 0.4 * c));
}

#[test]
fn terms_alone() {
    let scene = lit(ShadingModel::Paper);
    let mut appearance = Appearance::of(&scene);
    for (term, want) in [
        (ShadingTerm::Ambient, [0.1, 0.08, 0.02]),
        (ShadingTerm::Diffuse, [0.15, 0.12, 0.03]),
        (ShadingTerm::Specular, [0.1; 3]),
        (ShadingTerm::Normal, [0.933_012_7, 0.5, 0.25]),
    ] {
        appearance.term = term;
        close(&color(&scene, &appearance), &want);
    }
}

#[test]
fn a_units_colour_replaces_the_diffuse_colour_and_the_latest_saved_wins() {
    let scene = lit(ShadingModel::Paper);
    let mut appearance = Appearance::of(&scene);
    let lit_color = |c: [f32; 3]| c.map(|c| 0.5 * c + 0.1);
    // Its own colour is 1.51 times as bright as the palette's, and a factor of 3/2 is the most that stays.
    let blue = lit_color([0.0, 0.0, 1.5]);
    appearance.units = vec![edit(&[true], Some(Vec3::X), 1.0), edit(&[true], Some(Vec3::Z), 1.0)];
    close(&color(&scene, &appearance), &blue);
    appearance.units.push(edit(&[true], None, 1.0));
    close(&color(&scene, &appearance), &blue);
    appearance.units.push(edit(&[false], Some(Vec3::Y), 0.0));
    close(&color(&scene, &appearance), &blue);
    // With a palette as bright as it is, it takes the colour itself.
    appearance.base[0].palette = Vec3::new(0.5, 0.4, 0.1);
    let mut scene = scene;
    scene.units[0].gaussians.shading.as_mut().unwrap().offset_color = vec![Vec3::ZERO];
    close(&color(&scene, &appearance), &lit_color([0.0, 0.0, 1.0]));
}

#[test]
fn occlusion_takes_from_the_ambient_term_alone() {
    let scene = lit(ShadingModel::Paper);
    let mut appearance = Appearance::of(&scene);
    let open = color(&scene, &appearance);
    appearance.occlusion = Some(Arc::new([1.0]));
    assert_eq!(color(&scene, &appearance), open, "a factor of 1 changes nothing");
    appearance.occlusion = Some(Arc::new([0.25]));
    // ka is 0.2.
    close(&color(&scene, &appearance), &[0.5, 0.4, 0.1].map(|c| (0.05 + 0.6 * 0.5) * c + 0.1));
    for term in [ShadingTerm::Diffuse, ShadingTerm::Specular, ShadingTerm::Normal] {
        let alone = |occlusion| color(&scene, &Appearance { term, occlusion, ..Appearance::of(&scene) });
        assert_eq!(alone(None), alone(Some(Arc::new([0.25]))), "{term:?}");
    }
    appearance.occlusion = Some(Arc::new([0.25; 2]));
    let error = render(&scene, &appearance, &camera(80.0, 9, 9), Exact).unwrap_err();
    assert!(matches!(error, RenderError::Occlusion { found: 2, expected: 1 }), "{error}");
}

#[test]
fn opacities_multiply_and_are_clamped() {
    let scene = lit(ShadingModel::Paper);
    let alpha = |base: f32, units: &[f32]| {
        let mut appearance = Appearance::of(&scene);
        appearance.base[0].opacity = base;
        appearance.units = units.iter().map(|o| edit(&[true], None, *o)).collect();
        middle(&scene, &appearance)[3]
    };
    close(&[alpha(1.0, &[0.5, 0.5])], &[0.125]);
    close(&[alpha(0.5, &[1.5])], &[0.375]);
    close(&[alpha(4.0, &[])], &[1.0]);
    // Clamped once, after all factors.
    close(&[alpha(4.0, &[0.25])], &[0.5]);
    close(&[alpha(1.0, &[0.0])], &[0.0]);
}

#[test]
fn hidden_units_draw_nothing() {
    let scene = lit(ShadingModel::Paper);
    let mut appearance = Appearance::of(&scene);
    appearance.units = vec![UnitAppearance { visible: false, ..edit(&[true], None, 1.0) }, edit(&[true], None, 1.0)];
    assert_eq!(middle(&scene, &appearance), [0.0; 4]);
    appearance.units.clear();
    appearance.base[0].visible = false;
    assert_eq!(middle(&scene, &appearance), [0.0; 4]);
    let report = render(&scene, &appearance, &camera(80.0, 9, 9), Exact).unwrap().report;
    assert_eq!((report.hidden, report.drawn), (1, 0));
}

#[test]
fn the_overlay_comes_after_shading() {
    let scene = lit(ShadingModel::Paper);
    let mut appearance = Appearance::of(&scene);
    let plain = color(&scene, &appearance);
    let overlay = |selected: bool, mix: f32, opacity: f32| {
        Some(Overlay { mask: Arc::new(Mask::from_fn(1, |_| selected)), color: Vec3::new(0.0, 1.0, 0.5), mix, opacity })
    };
    appearance.overlay = overlay(true, 0.25, 1.0);
    let want = [0.75 * plain[0], 0.75 * plain[1] + 0.25, 0.75 * plain[2] + 0.125];
    close(&color(&scene, &appearance), &want);
    appearance.overlay = overlay(true, 0.0, 3.0);
    close(&middle(&scene, &appearance)[3..], &[1.0]);
    appearance.overlay = overlay(true, 0.0, 0.5);
    close(&middle(&scene, &appearance)[3..], &[0.25]);
    appearance.overlay = overlay(false, 1.0, 0.0);
    close(&color(&scene, &appearance), &plain);
}

#[test]
fn clips_hide_gaussians_outside() {
    // All planes are more than three standard deviations away.
    let at = |x: f32, z: f32| Blob { position: Vec3::new(x, 0.0, z), log_scale: Vec3::splat(-4.0), ..Blob::default() };
    let row = [at(-0.5, 2.0), at(0.0, 2.0), at(0.5, 2.0), at(0.5, 4.0)];
    let scene = scene(&row);
    let camera = camera(20.0, 33, 33);
    let through = |blobs: &[Blob]| {
        let kept = crate::scenes::scene(blobs);
        render(&kept, &Appearance::of(&kept), &camera, Exact).unwrap().image
    };
    let plane = |x: f64, normal: f64| Clip::plane(DVec3::new(x, 9.0, -7.0), DVec3::new(normal, 0.0, 0.0));
    let box_of = |inside| Clip::between(DVec3::new(-0.6, -1.0, 1.0), DVec3::new(0.1, 1.0, 3.0), inside);
    for (clips, kept) in [
        (vec![plane(0.25, 1.0)], vec![2, 3]),
        (vec![plane(0.25, -30.0)], vec![0, 1]),
        (vec![plane(-0.25, 1.0), plane(0.25, -1.0)], vec![1]),
        (vec![box_of(true)], vec![0, 1]),
        (vec![box_of(false)], vec![2, 3]),
        (vec![box_of(true), plane(-0.25, 1.0)], vec![1]),
        (vec![box_of(true), box_of(false)], vec![]),
    ] {
        let mut appearance = Appearance::of(&scene);
        appearance.clips = clips;
        for quality in [Exact, Standard, Fast] {
            let drawn = render(&scene, &appearance, &camera, quality).unwrap();
            assert_eq!(
                (drawn.report.clipped, drawn.report.drawn),
                (4 - kept.len(), kept.len()),
                "{quality:?} {kept:?}"
            );
        }
        let blobs: Vec<Blob> = kept.iter().map(|k| row[*k]).collect();
        assert_eq!(render(&scene, &appearance, &camera, Exact).unwrap().image, through(&blobs), "{kept:?}");
    }
    // Hidden Gaussians are counted as hidden.
    let mut appearance = Appearance::of(&scene);
    appearance.clips = vec![plane(0.25, 1.0)];
    appearance.units = vec![UnitAppearance { visible: false, ..edit(&[true, false, true, false], None, 1.0) }];
    let report = render(&scene, &appearance, &camera, Exact).unwrap().report;
    assert_eq!((report.hidden, report.clipped, report.drawn), (1, 2, 1));
}

/// The kept part of a faint Gaussian, by the optical depth of the picture: that of the whole times the share of its mass.
#[test]
fn clips_cut_gaussians() {
    // Far away, so that the perspective within the Gaussian does not count.
    let scene = scene(&[Blob { position: Vec3::new(0.0, 0.0, 40.0), logit: logit(0.02), ..Blob::default() }]);
    let camera = camera(2000.0, 65, 65);
    let depth = |clips: &[Clip]| {
        let appearance = Appearance { clips: clips.to_vec(), ..Appearance::of(&scene) };
        let image = render(&scene, &appearance, &camera, Exact).unwrap().image;
        image.as_pixels().iter().map(|[_, _, _, a]| -f64::from(-a).ln_1p()).sum::<f64>()
    };
    let at = |x: f64, z: f64, normal: DVec3| Clip::plane(DVec3::new(x, 0.0, z), normal);
    let whole = depth(&[]);
    for (clips, kept, bound) in [
        (vec![at(0.0, 40.0, DVec3::Z)], 0.5, 0.003),
        (vec![at(0.0, 39.9, DVec3::NEG_Z)], 0.1587, 0.003),
        // Beside the eye, the dilation widens the narrower part more.
        (vec![at(0.0, 40.0, DVec3::X)], 0.5, 0.02),
        (vec![at(-0.1, 40.0, DVec3::X)], 0.8413, 0.02),
        (vec![at(0.0, 40.0, DVec3::X), at(0.0, 40.0, DVec3::Z)], 0.25, 0.02),
    ] {
        let found = depth(&clips) / whole;
        assert!((found - kept).abs() < bound, "{clips:?}: {found} for {kept}");
    }
    // The part on the far side is the rest.
    let sides = [DVec3::X, DVec3::NEG_X].map(|normal| depth(&[at(0.07, 40.0, normal)]));
    assert!(((sides[0] + sides[1]) / whole - 1.0).abs() < 0.03, "{sides:?} {whole}");
}

/// Clips are in the scene frame, for any transform of the unit.
#[test]
fn clips_are_in_the_scene_frame() {
    let mut moved = unit("moved", &[Blob::default()]);
    moved.transform = DMat4::from_translation(DVec3::new(3.0, 0.0, 0.0));
    let scene = Scene::compose(vec![moved], None);
    let mut appearance = Appearance::of(&scene);
    let clipped =
        |appearance: &Appearance| render(&scene, appearance, &camera(80.0, 9, 9), Exact).unwrap().report.clipped;
    appearance.clips = vec![Clip::plane(DVec3::new(2.0, 0.0, 0.0), DVec3::X)];
    assert_eq!(clipped(&appearance), 0);
    appearance.clips = vec![Clip::plane(DVec3::new(2.0, 0.0, 0.0), DVec3::NEG_X)];
    assert_eq!(clipped(&appearance), 1);
}

#[test]
fn shown_colours_take_the_place_of_shading() {
    let scene = lit(ShadingModel::Paper);
    let mut appearance = Appearance::of(&scene);
    appearance.colors = Some(Arc::new([Vec3::new(0.25, 0.5, 2.0)]));
    for term in [ShadingTerm::Full, ShadingTerm::Normal, ShadingTerm::Specular] {
        appearance.term = term;
        close(&color(&scene, &appearance), &[0.25, 0.5, 2.0]);
    }
    // A unit's colour is not shown, its opacity is; the overlay lies over all.
    appearance.units = vec![edit(&[true], Some(Vec3::X), 0.5)];
    close(&middle(&scene, &appearance), &[0.0625, 0.125, 0.5, 0.25]);
    let mask = Arc::new(Mask::from_fn(1, |_| true));
    appearance.overlay = Some(Overlay { mask, color: Vec3::ONE, mix: 0.5, opacity: 2.0 });
    close(&color(&scene, &appearance), &[0.625, 0.75, 1.5]);
    close(&middle(&scene, &appearance)[3..], &[0.5]);
    appearance.units = vec![UnitAppearance { visible: false, ..edit(&[true], None, 1.0) }];
    assert_eq!(middle(&scene, &appearance), [0.0; 4]);
    // Gaussians that are not finite are dropped and counted in every look.
    appearance.units.clear();
    appearance.colors = Some(Arc::new([Vec3::new(f32::NAN, 0.0, 0.0)]));
    let report = render(&scene, &appearance, &camera(80.0, 9, 9), Exact).unwrap().report;
    assert_eq!((report.dropped_non_finite, report.drawn), (1, 0));
}

#[test]
fn a_compensated_filter_takes_what_the_dilation_adds() {
    // σ = 0.1 at depth 2 with f = 2: 0.01 px²; √(0.01²/(0.01 + 0.3)²) of the opacity is left.
    let blob = Blob { log_scale: Vec3::splat(0.1_f32.ln()), logit: logit(0.5), ..Blob::default() };
    let mut scene = scene(&[blob]);
    let camera = camera(2.0, 33, 33);
    let alpha = |scene: &Scene, filter, options: Options| {
        let appearance = Appearance { filter, ..Appearance::of(scene) };
        render(scene, &appearance, &camera, options).unwrap().image.pixel(16, 16).unwrap()[3]
    };
    let want = 0.5 * 0.01 / 0.31;
    for quality in [Exact, Standard, Fast] {
        for projection in [Projection::Affine, Projection::PerRay] {
            let alpha =
                |scene: &Scene, filter| alpha(scene, filter, Options { quality, projection, ..Options::default() });
            close(&[alpha(&scene, PixelFilter::Plain)], &[0.5]);
            close(&[alpha(&scene, PixelFilter::FromFile)], &[0.5]);
            close(&[alpha(&scene, PixelFilter::Compensated)], &[want]);
            scene.units[0].gaussians.antialiased = true;
            close(&[alpha(&scene, PixelFilter::FromFile)], &[want]);
            close(&[alpha(&scene, PixelFilter::Plain)], &[0.5]);
            scene.units[0].gaussians.antialiased = false;
        }
    }
    // Of no size, there is nothing to see of it.
    let point = crate::scenes::scene(&[Blob { log_scale: Vec3::splat(f32::NEG_INFINITY), ..blob }]);
    let appearance = Appearance { filter: PixelFilter::Compensated, ..Appearance::of(&point) };
    let report = render(&point, &appearance, &camera, Exact).unwrap().report;
    assert_eq!((report.transparent, report.drawn), (1, 0));
}

#[test]
fn masks_count_through_the_base_units() {
    let left = Blob { position: Vec3::new(-0.5, 0.0, 2.0), color: Vec3::X, ..Blob::default() };
    let right = Blob { position: Vec3::new(0.5, 0.0, 2.0), color: Vec3::X, ..Blob::default() };
    let scene = Scene::compose(vec![unit("a", &[left]), unit("b", &[left, right])], None);
    let mut appearance = Appearance::of(&scene);
    appearance.units = vec![edit(&[false, false, true], Some(Vec3::Z), 1.0)];
    let image = render(&scene, &appearance, &camera(20.0, 33, 33), Exact).unwrap().image;
    let [r, _, b, a] = image.pixel(21, 16).unwrap();
    assert!(b > 0.49 * a && b > 100.0 * r, "the third Gaussian, at the right, is blue");
    let [r, _, b, _] = image.pixel(11, 16).unwrap();
    assert!(r > 100.0 * b);
}

#[test]
fn an_unlit_gaussian_takes_harmonics_or_the_palette() {
    let mut one = unit("plain", &[Blob::default()]);
    one.gaussians.shading = None;
    one.palette = Vec3::new(0.7, 0.6, 0.5);
    let mut scene = Scene::compose(vec![one], None);
    let mut appearance = Appearance::of(&scene);
    appearance.light.ka = 0.0;
    close(&color(&scene, &appearance), &[0.7, 0.6, 0.5]);
    // Seen along +z: the degree-1 term of z, C₁·z.
    let (c0, c1) = (0.282_094_8, 0.488_602_5);
    scene.units[0].gaussians.harmonics = Some(Harmonics {
        degree: 1,
        dc: vec![[1.0, -2.0, 3.0]],
        rest: vec![[9.0, 0.0, 0.0], [0.5, 0.0, -1.0], [0.0, 9.0, 0.0]],
    });
    let [red, blue] = [0.5 + c0 + 0.5 * c1, 0.5 + 3.0 * c0 - c1];
    close(&color(&scene, &appearance), &[red, 0.0, blue]);
    // A unit's colour acts on it as on any other, and its brightness stays.
    appearance.units = vec![edit(&[true], Some(Vec3::new(0.1, 0.2, 0.3)), 1.0)];
    let factor = 0.5 + 0.2126 * red + 0.0722 * blue;
    close(&color(&scene, &appearance), &[0.1, 0.2, 0.3].map(|c| factor * c));
}

/// A scene turned with its camera is the same picture: normals, harmonics and covariances turn along.
#[test]
fn a_transform_moves_everything_it_should() {
    let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -1.1, 2.0);
    let transform = DMat4::from_scale_rotation_translation(DVec3::splat(3.0), turn, DVec3::new(5.0, -7.0, 11.0));
    let blob = Blob { log_scale: Vec3::new(-2.0, -3.0, -4.0), rotation: [0.7, 0.1, -0.5, 0.3], ..Blob::default() };
    let mut lit = lit(ShadingModel::Paper).units.remove(0);
    lit.gaussians.log_scale = vec![blob.log_scale];
    lit.gaussians.rotation = vec![blob.rotation];
    let mut plain = unit("plain", &[Blob { position: Vec3::new(0.3, -0.2, 1.5), ..blob }]);
    plain.gaussians.shading = None;
    plain.gaussians.harmonics = Some(Harmonics {
        degree: 3,
        dc: vec![[0.4, 0.2, 0.1]],
        rest: (0..15).map(|k| [0.03 * k as f32, 0.2 - 0.02 * k as f32, 0.1]).collect(),
    });
    let scene = Scene::compose(vec![lit, plain], None);
    let mut moved = scene.clone();
    for unit in &mut moved.units {
        unit.transform = transform;
    }
    let here = camera(80.0, 65, 49);
    // The camera moves rigidly; a uniform scale about the eye changes no picture.
    let rigid = DMat4::from_rotation_translation(turn, transform.transform_point3(DVec3::ZERO));
    let there = Camera { world_to_camera: (here.view() * rigid.inverse()).transpose().to_cols_array(), ..here.clone() };
    let mut appearance = Appearance::of(&scene);
    appearance.light.mode = LightMode::Direction;
    let light = DVec3::new(0.3, -0.5, -1.0);
    for quality in [Exact, Standard] {
        appearance.light.direction = light.as_vec3().to_array();
        let a = render(&scene, &appearance, &here, quality).unwrap().image;
        appearance.light.direction = (turn * light).as_vec3().to_array();
        let b = render(&moved, &appearance, &there, quality).unwrap().image;
        let worst = crate::oracle::distance(&a, &b);
        assert!(worst < 3e-6, "{quality:?}: {worst}");
        assert!(a.rgba.iter().any(|x| *x > 0.2));
    }
}

#[test]
fn parts_that_do_not_belong_together_are_refused() {
    let scene = scene(&[Blob { logit: logit(0.5), ..Blob::default() }]);
    let camera = camera(80.0, 9, 9);
    let mut appearance = Appearance::of(&scene);
    appearance.units = vec![edit(&[true, false], None, 1.0)];
    let error = render(&scene, &appearance, &camera, Exact).unwrap_err();
    assert!(matches!(error, RenderError::Mask { found: 2, expected: 1, .. }), "{error}");
    appearance.units.clear();
    appearance.base.clear();
    assert!(matches!(render(&scene, &appearance, &camera, Exact), Err(RenderError::BaseUnits { .. })));
    let mut appearance = Appearance::of(&scene);
    appearance.colors = Some(Arc::new([Vec3::ONE; 3]));
    let error = render(&scene, &appearance, &camera, Exact).unwrap_err();
    assert!(matches!(error, RenderError::Colors { found: 3, expected: 1 }), "{error}");
    appearance.colors = None;
    for normal in [DVec3::ZERO, DVec3::new(f64::NAN, 0.0, 1.0)] {
        appearance.clips = vec![Clip::plane(DVec3::ZERO, DVec3::X), Clip::plane(DVec3::ZERO, normal)];
        let error = render(&scene, &appearance, &camera, Exact).unwrap_err();
        assert!(matches!(error, RenderError::Clip { index: 1 }), "{error}");
    }
    appearance.clips.clear();
    let broken = Camera { fx: f64::NAN, ..camera.clone() };
    assert!(matches!(render(&scene, &appearance, &broken, Exact), Err(RenderError::Camera(_))));
    let mut short = scene.clone();
    short.units[0].gaussians.rotation.clear();
    let error = render(&short, &appearance, &camera, Exact).unwrap_err();
    assert_eq!(error.to_string(), "base unit `blobs`: column `rotation` has 0 values for 1 Gaussians");
}
