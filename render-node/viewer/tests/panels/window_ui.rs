//! The window's content without a window: the requests of dropped files and of drags of the mouse.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use egui::{Pos2, Role, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::{By, NodeT as _, Queryable as _};
use sg_gpu::backend::{self, Engine};
use sg_proto::scene::command::Action;
use sg_proto::scene::{InLasso, SetView, Target, selection_operation, selection_step, set_view};
use sg_proto::selection::AnswerStep;
use sg_viewer::display::{Backend, Request, ServiceAvailability, Tools, ViewPort, ViewState};
use sg_viewer::panels::Panel;
use sg_viewer::window::{Hint, MouseTool, Settings, WindowUi};

use crate::stage::{Stage, after, save, scene, select};

/// A desk that a mouse works on with a tool, and the other side of its seat.
pub(crate) fn desk(mouse_tool: MouseTool, folder: &Path) -> (Harness<'static, WindowUi>, Backend) {
    let settings = Settings { panels: false, mouse_tool, ..Settings::default() };
    desk_of(&settings, Vec2::new(800.0, 600.0), folder)
}

/// A desk of these settings and this size in points.
pub(crate) fn desk_of(settings: &Settings, size: Vec2, folder: &Path) -> (Harness<'static, WindowUi>, Backend) {
    let scene = scene();
    let state = after(&scene, []);
    let services = ServiceAvailability { scene: true, selection: true, agents: true, labeling: false };
    let (view_port, service) = ViewPort::new(ViewState { services, ..ViewState::of(state) });
    let engine = Engine::new(sg_scene::model::Scene::clone(&scene), backend::Backend::Cpu, None).unwrap();
    let mut tools = Tools::default();
    settings.apply(&mut tools, None);
    let window_ui =
        WindowUi::new(Arc::clone(&scene), engine, (view_port, tools), folder.to_owned(), settings, || ()).unwrap();
    let harness = Harness::builder().with_size(size).build_ui_state(|ui, window_ui| window_ui.show(ui), window_ui);
    (harness, service)
}

/// A file as the window's system hands it over.
#[derive(Debug)]
struct File(PathBuf);

impl egui::DroppedFile for File {
    fn path(&self) -> &Path {
        &self.0
    }

    fn bytes(&self) -> Result<Vec<u8>, String> {
        Err("nobody reads it here".to_owned())
    }
}

#[test]
fn only_dropped_scenes_and_volumes_are_opened() {
    let folder = tempfile::tempdir().unwrap();
    let (mut harness, service) = desk(MouseTool::Navigate, folder.path());
    harness.step();
    let files = ["/data/heart.ply", "/data/notes.pdf", "/data/skull/scene.toml", "/data/Tooth.NRRD"];
    for file in files {
        harness.input_mut().dropped_files.push(Arc::new(File(file.into())));
    }
    harness.step();
    let asked: Vec<_> = service.requests.try_iter().collect();
    let opened = [files[0], files[2], files[3]].map(|file| Request::Open(file.into(), None));
    assert_eq!(asked, opened);
    harness.step();
    assert_eq!(service.requests.try_iter().count(), 0, "a file is dropped once");
}

/// The changes of the scene that a key asks for.
fn pressed(
    harness: &mut Harness<'_, WindowUi>,
    service: &Backend,
    (modifiers, key): (egui::Modifiers, egui::Key),
) -> Vec<Action> {
    harness.key_press_modifiers(modifiers, key);
    harness.step();
    let of = |request| if let Request::Change(action) = request { *action } else { panic!("{request:?}") };
    service.requests.try_iter().map(of).collect()
}

#[test]
fn keys_select_everything_delete_and_crop() {
    let folder = tempfile::tempdir().unwrap();
    let (mut harness, service) = desk(MouseTool::Navigate, folder.path());
    let (delete, backspace, crop, all) = (
        (egui::Modifiers::NONE, egui::Key::Delete),
        (egui::Modifiers::NONE, egui::Key::Backspace),
        (egui::Modifiers::SHIFT, egui::Key::Delete),
        (egui::Modifiers::COMMAND, egui::Key::A),
    );
    harness.step();
    for key in [delete, backspace, crop] {
        assert_eq!(pressed(&mut harness, &service, key), []);
        assert!(harness.query_by_label_contains("nothing is selected").is_some(), "{key:?}");
    }
    let scene = scene();
    let chosen = after(&scene, [select(&scene, 10..60)]);
    service.writer.update(|state| {
        state.selected = Arc::clone(chosen.selection().mask());
        state.scene = Arc::clone(&chosen);
    });
    harness.step();
    for (key, left) in [(delete, 950), (backspace, 950), (crop, 50)] {
        let asked = pressed(&mut harness, &service, key);
        let [action] = asked.as_slice() else { panic!("{key:?}: {asked:?}") };
        assert_eq!(chosen.after(&scene, action.clone()).unwrap().existing_count(), left, "{key:?}");
    }
    // The stroke on screen is not the selection that the scene has.
    service.writer.update(|state| state.uncommitted = true);
    harness.step();
    for key in [delete, crop] {
        assert_eq!(pressed(&mut harness, &service, key), []);
        assert!(harness.query_by_label_contains("not stored yet").is_some(), "{key:?}");
    }
    service.writer.update(|state| state.uncommitted = false);
    harness.step();
    let asked = pressed(&mut harness, &service, all);
    let [action] = asked.as_slice() else { panic!("{asked:?}") };
    assert_eq!(chosen.after(&scene, action.clone()).unwrap().selection().mask().count(), 1000);
}

/// Other answers that the window asks for.
fn other_answers(service: &Backend) -> Vec<AnswerStep> {
    let of = |request| if let Request::Select(strokes) = request { strokes.answer() } else { panic!("{request:?}") };
    service.requests.try_iter().map(of).collect()
}

#[test]
fn keys_and_the_wheel_take_another_answer_to_a_region_stroke() {
    let folder = tempfile::tempdir().unwrap();
    let (mut harness, service) = desk(MouseTool::Navigate, folder.path());
    let mut stage = Stage::new(Panel::SELECT);
    stage.walk();
    stage.answers(1);
    let shown = stage.shown;
    service.writer.update(|state| {
        (state.scene, state.selected) = (Arc::clone(&shown.scene), Arc::clone(shown.scene.selection().mask()));
        (state.walk_capabilities, state.answers) = (shown.walk_capabilities, shown.answers.clone());
    });
    harness.step();
    for (key, answer) in [(egui::Key::Comma, AnswerStep::Narrower), (egui::Key::Period, AnswerStep::Wider)] {
        harness.key_press(key);
        harness.step();
        assert_eq!(other_answers(&service), [answer], "{key:?}");
    }
    // The wheel with Alt, up: more.
    let middle = Pos2::new(400.0, 300.0);
    harness.event(egui::Event::PointerMoved(middle));
    harness.step();
    harness.event_modifiers(
        egui::Event::MouseWheel {
            unit: egui::MouseWheelUnit::Point,
            delta: Vec2::new(0.0, 75.0),
            phase: egui::TouchPhase::Move,
            source: egui::MouseWheelSource::Wheel,
            modifiers: egui::Modifiers::ALT,
        },
        egui::Modifiers::ALT,
    );
    for _ in 0..60 {
        harness.step();
    }
    assert_eq!(other_answers(&service), [AnswerStep::Wider]);
    // At the widest one the line says so.
    service.writer.update(|state| {
        let mut answers = shown.answers.as_deref().cloned().unwrap();
        answers.taken = 2;
        state.answers = Some(Arc::new(answers));
    });
    harness.step();
    harness.key_press(egui::Key::Period);
    harness.step();
    assert_eq!(other_answers(&service), []);
    assert!(harness.query_by_label_contains("this is the widest answer").is_some());
}

/// Shift and F as a keyboard sends them.
fn frame_selection(harness: &mut Harness<'_, WindowUi>, service: &Backend) -> Vec<Option<set_view::Change>> {
    harness.key_press_modifiers(egui::Modifiers::SHIFT, egui::Key::F);
    harness.step();
    let of = |request: Request| match request {
        Request::Change(action) => match *action {
            Action::SetView(SetView { change }) => change,
            other => panic!("{other:?}"),
        },
        other => panic!("{other:?}"),
    };
    service.requests.try_iter().map(of).collect()
}

#[test]
fn the_selection_is_framed_from_where_the_eye_is() {
    let folder = tempfile::tempdir().unwrap();
    let (mut harness, service) = desk(MouseTool::Navigate, folder.path());
    harness.step();
    assert_eq!(frame_selection(&mut harness, &service), [], "nothing is selected");
    assert!(harness.query_by_label_contains("nothing is selected").is_some());

    let scene = scene();
    let chosen = after(&scene, [select(&scene, 10..60)]);
    let first = chosen.view();
    service.writer.update(|state| state.scene = Arc::clone(&chosen));
    harness.step();
    let focus = Some(set_view::Change::Focus(Target { selection: true, ..Target::default() }));
    assert_eq!(frame_selection(&mut harness, &service), std::slice::from_ref(&focus));

    // The mouse moves only the window's eye, so the scene hears of it first.
    harness.hover_at(Pos2::new(300.0, 300.0));
    harness.step();
    harness.drag_at(Pos2::new(300.0, 300.0));
    for x in [340.0, 380.0, 420.0] {
        harness.hover_at(Pos2::new(x, 330.0));
        harness.step();
    }
    harness.drop_at(Pos2::new(420.0, 330.0));
    harness.step();
    let asked = frame_selection(&mut harness, &service);
    let [Some(set_view::Change::View(view)), second] = asked.as_slice() else { panic!("{asked:?}") };
    assert_eq!(*second, focus);
    let seen = sg_edit::wire::decode_view(view).unwrap();
    assert!(seen.eye.distance(first.eye) > 1e-3, "{seen:?}");
    // The eye stays where it is until the scene has moved it, and where it is when the scene repeats its place.
    assert_eq!(frame_selection(&mut harness, &service), asked);
    let change = Some(set_view::Change::View(*view));
    let moved = Arc::new(chosen.after(&scene, Action::SetView(SetView { change })).unwrap());
    service.writer.update(|state| state.scene = Arc::clone(&moved));
    harness.step();
    assert_eq!(frame_selection(&mut harness, &service), [focus]);
}

#[test]
fn the_eye_goes_to_another_view_or_jumps_there() {
    for smooth_views in [true, false] {
        let folder = tempfile::tempdir().unwrap();
        let settings = Settings { smooth_views, panels: false, ..Settings::default() };
        let (mut harness, service) = desk_of(&settings, Vec2::new(800.0, 600.0), folder.path());
        let scene = scene();
        let chosen = after(&scene, [select(&scene, 10..60)]);
        service.writer.update(|state| state.scene = Arc::clone(&chosen));
        harness.run_steps(2);
        let mut there = chosen.view();
        there.eye = there.target + 1.5 * (there.eye - there.target);
        let change = Some(set_view::Change::View(sg_edit::wire::encode_view(&there)));
        let moved = Arc::new(chosen.after(&scene, Action::SetView(SetView { change })).unwrap());
        service.writer.update(|state| state.scene = Arc::clone(&moved));
        harness.step();
        // Where the eye is elsewhere the scene hears of its place first.
        let asked = frame_selection(&mut harness, &service);
        let is_elsewhere = matches!(asked.first(), Some(Some(set_view::Change::View(_))));
        assert_eq!(is_elsewhere, smooth_views, "{asked:?}");
        assert_eq!(harness.state().settings().smooth_views, smooth_views);
    }
}

#[test]
fn a_line_that_tells_something_is_read_along_and_not_down() {
    let folder = tempfile::tempdir().unwrap();
    let (mut harness, service) = desk(MouseTool::Navigate, folder.path());
    // The place of lines has been shown empty before.
    harness.run_steps(3);
    let said = "tooth.raw: as soon as Gaussians are made of it, a window of its own opens (session tooth-0123abcd)";
    service.writer.notice(said, false);
    harness.run_steps(3);
    let line = harness.get_by_label(said).rect();
    assert!(line.width() > 8.0 * line.height() && line.width() < 700.0, "{line:?}");
}

#[test]
fn the_list_of_shortcuts_stays_within_a_small_window() {
    for size in [Vec2::new(1440.0, 900.0), Vec2::new(1280.0, 720.0), Vec2::new(720.0, 450.0)] {
        let folder = tempfile::tempdir().unwrap();
        let (mut harness, _service) = desk(MouseTool::Navigate, folder.path());
        harness.set_size(size);
        harness.step();
        harness.event(egui::Event::Text("?".to_owned()));
        harness.key_press(egui::Key::Questionmark);
        harness.run_steps(4);
        let window = egui::Rect::from_min_size(Pos2::ZERO, size);
        for seen in ["Keys and mouse", "Tools", "B", "the mouse brushes"] {
            let rects: Vec<_> = harness.get_all_by_label(seen).map(|n| n.rect()).collect();
            assert!(rects.iter().all(|r| window.contains_rect(*r)), "{seen} at {rects:?} of {size:?}");
        }
        // All of it if there is room, without scrolling.
        let last = harness.get_by_label("fly, in that manner").rect();
        let list = harness.ctx.memory(|m| m.area_rect(egui::Id::unique("help"))).unwrap();
        assert!(window.contains_rect(list), "{list:?} of {size:?}");
        assert!(list.contains_rect(last) || size.y < 800.0, "{last:?} in {list:?} of {size:?}");
        let longest = harness.get_by_label_contains("nearer, further").rect();
        assert!(longest.min.x > 0.0 && longest.max.x < size.x, "{longest:?} of {size:?}");
    }
}

/// The outline of a drag with a tool: corners, in pixels of the picture.
fn drawn(mouse_tool: MouseTool, places: &[Pos2]) -> Option<Vec<Vec2>> {
    let folder = tempfile::tempdir().unwrap();
    let (mut harness, service) = desk(mouse_tool, folder.path());
    harness.step();
    harness.hover_at(places[0]);
    harness.step();
    harness.drag_at(places[0]);
    for place in places {
        harness.hover_at(*place);
        harness.step();
    }
    harness.drop_at(places[places.len() - 1]);
    harness.step();
    let lasso = service.requests.try_iter().find_map(|request| {
        let Request::Select(strokes) = request else { return None };
        let Some(selection_step::Step::Operation(operation)) = strokes.steps.first()?.step.clone() else { return None };
        let Some(selection_operation::Operation::Lasso(lasso)) = operation.operation else { return None };
        Some(lasso)
    });
    lasso.map(|InLasso { polygon, .. }| polygon.chunks(2).map(|c| Vec2::new(c[0] as f32, c[1] as f32)).collect())
}

#[test]
fn a_lasso_and_a_rectangle_begin_where_the_button_was_pressed() {
    // A mouse that jumps: the first place after the press is well beyond the limit between a click and a drag.
    let places = [Pos2::new(200.0, 200.0), Pos2::new(230.0, 205.0), Pos2::new(260.0, 290.0), Pos2::new(205.0, 280.0)];
    let rectangle = drawn(MouseTool::Rectangle, &places).unwrap();
    let [first, _, last, _] = rectangle[..] else { panic!("{rectangle:?}") };
    assert_eq!(first - last, places[0] - places[3]);
    let lasso = drawn(MouseTool::Lasso, &places).unwrap();
    let legs: Vec<_> = lasso.windows(2).map(|pair| pair[1] - pair[0]).collect();
    assert_eq!(legs, places.windows(2).map(|pair| pair[1] - pair[0]).collect::<Vec<_>>());
}

/// Controls that lie beyond the window's edges, and text that is cut sideways, outside what scrolls.
pub(crate) fn clipped(harness: &Harness<'_, WindowUi>) -> Vec<String> {
    let window = harness.ctx.content_rect().expand(0.5);
    let text = harness.output().shapes.iter().filter_map(|shape| {
        let egui::Shape::Text(text) = &shape.shape else { return None };
        let (rect, room) = (text.visual_bounding_rect(), shape.clip_rect.intersect(window).expand(1.0));
        let is_cut = rect.intersects(room) && (rect.left() < room.left() || rect.right() > room.right());
        is_cut.then(|| format!("{} at {rect} in {room}", text.galley.text()))
    });
    let controls = harness.query_all(By::new().predicate(|n| n.role() == Role::Button && n.bounding_box().is_some()));
    let beyond = controls.filter(|n| n.rect().left() < window.left() || n.rect().right() > window.right());
    text.chain(beyond.map(|n| format!("{:?} at {}", n.accesskit_node().label(), n.rect()))).collect()
}

#[test]
fn nothing_is_clipped_in_a_small_window_and_with_large_text() {
    for (size, scale) in [
        (Vec2::new(1280.0, 800.0), 1.0),
        (Vec2::new(640.0, 480.0), 1.0),
        (Vec2::new(1280.0, 800.0), 2.0),
        (Vec2::new(640.0, 400.0), 1.0),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let settings = Settings { scale, ..Settings::default() };
        let (mut harness, service) = desk_of(&settings, size, folder.path());
        let scene = scene();
        let chosen = after(&scene, [select(&scene, 10..60), save("sac")]);
        service.writer.update(|state| {
            state.selected = Arc::clone(chosen.selection().mask());
            state.scene = Arc::clone(&chosen);
        });
        harness.run_steps(4);
        assert_eq!(clipped(&harness), Vec::<String>::new(), "{size} at {scale}");
        // The tools, the number of selected Gaussians, the name and the structures are in sight.
        let window = harness.ctx.content_rect();
        for label in ["brush", "50 of 1,000 Gaussians (5 %)", "name of the new unit", "save", "undo"] {
            let rect = harness.get_by_label(label).rect();
            assert!(window.contains_rect(rect), "{label} at {rect} of {size} at {scale}");
        }
        // The picture keeps a part of the window.
        let dock = harness.get_by_label("save").rect().right();
        assert!(size.x - dock > 0.3 * size.x, "{dock} of {size} at {scale}");
        if size.x < 1000.0 || scale > 1.0 {
            for tab in ["Scene control", "Language"] {
                harness.get_by_label(tab).click();
                harness.run_steps(3);
                assert_eq!(clipped(&harness), Vec::<String>::new(), "{tab}, {size} at {scale}");
            }
        }
    }
}

#[test]
fn hints_point_at_a_control_until_they_are_followed_or_dismissed() {
    let folder = tempfile::tempdir().unwrap();
    let (mut harness, service) = desk_of(&Settings::default(), Vec2::new(1280.0, 800.0), folder.path());
    harness.run_steps(3);
    assert!(harness.query_by_label("Brush a structure (B)").is_some());
    assert!(harness.query_by_label("Name it (Ctrl+S)").is_none(), "one at a time");
    let scene = scene();
    let chosen = after(&scene, [select(&scene, 10..60)]);
    service.writer.update(|state| {
        state.selected = Arc::clone(chosen.selection().mask());
        state.scene = Arc::clone(&chosen);
    });
    harness.run_steps(3);
    assert!(harness.query_by_label("Brush a structure (B)").is_none());
    let (hint, field) =
        (harness.get_by_label("Name it (Ctrl+S)").rect(), harness.get_by_label("name of the new unit").rect());
    assert!(hint.left() > field.right() && (hint.center().y - field.center().y).abs() < 12.0, "{hint} beside {field}");
    for _ in 0..2 {
        harness.get_by_label("dismiss the hint").click();
        harness.run_steps(3);
    }
    assert!(harness.query_by_label("dismiss the hint").is_none());
    assert_eq!(harness.state().settings().hints_done, Hint::ALL);
}

#[test]
fn arrow_keys_move_the_eye_and_a_text_field_keeps_its_letters() {
    let folder = tempfile::tempdir().unwrap();
    let (mut harness, service) = desk_of(&Settings::default(), Vec2::new(1280.0, 800.0), folder.path());
    let scene = scene();
    let chosen = after(&scene, [select(&scene, 10..60)]);
    service.writer.update(|state| state.scene = Arc::clone(&chosen));
    harness.run_steps(2);
    let eye = |harness: &mut Harness<'_, WindowUi>| match frame_selection(harness, &service).first() {
        Some(Some(set_view::Change::View(view))) => sg_edit::wire::decode_view(view).unwrap(),
        Some(Some(set_view::Change::Focus(_))) => chosen.view(),
        other => panic!("{other:?}"),
    };
    let first = eye(&mut harness);
    harness.key_press(egui::Key::ArrowRight);
    harness.step();
    let turned = eye(&mut harness);
    assert!(turned.eye.x > first.eye.x && turned.target.distance(first.target) < 0.01, "{first:?} {turned:?}");
    harness.key_press_modifiers(egui::Modifiers::SHIFT, egui::Key::ArrowUp);
    harness.step();
    let slid = eye(&mut harness);
    assert!(slid.target.z > turned.target.z, "{turned:?} {slid:?}");
    harness.key_press(egui::Key::Plus);
    harness.step();
    let near = eye(&mut harness);
    assert!(near.eye.distance(near.target) < 0.95 * slid.eye.distance(slid.target));
    // The keyboard's focus on a button is no hindrance; a text field is.
    harness.key_press(egui::Key::Tab);
    harness.run_steps(2);
    harness.key_press(egui::Key::B);
    harness.step();
    assert_eq!(harness.state().settings().mouse_tool, MouseTool::Brush);
    harness.get_by_label("name of the new unit").click();
    harness.run_steps(2);
    harness.key_press(egui::Key::N);
    harness.step();
    assert_eq!(harness.state().settings().mouse_tool, MouseTool::Brush);
}

#[test]
fn the_status_line_tells_of_the_picture_that_stays() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, woken) = (scene(), Arc::new(AtomicBool::new(true)));
    let (view_port, service) = ViewPort::new(ViewState::of(after(&scene, [])));
    let engine = Engine::new(sg_scene::model::Scene::clone(&scene), backend::Backend::Cpu, None).unwrap();
    let (settings, wakes) = (Settings::default(), Arc::clone(&woken));
    let wake = move || wakes.store(true, Ordering::Release);
    let ports = (view_port, Tools::default());
    let window_ui = WindowUi::new(Arc::clone(&scene), engine, ports, folder.path().into(), &settings, wake).unwrap();
    let mut harness = Harness::builder()
        .with_size(Vec2::new(800.0, 600.0))
        .build_ui_state(|ui, window_ui: &mut WindowUi| window_ui.show(ui), window_ui);
    // Frames as the loop of a window draws them: where one is asked for, or something is finished.
    let rest = |harness: &mut Harness<'_, WindowUi>| {
        let (mut due, mut last) = (Some(Instant::now()), Instant::now());
        while last.elapsed() < Duration::from_secs(3) {
            if woken.swap(false, Ordering::AcqRel) || due.is_some_and(|due| due <= Instant::now()) {
                harness.step();
                let delay = harness.output().viewport_output.get(&egui::ViewportId::ROOT).unwrap().repaint_delay;
                (due, last) = (Instant::now().checked_add(delay), Instant::now());
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        assert!(harness.state().is_settled());
    };
    rest(&mut harness);
    assert!(harness.query_by_label("Full quality").is_some(), "the picture at rest is called a preview");
    // A change is not shown yet: the picture of before it has full quality no more.
    let chosen = after(&scene, [select(&scene, 10..60)]);
    service.writer.update(|state| {
        state.selected = Arc::clone(chosen.selection().mask());
        state.scene = Arc::clone(&chosen);
    });
    harness.step();
    harness.step();
    assert!(harness.query_by_label("Full quality").is_none(), "a picture of before the change is called full quality");
    rest(&mut harness);
    assert!(harness.query_by_label("Full quality").is_some());
}

/// The event of a key.
fn key(key: egui::Key, modifiers: egui::Modifiers, pressed: bool) -> egui::Event {
    egui::Event::Key { key, physical_key: None, pressed, repeat: false, modifiers }
}

/// The events of keys that a fast hand, or a slow machine, brings in one frame: Enter as `\n`, letters with their text.
fn at_once(harness: &mut Harness<'_, WindowUi>, keys: &str) {
    for c in keys.chars() {
        let k = if c == '\n' { egui::Key::Enter } else { egui::Key::from_name(&c.to_uppercase().to_string()).unwrap() };
        let event = |pressed| key(k, egui::Modifiers::NONE, pressed);
        let text = (c != '\n').then(|| egui::Event::Text(c.to_string()));
        harness.input_mut().events.extend([Some(event(true)), text, Some(event(false))].into_iter().flatten());
    }
    harness.step();
}

#[test]
fn letters_that_come_at_once_after_enter_are_no_shortcuts() {
    let folder = tempfile::tempdir().unwrap();
    let (mut harness, service) = desk_of(&Settings::default(), Vec2::new(1280.0, 800.0), folder.path());
    harness.run_steps(3);
    // Enter leads to the field; all letters of its frame and of the next ones are typed there.
    at_once(&mut harness, "\nhe");
    at_once(&mut harness, "lp");
    at_once(&mut harness, "\n");
    // A sentence was sent, and the next one follows without a pause.
    at_once(&mut harness, "un");
    at_once(&mut harness, "do");
    at_once(&mut harness, "\n");
    let said: Vec<_> = service.requests.try_iter().collect();
    assert_eq!(said, ["help", "undo"].map(|text| Request::Say(text.to_owned())));
    let settings = harness.state().settings();
    assert!(settings.panels && settings.mouse_tool == MouseTool::Navigate, "{settings:?}");
}

#[test]
fn escape_right_after_a_sentence_gives_the_keys_back_to_the_window() {
    let folder = tempfile::tempdir().unwrap();
    let (mut harness, service) = desk_of(&Settings::default(), Vec2::new(1280.0, 800.0), folder.path());
    harness.run_steps(3);
    for keys in ["\n", "he", "lp", "\n"] {
        at_once(&mut harness, keys);
    }
    // The field gets the focus again in the next frame, which holds Esc already.
    harness.input_mut().events.push(key(egui::Key::Escape, egui::Modifiers::NONE, true));
    harness.step();
    at_once(&mut harness, "b");
    harness.input_mut().events.push(key(egui::Key::Z, egui::Modifiers::COMMAND, true));
    harness.step();
    let requests: Vec<_> = service.requests.try_iter().collect();
    let [Request::Say(text), Request::Change(undo)] = &requests[..] else { panic!("{requests:?}") };
    assert!(text == "help" && matches!(**undo, Action::Undo(_)), "{requests:?}");
    assert_eq!(harness.state().settings().mouse_tool, MouseTool::Brush);
}

#[test]
fn a_turntable_shows_its_progress_at_rest_and_escape_cancels_it() {
    let folder = tempfile::tempdir().unwrap();
    let (mut harness, _service) = desk_of(&Settings::default(), Vec2::new(640.0, 480.0), folder.path());
    harness.run_steps(3);
    harness.key_press(egui::Key::T);
    harness.run_steps(2);
    let shown = harness.output().viewport_output.get(&egui::ViewportId::ROOT).unwrap().repaint_delay;
    assert!(shown < Duration::from_secs(1), "nothing else draws the progress: {shown:?}");
    harness.key_press(egui::Key::Escape);
    let began = Instant::now();
    while harness.query_by_label_contains("turntable cancelled").is_none() {
        assert!(began.elapsed() < Duration::from_secs(60), "it is not cancelled");
        std::thread::sleep(Duration::from_millis(20));
        harness.step();
    }
}
