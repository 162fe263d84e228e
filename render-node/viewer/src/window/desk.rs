//! Everything of a window that a person sees and touches, without the window itself: the picture, the tools, the panels.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use egui::{Align2, Frame, TextureId, Ui, Vec2};
use glam::DVec3;
use sg_edit::wire::encode_view;
use sg_proto::scene::{
    Invert, Redo, SelectionOperation, SelectionStep, SetView, Undo, command, selection_operation, selection_step,
    set_view,
};
use sg_proto::selection::StrokesRequest;
use sg_scene::model::Scene;
use sg_scene::view::{View, framed_box};
use sg_selection::brush::Brush;

use super::bookmarks::Bookmarks;
use super::drawing;
use super::dropped::{self, Dropped};
use super::error::WindowError;
use super::keep::{Keep, Keeper};
use super::memory::Memory;
use super::navigation::Navigator;
use super::shortcuts::{self, Action};
use super::viewport::{Pointer, Viewport};
use crate::display::{BrushMode, Drafts, Dressing, Hand, Pace, Request, Scrub, Seat, Showing, Shown, Tools};
use crate::panels::{NARROWEST, Output, Panel, Panels, Place, Wish, theme};
use sg_gpu::Gpu;
use sg_gpu::backend::Engine;
use sg_raster::attributes::Attribute;

/// Widths of the panels at first, points.
const LEFT: f32 = 340.0;
const RIGHT: f32 = 360.0;

/// Points from the lower edge to lines that tell what was not done.
const NOTICES: f32 = 48.0;

/// One step of the keys that widen and narrow the brush.
const WIDER: f64 = 1.15;

/// Share of the range of a walk's leak or threshold that one key press goes along, and one notch of the wheel.
const SCRUBS: (f64, f64) = (0.02, 0.02);

/// Keys and the wheel cannot be let go of: what they made is taken after so long a rest.
const RESTS: Duration = Duration::from_millis(500);

/// The window's content.
pub struct Desk {
    scene: Arc<Scene>,
    pub(super) seat: Seat,
    pub(super) tools: Tools,
    drafts: Drafts,
    /// The last walk under keys and the wheel, and when it was moved last.
    scrub: (Scrub, Instant),
    dressing: Dressing,
    pub(super) viewport: Viewport,
    panels: Panels,
    bookmarks: Bookmarks,
    pub(super) keeper: Keeper,
    /// The view that the scene told of last: another one moves the eye here.
    shared: View,
    panels_shown: bool,
    pub(super) help: bool,
    closes: bool,
    frames: u64,
    /// What this window itself has to say.
    pub(super) line: String,
}

impl Desk {
    /// A desk over a scene. `told` wakes the loop when there is something new to show.
    ///
    /// # Errors
    /// [`WindowError::Threads`].
    pub fn new(
        scene: Arc<Scene>,
        engine: Engine,
        (mut seat, tools): (Seat, Tools),
        pictures: PathBuf,
        memory: &Memory,
        told: impl Fn() + Clone + Send + 'static,
    ) -> Result<Self, WindowError> {
        let first = seat.newest();
        let (shared, opened) = (first.scene.view(), first.scene.geometry().path.clone());
        let mut navigator = Navigator::new(shared, scene.bounds);
        navigator.manner = memory.manner;
        let brush = Arc::new(Brush::of_scene(&scene));
        let name = format!("window-{}", std::process::id());
        let hand = Hand::new(&scene, brush, name);
        let pool = drawing::threads().map_err(|e| WindowError::Threads(e.to_string()))?;
        let mut viewport = Viewport::new(engine, Arc::clone(&scene), navigator, hand, Arc::clone(&pool), told.clone())?;
        viewport.pointer = memory.pointer;
        let keeper =
            Keeper::new(Arc::clone(&scene), pictures, pool, told).map_err(|e| WindowError::Threads(e.to_string()))?;
        let mut panels = Panels::new(Place::Window);
        for problem in panels.behind(&scene, Path::new(&opened)) {
            tracing::warn!("no curve is shown: {problem}");
        }
        Ok(Self {
            scene,
            seat,
            tools,
            drafts: Drafts::default(),
            scrub: (Scrub::default(), Instant::now()),
            dressing: Dressing::default(),
            viewport,
            panels,
            bookmarks: Bookmarks::default(),
            keeper,
            shared,
            panels_shown: memory.panels,
            help: false,
            closes: false,
            frames: 0,
            line: String::new(),
        })
    }

    /// What is remembered of it; the size is the window's own.
    #[must_use]
    pub fn remembers(&self) -> Memory {
        let Tools { mode, radius, quality, light_panels, scale, .. } = self.tools;
        Memory {
            panels: self.panels_shown,
            pointer: self.viewport.pointer,
            manner: self.viewport.navigator.manner,
            mode,
            radius,
            quality,
            light_panels,
            scale,
            ..Memory::default()
        }
    }

    /// Whether there is something that has not been shown.
    #[must_use]
    pub fn has_news(&self) -> bool {
        self.seat.has_news()
    }

    /// Whether the window has to close.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.closes || self.seat.is_over()
    }

    /// Whether the best picture of what is shown is there.
    #[must_use]
    pub fn is_settled(&self) -> bool {
        self.viewport.is_settled()
    }

    /// Has textures made anew with the next frame, for another context. Pictures may stay on the device of `shown_by`, called
    /// so among the panels.
    pub(super) fn show_by(&mut self, shown_by: Option<(Gpu, TextureId)>) {
        self.viewport.show_by(shown_by);
    }

    /// The device that draws pictures, if one does.
    pub(super) fn drawn_by(&self) -> Option<&Gpu> {
        self.viewport.drawn_by()
    }

    /// The newest picture where it lies on the device that shows the window, once.
    pub(super) fn take_picture(&mut self) -> Option<wgpu::Texture> {
        self.viewport.take_picture()
    }

    /// Shows a frame and takes in what was done in it.
    pub fn show(&mut self, ui: &mut Ui) {
        let newest = self.seat.newest();
        if newest.scene.view() != self.shared {
            self.shared = newest.scene.view();
            self.viewport.navigator.view = self.shared;
        }
        let drafted = self.drafts.over(&self.scene, &newest.scene);
        let shown = Shown { scene: drafted, ..Shown::clone(&newest) };
        theme::apply(ui.ctx(), &self.tools);
        let mut requests = Vec::new();
        if !ui.ctx().egui_wants_keyboard_input() {
            for action in ui.input_mut(shortcuts::pressed) {
                self.act(action, &shown, &mut requests);
            }
        }
        self.take_dropped(ui, &mut requests);
        if let Some(kept) = self.keeper.news() {
            self.line = kept.unwrap_or_else(|error| format!("nothing was kept: {error}"));
        }
        egui::Panel::top("tools").show(ui, |ui| self.toolbar(ui, &shown, &mut requests));
        egui::Panel::bottom("status").show(ui, |ui| self.status(ui, &shown));
        if self.panels_shown {
            self.show_panels(ui, &shown, &mut requests);
        }
        egui::CentralPanel::default().frame(Frame::NONE).show(ui, |ui| {
            let (response, asked) = self.viewport.interact(ui, &shown, &mut self.tools);
            requests.extend(asked);
            let notches = std::mem::take(&mut self.viewport.notches);
            self.scrub(SCRUBS.1 * notches, &shown, &mut requests);
            let highlighted = self.viewport.highlighted(&shown, &self.tools);
            let look =
                self.dressing.look(&self.scene, &shown.scene, &highlighted, shown.clusters.as_ref(), &self.tools);
            self.viewport.show(ui, response.rect, &look, &shown, &self.tools);
        });
        self.rest(ui, &shown, &mut requests);
        let notices = egui::Area::new(egui::Id::unique("notices")).anchor(Align2::CENTER_BOTTOM, [0.0, -NOTICES]);
        notices.interactable(false).show(ui.ctx(), |ui| self.panels.notices(ui, &shown));
        if self.help {
            self.show_help(ui);
        }
        self.ask(requests, &newest);
        self.frames += 1;
        let seen = &self.viewport.newest;
        self.seat.tell(Pace {
            frames: self.frames,
            pictures: seen.pictures,
            late: self.viewport.late(),
            seconds: seen.seconds,
            engine: seen.engine.clone(),
            revision: shown.scene.revision(),
        });
    }

    /// Panels beside the picture: what the scene is like on the left, what is done to it on the right.
    fn show_panels(&mut self, ui: &mut Ui, shown: &Shown, requests: &mut Vec<Request>) {
        self.panels.numbers = self.dressing.legend();
        self.panels.fulfils = vec![Wish::Fit, Wish::Bookmark, Wish::Screenshot];
        self.panels.fulfils.extend(self.bookmarks.numbers().map(Wish::Place));
        self.panels.fulfils.extend((0_u8..).zip(shown.proposals()).map(|(k, _)| Wish::Proposal(k)));
        let Self { panels, tools, .. } = self;
        let mut asked = Output::default();
        let least = NARROWEST * tools.scale;
        egui::Panel::left("scene").resizable(true).min_size(least).default_size(LEFT.max(least)).show(ui, |ui| {
            asked.join(panels.show(Panel::Scene, ui, shown, tools));
        });
        let right: Vec<Panel> = [Panel::Prompt, Panel::Language].into_iter().filter(|p| p.has_content(shown)).collect();
        if !right.is_empty() {
            egui::Panel::right("hands").resizable(true).min_size(least).default_size(RIGHT.max(least)).show(ui, |ui| {
                let height = ui.available_height() / right.len() as f32;
                for panel in right {
                    ui.allocate_ui(Vec2::new(ui.available_width(), height), |ui| {
                        asked.join(panels.show(panel, ui, shown, tools));
                    });
                }
            });
        }
        asked.show_draft(&mut self.drafts, shown);
        requests.extend(asked.requests);
        for wish in asked.wishes {
            match wish {
                Wish::Fit => self.act(Action::Fit, shown, requests),
                Wish::Screenshot => self.act(Action::Picture, shown, requests),
                Wish::Bookmark => {
                    let number = self.bookmarks.keep(self.viewport.navigator.view);
                    self.line = number.map_or_else(
                        || "all places are taken".to_owned(),
                        |number| format!("this is place {number} now"),
                    );
                }
                // Not among what is fulfilled.
                Wish::Panels => (),
                Wish::Proposal(k) => {
                    if let Some(at) = shown.proposal_at(self.scene.bounds, k.into()) {
                        let view = &mut self.viewport.navigator.view;
                        *view = turned_to(*view, at);
                    }
                }
                Wish::Place(number) => {
                    if let Some(view) = self.bookmarks.place(number) {
                        self.viewport.navigator.view = view;
                    }
                }
            }
        }
    }

    /// Moves the leak or the threshold of the last walk along its range, of which the whole is 1.
    fn scrub(&mut self, by: f64, shown: &Shown, requests: &mut Vec<Request>) {
        if by == 0.0 {
            return;
        }
        let which = self.tools.scrubs;
        let asked = self.scrub.0.turn(which, by, shown);
        match self.scrub.0.tuning(shown) {
            Some(tuning) => self.line = format!("{} {}", which.name(), which.written(tuning)),
            None => self.line = format!("there is no walk whose {} could be changed", which.name()),
        }
        if asked.is_some() {
            self.scrub.1 = Instant::now();
        }
        requests.extend(asked);
    }

    /// Takes what keys and the wheel made of the last walk once they rest.
    fn rest(&mut self, ui: &Ui, shown: &Shown, requests: &mut Vec<Request>) {
        if self.scrub.0.is_held() {
            match RESTS.checked_sub(self.scrub.1.elapsed()) {
                Some(left) => ui.ctx().request_repaint_after(left),
                None => requests.extend(self.scrub.0.release(shown.scene.revision())),
            }
        }
    }

    /// Hands requests in. What is said is said about what is seen here: the view is shared first.
    fn ask(&mut self, requests: Vec<Request>, newest: &Shown) {
        for request in requests {
            if matches!(request, Request::Say(_)) && self.viewport.navigator.view != newest.scene.view() {
                self.shared = self.viewport.navigator.view;
                let change = Some(set_view::Change::View(encode_view(&self.shared)));
                self.seat.ask(Request::Change(Box::new(command::Action::SetView(SetView { change }))));
            }
            if !self.seat.ask(request) {
                self.line = "too much at once: the last request was not taken".to_owned();
            }
        }
    }

    pub(super) fn act(&mut self, action: Action, shown: &Shown, requests: &mut Vec<Request>) {
        let change = |action| Request::Change(Box::new(action));
        let (scene, selection) = (shown.offered.scene, shown.offered.selection);
        match action {
            Action::Help => self.help = !self.help,
            Action::Navigate => self.viewport.pointer = Pointer::Navigate,
            Action::Brush => self.viewport.pointer = Pointer::Brush,
            Action::Lasso => self.viewport.pointer = Pointer::Lasso,
            Action::Rectangle => self.viewport.pointer = Pointer::Rectangle,
            Action::Walk => self.tools.mode = BrushMode::Walk,
            Action::Cluster => self.tools.mode = BrushMode::Cluster,
            Action::Point => self.tools.mode = BrushMode::Point,
            Action::Wider => self.tools.widen(WIDER),
            Action::Narrower => self.tools.widen(1.0 / WIDER),
            Action::Depth => {
                self.tools.limited = !self.tools.limited;
                let reach = if self.tools.limited { "only what is in front" } else { "what is behind it too" };
                self.line = format!("brush, lasso and rectangle reach {reach}");
            }
            Action::Less => self.scrub(-SCRUBS.0, shown, requests),
            Action::More => self.scrub(SCRUBS.0, shown, requests),
            Action::Scrubs => {
                self.tools.scrubs = self.tools.scrubs.other();
                self.line = format!("keys and the wheel change the {}", self.tools.scrubs.name());
            }
            Action::Undo if scene => requests.push(change(command::Action::Undo(Undo { steps: 1 }))),
            Action::Redo if scene => requests.push(change(command::Action::Redo(Redo { steps: 1 }))),
            Action::Clear if selection => {
                requests.push(Request::Select(StrokesRequest { restart: true, ..StrokesRequest::default() }));
            }
            Action::Invert if selection => {
                let operation = SelectionOperation {
                    operation: Some(selection_operation::Operation::Invert(Invert {})),
                    ..SelectionOperation::default()
                };
                let step = SelectionStep { step: Some(selection_step::Step::Operation(operation)) };
                requests.push(Request::Select(StrokesRequest { steps: vec![step], ..StrokesRequest::default() }));
            }
            Action::Undo | Action::Redo | Action::Clear | Action::Invert => {
                self.line = "the service that does this is away".to_owned();
            }
            Action::Name => {
                self.panels_shown = true;
                self.panels.name_selection();
            }
            Action::Say => {
                self.panels_shown = true;
                self.panels.say_something();
            }
            Action::Fit => self.viewport.navigator.frame(framed_box(&self.scene)),
            Action::Manner => {
                let navigator = &mut self.viewport.navigator;
                navigator.manner = navigator.manner.next();
            }
            Action::Picture => self.keep_picture(shown),
            Action::Turntable => self.keep_turn(shown),
            Action::Stereo => self.viewport.stereo = !self.viewport.stereo,
            Action::Panels => self.panels_shown = !self.panels_shown,
            Action::Theme => self.tools.light_panels = !self.tools.light_panels,
            Action::Showing => self.tools.showing = next_showing(self.tools.showing, shown),
            Action::Close => self.closes = true,
            Action::Abandon => {
                self.viewport.abandon();
                requests.extend(self.scrub.0.abandon());
                self.help = false;
            }
        }
    }

    /// The look that pictures are kept with: without what is highlighted only until it is decided.
    fn kept_look(&mut self, shown: &Shown) -> sg_scene::appearance::Appearance {
        let Self { scene, dressing, tools, .. } = self;
        dressing.look(scene, &shown.scene, &shown.selected, shown.clusters.as_ref(), tools)
    }

    fn keep_picture(&mut self, shown: &Shown) {
        let look = self.kept_look(shown);
        let [width, height] = self.viewport.size();
        let camera = self.viewport.navigator.view.camera(width, height);
        self.keeper.keep(Keep::Picture(Box::new(camera), look));
    }

    fn keep_turn(&mut self, shown: &Shown) {
        let look = self.kept_look(shown);
        self.keeper.keep(Keep::Turn(self.viewport.navigator.view, self.viewport.size(), look));
        self.line = "drawing a turn around the scene".to_owned();
    }

    /// Files that were dropped on the window: a camera is looked from, a scene or volume opened beside.
    fn take_dropped(&mut self, ui: &Ui, requests: &mut Vec<Request>) {
        for path in ui.input(|i| i.raw.dropped_files.iter().map(|f| f.path().to_path_buf()).collect::<Vec<_>>()) {
            let view = &mut self.viewport.navigator.view;
            self.line = match dropped::read(&path, view.target) {
                Ok(Dropped::View(seen)) => {
                    *view = seen;
                    format!("seen as {} says", path.display())
                }
                Ok(Dropped::Other) => {
                    let line = format!("{} is to be opened", path.display());
                    requests.push(Request::Open(path));
                    line
                }
                Err(why) => why,
            };
        }
    }
}

/// A view of a place from the same direction and distance.
fn turned_to(view: View, at: DVec3) -> View {
    View { eye: at + (view.eye - view.target), target: at, ..view }
}

/// The views of the structure one after another, those alone that there is something for.
fn next_showing(now: Showing, shown: &Shown) -> Showing {
    let clusters = [Showing::Clusters, Showing::FirstComponent, Showing::Outlines];
    let attributes = [Attribute::Scale, Attribute::Anisotropy, Attribute::Opacity, Attribute::Normal];
    let all: Vec<Showing> = std::iter::once(Showing::Scene)
        .chain(clusters.into_iter().filter(|_| shown.clusters.is_some()))
        .chain(attributes.into_iter().map(Showing::Attribute))
        .collect();
    let at = all.iter().position(|s| *s == now).unwrap_or(0);
    all.get(at + 1).copied().unwrap_or_default()
}
