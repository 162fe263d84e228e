//! The gizmo and the numbers that move the selection: what they show, and the one request of a release.

use std::sync::Arc;
use std::time::{Duration, Instant};

use egui::epaint::ColorMode;
use egui::{Color32, Key, Modifiers, Pos2, Role, Shape};
use egui_kittest::Harness;
use egui_kittest::kittest::{By, Queryable as _};
use glam::DVec3;
use sg_edit::wire::decode_vector;
use sg_proto::scene::TransformGaussians;
use sg_proto::scene::command::Action;
use sg_viewer::display::{Backend, Request};
use sg_viewer::window::{MouseTool, WindowUi};

use crate::stage::{after, scene, select};
use crate::window_ui::desk;

/// Colour of the handles of the x axis, and the opacity of the white square.
const X: Color32 = Color32::from_rgb(0xd5, 0x5e, 0x00);
const SQUARE: u8 = 210;

/// A desk whose selection is the first hundred Gaussians.
struct Desk {
    harness: Harness<'static, WindowUi>,
    service: Backend,
    _folder: tempfile::TempDir,
}

impl Desk {
    fn open() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let (harness, service) = desk(MouseTool::Navigate, folder.path());
        let mut desk = Self { harness, service, _folder: folder };
        desk.show([select(&scene(), 0..100)]);
        desk.harness.key_press_modifiers(Modifiers::SHIFT, Key::M);
        desk.harness.run_steps(2);
        desk.settle();
        desk
    }

    /// The scene's service confirms these changes.
    fn show(&mut self, actions: impl IntoIterator<Item = Action>) {
        let mut state = sg_edit::EditState::clone(&after(&scene(), actions));
        let newest = self.service.writer.newest().scene.revision();
        while state.revision() <= newest {
            // A revision of its own, without another change.
            let term = sg_proto::scene::SetTerm { term: 1 };
            state = state.after(&scene(), Action::SetTerm(term)).unwrap();
        }
        self.service.writer.update(|view| {
            view.selected = Arc::clone(state.selection().mask());
            view.scene = Arc::new(state.clone());
        });
        self.harness.step();
    }

    fn settle(&mut self) {
        let began = Instant::now();
        self.harness.step();
        while !self.harness.state().is_settled() {
            assert!(began.elapsed() < Duration::from_secs(60), "the window comes to no rest");
            std::thread::sleep(Duration::from_millis(10));
            self.harness.step();
        }
        self.harness.run_steps(2);
    }

    fn shapes(&self) -> impl Iterator<Item = &Shape> {
        self.harness.output().shapes.iter().map(|clipped| &clipped.shape)
    }

    /// The middle of the gizmo on screen, where there is one.
    fn square(&self) -> Option<Pos2> {
        self.shapes().find_map(|shape| match shape {
            Shape::Rect(rect) if rect.fill == Color32::from_white_alpha(SQUARE) => Some(rect.rect.center()),
            _ => None,
        })
    }

    /// A place on the arrow of the x axis, and its way.
    fn arrow(&self) -> (Pos2, egui::Vec2) {
        let found = self.shapes().find_map(|shape| match shape {
            Shape::Path(path) if path.points.len() == 2 && path.stroke.color == ColorMode::Solid(X) => {
                Some((path.points[0], path.points[1]))
            }
            _ => None,
        });
        let (from, to) = found.unwrap();
        (from + 0.6 * (to - from), (to - from).normalized())
    }

    fn pressed(&mut self, at: Pos2) {
        self.harness.hover_at(at);
        self.harness.step();
        self.harness.drag_at(at);
        self.harness.step();
    }

    fn dragged(&mut self, to: Pos2) {
        self.harness.hover_at(to);
        self.harness.run_steps(2);
        self.settle();
    }

    /// The moves that have been requested.
    fn asked(&self) -> Vec<TransformGaussians> {
        let of = |request| match request {
            Request::Change(action) => match *action {
                Action::TransformGaussians(moved) => moved,
                other => panic!("{other:?}"),
            },
            other => panic!("{other:?}"),
        };
        self.service.requests.try_iter().map(of).collect()
    }

    fn field(&self, name: &str) -> Pos2 {
        let spin = By::new().predicate(|node| node.role() == Role::SpinButton && node.label().as_deref() == Some(name));
        self.harness.query_all(spin).next().unwrap().rect().center()
    }

    fn typed(&mut self, name: &str, text: &str) {
        let at = self.field(name);
        self.pressed(at);
        self.harness.drop_at(at);
        self.harness.step();
        self.harness.key_press_modifiers(Modifiers::COMMAND, Key::A);
        self.harness.event(egui::Event::Text(text.to_owned()));
        self.harness.step();
        self.harness.key_press(Key::Enter);
        self.harness.run_steps(2);
        self.settle();
    }
}

/// How far the shown scene has a Gaussian from its place in the file.
fn moved(desk: &Desk, i: usize) -> DVec3 {
    desk.harness.state().scene().position(i).unwrap() - scene().position(i).unwrap()
}

#[test]
fn an_arrow_moves_the_selection_as_a_preview_and_asks_once_on_release() {
    let mut desk = Desk::open();
    let square = desk.square().unwrap();
    let (press, way) = desk.arrow();
    desk.pressed(press);
    desk.dragged(press + 60.0 * way);
    // The picture shows it already, and nobody was asked.
    let shift = moved(&desk, 5);
    assert!(shift.x > 0.05 && shift.y.abs() < 1e-5 && shift.z.abs() < 1e-5, "{shift}");
    assert_eq!((moved(&desk, 500), desk.asked()), (DVec3::ZERO, vec![]));
    let there = desk.square().unwrap();
    assert!((there - square).dot(way) > 40.0, "the gizmo goes along: {square} {there}");
    desk.harness.drop_at(press + 60.0 * way);
    desk.harness.run_steps(2);
    let asked = desk.asked();
    let [one] = asked.as_slice() else { panic!("{asked:?}") };
    let by = decode_vector(one.shift.as_ref().unwrap());
    assert!((by - shift).length() < 1e-4, "{by} {shift}");
    assert!(one.target.as_ref().unwrap().selection && one.factor.is_none() && one.axis.is_none());
    // Until the scene confirms it, and from then on, it is shown there.
    desk.settle();
    assert!((moved(&desk, 5) - shift).length() < 1e-4);
    desk.show([select(&scene(), 0..100), Action::TransformGaussians(one.clone())]);
    desk.settle();
    assert!((moved(&desk, 5) - shift).length() < 1e-4 && moved(&desk, 500) == DVec3::ZERO);
    assert!((desk.square().unwrap() - there).length() < 6.0);
    // Undone, the file's own scene is shown again.
    desk.show([select(&scene(), 0..100)]);
    desk.settle();
    assert_eq!(moved(&desk, 5), DVec3::ZERO);
    assert!((desk.square().unwrap() - square).length() < 1.0);
}

#[test]
fn esc_gives_a_move_up_and_a_drag_beside_the_gizmo_turns_the_eye() {
    let mut desk = Desk::open();
    let square = desk.square().unwrap();
    desk.pressed(square);
    desk.dragged(square + egui::Vec2::new(60.0, 0.0));
    assert!(moved(&desk, 5).length() > 0.01, "the square scales");
    desk.harness.key_press(Key::Escape);
    desk.harness.run_steps(2);
    desk.harness.drop_at(square + egui::Vec2::new(60.0, 0.0));
    desk.settle();
    assert_eq!((moved(&desk, 5), desk.asked()), (DVec3::ZERO, vec![]));
    let (before, (_, way)) = (desk.square().unwrap(), desk.arrow());
    let beside = Pos2::new(before.x - 180.0, before.y);
    desk.pressed(beside);
    desk.dragged(beside + egui::Vec2::new(80.0, 10.0));
    desk.harness.drop_at(beside + egui::Vec2::new(80.0, 10.0));
    desk.settle();
    assert_eq!((moved(&desk, 5), desk.asked()), (DVec3::ZERO, vec![]));
    assert!((desk.arrow().1 - way).length() > 0.05, "the eye has turned");
}

#[test]
fn typed_numbers_are_shown_and_applied_in_one_step() {
    let mut desk = Desk::open();
    desk.typed("shift y", "1.5");
    assert!((moved(&desk, 5) - DVec3::new(0.0, 1.5, 0.0)).length() < 1e-4, "{}", moved(&desk, 5));
    desk.typed("degrees", "90");
    desk.typed("factor", "2");
    assert_eq!(desk.asked(), [], "numbers alone ask for nothing");
    desk.harness.get_by_label("apply").click();
    desk.harness.run_steps(2);
    let asked = desk.asked();
    let [one] = asked.as_slice() else { panic!("{asked:?}") };
    assert_eq!(decode_vector(one.shift.as_ref().unwrap()), DVec3::new(0.0, 1.5, 0.0));
    assert_eq!((decode_vector(one.axis.as_ref().unwrap()), one.degrees, one.factor), (DVec3::Z, 90.0, Some(2.0)));
    // What the request says is what the scene's owner makes of it.
    let shown = after(&scene(), [select(&scene(), 0..100), Action::TransformGaussians(one.clone())]);
    let map = shown.placements()[0].map;
    desk.settle();
    let off = desk.harness.state().scene().position(5).unwrap() - map.apply(scene().position(5).unwrap());
    assert!(off.length() < 1e-4, "{off}");
    // Put back, it is asked to go home.
    desk.show([select(&scene(), 0..100), Action::TransformGaussians(one.clone())]);
    desk.settle();
    desk.harness.get_by_label("put back").click();
    desk.harness.run_steps(2);
    let asked = desk.asked();
    let [back] = asked.as_slice() else { panic!("{asked:?}") };
    assert!(back.restore && back.shift.is_none());
}

#[test]
fn without_a_selection_there_is_no_gizmo_and_a_word_about_it() {
    let mut desk = Desk::open();
    assert!(desk.square().is_some());
    desk.show([]);
    desk.settle();
    assert!(desk.square().is_none());
    assert!(desk.harness.query_by_label_contains("Nothing is selected").is_some());
}
