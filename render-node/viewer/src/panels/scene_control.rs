//! The panel "scene control".

use egui::{RichText, Ui, Vec2};

use super::control::{scrolling, section};
use super::icon::Icon;
use super::output::{Output, PanelHost};
use super::panel::{Dock, Panel, RoomPlace};
use super::state::Panels;
use super::text_input::Field;
use super::tour::tour_card;
use crate::display::{Tools, ViewState};

impl Panel {
    /// Scene control: transfer function, light, viewpoint, history, and display options; in a headset also units.
    pub const SCENE: Self = Self {
        name: "scene",
        title: "Scene control",
        icon: Some(Icon::Layers),
        size: Vec2::new(460.0, 760.0),
        dock: Some(Dock::Right),
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
        if !state.services.scene {
            ui.label(
                RichText::new("The scene service does not answer: no changes now. \"What is shown\" still works.")
                    .weak(),
            );
        }
        // A window has them in its task column, and one undo in its toolbar.
        let is_window = self.host == PanelHost::Window;
        if !is_window {
            tour_card(ui, state, output);
            if state.services.scene {
                self.steps_back(ui, state, output);
            }
            self.structures(ui, state, output);
        }
        if state.services.scene && self.has_volume() {
            section(ui, "Transfer function", is_window, |ui| self.transfer_function(ui, state, output));
        }
        section(ui, "What is shown", is_window, |ui| self.what_is_shown(ui, state, tools));
        if state.services.scene {
            section(ui, "Light and background", false, |ui| self.light(ui, state, tools, output));
        }
        let viewpoint = if state.services.scene || !self.supported_actions.is_empty() {
            section(ui, "Viewpoint", false, |ui| self.viewpoint(ui, state, output))
        } else {
            None
        };
        // The field is not drawn while its part is folded, or while the scene service does not answer.
        if viewpoint.is_none() || !state.services.scene {
            self.text_input.forget(Field::ViewName);
        }
        if state.services.scene {
            section(ui, "History", false, |ui| self.history(ui, state, output));
        }
        section(ui, "This display", false, |ui| self.this_display(ui, tools));
    }
}
