//! Clauses resolved against a scene: commands, answers, refusals.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test fails by panicking")]

use proptest::prelude::*;
use sg_language::commands;
use sg_language::resolution::{self, Refusal, Step};
use sg_language::{report, unit_names};
use sg_proto::bus::Code;
use sg_proto::language::movement::Kind;
use sg_proto::language::{Act, Clause, Movement, PutBack, Reference, Rotation, Scale, Shift, Way};
use sg_proto::launch::save_request::Content;
use sg_proto::launch::{GaussianChoice, GaussianPart};
use sg_proto::render::{Frame, UnitCoverage};
use sg_proto::scene::adjust_transfer_function::Change;
use sg_proto::scene::command::Action;
use sg_proto::scene::{
    AdjustTransferFunction, Axis, BaseUnit, Color, CommandResult, DuplicateGaussians, ForgetView, KeepView, KeptView,
    MergeUnits, PatientSide, RenameUnit, Selection, SetLight, SetOperation, SetTone, SetTransferFunction, SetView,
    State, Target, TransferFunction, TransformGaussians, Unit, ValueColor, ValueRange, ValueScale, ValueWindow, Vector,
    View, Volume, set_view,
};
use sg_proto::selection::{Answer, AnswerStep, Answers, StrokesReply, StrokesRequest};

fn scene() -> State {
    let base = |name: &str, first, count| BaseUnit {
        name: name.into(),
        first,
        count,
        palette: Some(Color { red: 1.0, green: 0.0, blue: 0.0 }),
        opacity: 1.0,
        visible: true,
        ..BaseUnit::default()
    };
    let unit = |id, name: &str, derived| Unit {
        id,
        name: name.into(),
        count: 10,
        opacity: 1.0,
        visible: true,
        derived,
        ..Unit::default()
    };
    State {
        revision: 9,
        count: 1000,
        base_units: vec![base("parent vessel", 0, 900), base("leaves", 900, 100)],
        units: vec![unit(1, "sac", false), unit(2, "left root", false), unit(3, "all but sac", true)],
        selection: Some(Selection { count: 42, ..Selection::default() }),
        focus: vec!["sac".into()],
        undo: vec!["made the sac red".into()],
        ..State::default()
    }
}

fn unselected() -> State {
    State { selection: None, focus: Vec::new(), undo: Vec::new(), ..scene() }
}

fn names_of(names: &[&str]) -> Reference {
    Reference { names: names.iter().map(|n| (*n).to_owned()).collect(), ..Reference::default() }
}

fn clause(act: Act, target: Reference) -> Clause {
    Clause { act: act.into(), target: Some(target), ..Clause::default() }
}

fn target(reference: &Reference, state: &State) -> Result<Target, Refusal> {
    resolution::target(reference, state)
}

fn action(clause: &Clause, state: &State) -> Action {
    match commands::resolve(clause, state, None).unwrap() {
        Step::Change { action, .. } => action,
        other => panic!("{other:?}"),
    }
}

fn refusal(clause: &Clause, state: &State) -> Refusal {
    commands::resolve(clause, state, None).unwrap_err()
}

#[test]
fn names_are_found_in_any_spelling() {
    for (spoken, name) in
        [("sac", "sac"), ("SAC", "sac"), ("the sacs", "sac"), ("leaf", "leaves"), ("Parent Vessels", "parent vessel")]
    {
        assert_eq!(target(&names_of(&[spoken]), &scene()).unwrap().units, [name], "{spoken}");
    }
    assert_eq!(target(&names_of(&["sac", "SAC", "leaf"]), &scene()).unwrap().units, ["sac", "leaves"]);
}

#[test]
fn an_unknown_name_is_refused_with_similar_and_all_names() {
    let refusal = target(&names_of(&["sack"]), &scene()).unwrap_err();
    assert_eq!(refusal.code, Code::NotFound);
    assert_eq!(
        refusal.message,
        "Nothing is named “sack”. Did you mean “sac”? Names: parent vessel, leaves, sac, left root."
    );
    assert_eq!(refusal.details, ["parent vessel", "leaves", "sac", "left root"]);
    let strange = target(&names_of(&["weather"]), &scene()).unwrap_err();
    assert!(!strange.message.contains("Did you mean"), "{strange}");
    assert_eq!(
        target(&names_of(&["sac"]), &State::default()).unwrap_err().message,
        "Nothing is named “sac” yet. Brush it, press Ctrl+S, name it."
    );
}

#[test]
fn it_is_the_focus_then_the_selection_then_nothing() {
    let it = Reference { focus: true, ..Reference::default() };
    assert_eq!(target(&it, &scene()).unwrap().units, ["sac"]);
    let gone = State { focus: vec!["was deleted".into()], ..scene() };
    let selected = target(&it, &gone).unwrap();
    assert!(selected.selection && selected.units.is_empty());
    let nothing = target(&it, &unselected()).unwrap_err();
    assert_eq!(nothing.code, Code::FailedPrecondition);
    assert!(nothing.message.starts_with("Which structure?") && nothing.message.contains("parent vessel"), "{nothing}");
}

#[test]
fn everything_else_is_all_but_the_focus_or_all_but_the_selection() {
    let rest = Reference { complement: true, ..Reference::default() };
    let of_focus = target(&rest, &scene()).unwrap();
    assert_eq!(
        (of_focus.units.as_slice(), of_focus.complement, of_focus.selection),
        (&["sac".to_owned()][..], true, false)
    );
    let of_selection = target(&rest, &State { focus: Vec::new(), ..scene() }).unwrap();
    assert_eq!((of_selection.units.len(), of_selection.complement, of_selection.selection), (0, true, true));
    assert_eq!(target(&rest, &unselected()).unwrap_err().code, Code::FailedPrecondition);
    let named = Reference { complement: true, ..names_of(&["leaf"]) };
    assert_eq!(
        target(&named, &unselected()).unwrap(),
        Target { units: vec!["leaves".into()], complement: true, ..Target::default() }
    );
}

#[test]
fn without_a_selection_clauses_that_need_one_are_refused() {
    let selection = Reference { selection: true, ..Reference::default() };
    for clause in [
        clause(Act::SetColor, selection.clone()),
        clause(Act::Hide, selection.clone()),
        Clause { name: "dome".into(), ..clause(Act::Label, selection) },
        Clause { operation: SetOperation::Remove.into(), ..clause(Act::Select, names_of(&["sac"])) },
    ] {
        let refusal = refusal(&clause, &unselected());
        assert_eq!(refusal.code, Code::FailedPrecondition);
        assert!(refusal.message.starts_with("Nothing is selected."), "{refusal}");
    }
}

#[test]
fn targets_are_copied_into_commands() {
    let red = Color { red: 1.0, green: 0.0, blue: 0.0 };
    let color = Clause { color: Some(red), ..clause(Act::SetColor, names_of(&["sacs"])) };
    let Action::SetColor(set) = action(&color, &scene()) else { panic!("no colour") };
    assert_eq!((set.target.unwrap().units, set.color), (vec!["sac".to_owned()], Some(red)));
    let fade =
        Clause { amount: Some(0.2), ..clause(Act::SetOpacity, Reference { complement: true, ..Reference::default() }) };
    let Action::SetOpacity(set) = action(&fade, &scene()) else { panic!("no opacity") };
    assert_eq!((set.factor, set.relative, set.target.unwrap().complement), (0.2, false, true));
    let Action::SetVisibility(set) = action(&clause(Act::Hide, names_of(&["leaves"])), &scene()) else {
        panic!("not hidden")
    };
    assert!(!set.visible);
    let view = SetView { change: Some(set_view::Change::Focus(Target::default())) };
    let look = Clause { view: Some(view), ..clause(Act::SetView, names_of(&["leaf"])) };
    let Action::SetView(set) = action(&look, &scene()) else { panic!("no view") };
    assert_eq!(set.change, Some(set_view::Change::Focus(Target { units: vec!["leaves".into()], ..Target::default() })));
    let selection = Reference { selection: true, ..Reference::default() };
    let frame = Clause { view: look.view.clone(), ..clause(Act::SetView, selection) };
    let Action::SetView(set) = action(&frame, &scene()) else { panic!("no view") };
    assert_eq!(set.change, Some(set_view::Change::Focus(Target { selection: true, ..Target::default() })));
    assert_eq!(refusal(&frame, &unselected()).code, Code::FailedPrecondition);
    let Action::Select(select) = action(&clause(Act::ClearSelection, Reference::default()), &scene()) else { panic!() };
    assert_eq!((select.target, select.operation), (None, i32::from(SetOperation::Replace)));
}

#[test]
fn numbers_out_of_range_are_refused() {
    let opacity = |amount| Clause { amount, ..clause(Act::SetOpacity, names_of(&["sac"])) };
    for (amount, code) in [
        (None, Code::InvalidArgument),
        (Some(-0.1), Code::OutOfRange),
        (Some(f64::NAN), Code::OutOfRange),
        (Some(f64::INFINITY), Code::OutOfRange),
    ] {
        assert_eq!(refusal(&opacity(amount), &scene()).code, code, "{amount:?}");
    }
    let color = Color { red: 2.0, green: 0.0, blue: f32::NAN };
    let colored = Clause { color: Some(color), ..clause(Act::SetColor, names_of(&["sac"])) };
    assert_eq!(refusal(&colored, &scene()).code, Code::OutOfRange);
    let zero = SetLight { direction: Some(Vector::default()), ..SetLight::default() };
    let dark = Clause { light: Some(zero), ..clause(Act::SetLight, Reference::default()) };
    assert_eq!(refusal(&dark, &scene()).code, Code::OutOfRange);
    let zoom = SetView { change: Some(set_view::Change::Zoom(0.0)) };
    let zoomed = Clause { view: Some(zoom), ..clause(Act::SetView, Reference::default()) };
    assert_eq!(refusal(&zoomed, &scene()).code, Code::OutOfRange);
    let undo = Clause { amount: Some(1.5), ..clause(Act::Undo, Reference::default()) };
    assert_eq!(refusal(&undo, &scene()).code, Code::OutOfRange);
    assert_eq!(refusal(&Clause::default(), &scene()).code, Code::InvalidArgument);
}

#[test]
fn undo_and_redo_without_history_are_refused() {
    let undo = |amount| Clause { amount, ..clause(Act::Undo, Reference::default()) };
    assert!(matches!(action(&undo(Some(2.0)), &scene()), Action::Undo(u) if u.steps == 2));
    assert!(matches!(action(&undo(None), &scene()), Action::Undo(u) if u.steps == 1));
    assert_eq!(refusal(&undo(None), &unselected()).message, "There is nothing to undo.");
    assert_eq!(refusal(&clause(Act::Redo, Reference::default()), &scene()).message, "There is nothing to redo.");
}

#[test]
fn an_existing_name_is_refused_unless_it_is_updated() {
    let label = |name: &str, operation: SetOperation| Clause {
        name: name.into(),
        operation: operation.into(),
        ..clause(Act::Label, Reference { selection: true, ..Reference::default() })
    };
    assert!(
        matches!(action(&label("dome", SetOperation::Unspecified), &scene()), Action::SaveUnit(s) if s.name == "dome" && !s.replace)
    );
    let taken = refusal(&label("Sac", SetOperation::Unspecified), &scene());
    assert_eq!(taken.code, Code::AlreadyExists);
    assert!(taken.message.contains("update the sac"), "{taken}");
    assert!(
        matches!(action(&label("the SAC", SetOperation::Replace), &scene()), Action::SaveUnit(s) if s.name == "sac" && s.replace)
    );
    assert_eq!(refusal(&label("leaves", SetOperation::Unspecified), &scene()).code, Code::AlreadyExists);
    assert_eq!(refusal(&label("leaves", SetOperation::Replace), &scene()).code, Code::FailedPrecondition);
    assert_eq!(refusal(&label("ghost", SetOperation::Replace), &scene()).code, Code::NotFound);
    assert_eq!(refusal(&label(" ", SetOperation::Unspecified), &scene()).code, Code::InvalidArgument);
    assert_eq!(refusal(&label(&"n".repeat(200), SetOperation::Unspecified), &scene()).code, Code::InvalidArgument);
}

#[test]
fn gaussians_are_deleted_by_name_by_selection_and_around_a_target() {
    let delete = |reference| clause(Act::DeleteGaussians, reference);
    let selection = Reference { selection: true, ..Reference::default() };
    let around = Reference { complement: true, ..names_of(&["sac"]) };
    for (reference, wanted) in [
        (names_of(&["leaves"]), Target { units: vec!["leaves".into()], ..Target::default() }),
        (selection.clone(), Target { selection: true, ..Target::default() }),
        (around, Target { units: vec!["sac".into()], complement: true, ..Target::default() }),
    ] {
        let Action::DeleteGaussians(made) = action(&delete(reference.clone()), &scene()) else {
            panic!("{reference:?}")
        };
        assert_eq!(made.target, Some(wanted));
    }
    assert_eq!(refusal(&delete(selection), &unselected()).code, Code::FailedPrecondition);
    assert_eq!(refusal(&delete(names_of(&["sack"])), &scene()).code, Code::NotFound);

    let restore = clause(Act::RestoreGaussians, Reference::default());
    assert!(
        matches!(commands::resolve(&restore, &scene(), None), Ok(Step::Answer { text, .. }) if text == "Nothing is deleted.")
    );
    let mut deleted = scene();
    deleted.base_units[0].deleted = 100;
    assert!(matches!(action(&restore, &deleted), Action::RestoreGaussians(_)));
    // What is deleted counts no more.
    let of = |name: &str| sg_language::query::unit(name, &deleted, None).unwrap();
    assert!(
        of("parent vessel").starts_with("Parent vessel: 800 Gaussians (89 % of the scene)"),
        "{}",
        of("parent vessel")
    );
    let told = sg_language::query::scene(&deleted, None);
    assert!(told.starts_with("The scene has 900 Gaussians. 100 more are deleted."), "{told}");
}

#[test]
fn only_saved_units_are_renamed_and_lose_their_names() {
    let rename = |from: &str, to: &str| Clause { name: to.into(), ..clause(Act::Rename, names_of(&[from])) };
    assert!(
        matches!(action(&rename("sac", "dome"), &scene()), Action::RenameUnit(r) if r.name == "sac" && r.new_name == "dome")
    );
    assert!(matches!(action(&rename("sac", "Sac"), &scene()), Action::RenameUnit(_)), "its own name in capitals");
    assert_eq!(refusal(&rename("sac", "left root"), &scene()).code, Code::AlreadyExists);
    assert_eq!(refusal(&rename("leaves", "foliage"), &scene()).code, Code::FailedPrecondition);
    let delete = |reference| clause(Act::Delete, reference);
    assert!(matches!(action(&delete(names_of(&["sac"])), &scene()), Action::DeleteUnit(d) if d.name == "sac"));
    let it = Reference { focus: true, ..Reference::default() };
    assert!(matches!(action(&delete(it), &scene()), Action::DeleteUnit(d) if d.name == "sac"));
    for wrong in [
        names_of(&["leaves"]),
        Reference { selection: true, ..Reference::default() },
        Reference { everything: true, ..Reference::default() },
        Reference { complement: true, ..names_of(&["sac"]) },
        names_of(&["sac", "left root"]),
    ] {
        let refusal = refusal(&delete(wrong.clone()), &scene());
        assert_eq!(refusal.code, Code::FailedPrecondition, "{wrong:?}");
        assert!(refusal.message.contains("sac, left root"), "{refusal}");
    }
}

#[test]
fn questions_are_answered_from_scene_and_frame() {
    let ask = |clause: &Clause, frame: Option<&Frame>| match commands::resolve(clause, &scene(), frame).unwrap() {
        Step::Answer { text, units } => (text, units),
        other => panic!("{other:?}"),
    };
    let frame = |revision| Frame {
        revision,
        coverage: 0.4,
        units: vec![UnitCoverage { unit: "leaves".into(), share: 0.25, mean_color: None }],
        ..Frame::default()
    };
    let (text, units) = ask(&clause(Act::Describe, names_of(&["leaf"])), Some(&frame(9)));
    assert_eq!(units, ["leaves"]);
    assert!(text.contains("10 % of the scene") && text.contains("covers 25 % of the picture"), "{text}");
    let (text, _) = ask(&clause(Act::Describe, names_of(&["leaf"])), Some(&frame(8)));
    assert!(!text.contains("covers"), "a frame of another revision is not used: {text}");
    let (text, _) = ask(&clause(Act::List, Reference::default()), None);
    assert!(text.contains("parent vessel") && text.contains("left root"), "{text}");
    let (text, _) = ask(&clause(Act::QuerySelection, Reference::default()), None);
    assert_eq!(text, "42 Gaussians are selected, 4.2 % of the scene.");
    let (text, _) = ask(&clause(Act::Help, Reference::default()), None);
    assert!(text.contains("make the parent vessel red"), "{text}");
    let everything = Reference { everything: true, ..Reference::default() };
    assert!(ask(&clause(Act::Describe, everything), Some(&frame(9))).0.contains("covers 40 % of the picture"));
}

#[test]
fn another_answer_is_asked_of_the_selection_service() {
    let more = Clause { act: Act::TakeAnswer.into(), answer: AnswerStep::Wider.into(), ..Clause::default() };
    let Ok(Step::Strokes(request)) = commands::resolve(&more, &scene(), None) else { panic!("no step") };
    assert_eq!(request, StrokesRequest { answer: AnswerStep::Wider.into(), ..StrokesRequest::default() });
    assert!(refusal(&more, &unselected()).message.contains("Nothing is selected"));
    let none = Clause { answer: 0, ..more };
    assert_eq!(refusal(&none, &scene()).code, Code::InvalidArgument);
    let step = |leak| Answer { leak, gaussians: 10, conductance: 0.1 };
    let reply = |taken| StrokesReply {
        summary: "10 of 80 Gaussians selected".to_owned(),
        answers: Some(Answers { steps: [1.0, 0.1, 0.01].map(step).to_vec(), first: 1, taken, tuning: None }),
        ..StrokesReply::default()
    };
    let said = [0, 1, 2].map(|taken| report::other_answer(&reply(taken)));
    assert_eq!(said[0], "10 of 80 Gaussians selected; this is the narrowest of 3 answers.");
    assert_eq!(said[1], "10 of 80 Gaussians selected; this is answer 2 of 3, from the narrowest.");
    assert_eq!(said[2], "10 of 80 Gaussians selected; this is the widest of 3 answers.");
}

#[test]
fn derived_units_are_found_but_not_offered() {
    assert_eq!(unit_names::addressable(&scene()), ["parent vessel", "leaves", "sac", "left root"]);
    assert_eq!(target(&names_of(&["all but sac"]), &scene()).unwrap().units, ["all but sac"]);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_clause_is_resolved_or_refused_in_one_line(
        act in -1..30_i32,
        names in prop::collection::vec("\\PC{0,12}|sac|leaf|parent vessel", 0..3),
        flags in any::<[bool; 4]>(),
        name in "\\PC{0,20}",
        amount in prop::option::of(any::<f64>()),
        operation in 0..6_i32,
        file in "\\PC{0,20}|sac.ply|~/a.png",
        empty in any::<bool>(),
    ) {
        let [selection, everything, complement, focus] = flags;
        let reference = Reference { names, selection, everything, complement, focus };
        let clause = Clause { act, name, amount, operation, file, ..clause(Act::Unspecified, reference) };
        let clause = Clause { act, ..clause };
        let state = if empty { State::default() } else { scene() };
        match commands::resolve(&clause, &state, None) {
            Err(refusal) => {
                prop_assert!(!refusal.message.contains('\n') && !refusal.message.is_empty());
                prop_assert!(refusal.code != Code::Unspecified);
            }
            Ok(Step::Change { units, .. }) => {
                let known = unit_names::all(&state);
                let given = clause.name.trim().to_owned();
                prop_assert!(units.iter().all(|u| known.contains(&u.as_str()) || *u == given), "{:?}", units);
            }
            Ok(Step::Answer { text, .. }) => prop_assert!(!text.is_empty()),
            Ok(Step::Save { request, .. }) => prop_assert!(request.content.is_some() && !request.replace),
            Ok(Step::Picture(wish)) => prop_assert!((1..=4).contains(&wish.scale)),
            Ok(Step::Open(request)) => prop_assert!(!request.path.is_empty()),
            Ok(Step::BestView(target)) => prop_assert!(target != Target::default()),
            Ok(Step::Tour { stops, .. }) => prop_assert!(stops.len() <= 32),
            Ok(Step::Strokes(request)) => prop_assert!(request.answer() != AnswerStep::Unspecified),
        }
    }
}

#[test]
fn files_are_asked_for_with_one_content_and_a_kind() {
    let file = |act: Act, target: Reference, file: &str| {
        let clause = Clause { file: file.to_owned(), ..clause(act, target) };
        commands::resolve(&clause, &scene(), None)
    };
    let choice = |part: GaussianPart, unit: &str| {
        Some(Content::Gaussians(GaussianChoice { part: part.into(), unit: unit.to_owned() }))
    };
    let exported = |target: Reference, name: &str| match file(Act::Export, target, name) {
        Ok(Step::Save { request, .. }) => (request.path, request.content, request.replace),
        other => panic!("{other:?}"),
    };
    let selection = || Reference { selection: true, ..Reference::default() };
    let everything = || Reference { everything: true, ..Reference::default() };
    assert_eq!(exported(names_of(&["Sac"]), "a.ply"), ("a.ply".into(), choice(GaussianPart::Unit, "sac"), false));
    assert_eq!(exported(selection(), ""), (String::new(), choice(GaussianPart::Selection, ""), false));
    assert_eq!(exported(everything(), "all").0, "all.ply");
    assert_eq!(exported(everything(), "all").1, choice(GaussianPart::Everything, ""));
    let refused = |act, target, name: &str| file(act, target, name).unwrap_err().message;
    assert!(refused(Act::Export, names_of(&["sac", "leaves"]), "").contains("export what is visible"));
    assert!(refused(Act::Export, Reference { complement: true, ..names_of(&["sac"]) }, "").contains("Hide the rest"));
    assert!(refused(Act::Export, names_of(&["dome"]), "").contains("Brush it"));
    assert!(refused(Act::SavePicture, Reference::default(), "view.jpg").contains(".png"));
    assert!(refused(Act::SaveCopy, Reference::default(), "copy.ply").contains(".sgproj"));
    assert!(refused(Act::Open, Reference::default(), " ").contains("no file"));
    let picture = Clause { amount: Some(9.0), ..clause(Act::SavePicture, Reference::default()) };
    assert!(commands::resolve(&picture, &scene(), None).unwrap_err().message.contains("1, 2, 3 or 4"));
}

/// Seen from the left side (-x), z up.
fn seen_from_the_side() -> State {
    let vector = |x, y, z| Some(Vector { x, y, z });
    let (eye, target, up) = (vector(-5.0, 0.0, 0.0), vector(0.0, 0.0, 0.0), vector(0.0, 0.0, 1.0));
    State { view: Some(View { eye, target, up, fov_y_degrees: 40.0 }), ..scene() }
}

fn moving(kind: Kind) -> Clause {
    Clause { movement: Some(Movement { kind: Some(kind) }), ..clause(Act::Transform, names_of(&["sac"])) }
}

fn shift(way: Way, distance: Option<f64>) -> Clause {
    moving(Kind::Shift(Shift { way: way.into(), distance, millimetres: true }))
}

#[test]
fn movements_are_those_of_the_picture_or_of_the_patient() {
    let state = seen_from_the_side();
    let plain = || TransformGaussians {
        target: Some(Target { units: vec!["sac".into()], ..Target::default() }),
        ..TransformGaussians::default()
    };
    // From -x, the right of the picture is -y.
    for (way, [x, y, z]) in [
        (Way::Right, [0.0, -5.0, 0.0]),
        (Way::Left, [0.0, 5.0, 0.0]),
        (Way::Up, [0.0, 0.0, 5.0]),
        (Way::Nearer, [-5.0, 0.0, 0.0]),
        (Way::Farther, [5.0, 0.0, 0.0]),
    ] {
        let Action::TransformGaussians(found) = action(&shift(way, Some(5.0)), &state) else { panic!() };
        let by = found.shift.unwrap();
        assert!([by.x - x, by.y - y, by.z - z].iter().all(|d| d.abs() < 1e-12), "{way:?}: {by:?}");
        assert_eq!((TransformGaussians { shift: None, ..found }), TransformGaussians { millimetres: true, ..plain() });
    }
    let front =
        TransformGaussians { towards: PatientSide::Anterior.into(), distance: 4.0, millimetres: true, ..plain() };
    assert_eq!(action(&shift(Way::Anterior, Some(4.0)), &state), Action::TransformGaussians(front));
    let turn = |way: Way, axis: Axis| Rotation { way: way.into(), axis: axis.into(), degrees: Some(30.0) };
    let axis = |clause: &Clause| match action(clause, &state) {
        Action::TransformGaussians(TransformGaussians { axis: Some(Vector { x, y, z }), degrees: 30.0, .. }) => {
            [x, y, z]
        }
        other => panic!("{other:?}"),
    };
    assert_eq!(axis(&moving(Kind::Rotation(turn(Way::Unspecified, Axis::PlusZ)))), [0.0, 0.0, 1.0]);
    assert_eq!(axis(&moving(Kind::Rotation(turn(Way::Right, Axis::Unspecified)))), [0.0, 0.0, 1.0]);
    let half = TransformGaussians { factor: Some(0.5), ..plain() };
    let scale = moving(Kind::Scale(Scale { factor: Some(0.5) }));
    assert_eq!(action(&scale, &state), Action::TransformGaussians(half));
    let back = TransformGaussians { restore: true, ..plain() };
    assert_eq!(action(&moving(Kind::PutBack(PutBack {})), &state), Action::TransformGaussians(back));
}

#[test]
fn a_movement_without_a_number_is_asked_for_it() {
    let asked = |clause: Clause| refusal(&clause, &scene()).message;
    assert!(asked(shift(Way::Left, None)).starts_with("How far? Say “move the sac 5 mm to the left”"));
    assert!(asked(shift(Way::Unspecified, Some(2.0))).starts_with("Which way? Say “move the sac 2 mm to the left”"));
    let turn = Rotation { way: Way::Left.into(), ..Rotation::default() };
    assert!(asked(moving(Kind::Rotation(turn))).starts_with("By how many degrees?"));
    assert!(asked(moving(Kind::Scale(Scale { factor: None }))).starts_with("To which size?"));
    let unknown =
        Clause { movement: shift(Way::Left, Some(1.0)).movement, ..clause(Act::Transform, names_of(&["dome"])) };
    assert!(asked(unknown).starts_with("Nothing is named “dome”"));
}

#[test]
fn units_merge_by_their_names_alone() {
    let merge = |names: &[&str], name: &str| Clause { name: name.into(), ..clause(Act::Merge, names_of(names)) };
    let merged = |units: &[&str], name: &str| {
        let units = units.iter().map(|u| (*u).to_owned()).collect();
        Action::MergeUnits(MergeUnits { units, name: name.into() })
    };
    assert_eq!(action(&merge(&["sac", "Left Root"], ""), &scene()), merged(&["sac", "left root"], ""));
    assert_eq!(action(&merge(&["leaves", "sac"], "both"), &scene()), merged(&["leaves", "sac"], "both"));
    assert_eq!(
        action(&merge(&["sac", "left root"], "Left root"), &scene()),
        merged(&["sac", "left root"], "Left root")
    );
    assert_eq!(refusal(&merge(&["sac", "left root"], "leaves"), &scene()).code, Code::AlreadyExists);
    assert_eq!(refusal(&merge(&["leaves", "sac"], "leaves"), &scene()).code, Code::AlreadyExists);
    for (clause, words) in [
        (merge(&["sac"], ""), "Say two names"),
        (merge(&["leaves", "sac"], ""), "is part of the scene file"),
        (clause(Act::Merge, Reference { selection: true, ..Reference::default() }), "Only units can be merged"),
    ] {
        let message = refusal(&clause, &scene()).message;
        assert!(message.contains(words), "{message}");
    }
}

#[test]
fn a_tone_out_of_range_is_told_with_its_range() {
    let tone = |tone: SetTone| Clause { tone: Some(tone), ..clause(Act::SetTone, names_of(&["sac"])) };
    let set = SetTone { saturation: Some(0.5), relative: true, ..SetTone::default() };
    let target = Some(Target { units: vec!["sac".into()], ..Target::default() });
    assert_eq!(action(&tone(set.clone()), &scene()), Action::SetTone(SetTone { target, ..set }));
    let wide = refusal(&tone(SetTone { brightness: Some(5.0), ..SetTone::default() }), &scene()).message;
    assert_eq!(wide, "Brightness goes from 0 to 400 %, and 100 % is as in the file.");
    assert!(
        refusal(&tone(SetTone { temperature: Some(2.0), ..SetTone::default() }), &scene())
            .message
            .contains("-1 (blue)")
    );
    assert!(refusal(&tone(SetTone::default()), &scene()).message.contains("has no saturation"));
}

/// A volume with values from `least` to `greatest` behind the scene, and a function of them.
fn volume(least: f64, greatest: f64) -> State {
    let function = TransferFunction { low: least, high: greatest, ..TransferFunction::default() };
    State { volume: Some(Volume { function: Some(function), least, greatest }), ..scene() }
}

#[test]
fn named_windows_are_for_hounsfield_units() {
    let change = |change| Clause {
        values: Some(AdjustTransferFunction { change: Some(change) }),
        ..Clause { act: Act::AdjustTransferFunction.into(), ..Clause::default() }
    };
    let said = ValueWindow { level: Some(1.0), window: Some(2.0), ..ValueWindow::default() };
    let bone = Clause { name: "bone window".to_owned(), ..change(Change::Window(said)) };
    let window = ValueWindow { level: Some(400.0), window: Some(1800.0), ..ValueWindow::default() };
    let set = AdjustTransferFunction { change: Some(Change::Window(window)) };
    assert_eq!(action(&bone, &volume(-1024.0, 3071.0)), Action::AdjustTransferFunction(set));
    let result = CommandResult { summary: "level 400, window 1,800".to_owned(), ..CommandResult::default() };
    let reply = report::action(&bone, &Action::AdjustTransferFunction(set), &scene(), &result);
    assert_eq!(reply, "Bone window: level 400, window 1,800.");
    let bytes = refusal(&bone, &volume(0.0, 255.0)).message;
    assert!(bytes.contains("Hounsfield units") && bytes.contains("from 0 to 255"), "{bytes}");
    assert!(refusal(&bone, &scene()).message.contains("keeps no values of a volume"));
    // Numbers are taken as they are.
    let plain = change(Change::Window(said));
    assert_eq!(action(&plain, &volume(0.0, 255.0)), Action::AdjustTransferFunction(plain.values.unwrap()));

    // Values at or below 0 have the logarithm that takes them.
    let scale = |state: &State| match action(&change(Change::Scale(ValueScale::Log10.into())), state) {
        Action::AdjustTransferFunction(AdjustTransferFunction { change: Some(Change::Scale(scale)) }) => scale,
        other => panic!("{other:?}"),
    };
    assert_eq!(scale(&volume(1.0, 255.0)), i32::from(ValueScale::Log10));
    assert_eq!(scale(&volume(0.0, 255.0)), i32::from(ValueScale::Symlog));

    let reset = Clause { act: Act::ResetTransferFunction.into(), ..Clause::default() };
    assert_eq!(action(&reset, &volume(0.0, 1.0)), Action::SetTransferFunction(SetTransferFunction { function: None }));
    assert!(refusal(&reset, &scene()).message.contains("keeps no values"));
    let described = sg_language::query::scene(&volume(-1024.0, 3071.0), None);
    assert!(described.contains("values from -1,024 to 3,071"), "{described}");
    assert!(refusal(&Clause { values: None, ..plain }, &volume(0.0, 1.0)).message.contains("has no change"));
}

#[test]
fn a_changed_transfer_function_is_told_in_a_sentence() {
    let result = CommandResult::default();
    let told = |change, color_name: &str| {
        let adjust = AdjustTransferFunction { change: Some(change) };
        let clause = Clause { color_name: color_name.to_owned(), values: Some(adjust), ..Clause::default() };
        report::action(&clause, &Action::AdjustTransferFunction(adjust), &scene(), &result)
    };
    let range = |low, high| ValueRange { low, high };
    assert_eq!(told(Change::ShowOnly(range(Some(1200.0), None)), ""), "Only values above 1,200 are shown now.");
    assert_eq!(told(Change::Hide(range(None, Some(-0.25))), ""), "Values below -0.25 are hidden now.");
    let blue = Some(Color { red: 0.0, green: 0.0, blue: 1.0 });
    let color = Change::Color(ValueColor { range: Some(range(Some(1.0), Some(2.0))), color: blue });
    assert_eq!(told(color, "Sea Blue"), "Values from 1 to 2 are now sea blue.");
    assert_eq!(told(color, ""), "Values from 1 to 2 are now blue.");
    assert!(told(Change::Scale(ValueScale::Symlog.into()), "").contains("linear around 0"));
}

#[test]
fn a_target_is_duplicated_under_a_free_name_and_the_copy_can_be_renamed() {
    let clause_of = |name: &str| Clause { name: name.into(), ..clause(Act::Duplicate, names_of(&["Left Root"])) };
    let duplicated = |name: &str| {
        let target = Some(Target { units: vec!["left root".to_owned()], ..Target::default() });
        Action::DuplicateGaussians(DuplicateGaussians { target, name: name.to_owned() })
    };
    assert_eq!(action(&clause_of(""), &scene()), duplicated(""));
    assert_eq!(action(&clause_of(" twin "), &scene()), duplicated("twin"));
    assert_eq!(refusal(&clause_of("Leaves"), &scene()).code, Code::AlreadyExists);
    let mut state = scene();
    let rename = Clause { name: "twin".into(), ..clause(Act::Rename, names_of(&["leaves"])) };
    assert!(refusal(&rename, &state).message.contains("is part of the scene file"));
    state.base_units.iter_mut().for_each(|unit| unit.duplicated = unit.name == "leaves");
    let renamed = RenameUnit { name: "leaves".into(), new_name: "twin".into() };
    assert_eq!(action(&rename, &state), Action::RenameUnit(renamed));
}

/// The scene with these viewpoints kept.
fn kept(names: &[&str]) -> State {
    let kept = |name: &&str| KeptView { name: (*name).to_owned(), ..KeptView::default() };
    State { kept_views: names.iter().map(kept).collect(), ..scene() }
}

fn to_kept(name: &str) -> Clause {
    let view = SetView { change: Some(set_view::Change::Kept(name.to_owned())) };
    Clause { act: Act::SetView.into(), view: Some(view), ..Clause::default() }
}

fn about_view(act: Act, name: &str) -> Clause {
    Clause { act: act.into(), name: name.to_owned(), ..Clause::default() }
}

#[test]
fn kept_viewpoints_are_found_as_units_are() {
    let state = kept(&["entry", "Front-left", "view 2"]);
    for (spoken, name) in [
        ("entry", "entry"),
        ("ENTRY", "entry"),
        ("the entries", "entry"),
        ("front left", "Front-left"),
        ("view 2", "view 2"),
    ] {
        let view = Some(set_view::Change::Kept(name.to_owned()));
        assert_eq!(action(&to_kept(spoken), &state), Action::SetView(SetView { change: view }), "{spoken}");
        let forget = ForgetView { name: name.to_owned() };
        assert_eq!(action(&about_view(Act::ForgetView, spoken), &state), Action::ForgetView(forget), "{spoken}");
    }
}

#[test]
fn an_unknown_viewpoint_is_refused_with_what_is_kept() {
    let state = kept(&["entry", "view 2"]);
    for clause in [to_kept("entra"), about_view(Act::ForgetView, "entra")] {
        let refusal = refusal(&clause, &state);
        assert_eq!(refusal.code, Code::NotFound);
        assert_eq!(refusal.message, "No viewpoint is kept as “entra”. Did you mean “entry”? Kept: entry, view 2.");
        assert_eq!(refusal.details, ["entry", "view 2"]);
    }
    let strange = refusal(&to_kept("weather"), &state).message;
    assert_eq!(strange, "No viewpoint is kept as “weather”. Kept: entry, view 2.");
    let none = refusal(&to_kept("entry"), &scene());
    assert_eq!((none.code, none.message.as_str()), (Code::NotFound, "Nothing is kept yet. Say “keep this view as …”."));
    let unclear = refusal(&to_kept("ENTRY"), &kept(&["entry", "Entry"]));
    assert_eq!(unclear.code, Code::InvalidArgument);
    assert!(unclear.message.contains("matches several viewpoints: “entry”, “Entry”"), "{unclear}");
    for clause in [to_kept(" "), about_view(Act::ForgetView, "")] {
        assert_eq!(refusal(&clause, &state).message, "The clause has no name of a viewpoint.");
    }
}

#[test]
fn a_viewpoint_is_kept_under_its_name_or_one_of_the_scenes_choice() {
    let keep = |name: &str, state: &State| action(&about_view(Act::KeepView, name), state);
    let made = |name: &str| Action::KeepView(KeepView { name: name.to_owned() });
    assert_eq!(keep("", &scene()), made(""));
    assert_eq!(keep(" home two ", &scene()), made("home two"));
    // A unit may have the same name, and other capitals replace.
    assert_eq!(keep("sac", &scene()), made("sac"));
    assert_eq!(keep("entry", &kept(&["Entry"])), made("Entry"));
    assert_eq!(keep("entry", &kept(&["Entry", "entry"])), made("entry"));
    assert_eq!(keep("entries", &kept(&["entry"])), made("entries"));
    assert_eq!(refusal(&about_view(Act::KeepView, &"n".repeat(200)), &scene()).code, Code::InvalidArgument);
}

#[test]
fn kept_viewpoints_are_listed() {
    let list = about_view(Act::ListViews, "");
    let listed = |state: &State| match commands::resolve(&list, state, None) {
        Ok(Step::Answer { text, units }) if units.is_empty() => text,
        other => panic!("{other:?}"),
    };
    assert_eq!(listed(&kept(&["entry", "view 2"])), "2 viewpoints are kept: “entry” and “view 2”.");
    assert_eq!(listed(&scene()), "Nothing is kept yet. Say “keep this view as …”.");
}
