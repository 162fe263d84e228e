//! The Select panel: brush, operations on the selection, saving.

use std::sync::Arc;

use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use sg_proto::scene::command::Action;
use sg_proto::scene::selection_operation::Operation;
use sg_proto::scene::selection_step::Step;
use sg_proto::scene::{
    Combine, DeleteGaussians, DuplicateGaussians, RestoreGaussians, SaveUnit, Select, SetOperation, SetView, Target,
    set_view,
};
use sg_proto::selection::{AnswerStep, ProposalsReply, StrokesRequest};
use sg_scene::mask::Mask;
use sg_viewer::display::{BrushMode, Request, ServiceAvailability, Tools, WalkParameter};
use sg_viewer::panels::{DisplayAction, Panel, PanelHost};

use crate::scene_requests::changes;
use crate::stage::{Stage, after, harness, press};

fn prompt() -> Harness<'static, Stage> {
    harness(Stage::new(Panel::SELECT))
}

/// The request to the selection of a press on this.
#[track_caller]
fn asks(harness: &mut Harness<'_, Stage>, label: &str) -> StrokesRequest {
    harness.state_mut().asked.clear();
    press(harness, label);
    let asked: Vec<_> = harness.state().asked.iter().flat_map(|o| o.requests.clone()).collect();
    let [Request::Select(request)] = asked.as_slice() else { panic!("{label}: {asked:?}") };
    request.clone()
}

fn operation(request: &StrokesRequest) -> (Operation, Combine) {
    assert!(!request.restart && request.strokes.is_empty());
    let [step] = request.steps.as_slice() else { panic!("{request:?}") };
    let Some(Step::Operation(operation)) = &step.step else { panic!("{request:?}") };
    (operation.operation.clone().unwrap(), operation.combine())
}

#[test]
fn the_brush_is_set_for_this_display() {
    let mut panel = prompt();
    for mode in [BrushMode::Cluster, BrushMode::Point, BrushMode::Walk] {
        press(&mut panel, mode.name());
        assert_eq!(panel.state().tools.mode, mode);
    }
    press(&mut panel, "pressure of the trigger narrows the brush");
    assert!(panel.state().tools.pressure);
    let slider = panel.get_by_label("brush width").rect();
    panel.drag_at(slider.right_center() - egui::vec2(2.0, 0.0));
    panel.run();
    panel.drop_at(slider.right_center() - egui::vec2(2.0, 0.0));
    panel.run();
    assert!(panel.state().tools.radius > 0.2 && panel.state().tools.radius <= Tools::RADII.1);
    assert_eq!(panel.state().asked, []);
    panel.state_mut().panels.host = PanelHost::Window;
    panel.run();
    assert!(panel.query_by_label_contains("pressure").is_none(), "a mouse has none");
}

#[test]
fn the_selection_is_counted_and_highlighted() {
    let mut panel = prompt();
    assert!(panel.query_by_label("80 of 1,000 Gaussians (8 %)").is_some());
    assert!(panel.query_by_label_contains("Updating").is_none());
    panel.state_mut().shown.uncommitted = true;
    panel.run();
    assert!(panel.query_by_label_contains("Updating").is_some());
    press(&mut panel, "colour of the selection");
    press(&mut panel, "yellow");
    let tools = &panel.state().tools;
    assert!(tools.highlight.x > 0.9 && tools.highlight.z < 0.3, "{:?}", tools.highlight);
    assert_eq!(panel.state().asked, []);
}

#[test]
fn operations_are_steps_of_the_selection() {
    let mut panel = prompt();
    let cleared = asks(&mut panel, "clear");
    assert!(cleared.restart && cleared.steps.is_empty() && cleared.strokes.is_empty());
    let mut of = |label: &str| operation(&asks(&mut panel, label));
    assert!(matches!(of("invert"), (Operation::Invert(_), Combine::Unspecified)));
    assert!(matches!(of("largest piece"), (Operation::LargestPieces(p), Combine::Unspecified) if p.keep == 1));
    assert!(matches!(of("grow"), (Operation::Grow(g), Combine::Unspecified) if g.distance == 0.005));
    assert!(matches!(of("shrink"), (Operation::Shrink(g), Combine::Unspecified) if g.distance == 0.005));
    assert!(matches!(of("fill holes"), (Operation::FillHoles(h), Combine::Unspecified) if h.most == 100));
    assert!(matches!(of("add similar"), (Operation::Similar(s), Combine::Add) if s.threshold == 2.0));

    // An empty selection cannot grow, but it can be inverted.
    panel.state_mut().shown.selected = Arc::new(Mask::empty(1000));
    panel.state_mut().asked.clear();
    for label in ["clear", "largest piece", "grow", "shrink", "fill holes", "add similar"] {
        press(&mut panel, label);
        assert_eq!(panel.state().asked, [], "{label}");
    }
    assert!(matches!(operation(&asks(&mut panel, "invert")), (Operation::Invert(_), _)));
}

#[test]
fn the_selection_is_framed_where_there_is_one() {
    let mut panel = prompt();
    let focus = set_view::Change::Focus(Target { selection: true, ..Target::default() });
    let framed = Action::SetView(SetView { change: Some(focus) });
    press(&mut panel, "frame selection");
    assert_eq!(changes(&panel.state().asked), std::slice::from_ref(&framed));
    // The scene accepts it.
    panel.state().shown.scene.after(&crate::stage::scene(), framed).unwrap();

    // A selection that the scene has not stored is nothing to look at, and the button says why it is disabled.
    panel.state_mut().asked.clear();
    panel.state_mut().shown.scene = after(&crate::stage::scene(), []);
    panel.run();
    press(&mut panel, "frame selection");
    assert_eq!(panel.state().asked, []);
    panel.get_by_label("frame selection").hover();
    panel.run_steps(60);
    assert!(panel.query_by_label_contains("nothing is selected").is_some());

    panel.state_mut().shown.services.scene = false;
    panel.run();
    assert!(panel.query_by_label("frame selection").is_none(), "the scene frames it");
}

#[test]
fn the_selection_is_deleted_cropped_to_and_restored() {
    let mut panel = prompt();
    let target = |complement| Some(Target { selection: true, complement, ..Target::default() });
    let delete = |complement| Action::DeleteGaussians(DeleteGaussians { target: target(complement) });
    for (label, complement, left) in [("delete", false, 920), ("crop", true, 80)] {
        panel.state_mut().asked.clear();
        press(&mut panel, label);
        assert_eq!(changes(&panel.state().asked), [delete(complement)], "{label}");
        let after = panel.state().shown.scene.after(&crate::stage::scene(), delete(complement)).unwrap();
        assert_eq!(after.existing_count(), left, "{label}");
    }
    assert!(panel.query_by_label("restore deleted").is_none(), "nothing is deleted yet");

    // After the deletion its Gaussians are not counted, and the rest of them can be selected.
    let after = Arc::new(panel.state().shown.scene.after(&crate::stage::scene(), delete(false)).unwrap());
    panel.state_mut().shown.selected = Arc::clone(after.selection().mask());
    panel.state_mut().shown.scene = Arc::clone(&after);
    panel.state_mut().asked.clear();
    panel.run();
    assert!(panel.query_by_label("0 of 920 Gaussians selected").is_some());
    for label in ["delete", "crop"] {
        press(&mut panel, label);
        assert_eq!(panel.state().asked, [], "{label}: nothing is selected");
    }
    press(&mut panel, "restore deleted");
    let restore = Action::RestoreGaussians(RestoreGaussians {});
    assert_eq!(changes(&panel.state().asked), std::slice::from_ref(&restore));
    assert_eq!(after.after(&crate::stage::scene(), restore).unwrap().existing_count(), 1000);
    panel.state_mut().asked.clear();
    press(&mut panel, "all");
    let asked = changes(&panel.state().asked);
    let [all] = asked.as_slice() else { panic!("{asked:?}") };
    let selected = after.after(&crate::stage::scene(), all.clone()).unwrap();
    assert_eq!(selected.selection().mask().count(), 920);
}

#[test]
fn the_selection_is_duplicated() {
    let mut panel = prompt();
    let target = Some(Target { selection: true, ..Target::default() });
    let duplicate = Action::DuplicateGaussians(DuplicateGaussians { target, ..DuplicateGaussians::default() });
    press(&mut panel, "duplicate");
    assert_eq!(changes(&panel.state().asked), std::slice::from_ref(&duplicate));
    let after = panel.state().shown.scene.after(&crate::stage::scene(), duplicate).unwrap();
    assert_eq!((after.count(), after.selection().mask().count()), (1080, 80));
}

#[test]
fn a_selection_that_is_not_stored_yet_is_not_deleted() {
    let mut panel = prompt();
    panel.state_mut().shown.uncommitted = true;
    panel.run();
    for label in ["delete", "duplicate", "crop"] {
        press(&mut panel, label);
        assert_eq!(panel.state().asked, [], "{label}");
    }
}

#[test]
fn a_selection_is_saved_under_a_free_name() {
    let mut panel = prompt();
    press(&mut panel, "name of the new unit");
    panel.get_by_label("name of the new unit").type_text("  dome ");
    panel.run();
    assert_eq!(panel.state().asked, []);
    press(&mut panel, "save");
    let save = |name: &str, replace| Action::SaveUnit(SaveUnit { name: name.to_owned(), replace });
    assert_eq!(changes(&panel.state().asked), [save("dome", false)]);
    panel.state_mut().asked.clear();
    press(&mut panel, "save");
    assert_eq!(panel.state().asked, [], "the name was used up");

    press(&mut panel, "name of the new unit");
    panel.get_by_label("name of the new unit").type_text("dome 2");
    panel.key_press(egui::Key::Enter);
    panel.run();
    assert_eq!(changes(&panel.state().asked), [save("dome 2", false)]);
}

#[test]
fn the_name_field_is_found_in_a_folded_panel() {
    let mut panel = prompt();
    press(&mut panel, "Save as a unit");
    assert!(panel.query_by_label("name of the new unit").is_none());
    panel.state_mut().panels.name_selection();
    panel.run();
    panel.run();
    panel.get_by_label("name of the new unit").type_text("dome");
    panel.key_press(egui::Key::Enter);
    panel.run();
    assert_eq!(changes(&panel.state().asked).len(), 1);
}

#[test]
fn a_unit_is_replaced_only_after_a_confirmation() {
    let mut panel = prompt();
    press(&mut panel, "name of the new unit");
    panel.get_by_label("name of the new unit").type_text("SAC");
    panel.run();
    press(&mut panel, "save");
    assert_eq!(panel.state().asked, []);
    press(&mut panel, "keep it");
    assert!(panel.query_by_label("replace it").is_none());
    press(&mut panel, "save");
    press(&mut panel, "replace it");
    let replaced = Action::SaveUnit(SaveUnit { name: "sac".to_owned(), replace: true });
    assert_eq!(changes(&panel.state().asked), [replaced]);

    panel.state_mut().asked.clear();
    press(&mut panel, "name of the new unit");
    panel.get_by_label("name of the new unit").type_text("vessel");
    panel.run();
    assert!(panel.query_by_label_contains("is a structure of the file").is_some());
    press(&mut panel, "save");
    assert_eq!(panel.state().asked, []);
}

#[test]
fn without_the_services_their_controls_are_not_there() {
    let mut stage = Stage::new(Panel::SELECT);
    stage.shown.services = ServiceAvailability { scene: true, ..ServiceAvailability::default() };
    let mut panel = harness(stage);
    for label in ["Region", "brush width", "clear", "invert", "grow", "add similar"] {
        assert!(panel.query_by_label(label).is_none(), "{label}");
    }
    assert!(panel.query_by_label("save").is_some());
    panel.state_mut().shown.services = ServiceAvailability { selection: true, ..ServiceAvailability::default() };
    panel.run();
    for label in ["save", "name of the new unit", "undo"] {
        assert!(panel.query_by_label(label).is_none(), "{label}");
    }
    assert!(panel.query_by_label("grow").is_some());
}

#[test]
fn the_wrist_menu_asks_about_the_selection() {
    let mut stage = Stage::new(Panel::WRIST);
    stage.walk();
    stage.shown.services.labeling = true;
    let mut menu = harness(stage);
    assert!(!menu.state().shown.scene.selection().mask().is_none(), "the walk is committed");
    for label in ["what is this?", "things like this"] {
        press(&mut menu, label);
    }
    let said: Vec<_> = menu.state().asked.iter().flat_map(|o| o.requests.clone()).collect();
    let say = |sentence: &str| Request::Say(sentence.to_owned());
    assert_eq!(said, [say("what is selected?"), say("find things like this")]);
    let mut nothing = Stage::new(Panel::WRIST);
    let none = Select { operation: SetOperation::Replace.into(), ..Select::default() };
    let cleared = nothing.shown.scene.after(&crate::stage::scene(), Action::Select(none)).unwrap();
    nothing.shown.scene = Arc::new(cleared);
    let nothing = harness(nothing);
    assert!(nothing.query_by_label("what is this?").is_none(), "nothing is selected");
}

#[test]
fn the_wrist_menu_has_modes_steps_back_and_what_its_room_does() {
    let mut stage = Stage::new(Panel::WRIST);
    let mut menu = harness(std::mem::replace(&mut stage, Stage::new(Panel::WRIST)));
    for label in ["panels", "fit all"] {
        assert!(menu.query_by_label(label).is_none(), "{label} is nobody's");
    }
    press(&mut menu, "Patch");
    assert_eq!(menu.state().tools.mode, BrushMode::Cluster);
    stage.panels.supported_actions =
        vec![DisplayAction::Fit, DisplayAction::Bookmark, DisplayAction::Panels, DisplayAction::Screenshot];
    stage.shown.services = ServiceAvailability { scene: true, ..ServiceAvailability::default() };
    let mut menu = harness(stage);
    assert!(menu.query_by_label("Region").is_none(), "no selection process");
    for label in ["undo", "redo", "panels", "fit all", "keep this place", "screenshot", "labels", "upright"] {
        press(&mut menu, label);
    }
    assert!(menu.state().tools.callouts && menu.state().tools.upright);
    let asked = &menu.state().asked;
    let changes: Vec<_> = asked.iter().flat_map(|o| &o.requests).collect();
    assert!(
        matches!(changes.as_slice(), [Request::Change(a), Request::Change(b)]
            if matches!(**a, Action::Undo(_)) && matches!(**b, Action::Redo(_))),
        "{changes:?}"
    );
    let actions: Vec<_> = asked.iter().flat_map(|o| o.actions.clone()).collect();
    let each = [DisplayAction::Panels, DisplayAction::Fit, DisplayAction::Bookmark, DisplayAction::Screenshot];
    assert_eq!(actions, each);
}

/// Drags a slider to a share of its length and lets go there.
fn slide(panel: &mut Harness<'_, Stage>, label: &str, shares: &[f32]) {
    let slider = panel.get_by_label(label).rect();
    let at = |share: f32| egui::pos2(slider.left() + share * slider.width(), slider.center().y);
    for share in shares {
        panel.drag_at(at(*share));
        panel.run();
    }
    panel.drop_at(at(shares[shares.len() - 1]));
    panel.run();
}

#[test]
fn a_moving_slider_previews_the_walk_and_its_release_commits_it() {
    let mut panel = prompt();
    for label in ["Reach", "Strictness", "where to brush next?"] {
        assert!(panel.query_by_label(label).is_none(), "{label} without a walk");
    }
    panel.state_mut().walk();
    panel.run();
    // In a room the section is folded until a person opens it.
    assert!(panel.query_by_label("Reach").is_none());
    press(&mut panel, "Reach and Strictness");
    for (label, leak) in [("Reach", true), ("Strictness", false)] {
        panel.state_mut().asked.clear();
        slide(&mut panel, label, &[0.5, 0.7, 0.8]);
        let asked: Vec<_> = panel.state().asked.iter().flat_map(|o| o.requests.clone()).collect();
        let Some((Request::Select(taken), trial_tuning)) = asked.split_last() else { panic!("{label}: {asked:?}") };
        let [step] = taken.steps.as_slice() else { panic!("{taken:?}") };
        let Some(Step::Tuning(tuning)) = step.step else { panic!("{step:?}") };
        assert!(trial_tuning.len() >= 2 && trial_tuning.last() == Some(&Request::Tune(tuning)), "{label}: {asked:?}");
        match leak {
            true => {
                // To the right selects more, and less leak reaches farther.
                assert!((3e-4..1.5e-3).contains(&tuning.leak) && tuning.threshold == 1e-12, "{tuning:?}");
                let leaks: Vec<f64> = trial_tuning
                    .iter()
                    .filter_map(|r| if let Request::Tune(t) = r { Some(t.leak) } else { None })
                    .collect();
                assert!(leaks.windows(2).all(|pair| pair[1] < pair[0]), "{leaks:?}");
            }
            false => assert!((0.4..0.7).contains(&tuning.threshold), "{tuning:?}"),
        }
    }
    press(&mut panel, "tune Strictness");
    assert_eq!(panel.state().tools.walk_parameter, WalkParameter::Threshold);
}

#[test]
fn less_and_more_take_another_answer_and_say_which_one_is_shown() {
    let wrist = || harness(Stage::new(Panel::WRIST));
    let window = || {
        let mut panel = prompt();
        panel.state_mut().panels.host = PanelHost::Window;
        panel
    };
    for mut panel in [prompt(), window(), wrist()] {
        panel.state_mut().walk();
        panel.run();
        assert!(panel.query_by_label("More").is_none(), "one answer alone");
        panel.state_mut().answers(1);
        panel.run();
        panel.get_by_label("2 of 3");
        assert_eq!(asks(&mut panel, "More").answer(), AnswerStep::Wider);
        assert_eq!(asks(&mut panel, "Less").answer(), AnswerStep::Narrower);
        panel.state_mut().answers(2);
        panel.state_mut().asked.clear();
        panel.run();
        panel.get_by_label("3 of 3");
        press(&mut panel, "More");
        assert!(panel.state().asked.iter().all(|o| o.requests.is_empty()), "nothing is wider");
    }
}

#[test]
fn a_hidden_panel_commits_the_open_draft() {
    let mut panel = prompt();
    panel.state_mut().walk();
    panel.run();
    // In a room the section is folded until a person opens it.
    assert!(panel.query_by_label("Reach").is_none());
    press(&mut panel, "Reach and Strictness");
    let slider = panel.get_by_label("Reach").rect();
    panel.drag_at(slider.center());
    panel.run();
    let left = panel.state_mut().panels.put_away(Panel::SELECT);
    assert!(matches!(left.requests.as_slice(), [Request::Select(_)]), "{left:?}");
}

#[test]
fn proposals_are_requested_and_viewed() {
    let mut panel = prompt();
    panel.state_mut().walk();
    panel.run();
    // In a room the section is folded until a person opens it.
    assert!(panel.query_by_label("Reach").is_none());
    press(&mut panel, "Reach and Strictness");
    press(&mut panel, "where to brush next?");
    let asked: Vec<_> = panel.state().asked.iter().flat_map(|o| o.requests.clone()).collect();
    assert_eq!(asked, [Request::Propose(5)]);
    let first = "1: about 1,210 Gaussians would change";
    panel.state_mut().asked.clear();
    press(&mut panel, first);
    assert_eq!(panel.state().asked, [], "a display that cannot turn there shows it alone");
    panel.state_mut().panels.supported_actions = vec![DisplayAction::Proposal(0)];
    panel.run();
    press(&mut panel, first);
    assert_eq!(
        panel.state().asked.iter().flat_map(|o| o.actions.clone()).collect::<Vec<_>>(),
        [DisplayAction::Proposal(0)]
    );
    // About another selection they say nothing.
    let shown = &mut panel.state_mut().shown;
    shown.proposals = shown
        .proposals
        .as_ref()
        .map(|p| Arc::new(ProposalsReply { selection_hash: "other".to_owned(), ..ProposalsReply::clone(p) }));
    panel.run();
    assert!(panel.query_by_label(first).is_none());
}
