//! The microphone in the panels and by its key: lamp, push-to-talk, mute, stop.

use std::path::Path;
use std::sync::Arc;

use egui::{Key, Modifiers};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use sg_proto::speech::{Control, Phase, State, Trigger};
use sg_viewer::display::Request;
use sg_viewer::panels::Panel;
use sg_viewer::window::MouseTool;

use crate::picture::Canvas;
use crate::stage::{Stage, harness, microphone, press};
use crate::window_ui::desk;

/// The controls that were asked for since the last call.
fn asked(panel: &mut Harness<'_, Stage>) -> Vec<Control> {
    let outputs = std::mem::take(&mut panel.state_mut().asked);
    let control = |request| if let Request::Speech(control) = request { control } else { panic!("{request:?}") };
    outputs.into_iter().flat_map(|output| output.requests).map(control).collect()
}

fn panel(of: Panel, state: State) -> Harness<'static, Stage> {
    let mut stage = Stage::new(of);
    stage.shown.speech = Some(Arc::new(state));
    harness(stage)
}

fn is_there(panel: &Harness<'_, Stage>, label: &str) -> bool {
    panel.query_by_label(label).is_some()
}

#[test]
fn a_button_talks_while_it_is_held() {
    for of in [Panel::LANGUAGE, Panel::WRIST] {
        let mut panel = panel(of, microphone(Phase::Idle));
        panel.run();
        let at = panel.get_by_label("talk").rect().center();
        panel.drag_at(at);
        panel.run();
        assert_eq!(asked(&mut panel), [Control::Press], "{of:?}");
        panel.run();
        assert_eq!(asked(&mut panel), [], "{of:?}: held");
        panel.drop_at(at);
        panel.run();
        assert_eq!(asked(&mut panel), [Control::Release], "{of:?}");
    }
}

#[test]
fn the_lamp_says_what_happens_and_offers_what_can_be_done() {
    for (phase, word) in [
        (Phase::Idle, "ready"),
        (Phase::Listening, "listening"),
        (Phase::Thinking, "thinking"),
        (Phase::Speaking, "speaking"),
    ] {
        let mut panel = panel(Panel::LANGUAGE, microphone(phase));
        panel.run();
        assert!(is_there(&panel, word), "{phase:?}");
        assert_eq!(is_there(&panel, "stop speaking"), phase == Phase::Speaking);
        if phase == Phase::Speaking {
            press(&mut panel, "stop speaking");
            assert_eq!(asked(&mut panel), [Control::StopSpeaking]);
        }
        press(&mut panel, "mute");
        assert_eq!(asked(&mut panel), [Control::Mute]);
        if let (Some(canvas), Some(folder)) = (Canvas::open(), std::env::var_os("PANEL_PICTURES")) {
            canvas.draw(&panel).write(&Path::new(&folder).join(format!("microphone-{word}.png")));
        }
    }
    let mut muted = panel(Panel::LANGUAGE, State { muted: true, ..microphone(Phase::Muted) });
    muted.run();
    assert!(is_there(&muted, "muted") && !is_there(&muted, "talk"));
    press(&mut muted, "unmute");
    assert_eq!(asked(&mut muted), [Control::Unmute]);
}

#[test]
fn a_question_stands_before_a_notice() {
    let question = "Did you say “delete the sac”? Say yes or no.";
    let state = State { question: question.to_owned(), ..microphone(Phase::Idle) };
    let mut panel = panel(Panel::LANGUAGE, state);
    panel.run();
    assert!(is_there(&panel, question) && !is_there(&panel, &microphone(Phase::Idle).notice));
}

#[test]
fn without_a_microphone_nothing_is_offered() {
    let deaf = State { input: String::new(), notice: "no microphone: …".to_owned(), ..microphone(Phase::Idle) };
    let mut panel = panel(Panel::LANGUAGE, deaf);
    panel.run();
    assert!(is_there(&panel, "no microphone") && is_there(&panel, "no microphone: …"));
    assert!(!is_there(&panel, "talk") && !is_there(&panel, "mute"));
}

#[test]
fn the_key_talks_while_it_is_held_and_only_where_a_microphone_waits_for_it() {
    let folder = tempfile::tempdir().unwrap();
    let (mut harness, service) = desk(MouseTool::Navigate, folder.path());
    harness.step();
    for (trigger, expected) in [
        (Some(Trigger::Held), vec![Control::Press, Control::Release]),
        (Some(Trigger::Voice), Vec::new()),
        (None, Vec::new()),
    ] {
        let state = trigger.map(|trigger| Arc::new(State { trigger: trigger.into(), ..microphone(Phase::Idle) }));
        service.writer.update(|shown| shown.speech.clone_from(&state));
        harness.step();
        service.requests.try_iter().for_each(drop);
        for pressed in [true, true, false] {
            harness.input_mut().events.push(egui::Event::Key {
                key: Key::Space,
                physical_key: None,
                pressed,
                repeat: false,
                modifiers: Modifiers::NONE,
            });
            harness.step();
        }
        let asked: Vec<Request> = service.requests.try_iter().collect();
        assert_eq!(asked, expected.into_iter().map(Request::Speech).collect::<Vec<_>>(), "{trigger:?}");
    }
}
