//! Commands on a small scene: effects, refusals, and properties of any sequence.

mod commands;
mod deletion;
mod duplicates;
mod edited;
mod kept_views;
mod lock;
mod merge;
mod placement;
mod properties;
mod reclassification;
mod tone;

use std::sync::Arc;

use glam::Vec3;
use sg_proto::scene::command::Action;
use sg_proto::scene::{
    Color, Command, CommitSelection, DeleteGaussians, DuplicateGaussians, RestoreGaussians, SaveUnit, SetColor,
    SetLock, SetOpacity, SetVisibility, ShowOnly, Target, TransformGaussians, Vector,
};

use super::wire::encode_mask;
use super::{Applied, EditError, EditState, Editor};
use sg_reclassify::VolumeOfScene;
use sg_reclassify::sources::{Source, store};
use sg_scene::mask::Mask;
use sg_scene::model::Scene;
use sg_scene::synthetic::test_scene;
use sg_scene::tone::Tone;
use sg_volume::TransferFunction;
use sg_volume::transfer::{ControlPoint, Scale, Units};

/// Base units `bone` (0..20), `skin` (20..35) and `Vessel` (35..60).
pub(crate) fn editor() -> Editor {
    let scene = Arc::new(test_scene(&[("bone", 20), ("skin", 15), ("Vessel", 25)]));
    let state = EditState::of_scene(&scene, "scene.toml", "hash");
    Editor::new(scene, state)
}

/// A test scene of which the first unit keeps values of a volume: 100 times the index of a Gaussian.
fn volume_of(units: &[(&str, usize)]) -> Arc<Scene> {
    let mut units = test_scene(units).units;
    let source = |i: usize| Source { value: 100.0 * i as f64, depth: 1.0, ..Source::default() };
    let sources: Vec<_> = (0..units[0].gaussians.len()).map(source).collect();
    store(&sources, &mut units[0].gaussians);
    units[0].values = Some([0.0, 2000.0]);
    Arc::new(Scene::compose(units, None))
}

/// As [`editor`], where `bone` keeps values of a volume.
fn volume_editor() -> Editor {
    let scene = volume_of(&[("bone", 20), ("skin", 15), ("Vessel", 25)]);
    let state = EditState::of_scene(&scene, "scene.toml", "hash").with_volume(Some(volume()));
    Editor::new(scene, state)
}

/// The volume of [`volume_of`]: a ramp over its values.
fn volume() -> VolumeOfScene {
    let point = |value: f64, opacity| ControlPoint { value, color: [0.5; 3], opacity };
    let function = TransferFunction {
        domain: [0.0, 2000.0],
        units: Units::Raw,
        scale: Scale::Linear,
        variable: None,
        points: vec![point(200.0, 0.0), point(1000.0, 0.8)],
        base_units: Vec::new(),
    };
    VolumeOfScene { function: Some(Arc::new(function)), range: [0.0, 2000.0] }
}

pub(crate) fn command(action: Action) -> Command {
    Command { id: "test".to_owned(), expected_revision: 0, action: Some(action) }
}

fn units(names: &[&str]) -> Target {
    Target { units: names.iter().map(|n| (*n).to_owned()).collect(), ..Target::default() }
}

fn all_but(names: &[&str]) -> Target {
    Target { complement: true, ..units(names) }
}

fn selection() -> Target {
    Target { selection: true, ..Target::default() }
}

fn everything() -> Target {
    Target { everything: true, ..Target::default() }
}

const RED: Color = Color { red: 1.0, green: 0.0, blue: 0.0 };
const BLUE: Color = Color { red: 0.0, green: 0.0, blue: 1.0 };

fn color(target: Target, color: Color) -> Action {
    Action::SetColor(SetColor { target: Some(target), color: Some(color) })
}

fn own_color(target: Target) -> Action {
    Action::SetColor(SetColor { target: Some(target), color: None })
}

fn opacity(target: Target, factor: f32) -> Action {
    Action::SetOpacity(SetOpacity { target: Some(target), factor, relative: false })
}

fn visible(target: Target, visible: bool) -> Action {
    Action::SetVisibility(SetVisibility { target: Some(target), visible })
}

fn only(target: Target) -> Action {
    Action::ShowOnly(ShowOnly { target: Some(target) })
}

fn commit(members: impl Fn(usize) -> bool) -> Action {
    commit_of(60, members)
}

fn commit_of(gaussians: usize, members: impl Fn(usize) -> bool) -> Action {
    let mask = Some(encode_mask(&Mask::from_fn(gaussians, members)));
    Action::CommitSelection(CommitSelection { mask, ..CommitSelection::default() })
}

fn delete(target: Target) -> Action {
    Action::DeleteGaussians(DeleteGaussians { target: Some(target) })
}

fn restore() -> Action {
    Action::RestoreGaussians(RestoreGaussians {})
}

fn duplicate(target: Target, name: &str) -> Action {
    Action::DuplicateGaussians(DuplicateGaussians { target: Some(target), name: name.to_owned() })
}

fn lock(target: Target, locked: bool) -> Action {
    Action::SetLock(SetLock { target: Some(target), locked })
}

fn vector([x, y, z]: [f64; 3]) -> Option<Vector> {
    Some(Vector { x, y, z })
}

fn shift(target: Target, by: [f64; 3]) -> Action {
    let target = Some(target);
    Action::TransformGaussians(TransformGaussians { target, shift: vector(by), ..TransformGaussians::default() })
}

fn save(name: &str) -> Action {
    Action::SaveUnit(SaveUnit { name: name.to_owned(), replace: false })
}

/// Carries actions out; all must be accepted.
fn run(editor: &mut Editor, actions: impl IntoIterator<Item = Action>) -> Option<Applied> {
    actions
        .into_iter()
        .map(|action| editor.apply(&command(action.clone())).unwrap_or_else(|e| panic!("{action:?}: {e}")))
        .last()
}

fn refused(editor: &mut Editor, action: Action) -> EditError {
    let before = editor.clone().message(true);
    let error = editor.apply(&command(action)).unwrap_err();
    assert_eq!(editor.message(true), before, "a refused command changed something");
    assert!(!error.to_string().contains('\n'));
    error
}

/// The appearance of one Gaussian, as a renderer derives it.
#[derive(Debug, Clone, PartialEq)]
struct Drawn {
    visible: bool,
    opacity: f32,
    palette: Vec3,
    color: Option<Vec3>,
    tone: Tone,
}

fn drawn(state: &EditState, i: usize) -> Drawn {
    let appearance = state.appearance();
    let at = state.base_units().iter().position(|b| b.range().contains(&i)).unwrap();
    let base = appearance.base[at];
    let mut drawn =
        Drawn { visible: base.visible, opacity: base.opacity, palette: base.palette, color: None, tone: Tone::NEUTRAL };
    for unit in appearance.units.iter().filter(|u| u.mask.get(i)) {
        drawn.visible &= unit.visible;
        drawn.opacity *= unit.opacity;
        drawn.color = unit.color.or(drawn.color);
        drawn.tone = drawn.tone.and(unit.tone);
    }
    drawn
}

fn shown(state: &EditState) -> Vec<usize> {
    (0..state.count()).filter(|&i| drawn(state, i).visible).collect()
}
