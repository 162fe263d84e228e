//! Properties of any sequence of commands.

use proptest::prelude::*;
use prost::Message as _;
use sg_proto::replica::Replica as _;
use sg_proto::scene::adjust_transfer_function::Change;
use sg_proto::scene::set_view::Change as ViewChange;
use sg_proto::scene::{
    AdjustTransferFunction, ControlPoint, Event, ForgetView, KeepView, MergeUnits, NamedView, Orbit, Redo, RenameUnit,
    Reset, Select, SetBackground, SetLight, SetTerm, SetTone, SetTransferFunction, SetView, TransferFunction, Undo,
    ValueColor, ValueRange, ValueWindow,
};

use sg_scene::similarity::Similarity;

use super::*;
use crate::{HistoryMove, Replica, UnitRef};

const NAMES: [&str; 9] =
    ["bone", "SKIN", "vessel", "bone copy", "sac", "neck", "selection 1", "everything but sac", "nobody"];

fn name() -> impl Strategy<Value = String> {
    prop::sample::select(NAMES.as_slice()).prop_map(str::to_owned)
}

fn target() -> impl Strategy<Value = Target> {
    (
        prop::collection::vec(name(), 0..3),
        prop::bool::weighted(0.3),
        prop::bool::weighted(0.1),
        prop::bool::weighted(0.3),
    )
        .prop_map(|(units, selection, everything, complement)| Target { units, selection, everything, complement })
}

fn some_color() -> impl Strategy<Value = Color> {
    [0.0..1.0_f32, 0.0..1.0_f32, 0.0..1.0_f32].prop_map(|[red, green, blue]| Color { red, green, blue })
}

fn action() -> impl Strategy<Value = Action> {
    let on = || target().prop_map(Some);
    prop_oneof![
        4 => (on(), prop::option::weighted(0.8, some_color())).prop_map(|(target, color)| Action::SetColor(SetColor { target, color })),
        4 => (on(), prop::sample::select(vec![0.0, 0.2, 0.5, 1.0, 2.0, -1.0, f32::NAN]), any::<bool>())
            .prop_map(|(target, factor, relative)| Action::SetOpacity(SetOpacity { target, factor, relative })),
        4 => (on(), any::<bool>()).prop_map(|(target, visible)| Action::SetVisibility(SetVisibility { target, visible })),
        3 => on().prop_map(|target| Action::ShowOnly(ShowOnly { target })),
        3 => any::<u64>().prop_map(|bits| commit(move |i| bits >> (i % 64) & 1 == 1 && i % 7 < 5)),
        2 => (0_usize..60, 0_usize..60).prop_map(|(a, n)| commit(move |i| (a..a + n).contains(&i))),
        2 => (on(), -1..6_i32).prop_map(|(target, operation)| Action::Select(Select { target, operation })),
        3 => (name(), any::<bool>()).prop_map(|(name, replace)| Action::SaveUnit(SaveUnit { name, replace })),
        2 => on().prop_map(|target| Action::DeleteGaussians(DeleteGaussians { target })),
        1 => Just(Action::RestoreGaussians(RestoreGaussians {})),
        2 => (target(), prop_oneof![3 => Just(String::new()), 1 => name()])
            .prop_map(|(target, name)| duplicate(target, &name)),
        2 => (on(), prop::array::uniform3(-2.0..2.0_f64), -90.0..90.0_f64, prop::option::of(0.5..2.0_f64), prop::bool::weighted(0.2))
            .prop_map(|(target, by, degrees, factor, restore)| moving(target, by, degrees, factor, restore)),
        1 => (on(), prop::bool::weighted(0.3)).prop_map(|(target, locked)| Action::SetLock(SetLock { target, locked })),
        2 => (prop::collection::vec(name(), 1..4), prop_oneof![Just(String::new()), name()])
            .prop_map(|(units, name)| Action::MergeUnits(MergeUnits { units, name })),
        3 => (on(), prop::option::of(0.0..5.0_f32), prop::option::of(0.0..2.0_f32), prop::option::of(-1.0..1.0_f32), any::<bool>())
            .prop_map(|(target, saturation, brightness, temperature, relative)| {
                Action::SetTone(SetTone { target, saturation, brightness, temperature, relative })
            }),
        1 => name().prop_map(|name| Action::DeleteUnit(sg_proto::scene::DeleteUnit { name })),
        1 => (name(), name()).prop_map(|(name, new_name)| Action::RenameUnit(RenameUnit { name, new_name })),
        2 => view_name().prop_map(|name| Action::KeepView(KeepView { name })),
        1 => view_name().prop_map(|name| Action::ForgetView(ForgetView { name })),
        2 => (0_u32..4).prop_map(|steps| Action::Undo(Undo { steps })),
        2 => (0_u32..4).prop_map(|steps| Action::Redo(Redo { steps })),
        1 => Just(Action::Reset(Reset {})),
        1 => (0..7_i32).prop_map(|term| Action::SetTerm(SetTerm { term })),
        2 => prop::option::weighted(0.8, function())
            .prop_map(|function| Action::SetTransferFunction(SetTransferFunction { function })),
        2 => adjustment().prop_map(|change| Action::AdjustTransferFunction(AdjustTransferFunction { change })),
        1 => some_color().prop_map(|c| Action::SetBackground(SetBackground { color: Some(c) })),
        1 => (prop::option::of(-1.0..3.0_f32), any::<bool>())
            .prop_map(|(ambient, relative)| Action::SetLight(SetLight { ambient, relative, ..SetLight::default() })),
        2 => prop_oneof![
            (0..9_i32).prop_map(ViewChange::Named),
            (-200.0..200.0, -200.0..200.0)
                .prop_map(|(azimuth_degrees, elevation_degrees)| ViewChange::Orbit(Orbit { azimuth_degrees, elevation_degrees })),
            (-1.0..4.0).prop_map(ViewChange::Zoom),
            target().prop_map(ViewChange::Focus),
            Just(ViewChange::Named(NamedView::Top.into())),
            view_name().prop_map(ViewChange::Kept),
        ].prop_map(|change| Action::SetView(SetView { change: Some(change) })),
    ]
}

/// Names of kept viewpoints, some of which are the same in other capitals.
fn view_name() -> impl Strategy<Value = String> {
    prop::sample::select(vec!["", "entry", "Entry", "view 1", "view 2"]).prop_map(str::to_owned)
}

/// Transfer functions, most of which are in order.
fn function() -> impl Strategy<Value = TransferFunction> {
    let point = (0.0..2000.0_f64, some_color(), -0.05..1.0_f32).prop_map(|(value, color, opacity)| ControlPoint {
        value,
        color: Some(color),
        opacity,
    });
    (prop::collection::vec(point, 0..4), any::<bool>(), 0..4_i32, any::<bool>()).prop_map(
        |(mut points, in_order, scale, normalized)| {
            if in_order {
                points.sort_by(|a, b| a.value.total_cmp(&b.value));
            }
            TransferFunction { low: 1.0, high: 2000.0, normalized, scale, points }
        },
    )
}

/// Changes of a transfer function, some of which are refused.
fn adjustment() -> impl Strategy<Value = Option<Change>> {
    let end = || prop::option::of(-100.0..2100.0_f64);
    let range = move || (end(), end()).prop_map(|(low, high)| ValueRange { low, high });
    prop::option::weighted(
        0.95,
        prop_oneof![
            (end(), end(), -50.0..50.0_f64, prop::option::of(-0.1..2.0_f64)).prop_map(
                |(level, window, level_change, window_factor)| Change::Window(ValueWindow {
                    level,
                    window,
                    level_change,
                    window_factor,
                    ..ValueWindow::default()
                })
            ),
            range().prop_map(Change::ShowOnly),
            range().prop_map(Change::Hide),
            (prop::option::of(range()), some_color())
                .prop_map(|(range, color)| Change::Color(ValueColor { range, color: Some(color) })),
            (0..5_i32).prop_map(Change::Scale),
        ],
    )
}

fn moving(target: Option<Target>, by: [f64; 3], degrees: f64, factor: Option<f64>, restore: bool) -> Action {
    if restore {
        return Action::TransformGaussians(TransformGaussians { target, restore, ..TransformGaussians::default() });
    }
    let (pivot, shift, axis) = (vector(by), vector(by), vector(by));
    Action::TransformGaussians(TransformGaussians {
        target,
        pivot,
        shift,
        axis,
        degrees,
        factor,
        ..TransformGaussians::default()
    })
}

/// The action with a mask over `count` Gaussians.
fn over(count: usize, action: Action) -> Action {
    match action {
        Action::CommitSelection(commit) => {
            let mask = commit.mask.map(|mask| Mask::from_bytes(60, &mask.bits).unwrap());
            // Later Gaussians are as the first ones.
            let grown = |mask: Mask| encode_mask(&Mask::from_fn(count, |i| mask.get(i % 60)));
            Action::CommitSelection(CommitSelection { mask: mask.map(grown), ..commit })
        }
        action => action,
    }
}

/// Where the edits of a state put Gaussian `i` in relation to its place in the file.
fn map_of(state: &EditState, i: usize) -> Similarity {
    let of = |part: &crate::Placement| part.members.get(i).then_some(part.map);
    state.placements().iter().find_map(of).unwrap_or(Similarity::IDENTITY)
}

/// The state without the fields that every command changes.
fn content(state: &EditState) -> EditState {
    let mut content = state.clone();
    content.revision = 0;
    content
}

fn members(state: &EditState, target: &Target) -> Option<Mask> {
    state.resolve(Some(target)).ok().map(|r| r.members)
}

/// The Gaussians whose look a command promises something about.
fn existing(state: &EditState) -> impl Iterator<Item = usize> {
    let deleted = Arc::clone(state.deleted());
    (0..state.count()).filter(move |i| !deleted.get(*i))
}

/// Saved units that hide Gaussian `i`.
fn hidden_by_saved(state: &EditState, i: usize) -> bool {
    state.units().any(|u| !u.derived && !u.visible && u.mask.get(i))
}

/// The effects of commands, checked for each Gaussian.
fn check_promise(action: &Action, before: &EditState, after: &EditState) -> Result<(), TestCaseError> {
    match action {
        Action::DeleteGaussians(a) => {
            let members = members(before, &a.target.clone().unwrap_or_default()).unwrap();
            for i in existing(before) {
                prop_assert_eq!(after.deleted().get(i), members.get(i), "{}", i);
                prop_assert!(members.get(i) || drawn(after, i) == drawn(before, i), "{}", i);
                prop_assert_eq!(
                    after.selection().mask().get(i),
                    before.selection().mask().get(i) && !members.get(i),
                    "{}",
                    i
                );
            }
            prop_assert!(before.deleted().is_subset_of(after.deleted()));
        }
        Action::SetTransferFunction(a) => {
            let shown = after.transfer_function().map(|f| crate::wire::encode_transfer_function(f));
            prop_assert_eq!(&shown, &a.function);
            prop_assert_eq!(after.appearance(), before.appearance());
        }
        Action::AdjustTransferFunction(_) => {
            prop_assert!(after.transfer_function().is_some_and(|function| function.check().is_ok()));
            prop_assert_eq!(after.appearance(), before.appearance());
        }
        Action::TransformGaussians(a) => {
            let members = members(before, &a.target.clone().unwrap_or_default()).unwrap();
            for i in 0..before.count() {
                prop_assert_eq!(drawn(after, i), drawn(before, i), "{}", i);
                let (was, is) = (map_of(before, i), map_of(after, i));
                if !members.get(i) {
                    // A deleted Gaussian goes with its unit.
                    prop_assert!(is == was || before.deleted().get(i), "{}", i);
                } else if a.restore {
                    prop_assert_eq!(is, Similarity::IDENTITY, "{}", i);
                } else if let Some(by) = &a.shift {
                    // The pivot is the shift, so it goes to its double.
                    let by = crate::wire::decode_vector(by);
                    let pivot = was.inverse().apply(by);
                    prop_assert!((is.apply(pivot) - 2.0 * by).length() < 1e-9, "{}", i);
                }
            }
            prop_assert_eq!(after.selection().hash(), before.selection().hash());
        }
        Action::DuplicateGaussians(a) => {
            let originals: Vec<_> = members(before, &a.target.clone().unwrap_or_default()).unwrap().ones().collect();
            prop_assert_eq!(after.count(), before.count() + originals.len());
            for (copy, original) in (before.count()..).zip(originals) {
                prop_assert_eq!(drawn(after, copy), drawn(before, original), "{} of {}", copy, original);
                prop_assert_eq!(map_of(after, copy), map_of(before, original), "{} of {}", copy, original);
                prop_assert!(after.units().all(|unit| unit.derived || !unit.mask.get(copy)));
            }
            for i in 0..before.count() {
                prop_assert_eq!(drawn(after, i), drawn(before, i), "{}", i);
                prop_assert_eq!(map_of(after, i), map_of(before, i), "{}", i);
            }
            let copies: Vec<_> = (before.count()..after.count()).collect();
            prop_assert_eq!(after.selection().mask().ones().collect::<Vec<_>>(), copies);
        }
        Action::SetLock(_) => {
            for i in 0..before.count() {
                prop_assert_eq!(drawn(after, i), drawn(before, i), "{}", i);
            }
        }
        Action::RestoreGaussians(_) => {
            prop_assert!(after.deleted().is_none() && after.existing_count() == after.count());
            for i in existing(before) {
                prop_assert_eq!(drawn(after, i), drawn(before, i), "{}", i);
            }
        }
        Action::ShowOnly(a) => {
            let target = a.target.clone().unwrap_or_default();
            let members = members(before, &target).unwrap();
            for i in 0..before.count() {
                let want = members.get(i) && !hidden_by_saved(after, i);
                prop_assert_eq!(drawn(after, i).visible, want, "{} in {:?}", i, target);
            }
        }
        Action::SetVisibility(a) => {
            let target = a.target.clone().unwrap_or_default();
            let members = members(before, &target).unwrap();
            for i in 0..before.count() {
                if members.get(i) {
                    prop_assert_eq!(drawn(after, i).visible, a.visible && !hidden_by_saved(after, i), "{}", i);
                } else if a.visible {
                    let inside = hidden_by_saved(before, i) && !hidden_by_saved(after, i);
                    prop_assert!(
                        inside || drawn(after, i).visible == drawn(before, i).visible,
                        "{} in {:?}",
                        i,
                        target
                    );
                } else {
                    prop_assert_eq!(drawn(after, i).visible, drawn(before, i).visible, "{} in {:?}", i, target);
                }
            }
        }
        Action::SetOpacity(a) if !a.relative => {
            let target = a.target.clone().unwrap_or_default();
            let resolved = before.resolve(Some(&target)).unwrap();
            for i in existing(before) {
                let unnamed = resolved.unnamed.as_ref().is_some_and(|m| m.get(i));
                if unnamed {
                    // The factor of the base unit and of saved units stays; derived units say this and nothing else.
                    let derived: f32 =
                        after.units().filter(|u| u.derived && u.mask.get(i)).map(|u| u.opacity).product();
                    let named = resolved.named.iter().any(|u| after.members(*u).get(i));
                    prop_assert!(named || derived == a.factor, "{i}: {derived}");
                } else if !resolved.members.get(i) {
                    prop_assert_eq!(drawn(after, i).opacity, drawn(before, i).opacity, "{} in {:?}", i, target);
                }
            }
        }
        Action::SetTone(a) => {
            let resolved = before.resolve(a.target.as_ref()).unwrap();
            for i in existing(before) {
                let (was, is) = (drawn(before, i), drawn(after, i));
                prop_assert_eq!((is.color, is.opacity, is.visible), (was.color, was.opacity, was.visible), "{}", i);
                if !resolved.members.get(i) {
                    prop_assert_eq!(is.tone, was.tone, "{}", i);
                } else if let (false, Some(saturation)) = (a.relative, a.saturation) {
                    // The tone of base and saved units stays under that of derived ones.
                    let derived = after.units().filter(|u| u.derived && u.mask.get(i));
                    let derived: f32 = derived.map(|u| u.tone.saturation).product();
                    let unnamed = resolved.unnamed.as_ref().is_some_and(|m| m.get(i));
                    let named = resolved.named.iter().any(|u| after.members(*u).get(i));
                    prop_assert!(named || !unnamed || derived == saturation, "{}: {}", i, derived);
                }
            }
        }
        Action::MergeUnits(a) => {
            let target = Target { units: a.units.clone(), ..Target::default() };
            let resolved = before.resolve(Some(&target)).unwrap();
            let name = if a.name.trim().is_empty() { &resolved.names[0] } else { a.name.trim() };
            let merged = after.find(name).unwrap();
            prop_assert_eq!(&*after.members(merged), &resolved.members);
            let left = resolved.named.iter().filter(|u| matches!(u, UnitRef::Editable(_)));
            prop_assert!(left.into_iter().all(|u| *u == merged || after.name_of(*u).is_none()));
            prop_assert_eq!(after.base_units(), before.base_units());
            for i in existing(before).filter(|i| !resolved.members.get(*i)) {
                prop_assert_eq!(drawn(after, i), drawn(before, i), "{}", i);
            }
        }
        Action::SetColor(a) => {
            let target = a.target.clone().unwrap_or_default();
            let resolved = before.resolve(Some(&target)).unwrap();
            for i in existing(before) {
                let (was, is) = (drawn(before, i), drawn(after, i));
                if let (true, Some(c)) = (resolved.unnamed.as_ref().is_some_and(|m| m.get(i)), &a.color) {
                    prop_assert_eq!(is.color, Some(crate::wire::decode_color(c)));
                } else if !resolved.members.get(i) {
                    prop_assert_eq!((is.color, is.palette), (was.color, was.palette), "{} in {:?}", i, target);
                }
            }
        }
        _ => {}
    }
    Ok(())
}

fn check_state(state: &EditState) -> Result<(), TestCaseError> {
    let mut names: Vec<_> = state.names().map(|(n, _)| n.to_lowercase()).collect();
    names.sort();
    names.dedup();
    prop_assert_eq!(names.len(), state.names().count(), "names are unique");
    for unit in state.units() {
        prop_assert!(!unit.derived || !(unit.is_neutral() || unit.mask.is_none()), "{} says nothing", unit.name);
        prop_assert_eq!(state.find(&unit.name), Ok(UnitRef::Editable(unit.id)));
    }
    prop_assert!(
        !state.selection().mask().intersects(&state.unselectable()),
        "a deleted or locked Gaussian is selected"
    );
    for (name, unit) in state.names() {
        prop_assert!(!state.members(unit).intersects(state.deleted()), "{name} has deleted Gaussians");
    }
    for unit in state.units() {
        prop_assert!(unit.deleted.as_ref().is_none_or(|gone| gone.is_subset_of(state.deleted())), "{}", unit.name);
    }
    prop_assert_eq!(state.existing_count(), state.count() - state.deleted().count());
    prop_assert_eq!(state.base_units().last().map(|base| base.range().end), Some(state.count()));
    prop_assert!(state.deleted().ones().all(|i| !drawn(state, i).visible), "a deleted Gaussian is drawn");
    for (k, part) in state.placements().iter().enumerate() {
        prop_assert!(!part.members.is_none() && part.map != Similarity::IDENTITY);
        prop_assert!(state.placements()[..k].iter().all(|other| !other.members.intersects(&part.members)));
    }
    for name in state.focus() {
        prop_assert!(state.find(name).is_ok(), "{} is in focus and gone", name);
    }
    prop_assert_eq!(state.view().check(), Ok(()));
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn any_sequence_keeps_its_promises(actions in prop::collection::vec(action(), 1..40)) {
        let mut editor = volume_editor();
        let mut twin = editor.clone();
        let mut replica = Replica::new(editor.state().clone());
        for action in actions {
            let action = over(editor.state().count(), action);
            let before = editor.clone();
            let Ok(applied) = editor.apply(&command(action.clone())) else {
                prop_assert_eq!(editor.message(true), before.message(true));
                prop_assert!(twin.apply(&command(action)).is_err());
                continue;
            };
            prop_assert_eq!(editor.state().revision(), before.state().revision() + 1);
            check_state(editor.state())?;
            check_promise(&action, before.state(), editor.state())?;

            // The same commands make the same everything.
            prop_assert_eq!(&twin.apply(&command(action.clone())).unwrap(), &applied);

            // Events suffice for a copy, and so does a snapshot.
            let event = Event::decode(applied.event.encode_to_vec().as_slice()).unwrap();
            prop_assert_eq!(replica.apply(&event), Ok(()));
            prop_assert_eq!(&**replica.state(), editor.state());
            prop_assert_eq!(&EditState::from_snapshot(&editor.message(true)).unwrap(), editor.state());
            prop_assert_eq!(editor.scene().len(), editor.state().count());

            // Undo takes exactly this back, redo brings exactly this back.
            let mut other = editor.clone();
            if applied.history == HistoryMove::Push {
                other.apply(&command(Action::Undo(Undo { steps: 1 }))).unwrap();
                prop_assert_eq!(content(other.state()), content(before.state()));
                other.apply(&command(Action::Redo(Redo { steps: 1 }))).unwrap();
                prop_assert_eq!(content(other.state()), content(editor.state()));
                prop_assert_eq!(other.message(false).undo, editor.message(false).undo);
            }

            // A replay of the stored commands equals the editor.
            let mut replayed = before;
            replayed.replay(&event, &applied.inverse, applied.history).unwrap();
            prop_assert_eq!(replayed.message(true), editor.message(true));
            prop_assert_eq!(replayed.next_unit(), editor.next_unit());
            prop_assert_eq!(replayed.history(), editor.history());
        }
        // All the way back is the first state, except for the target of the conversation.
        while editor.apply(&command(Action::Undo(Undo { steps: 7 }))).is_ok() {}
        let mut back = content(editor.state());
        back.focus = editor.initial().focus().to_vec();
        prop_assert_eq!(&back, editor.initial());
    }
}
