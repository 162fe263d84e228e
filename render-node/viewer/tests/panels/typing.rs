//! Letters: the virtual keyboard, the field that they go to, and the messages to the agents.

use egui_kittest::kittest::Queryable;
use sg_proto::scene::command::Action;
use sg_proto::scene::{RenameUnit, SaveUnit};
use sg_viewer::display::{Request, ServiceAvailability};
use sg_viewer::panels::Panel;

use crate::scene_requests::changes;
use crate::stage::{Stage, harness, press};

#[test]
fn a_name_typed_by_pointing_saves_a_unit() {
    let mut stage = Stage::new(Panel::SELECT);
    stage.show.push(Panel::KEYBOARD);
    let mut panels = harness(stage);
    assert!(!panels.state().panels.is_typing());
    press(&mut panels, "name of the new unit");
    assert!(panels.state().panels.is_typing());
    for key in ["shift", "S", "a", "c", "space", "2", "-", "x", "back", "b", "left", "a", "right"] {
        press(&mut panels, key);
    }
    assert_eq!(panels.state().asked, [], "nothing is asked for while somebody types");
    press(&mut panels, "enter");
    let save = Action::SaveUnit(SaveUnit { name: "Sac 2-ab".to_owned(), replace: false });
    assert_eq!(changes(&panels.state().asked), [save]);
    assert!(!panels.state().panels.is_typing());
}

#[test]
fn the_keyboard_types_into_another_context() {
    let mut field = harness(Stage::new(Panel::SELECT));
    let mut keys = harness(Stage::new(Panel::KEYBOARD));
    press(&mut field, "name of the new unit");
    // One set of panels, drawn by turns in two contexts, as a headset does.
    let mut type_one = |field: &mut egui_kittest::Harness<'_, Stage>, key: &str| {
        assert!(field.state().panels.wants_drawing(Panel::KEYBOARD), "it shows what was typed");
        std::mem::swap(&mut field.state_mut().panels, &mut keys.state_mut().panels);
        keys.run();
        assert!(!keys.state().panels.wants_drawing(Panel::KEYBOARD));
        press(&mut keys, key);
        std::mem::swap(&mut field.state_mut().panels, &mut keys.state_mut().panels);
        assert!(field.state().panels.wants_drawing(Panel::SELECT), "a letter waits for it");
        field.run();
        assert!(!field.state().panels.wants_drawing(Panel::SELECT));
    };
    for key in ["n", "e", "w"] {
        type_one(&mut field, key);
    }
    type_one(&mut field, "enter");
    let save = Action::SaveUnit(SaveUnit { name: "new".to_owned(), replace: false });
    assert_eq!(changes(&field.state().asked), [save]);

    press(&mut field, "name of the new unit");
    assert!(field.state().panels.is_typing());
    type_one(&mut field, "done");
    assert!(!field.state().panels.is_typing());
    assert_eq!(changes(&field.state().asked).len(), 1);
}

#[test]
fn a_field_that_is_left_for_one_of_another_panel_is_done() {
    let mut scene = harness(Stage::new(Panel::SCENE));
    let mut language = harness(Stage::new(Panel::LANGUAGE));
    press(&mut scene, "sac");
    press(&mut scene, "rename");
    scene.get_by_label("new name").type_text(" 7");
    scene.run();
    scene.state_mut().asked.clear();
    std::mem::swap(&mut scene.state_mut().panels, &mut language.state_mut().panels);
    press(&mut language, "say");
    std::mem::swap(&mut scene.state_mut().panels, &mut language.state_mut().panels);
    assert!(scene.state().panels.wants_drawing(Panel::SCENE));
    scene.run();
    let renamed = Action::RenameUnit(RenameUnit { name: "sac".to_owned(), new_name: "sac 7".to_owned() });
    assert_eq!(changes(&scene.state().asked), [renamed]);
    assert!(scene.state().panels.is_typing(), "into the other field");
}

#[test]
fn keys_without_a_field_do_nothing() {
    let mut panel = harness(Stage::new(Panel::KEYBOARD));
    assert!(panel.query_by_label_contains("Point at a text field").is_some());
    press(&mut panel, "a");
    press(&mut panel, "enter");
    assert!(!panel.state().panels.is_typing());
    assert_eq!(panel.state().asked, []);
}

#[test]
fn a_conversation_is_read_gone_on_with_and_stopped() {
    let mut panel = harness(Stage::new(Panel::LANGUAGE));
    for text in ["how large is the neck?", "measure neck", "coloured sac #0072b2"] {
        assert!(panel.query_by_label(text).is_some(), "{text}");
    }
    assert_eq!(panel.query_all_by_label("Agent Commands").count(), 3);
    assert!(panel.query_by_label("waiting for an answer …").is_some());
    press(&mut panel, "send");
    assert_eq!(panel.state().asked, [], "there is nothing to send");
    press(&mut panel, "stop");
    let asked = |panel: &egui_kittest::Harness<'_, Stage>| -> Vec<Request> {
        panel.state().asked.iter().flat_map(|o| o.requests.clone()).collect()
    };
    assert_eq!(asked(&panel), [Request::Withdraw]);
    panel.state_mut().asked.clear();
    press(&mut panel, "say");
    panel.get_by_label("say").type_text("show only the sac");
    panel.run();
    assert_eq!(panel.state().asked, []);
    panel.key_press(egui::Key::Enter);
    panel.run();
    // The field still has the letters for a person who goes on typing.
    panel.get_by_label("say").type_text("and the neck");
    panel.run();
    press(&mut panel, "send");
    let said = ["show only the sac", "and the neck"].map(|text| Request::Say(text.to_owned()));
    assert_eq!(asked(&panel), said);

    let mut talk = (*panel.state().shown.conversation).clone();
    talk.turn("2").unwrap().answer = Some(("The neck has 80 Gaussians.".to_owned(), true));
    panel.state_mut().shown.conversation = std::sync::Arc::new(talk);
    panel.run();
    assert!(panel.query_by_label("stop").is_none(), "nothing is under way");
    panel.state_mut().shown.services =
        ServiceAvailability { scene: true, selection: true, agents: false, labeling: false };
    panel.run();
    assert!(panel.query_by_label("say").is_none() && panel.query_by_label("Language").is_none());
}
