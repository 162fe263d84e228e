//! The wrist menu: actions for any place in a room, independent of the controller's buttons.

use egui::{Ui, Vec2};

use super::control::choice;
use super::output::{DisplayAction, Output};
use super::panel::{Panel, RoomPlace};
use super::state::Panels;
use super::theme;
use super::tour::tour_buttons;
use crate::display::{Request, Tools, ViewState};

impl Panel {
    /// The wrist menu: the brush mode, the answers to a stroke, one step back and forth, questions about the selection or the
    /// buttons of a tour, the panels, the scene's placement, a screenshot, labels.
    pub const WRIST: Self = Self {
        name: "wrist",
        title: "Wrist menu",
        icon: None,
        size: Vec2::new(340.0, 236.0),
        dock: None,
        place: RoomPlace::Wrist,
        has_content: |_| true,
        draw: Panels::wrist,
    };
}

/// Sentences about the selection, with the text of their button.
const ABOUT_SELECTION: [(&str, &str); 2] =
    [("what is this?", "what is selected?"), ("things like this", LIKE_SELECTION)];
const LIKE_SELECTION: &str = "find things like this";

/// Asks the agents about the selection, if there is one.
fn about_selection(ui: &mut Ui, state: &ViewState, output: &mut Output) {
    if !state.services.agents || state.scene.selection().mask().is_none() {
        return;
    }
    ui.horizontal(|ui| {
        for (text, sentence) in ABOUT_SELECTION {
            // Likeness is the labeling service's.
            let is_offered = sentence != LIKE_SELECTION || state.services.labeling;
            if is_offered && ui.button(text).clicked() {
                output.requests.push(Request::Say(sentence.to_owned()));
            }
        }
    });
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
            // The menu has no room for a further line.
            if state.tour.is_some() {
                ui.horizontal(|ui| tour_buttons(ui, state, &mut output));
            } else {
                about_selection(ui, state, &mut output);
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
