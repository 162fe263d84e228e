//! The wrist menu: actions for any place in a room, independent of the controller's buttons.

use egui::{Ui, Vec2};

use super::control::choice;
use super::output::{DisplayAction, Output};
use super::panel::{Panel, RoomPlace};
use super::state::Panels;
use super::theme;
use crate::display::{Tools, ViewState};

impl Panel {
    /// The wrist menu: the brush mode, the answers to a stroke, one step back and forth, the panels, the scene's placement, a
    /// screenshot, labels.
    pub const WRIST: Self = Self {
        name: "wrist",
        title: "Wrist menu",
        icon: None,
        size: Vec2::new(340.0, 200.0),
        dock: None,
        place: RoomPlace::Wrist,
        has_content: |_| true,
        draw: Panels::wrist,
    };
}

impl Panels {
    fn wrist(&mut self, ui: &mut Ui, state: &ViewState, tools: &mut Tools) -> Output {
        let mut output = Output::default();
        theme::frame(ui).show(ui, |ui| {
            ui.set_min_size(ui.available_size());
            if state.services.selection {
                self.modes(ui, tools);
                self.answers(ui, state, tools, &mut output);
            }
            if state.services.scene {
                self.steps_back(ui, state, &mut output);
            }
            ui.horizontal(|ui| {
                for (action, text) in [
                    (DisplayAction::Panels, "panels"),
                    (DisplayAction::Fit, "fit all"),
                    (DisplayAction::Bookmark, "keep this place"),
                ] {
                    if self.supported_actions.contains(&action) && ui.button(text).clicked() {
                        output.actions.push(action);
                    }
                }
            });
            ui.horizontal(|ui| {
                if self.supported_actions.contains(&DisplayAction::Screenshot) && ui.button("screenshot").clicked() {
                    output.actions.push(DisplayAction::Screenshot);
                }
                if let Some(speech) = &state.speech {
                    self.talk_button(ui, speech, &mut output);
                }
                for (on, text) in [(&mut tools.callouts, "labels"), (&mut tools.upright, "upright")] {
                    if choice(ui, *on, text) {
                        *on = !*on;
                    }
                }
            });
        });
        output
    }
}
