//! Scene control: the requests of each control, and the controls that are not drawn.

use std::sync::Arc;

use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use sg_proto::scene::command::Action;
use sg_proto::scene::{
    Color, DeleteUnit, LightMode, MergeUnits, NamedView, Redo, RenameUnit, Reset, Select, SetBackground, SetColor,
    SetLight, SetLock, SetOperation, SetTerm, SetView, SetVisibility, ShadingTerm, ShowOnly, Target, Undo, Vector,
    set_view,
};
use sg_raster::attributes::{Attribute, Legend};
use sg_raster::color_map::ColorMap;
use sg_raster::render::Quality;
use sg_viewer::display::{DisplayMode, Request, ServiceAvailability, Tools, TurnStyle};
use sg_viewer::panels::{DisplayAction, Draft, Output, Panel, PanelHost};

use crate::stage::{Stage, harness, press};

fn scene() -> Harness<'static, Stage> {
    tall(Stage::new(Panel::SCENE))
}

/// A panel that is high enough for all of its parts.
fn tall(stage: Stage) -> Harness<'static, Stage> {
    let mut harness = harness(stage);
    harness.state_mut().height = Some(2400.0);
    harness.set_size(egui::vec2(Panel::SCENE.size.x, 2400.0));
    harness.run();
    harness
}

pub(crate) fn changes(output: &[Output]) -> Vec<Action> {
    let of = |request: &Request| match request {
        Request::Change(action) => (**action).clone(),
        other => panic!("{other:?}"),
    };
    output.iter().flat_map(|o| &o.requests).map(of).collect()
}

/// The request of a press on this.
#[track_caller]
fn asks(harness: &mut Harness<'_, Stage>, label: &str) -> Action {
    harness.state_mut().asked.clear();
    press(harness, label);
    let asked = changes(&harness.state().asked);
    assert_eq!(asked.len(), 1, "{label}: {asked:?}");
    asked[0].clone()
}

fn named(name: &str) -> Option<Target> {
    Some(Target { units: vec![name.to_owned()], ..Target::default() })
}

/// Drags from the middle of the widget with this label to a share of its width, in steps. Returns the requests of each frame.
fn drag(harness: &mut Harness<'_, Stage>, label: &str, to: f32) -> Vec<Output> {
    let rect = harness.get_by_label(label).rect();
    harness.state_mut().asked.clear();
    harness.drag_at(rect.center());
    for k in 1..=4 {
        let x = rect.center().x + (to - 0.5) * rect.width() * k as f32 / 4.0;
        harness.hover_at(egui::pos2(x, rect.center().y));
        harness.step();
    }
    harness.drop_at(egui::pos2(rect.left() + to * rect.width(), rect.center().y));
    harness.run();
    std::mem::take(&mut harness.state_mut().asked)
}

#[test]
fn units_are_hidden_shown_selected_and_looked_at() {
    let mut panel = scene();
    let hidden = Action::SetVisibility(SetVisibility { target: named("tissue"), visible: false });
    assert_eq!(asks(&mut panel, "hide tissue"), hidden);
    let everything = Some(Target { everything: true, ..Target::default() });
    let all = Action::SetVisibility(SetVisibility { target: everything, visible: true });
    assert_eq!(asks(&mut panel, "show everything"), all);
    press(&mut panel, "sac");
    for (label, operation) in [
        ("select", SetOperation::Replace),
        ("add to selection", SetOperation::Add),
        ("take from selection", SetOperation::Remove),
    ] {
        let select = Action::Select(Select { target: named("sac"), operation: operation.into() });
        assert_eq!(asks(&mut panel, label), select);
    }
    assert_eq!(asks(&mut panel, "solo"), Action::ShowOnly(ShowOnly { target: named("sac") }));
    let focus = set_view::Change::Focus(named("sac").unwrap());
    assert_eq!(asks(&mut panel, "look at it"), Action::SetView(SetView { change: Some(focus) }));
    assert_eq!(
        asks(&mut panel, "Remove name (keeps splats)"),
        Action::DeleteUnit(DeleteUnit { name: "sac".to_owned() })
    );
    // A base unit can be neither renamed nor deleted, so that there is nothing to press for it.
    press(&mut panel, "vessel");
    assert!(panel.query_by_label("Remove name (keeps splats)").is_none() && panel.query_by_label("rename").is_none());
    assert!(panel.query_by_label_contains("transfer function of vessel, 70 to 255").is_some());
}

#[test]
fn a_slider_that_is_dragged_gives_drafts_and_one_request() {
    let mut panel = scene();
    let frames = drag(&mut panel, "opacity of sac", 0.2);
    let held: Vec<_> = frames.iter().filter_map(|o| o.draft.clone()).collect();
    let [drafts @ .., Draft::Release(last)] = held.as_slice() else { panic!("{held:?}") };
    assert!(drafts.len() >= 3, "{held:?}");
    let factors: Vec<f32> = drafts
        .iter()
        .map(|d| match d {
            Draft::Hold(Action::SetOpacity(set)) if set.target == named("sac") && !set.relative => set.factor,
            other => panic!("{other:?}"),
        })
        .collect();
    assert!(factors.windows(2).all(|w| w[1] < w[0]), "{factors:?}");
    let requests = changes(&frames);
    assert_eq!(
        requests.as_slice(),
        std::slice::from_ref(last),
        "one request when it is let go, the change that was seen last"
    );
    let Action::SetOpacity(set) = last else { panic!("{last:?}") };
    // The handle's middle goes from half its width within one end to as much within the other.
    assert!((0.1..0.2).contains(&set.factor), "{set:?}");
    assert_eq!(frames.iter().position(|o| !o.requests.is_empty()), Some(frames.len() - 1));
}

#[test]
fn a_hand_that_rests_says_nothing_new() {
    let mut panel = scene();
    let at = panel.get_by_label("opacity of sac").rect().center();
    panel.drag_at(at);
    panel.step();
    panel.state_mut().asked.clear();
    panel.run_steps(4);
    assert_eq!(panel.state().asked, []);
    // The panel is put away under the hand: the change is not lost.
    let away = panel.state_mut().panels.put_away(Panel::SCENE);
    assert_eq!(away.requests.len(), 1);
    assert!(matches!(away.draft, Some(Draft::Release(Action::SetOpacity(_)))));
    assert_eq!(panel.state_mut().panels.put_away(Panel::SCENE), Output::default());
}

#[test]
fn colours_are_chosen_from_swatches_and_sliders() {
    let mut panel = scene();
    press(&mut panel, "colour of sac");
    let orange = Color { red: 0.902, green: 0.624, blue: 0.0 };
    let set = |color| Action::SetColor(SetColor { target: named("sac"), color });
    assert_eq!(asks(&mut panel, "orange"), set(Some(orange)));
    let frames = drag(&mut panel, "brightness", 0.3);
    assert!(frames.iter().filter(|o| matches!(o.draft, Some(Draft::Hold(_)))).count() >= 3);
    assert_eq!(changes(&frames).len(), 1);
    assert_eq!(asks(&mut panel, "Original colours"), set(None));
    press(&mut panel, "Scene control");
    press(&mut panel, "colour of vessel");
    assert_eq!(
        asks(&mut panel, "palette of the file"),
        Action::SetColor(SetColor { target: named("vessel"), color: None })
    );
}

#[test]
fn a_locked_unit_is_left_alone() {
    let mut panel = scene();
    let lock = |locked| Action::SetLock(SetLock { target: named("sac"), locked });
    assert_eq!(asks(&mut panel, "lock sac"), lock(true));
    let locked = panel.state().shown.scene.after(&crate::stage::scene(), lock(true)).unwrap();
    panel.state_mut().shown.scene = Arc::new(locked);
    panel.run();
    panel.state_mut().asked.clear();
    press(&mut panel, "hide sac");
    press(&mut panel, "colour of sac");
    assert!(panel.query_by_label("orange").is_none());
    let frames = drag(&mut panel, "opacity of sac", 0.1);
    assert_eq!(frames, []);
    press(&mut panel, "sac");
    for label in ["Remove name (keeps splats)", "rename", "select", "add to selection"] {
        press(&mut panel, label);
        assert_eq!(panel.state().asked, [], "{label}");
    }
    // Actions that do not change it still work, as does another unit.
    assert!(matches!(asks(&mut panel, "take from selection"), Action::Select(_)));
    assert!(matches!(asks(&mut panel, "solo"), Action::ShowOnly(_)));
    assert!(matches!(asks(&mut panel, "hide neck"), Action::SetVisibility(_)));
    assert_eq!(asks(&mut panel, "unlock sac"), lock(false));
    let free = panel.state().shown.scene.after(&crate::stage::scene(), lock(false)).unwrap();
    panel.state_mut().shown.scene = Arc::new(free);
    panel.run();
    assert!(matches!(asks(&mut panel, "hide sac"), Action::SetVisibility(_)));
}

#[test]
fn light_shading_and_background() {
    let mut panel = scene();
    press(&mut panel, "Light and background");
    let from =
        |mode: LightMode, direction| Action::SetLight(SetLight { mode: mode.into(), direction, ..SetLight::default() });
    assert_eq!(asks(&mut panel, "one direction"), from(LightMode::Direction, None));
    assert_eq!(asks(&mut panel, "the eye"), from(LightMode::Headlight, None));
    assert!(panel.query_by_label("around").is_none(), "a headlight has no direction");
    let frames = drag(&mut panel, "specular", 0.9);
    let [Action::SetLight(light)] = changes(&frames)[..] else { panic!() };
    assert!(light.specular.is_some_and(|x| x > 2.0) && light.ambient.is_none() && light.mode == 0);
    let term = Action::SetTerm(SetTerm { term: ShadingTerm::Diffuse.into() });
    assert_eq!(asks(&mut panel, "shading: diffuse"), term);
    let white = Some(Color { red: 1.0, green: 1.0, blue: 1.0 });
    assert_eq!(asks(&mut panel, "white"), Action::SetBackground(SetBackground { color: white }));

    let state = panel.state().shown.scene.after(&crate::stage::scene(), from(LightMode::Direction, None)).unwrap();
    panel.state_mut().shown.scene = Arc::new(state);
    panel.run();
    let frames = drag(&mut panel, "height", 0.5);
    assert!(changes(&frames).len() <= 1);
    let Action::SetLight(SetLight { direction: Some(Vector { x, y, z }), .. }) =
        asks(&mut panel, "from the present viewpoint")
    else {
        panic!()
    };
    let front = (x.abs() < 1e-9, y < 0.0, z.abs() < 1e-9);
    assert_eq!(front, (true, true, true), "the view as opened is from the front");
}

#[test]
fn viewpoints_and_requests_handled_by_the_display() {
    let mut stage = Stage::new(Panel::SCENE);
    stage.panels.supported_actions = vec![DisplayAction::Fit, DisplayAction::Bookmark, DisplayAction::Place(1)];
    let mut panel = tall(stage);
    press(&mut panel, "Viewpoint");
    for (label, view) in [("front", NamedView::Front), ("bottom", NamedView::Bottom), ("as opened", NamedView::Initial)]
    {
        let change = Some(set_view::Change::Named(view.into()));
        assert_eq!(asks(&mut panel, label), Action::SetView(SetView { change }));
    }
    assert!(panel.query_by_label("screenshot").is_none(), "nobody would take it");
    panel.state_mut().asked.clear();
    for label in ["fit all", "keep this place", "place 1"] {
        press(&mut panel, label);
    }
    let actions: Vec<_> = panel.state().asked.iter().flat_map(|o| o.actions.clone()).collect();
    assert_eq!(actions, [DisplayAction::Fit, DisplayAction::Bookmark, DisplayAction::Place(1)]);
}

#[test]
fn a_structure_gets_a_tone_of_its_own_and_the_file_s_again() {
    let mut panel = scene();
    press(&mut panel, "sac");
    assert!(panel.query_by_label("saturation").is_none(), "folded while nothing is changed");
    press(&mut panel, "Colours");
    let frames = drag(&mut panel, "saturation", 0.1);
    let [Action::SetTone(tone)] = &changes(&frames)[..] else { panic!("{frames:?}") };
    assert!(tone.saturation.is_some_and(|s| s < 0.5) && tone.brightness.is_none() && tone.temperature.is_none());
    assert_eq!((&tone.target, tone.relative), (&named("sac"), false));
    let frames = drag(&mut panel, "brightness", 0.9);
    assert!(
        matches!(&changes(&frames)[..], [Action::SetTone(t)] if t.brightness.is_some_and(|b| b > 1.5)),
        "{frames:?}"
    );
    let frames = drag(&mut panel, "temperature", 0.9);
    assert!(
        matches!(&changes(&frames)[..], [Action::SetTone(t)] if t.temperature.is_some_and(|t| t > 0.5)),
        "{frames:?}"
    );
    let toned = panel.state().shown.scene.after(&crate::stage::scene(), Action::SetTone(tone.clone())).unwrap();
    panel.state_mut().shown.scene = Arc::new(toned);
    panel.run();
    let Action::SetTone(back) = asks(&mut panel, "as in the file") else { panic!() };
    assert_eq!((back.saturation, back.brightness, back.temperature), (Some(1.0), Some(1.0), Some(0.0)));
}

#[test]
fn units_that_are_pressed_with_ctrl_become_one() {
    let mut panel = scene();
    press(&mut panel, "neck");
    assert!(panel.query_by_label("Merge 2 units").is_none());
    let ctrl = |panel: &mut Harness<'_, Stage>, label: &str| {
        let place = panel.get_by_label(label).rect().center();
        panel.hover_at(place);
        for pressed in [true, false] {
            panel.event_modifiers(
                egui::Event::PointerButton {
                    pos: place,
                    button: egui::PointerButton::Primary,
                    pressed,
                    modifiers: egui::Modifiers::COMMAND,
                },
                egui::Modifiers::COMMAND,
            );
        }
        panel.run();
    };
    ctrl(&mut panel, "vessel");
    ctrl(&mut panel, "sac");
    let merge = |units: &[&str], name: &str| {
        let units = units.iter().map(|n| (*n).to_owned()).collect();
        Action::MergeUnits(MergeUnits { units, name: name.to_owned() })
    };
    // A unit of the file keeps its Gaussians: the first saved one takes all.
    assert_eq!(asks(&mut panel, "Merge 3 units"), merge(&["neck", "sac", "vessel"], ""));
    assert!(panel.query_by_label("Merge 3 units").is_none(), "the next merge begins anew");
    press(&mut panel, "neck");
    press(&mut panel, "tissue");
    ctrl(&mut panel, "vessel");
    assert_eq!(asks(&mut panel, "Merge 2 units"), merge(&["tissue", "vessel"], "tissue + vessel"));
    ctrl(&mut panel, "vessel");
    ctrl(&mut panel, "vessel");
    assert!(panel.query_by_label("Merge 2 units").is_none(), "a second press takes it out");
    // Nobody presses what would be refused.
    ctrl(&mut panel, "vessel");
    let lock = Action::SetLock(SetLock { target: named("vessel"), locked: true });
    let locked = panel.state().shown.scene.after(&crate::stage::scene(), lock).unwrap();
    panel.state_mut().shown.scene = Arc::new(locked);
    panel.run();
    panel.state_mut().asked.clear();
    press(&mut panel, "Merge 2 units");
    assert!(changes(&panel.state().asked).is_empty());
}

#[test]
fn no_step_of_an_earlier_revision_is_named_or_pressed() {
    let mut panel = scene();
    press(&mut panel, "History");
    let hide = Action::SetVisibility(SetVisibility { target: named("tissue"), visible: false });
    let mut later = (*panel.state().shown.scene).clone();
    later = later.after(&crate::stage::scene(), hide).unwrap();
    panel.state_mut().shown.scene = Arc::new(later);
    panel.run();
    assert!(panel.query_by_label("Coloured sac #0072b2").is_none() && panel.query_by_label("Hid tissue").is_none());
    assert!(panel.query_by_label_contains("neck: 80 Gaussians").is_none());
    assert_eq!(asks(&mut panel, "undo"), Action::Undo(Undo { steps: 1 }), "the scene knows its steps");
    let revision = panel.state().shown.scene.revision();
    panel.state_mut().shown.steps_at = revision;
    panel.run();
    assert!(panel.query_by_label("Hid tissue").is_some());
}

#[test]
fn history_takes_back_as_far_as_is_pointed_at() {
    let mut panel = scene();
    assert_eq!(asks(&mut panel, "undo"), Action::Undo(Undo { steps: 1 }));
    assert_eq!(asks(&mut panel, "redo"), Action::Redo(Redo { steps: 1 }));
    press(&mut panel, "History");
    assert_eq!(asks(&mut panel, "Coloured sac #0072b2"), Action::Undo(Undo { steps: 2 }));
    assert_eq!(asks(&mut panel, "Hid tissue"), Action::Redo(Redo { steps: 1 }));
    assert_eq!(asks(&mut panel, "reset all looks"), Action::Reset(Reset {}));
    panel.state_mut().shown.undo = [].into();
    panel.state_mut().shown.redo = [].into();
    panel.state_mut().asked.clear();
    press(&mut panel, "undo");
    press(&mut panel, "redo");
    assert_eq!(panel.state().asked, [], "there is nothing to take back");
}

#[test]
fn display_options_belong_to_one_display() {
    let mut panel = scene();
    press(&mut panel, "What is shown");
    // A headset's pictures have no lines drawn into them.
    assert!(panel.query_by_label("outlines of Super-Gaussians").is_none());
    panel.state_mut().panels.host = PanelHost::Window;
    panel.run();
    for (label, display_mode) in [
        ("Super-Gaussians", DisplayMode::Clusters),
        ("outlines of Super-Gaussians", DisplayMode::Outlines),
        ("along the first component", DisplayMode::FirstComponent),
        ("normal", DisplayMode::Attribute(Attribute::Normal)),
        ("opacity", DisplayMode::Attribute(Attribute::Opacity)),
    ] {
        press(&mut panel, label);
        assert_eq!(panel.state().tools.display_mode, display_mode);
    }
    assert!(panel.query_by_label("20 Super-Gaussians").is_some());
    let numbers = Legend { low: 0.0, high: 0.75, logarithmic: false, map: ColorMap::default() };
    panel.state_mut().panels.numbers = Some(numbers);
    panel.run();
    assert!(panel.query_by_label("0.75").is_some());
    panel.state_mut().shown.clusters = None;
    panel.run();
    assert!(panel.query_by_label("Super-Gaussians").is_none());

    panel.state_mut().panels.host = PanelHost::Headset;
    panel.run();
    press(&mut panel, "This display");
    press(&mut panel, "fast");
    press(&mut panel, "150 %");
    press(&mut panel, "light");
    press(&mut panel, "left-handed");
    press(&mut panel, "evenly");
    assert!(panel.query_by_label("surroundings").is_none(), "a headset that cannot show them has no switch");
    panel.state_mut().panels.switches_surroundings = true;
    panel.run();
    press(&mut panel, "surroundings");
    assert!(panel.state().tools.surroundings);
    press(&mut panel, "surroundings");
    assert!(!panel.state().tools.surroundings);
    assert_eq!(panel.state().tools.turn_style, TurnStyle::Smooth);
    let tools = &panel.state().tools;
    assert_eq!((tools.quality, tools.scale, tools.light_panels), (Quality::Fast, 1.5, true));
    assert!(tools.left_handed && !tools.seated);
    assert_eq!(panel.state().asked, [], "nothing of it is told to the scene");
    panel.state_mut().panels.host = PanelHost::Window;
    panel.run();
    assert!(panel.query_by_label("left-handed").is_none(), "a window has no hands");
}

#[test]
fn a_headset_sets_its_near_distance_and_ambient_occlusion() {
    let mut panel = scene();
    assert_eq!((panel.state().tools.room_near, panel.state().tools.occlusion), (0.05, false));
    press(&mut panel, "This display");
    drag(&mut panel, "near distance", 0.95);
    let near = panel.state().tools.room_near;
    assert!(near > 0.3 && near <= Tools::ROOM_NEARS.1, "{near}");
    drag(&mut panel, "near distance", 0.05);
    let near = panel.state().tools.room_near;
    assert!(near < 0.02 && near >= Tools::ROOM_NEARS.0, "{near}");
    press(&mut panel, "Light and background");
    press(&mut panel, "ambient occlusion");
    assert!(panel.state().tools.occlusion);
    assert_eq!(panel.state().asked, [], "nothing of it is told to the scene");
    panel.state_mut().panels.host = PanelHost::Window;
    panel.run();
    assert!(panel.query_by_label("near distance").is_none(), "a window has its own");
    press(&mut panel, "ambient occlusion");
    assert!(!panel.state().tools.occlusion);
}

#[test]
fn without_the_scenes_owner_nothing_can_be_changed() {
    let mut stage = Stage::new(Panel::SCENE);
    stage.shown.services = ServiceAvailability::default();
    let mut panel = tall(stage);
    press(&mut panel, "sac");
    for label in [
        "undo",
        "redo",
        "hide sac",
        "colour of sac",
        "opacity of sac",
        "lock sac",
        "select",
        "solo",
        "rename",
        "Remove name (keeps splats)",
        "show everything",
        "Light and background",
        "Viewpoint",
        "History",
    ] {
        assert!(panel.query_by_label(label).is_none(), "{label}");
    }
    assert!(panel.query_by_label("unit, 180 Gaussians (18 %)").is_some());
}

#[test]
fn a_typed_name_is_requested() {
    let mut panel = scene();
    press(&mut panel, "sac");
    press(&mut panel, "rename");
    panel.state_mut().asked.clear();
    panel.get_by_label("new name").type_text("2");
    panel.run();
    assert_eq!(panel.state().asked, [], "nothing is asked for while somebody types");
    panel.key_press(egui::Key::Enter);
    panel.run();
    let renamed = |new: &str| Action::RenameUnit(RenameUnit { name: "sac".to_owned(), new_name: new.to_owned() });
    assert_eq!(changes(&panel.state().asked), [renamed("sac2")]);

    press(&mut panel, "rename");
    panel.get_by_label("new name").type_text(" of Ann");
    panel.run();
    panel.state_mut().asked.clear();
    press(&mut panel, "Scene control");
    assert_eq!(changes(&panel.state().asked), [renamed("sac of Ann")], "turning to something else is enough");

    press(&mut panel, "rename");
    panel.get_by_label("new name").type_text("!");
    panel.run();
    panel.state_mut().asked.clear();
    panel.key_press(egui::Key::Escape);
    panel.run();
    assert_eq!(panel.state().asked, [], "escape gives it up");
    assert!(panel.query_by_label("new name").is_none());
}
