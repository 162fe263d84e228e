//! What keys and buttons of a window do.

use std::time::{Duration, Instant};

use egui::Ui;
use glam::DVec2;
use sg_proto::scene::{
    Invert, Redo, SelectionOperation, SelectionStep, Undo, command, selection_operation, selection_step,
};
use sg_proto::selection::StrokesRequest;
use sg_raster::attributes::Attribute;
use sg_raster::finish::Finish;

use super::exporter::ExportJob;
use super::mouse_tool::MouseTool;
use super::shortcuts::{Action, Way};
use super::window_ui::WindowUi;
use crate::display::{BrushMode, DisplayMode, Request, ViewState, WalkParameter, other_answer};
use crate::panels::{
    Panel, crop_to_selection, delete_selection, duplicate_selection, frame_selection, select_visible, turn_up,
};

/// One step of the keys that widen and narrow the brush.
const WIDER: f64 = 1.15;

/// The way of one press of an arrow key, in heights of the picture: to turn, and to slide.
const KEY_TURN: f64 = 1.0 / 24.0;
const KEY_SLIDE: f64 = 0.05;

/// Factor of one press of the keys that go nearer and further.
const KEY_NEARER: f64 = 1.1;

/// Share of the range of a walk's leak or threshold that one press of a key or one notch of the wheel goes through.
const PARAMETER_STEP: f64 = 0.02;

/// Keys and the wheel have no release: their change commits after this rest.
const DRAG_TIMEOUT: Duration = Duration::from_millis(500);

impl WindowUi {
    /// Selects less or more by so many notches, less if positive: by another answer to the strokes for each whole notch, or by
    /// the leak or the threshold of the last walk.
    pub(super) fn change_walk(&mut self, notches: f64, state: &ViewState, requests: &mut Vec<Request>) {
        if notches == 0.0 {
            return;
        }
        let which = self.tools.walk_parameter.in_state(state);
        if which == WalkParameter::Size {
            self.answer_notches += notches;
            // A smooth scroll takes a step in the middle of its notch.
            while self.answer_notches.abs() > 0.5 {
                let wider = self.answer_notches < 0.0;
                self.answer_notches -= self.answer_notches.signum();
                self.take_answer(wider, state, requests);
            }
            return;
        }
        let output = self.drag.0.turn(which, PARAMETER_STEP * notches, state);
        match self.drag.0.tuning(state) {
            Some(tuning) => self.line = format!("{} {}", which.name(), which.written(tuning, state)),
            None => self.line = format!("brush a Region first: {} belongs to its last stroke", which.name()),
        }
        if output.is_some() {
            self.drag.1 = Instant::now();
        }
        requests.extend(output);
    }

    /// Takes the next wider or narrower answer to the strokes.
    fn take_answer(&mut self, wider: bool, state: &ViewState, requests: &mut Vec<Request>) {
        // A number that is still under the keys comes first.
        requests.extend(self.drag.0.release(state.scene.revision()));
        match other_answer(wider, self.tools.include_hidden, state) {
            Some(request) => {
                self.line.clear();
                requests.push(request);
            }
            None if wider => {
                self.line = "this is the widest answer; brush what is missing, or press G and change Reach".to_owned();
            }
            None => {
                self.line =
                    "this is the narrowest answer; brush with Shift what does not belong, or press G and change Reach"
                        .to_owned();
            }
        }
    }

    /// Commits the keys' and the wheel's change of the last walk once they rest.
    pub(super) fn release_after_rest(&mut self, ui: &Ui, state: &ViewState, requests: &mut Vec<Request>) {
        if self.drag.0.is_held() {
            match DRAG_TIMEOUT.checked_sub(self.drag.1.elapsed()) {
                Some(left) => ui.ctx().request_repaint_after(left),
                None => requests.extend(self.drag.0.release(state.scene.revision())),
            }
        }
    }

    pub(super) fn act(&mut self, action: Action, state: &ViewState, requests: &mut Vec<Request>) {
        let change = |action| Request::Change(Box::new(action));
        let (scene, selection) = (state.services.scene, state.services.selection);
        match action {
            Action::Help => self.help = !self.help,
            Action::Navigate => self.scene_view.mouse_tool = MouseTool::Navigate,
            Action::Brush => self.scene_view.mouse_tool = MouseTool::Brush,
            Action::Lasso => self.scene_view.mouse_tool = MouseTool::Lasso,
            Action::Rectangle => self.scene_view.mouse_tool = MouseTool::Rectangle,
            Action::Polygon => self.scene_view.mouse_tool = MouseTool::Polygon,
            Action::Sphere => self.scene_view.mouse_tool = MouseTool::Sphere,
            Action::Box => self.scene_view.mouse_tool = MouseTool::Box,
            Action::Move => self.scene_view.mouse_tool = MouseTool::Move,
            Action::Walk => self.tools.mode = BrushMode::Walk,
            Action::Cluster => self.tools.mode = BrushMode::Cluster,
            Action::Point => self.tools.mode = BrushMode::Point,
            Action::Wider => self.tools.widen(WIDER),
            Action::Narrower => self.tools.widen(1.0 / WIDER),
            Action::Depth => {
                self.tools.front_only = !self.tools.front_only;
                let reach = if self.tools.front_only { "only the front" } else { "the back too" };
                self.line = format!("brush, lasso, rectangle and polygon reach {reach}");
            }
            Action::Less => self.change_walk(1.0, state, requests),
            Action::More => self.change_walk(-1.0, state, requests),
            Action::NextParameter => {
                self.tools.walk_parameter = self.tools.walk_parameter.next(state);
                self.line = format!("keys and the wheel change {}", self.tools.walk_parameter.name());
            }
            Action::Undo | Action::Redo if scene => {
                // What the line says of an earlier action may hold no longer.
                self.line.clear();
                let action = match action {
                    Action::Undo => command::Action::Undo(Undo { steps: 1 }),
                    _ => command::Action::Redo(Redo { steps: 1 }),
                };
                requests.push(change(action));
            }
            Action::Clear if selection => {
                requests.push(Request::Select(StrokesRequest { restart: true, ..StrokesRequest::default() }));
            }
            Action::All if scene => match select_visible(&state.scene) {
                Ok(action) => requests.push(change(action)),
                Err(_) => self.line = "nothing is visible; show something first".to_owned(),
            },
            Action::Delete | Action::Crop | Action::Duplicate if scene => {
                if state.uncommitted {
                    // The scene would change the selection that it has stored, not the one on screen.
                    self.line = "the selection is not stored yet; press the key again".to_owned();
                } else if state.scene.selection().mask().is_none() {
                    self.line = "nothing is selected; brush something first".to_owned();
                } else {
                    requests.push(change(match action {
                        Action::Delete => delete_selection(),
                        Action::Crop => crop_to_selection(),
                        _ => duplicate_selection(),
                    }));
                    if action == Action::Duplicate {
                        self.scene_view.mouse_tool = MouseTool::Move;
                        self.line = "the copy lies in the place of the original; drag an arrow to move it".to_owned();
                    }
                }
            }
            Action::Invert if selection => {
                let operation = SelectionOperation {
                    operation: Some(selection_operation::Operation::Invert(Invert {})),
                    ..SelectionOperation::default()
                };
                let step = SelectionStep { step: Some(selection_step::Step::Operation(operation)) };
                let include_hidden = self.tools.include_hidden;
                requests.push(Request::Select(StrokesRequest {
                    steps: vec![step],
                    include_hidden,
                    ..StrokesRequest::default()
                }));
            }
            Action::SaveCopy if scene => self.ask_copy(state),
            Action::ExportSplats if scene => self.ask_usual_export(state),
            Action::FrameSelection if state.scene.selection().mask().is_none() => {
                self.line = "nothing is selected; brush something first".to_owned();
            }
            Action::FrameSelection if scene => requests.push(change(frame_selection())),
            Action::NextUp | Action::Flip if scene => {
                let up = self.scene.orientation.with_up(state.scene.up()).up();
                let up = if action == Action::Flip { up.opposite() } else { up.next() };
                requests.push(change(turn_up(Some(up))));
            }
            Action::Undo
            | Action::Redo
            | Action::All
            | Action::Clear
            | Action::Invert
            | Action::Delete
            | Action::Duplicate
            | Action::Crop
            | Action::FrameSelection
            | Action::NextUp
            | Action::Flip
            | Action::SaveCopy
            | Action::ExportSplats => {
                self.line = "the service for this does not answer".to_owned();
            }
            Action::Name => {
                self.panels_shown = true;
                self.tab = Panel::SELECT.name;
                self.panels.name_selection();
            }
            Action::Say => {
                self.panels_shown = true;
                self.tab = Panel::LANGUAGE.name;
                self.panels.say_something();
            }
            Action::Fit => self.scene_view.fit(),
            Action::Turn(way) => self.scene_view.navigator.turn(-KEY_TURN * in_picture(way)),
            Action::Slide(way) => self.scene_view.navigator.slide(-KEY_SLIDE * in_picture(way)),
            Action::Nearer => self.scene_view.navigator.approach(KEY_NEARER),
            Action::Further => self.scene_view.navigator.approach(1.0 / KEY_NEARER),
            Action::NavigationMode => {
                let navigator = &mut self.scene_view.navigator;
                navigator.navigation_mode = navigator.navigation_mode.next();
            }
            Action::Picture => self.export_picture(state),
            Action::Turntable => self.export_turn(state),
            Action::Open => self.ask_open(state),
            Action::Stereo => self.scene_view.stereo = !self.scene_view.stereo,
            Action::Panels => self.panels_shown = !self.panels_shown,
            Action::Grid => self.tools.grid = !self.tools.grid,
            Action::Theme => self.tools.light_panels = !self.tools.light_panels,
            Action::NextDisplayMode => self.tools.display_mode = next_display_mode(self.tools.display_mode, state),
            Action::Close => self.closes = true,
            Action::Abandon => {
                self.scene_view.abandon();
                self.exporter.cancel();
                self.file_menu.dialogs.close();
                self.file_menu.spacing.close();
                requests.extend(self.drag.0.abandon());
                self.help = false;
            }
        }
    }

    /// Appearance of exported pictures: without provisional highlights, such as the preview of a stroke.
    pub(super) fn export_appearance(&mut self, state: &ViewState) -> sg_scene::appearance::Appearance {
        let Self { scene, appearance_builder, tools, scene_view, .. } = self;
        let own = appearance_builder.build(scene, &state.scene, &state.selected, state.clusters.as_deref(), tools);
        sg_scene::appearance::Appearance { occlusion: scene_view.occlusion(&own, tools), ..own }
    }

    fn export_picture(&mut self, state: &ViewState) {
        let appearance = self.export_appearance(state);
        let [width, height] = self.scene_view.size();
        let camera = self.scene_view.navigator.camera(width, height);
        let finish = Finish::to_look_at(appearance.background, self.tools.gradient);
        self.exporter.export(&self.scene, ExportJob::Picture(Box::new(camera), appearance, finish));
    }

    fn export_turn(&mut self, state: &ViewState) {
        let appearance = self.export_appearance(state);
        let finish = Finish::to_look_at(appearance.background, self.tools.gradient);
        let (navigator, size) = (self.scene_view.navigator, self.scene_view.size());
        self.exporter.export(&self.scene, ExportJob::Turn(navigator, size, appearance, finish));
        self.line = "drawing a turn around the scene; Esc cancels".to_owned();
    }
}

/// The direction of an arrow key, x to the right and y down.
fn in_picture(way: Way) -> DVec2 {
    match way {
        Way::Left => DVec2::NEG_X,
        Way::Right => DVec2::X,
        Way::Up => DVec2::NEG_Y,
        Way::Down => DVec2::Y,
    }
}

/// The views of the structure one after another, those alone that there is something for.
fn next_display_mode(now: DisplayMode, state: &ViewState) -> DisplayMode {
    let clusters = [DisplayMode::Clusters, DisplayMode::FirstComponent, DisplayMode::Outlines];
    let attributes = [Attribute::Scale, Attribute::Anisotropy, Attribute::Opacity, Attribute::Normal];
    let all: Vec<DisplayMode> = std::iter::once(DisplayMode::Scene)
        .chain(clusters.into_iter().filter(|_| state.clusters.is_some()))
        .chain(attributes.into_iter().map(DisplayMode::Attribute))
        .collect();
    let at = all.iter().position(|s| *s == now).unwrap_or(0);
    all.get(at + 1).copied().unwrap_or_default()
}
