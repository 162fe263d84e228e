//! The panel "Select": brush, selection, and the resulting unit.

use egui::{Align, Button, Response, RichText, Ui, Vec2};
use sg_edit::UnitRef;
use sg_proto::limits::MAX_NAME_BYTES;
use sg_proto::scene::command::Action;
use sg_proto::scene::selection_operation::Operation;
use sg_proto::scene::selection_step::Step;
use sg_proto::scene::{
    Combine, FillHoles, Grow, Invert, LargestPieces, RestoreGaussians, SaveUnit, SelectionOperation, SelectionStep,
    Shrink, Similar,
};
use sg_proto::selection::StrokesRequest;

use super::commands::{crop_to_selection, delete_selection, duplicate_selection, frame_selection, select_visible};
use super::control::{
    NOTHING_SELECTED, Number, button_width, by_number, framed, scale, scroll, scrolling, section, section_that,
};
use super::display_options::brush_width;
use super::icon::Icon;
use super::output::{Output, PanelHost};
use super::panel::{Dock, Panel, RoomPlace};
use super::pick_color::{Picked, color_button};
use super::state::Panels;
use super::text_input::{Field, FieldEvent};
use super::theme;
use crate::display::number_format::{count, decimal, percent};
use crate::display::{Request, Tools, ViewState};

/// Least height of a window's column that has room for a part that does not scroll, points at the usual size of text.
const FIXED_HEAD: f32 = 330.0;

impl Panel {
    /// Select: brush, selection, and the resulting unit.
    pub const SELECT: Self = Self {
        name: "select",
        title: "Select",
        icon: Some(Icon::Lasso),
        size: Vec2::new(420.0, 700.0),
        dock: Some(Dock::Left),
        place: RoomPlace::Around { degrees: 50.0 },
        has_content: |state| state.services.selection || state.services.scene,
        draw: Panels::select_panel,
    };
}

impl Panels {
    fn select_panel(&mut self, ui: &mut Ui, state: &ViewState, tools: &mut Tools) -> Output {
        let mut output = Output::default();
        match self.host {
            PanelHost::Window => framed(ui, |ui| self.task_column(ui, state, tools, &mut output)),
            PanelHost::Headset => {
                scrolling(ui, Panel::SELECT.name, |ui| self.select_sections(ui, state, tools, &mut output));
            }
        }
        output
    }

    /// The column of a window: the brush, the selection with its number, its name and the button that saves it, and the
    /// structures. The first two stay in sight while the rest scrolls, unless the column is too low for that.
    fn task_column(&mut self, ui: &mut Ui, state: &ViewState, tools: &mut Tools, output: &mut Output) {
        if ui.available_height() >= FIXED_HEAD * scale(ui) {
            self.task_head(ui, state, tools, output);
            scroll(ui, Panel::SELECT.name, |ui| self.task_sections(ui, state, tools, output));
        } else {
            scroll(ui, Panel::SELECT.name, |ui| {
                self.task_head(ui, state, tools, output);
                self.task_sections(ui, state, tools, output);
            });
        }
    }

    fn task_head(&mut self, ui: &mut Ui, state: &ViewState, tools: &mut Tools, output: &mut Output) {
        if state.services.selection {
            self.modes(ui, tools);
            ui.label(RichText::new(tools.mode.hint()).small().weak());
            brush_width(ui, tools);
        }
        how_many(ui, state);
        self.answers(ui, state, tools, output);
        if state.services.scene {
            self.save(ui, state, output);
        } else {
            self.text_input.forget(Field::SaveName);
        }
    }

    fn task_sections(&mut self, ui: &mut Ui, state: &ViewState, tools: &mut Tools, output: &mut Output) {
        if state.tuning().is_some() {
            section(ui, "Reach and Strictness", true, |ui| self.walk(ui, state, tools, output));
        }
        self.structures(ui, state, output);
        section(ui, "Selection", true, |ui| {
            self.operations(ui, state, tools, output);
            self.highlight(ui, tools);
        });
        if state.services.selection {
            section(ui, "Brush", false, |ui| self.brush_reach(ui, tools));
        }
    }

    fn select_sections(&mut self, ui: &mut Ui, state: &ViewState, tools: &mut Tools, output: &mut Output) {
        Panel::SELECT.heading(ui);
        if state.services.scene {
            self.steps_back(ui, state, output);
        }
        if state.services.selection {
            section(ui, "Brush", true, |ui| self.brush(ui, tools));
        }
        if state.tuning().is_some() {
            // In a room the stick changes a walk, and the controls below must be in reach without scrolling.
            section(ui, "Reach and Strictness", false, |ui| {
                self.walk(ui, state, tools, output);
            });
        }
        // The number and the name come before what needs scrolling in a room.
        how_many(ui, state);
        self.answers(ui, state, tools, output);
        if state.services.scene {
            let opens = self.text_input.wants(Field::SaveName);
            section_that(ui, "Save as a unit", true, opens, |ui| self.save(ui, state, output));
        } else {
            self.text_input.forget(Field::SaveName);
        }
        section(ui, "Selection", true, |ui| {
            self.highlight(ui, tools);
            self.operations(ui, state, tools, output);
        });
    }

    fn highlight(&self, ui: &mut Ui, tools: &mut Tools) {
        ui.horizontal(|ui| {
            ui.label("highlight");
            let picked = color_button(ui, "colour of the selection", Some(tools.highlight), None).picked;
            if let Some(Picked::Color(rgb)) = picked {
                tools.highlight = rgb;
            }
        });
        let mut number = |name, range, value: &mut f32| {
            let mut x = f64::from(*value);
            if (Number { name, range, logarithmic: false, text: percent }).show(ui, &mut x) {
                *value = x as f32;
            }
        };
        number("colour mix", 0.0..=1.0, &mut tools.highlight_mix);
        number("opacity", 0.0..=2.0, &mut tools.highlight_opacity);
    }

    fn operations(&mut self, ui: &mut Ui, state: &ViewState, tools: &Tools, output: &mut Output) {
        let include_hidden = tools.include_hidden;
        let some = !state.selected.is_none();
        let step = |operation: Operation, combine: Combine| {
            let operation = SelectionOperation { operation: Some(operation), combine: combine.into() };
            let steps = vec![SelectionStep { step: Some(Step::Operation(operation)) }];
            Request::Select(StrokesRequest { steps, include_hidden, ..StrokesRequest::default() })
        };
        let own = Combine::Unspecified;
        let button = |ui: &mut Ui, on: bool, text: &str, does: &str| {
            let response = ui.add_enabled(on, Button::new(text));
            response.on_hover_text(does).on_disabled_hover_text(NOTHING_SELECTED).clicked()
        };
        ui.horizontal_wrapped(|ui| {
            if state.services.selection {
                if button(ui, some, "clear", "forgets all strokes and selects nothing (Ctrl+D)") {
                    let restart = StrokesRequest { restart: true, ..StrokesRequest::default() };
                    output.requests.push(Request::Select(restart));
                }
                if button(
                    ui,
                    true,
                    "invert",
                    "within the structures of the file in which something is selected (Ctrl+I)",
                ) {
                    output.requests.push(step(Operation::Invert(Invert {}), own));
                }
                if button(ui, some, "largest piece", "keeps only the largest connected piece") {
                    output.requests.push(step(Operation::LargestPieces(LargestPieces { keep: 1 }), own));
                }
            }
            if state.services.scene {
                self.all_and_deletion(ui, state, output);
                // The scene frames the selection that it has stored.
                let stored = !state.scene.selection().mask().is_none();
                if button(ui, stored, "frame selection", "looks at the selection from the present direction (Shift+F)")
                {
                    output.change(frame_selection());
                }
            }
        });
        if !state.services.selection {
            return;
        }
        let select = &mut self.select;
        let number = |name, range, logarithmic, text| Number { name, range, logarithmic, text };
        let does = "by this share of the scene's longest edge";
        let by = number("distance", 0.0005..=0.1, true, |x| format!("by {}", percent(x)));
        let pressed = by_number(ui, some, &[("grow", does), ("shrink", does)], by, &mut select.distance);
        let distance = select.distance;
        match pressed {
            Some(0) => output.requests.push(step(Operation::Grow(Grow { distance }), own)),
            Some(_) => output.requests.push(step(Operation::Shrink(Shrink { distance }), own)),
            None => {}
        }
        let does = "adds unselected pieces of at most this many Gaussians that touch the selection";
        let most =
            number("largest hole", 1.0..=10_000.0, true, |x| format!("up to {} splats", count(x.round() as usize)));
        if by_number(ui, some, &[("fill holes", does)], most, &mut select.hole).is_some() {
            let most = select.hole.round() as u64;
            output.requests.push(step(Operation::FillHoles(FillHoles { most }), own));
        }
        let does = "adds Gaussians this close to the mean features of the selection";
        let within = number("likeness", 0.5..=5.0, false, |x| format!("similarity {} σ", decimal(x)));
        if by_number(ui, some, &[("add similar", does)], within, &mut select.likeness).is_some() {
            let threshold = select.likeness;
            output.requests.push(step(Operation::Similar(Similar { threshold }), Combine::Add));
        }
    }

    /// Buttons that select everything visible, delete, crop and restore.
    fn all_and_deletion(&mut self, ui: &mut Ui, state: &ViewState, output: &mut Output) {
        let all = ui.button("all").on_hover_text("selects everything visible (Ctrl+A)");
        if all.clicked()
            && let Ok(action) = select_visible(&state.scene)
        {
            output.change(action);
        }
        // The scene deletes the selection that it has stored.
        let selected = state.scene.selection().mask().count();
        let stored = selected > 0 && !state.uncommitted;
        let mut button = |on: bool, text: &str, does: &str, action: Action| {
            let button = ui.add_enabled(on, Button::new(text)).on_hover_text(does);
            if button.on_disabled_hover_text(NOTHING_SELECTED).clicked() {
                output.change(action);
            }
        };
        let does = "removes the selected Gaussians from the scene; undo brings them back (Delete)";
        button(stored, "delete", does, delete_selection());
        let does = "copies the selected Gaussians in place and selects the copy (Shift+D)";
        button(stored, "duplicate", does, duplicate_selection());
        // Without anything else there is nothing to crop.
        let rest = selected < state.scene.existing_count();
        let does = "deletes everything but the selection, hidden Gaussians too (Shift+Delete)";
        button(stored && rest, "crop", does, crop_to_selection());
        let deleted = state.scene.deleted().count();
        if deleted > 0
            && ui.button("restore deleted").on_hover_text(format!("brings {} back", count(deleted))).clicked()
        {
            output.change(Action::RestoreGaussians(RestoreGaussians {}));
        }
    }

    fn save(&mut self, ui: &mut Ui, state: &ViewState, output: &mut Output) {
        let mut saves = false;
        ui.horizontal(|ui| {
            let width = ui.available_width() - button_width(ui, "save") - ui.spacing().item_spacing.x;
            saves = self.text_input.edit(ui, Field::SaveName, "name of the new unit", width, MAX_NAME_BYTES)
                == FieldEvent::Entered;
            let ready = !self.text_input.text(Field::SaveName).trim().is_empty() && !state.selected.is_none();
            let pressed =
                ui.add_enabled(ready, Button::new("save")).on_hover_text("saves the selection under this name");
            let pressed = pressed.on_disabled_hover_text("brush something and type a name first").clicked();
            saves = ready && (pressed || saves);
        });
        if state.selected.is_none() {
            // The selection that the question was about is gone.
            self.select.replaces = None;
        }
        let name = self.text_input.text(Field::SaveName).trim().to_owned();
        let folded = name.to_lowercase();
        let same = state.scene.names().find(|(n, _)| n.len() == name.len() && n.to_lowercase() == folded);
        let saved_before = |id: u64| state.scene.units().any(|u| u.id == id && !u.derived);
        match same {
            Some((taken, UnitRef::Base(_))) => {
                let text = format!("{taken} is a structure of the file; choose another name.");
                ui.label(RichText::new(text).color(ui.visuals().warn_fg_color));
                return;
            }
            Some((taken, UnitRef::Editable(id))) if saved_before(id) => {
                if saves {
                    self.select.replaces = Some(taken.to_owned());
                }
                if self.select.replaces.as_deref() == Some(taken) {
                    let question = self.confirm(ui, taken, output);
                    if saves {
                        question.scroll_to_me(Some(Align::Max));
                    }
                }
                return;
            }
            _ => self.select.replaces = None,
        }
        if saves {
            output.change(Action::SaveUnit(SaveUnit { name, replace: false }));
            self.text_input.set(Field::SaveName, "");
        }
    }

    fn confirm(&mut self, ui: &mut Ui, taken: &str, output: &mut Output) -> Response {
        let card = theme::card(ui).show(ui, |ui| {
            ui.label(format!("{taken} exists. Replace its Gaussians by the selection? Its colour and opacity stay."));
            ui.horizontal(|ui| {
                if ui.button("replace it").clicked() {
                    let name = taken.to_owned();
                    output.change(Action::SaveUnit(SaveUnit { name, replace: true }));
                    self.text_input.set(Field::SaveName, "");
                    self.select.replaces = None;
                }
                if ui.button("keep it").clicked() {
                    self.select.replaces = None;
                }
            });
        });
        card.response
    }
}

fn how_many(ui: &mut Ui, state: &ViewState) {
    let (selected, all) = (state.selected.count(), state.scene.existing_count());
    if selected == 0 {
        ui.label(format!("0 of {} Gaussians selected", count(all)));
    } else {
        let share = percent(selected as f64 / all.max(1) as f64);
        ui.label(RichText::new(format!("{} of {} Gaussians ({share})", count(selected), count(all))).strong());
    }
    if state.uncommitted {
        ui.label(RichText::new("Updating…").color(ui.visuals().warn_fg_color));
    }
}
