//! Panels: what a person reads and presses beside the scene, the same in a window and in a headset.
//!
//! [`Panels`] keeps what lasts from frame to frame: the chosen unit, locks, what is being typed. A display calls one method for
//! each panel that it shows, with an [`egui::Ui`] of any size (a window, docked) or of [`Panel::size`] (a headset, one
//! [`egui::Context`] for each panel), after [`theme::apply`] to each context:
//!
//! ```no_run
//! # use sg_render_node::display::{Drafts, Request, Seat, Shown, Tools};
//! # use sg_render_node::panels::{Panel, Panels, Place, theme};
//! # fn frame(ctx: &egui::Context, input: egui::RawInput, panels: &mut Panels, shown: &Shown, tools: &mut Tools,
//! #          drafts: &mut Drafts, seat: &mut Seat) {
//! theme::apply(ctx, tools);
//! let _ = ctx.run_ui(input, |ui| {
//!     let mut asked = panels.show(Panel::Scene, ui, shown, tools);
//!     asked.show_draft(drafts, shown);
//!     for request in asked.requests {
//!         seat.ask(request);
//!     }
//!     for wish in asked.wishes { /* fit the view, take a screenshot, … */ }
//! });
//! # }
//! ```
//!
//! `shown.scene` is the state with the display's draft on it ([`crate::display::Drafts::over`]), so that a control shows what
//! the hand has made of it. Panels may be drawn only when something changed: when what is shown or set is new, when something
//! points at them, when their context asks for another frame, and when [`Panels::wants_drawing`] says so.
//! [`Panels::is_typing`] says when the keyboard's panel has to be shown.
//!
//! A control whose service is not offered ([`Shown::offered`]) is not drawn, and neither is a [`Wish`] that the display has not
//! said it fulfils.

mod ask;
mod choices;
mod control;
mod history;
mod icon;
mod keyboard;
mod language;
mod legend;
mod light;
mod pick_color;
mod prompt;
mod scene_control;
pub mod theme;
pub mod transfer;
mod typing;
mod units;
mod walk;
mod wrist;

use std::path::Path;

use egui::{ScrollArea, Ui, Vec2};
use sg_edit::UnitRef;
use sg_proto::scene::command::Action;
use sg_scene::model::Scene;

use crate::display::{Drafts, Request, Shown, Tools};
use sg_raster::attributes;

pub use legend::legend;

/// The narrowest dock that everything in it has room in, points, to be multiplied by [`Tools::scale`].
pub const NARROWEST: f32 = 310.0;

/// One of the panels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Panel {
    /// Units, light, viewpoint, history, what is shown.
    Scene,
    /// Brush and selection ("3D prompt").
    Prompt,
    /// What was said and answered.
    Language,
    /// The virtual keyboard.
    Keyboard,
    /// The menu at the wrist of a person in a room.
    Wrist,
}

impl Panel {
    /// All.
    pub const ALL: [Self; 5] = [Self::Scene, Self::Prompt, Self::Language, Self::Keyboard, Self::Wrist];

    /// What it is called.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Scene => "Scene control",
            Self::Prompt => "3D prompt",
            Self::Language => "Language",
            Self::Keyboard => "Keyboard",
            Self::Wrist => "Wrist menu",
        }
    }

    /// Its size in points where it stands by itself in front of a person, to be multiplied by [`Tools::scale`]. What does not
    /// fit its height scrolls.
    #[must_use]
    pub fn size(self) -> Vec2 {
        match self {
            Self::Scene => Vec2::new(460.0, 760.0),
            Self::Prompt => Vec2::new(420.0, 700.0),
            Self::Language => Vec2::new(560.0, 640.0),
            Self::Keyboard => Vec2::new(760.0, 320.0),
            Self::Wrist => Vec2::new(340.0, 136.0),
        }
    }

    /// Its width and height in metres at which a line of its smallest text takes [`theme::LINE_DEGREES`] seen from so far,
    /// in metres; it may be larger.
    #[must_use]
    pub fn least_metres(self, distance: f64) -> [f64; 2] {
        let point = theme::metres_per_point(distance);
        [f64::from(self.size().x) * point, f64::from(self.size().y) * point]
    }

    /// Whether there is anything to show in it now.
    #[must_use]
    pub fn has_content(self, shown: &Shown) -> bool {
        match self {
            Self::Scene | Self::Keyboard | Self::Wrist => true,
            Self::Prompt => shown.offered.selection || shown.offered.scene,
            Self::Language => shown.offered.agents,
        }
    }
}

/// Where panels are shown.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Place {
    /// In a window, with a mouse and a keyboard.
    #[default]
    Window,
    /// Before the eyes, pointed at with a ray; there is a trigger with pressure and no keyboard.
    Headset,
}

/// What a display does by itself when a panel asks for it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wish {
    /// Bring all that is drawn into view.
    Fit,
    /// Keep the present place under the next free number.
    Bookmark,
    /// Go to the place kept under this number, from 1.
    Place(u8),
    /// Show the panels that hang around a person where they were hidden, and the other way round.
    Panels,
    /// Keep a picture of the view.
    Screenshot,
    /// Look at the place of this number, from 0, where a next stroke would tell most ([`Shown::proposals`]); before the eyes of
    /// a person, who turns by themselves, have it stand out.
    Proposal(u8),
}

/// A change under a hand.
#[derive(Debug, Clone, PartialEq)]
pub enum Draft {
    /// Still being made: to be shown, not told. Said once for each change under the hand.
    Hold(Action),
    /// Just let go; the same change is among the requests.
    Release(Action),
}

/// What a person asked for in one frame.
#[derive(Debug, Default, PartialEq)]
pub struct Output {
    /// To be handed to the seat, in this order.
    pub requests: Vec<Request>,
    /// What is under the hand.
    pub draft: Option<Draft>,
    /// What the display does itself.
    pub wishes: Vec<Wish>,
}

impl Output {
    fn change(&mut self, action: Action) {
        self.requests.push(Request::Change(Box::new(action)));
    }

    /// Has the change under the hand seen over the scene that the panels have shown.
    pub fn show_draft(&mut self, drafts: &mut Drafts, shown: &Shown) {
        match self.draft.take() {
            Some(Draft::Hold(action)) => drafts.hold(action),
            Some(Draft::Release(action)) => drafts.release(action, shown.scene.revision()),
            None => (),
        }
    }

    /// Adds what was asked for in another panel of the same frame.
    pub fn join(&mut self, other: Self) {
        self.requests.extend(other.requests);
        self.draft = other.draft.or(self.draft.take());
        self.wishes.extend(other.wishes);
    }
}

/// What panels remember from frame to frame.
#[derive(Debug, Default)]
pub struct Panels {
    /// Where they are shown: decides what needs a trigger, a ray or a mouse.
    pub place: Place,
    /// What the display does when it is wished for; nothing else is drawn.
    pub fulfils: Vec<Wish>,
    /// What the colours mean that are shown now, where they stand for a number.
    pub numbers: Option<attributes::Legend>,
    curves: Vec<Option<transfer::Curve>>,
    chosen: Option<UnitRef>,
    locked: Vec<UnitRef>,
    held: Option<ask::Held>,
    typing: typing::Typing,
    /// What each panel has been drawn of that, in the order of [`Panel::ALL`].
    drawn: [u64; Panel::ALL.len()],
    shift: bool,
    renaming: Option<u64>,
    prompt: prompt::Prompt,
    /// Revision of the scene that was shown last.
    revision: u64,
    shown_notices: legend::Seen,
    clusters: units::Clusters,
}

impl Panels {
    /// Panels of a display.
    #[must_use]
    pub fn new(place: Place) -> Self {
        Self { place, ..Self::default() }
    }

    /// Reads the transfer functions behind a scene's base units, for plots beside them; `path` is what the scene was opened
    /// from. Returns what could not be read, a line each.
    pub fn behind(&mut self, scene: &Scene, path: &Path) -> Vec<String> {
        let (curves, problems) = transfer::curves(scene, path);
        self.curves = curves;
        problems
    }

    /// Whether a text field waits for letters.
    #[must_use]
    pub fn is_typing(&self) -> bool {
        self.typing.field().is_some()
    }

    /// Has letters go to the name of a new unit as soon as that is drawn.
    pub fn name_selection(&mut self) {
        self.typing.turn_to(typing::Field::SaveName);
    }

    /// Has letters go to what is said to the agents as soon as that is drawn.
    pub fn say_something(&mut self) {
        self.typing.turn_to(typing::Field::Say);
    }

    /// Whether a panel would look other than it was drawn last, or do something, because of what was done in another one: letters
    /// that wait for their field, a field that was left for another. What is shown and what is pointed at the display knows.
    #[must_use]
    pub fn wants_drawing(&self, panel: Panel) -> bool {
        self.drawn[panel as usize] != self.typing.version()
    }

    /// Draws a panel into all that is left of a [`Ui`] and says what was asked for.
    pub fn show(&mut self, panel: Panel, ui: &mut Ui, shown: &Shown, tools: &mut Tools) -> Output {
        self.revision = shown.scene.revision();
        let asked = match panel {
            Panel::Scene => self.scene_control(ui, shown, tools),
            Panel::Prompt => self.prompt(ui, shown, tools),
            Panel::Language => self.language(ui, shown),
            Panel::Keyboard => {
                self.keyboard(ui);
                Output::default()
            }
            Panel::Wrist => self.wrist(ui, shown, tools),
        };
        self.drawn[panel as usize] = self.typing.version();
        asked
    }
}

/// Room with the panel's margins; what is too high for it scrolls.
fn scrolling<R>(ui: &mut Ui, panel: Panel, content: impl FnOnce(&mut Ui) -> R) -> R {
    theme::frame(ui)
        .show(ui, |ui| {
            ui.set_min_size(ui.available_size());
            ScrollArea::vertical()
                .id_salt(panel.name())
                .auto_shrink(false)
                .show(ui, |ui| {
                    ui.set_max_width(ui.available_width());
                    content(ui)
                })
                .inner
        })
        .inner
}
