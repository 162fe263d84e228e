//! The panel "scene control".

use egui::{RichText, Ui, Vec2};

use super::commands;
use super::control::{scrolling, section};
use super::icon::Icon;
use super::output::Output;
use super::panel::{Dock, Panel, RoomPlace};
use super::state::Panels;
use crate::display::{Tools, ViewState};

impl Panel {
    /// Scene control: units, light, viewpoint, history, and display options.
    pub const SCENE: Self = Self {
        name: "scene",
        title: "Scene control",
        icon: Some(Icon::Layers),
        size: Vec2::new(460.0, 760.0),
        dock: Some(Dock::Left),
        place: RoomPlace::Around { degrees: -55.0 },
        has_content: |_| true,
        draw: Panels::scene_control,
    };
}

impl Panels {
    fn scene_control(&mut self, ui: &mut Ui, state: &ViewState, tools: &mut Tools) -> Output {
        let mut output = Output::default();
        scrolling(ui, Panel::SCENE.name, |ui| self.scene_sections(ui, state, tools, &mut output));
        output
    }

    fn scene_sections(&mut self, ui: &mut Ui, state: &ViewState, tools: &mut Tools, output: &mut Output) {
        Panel::SCENE.heading(ui);
        if state.services.scene {
            self.steps_back(ui, state, output);
        } else {
            ui.label(
                RichText::new("The scene service does not answer: no changes now. \"What is shown\" still works.")
                    .weak(),
            );
        }
        section(ui, "Base units", true, |ui| self.base_units(ui, state, output));
        if state.scene.units().any(|u| !u.derived) {
            section(ui, "Units", true, |ui| self.editable_units(ui, state, false, output));
        }
        if state.scene.units().any(|u| u.derived) {
            section(ui, "Made by commands", false, |ui| self.editable_units(ui, state, true, output));
        }
        if state.services.scene && ui.button("show everything").clicked() {
            output.change(commands::set_visibility(commands::everything(), true));
        }
        section(ui, "What is shown", false, |ui| self.what_is_shown(ui, state, tools));
        if state.services.scene {
            section(ui, "Light and background", false, |ui| self.light(ui, state, tools, output));
        }
        if state.services.scene || !self.supported_actions.is_empty() {
            section(ui, "Viewpoint", false, |ui| self.viewpoint(ui, state, output));
        }
        if state.services.scene {
            section(ui, "History", false, |ui| self.history(ui, state, output));
        }
        section(ui, "This display", false, |ui| self.this_display(ui, tools));
    }
}
