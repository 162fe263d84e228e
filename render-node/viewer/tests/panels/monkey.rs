//! Random presses: the panels ask only for requests that the services offer, and the scene's owner accepts them.

use std::sync::Arc;

use egui::{Event, Key, Pos2, Role};
use egui_kittest::Harness;
use egui_kittest::kittest::{By, NodeT, Queryable};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sg_edit::EditError;
use sg_proto::labeling::{Candidate, FindReply, Outcome};
use sg_proto::language::TourStep;
use sg_proto::scene::command::Action;
use sg_scene::model::Scene;
use sg_viewer::display::{Answer, Drafts, Request, ServiceAvailability};
use sg_viewer::panels::{DisplayAction, Draft, Output, Panel};

use crate::stage::{Stage, docked, harness, press, scene};

/// Presses, drags, scrolls and types at random. Returns the outputs.
fn play(harness: &mut Harness<'_, Stage>, random: &mut ChaCha8Rng) -> Vec<Output> {
    let size = harness.ctx.content_rect().size();
    let control = |role: Role| matches!(role, Role::Button | Role::CheckBox | Role::Slider | Role::TextInput);
    let controls: Vec<_> =
        harness.query_all(By::new().predicate(|n| control(n.role()))).map(|n| n.rect().center()).collect();
    // Mostly onto a control, sometimes beside all of them.
    let at = |random: &mut ChaCha8Rng| match random.random_range(0..controls.len() + 5) {
        k if k < controls.len() => controls[k],
        _ => Pos2::new(random.random::<f32>() * size.x, random.random::<f32>() * size.y),
    };
    harness.state_mut().asked.clear();
    let first = at(random);
    match random.random_range(0..10) {
        0..6 => {
            harness.drag_at(first);
            harness.drop_at(first);
        }
        6..8 => {
            let second = at(random);
            harness.drag_at(first);
            harness.hover_at(Pos2::new(second.x, first.y));
            harness.drop_at(Pos2::new(second.x, first.y));
        }
        8 => {
            harness.event(Event::Text(["a", "Sac", " ", "ünit", "9"][random.random_range(0..5)].to_owned()));
            harness.key_press([Key::Enter, Key::Backspace, Key::Escape, Key::Tab][random.random_range(0..4)]);
        }
        _ => {
            harness.hover_at(first);
            let delta = egui::vec2(0.0, random.random_range(-300.0..300.0));
            let (unit, source) = (egui::MouseWheelUnit::Point, egui::MouseWheelSource::Wheel);
            let modifiers = egui::Modifiers::NONE;
            harness.event(Event::MouseWheel { unit, delta, modifiers, phase: egui::TouchPhase::Move, source });
        }
    }
    harness.step();
    harness.run_steps(1);
    std::mem::take(&mut harness.state_mut().asked)
}

/// A unit that a text may mean.
fn candidate(unit: &str) -> Candidate {
    Candidate { unit: unit.to_owned(), score: 0.5, ..Candidate::default() }
}

/// The scene owner's answer to a change. A refusal that a person can do nothing about is a fault of the panel.
fn take(harness: &mut Harness<'_, Stage>, scene: &Arc<Scene>, action: &Action) {
    let shown = &mut harness.state_mut().shown;
    match shown.scene.after(scene, action.clone()) {
        Ok(state) => {
            shown.scene = Arc::new(state);
            shown.selected = Arc::clone(shown.scene.selection().mask());
        }
        // A state alone knows no history; the scene's owner does.
        Err(EditError::NothingToUndo | EditError::NothingToRedo) => {}
        // Names are the person's own, and nothing may be left to look at.
        Err(EditError::NameTaken(_) | EditError::BaseUnit { .. } | EditError::NothingToSee(_)) => {}
        // Units overlap, so a unit that is free may share Gaussians with a locked one; the refusal names the one to unlock.
        Err(EditError::Locked(_)) => {}
        Err(error) => panic!("{action:?}: {error}"),
    }
}

#[test]
fn only_available_requests_are_sent_and_they_are_valid() {
    let scene = scene();
    let mut random = ChaCha8Rng::seed_from_u64(6);
    let (mut changes, mut held, mut selects, mut said, mut wished, mut tuned) = (0, 0, 0, 0, 0, 0);
    let mut questions = 0;
    let docked = docked();
    for round in 0..6 * docked.len() {
        let panel = docked[round % docked.len()];
        let services = if round < 3 * docked.len() {
            ServiceAvailability { scene: true, selection: true, agents: true, labeling: true }
        } else {
            ServiceAvailability {
                scene: random.random(),
                selection: random.random(),
                agents: random.random(),
                labeling: random.random(),
            }
        };
        let mut stage = Stage::new(panel);
        stage.shown.services = services;
        stage.panels.supported_actions = vec![DisplayAction::Fit, DisplayAction::Screenshot];
        if round % 4 < 2 {
            stage.walk();
        }
        if round % 2 == 1 {
            stage.show.push(Panel::KEYBOARD);
        }
        stage.height = Some(1500.0);
        let mut harness = harness(stage);
        harness.set_size(egui::vec2(harness.ctx.content_rect().width(), 1500.0));
        for part in ["Viewpoint", "Light and background", "History", "Made by commands", "Reach and Strictness"] {
            if harness.query_by_label(part).is_some() {
                press(&mut harness, part);
            }
        }
        for step in 0..250 {
            // Deleting, and selecting everything, end a walk.
            if round % 4 < 2 && step % 40 == 39 {
                let stage = harness.state_mut();
                stage.shown.selected = Arc::clone(stage.shown.scene.selection().mask());
                stage.walk();
            }
            for output in play(&mut harness, &mut random) {
                assert!(!matches!(output.draft, Some(Draft::Hold(_))) || services.scene);
                held += u32::from(matches!(output.draft, Some(Draft::Hold(_))));
                wished += output.actions.len();
                for request in output.requests {
                    match request {
                        Request::Change(action) => {
                            assert!(services.scene, "{action:?}");
                            changes += 1;
                            take(&mut harness, &scene, &action);
                        }
                        Request::Select(_) => {
                            assert!(services.selection);
                            selects += 1;
                        }
                        Request::Tour(step) => {
                            assert!(services.agents && services.labeling && step == TourStep::Start, "{step:?}");
                            said += 1;
                        }
                        Request::Say(_) | Request::Withdraw => {
                            assert!(services.agents);
                            said += 1;
                        }
                        Request::Tune(_) | Request::Propose(_) => {
                            assert!(harness.state().shown.tuning().is_some(), "there is a walk, and who does it again");
                            tuned += 1;
                        }
                        Request::Find { number, text } => {
                            assert!(services.labeling && !text.is_empty() && text.len() <= 512, "{text}");
                            questions += 1;
                            let units = ["sac", "vessel", "former"].map(candidate).to_vec();
                            let reply = FindReply { outcome: Outcome::Match.into(), units, ..FindReply::default() };
                            let labeling = Arc::make_mut(&mut harness.state_mut().shown.labeling);
                            labeling.take_found(Answer { number, result: Ok(reply) });
                        }
                        Request::Views { unit, .. } => {
                            let scene = &harness.state().shown.scene;
                            assert!(services.labeling);
                            assert!(unit.is_empty() || scene.names().any(|(name, _)| name == unit), "{unit}");
                            questions += 1;
                        }
                        Request::Speech(_) => said += 1,
                        Request::Sample(_) | Request::Forget => panic!("panels draw no strokes"),
                        Request::Open(..) | Request::Save(_) => panic!("panels open and save no file"),
                    }
                }
            }
        }
    }
    println!("{changes} changes, {held} drafts, {selects} selections, {tuned} tried, {said} said, {wished} wishes");
    println!("{questions} questions");
    assert!(changes > 100 && held > 20 && selects > 20 && tuned > 5 && said > 20 && wished > 0 && questions > 4);
}

#[test]
fn a_control_shows_its_draft_until_the_scene_confirms_it() {
    let scene = scene();
    let mut panel = harness(Stage::new(Panel::SCENE));
    let told = Arc::clone(&panel.state().shown.scene);
    let mut drafts = Drafts::default();
    let value =
        |panel: &Harness<'_, Stage>| panel.get_by_label("opacity of vessel").accesskit_node().numeric_value().unwrap();
    // One turn of a display's loop: draw, pass on the draft under the hand, show the scene with it.
    let mut turn = |panel: &mut Harness<'_, Stage>| {
        panel.step();
        let mut asked = Vec::new();
        for output in std::mem::take(&mut panel.state_mut().asked) {
            match output.draft {
                Some(Draft::Hold(action)) => drafts.hold(action),
                Some(Draft::Release(action)) => drafts.release(action, told.revision()),
                None => {}
            }
            asked.extend(output.requests);
        }
        panel.state_mut().shown.scene = drafts.over(&scene, &told);
        asked
    };
    let rect = panel.get_by_label("opacity of vessel").rect();
    let aim = egui::pos2(rect.left() + 0.3 * rect.width(), rect.center().y);
    panel.drag_at(rect.center());
    turn(&mut panel);
    panel.hover_at(aim);
    turn(&mut panel);
    turn(&mut panel);
    let under_the_hand = value(&panel);
    assert!((0.2..0.35).contains(&under_the_hand), "{under_the_hand}");
    panel.drop_at(aim);
    let mut asked = turn(&mut panel);
    for _ in 0..3 {
        asked.extend(turn(&mut panel));
        assert_eq!(value(&panel), under_the_hand, "it does not jump back while the scene takes its time");
    }
    assert_eq!(asked.len(), 1, "{asked:?}");
}
