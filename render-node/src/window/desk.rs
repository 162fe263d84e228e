//! Everything of a window that a person sees and touches, without the window itself: the picture, the tools, the panels.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use egui::{Align2, Frame, RichText, Ui, Vec2};
use sg_proto::scene::{
    Invert, Redo, SelectionOperation, SelectionStep, SetView, Undo, command, selection_operation, selection_step,
    set_view,
};
use sg_proto::selection::StrokesRequest;
use sg_scene::edit::wire::encode_view;
use sg_scene::model::Scene;
use sg_scene::view::{View, framed_box};
use sg_selection::brush::Brush;

use super::bookmarks::Bookmarks;
use super::keep::{Keep, Keeper};
use super::memory::Memory;
use super::navigation::Navigator;
use super::shortcuts::{self, Action, MOUSE, SHORTCUTS};
use super::viewport::{Pointer, Viewport};
use super::{WindowError, drawing};
use crate::attributes::Attribute;
use crate::backend::Engine;
use crate::display::{BrushMode, Drafts, Dressing, Hand, Pace, Request, Seat, Sense, Showing, Shown, Tools};
use crate::panels::{NARROWEST, Output, Panel, Panels, Place, Wish, theme};
use crate::render::Quality;

/// Widths of the panels at first, points.
const LEFT: f32 = 340.0;
const RIGHT: f32 = 360.0;

/// Points from the lower edge to lines that tell what was not done.
const NOTICES: f32 = 48.0;

/// One step of the keys that widen and narrow the brush.
const WIDER: f64 = 1.15;

/// The window's content.
pub struct Desk {
    scene: Arc<Scene>,
    seat: Seat,
    tools: Tools,
    drafts: Drafts,
    dressing: Dressing,
    viewport: Viewport,
    panels: Panels,
    bookmarks: Bookmarks,
    keeper: Keeper,
    /// The view that the scene told of last: another one moves the eye here.
    shared: View,
    panels_shown: bool,
    help: bool,
    closes: bool,
    frames: u64,
    /// What this window itself has to say.
    line: String,
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

    /// Has textures made anew with the next frame, for another context.
    pub fn forget_textures(&mut self) {
        self.viewport.forget_textures();
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
        self.take_dropped(ui);
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
            let highlighted = self.viewport.highlighted(&shown, &self.tools);
            let look =
                self.dressing.look(&self.scene, &shown.scene, &highlighted, shown.clusters.as_ref(), &self.tools);
            self.viewport.show(ui, response.rect, &look, &shown, &self.tools);
        });
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
                Wish::Place(number) => {
                    if let Some(view) = self.bookmarks.place(number) {
                        self.viewport.navigator.view = view;
                    }
                }
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

    fn act(&mut self, action: Action, shown: &Shown, requests: &mut Vec<Request>) {
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

    fn toolbar(&mut self, ui: &mut Ui, shown: &Shown, requests: &mut Vec<Request>) {
        ui.horizontal_wrapped(|ui| {
            for pointer in Pointer::ALL {
                if pointer == Pointer::Navigate || shown.offered.selection {
                    ui.selectable_value(&mut self.viewport.pointer, pointer, pointer.name());
                }
            }
            if shown.offered.selection {
                ui.separator();
                for mode in BrushMode::ALL {
                    ui.selectable_value(&mut self.tools.mode, mode, mode.name());
                }
            }
            ui.separator();
            for manner in super::Manner::ALL {
                ui.selectable_value(&mut self.viewport.navigator.manner, manner, manner.name());
            }
            ui.separator();
            let buttons = [
                (Action::Undo, "undo", shown.offered.scene, !shown.undo.is_empty()),
                (Action::Redo, "redo", shown.offered.scene, !shown.redo.is_empty()),
                (Action::Fit, "fit", true, true),
                (Action::Stereo, "two eyes", true, true),
                (Action::Picture, "picture", true, true),
                (Action::Turntable, "turntable", true, true),
                (Action::Panels, "panels", true, true),
                (Action::Help, "?", true, true),
            ];
            for (action, name, offered, enabled) in buttons {
                let written = SHORTCUTS.iter().find(|s| s.action == action).map_or("", |s| s.written);
                if offered && ui.add_enabled(enabled, egui::Button::new(name)).on_hover_text(written).clicked() {
                    self.act(action, shown, requests);
                }
            }
        });
    }

    fn status(&mut self, ui: &mut Ui, shown: &Shown) {
        ui.horizontal_wrapped(|ui| {
            let newest = &self.viewport.newest;
            let level = newest.level.map_or_else(String::new, |level| {
                let quality = match level.quality {
                    Quality::Exact => "exact",
                    Quality::Standard => "standard",
                    Quality::Fast => "fast",
                };
                let scale = if level.scale < 1.0 {
                    format!(", {:.0} % of the edge", 100.0 * level.scale)
                } else {
                    String::new()
                };
                format!("{quality}{scale}, {:.0} ms, {} late", 1e3 * newest.seconds, self.viewport.late())
            });
            ui.label(format!("{}: {level}", if newest.engine.is_empty() { "drawing" } else { &newest.engine }));
            ui.separator();
            let tentative = if shown.tentative { ", not settled yet" } else { "" };
            ui.label(format!("{} of {} Gaussians selected{tentative}", shown.selected.count(), shown.scene.count()));
            if self.seat.dropped() > 0 {
                ui.separator();
                ui.label(format!("{} requests not taken", self.seat.dropped()));
            }
            if let Some(trouble) = &newest.trouble {
                ui.separator();
                ui.label(RichText::new(trouble).color(theme::color_of(Sense::Remove)));
            }
            if let Some(share) = self.keeper.progress() {
                ui.separator();
                ui.add(egui::ProgressBar::new(share).desired_width(120.0).text("turntable"));
                ui.ctx().request_repaint_after(std::time::Duration::from_millis(200));
            }
            if !self.line.is_empty() {
                ui.separator();
                ui.label(&self.line);
            }
        });
    }

    fn show_help(&mut self, ui: &Ui) {
        let help = egui::Window::new("What keys and the mouse do").anchor(Align2::CENTER_CENTER, [0.0, 0.0]);
        help.open(&mut self.help).collapsible(false).resizable(false).show(ui.ctx(), |ui| {
            egui::Grid::new("shortcuts").num_columns(4).striped(true).show(ui, |ui| {
                for pair in SHORTCUTS.chunks(2) {
                    for shortcut in pair {
                        ui.strong(shortcut.written);
                        ui.label(shortcut.does);
                    }
                    ui.end_row();
                }
            });
            ui.separator();
            egui::Grid::new("mouse").num_columns(2).striped(true).show(ui, |ui| {
                for (what, does) in MOUSE {
                    ui.strong(*what);
                    ui.label(*does);
                    ui.end_row();
                }
            });
        });
    }

    /// Files that were dropped on the window: a camera is looked from.
    fn take_dropped(&mut self, ui: &Ui) {
        for path in ui.input(|i| i.raw.dropped_files.iter().map(|f| f.path().to_path_buf()).collect::<Vec<_>>()) {
            let view = &mut self.viewport.navigator.view;
            self.line = match super::dropped::view_of(&path, view.target) {
                Ok(seen) => {
                    *view = seen;
                    format!("seen as {} says", path.display())
                }
                Err(why) => why,
            };
        }
    }
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
