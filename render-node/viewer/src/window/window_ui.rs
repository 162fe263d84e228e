//! Everything of a window that a person sees and touches, without the window itself: the picture, the tools, the panels.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use egui::{Align2, Frame, Rect, TextureId, Ui};
use sg_edit::wire::encode_view;
use sg_gpu::Gpu;
use sg_gpu::backend::Engine;
use sg_proto::scene::{SetView, command, set_view};
use sg_proto::speech::Control;
use sg_scene::framing::{FirstView, near_distance};
use sg_scene::mask::Mask;
use sg_scene::model::Scene;
use sg_scene::orientation::Axis;
use sg_scene::view::View;
use sg_selection::brush::Brush;

use super::bookmarks::Bookmarks;
use super::drawing;
use super::error::WindowError;
use super::exporter::Exporter;
use super::hints::{self, Hint, HintPlaces};
use super::mouse_tool::MouseTool;
use super::navigation::Navigator;
use super::scene_view::SceneView;
use super::settings::Settings;
use super::shortcuts::{self, KeyFocus};
use super::tour_view;
use super::view_flight::ViewFlight;
use super::window_files::FileMenu;
use crate::display::{
    AppearanceBuilder, BrushController, Drafts, FrameStats, ParameterDrag, Request, SceneFollower, Tools, ViewPort,
    ViewState,
};
use crate::panels::{Panel, PanelHost, Panels, theme};

/// Points from the lower edge to the notices.
const NOTICES: f32 = 48.0;

/// The window's content.
pub struct WindowUi {
    /// The scene as its file has it.
    file: Arc<Scene>,
    /// The scene with Gaussians where edits put them, and what finds it.
    pub(super) scene: Arc<Scene>,
    follower: SceneFollower,
    pub(super) view_port: ViewPort,
    pub(super) tools: Tools,
    pub(super) drafts: Drafts,
    /// The last walk under keys and the wheel, and when it was moved last.
    pub(super) drag: (ParameterDrag, Instant),
    /// Notches of the wheel towards another answer.
    pub(super) answer_notches: f64,
    pub(super) appearance_builder: AppearanceBuilder,
    pub(super) scene_view: SceneView,
    pub(super) panels: Panels,
    pub(super) bookmarks: Bookmarks,
    pub(super) exporter: Exporter,
    pub(super) file_menu: FileMenu,
    /// Folder of pictures without a chosen name.
    pub(super) pictures: PathBuf,
    /// The scene's last known view: a different one moves the eye here.
    shared: View,
    first_view: FirstView,
    /// The axis that was up in the last frame.
    up: Option<Axis>,
    /// The view that this window has sent and the scene has not confirmed yet, and the revision before it.
    sent: Option<(View, u64)>,
    /// The way of the eye to a view that somebody else has set.
    flight: Option<ViewFlight>,
    pub(super) panels_shown: bool,
    /// Name of the panel that a narrow window shows.
    pub(super) tab: &'static str,
    hints_done: Vec<Hint>,
    pub(super) hint_places: HintPlaces,
    /// Whether a panel shows the choice of a unit's colour.
    pub(super) is_choosing_color: bool,
    pub(super) help: bool,
    /// Whether the last frame left its keys to a field that waits for the focus.
    waited: bool,
    /// Whether the key that is held to talk was down.
    is_talking: bool,
    pub(super) closes: bool,
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
        scene_view.mouse_tool = settings.mouse_tool.at_first();
        let exporter = Exporter::new(pictures.clone(), pool, wake).map_err(|e| WindowError::Threads(e.to_string()))?;
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
            answer_notches: 0.0,
            appearance_builder: AppearanceBuilder::default(),
            scene_view,
            panels,
            bookmarks: Bookmarks::default(),
            exporter,
            file_menu: FileMenu::default(),
            pictures,
            shared,
            up: None,
            sent: None,
            flight: None,
            panels_shown: settings.panels,
            tab: Panel::SELECT.name,
            hints_done: settings.hints_done.clone(),
            hint_places: HintPlaces::default(),
            is_choosing_color: false,
            help: false,
            waited: false,
            is_talking: false,
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
        let Tools {
            mode,
            radius,
            front_only,
            quality,
            light_panels,
            scale,
            gradient,
            occlusion,
            grid,
            smooth_views,
            room_near,
            ..
        } = self.tools;
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
            smooth_views,
            room_near,
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
        self.flight.is_none() && self.scene_view.is_settled() && self.follower.is_idle()
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
        self.scene_view.take_in(ui);
        let newest = self.view_port.newest();
        let view = newest.scene.view();
        // This window's own view may be followed by another one before it is ever seen here.
        let is_passed = self.sent.is_some_and(|(sent, before)| newest.scene.revision() > before && view != sent);
        if view != self.shared || is_passed {
            self.shared = view;
            // The eye has been there already, and may have moved on.
            if self.sent.take().map(|(sent, _)| sent) != Some(view) {
                self.go_to(ui, view);
            }
        }
        self.fly(ui);
        let up = self.scene.orientation.with_up(newest.scene.up()).up();
        if self.up.replace(up).is_some_and(|before| before != up) {
            self.line = format!("{} is up", up.name());
        }
        let drafted = self.drafts.over(&self.scene, &newest.scene);
        if let Some(left) = self.drafts.expires_in() {
            ui.ctx().request_repaint_after(left);
        }
        if let Some(followed) = self.follower.follow(&drafted, self.drafts.is_held()) {
            self.scene = Arc::clone(&followed.scene);
            self.scene_view.show_scene(followed);
        }
        let state = newest.with_scene(self.follower.shown(&drafted));
        theme::apply(ui.ctx(), &self.tools);
        let mut requests = Vec::new();
        // A field that waits for the focus gets the letters of this frame already, for one frame: it may never be drawn.
        let waits = self.panels.expects_letters() && !std::mem::replace(&mut self.waited, true);
        self.waited &= waits;
        let focus = KeyFocus {
            is_typing: ui.ctx().text_edit_focused(),
            has_control: ui.ctx().egui_wants_keyboard_input(),
            has_menu: egui::Popup::is_any_open(ui.ctx()),
            expects_field: waits,
        };
        if !waits && !focus.is_typing {
            self.scene_view.take_polygon_keys(ui);
        }
        let pressed = ui.input_mut(|input| shortcuts::pressed(input, focus));
        if pressed.leaves_field {
            self.panels.expect_no_letters();
        }
        for action in pressed.actions {
            self.act(action, &state, &mut requests);
        }
        let is_talking = state.waits_to_talk() && ui.input(|input| shortcuts::is_talking(input, focus));
        if std::mem::replace(&mut self.is_talking, is_talking) != is_talking {
            requests.push(Request::Speech(if is_talking { Control::Press } else { Control::Release }));
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
        tour_view::show_bar(ui, &state, &mut requests);
        let mut picture = Rect::NOTHING;
        egui::CentralPanel::default().frame(Frame::NONE).show(ui, |ui| {
            picture = ui.available_rect_before_wrap();
            // On its way from the first view the eye is not framed anew: it would jump.
            if self.flight.is_none() {
                self.scene_view.keep_framed(&mut self.first_view, &self.file, self.shared, picture);
            }
            let (response, output) = self.scene_view.interact(ui, &state, &mut self.tools);
            requests.extend(output);
            let notches = std::mem::take(&mut self.scene_view.notches);
            // Up selects more.
            self.change_walk(-notches, &state, &mut requests);
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
            // Over one of two pictures it would be in the way.
            if !self.scene_view.stereo {
                tour_view::show_legend(ui, response.rect, self.tools.scale, &state);
            }
        });
        self.take_move_draft(ui, &newest);
        self.release_after_rest(ui, &state, &mut requests);
        let notices = egui::Area::new(egui::Id::unique("notices")).anchor(Align2::CENTER_BOTTOM, [0.0, -NOTICES]);
        notices.interactable(false).show(ui.ctx(), |ui| self.panels.notices(ui, &state));
        if self.panels_shown && !self.help {
            // Another tool has a card of its own where the hint of the brush would be.
            let is_free = matches!(self.scene_view.mouse_tool, MouseTool::Navigate | MouseTool::Brush);
            let places = HintPlaces {
                brush: self.hint_places.brush.filter(|_| is_free),
                name: self.panels.name_place(),
                ask: self.panels.say_place(),
            };
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
            size: self.scene_view.size(),
        });
    }

    /// Has the eye go to another view, or jump there.
    fn go_to(&mut self, ui: &Ui, view: View) {
        let eye = &mut self.scene_view.navigator.view;
        if self.tools.smooth_views {
            self.flight = Some(ViewFlight::new(*eye, view, ui.input(|input| input.time)));
        } else {
            *eye = view;
            self.flight = None;
        }
    }

    /// Moves the eye on its way to another view.
    fn fly(&mut self, ui: &Ui) {
        let Some(flight) = &mut self.flight else { return };
        let now = ui.input(|input| input.time);
        let Some((view, has_arrived)) = flight.at(self.scene_view.navigator.view, now) else {
            self.flight = None;
            return;
        };
        self.scene_view.navigator.view = view;
        if has_arrived {
            self.flight = None;
        } else {
            ui.ctx().request_repaint();
        }
    }

    /// Sends requests. The view is shared before requests that refer to it.
    fn ask(&mut self, requests: Vec<Request>, newest: &ViewState) {
        for request in requests {
            let view = self.scene_view.navigator.view;
            if refers_to_view(&request) && !self.scene_view.is_at(newest.scene.view()) {
                self.sent = Some((view, newest.scene.revision()));
                let change = Some(set_view::Change::View(encode_view(&view)));
                self.view_port.send(Request::Change(Box::new(command::Action::SetView(SetView { change }))));
            }
            if !self.view_port.send(request) {
                self.line = "too many requests at once: the last one was refused".to_owned();
            }
        }
    }

    /// Files that were dropped on the window: a camera is looked from, a scene or volume opened beside.
    fn take_dropped_files(&mut self, ui: &Ui, requests: &mut Vec<Request>) {
        for path in ui.input(|i| i.raw.dropped_files.iter().map(|f| f.path().to_path_buf()).collect::<Vec<_>>()) {
            self.open_file(path, requests);
        }
    }
}

/// Whether a request refers to the visible view: an utterance or a text for units ("this", "on the left"), a tour, a view that
/// is kept, or another view. Some of these begin at the present one. And where the scene is at the wanted view already, while
/// the eye has moved away, only a change brings it back.
fn refers_to_view(request: &Request) -> bool {
    let from_here =
        |change: &command::Action| matches!(change, command::Action::SetView(_) | command::Action::KeepView(_));
    match request {
        Request::Say(_) | Request::Tour(_) | Request::Find { .. } => true,
        Request::Change(change) => from_here(change),
        _ => false,
    }
}
