//! Finding units by words, the best views of a unit, and the state of the labeling service.

use std::sync::Arc;

use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use glam::{DVec3, Vec3};
use sg_edit::EditState;
use sg_proto::labeling::{Candidate, FindReply, Outcome, ProposedRegion, RegionView, State, ViewsReply};
use sg_proto::scene::command::Action;
use sg_proto::scene::selection_step::Step;
use sg_proto::scene::{Mask, Select, SelectionStep, SetLock, SetOperation, SetView, Target, Vector, View, set_view};
use sg_proto::selection::StrokesRequest;
use sg_raster::render::{Quality, render};
use sg_scene::appearance::Appearance;
use sg_viewer::display::{Answer, Labeling, RegionViews, Request};
use sg_viewer::panels::Panel;

use crate::scene_requests::changes;
use crate::stage::{Stage, harness, press};

/// Scene control of a session with the labeling service, high enough for all of its parts.
fn labels() -> Harness<'static, Stage> {
    let mut stage = Stage::new(Panel::SCENE);
    stage.shown.services.labeling = true;
    stage.height = Some(2400.0);
    let mut harness = harness(stage);
    harness.set_size(egui::vec2(Panel::SCENE.size.x, 2400.0));
    harness.run();
    harness
}

/// Scene control with an answer and the best views of what it found, as the documents show it.
pub(crate) fn answered(pixels_per_point: f32) -> Harness<'static, Stage> {
    let mut stage = Stage::new(Panel::SCENE);
    stage.shown.services.labeling = true;
    stage.pixels_per_point = pixels_per_point;
    let state = State {
        method: "labels and looks".to_owned(),
        image_encoder: "clip-vit-base-patch32".to_owned(),
        units: 4,
        pending: 1,
        embedded: ["vessel", "tissue", "sac"].map(str::to_owned).to_vec(),
        ..State::default()
    };
    Arc::make_mut(&mut stage.shown.labeling).state = Some(Arc::new(state));
    let mut panel = harness(stage);
    let number = ask(&mut panel, "pouch");
    found(&mut panel, number, reply(Outcome::Match, &[("sac", 0.87)], ""));
    press(&mut panel, "candidate sac");
    let (number, _) = asks_for_views(&mut panel);
    let views = [DVec3::new(1.0, 0.6, 1.0), DVec3::new(-1.0, 0.4, 0.8), DVec3::new(0.1, 1.2, 0.2), DVec3::NEG_Z];
    let state = Arc::clone(&panel.state().shown.scene);
    let views = views.map(|direction| drawn(&state, "sac", direction)).to_vec();
    pictured(&mut panel, number, views);
    panel
}

/// A picture of a unit alone from a direction.
fn drawn(state: &EditState, unit: &str, direction: DVec3) -> RegionView {
    let scene = crate::stage::scene();
    let members = Arc::clone(&state.units().find(|known| known.name == unit).unwrap().mask);
    let alone = state.edited_placed(&scene, &members).unwrap();
    let middle = 0.5 * (alone.bounds.min + alone.bounds.max);
    let view = sg_scene::view::View {
        eye: middle + 2.2 * alone.bounds.longest_edge() * direction.normalize(),
        target: middle,
        up: if direction.y.abs() > 1.0 { DVec3::Z } else { DVec3::Y },
        fov_y_degrees: 40.0,
    };
    let look = Appearance { background: Vec3::splat(0.07), ..Appearance::of(&alone) };
    let image = render(&alone, &look, &view.camera(128, 128), Quality::Standard).unwrap().image;
    let mut picture = Vec::new();
    image.write_png(&mut picture).unwrap();
    RegionView { picture, ..seen(0.0) }
}

fn is_there(panel: &Harness<'_, Stage>, label: &str) -> bool {
    panel.query_by_label(label).is_some()
}

/// The requests since the last call.
fn asked(panel: &mut Harness<'_, Stage>) -> Vec<Request> {
    std::mem::take(&mut panel.state_mut().asked).into_iter().flat_map(|output| output.requests).collect()
}

/// Types a text behind the one that is there, and presses Enter; returns the number of the question.
fn ask(panel: &mut Harness<'_, Stage>, text: &str) -> u64 {
    press(panel, "words for units");
    panel.get_by_label("words for units").type_text(text);
    panel.run();
    assert_eq!(asked(panel), [], "nothing is asked for while somebody types");
    panel.key_press(egui::Key::Enter);
    panel.run();
    match asked(panel).as_slice() {
        [Request::Find { number, text: sent }] if sent.ends_with(text) => *number,
        other => panic!("{other:?}"),
    }
}

/// The service tells something.
fn told(panel: &mut Harness<'_, Stage>, what: impl FnOnce(&mut Labeling)) {
    what(Arc::make_mut(&mut panel.state_mut().shown.labeling));
    panel.run();
}

fn reply(outcome: Outcome, units: &[(&str, f64)], reason: &str) -> FindReply {
    let candidate = |(unit, score): &(&str, f64)| Candidate {
        unit: (*unit).to_owned(),
        score: *score,
        explanation: format!("synonym: pouch ~ {unit}"),
        inferred: true,
    };
    let units = units.iter().map(candidate).collect();
    FindReply { outcome: outcome.into(), units, reason: reason.to_owned(), ..FindReply::default() }
}

fn found(panel: &mut Harness<'_, Stage>, number: u64, reply: FindReply) {
    told(panel, |labeling| labeling.take_found(Answer { number, result: Ok(reply) }));
}

fn selects(units: &[&str]) -> Action {
    let units = units.iter().map(|name| (*name).to_owned()).collect();
    let target = Some(Target { units, ..Target::default() });
    Action::Select(Select { target, operation: SetOperation::Replace.into() })
}

#[test]
fn the_answer_is_listed_with_scores_and_a_press_selects_the_unit() {
    let mut panel = labels();
    press(&mut panel, "find");
    assert_eq!(asked(&mut panel), [], "there is nothing to look for");
    let number = ask(&mut panel, "pouch");
    assert!(is_there(&panel, "“pouch” …"));
    found(&mut panel, number, reply(Outcome::Match, &[("sac", 0.87), ("vessel", 0.34)], ""));
    for label in ["“pouch”: 2 matches", "87 %", "34 %", "Synonym: pouch ~ sac", "Synonym: pouch ~ vessel"] {
        assert!(is_there(&panel, label), "{label}");
    }
    assert!(!is_there(&panel, "“pouch” …") && !is_there(&panel, "unit, 180 Gaussians (18 %)"));
    press(&mut panel, "candidate sac");
    assert_eq!(changes(&std::mem::take(&mut panel.state_mut().asked)), [selects(&["sac"])]);
    assert!(is_there(&panel, "unit, 180 Gaussians (18 %)"), "its row is open");
    press(&mut panel, "select all 2");
    assert_eq!(changes(&std::mem::take(&mut panel.state_mut().asked)), [selects(&["sac", "vessel"])]);
}

#[test]
fn a_locked_unit_is_only_chosen_and_one_that_is_gone_cannot_be_pressed() {
    let mut panel = labels();
    let target = Some(Target { units: vec!["sac".to_owned()], ..Target::default() });
    let lock = Action::SetLock(SetLock { target, locked: true });
    let locked = panel.state().shown.scene.after(&crate::stage::scene(), lock).unwrap();
    panel.state_mut().shown.scene = Arc::new(locked);
    let number = ask(&mut panel, "pouch");
    found(&mut panel, number, reply(Outcome::Match, &[("sac", 0.9), ("former", 0.5), ("neck", 0.25)], ""));
    assert!(panel.query_by_label_contains("select all").is_none(), "one alone can be selected");
    press(&mut panel, "candidate former");
    assert_eq!(asked(&mut panel), []);
    press(&mut panel, "candidate sac");
    assert_eq!(asked(&mut panel), []);
    assert!(is_there(&panel, "unit, 180 Gaussians (18 %)"));
    press(&mut panel, "candidate neck");
    assert_eq!(changes(&std::mem::take(&mut panel.state_mut().asked)), [selects(&["neck"])]);
}

#[test]
fn an_ambiguity_is_a_question_and_no_match_has_a_reason() {
    let mut panel = labels();
    let number = ask(&mut panel, "a");
    found(&mut panel, number, reply(Outcome::Ambiguous, &[("sac", 0.5), ("neck", 0.4)], ""));
    assert!(is_there(&panel, "“a”: which one?") && is_there(&panel, "candidate neck"));
    assert!(!is_there(&panel, "select all 2"), "it is one of them");
    let number = ask(&mut panel, "b");
    found(&mut panel, number, reply(Outcome::Ambiguous, &[("sac", 0.5)], ""));
    assert!(is_there(&panel, "“ab”: likely, not sure"));
    let number = ask(&mut panel, "c");
    found(&mut panel, number, reply(Outcome::NoMatch, &[], "no unit is like “abc”"));
    assert!(is_there(&panel, "“abc”: no unit is like “abc”") && !is_there(&panel, "candidate sac"));
    let number = ask(&mut panel, "d");
    found(&mut panel, number, reply(Outcome::NoMatch, &[("sac", 0.1)], "no unit is like “abcd”"));
    assert!(is_there(&panel, "“abcd”: no unit is like “abcd”; the likeliest is"));
    let number = ask(&mut panel, "e");
    told(&mut panel, |labeling| labeling.take_found(Answer { number, result: Err("it is busy".to_owned()) }));
    assert!(is_there(&panel, "It is busy") && !is_there(&panel, "candidate sac"));
}

#[test]
fn a_region_that_nobody_has_named_is_selected_by_a_press() {
    let mut panel = labels();
    let number = ask(&mut panel, "red part");
    let members = Some(Mask { length: 9, bits: vec![0b11, 0] });
    let region =
        ProposedRegion { members: members.clone(), gaussians: 1234, score: 0.91, explanation: "looks red".into() };
    let reply =
        FindReply { regions: vec![region], ..reply(Outcome::NoMatch, &[("sac", 0.1)], "nothing looks \"red\"") };
    found(&mut panel, number, reply);
    for label in ["“red part”: nothing looks \"red\"; it may be a part without a name", "91 %", "Looks red"] {
        assert!(is_there(&panel, label), "{label}");
    }
    assert!(!is_there(&panel, "candidate sac"), "the likeliest unit is not likely");
    press(&mut panel, "candidate region of 1,234 Gaussians");
    let steps = vec![SelectionStep { step: members.map(Step::Mask) }];
    let expected = StrokesRequest { restart: true, steps, ..StrokesRequest::default() };
    assert_eq!(asked(&mut panel), [Request::Select(expected)]);
}

#[test]
fn a_late_answer_to_an_older_question_is_not_shown() {
    let mut panel = labels();
    let first = ask(&mut panel, "a");
    let second = ask(&mut panel, "b");
    assert!(second > first);
    found(&mut panel, first, reply(Outcome::Match, &[("sac", 0.87)], ""));
    assert!(!is_there(&panel, "candidate sac") && is_there(&panel, "“ab” …"));
    told(&mut panel, |labeling| {
        labeling.take_found(Answer { number: first, result: Err("it is busy".to_owned()) });
    });
    assert!(!is_there(&panel, "It is busy") && is_there(&panel, "“ab” …"));
    found(&mut panel, second, reply(Outcome::Match, &[("neck", 0.87)], ""));
    assert!(is_there(&panel, "candidate neck") && is_there(&panel, "“ab”: 1 match"));
    // Panels that are new at a display do not take an answer to those before for their own.
    let kept = Arc::clone(&panel.state().shown.labeling);
    let mut other = labels();
    other.state_mut().shown.labeling = kept;
    other.run();
    assert!(!is_there(&other, "candidate neck"));
    assert!(ask(&mut other, "c") > second);
    assert!(!is_there(&other, "candidate neck"));
}

#[test]
fn questions_and_lists_are_bounded() {
    let mut panel = labels();
    press(&mut panel, "words for units");
    panel.get_by_label("words for units").type_text(&"…".repeat(171));
    panel.run();
    panel.key_press(egui::Key::Enter);
    panel.run();
    press(&mut panel, "find");
    assert_eq!(asked(&mut panel), [], "513 bytes are too many");
    press(&mut panel, "like this");
    let [Request::Find { number, text }] = &asked(&mut panel)[..] else { panic!() };
    assert_eq!(text, "things like this");
    found(&mut panel, *number, reply(Outcome::Match, &[("sac", 0.5); 100], ""));
    assert!(is_there(&panel, "and 36 more") && is_there(&panel, "“things like this”: 100 matches"));
    // Without a selection there is nothing to be like.
    let state = crate::stage::after(&crate::stage::scene(), []);
    panel.state_mut().shown.selected = Arc::clone(state.selection().mask());
    panel.state_mut().shown.scene = state;
    panel.run();
    assert!(!is_there(&panel, "like this") && !is_there(&panel, "best views"));
}

/// A view from this place, with a picture of one colour.
fn seen(x: f64) -> RegionView {
    let mut picture = Vec::new();
    let mut encoder = png::Encoder::new(&mut picture, 4, 4);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(&[90; 3 * 16]).unwrap();
    writer.finish().unwrap();
    let eye = Some(Vector { x, y: 0.0, z: 0.0 });
    let view = Some(View { eye, fov_y_degrees: 40.0, ..View::default() });
    RegionView { view, entropy: 0.75, unhidden: 0.5, picture, ..RegionView::default() }
}

/// The question for views that a press asks for: its number, and the name of the unit.
fn asks_for_views(panel: &mut Harness<'_, Stage>) -> (u64, String) {
    panel.state_mut().asked.clear();
    press(panel, "best views");
    match asked(panel).as_slice() {
        [Request::Views { number, unit }] => (*number, unit.clone()),
        other => panic!("{other:?}"),
    }
}

fn pictured(panel: &mut Harness<'_, Stage>, number: u64, views: Vec<RegionView>) {
    let views = RegionViews::of(&ViewsReply { views, ..ViewsReply::default() });
    told(panel, |labeling| labeling.take_views(Answer { number, result: Ok(views) }));
}

#[test]
fn best_views_are_pictures_that_lead_there() {
    let mut panel = labels();
    let textures = |panel: &Harness<'_, Stage>| panel.ctx.tex_manager().read().num_allocated();
    let before = textures(&panel);
    let (number, unit) = asks_for_views(&mut panel);
    assert_eq!(unit, "", "no unit is chosen: the selection");
    assert!(is_there(&panel, "Drawing views of the selection …"));
    pictured(&mut panel, number, (0..6).map(|k| seen(f64::from(k))).collect());
    assert!(is_there(&panel, "Best views of the selection"));
    assert!(is_there(&panel, "view 4") && !is_there(&panel, "view 5"), "four at most");
    assert_eq!(textures(&panel), before + 4);
    press(&mut panel, "view 2");
    let there = Action::SetView(SetView { change: seen(1.0).view.map(set_view::Change::View) });
    assert_eq!(changes(&std::mem::take(&mut panel.state_mut().asked)), [there]);
    panel.run();
    assert_eq!(textures(&panel), before + 4, "made once");

    press(&mut panel, "sac");
    let (number, unit) = asks_for_views(&mut panel);
    assert_eq!(unit, "sac");
    assert!(!is_there(&panel, "view 1"), "the pictures of another region go");
    assert_eq!(textures(&panel), before);
    let broken = RegionView { picture: b"no picture".to_vec(), ..seen(2.0) };
    pictured(&mut panel, number, vec![seen(1.0), broken]);
    assert!(is_there(&panel, "view 2") && panel.query_by_label_contains("The picture is no PNG file").is_some());
    assert_eq!(textures(&panel), before + 1);

    panel.state_mut().shown.services.scene = false;
    panel.run();
    panel.state_mut().asked.clear();
    press(&mut panel, "view 1");
    assert_eq!(asked(&mut panel), [], "nobody moves the scene's view");
    panel.state_mut().shown.services.labeling = false;
    panel.run();
    assert!(!is_there(&panel, "view 1"));
    assert_eq!(textures(&panel), before);
}

#[test]
fn a_failed_question_for_views_says_why() {
    let mut panel = labels();
    let (number, _) = asks_for_views(&mut panel);
    told(&mut panel, |labeling| labeling.take_views(Answer { number, result: Err("it is busy".to_owned()) }));
    assert!(is_there(&panel, "It is busy") && !is_there(&panel, "Drawing views of the selection …"));
    let (number, _) = asks_for_views(&mut panel);
    assert!(!is_there(&panel, "It is busy"));
    pictured(&mut panel, number, Vec::new());
    assert!(is_there(&panel, "Nothing is seen of the selection"));
}

#[test]
fn the_state_of_the_service_is_told() {
    let mut panel = labels();
    let mut state = State { method: "labels and looks".to_owned(), units: 5, pending: 2, ..State::default() };
    state.embedded = ["sac", "neck", "vessel"].map(str::to_owned).to_vec();
    let tells = state.clone();
    told(&mut panel, |labeling| labeling.state = Some(Arc::new(tells)));
    assert!(is_there(&panel, "Labels and looks") && panel.query_by_label_contains("embedded").is_none());
    state.image_encoder = "a small image encoder".to_owned();
    let tells = state.clone();
    told(&mut panel, |labeling| labeling.state = Some(Arc::new(tells)));
    assert!(is_there(&panel, "pictures: 3 of 5 units embedded"));
    state.embedded_regions = 12;
    told(&mut panel, |labeling| labeling.state = Some(Arc::new(state)));
    assert!(is_there(&panel, "pictures: 3 of 5 units embedded, and 12 parts"));
}

#[test]
fn nothing_is_drawn_without_the_service() {
    let mut panel = labels();
    let number = ask(&mut panel, "pouch");
    found(&mut panel, number, reply(Outcome::Match, &[("sac", 0.87)], ""));
    let state = State { method: "labels and looks".to_owned(), ..State::default() };
    told(&mut panel, |labeling| labeling.state = Some(Arc::new(state)));
    press(&mut panel, "words for units");
    assert!(panel.state().panels.is_typing());
    panel.state_mut().shown.services.labeling = false;
    panel.run();
    for label in ["Find", "words for units", "find", "candidate sac", "like this", "best views", "Labels and looks"] {
        assert!(!is_there(&panel, label), "{label}");
    }
    assert!(!panel.state().panels.is_typing(), "no letters go to a field that is not there");
    panel.state_mut().shown.services.labeling = true;
    panel.run();
    assert!(is_there(&panel, "Find") && !is_there(&panel, "candidate sac"), "an answer of before is not kept");
}
