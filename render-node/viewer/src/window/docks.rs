//! The panels beside a window's picture.

use egui::{Ui, Vec2};
use glam::DVec3;
use sg_scene::view::View;

use super::shortcuts::Action;
use super::window_ui::WindowUi;
use crate::display::{Request, ViewState};
use crate::panels::{DisplayAction, Dock, NARROWEST, Output, Panel};

/// Widths of the panels at first, points.
const LEFT: f32 = 376.0;
const RIGHT: f32 = 360.0;

/// Least width of the picture between two docks, points at the usual size of text.
const PICTURE: f32 = 260.0;

impl WindowUi {
    /// Panels beside the picture, at the sides that the table of panels gives them.
    pub(super) fn show_panels(&mut self, ui: &mut Ui, state: &ViewState, requests: &mut Vec<Request>) {
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
}

/// A view of a place from the same direction and distance.
fn turned_to(view: View, at: DVec3) -> View {
    View { eye: at + (view.eye - view.target), target: at, ..view }
}
