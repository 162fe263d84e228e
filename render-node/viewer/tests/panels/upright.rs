//! The right way up in a window: the orientation cube, the scale bar, and the keys that turn another axis up.

use std::sync::Arc;
use std::time::{Duration, Instant};

use egui::{Pos2, Rect, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use glam::DVec3;
use sg_edit::EditState;
use sg_gpu::backend::{self, Engine};
use sg_proto::scene::command::Action;
use sg_proto::scene::{Axis, SetView, set_view};
use sg_scene::model::Scene;
use sg_scene::orientation::{LengthUnit, Orientation, PatientFrame};
use sg_viewer::display::{Backend, Request, ServiceAvailability, Tools, ViewPort, ViewState};
use sg_viewer::window::{MouseTool, Settings, WindowUi};
use tempfile::TempDir;

use crate::picture::{Canvas, Picture, Textures};
use crate::stage::{after, scene, select};

const SIZE: Vec2 = Vec2::new(900.0, 640.0);

/// A window over a scene of this orientation, with a selection.
struct Desk {
    harness: Harness<'static, WindowUi>,
    service: Backend,
    scene: Arc<Scene>,
    state: Arc<EditState>,
    textures: Textures,
    _pictures: TempDir,
}

impl Desk {
    fn open(orientation: Orientation) -> Self {
        let scene = Arc::new(Scene { orientation, ..Scene::clone(&scene()) });
        let state = after(&scene, [select(&scene, 10..60)]);
        let services = ServiceAvailability { scene: true, selection: true, agents: true, labeling: false };
        let (view_port, service) = ViewPort::new(ViewState { services, ..ViewState::of(Arc::clone(&state)) });
        let engine = Engine::new(Scene::clone(&scene), backend::Backend::Cpu, None).unwrap();
        let settings = Settings { panels: false, mouse_tool: MouseTool::Navigate, ..Settings::default() };
        let pictures = tempfile::tempdir().unwrap();
        let place = pictures.path().to_owned();
        let ports = (view_port, Tools::default());
        let window_ui = WindowUi::new(Arc::clone(&scene), engine, ports, place, &settings, || ()).unwrap();
        let textures = Textures::default();
        let mut harness = Harness::builder()
            .with_size(SIZE)
            .renderer(textures.clone())
            .build_ui_state(|ui, window_ui| window_ui.show(ui), window_ui);
        harness.run_steps(3);
        Self { harness, service, scene, state, textures, _pictures: pictures }
    }

    /// The window once its best picture is shown.
    fn picture(&mut self, canvas: &Canvas) -> Picture {
        let began = Instant::now();
        while !self.harness.state().is_settled() {
            assert!(began.elapsed() < Duration::from_secs(60), "no picture");
            std::thread::sleep(Duration::from_millis(20));
            self.harness.step();
        }
        self.harness.step();
        canvas.draw_with(&self.harness, &self.textures)
    }

    fn cube(&self) -> Rect {
        self.harness.get_by_label("orientation cube").rect()
    }

    fn click(&mut self, at: Pos2) {
        self.harness.hover_at(at);
        self.harness.step();
        self.harness.drag_at(at);
        self.harness.step();
        self.harness.drop_at(at);
        self.harness.run_steps(2);
    }

    /// Changes of the view that are requested.
    fn requested(&self) -> Vec<set_view::Change> {
        let of = |request: Request| match request {
            Request::Change(action) => match *action {
                Action::SetView(SetView { change }) => change,
                other => panic!("{other:?}"),
            },
            other => panic!("{other:?}"),
        };
        self.service.requests.try_iter().filter_map(of).collect()
    }

    /// Drags from a place, so many steps of this way.
    fn drag(&mut self, from: Pos2, steps: u8, step: Vec2) {
        self.harness.hover_at(from);
        self.harness.step();
        self.harness.drag_at(from);
        for k in 1..=steps {
            self.harness.hover_at(from + f32::from(k) * step);
            self.harness.step();
        }
        self.harness.drop_at(from + f32::from(steps) * step);
    }

    /// The direction from the target to the window's eye, and its up. The window tells its view before it frames the selection.
    fn eye(&mut self) -> (DVec3, DVec3) {
        self.harness.key_press_modifiers(egui::Modifiers::SHIFT, egui::Key::F);
        self.harness.step();
        let view = match self.requested().first() {
            Some(set_view::Change::View(view)) => sg_edit::wire::decode_view(view).unwrap(),
            Some(set_view::Change::Focus(_)) => self.state.view(),
            other => panic!("{other:?}"),
        };
        ((view.eye - view.target).normalize(), view.up)
    }

    /// The scene does what is requested.
    fn apply(&mut self, change: set_view::Change) {
        let action = Action::SetView(SetView { change: Some(change) });
        self.state = Arc::new(self.state.after(&self.scene, action).unwrap());
        let state = Arc::clone(&self.state);
        self.service.writer.update(|shown| shown.scene = Arc::clone(&state));
        self.harness.run_steps(2);
    }
}

fn patient(frame: PatientFrame) -> Orientation {
    Orientation { patient: Some(frame), unit: Some(LengthUnit::Millimetre), up: None }
}

#[test]
fn a_click_on_a_side_of_the_cube_looks_from_there() {
    for (frame, posterior) in [(PatientFrame::Lps, DVec3::Y), (PatientFrame::Ras, DVec3::NEG_Y)] {
        let mut desk = Desk::open(patient(frame));
        assert!((desk.eye().0 + posterior).length() < 1e-9, "opened from anterior");
        let middle = desk.cube().center();
        // The side that faces the eye already: the other side.
        desk.click(middle);
        let (eye, up) = desk.eye();
        assert!((eye - posterior).length() < 1e-9 && up == DVec3::Z, "{frame:?}: {eye}");
        // A drag turns the eye, and what lies below the cube is not touched.
        desk.drag(middle, 5, Vec2::new(4.0, 4.0));
        desk.harness.run_steps(2);
        let (turned, _) = desk.eye();
        assert!(turned.angle_between(posterior).to_degrees() > 20.0 && turned.z > 0.1, "{turned}");
        // Superior is now seen at the top of the cube.
        desk.click(Pos2::new(middle.x, middle.y - 26.0));
        let (eye, up) = desk.eye();
        assert!((eye - DVec3::Z).length() < 1e-9, "{frame:?}: {eye}");
        assert_eq!(up, -posterior, "anterior is up from above");
    }
}

#[test]
fn keys_turn_another_axis_up_and_upside_down() {
    let mut desk = Desk::open(Orientation::default());
    let up = |axis: Axis| set_view::Change::Up(axis.into());
    for (shift, axis, direction) in [
        (false, Axis::MinusZ, DVec3::NEG_Z),
        (false, Axis::PlusY, DVec3::Y),
        (true, Axis::MinusY, DVec3::NEG_Y),
        (false, Axis::PlusX, DVec3::X),
    ] {
        let modifiers = if shift { egui::Modifiers::SHIFT } else { egui::Modifiers::NONE };
        desk.harness.key_press_modifiers(modifiers, egui::Key::U);
        desk.harness.step();
        assert_eq!(desk.requested(), [up(axis)]);
        desk.apply(up(axis));
        assert_eq!((desk.state.view().up, desk.eye().1), (direction, direction));
        let (eye, _) = desk.eye();
        assert!(eye.dot(direction).abs() < 1e-9, "the eye is level: {eye}");
    }
}

/// Whether a pixel is almost white.
fn bright([r, g, b]: [u8; 3]) -> bool {
    r.min(g).min(b) > 215
}

#[test]
fn the_picture_has_a_cube_and_a_bar_where_the_file_has_a_unit() {
    let Some(canvas) = Canvas::open() else { return };
    let mut longest = Vec::new();
    for (name, orientation) in [("patient", patient(PatientFrame::Lps)), ("axes", Orientation::default())] {
        let mut desk = Desk::open(orientation);
        let middle = desk.cube().center();
        // Seen obliquely, so that three sides show.
        desk.drag(middle, 7, Vec2::new(3.5, 2.5));
        desk.harness.hover_at(Pos2::new(300.0, 300.0));
        desk.harness.run_steps(2);
        let picture = desk.picture(&canvas);
        if let Some(folder) = std::env::var_os("SUPERGAUSSIAN_PICTURES") {
            picture.write(&std::path::Path::new(&folder).join(format!("upright-{name}.png")));
        }
        let width = picture.size[0] as usize;
        let pixels: Vec<[u8; 3]> = picture.pixels().collect();
        let row = |y: usize, xs: std::ops::Range<usize>| xs.map(move |x| (x, y)).map(|(x, y)| pixels[y * width + x]);
        // The cube has three sides of three colours, and edges and letters in white.
        let cube = desk.cube();
        let of_cube: Vec<[u8; 3]> = (cube.top() as usize..cube.bottom() as usize)
            .flat_map(|y| row(y, cube.left() as usize..cube.right() as usize))
            .collect();
        let count = |is: fn([u8; 3]) -> bool| of_cube.iter().filter(|p| is(**p)).count();
        assert!(count(|[r, g, b]| r > 60 && b < 10 && r > 2 * g.max(1) - g) > 150, "a side along x");
        assert!(count(|[r, g, b]| r < 10 && g > 40 && g > b) > 150, "a side along y");
        assert!(count(|[r, g, b]| r < 10 && b > 60 && b > g) > 150, "a side along z");
        assert!(count(bright) > 60, "edges and letters");
        // The longest bright run of a row at the lower left.
        let run = (picture.size[1] as usize - 90..picture.size[1] as usize - 20)
            .map(|y| {
                let mut best = (0, 0);
                for pixel in row(y, 0..280) {
                    best.1 = if bright(pixel) { best.1 + 1 } else { 0 };
                    best.0 = best.0.max(best.1);
                }
                best.0
            })
            .max()
            .unwrap();
        longest.push(run);
    }
    assert!((60..=165).contains(&longest[0]), "a bar in the scene of a patient: {longest:?}");
    assert!(longest[1] < 40, "no bar without a unit: {longest:?}");
}
