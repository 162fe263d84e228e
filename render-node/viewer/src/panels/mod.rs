//! Panels: what a person reads and presses beside the scene, the same in a window and in a headset.
//!
//! [`Panels`] keeps what lasts from frame to frame: the chosen unit, locks, what is being typed. A display calls one method for
//! each panel that it shows, with an [`egui::Ui`] of any size (a window, docked) or of [`Panel::size`] (a headset, one
//! [`egui::Context`] for each panel), after [`theme::apply`] to each context:
//!
//! ```no_run
//! # use sg_viewer::display::{Drafts, Request, Seat, Shown, Tools};
//! # use sg_viewer::panels::{Panel, Panels, Place, theme};
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
mod output;
mod panel;
mod pick_color;
mod prompt;
mod scene_control;
mod state;
pub mod theme;
pub mod transfer;
mod typing;
mod units;
mod walk;
mod wrist;

use std::path::Path;

use egui::Ui;
use sg_scene::model::Scene;

use crate::display::{Shown, Tools};

pub use legend::legend;
pub use output::{Draft, Output, Place, Wish};
pub use panel::Panel;
pub use state::Panels;

/// The narrowest dock that everything in it has room in, points, to be multiplied by [`Tools::scale`].
pub const NARROWEST: f32 = 310.0;

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
