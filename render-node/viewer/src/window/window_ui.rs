//! Everything of a window that a person sees and touches, without the window itself: the picture, the tools, the panels.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use egui::{Align2, Frame, Rect, TextureId, Ui, Vec2};
use glam::{DVec2, DVec3};
use sg_edit::wire::encode_view;
use sg_proto::scene::{
    Invert, Redo, SelectionOperation, SelectionStep, SetView, Undo, command, selection_operation, selection_step,
    set_view,
};
use sg_proto::selection::StrokesRequest;
use sg_scene::framing::{FirstView, near_distance};
use sg_scene::mask::Mask;
use sg_scene::model::Scene;
use sg_scene::view::View;
use sg_selection::brush::Brush;

use super::bookmarks::Bookmarks;
use super::drawing;
use super::error::WindowError;
use super::exporter::{ExportJob, Exporter};
use super::hints::{self, Hint, HintPlaces};
use super::navigation::Navigator;
use super::scene_view::{MouseTool, SceneView};
use super::settings::Settings;
use super::shortcuts::{self, Action, Way};
use super::window_files::FileMenu;
use crate::display::{
    AppearanceBuilder, BrushController, BrushMode, DisplayMode, Drafts, FrameStats, ParameterDrag, Request,
    SceneFollower, Tools, ViewPort, ViewState,
};
use crate::panels::{
    DisplayAction, Dock, NARROWEST, Output, Panel, PanelHost, Panels, crop_to_selection, delete_selection,
    frame_selection, select_visible, theme, turn_up,
};
use sg_gpu::Gpu;
use sg_gpu::backend::Engine;
use sg_raster::attributes::Attribute;
use sg_raster::finish::Finish;

/// Widths of the panels at first, points.
const LEFT: f32 = 376.0;
const RIGHT: f32 = 360.0;

/// Points from the lower edge to the notices.
const NOTICES: f32 = 48.0;

/// One step of the keys that widen and narrow the brush.
const WIDER: f64 = 1.15;

/// Share of the range of a walk's leak or threshold that one key press goes along, and one notch of the wheel.
const PARAMETER_STEPS: (f64, f64) = (0.02, 0.02);

/// Least width of the picture between two docks, points at the usual size of text.
const PICTURE: f32 = 260.0;

/// The way of one press of an arrow key, in heights of the picture: to turn, and to slide.
const KEY_TURN: f64 = 1.0 / 24.0;
const KEY_SLIDE: f64 = 0.05;

/// Factor of one press of the keys that go nearer and further.
const KEY_NEARER: f64 = 1.1;

/// Keys and the wheel have no release: their change commits after this rest.
const DRAG_TIMEOUT: Duration = Duration::from_millis(500);

/// The window's content.
pub struct WindowUi {
    /// The scene as its file has it.
    file: Arc<Scene>,
    /// The scene with Gaussians where edits put them, and what finds it.
    pub(super) scene: Arc<Scene>,
    follower: SceneFollower,
    pub(super) view_port: ViewPort,
    pub(super) tools: Tools,
    drafts: Drafts,
    /// The last walk under keys and the wheel, and when it was moved last.
    drag: (ParameterDrag, Instant),
    appearance_builder: AppearanceBuilder,
    pub(super) scene_view: SceneView,
    panels: Panels,
    bookmarks: Bookmarks,
    pub(super) exporter: Exporter,
    pub(super) file_menu: FileMenu,
    /// Folder of pictures without a chosen name.
    pub(super) pictures: PathBuf,
    /// The scene's last known view: a different one moves the eye here.
    shared: View,
    first_view: FirstView,
    /// The view that this window has sent and the scene has not confirmed yet.
    sent: Option<View>,
    pub(super) panels_shown: bool,
    /// Name of the panel that a narrow window shows.
    tab: &'static str,
    hints_done: Vec<Hint>,
    pub(super) hint_places: HintPlaces,
    /// Whether a panel shows the choice of a unit's colour.
    is_choosing_color: bool,
    pub(super) help: bool,
    closes: bool,
    frames: u64,
    /// The window's own message.
    pub(super) line: String,
}

impl WindowUi {
    /// A desk over a scene. `wake` wakes the loop when there is something new to show.
    ///
    /// # Errors
    /// [`WindowError::Threads`].
    pub fn new(
        scene: Arc<Scene>,
        engine: Engine,
        (mut view_port, tools): (ViewPort, Tools),
        pictures: PathBuf,
        settings: &Settings,
        wake: impl Fn() + Clone + Send + Sync + 'static,
    ) -> Result<Self, WindowError> {
        view_port.on_update(wake.clone());
        let first = view_port.newest();
        let (shared, opened) = (first.scene.view(), first.scene.geometry().path.clone());
        let file = scene;
        let mut navigator = Navigator::new(shared, file.bounds);
        navigator.near = near_distance(&file);
        navigator.navigation_mode = settings.navigation_mode;
        let (follower, scene) = SceneFollower::new(Arc::clone(&file), Arc::clone(&first.scene), wake.clone())
            .map_err(|e| WindowError::Threads(e.to_string()))?;
        let brush = Arc::new(Brush::of_scene(&scene));
        let name = format!("window-{}", std::process::id());
        let brush_controller = BrushController::new(&scene, brush, name);
        let pool = drawing::threads().map_err(|e| WindowError::Threads(e.to_string()))?;
        let mut scene_view =
            SceneView::new(engine, Arc::clone(&scene), navigator, brush_controller, Arc::clone(&pool), wake.clone())?;
        scene_view.mouse_tool = settings.mouse_tool;
        let exporter = Exporter::new(pictures.clone(), pool, wake)
            .map_err(|e| WindowError::Threads(e.to_string()))?;
        let mut panels = Panels::new(PanelHost::Window);
        for problem in panels.behind(&scene, Path::new(&opened)) {
            tracing::warn!("no curve is shown: {problem}");
        }
        Ok(Self {
            first_view: FirstView::of(&file),
            file,
            scene,
            follower,
            view_port,
            tools,
            drafts: Drafts::default(),
            drag: (ParameterDrag::default(), Instant::now()),
            appearance_builder: AppearanceBuilder::default(),
            scene_view,
            panels,
            bookmarks: Bookmarks::default(),
            exporter,
            file_menu: FileMenu::default(),
            pictures,
            shared,
            sent: None,
            panels_shown: settings.panels,
            tab: Panel::SELECT.name,
            hints_done: settings.hints_done.clone(),
            hint_places: HintPlaces::default(),
            is_choosing_color: false,
            help: false,
            closes: false,
            frames: 0,
            line: String::new(),
        })
    }

    /// The scene with Gaussians where the window shows them.
    #[must_use]
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// Its settings without the size of the window.
    #[must_use]
    pub fn settings(&self) -> Settings {
        let Tools { mode, radius, front_only, quality, light_panels, scale, gradient, occlusion, grid, .. } =
            self.tools;
        Settings {
            panels: self.panels_shown,
            mouse_tool: self.scene_view.mouse_tool,
            navigation_mode: self.scene_view.navigator.navigation_mode,
            mode,
            radius,
            front_only,
            quality,
            light_panels,
            scale,
            gradient,
            occlusion,
            hints_done: self.hints_done.clone(),
            grid,
            ..Settings::default()
        }
    }

    /// Whether there is something that has not been shown.
    #[must_use]
    pub fn has_update(&self) -> bool {
        self.view_port.has_update()
    }

    /// Whether a change waits for its commit at the next frame: a hidden window draws that one too.
    #[must_use]
    pub(super) fn holds_change(&self) -> bool {
        self.drag.0.is_held()
    }

    /// Whether the window has to close.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        self.closes || self.view_port.is_closed()
    }

    /// Whether the best picture of the present state is shown.
    #[must_use]
    pub fn is_settled(&self) -> bool {
        self.scene_view.is_settled() && self.follower.is_idle()
    }

    /// Recreates textures at the next frame, for another context. Pictures may stay on the device of `shown_by`, under that
    /// texture id.
    pub(super) fn show_by(&mut self, shown_by: Option<(Gpu, TextureId)>) {
        self.scene_view.show_by(shown_by);
    }

    /// The device that draws pictures, if one does.
    pub(super) fn drawn_by(&self) -> Option<&Gpu> {
        self.scene_view.drawn_by()
    }

    /// The newest picture where it lies on the device that shows the window, once.
    pub(super) fn take_picture(&mut self) -> Option<wgpu::Texture> {
        self.scene_view.take_picture()
    }

    /// Shows a frame and handles its input.
    pub fn show(&mut self, ui: &mut Ui) {
        let newest = self.view_port.newest();
        if newest.scene.view() != self.shared {
            self.shared = newest.scene.view();
            // The eye has been there already, and may have moved on.
            if self.sent.take() != Some(self.shared) {
                self.scene_view.navigator.view = self.shared;
            }
        }
        let drafted = self.drafts.over(&self.scene, &newest.scene);
        if let Some(left) = self.drafts.expires_in() {
            ui.ctx().request_repaint_after(left);
        }
        if let Some(followed) = self.follower.follow(&drafted, self.drafts.is_held()) {
            self.scene = Arc::clone(&followed.scene);
            self.scene_view.show_scene(followed);
        }
        let state = ViewState { scene: drafted, ..ViewState::clone(&newest) };
        theme::apply(ui.ctx(), &self.tools);
        let mut requests = Vec::new();
        if !ui.ctx().text_edit_focused() {
            self.scene_view.take_polygon_keys(ui);
            let has_focus = ui.ctx().egui_wants_keyboard_input();
            for action in ui.input_mut(|input| shortcuts::pressed(input, has_focus)) {
                self.act(action, &state, &mut requests);
            }
        }
        self.hint_places = HintPlaces::default();
        self.take_dropped_files(ui, &mut requests);
        self.take_export(&mut requests);
        self.take_chosen_file(ui, &state, &mut requests);
        egui::Panel::top("tools").show(ui, |ui| self.toolbar(ui, &state, &mut requests));
        egui::Panel::bottom("status").show(ui, |ui| self.status(ui, &state));
        self.is_choosing_color = false;
        if self.panels_shown {
            self.show_panels(ui, &state, &mut requests);
        }
        let mut picture = Rect::NOTHING;
        egui::CentralPanel::default().frame(Frame::NONE).show(ui, |ui| {
            picture = ui.available_rect_before_wrap();
            self.scene_view.keep_framed(&mut self.first_view, &self.file, self.shared, ui.available_rect_before_wrap());
            let (response, output) = self.scene_view.interact(ui, &state, &mut self.tools);
            requests.extend(output);
            let notches = std::mem::take(&mut self.scene_view.notches);
            self.drag_parameter(PARAMETER_STEPS.1 * notches, &state, &mut requests);
            let highlighted = if self.is_choosing_color {
                Arc::new(Mask::empty(self.scene.len()))
            } else {
                self.scene_view.highlighted(&state, &self.tools)
            };
            let appearance = self.appearance_builder.build(
                &self.scene,
                &state.scene,
                &highlighted,
                state.clusters.as_deref(),
                &self.tools,
            );
            self.scene_view.show(ui, response.rect, &appearance, &state, &self.tools);
            self.scene_view.show_shape(ui, response.rect, (&state, &self.tools), &mut requests);
            self.scene_view.show_move_tool(ui, response.rect, (&state, &self.tools), &mut requests);
            let orientation = self.scene.orientation.with_up(state.scene.up());
            self.scene_view.scale_bar(ui, response.rect, self.tools.scale);
            self.scene_view.orientation_cube(ui, response.rect, orientation, self.tools.scale);
        });
        self.take_move_draft(ui, &newest);
        self.release_after_rest(ui, &state, &mut requests);
        let notices = egui::Area::new(egui::Id::unique("notices")).anchor(Align2::CENTER_BOTTOM, [0.0, -NOTICES]);
        notices.interactable(false).show(ui.ctx(), |ui| self.panels.notices(ui, &state));
        if self.panels_shown && !self.help {
            let places =
                HintPlaces { name: self.panels.name_place(), ask: self.panels.say_place(), ..self.hint_places };
            hints::show(ui, places, picture, &state, &mut self.hints_done);
        }
        if self.help {
            self.show_help(ui);
        }
        self.ask(requests, &newest);
        self.frames += 1;
        let seen = &self.scene_view.newest;
        self.view_port.report(FrameStats {
            frames: self.frames,
            pictures: seen.pictures,
            late: self.scene_view.late(),
            seconds: seen.seconds,
            engine: seen.engine.clone(),
            revision: state.scene.revision(),
        });
    }

    /// Shows the change of the tool that moves the selection, or shows it no more. `newest` is the state without drafts: a released
    /// move shows until the scene is past that revision, and over its own result it would be shown twice.
    fn take_move_draft(&mut self, ui: &Ui, newest: &ViewState) {
        let (is_dropped, draft) = self.scene_view.move_tool.take_draft();
        if is_dropped {
            self.drafts.drop_held();
        }
        if is_dropped || draft.is_some() {
            // The scene is found beside the loop, from the next frame on.
            ui.ctx().request_repaint();
        }
        Output { draft, ..Output::default() }.show_draft(&mut self.drafts, newest);
    }

    /// Panels beside the picture, at the sides that the table of panels gives them.
    fn show_panels(&mut self, ui: &mut Ui, state: &ViewState, requests: &mut Vec<Request>) {
        self.panels.numbers = self.appearance_builder.legend();
        self.panels.supported_actions = vec![DisplayAction::Fit, DisplayAction::Bookmark, DisplayAction::Screenshot];
        self.panels.supported_actions.extend(self.bookmarks.numbers().map(DisplayAction::Place));
        self.panels.supported_actions.extend((0_u8..).zip(state.proposals()).map(|(k, _)| DisplayAction::Proposal(k)));
        let mut output = Output::default();
        let least = NARROWEST * self.tools.scale;
        let docked = |dock| {
            let docked = Panel::ALL.iter().filter(|panel| panel.dock == Some(dock) && panel.has_content(state));
            docked.copied().collect::<Vec<Panel>>()
        };
        let room = ui.available_width();
        if room < 2.0 * least + PICTURE * self.tools.scale {
            let width = least.min(room);
            let side = egui::Panel::left("tabs").resizable(false).exact_size(width);
            side.show(ui, |ui| self.show_tabs(ui, &Dock::ALL.map(docked).concat(), state, &mut output));
        } else {
            for dock in Dock::ALL {
                let docked = docked(dock);
                if docked.is_empty() {
                    continue;
                }
                let (side, width) = match dock {
                    Dock::Left => (egui::Panel::left("left"), LEFT),
                    Dock::Right => (egui::Panel::right("right"), RIGHT),
                };
                side.resizable(true).min_size(least).default_size(width.max(least)).show(ui, |ui| {
                    if dock == Dock::Left {
                        ui.horizontal_wrapped(|ui| self.tool_choice(ui, state, false));
                    }
                    let height = ui.available_height() / docked.len() as f32;
                    for panel in docked {
                        ui.allocate_ui(Vec2::new(ui.available_width(), height), |ui| {
                            output.join(self.panels.show(panel, ui, state, &mut self.tools));
                        });
                    }
                });
            }
        }
        self.is_choosing_color = output.is_choosing_color;
        output.show_draft(&mut self.drafts, state);
        requests.extend(output.requests);
        for wish in output.actions {
            match wish {
                DisplayAction::Fit => self.act(Action::Fit, state, requests),
                DisplayAction::Screenshot => self.act(Action::Picture, state, requests),
                DisplayAction::Bookmark => {
                    let number = self.bookmarks.keep(self.scene_view.navigator.view);
                    self.line = number.map_or_else(
                        || "all nine places are taken".to_owned(),
                        |number| format!("saved as place {number}"),
                    );
                }
                // Not among the supported actions.
                DisplayAction::Panels => (),
                DisplayAction::Proposal(k) => {
                    if let Some(at) = state.proposal_at(self.scene.bounds, k.into()) {
                        let view = &mut self.scene_view.navigator.view;
                        *view = turned_to(*view, at);
                    }
                }
                DisplayAction::Place(number) => {
                    if let Some(view) = self.bookmarks.place(number) {
                        self.scene_view.navigator.view = view;
                    }
                }
            }
        }
    }

    /// One panel at a time, in a window that has no room for two docks.
    fn show_tabs(&mut self, ui: &mut Ui, docked: &[Panel], state: &ViewState, output: &mut Output) {
        let Some(shown) = docked.iter().find(|panel| panel.name == self.tab).or(docked.first()).copied() else {
            return;
        };
        ui.horizontal_wrapped(|ui| {
            for panel in docked {
                if ui.selectable_label(*panel == shown, panel.title).clicked() {
                    self.tab = panel.name;
                }
            }
        });
        if shown == Panel::SELECT {
            ui.horizontal_wrapped(|ui| self.tool_choice(ui, state, true));
        }
        output.join(self.panels.show(shown, ui, state, &mut self.tools));
    }

    /// Moves the leak or the threshold of the last walk by a share of its whole range.
    fn drag_parameter(&mut self, by: f64, state: &ViewState, requests: &mut Vec<Request>) {
        if by == 0.0 {
            return;
        }
        let which = self.tools.walk_parameter;
        let output = self.drag.0.turn(which, by, state);
        match self.drag.0.tuning(state) {
            Some(tuning) => self.line = format!("{} {}", which.name(), which.written(tuning)),
            None => self.line = format!("brush a Region first: {} belongs to its last stroke", which.name()),
        }
        if output.is_some() {
            self.drag.1 = Instant::now();
        }
        requests.extend(output);
    }

    /// Commits the keys' and the wheel's change of the last walk once they rest.
    fn release_after_rest(&mut self, ui: &Ui, state: &ViewState, requests: &mut Vec<Request>) {
        if self.drag.0.is_held() {
            match DRAG_TIMEOUT.checked_sub(self.drag.1.elapsed()) {
                Some(left) => ui.ctx().request_repaint_after(left),
                None => requests.extend(self.drag.0.release(state.scene.revision())),
            }
        }
    }

    /// Sends requests. The view is shared before requests that refer to it.
    fn ask(&mut self, requests: Vec<Request>, newest: &ViewState) {
        for request in requests {
            let view = self.scene_view.navigator.view;
            if refers_to_view(&request) && !self.scene_view.is_at(newest.scene.view()) {
                self.sent = Some(view);
                let change = Some(set_view::Change::View(encode_view(&view)));
                self.view_port.send(Request::Change(Box::new(command::Action::SetView(SetView { change }))));
            }
            if !self.view_port.send(request) {
                self.line = "too many requests at once: the last one was refused".to_owned();
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
            Action::Less => self.drag_parameter(PARAMETER_STEPS.0, state, requests),
            Action::More => self.drag_parameter(-PARAMETER_STEPS.0, state, requests),
            Action::NextParameter => {
                self.tools.walk_parameter = self.tools.walk_parameter.other();
                self.line = format!("keys and the wheel change {}", self.tools.walk_parameter.name());
            }
            Action::Undo if scene => requests.push(change(command::Action::Undo(Undo { steps: 1 }))),
            Action::Redo if scene => requests.push(change(command::Action::Redo(Redo { steps: 1 }))),
            Action::Clear if selection => {
                requests.push(Request::Select(StrokesRequest { restart: true, ..StrokesRequest::default() }));
            }
            Action::All if scene => match select_visible(&state.scene) {
                Ok(action) => requests.push(change(action)),
                Err(_) => self.line = "nothing is visible; show something first".to_owned(),
            },
            Action::Delete | Action::Crop if scene => {
                if state.uncommitted {
                    // The scene would delete the selection that it has stored, not the one on screen.
                    self.line = "the selection is not stored yet; press the key again".to_owned();
                } else if state.scene.selection().mask().is_none() {
                    self.line = "nothing is selected; brush something first".to_owned();
                } else {
                    let delete = if action == Action::Delete { delete_selection() } else { crop_to_selection() };
                    requests.push(change(delete));
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
                self.line = format!("{} is up", up.name());
            }
            Action::Undo
            | Action::Redo
            | Action::All
            | Action::Clear
            | Action::Invert
            | Action::Delete
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

    /// Files that were dropped on the window: a camera is looked from, a scene or volume opened beside.
    fn take_dropped_files(&mut self, ui: &Ui, requests: &mut Vec<Request>) {
        for path in ui.input(|i| i.raw.dropped_files.iter().map(|f| f.path().to_path_buf()).collect::<Vec<_>>()) {
            self.open_file(path, requests);
        }
    }
}

/// Whether a request refers to the visible view: an utterance ("this"), or a change from the present direction.
fn refers_to_view(request: &Request) -> bool {
    let from_here = |change: &command::Action| {
        matches!(change, command::Action::SetView(SetView { change: Some(set_view::Change::Focus(_)) }))
    };
    match request {
        Request::Say(_) => true,
        Request::Change(change) => from_here(change),
        _ => false,
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

/// A view of a place from the same direction and distance.
fn turned_to(view: View, at: DVec3) -> View {
    View { eye: at + (view.eye - view.target), target: at, ..view }
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
