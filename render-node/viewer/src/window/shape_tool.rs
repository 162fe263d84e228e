//! Spheres and boxes of the scene that select what lies within: drawn from a place on the surface, then changed by numbers.

use std::sync::Arc;

use egui::{DragValue, Grid, Pos2, Ui};
use glam::{DVec2, DVec3};
use sg_clusters::geometry::GeometryOptions;
use sg_proto::scene::{
    Combine, InBox, InSphere, SelectionOperation, SelectionStep, selection_operation, selection_step,
};
use sg_proto::selection::StrokesRequest;
use sg_scene::camera::Camera;
use sg_scene::mask::Mask;
use sg_scene::model::{Scene, SceneBox};
use sg_scene::orientation::LengthUnit;
use sg_selection::operation_context::OperationContext;
use sg_selection::operations::{self, Operation};

use super::tool_card;
use crate::display::{BrushSign, LatestWorker, Request, ViewState};

/// Points of a drag from which on it makes a shape; a shorter one is a click.
pub(super) const LEAST_DRAG: f32 = 4.0;

/// Lines of a circle.
const CIRCLE: u32 = 72;

/// A drag over one point changes a number by this share of the scene's longest edge.
const SPEED: f64 = 1e-3;

/// Shares of the scene's longest edge: the finest step that numbers show, and the largest number that they take.
const NUMBERS: (f64, f64) = (1e-5, 1e3);

/// The buttons of the card: name, combination, effect.
pub(super) const BUTTONS: [(&str, Combine, &str); 4] = [
    ("add", Combine::Add, "adds what lies inside to the selection"),
    ("take away", Combine::Remove, "takes what lies inside out of the selection"),
    ("only these", Combine::Replace, "selects what lies inside, and nothing else"),
    ("intersect", Combine::Intersect, "keeps of the selection what lies inside"),
];

/// How far a shape reaches from its centre, scene lengths.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Reach {
    /// A sphere's radius.
    Radius(f64),
    /// Half the edges of a box along the scene's axes.
    HalfEdges(DVec3),
}

/// A region of the scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Shape {
    /// Scene coordinates.
    pub(super) centre: DVec3,
    pub(super) reach: Reach,
}

impl Shape {
    /// The operation of files and of the selection, in parts of the scene's box.
    fn operation(&self, bounds: SceneBox) -> Operation {
        let place = |p: DVec3| bounds.normalize(p).to_array();
        let combine = operations::Combine::Replace;
        match self.reach {
            Reach::Radius(radius) => {
                Operation::Sphere { centre: place(self.centre), radius: radius / bounds.longest_edge(), combine }
            }
            Reach::HalfEdges(half) => {
                Operation::Box { min: place(self.centre - half), max: place(self.centre + half), combine }
            }
        }
    }

    /// The request that selects by it; `None` for one that no selection takes.
    pub(super) fn request(&self, bounds: SceneBox, combine: Combine, include_hidden: bool) -> Option<Request> {
        let operation = self.operation(bounds);
        operation.check().ok()?;
        let operation = match operation {
            Operation::Sphere { centre, radius, .. } => {
                selection_operation::Operation::Sphere(InSphere { centre: centre.to_vec(), radius })
            }
            Operation::Box { min, max, .. } => {
                selection_operation::Operation::Box(InBox { min: min.to_vec(), max: max.to_vec() })
            }
            _ => return None,
        };
        let operation = SelectionOperation { operation: Some(operation), combine: combine.into() };
        let step = SelectionStep { step: Some(selection_step::Step::Operation(operation)) };
        Some(Request::Select(StrokesRequest { steps: vec![step], include_hidden, ..StrokesRequest::default() }))
    }

    /// Its edges as an eye sees them: a box's twelve, or three circles of a sphere and its rim.
    pub(super) fn lines(&self, eye: DVec3) -> Vec<[DVec3; 2]> {
        match self.reach {
            Reach::HalfEdges(half) => {
                let corner = |k: usize| {
                    let sign = |bit: usize| if k >> bit & 1 == 0 { -1.0 } else { 1.0 };
                    self.centre + half * DVec3::new(sign(0), sign(1), sign(2))
                };
                let edges = (0..8).flat_map(|k| [1, 2, 4].map(|bit| (k, k | bit)));
                edges.filter(|(a, b)| a != b).map(|(a, b)| [corner(a), corner(b)]).collect()
            }
            Reach::Radius(radius) => {
                let axes = [(DVec3::X, DVec3::Y), (DVec3::Y, DVec3::Z), (DVec3::Z, DVec3::X)];
                let mut lines: Vec<_> =
                    axes.iter().flat_map(|(a, b)| circle(self.centre, radius * *a, radius * *b)).collect();
                let way = eye - self.centre;
                // The rim is where lines from the eye touch the sphere; from within there is none.
                let share = (radius / way.length()).powi(2);
                if share < 1.0 {
                    let (a, b) = way.normalize().any_orthonormal_pair();
                    let rim = radius * (1.0 - share).sqrt();
                    lines.extend(circle(self.centre + share * way, rim * a, rim * b));
                }
                lines
            }
        }
    }
}

/// The lines of an ellipse with these half axes.
fn circle(centre: DVec3, a: DVec3, b: DVec3) -> impl Iterator<Item = [DVec3; 2]> {
    let at = move |k: u32| {
        let (sine, cosine) = (std::f64::consts::TAU * f64::from(k) / f64::from(CIRCLE)).sin_cos();
        centre + cosine * a + sine * b
    };
    (0..CIRCLE).map(move |k| [at(k), at(k + 1)])
}

/// What the preview of a shape depends on.
#[derive(Debug, Clone)]
pub(super) struct Wanted {
    geometry: Arc<Scene>,
    shape: Shape,
    sign: BrushSign,
    include_hidden: bool,
    selected: Arc<Mask>,
    scene: Arc<sg_edit::EditState>,
}

impl PartialEq for Wanted {
    fn eq(&self, other: &Self) -> bool {
        let plain = |w: &Self| (w.shape, w.sign, w.include_hidden, w.scene.revision());
        plain(self) == plain(other)
            && Arc::ptr_eq(&self.selected, &other.selected)
            && Arc::ptr_eq(&self.geometry, &other.geometry)
    }
}

/// What a shape would select.
#[derive(Debug, Clone)]
pub(super) struct Preview {
    /// The selection before.
    pub(super) base: Arc<Mask>,
    /// The selection after.
    pub(super) selected: Arc<Mask>,
    /// Gaussians inside that can be selected.
    pub(super) inside: usize,
}

impl Preview {
    fn of(wanted: &Wanted) -> Self {
        let Wanted { geometry, shape, sign, include_hidden, selected, scene } = wanted;
        // It computes neighbours and features where an operation needs them; a shape does not.
        let context = OperationContext::new(Arc::clone(geometry), GeometryOptions::default());
        let mut found = Mask::empty(selected.len());
        let operation = shape.operation(context.scene().bounds);
        // A shape needs no geometry, so nothing fails; without a result nothing is inside.
        let is_known = operation.check().is_ok() && context.apply(&operation, &mut found).is_ok();
        if !is_known {
            found = Mask::empty(selected.len());
        }
        found.intersect_with(&if *include_hidden { scene.existing() } else { scene.visible_in(geometry) });
        let inside = found.count();
        let mut after = Mask::clone(selected);
        match sign {
            BrushSign::Add => after.union_with(&found),
            BrushSign::Remove => after.subtract(&found),
        }
        Self { base: Arc::clone(selected), selected: Arc::new(after), inside }
    }
}

/// A drag under way.
#[derive(Debug, Clone, Copy)]
pub(super) struct Drag {
    pub(super) press: Pos2,
    /// The shape before the press.
    pub(super) before: Option<Shape>,
}

/// The tool of spheres and boxes.
pub(super) struct ShapeTool {
    pub(super) shape: Option<Shape>,
    pub(super) drag: Option<Drag>,
    /// Whether the shape differs from the one that was last applied.
    pub(super) is_changed: bool,
    pub(super) worker: LatestWorker<Wanted, Preview>,
    pub(super) wanted: Option<Wanted>,
    pub(super) preview: Option<Preview>,
}

impl ShapeTool {
    /// A tool without a shape. Previews are computed on `pool`; `wake` is called after each.
    ///
    /// # Errors
    /// The system's error if it cannot start a thread.
    pub(super) fn new(pool: Arc<rayon::ThreadPool>, wake: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        let work = move |wanted: Wanted| pool.install(|| Preview::of(&wanted));
        let worker = LatestWorker::new("finds-inside", work, wake)?;
        Ok(Self { shape: None, drag: None, is_changed: false, worker, wanted: None, preview: None })
    }

    /// Forgets the shape.
    pub(super) fn clear(&mut self) {
        (self.shape, self.drag, self.is_changed, self.wanted, self.preview) = (None, None, false, None, None);
    }

    /// Whether no preview is computed or waits.
    pub(super) fn is_idle(&self) -> bool {
        self.worker.is_idle()
    }

    /// The selection with a shape that has not been applied, as far as it is known.
    pub(super) fn would_select(&self, selected: &Arc<Mask>) -> Option<Arc<Mask>> {
        let preview =
            self.preview.as_ref().filter(|preview| self.is_changed && Arc::ptr_eq(&preview.base, selected))?;
        Some(Arc::clone(&preview.selected))
    }

    /// Asks for the preview of the shape, and takes the newest.
    pub(super) fn update(&mut self, geometry: &Arc<Scene>, sign: BrushSign, state: &ViewState, include_hidden: bool) {
        let Some(shape) = self.shape else { return };
        if let Some(preview) = self.worker.take() {
            self.preview = Some(preview);
        }
        let (selected, scene) = (Arc::clone(&state.selected), Arc::clone(&state.scene));
        let wanted = Wanted { geometry: Arc::clone(geometry), shape, sign, include_hidden, selected, scene };
        if self.wanted.as_ref() != Some(&wanted) {
            self.worker.submit(wanted.clone());
            self.wanted = Some(wanted);
        }
    }
}

/// The distance of a scene point from the line of sight through a place of a picture.
pub(super) fn distance_from_sight(camera: &Camera, place: DVec2, point: DVec3) -> f64 {
    let seen = camera.view().transform_point3(point);
    let ray = DVec3::new((place.x - camera.cx) / camera.fx, (place.y - camera.cy) / camera.fy, 1.0);
    seen.cross(ray).length() / ray.length()
}

impl Shape {
    /// Its numbers to change, in the scene's unit, where `length` is the scene's longest edge.
    pub(super) fn numbers(&mut self, ui: &mut Ui, length: f64, unit: Option<LengthUnit>) {
        let decimals = (-(NUMBERS.0 * length).log10()).ceil().clamp(0.0, 12.0) as usize;
        let most = NUMBERS.1 * length;
        let number = |ui: &mut Ui, name: &str, value: &mut f64, least: f64| {
            let text = move |x: f64, _| tool_card::plain(x, decimals);
            let field = DragValue::new(value).speed(SPEED * length).range(least..=most).custom_formatter(text);
            let response = ui.add(field.update_while_editing(false));
            ui.ctx().accesskit_node_builder(response.id, |node| node.set_label(name));
        };
        let in_unit = |name: &str| tool_card::in_unit(name, unit);
        Grid::new("numbers of a shape").num_columns(4).show(ui, |ui| {
            ui.label(in_unit("centre"));
            let DVec3 { x, y, z } = &mut self.centre;
            for (name, value) in [("centre x", x), ("centre y", y), ("centre z", z)] {
                number(ui, name, value, -most);
            }
            ui.end_row();
            match &mut self.reach {
                Reach::Radius(radius) => {
                    ui.label(in_unit("radius"));
                    number(ui, "radius", radius, 0.0);
                }
                Reach::HalfEdges(half) => {
                    ui.label(in_unit("edges"));
                    let mut edges = 2.0 * *half;
                    let DVec3 { x, y, z } = &mut edges;
                    for (name, value) in [("edge x", x), ("edge y", y), ("edge z", z)] {
                        number(ui, name, value, 0.0);
                    }
                    *half = 0.5 * edges;
                }
            }
            ui.end_row();
        });
    }
}

#[cfg(test)]
mod tests {
    use sg_edit::EditState;
    use sg_scene::synthetic::test_scene;
    use sg_scene::view::View;

    use super::*;

    #[test]
    fn the_way_of_the_mouse_is_the_reach_of_the_shape() {
        let eye = DVec3::new(0.0, -4.0, 0.0);
        let camera = View { eye, target: DVec3::ZERO, up: DVec3::Z, fov_y_degrees: 40.0 }.camera(400, 300);
        let centre = DVec3::new(0.3, 1.0, -0.2);
        assert!(distance_from_sight(&camera, seen(&camera, centre), centre) < 1e-12);
        // The rim of a sphere whose radius is the mouse's way passes below the mouse.
        let place = DVec2::new(260.0, 120.0);
        let sphere = Shape { centre, reach: Reach::Radius(distance_from_sight(&camera, place, centre)) };
        let nearest = sphere.lines(eye).into_iter().flatten().map(|p| seen(&camera, p).distance(place));
        assert!(nearest.fold(f64::INFINITY, f64::min) < 6.0);
        let beyond = |p: DVec3| (seen(&camera, p) - seen(&camera, centre)).length() - 1.5;
        let way = place.distance(seen(&camera, centre));
        assert!(sphere.lines(eye).into_iter().flatten().all(|p| beyond(p) < 1.05 * way));
        // From within a sphere no rim is seen.
        assert_eq!(Shape { centre, reach: Reach::Radius(9.0) }.lines(eye).len(), 3 * CIRCLE as usize);
    }

    fn seen(camera: &Camera, p: DVec3) -> DVec2 {
        let p = camera.view().transform_point3(p);
        DVec2::new(camera.fx * p.x, camera.fy * p.y) / p.z + DVec2::new(camera.cx, camera.cy)
    }

    #[test]
    fn a_preview_is_what_the_selection_makes_of_the_shape() {
        let scene = Arc::new(test_scene(&[("cloud", 600), ("hidden", 200)]));
        let state = Arc::new(EditState::of_scene(&scene, "scene.toml", "hash"));
        let hide = sg_proto::scene::SetVisibility {
            target: Some(sg_proto::scene::Target { units: vec!["hidden".to_owned()], ..Default::default() }),
            visible: false,
        };
        let action = sg_proto::scene::command::Action::SetVisibility(hide);
        let state = Arc::new(state.after(&scene, action).unwrap());
        let selected = Arc::new(Mask::from_fn(scene.len(), |i| i < 100));
        let centre = DVec3::new(4.0, 5.0, 6.0);
        let half = DVec3::new(1.0, 3.0, 2.0);
        for (reach, includes) in [
            (Reach::Radius(3.0), Box::new(move |p: DVec3| p.distance(centre) < 3.0) as Box<dyn Fn(DVec3) -> bool>),
            (Reach::HalfEdges(half), Box::new(move |p: DVec3| (p - centre).abs().cmple(half + 1e-9).all())),
        ] {
            let is_inside = |i: usize| includes(scene.position(i).unwrap());
            let of = |sign, include_hidden| {
                let geometry = Arc::clone(&scene);
                let (selected, scene) = (Arc::clone(&selected), Arc::clone(&state));
                let shape = Shape { centre, reach };
                Preview::of(&Wanted { geometry, shape, sign, include_hidden, selected, scene })
            };
            let added = of(BrushSign::Add, false);
            let expected = Mask::from_fn(scene.len(), |i| i < 100 || (i < 600 && is_inside(i)));
            assert_eq!((&*added.selected, added.inside), (&expected, (0..600).filter(|i| is_inside(*i)).count()));
            assert!(added.inside > 10);
            let all = of(BrushSign::Add, true);
            assert_eq!(all.inside, (0..800).filter(|i| is_inside(*i)).count());
            let left = of(BrushSign::Remove, false).selected;
            assert_eq!(*left, Mask::from_fn(scene.len(), |i| i < 100 && !is_inside(i)));
        }
    }

    #[test]
    fn a_shape_without_finite_numbers_is_not_asked_for() {
        let bounds = SceneBox { min: DVec3::ZERO, max: DVec3::ONE };
        let of = |centre: DVec3, reach| Shape { centre, reach }.request(bounds, Combine::Add, false);
        assert!(of(DVec3::ONE, Reach::Radius(0.1)).is_some());
        assert_eq!(of(DVec3::NAN, Reach::Radius(0.1)), None);
        assert_eq!(of(DVec3::ONE, Reach::HalfEdges(DVec3::splat(f64::INFINITY))), None);
    }
}
