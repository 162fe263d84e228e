//! Random actions, right and wrong ones, of every kind.

use proptest::prelude::*;
use proptest::sample::select;
use proptest::strategy::ValueTree;
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};
use sg_edit::wire::encode_mask;
use sg_proto::scene::adjust_transfer_function::Change;
use sg_proto::scene::command::Action;
use sg_proto::scene::set_view::Change as ViewChange;
use sg_proto::scene::{
    AdjustTransferFunction, Color, CommitSelection, ControlPoint, DeleteGaussians, DeleteUnit, DuplicateGaussians,
    Mask as MaskMessage, MergeUnits, Orbit, Redo, RenameUnit, Reset, RestoreGaussians, SaveUnit, Select, SetBackground,
    SetColor, SetLight, SetLock, SetOpacity, SetTerm, SetTone, SetTransferFunction, SetView, SetVisibility, ShowOnly,
    Stroke, Target, TransferFunction, TransformGaussians, Undo, ValueRange, Vector, View,
};
use sg_scene::mask::Mask;

/// Most names of units, in use or not.
const NAMES: [&str; 10] =
    ["spiral", "SPIRAL", "sac", "neck", "Sac", "selection 1", "everything but sac", "nobody", "", "\u{1b}[2J"];

/// A repeatable stream of actions.
#[derive(Debug)]
pub(crate) struct RandomActions {
    runner: TestRunner,
    gaussians: usize,
}

impl RandomActions {
    /// For a scene of this size.
    pub(crate) fn new(gaussians: usize, seed: u8) -> Self {
        let random = TestRng::from_seed(RngAlgorithm::ChaCha, &[seed; 32]);
        Self { runner: TestRunner::new_with_rng(Config::default(), random), gaussians }
    }

    /// The next action; `None` is a command without one.
    pub(crate) fn next(&mut self) -> Option<Action> {
        let strategy = prop::option::weighted(0.97, action(self.gaussians));
        strategy.new_tree(&mut self.runner).unwrap().current()
    }

    /// A number below `end`.
    pub(crate) fn below(&mut self, end: usize) -> usize {
        (0..end).new_tree(&mut self.runner).unwrap().current()
    }
}

fn name() -> impl Strategy<Value = String> {
    prop_oneof![9 => select(NAMES.as_slice()).prop_map(str::to_owned), 1 => Just("n".repeat(300))]
}

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![3 => 0.0..1.0, 1 => select(vec![-1.0, 0.0, 2.0, 1e-300, 1e30, 1e300, f64::NAN, f64::INFINITY])]
}

fn color() -> impl Strategy<Value = Option<Color>> {
    prop::option::weighted(
        0.9,
        [number(), number(), number()].prop_map(|[red, green, blue]| Color {
            red: red as f32,
            green: green as f32,
            blue: blue as f32,
        }),
    )
}

fn target() -> impl Strategy<Value = Option<Target>> {
    let flag = prop::bool::weighted;
    prop::option::weighted(
        0.95,
        (prop::collection::vec(name(), 0..3), flag(0.3), flag(0.2), flag(0.3))
            .prop_map(|(units, selection, everything, complement)| Target { units, selection, everything, complement }),
    )
}

fn mask(gaussians: usize) -> impl Strategy<Value = Option<MaskMessage>> {
    let right = (any::<u64>(), 0..gaussians).prop_map(move |(bits, from)| {
        Some(encode_mask(&Mask::from_fn(gaussians, |i| i >= from && bits >> (i % 64) & 1 == 1)))
    });
    let wrong = (0..4 * gaussians as u32, prop::collection::vec(any::<u8>(), 0..40))
        .prop_map(|(length, bits)| Some(MaskMessage { length: length.into(), bits }));
    prop_oneof![8 => right, 1 => wrong, 1 => Just(None)]
}

fn vector() -> impl Strategy<Value = Option<Vector>> {
    prop::option::weighted(0.9, [number(), number(), number()].prop_map(|[x, y, z]| Vector { x, y, z }))
}

fn strokes() -> impl Strategy<Value = Vec<Stroke>> {
    let stroke = (0..5_i32, 0..5_i32, number(), prop::collection::vec(number(), 0..9))
        .prop_map(|(mode, kind, radius, points)| Stroke { mode, kind, radius, points, ..Stroke::default() });
    prop::collection::vec(stroke, 0..3)
}

fn action(gaussians: usize) -> impl Strategy<Value = Action> {
    prop_oneof![
        4 => (target(), color()).prop_map(|(target, color)| Action::SetColor(SetColor { target, color })),
        4 => (target(), number(), any::<bool>())
            .prop_map(|(target, factor, relative)| Action::SetOpacity(SetOpacity { target, factor: factor as f32, relative })),
        3 => (target(), any::<bool>()).prop_map(|(target, visible)| Action::SetVisibility(SetVisibility { target, visible })),
        2 => target().prop_map(|target| Action::ShowOnly(ShowOnly { target })),
        4 => (mask(gaussians), strokes(), prop::bool::weighted(0.1)).prop_map(|(mask, strokes, stale)| {
            let expected_hash = if stale { "0".repeat(64) } else { String::new() };
            Action::CommitSelection(CommitSelection { mask, strokes, expected_hash, ..CommitSelection::default() })
        }),
        3 => (target(), -1..7_i32).prop_map(|(target, operation)| Action::Select(Select { target, operation })),
        4 => (name(), any::<bool>()).prop_map(|(name, replace)| Action::SaveUnit(SaveUnit { name, replace })),
        2 => target().prop_map(|target| Action::DeleteGaussians(DeleteGaussians { target })),
        1 => Just(Action::RestoreGaussians(RestoreGaussians {})),
        2 => (target(), prop_oneof![3 => Just(String::new()), 1 => name()])
            .prop_map(|(target, name)| Action::DuplicateGaussians(DuplicateGaussians { target, name })),
        2 => (target(), prop::array::uniform3(-1.0..1.0_f64), -90.0..90.0_f64, prop::option::of(0.5..2.0_f64)).prop_map(
            |(target, [x, y, z], degrees, factor)| {
                let (shift, axis) = (Some(Vector { x, y, z }), Some(Vector { x: z, y: x, z: y }));
                let turned = TransformGaussians { target, shift, axis, degrees, factor, ..TransformGaussians::default() };
                Action::TransformGaussians(turned)
            }
        ),
        1 => (target(), prop::bool::weighted(0.3)).prop_map(|(target, locked)| Action::SetLock(SetLock { target, locked })),
        2 => name().prop_map(|name| Action::DeleteUnit(DeleteUnit { name })),
        2 => (prop::collection::vec(name(), 0..4), prop_oneof![Just(String::new()), name()])
            .prop_map(|(units, name)| Action::MergeUnits(MergeUnits { units, name })),
        2 => (target(), prop::option::of(number()), prop::option::of(0.0..4.0_f32), any::<bool>()).prop_map(
            |(target, saturation, brightness, relative)| {
                let saturation = saturation.map(|s| s as f32);
                Action::SetTone(SetTone { target, saturation, brightness, relative, ..SetTone::default() })
            }
        ),
        2 => (name(), name()).prop_map(|(name, new_name)| Action::RenameUnit(RenameUnit { name, new_name })),
        3 => select(vec![0, 1, 2, 7, u32::MAX]).prop_map(|steps| Action::Undo(Undo { steps })),
        3 => select(vec![0, 1, 2, 7, u32::MAX]).prop_map(|steps| Action::Redo(Redo { steps })),
        1 => Just(Action::Reset(Reset {})),
        1 => (-1..9_i32).prop_map(|term| Action::SetTerm(SetTerm { term })),
        1 => prop::option::weighted(0.5, transfer_function())
            .prop_map(|function| Action::SetTransferFunction(SetTransferFunction { function })),
        1 => (prop::option::of(number()), prop::option::of(number())).prop_map(|(low, high)| {
            let change = Some(Change::ShowOnly(ValueRange { low, high }));
            Action::AdjustTransferFunction(AdjustTransferFunction { change })
        }),
        1 => color().prop_map(|color| Action::SetBackground(SetBackground { color })),
        1 => (prop::option::of(number()), any::<bool>())
            .prop_map(|(ambient, relative)| Action::SetLight(SetLight { ambient: ambient.map(|a| a as f32), relative, ..SetLight::default() })),
        3 => view_change().prop_map(|change| Action::SetView(SetView { change })),
    ]
}

fn transfer_function() -> impl Strategy<Value = TransferFunction> {
    let point = (number(), color(), number()).prop_map(|(value, color, opacity)| ControlPoint {
        value,
        color,
        opacity: opacity as f32,
    });
    (number(), number(), -1..5_i32, any::<bool>(), prop::collection::vec(point, 0..4))
        .prop_map(|(low, high, scale, normalized, points)| TransferFunction { low, high, normalized, scale, points })
}

fn view_change() -> impl Strategy<Value = Option<ViewChange>> {
    let view = (vector(), vector(), vector(), number()).prop_map(|(eye, target, up, fov_y_degrees)| {
        ViewChange::View(View { eye, target, up, fov_y_degrees: 60.0 * fov_y_degrees })
    });
    let orbit = (number(), number()).prop_map(|(azimuth_degrees, elevation_degrees)| {
        ViewChange::Orbit(Orbit { azimuth_degrees, elevation_degrees })
    });
    let focus = target().prop_map(|target| ViewChange::Focus(target.unwrap_or_default()));
    prop::option::weighted(
        0.95,
        prop_oneof![view, (-1..9_i32).prop_map(ViewChange::Named), orbit, number().prop_map(ViewChange::Zoom), focus],
    )
}
