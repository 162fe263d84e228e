//! The file menu of a window, and the dialog in the window that stands in for the desktop's.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use egui::{Event, Key, Modifiers, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use sg_gpu::backend::{self, Engine};
use sg_proto::launch::save_request::Content;
use sg_proto::launch::{GaussianPart, SaveRequest};
use sg_viewer::display::{Backend, Request, ServiceAvailability, Tools, ViewPort, ViewState};
use sg_viewer::window::{MouseTool, Settings, WindowFiles, WindowUi};

use crate::stage::{after, save, scene, select};

/// A window that a person has opened a file of `folder` in.
fn window(folder: &Path) -> (Harness<'static, WindowUi>, Backend) {
    let scene = scene();
    let state = after(&scene, [select(&scene, 10..60), save("sac")]);
    let services = ServiceAvailability { scene: true, selection: true, agents: true, labeling: false };
    let (view_port, service) = ViewPort::new(ViewState { services, ..ViewState::of(state) });
    let engine = Engine::new(sg_scene::model::Scene::clone(&scene), backend::Backend::Cpu, None).unwrap();
    let settings = Settings { panels: false, mouse_tool: MouseTool::Navigate, ..Settings::default() };
    let files = WindowFiles {
        opened: Some(folder.join("heart.ply")),
        scratch: Some(folder.to_owned()),
        settings: Some(folder.join("window.toml")),
    };
    let ports = (view_port, Tools::default());
    let pictures = folder.join("pictures");
    let window_ui = WindowUi::new(Arc::clone(&scene), engine, ports, pictures, &settings, || ()).unwrap();
    let mut harness = Harness::builder()
        .with_size(Vec2::new(900.0, 640.0))
        .build_ui_state(|ui, window_ui| window_ui.show(ui), window_ui.with_files(files));
    harness.run_steps(3);
    (harness, service)
}

const CTRL: Modifiers = Modifiers::COMMAND;
const CTRL_SHIFT: Modifiers = Modifiers { shift: true, ..Modifiers::COMMAND };

fn press(harness: &mut Harness<'_, WindowUi>, modifiers: Modifiers, key: Key) {
    harness.key_press_modifiers(modifiers, key);
    harness.run_steps(3);
}

fn write(harness: &mut Harness<'_, WindowUi>, text: &str) {
    harness.event(Event::Text(text.to_owned()));
    harness.run_steps(2);
}

fn click(harness: &mut Harness<'_, WindowUi>, label: &str) {
    harness.get_by_label_contains(label).click();
    harness.run_steps(3);
}

/// The one request to save.
fn saved(service: &Backend) -> SaveRequest {
    let mut all = service.requests.try_iter().filter_map(|request| match request {
        Request::Save(save) => Some(*save),
        _ => None,
    });
    let one = all.next().unwrap();
    assert_eq!(all.next(), None);
    one
}

fn part(request: &SaveRequest) -> (GaussianPart, &str) {
    match &request.content {
        Some(Content::Gaussians(choice)) => (choice.part(), &choice.unit),
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_typed_path_is_opened() {
    let folder = tempfile::tempdir().unwrap();
    let (mut harness, service) = window(folder.path());
    press(&mut harness, CTRL, Key::O);
    write(&mut harness, "brain.nrrd");
    press(&mut harness, Modifiers::NONE, Key::Enter);
    assert!(harness.query_by_label_contains("no such file").is_some());
    assert_eq!(service.requests.try_iter().count(), 0);
    let path = folder.path().join("brain.nrrd");
    std::fs::write(&path, "NRRD").unwrap();
    press(&mut harness, Modifiers::NONE, Key::Enter);
    assert_eq!(service.requests.try_iter().collect::<Vec<_>>(), [Request::Open(path, None)]);
    press(&mut harness, CTRL, Key::O);
    assert!(harness.query_by_label_contains("Cancel").is_some());
    press(&mut harness, Modifiers::NONE, Key::Escape);
    assert!(harness.query_by_label_contains("Cancel").is_none());
}

#[test]
fn escape_closes_an_open_menu() {
    let folder = tempfile::tempdir().unwrap();
    let (mut harness, _service) = window(folder.path());
    click(&mut harness, "File");
    assert!(harness.query_by_label_contains("Save a copy").is_some());
    press(&mut harness, Modifiers::NONE, Key::Escape);
    assert!(harness.query_by_label_contains("Save a copy").is_none());
}

#[test]
fn a_raw_volume_is_opened_with_the_lengths_of_its_voxels() {
    let folder = tempfile::tempdir().unwrap();
    let (mut harness, service) = window(folder.path());
    let path = folder.path().join("head_4x4x4_uint8.raw");
    std::fs::write(&path, [0; 64]).unwrap();
    let open = |harness: &mut Harness<'_, WindowUi>| {
        press(harness, CTRL, Key::O);
        write(harness, "head_4x4x4_uint8.raw");
        press(harness, Modifiers::NONE, Key::Enter);
        assert!(harness.query_by_label_contains("The spacing is not known").is_some());
    };
    open(&mut harness);
    assert_eq!(service.requests.try_iter().count(), 0);
    // The first number has the focus: typed digits replace it.
    press(&mut harness, CTRL, Key::A);
    write(&mut harness, "0.5");
    press(&mut harness, Modifiers::NONE, Key::Enter);
    let spaced = Request::Open(path.clone(), Some([0.5, 1.0, 1.0]));
    assert_eq!(service.requests.try_iter().collect::<Vec<_>>(), [spaced]);

    open(&mut harness);
    click(&mut harness, "not known");
    assert_eq!(service.requests.try_iter().collect::<Vec<_>>(), [Request::Open(path, None)]);

    open(&mut harness);
    press(&mut harness, Modifiers::NONE, Key::Escape);
    assert!(harness.query_by_label_contains("The spacing is not known").is_none());
    assert_eq!(service.requests.try_iter().count(), 0);
}

#[test]
fn gaussians_are_exported_under_a_chosen_name() {
    let folder = tempfile::tempdir().unwrap();
    let (mut harness, service) = window(folder.path());
    let name = |name: &str| folder.path().join(name).display().to_string();
    press(&mut harness, CTRL, Key::E);
    press(&mut harness, Modifiers::NONE, Key::Enter);
    let request = saved(&service);
    assert_eq!((request.path.clone(), request.replace), (name("heart-selection.ply"), false));
    assert_eq!(part(&request), (GaussianPart::Selection, ""));

    // A taken name gets a number; typing it all the same needs a second Enter.
    std::fs::write(name("heart-selection.ply"), "ply").unwrap();
    press(&mut harness, CTRL, Key::E);
    press(&mut harness, CTRL, Key::A);
    write(&mut harness, "heart-selection");
    press(&mut harness, Modifiers::NONE, Key::Enter);
    assert!(harness.query_by_label_contains("Replace").is_some());
    assert_eq!(service.requests.try_iter().count(), 0);
    press(&mut harness, Modifiers::NONE, Key::Enter);
    let request = saved(&service);
    assert_eq!((request.path.clone(), request.replace), (name("heart-selection.ply"), true));

    // Without a selection, what is visible.
    let scene = scene();
    service.writer.update(|state| {
        state.scene = after(&scene, []);
        state.selected = Arc::clone(state.scene.selection().mask());
    });
    harness.run_steps(2);
    press(&mut harness, CTRL, Key::E);
    press(&mut harness, CTRL, Key::A);
    write(&mut harness, "all.splat");
    press(&mut harness, Modifiers::NONE, Key::Enter);
    let request = saved(&service);
    assert_eq!((request.path.clone(), part(&request).0), (name("all.splat"), GaussianPart::Visible));
}

#[test]
fn the_menu_exports_a_unit_and_copies_the_project() {
    let folder = tempfile::tempdir().unwrap();
    let (mut harness, service) = window(folder.path());
    click(&mut harness, "File");
    click(&mut harness, "Export splats");
    assert!(harness.query_by_label_contains("Selection (50)").is_some());
    click(&mut harness, "sac…");
    press(&mut harness, Modifiers::NONE, Key::Enter);
    let request = saved(&service);
    assert!(request.path.ends_with("heart-sac.ply"), "{}", request.path);
    assert_eq!(part(&request), (GaussianPart::Unit, "sac"));

    press(&mut harness, CTRL_SHIFT, Key::S);
    press(&mut harness, Modifiers::NONE, Key::Enter);
    let request = saved(&service);
    assert!(request.path.ends_with("heart-copy.sgproj") && matches!(request.content, Some(Content::Project(_))));
    press(&mut harness, CTRL_SHIFT, Key::S);
    press(&mut harness, CTRL, Key::A);
    write(&mut harness, "whole.ply");
    press(&mut harness, Modifiers::NONE, Key::Enter);
    assert_eq!(part(&saved(&service)).0, GaussianPart::Everything);
}

#[test]
fn recent_files_open_unless_they_are_gone() {
    let folder = tempfile::tempdir().unwrap();
    let there = folder.path().join("there.ply");
    std::fs::write(&there, "ply").unwrap();
    let recent = vec![folder.path().join("heart.ply"), there.clone(), folder.path().join("gone.ply")];
    Settings { recent, ..Settings::default() }.save(&folder.path().join("window.toml")).unwrap();
    let (mut harness, service) = window(folder.path());
    click(&mut harness, "File");
    click(&mut harness, "Recent");
    assert!(harness.query_by_label_contains("heart.ply").is_none(), "it is open");
    assert!(harness.query_by_label_contains("gone.ply").is_some());
    click(&mut harness, "gone.ply");
    assert_eq!(service.requests.try_iter().count(), 0);
    // A click anywhere closes the menu.
    click(&mut harness, "File");
    click(&mut harness, "Recent");
    click(&mut harness, "there.ply");
    assert_eq!(service.requests.try_iter().collect::<Vec<_>>(), [Request::Open(there, None)]);
}

#[test]
fn a_picture_is_drawn_larger_and_transparent() {
    let folder = tempfile::tempdir().unwrap();
    let (mut harness, service) = window(folder.path());
    click(&mut harness, "File");
    click(&mut harness, "Save picture");
    click(&mut harness, "2×");
    click(&mut harness, "Transparent background");
    click(&mut harness, "Save picture…");
    press(&mut harness, Modifiers::NONE, Key::Enter);
    let began = Instant::now();
    let request = loop {
        let next =
            service.requests.try_iter().find_map(|r| if let Request::Save(save) = r { Some(*save) } else { None });
        if let Some(request) = next {
            break request;
        }
        assert!(began.elapsed() < Duration::from_secs(60), "no picture");
        std::thread::sleep(Duration::from_millis(20));
        harness.step();
    };
    assert!(request.path.ends_with("heart.png"), "{}", request.path);
    let Some(Content::Picture(drawn)) = request.content else { panic!("{request:?}") };
    let file = std::fs::File::open(&drawn.path).unwrap();
    let reader = png::Decoder::new(std::io::BufReader::new(file)).read_info().unwrap();
    let info = reader.info();
    assert_eq!(info.color_type, png::ColorType::Rgba);
    assert!(
        info.width > 1000 && info.width.is_multiple_of(2),
        "twice the picture of a window of 900 points: {}",
        info.width
    );
}
