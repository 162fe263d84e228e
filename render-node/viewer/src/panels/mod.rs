//! Panels: text and controls beside the scene, the same in a window and in a headset.
//!
//! [`Panel::ALL`] is the table of panels. A panel is one file and one row of the table: its name, size and places, and the
//! function that draws it.
//!
//! [`Panels`] keeps the state between frames: the chosen unit, locks, the typed text. A display calls one method for each
//! visible panel. It passes an [`egui::Ui`] of any size (a window, docked) or of [`Panel::size`] (a headset, one
//! [`egui::Context`] for each panel). It calls [`theme::apply`] on each context first:
//!
//! ```no_run
//! # use sg_viewer::display::{Drafts, Request, Tools, ViewPort, ViewState};
//! # use sg_viewer::panels::{Panel, Panels, theme};
//! # fn frame(ctx: &egui::Context, input: egui::RawInput, panels: &mut Panels, state: &ViewState, tools: &mut Tools,
//! #          drafts: &mut Drafts, view_port: &mut ViewPort) {
//! theme::apply(ctx, tools);
//! let _ = ctx.run_ui(input, |ui| {
//!     let mut output = panels.show(Panel::SCENE, ui, state, tools);
//!     output.show_draft(drafts, state);
//!     for request in output.requests {
//!         view_port.send(request);
//!     }
//!     for action in output.actions { /* fit the view, take a screenshot, … */ }
//! });
//! # }
//! ```
//!
//! `state.scene` is the state with the display's draft applied ([`crate::display::Drafts::over`]), so a control shows the
//! hand's edit. Panels need drawing only after a change: new content or settings, a pointer on them, or a repaint request
//! of their context. [`Panels::wants_drawing`] reports further changes. [`Panels::is_typing`] says when to show the
//! keyboard's panel.
//!
//! A control of an unavailable service ([`ViewState::services`]) is not drawn. Neither is a [`DisplayAction`] that the
//! display does not support.

mod commands;
mod control;
mod display_options;
mod function;
mod history;
mod icon;
mod kept_views;
mod keyboard;
mod label_questions;
mod labels;
mod language;
mod last_turn;
mod legend;
mod light;
mod merge;
mod microphone;
mod output;
mod panel;
mod pick_color;
mod scene_control;
mod select;
mod state;
mod table;
mod text_input;
pub mod theme;
mod tone;
mod tour;
pub mod transfer;
mod units;
mod volume_values;
mod walk;
mod wrist;

use std::path::Path;

use egui::{Rect, Ui};
use sg_scene::model::Scene;

use crate::display::{Tools, ViewState};

use volume_values::VolumeValues;

pub(crate) use commands::{
    crop_to_selection, delete_selection, duplicate_selection, frame_selection, select_visible, turn_up,
};
pub(crate) use control::{capital, labelled_button};
pub(crate) use display_options::mode_icon;
pub(crate) use icon::Icon;
pub use legend::legend;
pub use output::{DisplayAction, Draft, Output, PanelHost};
pub use panel::{Dock, Panel, RoomPlace};
pub use state::Panels;
pub(crate) use tour::{tour_bar, tour_legend};

/// The narrowest dock that everything in it has room in, points, to be multiplied by [`Tools::scale`].
pub const NARROWEST: f32 = 310.0;

impl Panels {
    /// Panels of a display.
    #[must_use]
    pub fn new(host: PanelHost) -> Self {
        Self { host, ..Self::default() }
    }

    /// Reads the transfer functions behind a scene's base units, for plots beside them, and the values of its volume. `path` is
    /// the scene's source, and `scene` is as its file has it.
    /// Returns the read errors, a line each.
    pub fn behind(&mut self, scene: &Scene, path: &Path) -> Vec<String> {
        let (functions, problems) = sg_reclassify::functions(scene, path);
        self.volume = VolumeValues::of(scene, &functions);
        self.functions = functions;
        problems
    }

    /// Whether a text field waits for letters.
    #[must_use]
    pub fn is_typing(&self) -> bool {
        self.text_input.field().is_some()
    }

    /// Whether a text field gets the focus as soon as it is drawn.
    pub(crate) fn expects_letters(&self) -> bool {
        self.text_input.is_awaited()
    }

    /// Gives no field the focus: Esc came before it was drawn.
    pub(crate) fn expect_no_letters(&mut self) {
        self.text_input.leave();
    }

    /// Has letters go to the name of a new unit as soon as that is drawn.
    pub fn name_selection(&mut self) {
        self.text_input.turn_to(text_input::Field::SaveName);
    }

    /// Moves the keyboard focus to the field for the agents at its next frame.
    pub fn say_something(&mut self) {
        self.text_input.turn_to(text_input::Field::Say);
    }

    /// Where the field for the name of a new unit was drawn in this frame, points.
    pub(crate) fn name_place(&mut self) -> Option<Rect> {
        self.text_input.take_place(text_input::Field::SaveName)
    }

    /// Where the field for the agents was drawn in this frame, points.
    pub(crate) fn say_place(&mut self) -> Option<Rect> {
        self.text_input.take_place(text_input::Field::Say)
    }

    /// Whether another panel's change alters this panel's look or state: letters waiting for their field, or a field that
    /// lost its focus. The display itself knows about its content and its pointer.
    #[must_use]
    pub fn wants_drawing(&self, panel: Panel) -> bool {
        self.drawn.get(panel.name).copied().unwrap_or_default() != self.text_input.version()
    }

    /// Draws a panel into the rest of a [`Ui`] and returns its requests.
    pub fn show(&mut self, panel: Panel, ui: &mut Ui, state: &ViewState, tools: &mut Tools) -> Output {
        self.revision = state.scene.revision();
        self.drawing = panel.name;
        let mut output = ui.push_id(panel.name, |ui| (panel.draw)(self, ui, state, tools)).inner;
        self.settle(panel, ui, &mut output);
        self.drawn.insert(panel.name, self.text_input.version());
        output
    }
}
