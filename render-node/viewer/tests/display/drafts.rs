//! Changes that are still being made.

use std::sync::Arc;

use glam::Vec3;
use sg_edit::EditState;
use sg_proto::scene::{Color, SetColor, SetOpacity, Target, command::Action};
use sg_scene::model::Scene;
use sg_viewer::display::Drafts;

use crate::brush::row_of_gaussians;

fn opacity(factor: f32) -> Action {
    let target = Some(Target { units: vec!["row".to_owned()], ..Target::default() });
    Action::SetOpacity(SetOpacity { target, factor, relative: false })
}

fn opened(scene: &Scene) -> Arc<EditState> {
    Arc::new(EditState::of_scene(scene, "scene.ply", "hash"))
}

#[test]
fn a_draft_changes_the_picture_and_not_the_state() {
    let scene = Arc::new(row_of_gaussians(6));
    let state = opened(&scene);
    let mut drafts = Drafts::default();
    assert!(Arc::ptr_eq(&drafts.over(&scene, &state), &state), "nothing is copied without one");
    drafts.hold(opacity(0.25));
    let seen = drafts.over(&scene, &state);
    assert_eq!(seen.appearance().base[0].opacity, 0.25);
    assert_eq!(state.appearance().base[0].opacity, 1.0);
    assert!(Arc::ptr_eq(&drafts.over(&scene, &state), &seen), "made once for each state");
    drafts.hold(opacity(0.5));
    assert_eq!(drafts.over(&scene, &state).appearance().base[0].opacity, 0.5);
}

#[test]
fn a_requested_draft_stays_until_the_next_scene_event() {
    let scene = Arc::new(row_of_gaussians(6));
    let state = opened(&scene);
    let mut drafts = Drafts::default();
    drafts.release(opacity(0.25), state.revision());
    assert_eq!(drafts.over(&scene, &state).appearance().base[0].opacity, 0.25);
    let newer = Arc::new(state.after(&scene, opacity(0.75)).unwrap());
    assert_eq!(drafts.over(&scene, &newer).appearance().base[0].opacity, 0.75, "the scene's word counts");
    assert!(drafts.is_empty());
}

#[test]
fn a_draft_that_the_scene_would_refuse_shows_nothing() {
    let scene = Arc::new(row_of_gaussians(6));
    let state = opened(&scene);
    let mut drafts = Drafts::default();
    for bad in [opacity(-1.0), opacity(f32::NAN)] {
        drafts.hold(bad);
        assert_eq!(drafts.over(&scene, &state).appearance(), state.appearance());
    }
    let target = Some(Target { units: vec!["no such unit".to_owned()], ..Target::default() });
    drafts.hold(Action::SetColor(SetColor { target, color: Some(Color { red: 1.0, green: 0.0, blue: 0.0 }) }));
    assert_eq!(drafts.over(&scene, &state).appearance(), state.appearance());
}

#[test]
fn a_draft_on_the_selection_leaves_units_that_are_there_alone() {
    let scene = Arc::new(row_of_gaussians(6));
    let red = Some(Color { red: 1.0, green: 0.0, blue: 0.0 });
    let all = Some(Target { units: vec!["row".to_owned()], ..Target::default() });
    let select = Action::Select(sg_proto::scene::Select { target: all, operation: 0 });
    let saved = Action::SaveUnit(sg_proto::scene::SaveUnit { name: "all".to_owned(), replace: false });
    let state = Arc::new(opened(&scene).after(&scene, select).unwrap().after(&scene, saved).unwrap());
    let mut drafts = Drafts::default();
    let target = Some(Target { selection: true, ..Target::default() });
    drafts.hold(Action::SetColor(SetColor { target, color: red }));
    let seen = drafts.over(&scene, &state);
    assert!(seen.units().any(|u| u.name == "all" && u.color.is_none()), "the saved unit is as it was");
    assert!(seen.units().any(|u| u.color == Some(Vec3::X)), "the selection is red");
}
