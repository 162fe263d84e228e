//! The wrist menu: what is wanted anywhere in a room, whatever buttons its hands have.

use egui::Ui;

use super::output::{Output, Wish};
use super::state::Panels;
use super::theme;
use crate::display::{Shown, Tools};

impl Panels {
    /// What strokes mean, one step back and forth, the panels, the scene's place.
    pub(super) fn wrist(&self, ui: &mut Ui, shown: &Shown, tools: &mut Tools) -> Output {
        let mut asked = Output::default();
        theme::frame(ui).show(ui, |ui| {
            ui.set_min_size(ui.available_size());
            if shown.offered.selection {
                self.modes(ui, tools);
            }
            if shown.offered.scene {
                self.steps_back(ui, shown, &mut asked);
            }
            ui.horizontal(|ui| {
                for (wish, text) in
                    [(Wish::Panels, "panels"), (Wish::Fit, "fit all"), (Wish::Bookmark, "keep this place")]
                {
                    if self.fulfils.contains(&wish) && ui.button(text).clicked() {
                        asked.wishes.push(wish);
                    }
                }
            });
        });
        asked
    }
}
