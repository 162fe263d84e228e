//! Scenes with their edits.

use std::sync::Arc;

use glam::{DMat4, DVec3, Vec3};
use sg_proto::scene::SetTone;
use sg_proto::scene::command::Action;
use sg_scene::mask::Mask;
use sg_scene::model::{BaseUnit, Harmonics, Scene, ShadingModel};
use sg_scene::recolor::{recolored, recolored_unlit};
use sg_scene::synthetic::{samples, test_scene};
use sg_scene::tone::Tone;

use super::{BLUE, RED, color, commit, editor, opacity, run, save, selection, units, visible};
use crate::{EditError, EditState, Editor, Part};

fn names(scene: &Scene) -> Vec<(&str, usize)> {
    scene.units.iter().map(|u| (u.name.as_str(), u.gaussians.len())).collect()
}

/// Diffuse colour and opacity of a Gaussian as they are drawn, by the rules of the rasterizer.
fn drawn(state: &EditState, scene: &Scene, i: usize) -> (DVec3, f64) {
    let look = state.appearance();
    let (unit, local) = scene.locate(i).unwrap();
    let at = scene.units.iter().position(|u| u.first == unit.first && !u.gaussians.is_empty()).unwrap();
    let (palette, mut factor) = (look.base[at].palette.as_dvec3(), f64::from(look.base[at].opacity));
    let mut seen = palette;
    if let Some(columns) = &unit.gaussians.shading {
        seen += columns.offset_color[local].as_dvec3();
    }
    let mut given = None;
    for edit in look.units.iter().filter(|u| u.mask.get(i)) {
        factor *= f64::from(edit.opacity);
        given = edit.color.or(given);
    }
    let seen = given.map_or(seen, |given| recolored(given.as_dvec3(), seen, palette));
    let tone = look.units.iter().filter(|u| u.mask.get(i)).fold(Tone::NEUTRAL, |all, u| all.and(u.tone));
    let seen = tone.of(seen);
    (seen, (factor * f64::from(unit.gaussians.opacity(local))).clamp(0.0, 1.0))
}

fn tone(name: &str, saturation: f32, temperature: f32) -> Action {
    let (saturation, temperature) = (Some(saturation), Some(temperature));
    let target = Some(units(&[name]));
    Action::SetTone(SetTone { target, saturation, temperature, brightness: Some(0.8), relative: false })
}

#[test]
fn parts_of_different_looks_become_units_that_look_the_same() {
    let bone = samples::unit("bone", samples::editable_columns(40, 1));
    let skin = samples::unit("skin", samples::editable_columns(20, 2));
    let scene = Arc::new(Scene::compose(vec![bone, skin], None));
    let mut editor = Editor::new(Arc::clone(&scene), EditState::of_scene(&scene, "scene.toml", "hash"));
    run(
        &mut editor,
        [
            color(units(&["skin"]), BLUE),
            commit(|i| (10..50).contains(&i)),
            save("sac"),
            color(units(&["sac"]), RED),
            opacity(units(&["sac"]), 0.25),
            opacity(units(&["bone"]), 3.0),
            tone("bone", 0.25, 0.5),
            tone("sac", 2.0, -0.25),
        ],
    );
    let state = editor.state();
    let all = state.edited(&scene, &state.part(Part::Everything).unwrap()).unwrap();
    assert_eq!(names(&all), [("bone", 10), ("sac", 30), ("skin", 10), ("sac 2", 10)]);
    assert_eq!(all.bounds, scene.bounds);
    // The new order: bone, sac's part of bone, the rest of skin, sac's part of skin.
    let order: Vec<usize> = (0..10).chain(10..40).chain(50..60).chain(40..50).collect();
    let after = EditState::of_scene(&all, "", "");
    for (new, old) in order.into_iter().enumerate() {
        let ((want, o), (got, p)) = (drawn(state, &scene, old), drawn(&after, &all, new));
        assert!((want - got).length() < 1e-6, "{old}: {want} became {got}");
        assert!((o - p).abs() < 1e-6, "{old}: opacity {o} became {p}");
        assert_eq!(scene.position(old), all.position(new));
    }
}

#[test]
fn a_part_has_its_members_and_their_box() {
    let mut editor = editor();
    run(
        &mut editor,
        [
            commit(|i| (5..25).contains(&i)),
            save("sac"),
            visible(units(&["skin"]), false),
            opacity(units(&["Vessel"]), 0.0),
        ],
    );
    let scene = test_scene(&[("bone", 20), ("skin", 15), ("Vessel", 25)]);
    let state = editor.state();
    let count = |part| state.part(part).map(|mask| mask.count());
    assert_eq!((count(Part::Everything), count(Part::Visible)), (Ok(60), Ok(20)));
    assert_eq!((count(Part::Selection), count(Part::Unit("SAC")), count(Part::Unit("skin"))), (Ok(20), Ok(20), Ok(15)));
    assert!(matches!(count(Part::Unit("sack")), Err(EditError::UnknownUnit { near, .. }) if near == ["sac"]));
    let sac = state.edited(&scene, &state.part(Part::Unit("sac")).unwrap()).unwrap();
    assert_eq!(names(&sac), [("sac", 15), ("sac 2", 5)]);
    let centers: Vec<_> = (5..25).map(|i| scene.position(i).unwrap()).collect();
    assert_eq!(sac.bounds.min, centers.iter().copied().reduce(DVec3::min).unwrap());
    assert_eq!(sac.bounds.max, centers.iter().copied().reduce(DVec3::max).unwrap());

    run(&mut editor, [commit(|_| false)]);
    assert_eq!(editor.state().part(Part::Selection), Err(EditError::NothingSelected));
    run(&mut editor, [visible(units(&["bone"]), false)]);
    assert_eq!(editor.state().part(Part::Visible), Err(EditError::EmptyTarget("the visible part".to_owned())));
}

#[test]
fn trained_splats_keep_their_views_under_a_colour() {
    let mut splat = samples::unit("donut", samples::harmonic(60, 2, 3));
    splat.transform = DMat4::from_translation(DVec3::X);
    splat.shading = ShadingModel::Paper;
    // Colours between the bounds of recolouring.
    for term in splat.gaussians.harmonics.iter_mut().flat_map(|h| h.dc.iter_mut().chain(&mut h.rest)) {
        *term = term.map(|x| 0.1 * x);
    }
    let scene = Arc::new(Scene::compose(vec![splat], None));
    let mut editor = Editor::new(Arc::clone(&scene), EditState::of_scene(&scene, "donut.ply", "hash"));
    run(&mut editor, [commit(|i| i >= 20), color(selection(), RED)]);
    let state = editor.state();
    let edited = state.edited(&scene, &Mask::full(60)).unwrap();
    assert_eq!(names(&edited), [("donut", 20), ("donut 2", 40)]);
    // The palette of the unit does the same to the others.
    let mut tinted = Editor::new(Arc::clone(&scene), EditState::of_scene(&scene, "donut.ply", "hash"));
    run(&mut tinted, [color(units(&["donut"]), BLUE), commit(|i| i >= 20), color(selection(), RED)]);
    let both = tinted.state().edited(&scene, &Mask::full(60)).unwrap();
    let [first, second] = both.units.as_slice() else { panic!("{:?}", names(&both)) };
    assert_eq!((first.palette, second.palette), (Vec3::Z, Vec3::X));
    assert_eq!(second.gaussians.harmonics, edited.units[1].gaussians.harmonics);
    let reds = |unit: &BaseUnit| unit.gaussians.harmonics.as_ref().unwrap().rest.iter().any(|c| c[0] != 0.0);
    assert!(!reds(first) && reds(second));
    let before = scene.units[0].gaussians.harmonics.as_ref().unwrap();
    let after = edited.units[1].gaussians.harmonics.as_ref().unwrap();
    assert_eq!(edited.units[0].gaussians.harmonics.as_ref().unwrap().dc[..20], before.dc[..20]);
    // Two values of each basis function stand for all directions: the sum is linear in them.
    for basis in [[0.4_f64; 8], [-0.3; 8], [0.1, -0.2, 0.3, 0.0, 0.5, -0.5, 0.2, -0.1]] {
        let seen = |h: &Harmonics, i: usize| {
            let vector = |c: [f32; 3]| DVec3::from_array(c.map(f64::from));
            let rest = h.rest[i * 8..][..8].iter().zip(basis).map(|(term, b)| b * vector(*term)).sum::<DVec3>();
            DVec3::splat(0.5) + Harmonics::C0 * vector(h.dc[i]) + rest
        };
        for i in 0..40 {
            let want = recolored_unlit(Vec3::new(1.0, 0.0, 0.0).as_dvec3(), seen(before, 20 + i));
            let got = seen(after, i);
            assert!((want - got).length() < 1e-6, "{i}: {want} became {got}");
        }
    }
}

#[test]
fn trained_splats_keep_their_views_under_a_tone() {
    let mut splat = samples::unit("donut", samples::harmonic(30, 2, 3));
    for term in splat.gaussians.harmonics.iter_mut().flat_map(|h| h.dc.iter_mut().chain(&mut h.rest)) {
        *term = term.map(|x| 0.1 * x);
    }
    let scene = Arc::new(Scene::compose(vec![splat], None));
    let mut editor = Editor::new(Arc::clone(&scene), EditState::of_scene(&scene, "donut.ply", "hash"));
    run(&mut editor, [tone("donut", 0.25, 0.5)]);
    let edited = editor.state().edited(&scene, &Mask::full(30)).unwrap();
    let change = Tone { saturation: 0.25, brightness: 0.8, temperature: 0.5 };
    let [before, after] = [&scene, &edited].map(|s| s.units[0].gaussians.harmonics.as_ref().unwrap());
    for basis in [[0.4_f64; 8], [-0.3; 8], [0.1, -0.2, 0.3, 0.0, 0.5, -0.5, 0.2, -0.1]] {
        let seen = |h: &Harmonics, i: usize| {
            let vector = |c: [f32; 3]| DVec3::from_array(c.map(f64::from));
            let rest = h.rest[i * 8..][..8].iter().zip(basis).map(|(term, b)| b * vector(*term)).sum::<DVec3>();
            DVec3::splat(0.5) + Harmonics::C0 * vector(h.dc[i]) + rest
        };
        for i in 0..30 {
            let (want, got) = (change.of(seen(before, i)), seen(after, i));
            assert!((want - got).length() < 1e-6, "{i}: {want} became {got}");
        }
    }
}
