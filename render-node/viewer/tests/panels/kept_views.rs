//! Kept viewpoints of the scene: keeping, going there, forgetting, and where they have room.

use std::path::Path;
use std::sync::Arc;

use egui::Key;
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use sg_proto::limits::MAX_KEPT_VIEWS;
use sg_proto::scene::command::Action;
use sg_proto::scene::{ForgetView, KeepView, NamedView, SetView, set_view};
use sg_viewer::display::Request;
use sg_viewer::panels::{DisplayAction, NARROWEST, Panel};
use sg_viewer::window::{Hint, Settings};

use crate::appearance::{beyond, cut_text, faint_text};
use crate::picture::Canvas;
use crate::scene_requests::changes;
use crate::stage::{Stage, after, harness, press, scene};
use crate::window_ui::desk_of;

const FIELD: &str = "name of the view";
const KEEP: &str = "keep this view";

fn keep(name: &str) -> Action {
    Action::KeepView(KeepView { name: name.to_owned() })
}

fn go_to(name: &str) -> Action {
    Action::SetView(SetView { change: Some(set_view::Change::Kept(name.to_owned())) })
}

/// Scene control of a scene after these actions.
fn stage(actions: impl IntoIterator<Item = Action>) -> Stage {
    let mut stage = Stage::new(Panel::SCENE);
    stage.shown.scene = after(&scene(), actions);
    stage
}

/// Shows it high enough for all of its parts, with the part "Viewpoint" open.
fn open(mut stage: Stage) -> Harness<'static, Stage> {
    let width = stage.width.unwrap_or(Panel::SCENE.size.x * stage.tools.scale);
    stage.height = Some(1600.0);
    let mut panel = harness(stage);
    panel.set_size(egui::vec2(width, 1600.0));
    panel.run();
    press(&mut panel, "Viewpoint");
    panel
}

/// The changes that were requested since the last call.
fn asked(panel: &mut Harness<'_, Stage>) -> Vec<Action> {
    changes(&std::mem::take(&mut panel.state_mut().asked))
}

/// Types behind the letters that are in the field.
fn types(panel: &mut Harness<'_, Stage>, text: &str) {
    press(panel, FIELD);
    panel.get_by_label(FIELD).type_text(text);
    panel.run();
    assert_eq!(asked(panel), [], "nothing is asked for while somebody types");
}

#[test]
fn a_view_is_kept_under_a_name_or_without_one() {
    let mut panel = open(stage([]));
    types(&mut panel, "  front of the sac ");
    assert!(panel.state().panels.is_typing());
    press(&mut panel, KEEP);
    assert_eq!(asked(&mut panel), [keep("front of the sac")]);
    assert!(!panel.state().panels.is_typing());
    // The name was used up. The scene finds the next one.
    press(&mut panel, KEEP);
    assert_eq!(asked(&mut panel), [keep("")]);
}

#[test]
fn enter_keeps_a_view_and_escape_does_not() {
    let mut panel = open(stage([]));
    types(&mut panel, "front");
    panel.key_press(Key::Enter);
    panel.run();
    assert_eq!(asked(&mut panel), [keep("front")]);
    assert!(!panel.state().panels.is_typing());

    press(&mut panel, FIELD);
    panel.key_press(Key::Enter);
    panel.run();
    assert_eq!(asked(&mut panel), [keep("")]);

    types(&mut panel, "back");
    panel.key_press(Key::Escape);
    panel.run();
    assert_eq!(asked(&mut panel), []);
    assert!(!panel.state().panels.is_typing());
}

#[test]
fn a_name_of_too_many_bytes_is_not_sent() {
    let mut panel = open(stage([]));
    types(&mut panel, &"ü".repeat(100));
    press(&mut panel, KEEP);
    assert_eq!(asked(&mut panel), []);
    panel.get_by_label(KEEP).hover();
    panel.run_steps(60);
    assert!(panel.query_by_label_contains("the name is too long").is_some());
}

#[test]
fn a_kept_view_is_gone_to_and_forgotten() {
    let mut panel = open(stage(["front", "sac"].map(keep)));
    // A side of the box has the same name as a kept view.
    press(&mut panel, "front");
    let side = Action::SetView(SetView { change: Some(set_view::Change::Named(NamedView::Front.into())) });
    assert_eq!(asked(&mut panel), [side]);
    press(&mut panel, "go to front");
    assert_eq!(asked(&mut panel), [go_to("front")]);
    press(&mut panel, "forget front");
    let forget = Action::ForgetView(ForgetView { name: "front".to_owned() });
    assert_eq!(asked(&mut panel), std::slice::from_ref(&forget));

    // The scene accepts both, and a forgotten view has no row.
    let shown = Arc::clone(&panel.state().shown.scene);
    shown.after(&scene(), go_to("front")).unwrap();
    panel.state_mut().shown.scene = Arc::new(shown.after(&scene(), forget).unwrap());
    panel.run();
    assert!(panel.query_by_label("go to front").is_none() && panel.query_by_label("forget front").is_none());
    assert!(panel.query_by_label("go to sac").is_some());
}

#[test]
fn views_without_names_are_numbered_and_the_oldest_is_first() {
    let panel = open(stage(["", ""].map(keep)));
    let [first, second] = ["go to view 1", "go to view 2"].map(|label| panel.get_by_label(label).rect());
    assert!(first.bottom() <= second.top(), "{first} {second}");
    // They stand below the field, and above what belongs to this display alone.
    assert!(panel.get_by_label(FIELD).rect().bottom() <= first.top());
}

#[test]
fn without_the_scene_service_no_view_is_kept() {
    let mut stage = stage([keep("front")]);
    stage.panels.supported_actions = vec![DisplayAction::Bookmark];
    let mut panel = open(stage);
    types(&mut panel, "back");
    panel.state_mut().shown.services.scene = false;
    panel.run();
    for label in [FIELD, KEEP, "go to front", "forget front"] {
        assert!(panel.query_by_label(label).is_none(), "{label}");
    }
    assert!(!panel.state().panels.is_typing(), "its field is gone");
    assert!(panel.query_by_label("keep this place").is_some(), "the display does that by itself");
    panel.state_mut().panels.supported_actions.clear();
    panel.run();
    assert!(panel.query_by_label("Viewpoint").is_none());
    assert_eq!(asked(&mut panel), []);
}

#[test]
fn no_more_views_are_kept_than_a_scene_takes() {
    let names: Vec<String> = (0..MAX_KEPT_VIEWS).map(|k| format!("side {k}")).collect();
    let mut panel = open(stage(names.iter().map(|name| keep(name))));
    press(&mut panel, KEEP);
    assert_eq!(asked(&mut panel), []);
    types(&mut panel, "side 3");
    press(&mut panel, KEEP);
    assert_eq!(asked(&mut panel), [keep("side 3")], "it replaces one");
    types(&mut panel, "another side");
    panel.key_press(Key::Enter);
    panel.run();
    assert_eq!(asked(&mut panel), []);
    panel.get_by_label(KEEP).hover();
    panel.run_steps(60);
    assert!(panel.query_by_label_contains("64 views are kept; forget one first").is_some());

    // A long list scrolls, so that the next part stays near.
    let way = panel.get_by_label("History").rect().top() - panel.get_by_label(KEEP).rect().bottom();
    assert!((150.0..280.0).contains(&way), "{way}");
    let forget = Action::ForgetView(ForgetView { name: "side 0".to_owned() });
    let fewer = panel.state().shown.scene.after(&scene(), forget).unwrap();
    panel.state_mut().shown.scene = Arc::new(fewer);
    panel.run();
    press(&mut panel, KEEP);
    assert_eq!(asked(&mut panel), [keep("another side")]);
}

#[test]
fn kept_views_have_room_at_every_size() {
    let canvas = Canvas::open();
    let wide = Panel::SCENE.size.x;
    let long = "Aneurysma".repeat(14);
    for (light, scale, width) in
        [(false, 1.0, wide), (true, 1.0, wide), (false, 1.5, 1.5 * wide), (false, 1.0, NARROWEST)]
    {
        let mut stage = stage(["front", long.as_str()].map(keep));
        (stage.tools.light_panels, stage.tools.scale) = (light, scale);
        stage.width = Some(width);
        let panel = open(stage);
        assert!(panel.query_by_label(&format!("go to {long}")).is_some(), "×{scale}");
        assert_eq!(cut_text(&panel), Vec::<String>::new(), "×{scale} {width}");
        assert_eq!(beyond(&panel), Vec::<String>::new(), "×{scale} {width}");
        let [name, forget] = ["go to front", "forget front"].map(|label| panel.get_by_label(label).rect());
        assert!(name.right() <= forget.left() && name.width() > forget.width(), "{name} {forget}");
        if let Some(canvas) = &canvas {
            let picture = canvas.draw(&panel);
            assert_eq!(faint_text(&panel, &picture), Vec::<String>::new(), "light {light}");
            if let Some(folder) = std::env::var_os("PANEL_PICTURES") {
                picture.write(&Path::new(&folder).join(format!("kept-views-{light}-{scale}-{width}.png")));
            }
        }
    }
}

/// Keys and the mouse move only the window's eye. The scene learns of it before it keeps the view. The eye comes back
/// even where the scene has been there all the time.
#[test]
fn a_window_keeps_what_is_in_view_and_goes_back_to_it() {
    let folder = tempfile::tempdir().unwrap();
    let settings = Settings { hints_done: Hint::ALL.to_vec(), ..Settings::default() };
    let (mut window, service) = desk_of(&settings, egui::vec2(640.0, 1100.0), folder.path());
    window.run_steps(3);
    for label in ["Scene control", "Viewpoint"] {
        window.get_by_label(label).click();
        window.run_steps(4);
    }
    let asked = || -> Vec<Action> {
        let of = |request: Request| match request {
            Request::Change(action) => *action,
            other => panic!("{other:?}"),
        };
        service.requests.try_iter().map(of).collect()
    };
    window.key_press(Key::ArrowRight);
    window.run_steps(2);
    assert_eq!(asked(), []);
    window.get_by_label(KEEP).click();
    window.run_steps(3);
    let changes = asked();
    let [Action::SetView(SetView { change: Some(set_view::Change::View(_)) }), last] = changes.as_slice() else {
        panic!("{changes:?}")
    };
    assert_eq!(*last, keep(""));
    let kept = after(&scene(), changes);
    service.writer.update(|state| state.scene = Arc::clone(&kept));
    window.run_steps(3);

    window.key_press(Key::ArrowRight);
    window.run_steps(2);
    window.get_by_label("go to view 1").click();
    window.run_steps(3);
    // The scene learns where the eye was: undo leads back there, and the kept view is another one.
    let changes = asked();
    let [Action::SetView(SetView { change: Some(set_view::Change::View(_)) }), last] = changes.as_slice() else {
        panic!("{changes:?}")
    };
    assert_eq!(*last, go_to("view 1"));
    let there = changes.into_iter().fold(kept, |state, change| Arc::new(state.after(&scene(), change).unwrap()));
    service.writer.update(|state| state.scene = there);
    // The eye takes a moment to get there.
    window.run_steps(120);
    window.get_by_label(KEEP).click();
    window.run_steps(3);
    assert_eq!(asked(), [keep("")], "the eye is where the scene is");
}
