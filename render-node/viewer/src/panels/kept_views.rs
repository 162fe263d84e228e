//! Kept viewpoints of the scene: a row that keeps the present one, and a row for each kept one.

use egui::{Align, Button, Layout, ScrollArea, Ui, vec2};
use sg_edit::KeptView;
use sg_proto::limits::{MAX_KEPT_VIEWS, MAX_NAME_BYTES};
use sg_proto::scene::command::Action;
use sg_proto::scene::{ForgetView, KeepView, SetView, set_view};

use super::control::{button_width, scale};
use super::output::Output;
use super::state::Panels;
use super::text_input::{Field, FieldEvent};
use crate::display::ViewState;

/// Height of the list of kept viewpoints, beyond which it scrolls, points at the usual size of text.
const LIST: f32 = 190.0;

/// The button that keeps the present viewpoint.
const KEEP: &str = "keep this view";

/// The button that forgets a kept one.
const FORGET: &str = "forget";

impl Panels {
    /// A field for a name with a button that keeps the scene's viewpoint, and the kept viewpoints, oldest first.
    pub(super) fn kept_views(&mut self, ui: &mut Ui, state: &ViewState, output: &mut Output) {
        let kept = state.scene.kept_views();
        self.keep_view(ui, kept, output);
        if kept.is_empty() {
            return;
        }
        let list = ScrollArea::vertical().id_salt("kept views").max_height(LIST * scale(ui)).auto_shrink([false, true]);
        list.show(ui, |ui| {
            for view in kept {
                let asked = ui.push_id(&view.name, |ui| kept_row(ui, &view.name)).inner;
                if let Some(action) = asked {
                    output.change(action);
                }
            }
        });
    }

    fn keep_view(&mut self, ui: &mut Ui, kept: &[KeptView], output: &mut Output) {
        let mut keeps = false;
        ui.horizontal(|ui| {
            let width = ui.available_width() - button_width(ui, KEEP) - ui.spacing().item_spacing.x;
            let hint = Field::ViewName.name();
            keeps = self.text_input.edit(ui, Field::ViewName, hint, width, MAX_NAME_BYTES) == FieldEvent::Entered;
            let name = self.text_input.text(Field::ViewName).trim();
            let is_replaced = kept.iter().any(|view| view.name == name);
            let is_full = kept.len() >= MAX_KEPT_VIEWS && !is_replaced;
            let ready = !is_full && name.len() <= MAX_NAME_BYTES;
            let does = if is_replaced {
                "replaces the kept view of this name"
            } else {
                "keeps the viewpoint with the scene; without a name it is “view 1”, “view 2” and so on"
            };
            let why = if is_full {
                format!("{MAX_KEPT_VIEWS} views are kept; forget one first")
            } else {
                "the name is too long".to_owned()
            };
            let button = ui.add_enabled(ready, Button::new(KEEP)).on_hover_text(does);
            let pressed = button.on_disabled_hover_text(why).clicked();
            keeps = ready && (pressed || keeps);
        });
        if keeps {
            let name = self.text_input.text(Field::ViewName).trim().to_owned();
            output.change(Action::KeepView(KeepView { name }));
            self.text_input.set(Field::ViewName, "");
        }
    }
}

/// The line of a kept viewpoint: a press on its name goes there. Returns the change that was asked for.
fn kept_row(ui: &mut Ui, name: &str) -> Option<Action> {
    let row = ui.horizontal(|ui| {
        let width = ui.available_width() - button_width(ui, FORGET) - ui.spacing().item_spacing.x;
        let size = vec2(width.max(40.0), ui.spacing().interact_size.y);
        let button = Button::new(name).truncate().min_size(size).frame_when_inactive(false);
        let shape = Layout::left_to_right(Align::Center).with_main_justify(true).with_main_align(Align::Min);
        let going = ui.allocate_ui_with_layout(size, shape, |ui| ui.add(button)).inner;
        // A side of the box, or a unit, may have the same name.
        ui.ctx().accesskit_node_builder(going.id, |node| node.set_label(format!("go to {name}")));
        let forgetting = ui.button(FORGET);
        ui.ctx().accesskit_node_builder(forgetting.id, |node| node.set_label(format!("forget {name}")));
        let goes = going.on_hover_text(format!("goes to {name}")).clicked();
        let forgets = forgetting.on_hover_text("undo brings the kept view back").clicked();
        (goes, forgets)
    });
    match row.inner {
        (true, _) => {
            let change = Some(set_view::Change::Kept(name.to_owned()));
            Some(Action::SetView(SetView { change }))
        }
        (_, true) => Some(Action::ForgetView(ForgetView { name: name.to_owned() })),
        _ => None,
    }
}
