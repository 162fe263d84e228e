//! The panel "scene control".

use egui::{RichText, Ui};

use super::ask;
use super::control::{scrolling, section};
use super::output::Output;
use super::panel::Panel;
use super::state::Panels;
use crate::display::{Shown, Tools};

impl Panels {
    /// Units, light, viewpoint, history, and what is shown.
    pub(super) fn scene_control(&mut self, ui: &mut Ui, shown: &Shown, tools: &mut Tools) -> Output {
        let mut asked = Output::default();
        ui.push_id(Panel::Scene.name(), |ui| {
            scrolling(ui, Panel::Scene.name(), |ui| self.scene_sections(ui, shown, tools, &mut asked));
        });
        self.settle(Panel::Scene, ui, &mut asked);
        asked
    }

    fn scene_sections(&mut self, ui: &mut Ui, shown: &Shown, tools: &mut Tools, asked: &mut Output) {
        ui.heading(Panel::Scene.name());
        if shown.offered.scene {
            self.steps_back(ui, shown, asked);
        } else {
            ui.label(RichText::new("The scene takes no changes now; what is shown can still be chosen.").weak());
        }
        section(ui, "Base units", true, |ui| self.base_units(ui, shown, asked));
        if shown.scene.units().any(|u| !u.derived) {
            section(ui, "Units", true, |ui| self.editable_units(ui, shown, false, asked));
        }
        if shown.scene.units().any(|u| u.derived) {
            section(ui, "Made by commands", false, |ui| self.editable_units(ui, shown, true, asked));
        }
        if shown.offered.scene && ui.button("show everything").clicked() {
            asked.change(ask::set_visibility(ask::everything(), true));
        }
        section(ui, "What is shown", false, |ui| self.what_is_shown(ui, shown, tools));
        if shown.offered.scene {
            section(ui, "Light and background", false, |ui| self.light(ui, shown, asked));
        }
        if shown.offered.scene || !self.fulfils.is_empty() {
            section(ui, "Viewpoint", false, |ui| self.viewpoint(ui, shown, asked));
        }
        if shown.offered.scene {
            section(ui, "History", false, |ui| self.history(ui, shown, asked));
        }
        section(ui, "This display", false, |ui| self.this_display(ui, tools));
    }
}
