//! Polygons, spheres and boxes that the mouse draws in the picture: the requests of presses, drags, keys and numbers.

use std::time::{Duration, Instant};

use egui::{Key, Modifiers, Pos2, Role, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::{By, NodeT, Queryable as _};
use glam::DVec3;
use sg_proto::scene::{Combine, selection_operation, selection_step};
use sg_viewer::display::{Backend, Request};
use sg_viewer::window::{MouseTool, WindowUi};

use crate::stage::scene;
use crate::window_ui::desk;

/// A desk of these tests.
struct Desk {
    harness: Harness<'static, WindowUi>,
    service: Backend,
    _folder: tempfile::TempDir,
}

impl Desk {
    /// A desk with a tool, once its picture and its surface in front are known.
    fn open(mouse_tool: MouseTool) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let (harness, service) = desk(mouse_tool, folder.path());
        let mut desk = Self { harness, service, _folder: folder };
        desk.harness.run_steps(3);
        desk.settle();
        desk
    }

    fn settle(&mut self) {
        let began = Instant::now();
        while !self.harness.state().is_settled() {
            assert!(began.elapsed() < Duration::from_secs(60), "the window comes to no rest");
            std::thread::sleep(Duration::from_millis(10));
            self.harness.step();
        }
        self.harness.step();
    }

    /// A drag along places; a single one is a click.
    fn drag(&mut self, places: &[Pos2]) {
        let (first, last) = (places[0], places[places.len() - 1]);
        self.harness.hover_at(first);
        self.harness.step();
        self.harness.drag_at(first);
        self.harness.step();
        for place in places {
            self.harness.hover_at(*place);
            self.harness.step();
        }
        self.harness.drop_at(last);
        self.harness.run_steps(2);
    }

    /// Clicks with the modifiers held, as a keyboard sends them.
    fn click(&mut self, at: Pos2, modifiers: Modifiers) {
        self.harness.event(egui::Event::ModifiersChanged(modifiers));
        self.drag(&[at]);
        self.harness.event(egui::Event::ModifiersChanged(Modifiers::NONE));
    }

    fn key(&mut self, key: Key) {
        self.harness.key_press(key);
        self.harness.step();
    }

    /// The operations that have been requested, with their combination.
    fn asked(&self) -> Vec<(selection_operation::Operation, Combine)> {
        let of = |request| {
            let Request::Select(strokes) = request else { panic!("{request:?}") };
            let [step] = strokes.steps.as_slice() else { panic!("{strokes:?}") };
            let Some(selection_step::Step::Operation(found)) = step.step.clone() else { panic!("{step:?}") };
            (found.operation.clone().unwrap(), found.combine())
        };
        self.service.requests.try_iter().map(of).collect()
    }

    /// Corners of the polygons that have been requested, with their combination.
    fn polygons(&self) -> Vec<(Vec<Vec2>, Combine)> {
        let of = |(operation, combine)| {
            let selection_operation::Operation::Lasso(lasso) = operation else { panic!("{operation:?}") };
            (lasso.polygon.chunks(2).map(|c| Vec2::new(c[0] as f32, c[1] as f32)).collect(), combine)
        };
        self.asked().into_iter().map(of).collect()
    }
}

/// Ways from each corner to the next.
fn legs(corners: &[Vec2]) -> Vec<Vec2> {
    corners.windows(2).map(|pair| pair[1] - pair[0]).collect()
}

#[test]
fn a_polygon_is_closed_by_its_first_corner_by_a_double_click_and_by_enter() {
    let mut desk = Desk::open(MouseTool::Polygon);
    let corners = [Pos2::new(420.0, 200.0), Pos2::new(560.0, 230.0), Pos2::new(600.0, 380.0), Pos2::new(450.0, 420.0)];
    let expected = legs(&corners.map(Pos2::to_vec2));
    // The last one closes it: on the first corner, as the second of a double click, or by a key.
    for ends in ["first corner", "double click", "double click in one frame", "Enter", "Shift and Enter"] {
        let one_by_one = if ends.ends_with("frame") { 3 } else { 4 };
        corners.iter().take(one_by_one).for_each(|corner| desk.click(*corner, Modifiers::NONE));
        assert_eq!(desk.polygons(), [], "{ends}: it is open");
        match ends {
            "first corner" => desk.click(corners[0] + Vec2::new(3.0, -2.0), Modifiers::NONE),
            "double click" => desk.click(corners[3] + Vec2::new(1.0, 1.0), Modifiers::NONE),
            "double click in one frame" => {
                desk.harness.hover_at(corners[3]);
                for _ in 0..2 {
                    desk.harness.drag_at(corners[3]);
                    desk.harness.drop_at(corners[3]);
                }
                desk.harness.step();
            }
            "Enter" => desk.key(Key::Enter),
            _ => {
                desk.harness.event(egui::Event::ModifiersChanged(Modifiers::SHIFT));
                desk.key(Key::Enter);
                desk.harness.event(egui::Event::ModifiersChanged(Modifiers::NONE));
            }
        }
        let asked = desk.polygons();
        let [(polygon, combine)] = asked.as_slice() else { panic!("{ends}: {asked:?}") };
        assert_eq!(legs(polygon), expected, "{ends}");
        assert_eq!(*combine == Combine::Remove, ends.starts_with("Shift"), "{ends}");
    }
}

#[test]
fn corners_are_taken_back_moved_and_given_up() {
    let mut desk = Desk::open(MouseTool::Polygon);
    let corners = [Pos2::new(420.0, 200.0), Pos2::new(560.0, 230.0), Pos2::new(600.0, 380.0)];
    desk.click(corners[0], Modifiers::NONE);
    desk.click(corners[1], Modifiers::NONE);
    // Two corners enclose nothing, and the key does not go to the agents' field.
    desk.key(Key::Enter);
    assert_eq!(desk.polygons(), []);
    desk.click(Pos2::new(700.0, 500.0), Modifiers::NONE);
    // Nothing is deleted.
    desk.key(Key::Backspace);
    assert_eq!(desk.polygons(), []);
    // A press that is held moves its corner; with Alt the mouse turns the eye.
    desk.drag(&[Pos2::new(640.0, 330.0), Pos2::new(620.0, 360.0), corners[2]]);
    desk.click(Pos2::new(500.0, 500.0), Modifiers::ALT);
    desk.key(Key::Enter);
    let asked = desk.polygons();
    let [(polygon, Combine::Add)] = asked.as_slice() else { panic!("{asked:?}") };
    assert_eq!(legs(polygon), legs(&corners.map(Pos2::to_vec2)));

    corners.iter().for_each(|corner| desk.click(*corner, Modifiers::NONE));
    desk.key(Key::Escape);
    desk.key(Key::L);
    desk.key(Key::J);
    corners.iter().take(2).for_each(|corner| desk.click(*corner, Modifiers::NONE));
    desk.key(Key::N);
    desk.key(Key::J);
    desk.click(corners[2], Modifiers::NONE);
    desk.key(Key::Enter);
    assert_eq!(desk.polygons(), [], "neither Esc nor another tool leaves corners behind");
}

/// Draws a shape and returns its centre and its half edges, scene coordinates; a sphere has its radius three times.
fn drawn(desk: &mut Desk, way: Vec2) -> (DVec3, DVec3, Combine, Pos2) {
    // The scene has gaps.
    let places = (0..200).map(|k| Pos2::new(420.0 + 20.0 * (k % 10) as f32, 180.0 + 15.0 * (k / 10) as f32));
    for place in places {
        desk.drag(&[place, place + 0.5 * way, place + way]);
        if let Some((operation, combine)) = desk.asked().pop() {
            let (centre, half) = extent(&operation);
            return (centre, half, combine, place);
        }
    }
    panic!("no surface in front");
}

fn extent(operation: &selection_operation::Operation) -> (DVec3, DVec3) {
    let bounds = scene().bounds;
    let place = |p: &[f64]| bounds.denormalize(DVec3::from_slice(p));
    match operation {
        selection_operation::Operation::Sphere(sphere) => {
            (place(&sphere.centre), DVec3::splat(sphere.radius * bounds.longest_edge()))
        }
        selection_operation::Operation::Box(found) => {
            let (min, max) = (place(&found.min), place(&found.max));
            (0.5 * (min + max), 0.5 * (max - min))
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_sphere_and_a_box_are_drawn_from_a_place_of_the_surface() {
    for (tool, key, fields) in [
        (MouseTool::Sphere, Key::O, ["centre x", "centre y", "centre z", "radius"].as_slice()),
        (MouseTool::Box, Key::C, ["centre x", "centre y", "centre z", "edge x", "edge y", "edge z"].as_slice()),
    ] {
        let mut desk = Desk::open(MouseTool::Navigate);
        desk.key(key);
        desk.settle();
        assert!(desk.harness.query_by_label_contains("Press on the surface and drag").is_some());
        let (centre, half, combine, press) = drawn(&mut desk, Vec2::new(60.0, 20.0));
        assert_eq!(combine, Combine::Add, "{tool:?}");
        let bounds = scene().bounds;
        assert!(bounds.normalize(centre).cmpge(DVec3::splat(-0.1)).all(), "{tool:?}: {centre}");
        assert!((half - DVec3::splat(half.x)).abs().max_element() < 1e-9 && half.x > 0.3 && half.x < 3.0, "{half}");

        // Twice the way is about twice the radius: the perspective is that of the line of sight.
        desk.harness.event(egui::Event::ModifiersChanged(Modifiers::SHIFT));
        let way = Vec2::new(120.0, 40.0);
        desk.drag(&[press, press + 0.5 * way, press + way]);
        desk.harness.event(egui::Event::ModifiersChanged(Modifiers::NONE));
        let asked = desk.asked();
        let [(operation, Combine::Remove)] = asked.as_slice() else { panic!("{tool:?}: {asked:?}") };
        let (again, wide) = extent(operation);
        assert!((again - centre).length() < 1e-9 && (wide.x / half.x - 2.0).abs() < 0.1, "{half} {wide}");

        // Its numbers, and the number of Gaussians inside, are beside the picture.
        desk.settle();
        let inside = |i: usize| {
            let way = (scene().position(i).unwrap() - again).abs();
            if tool == MouseTool::Sphere { way.length() < wide.x } else { way.max_element() <= wide.x + 1e-9 }
        };
        let inside = (0..scene().len()).filter(|i| inside(*i)).count();
        assert!(inside > 5, "{tool:?}");
        desk.harness.get_by_label(&format!("{inside} Gaussians inside"));
        let numbers: Vec<_> = {
            let spin = By::new().predicate(|node| node.role() == Role::SpinButton);
            desk.harness.query_all(spin).filter_map(|node| node.accesskit_node().label()).collect()
        };
        assert_eq!(numbers, fields, "{tool:?}");
        for (button, expected) in [
            ("add", Combine::Add),
            ("take away", Combine::Remove),
            ("only these", Combine::Replace),
            ("intersect", Combine::Intersect),
        ] {
            desk.harness.get_by_label(button).click();
            desk.harness.run_steps(2);
            let asked = desk.asked();
            let [(again, combine)] = asked.as_slice() else { panic!("{button}: {asked:?}") };
            assert_eq!((again, *combine), (operation, expected), "{button}");
        }

        // Esc removes it, and a click without it makes none.
        desk.key(Key::Escape);
        desk.settle();
        desk.click(press, Modifiers::NONE);
        assert!(desk.harness.query_by_label_contains("Gaussians inside").is_none());
        assert_eq!(desk.asked(), []);
    }
}

#[test]
fn a_typed_number_and_a_click_change_a_shape_before_it_is_applied_again() {
    let mut desk = Desk::open(MouseTool::Sphere);
    let (centre, _, _, press) = drawn(&mut desk, Vec2::new(60.0, 20.0));
    desk.settle();
    let radius = |desk: &Desk| {
        let spin =
            By::new().predicate(|node| node.role() == Role::SpinButton && node.label().as_deref() == Some("radius"));
        desk.harness.query_all(spin).next().unwrap().rect().center()
    };
    desk.click(radius(&desk), Modifiers::NONE);
    desk.harness.key_press_modifiers(Modifiers::COMMAND, Key::A);
    desk.harness.event(egui::Event::Text("2.5".to_owned()));
    desk.harness.step();
    desk.key(Key::Enter);
    desk.harness.run_steps(2);
    assert_eq!(desk.asked(), [], "a number alone selects nothing");
    // The surface may be missing beside the first press, not at it.
    desk.click(press, Modifiers::NONE);
    assert_eq!(desk.asked(), [], "a click alone selects nothing");
    desk.harness.get_by_label("only these").click();
    desk.harness.run_steps(2);
    let asked = desk.asked();
    let [(operation, Combine::Replace)] = asked.as_slice() else { panic!("{asked:?}") };
    let (again, half) = extent(operation);
    assert!((again - centre).length() < 1e-9 && (half.x - 2.5).abs() < 1e-9, "{again} {half}");
}

/// The texts that the window paints.
fn texts(harness: &Harness<'_, WindowUi>) -> Vec<String> {
    let text = |shape: &egui::Shape| {
        if let egui::Shape::Text(text) = shape { Some(text.galley.text().to_owned()) } else { None }
    };
    harness.output().shapes.iter().filter_map(|clipped| text(&clipped.shape)).collect()
}

#[test]
fn the_grid_is_switched_by_its_key_and_remembered() {
    let mut desk = Desk::open(MouseTool::Navigate);
    let lines = |desk: &Desk| {
        let is_line = |shape: &egui::Shape| matches!(shape, egui::Shape::LineSegment { .. });
        desk.harness.output().shapes.iter().filter(|clipped| is_line(&clipped.shape)).count()
    };
    let label = |desk: &Desk| texts(&desk.harness).iter().any(|text| text.starts_with("grid 2, box 11 × "));
    let without = lines(&desk);
    assert!(!desk.harness.state().settings().grid && !label(&desk));
    desk.harness.key_press_modifiers(Modifiers::SHIFT, Key::G);
    desk.harness.step();
    desk.settle();
    assert!(desk.harness.state().settings().grid && label(&desk), "{:?}", texts(&desk.harness));
    assert!(lines(&desk) > without + 20, "{} {without}", lines(&desk));
    desk.harness.key_press_modifiers(Modifiers::SHIFT, Key::G);
    desk.harness.step();
    assert!(!desk.harness.state().settings().grid && !label(&desk) && lines(&desk) == without);
}
