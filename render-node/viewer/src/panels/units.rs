//! Base units and editable units: a row each, and more about the chosen one.

use egui::{Align, Button, Rect, RichText, Ui, vec2};
use glam::Vec3;
use sg_edit::{BaseUnitState, EditState, UnitRef};
use sg_proto::limits::MAX_NAME_BYTES;
use sg_proto::scene::command::Action;
use sg_proto::scene::{DeleteUnit, RenameUnit, Select, SetOperation};
use sg_scene::tone::Tone;

use super::control::{Number, bare_slider, button_width, cell, icon, scale, section};
use super::icon::Icon;
use super::output::{Output, PanelHost};
use super::pick_color::{Picked, color_button};
use super::state::Panels;
use super::text_input::{Field, FieldEvent};
use super::transfer::Curve;
use super::{commands, theme};
use crate::display::ViewState;
use crate::display::number_format::{count, percent};

/// Width of the number in the line of a unit, points at the usual size of text.
const NUMBER: f32 = 54.0;

/// Widths of the shortest and the longest slider beside a name, likewise.
const SLIDER: (f32, f32) = (36.0, 96.0);

/// Width of a name that leaves no room for a longer slider, likewise.
const NAME: f32 = 100.0;

/// One unit as its row shows it.
struct Row {
    unit: UnitRef,
    name: String,
    color: Option<Vec3>,
    opacity: f32,
    visible: bool,
    locked: bool,
    tone: Tone,
}

/// How the line of a unit uses its width, points.
struct LineLayout {
    /// Width of the eye and the swatch before the name.
    before_name: f32,
    /// Width of the name.
    name: f32,
    /// Whether the name is longer than that.
    is_name_cut: bool,
    /// Width of the slider; 0 for none.
    slider: f32,
    /// Whether the slider and its number are below the name, which is too long to stand beside them.
    two_lines: bool,
    /// Height of all of it.
    height: f32,
}

impl LineLayout {
    /// The layout for the width that is left in `ui`.
    fn of(ui: &Ui, state: &ViewState, row: &Row) -> Self {
        let (scale, gap, side) = (scale(ui), ui.spacing().item_spacing, ui.spacing().interact_size.y);
        let text = button_width(ui, &row.name);
        if !state.services.scene {
            let name = ui.available_width();
            let is_name_cut = text > name;
            return Self { before_name: 0.0, name, is_name_cut, slider: 0.0, two_lines: false, height: side };
        }
        let before_name = 2.0 * (side + gap.x);
        // Between the swatch and the edge stand the name, the slider, its number and the lock. In a narrow dock the slider
        // gives way to a short name; the chosen unit has another.
        let room = ui.available_width() - before_name - NUMBER * scale - side - 3.0 * gap.x;
        let slider = (room - NAME * scale).min(SLIDER.1 * scale);
        let slider = if slider < SLIDER.0 * scale { 0.0 } else { slider };
        let beside = (room - slider).max(40.0 * scale);
        if text <= beside {
            return Self { before_name, name: beside, is_name_cut: false, slider, two_lines: false, height: side };
        }
        let name = ui.available_width() - before_name - side - gap.x;
        let slider = ui.available_width() - before_name - NUMBER * scale - gap.x;
        let height = 2.0 * side + gap.y;
        Self { before_name, name, is_name_cut: text > name, slider, two_lines: true, height }
    }
}

/// Whether the name of a unit is not the file's own.
fn can_rename(state: &ViewState, unit: UnitRef) -> bool {
    match unit {
        UnitRef::Base(i) => state.scene.base_units().get(i).is_some_and(|base| base.duplicated),
        UnitRef::Editable(_) => true,
    }
}

/// The colour of a unit's swatch; `None` where its Gaussians have colours of their own.
pub(super) fn swatch_color(scene: &EditState, unit: UnitRef) -> Option<Vec3> {
    match unit {
        // The palette of a trained scene is black: its Gaussians have colours of their own. A copy has the look of its original,
        // which another unit may have coloured.
        UnitRef::Base(i) => {
            let palette = || scene.base_units().get(i).map(|base| base.palette);
            scene.covering_color(unit).or_else(palette).filter(|color| *color != Vec3::ZERO)
        }
        UnitRef::Editable(id) => scene.units().find(|known| known.id == id)?.color,
    }
}

impl Panels {
    /// The structures: those of the file, saved ones, and those that commands made. Above them is what finds one.
    pub(super) fn structures(&mut self, ui: &mut Ui, state: &ViewState, output: &mut Output) {
        self.labels(ui, state, output);
        match self.host {
            PanelHost::Window => {
                section(ui, "Structures", true, |ui| {
                    self.base_units(ui, state, output);
                    self.editable_units(ui, state, false, output);
                });
            }
            PanelHost::Headset => {
                section(ui, "Base units", true, |ui| self.base_units(ui, state, output));
                if state.scene.units().any(|u| !u.derived) {
                    section(ui, "Units", true, |ui| self.editable_units(ui, state, false, output));
                }
            }
        }
        if state.scene.units().any(|u| u.derived) {
            section(ui, "Made by commands", false, |ui| self.editable_units(ui, state, true, output));
        }
        if state.services.scene && ui.button("show everything").clicked() {
            output.change(commands::set_visibility(commands::everything(), true));
        }
    }

    fn base_units(&mut self, ui: &mut Ui, state: &ViewState, output: &mut Output) {
        // A duplicate that was deleted is nothing of the file: undo brings it back, and "restore deleted".
        let exists = |base: &BaseUnitState| !base.duplicated || base.existing() > 0;
        for (i, base) in state.scene.base_units().iter().enumerate().filter(|(_, base)| exists(base)) {
            let row = Row {
                unit: UnitRef::Base(i),
                name: base.name.clone(),
                color: swatch_color(&state.scene, UnitRef::Base(i)),
                opacity: base.opacity,
                visible: base.visible,
                locked: base.locked,
                tone: base.tone,
            };
            self.row(ui, state, &row, output);
        }
    }

    /// Editable units: those that a person saved, or those that commands made.
    fn editable_units(&mut self, ui: &mut Ui, state: &ViewState, derived: bool, output: &mut Output) {
        for unit in state.scene.units().filter(|u| u.derived == derived) {
            let row = Row {
                unit: UnitRef::Editable(unit.id),
                name: unit.name.clone(),
                color: unit.color,
                opacity: unit.opacity,
                visible: unit.visible,
                locked: unit.locked,
                tone: unit.tone,
            };
            self.row(ui, state, &row, output);
        }
    }

    fn row(&mut self, ui: &mut Ui, state: &ViewState, row: &Row, output: &mut Output) {
        let chosen = self.chosen == Some(row.unit);
        let free = !row.locked;
        // A scene may have a thousand units; a panel shows only about twenty.
        let place =
            Rect::from_min_size(ui.cursor().min, vec2(ui.available_width(), LineLayout::of(ui, state, row).height));
        if !chosen && !ui.is_rect_visible(place) {
            ui.allocate_space(place.size());
            return;
        }
        ui.push_id(&row.name, |ui| {
            if !chosen {
                self.line(ui, state, row, free, output);
                return;
            }
            theme::card(ui).show(ui, |ui| {
                self.line(ui, state, row, free, output);
                self.details(ui, state, row, free, output);
            });
        });
    }

    fn line(&mut self, ui: &mut Ui, state: &ViewState, row: &Row, free: bool, output: &mut Output) {
        let layout = LineLayout::of(ui, state, row);
        ui.horizontal(|ui| {
            if state.services.scene {
                ui.add_enabled_ui(free, |ui| {
                    let does = if row.visible { format!("hide {}", row.name) } else { format!("show {}", row.name) };
                    if icon(ui, Icon::Eye, row.visible, &does) {
                        output.change(commands::set_visibility(commands::unit(&row.name), !row.visible));
                    }
                });
                ui.add_enabled_ui(free, |ui| self.unit_color(ui, row, output));
            }
            self.name(ui, row, &layout);
            if !state.services.scene {
                return;
            }
            if !layout.two_lines {
                self.opacity(ui, (state, row), free, layout.slider);
            }
            let does = if free { format!("lock {}", row.name) } else { format!("unlock {}", row.name) };
            if icon(ui, Icon::Lock, !free, &does) {
                output.change(commands::set_lock(&row.name, free));
            }
        });
        if layout.two_lines {
            ui.horizontal(|ui| {
                ui.add_space(layout.before_name);
                self.opacity(ui, (state, row), free, layout.slider);
            });
        }
    }

    /// The name: a button that opens the controls of the unit.
    fn name(&mut self, ui: &mut Ui, row: &Row, layout: &LineLayout) {
        let chosen = self.chosen == Some(row.unit);
        let size = vec2(layout.name, ui.spacing().interact_size.y);
        let text = if row.visible { RichText::new(&row.name) } else { RichText::new(&row.name).weak() };
        let marked = chosen || self.joined.contains(&row.unit);
        let button = Button::new(text).selected(marked).truncate().min_size(size).frame_when_inactive(marked);
        let shape = egui::Layout::left_to_right(Align::Center).with_main_justify(true).with_main_align(Align::Min);
        let mut response = ui.allocate_ui_with_layout(size, shape, |ui| ui.add(button)).inner;
        if layout.is_name_cut {
            response = response.on_hover_text(&row.name);
        }
        if response.clicked() {
            if self.chosen.is_some() && ui.input(|i| i.modifiers.command) {
                self.join(row.unit);
                return;
            }
            self.choose(if chosen { None } else { Some(row.unit) });
        }
    }

    /// Opens the controls of a unit, and closes those of another one.
    pub(super) fn choose(&mut self, unit: Option<UnitRef>) {
        self.joined.clear();
        self.chosen = unit;
        self.renaming = None;
        self.text_input.forget(Field::NewName);
    }

    /// A slider of the opacity factor, unless it is too short to be dragged, and the mean factor of all edits on its Gaussians.
    fn opacity(&mut self, ui: &mut Ui, (state, row): (&ViewState, &Row), free: bool, slider: f32) {
        ui.add_enabled_ui(free, |ui| {
            let mut opacity = f64::from(row.opacity);
            let what = format!("opacity of {}", row.name);
            if slider > 0.0 && bare_slider(ui, &what, &mut opacity, 0.0..=1.0, slider).changed() {
                self.hold(commands::set_opacity(&row.name, opacity as f32));
            }
            let mean = state.scene.mean_opacity(row.unit);
            if mean.is_none() {
                let (gone, why) = if state.scene.deleted().is_none() {
                    ("empty", "it holds no Gaussian")
                } else {
                    ("gone", "all of its Gaussians are deleted; undo and “restore deleted” bring them back")
                };
                cell(ui, NUMBER * scale(ui), Align::Max, RichText::new(gone).weak()).on_hover_text(why);
                return;
            }
            // A hidden unit keeps the number that it will be shown with.
            let effective = mean.filter(|_| row.visible).map_or(opacity, f64::from);
            let is_changed_by_others = (effective - opacity).abs() > 0.005;
            let number = RichText::new(percent(effective));
            let number = if is_changed_by_others { number.strong() } else { number.weak() };
            let shown = cell(ui, NUMBER * scale(ui), Align::Max, number);
            if is_changed_by_others {
                shown.on_hover_text(format!(
                    "shown at {}: its own factor is {}, other units change the rest",
                    percent(effective),
                    percent(opacity)
                ));
            }
        });
    }

    fn unit_color(&mut self, ui: &mut Ui, row: &Row, output: &mut Output) {
        let own = match row.unit {
            UnitRef::Base(_) => "palette of the file",
            UnitRef::Editable(_) => "Original colours",
        };
        let choice = color_button(ui, &format!("colour of {}", row.name), row.color, Some(own));
        output.is_choosing_color |= choice.is_open;
        match choice.picked {
            Some(Picked::Color(rgb)) => self.hold(commands::set_color(&row.name, Some(rgb))),
            Some(Picked::Own) => output.change(commands::set_color(&row.name, None)),
            None => {}
        }
    }

    fn details(&mut self, ui: &mut Ui, state: &ViewState, row: &Row, free: bool, output: &mut Output) {
        let members = match row.unit {
            UnitRef::Base(i) => state.scene.base_units().get(i).map_or(0, BaseUnitState::existing),
            UnitRef::Editable(id) => state.scene.units().find(|u| u.id == id).map_or(0, |u| u.mask.count()),
        };
        let share = members as f64 / state.scene.existing_count().max(1) as f64;
        let what = match row.unit {
            UnitRef::Base(_) if can_rename(state, row.unit) => "duplicate",
            UnitRef::Base(_) => "base unit",
            UnitRef::Editable(_) => "unit",
        };
        ui.label(RichText::new(format!("{what}, {} Gaussians ({})", count(members), percent(share))).weak());
        if let UnitRef::Base(i) = row.unit
            && let Some(Some(file)) = self.functions.get(i)
            && let Some(curve) = Curve::shown(file, state.scene.transfer_function().map(|f| &**f), &row.name)
        {
            curve.show(ui, &row.name);
        }
        if !state.services.scene {
            return;
        }
        self.pick(ui, row, output);
        self.merge_button(ui, &state.scene, output);
        ui.add_enabled_ui(free, |ui| {
            let mut opacity = f64::from(row.opacity);
            let number = Number { name: "opacity factor", range: 0.0..=2.0, logarithmic: false, text: percent };
            if number.show(ui, &mut opacity) {
                self.hold(commands::set_opacity(&row.name, opacity as f32));
            }
            self.tone(ui, &row.name, row.tone, output);
            if can_rename(state, row.unit) {
                self.name_or_delete(ui, row, output);
            }
        });
    }

    /// Controls of the selection and the view.
    fn pick(&mut self, ui: &mut Ui, row: &Row, output: &mut Output) {
        let select = |operation: SetOperation| {
            Action::Select(Select { target: Some(commands::unit(&row.name)), operation: operation.into() })
        };
        ui.horizontal_wrapped(|ui| {
            for (text, operation, does) in [
                ("select", SetOperation::Replace, "its splats become the selection"),
                ("add to selection", SetOperation::Add, "its splats join the selection"),
                ("take from selection", SetOperation::Remove, "its splats leave the selection"),
            ] {
                // Nothing of a locked unit is selected.
                let enabled = !row.locked || operation == SetOperation::Remove;
                let button = ui
                    .add_enabled(enabled, Button::new(text))
                    .on_hover_text(does)
                    .on_disabled_hover_text("locked; press its lock first");
                if button.clicked() {
                    output.change(select(operation));
                }
            }
            if ui.button("solo").on_hover_text("shows this unit and hides all others").clicked() {
                output.change(commands::show_only(&row.name));
            }
            if ui.button("look at it").on_hover_text("frames it from the present direction").clicked() {
                output.change(commands::focus(commands::unit(&row.name)));
            }
        });
    }

    fn name_or_delete(&mut self, ui: &mut Ui, row: &Row, output: &mut Output) {
        if self.renaming == Some(row.unit) {
            ui.horizontal(|ui| {
                let width = ui.available_width() - button_width(ui, "rename") - ui.spacing().item_spacing.x;
                let came = self.text_input.edit(ui, Field::NewName, "new name", width, MAX_NAME_BYTES);
                let renamed = ui.button("rename").clicked();
                if came == FieldEvent::Going && !renamed {
                    return;
                }
                self.renaming = None;
                let new_name = self.text_input.text(Field::NewName).trim().to_owned();
                if came != FieldEvent::GivenUp && !new_name.is_empty() && new_name != row.name {
                    output.change(Action::RenameUnit(RenameUnit { name: row.name.clone(), new_name }));
                }
            });
            return;
        }
        ui.horizontal_wrapped(|ui| {
            if ui.button("rename").clicked() {
                self.renaming = Some(row.unit);
                self.text_input.set(Field::NewName, row.name.clone());
                self.text_input.turn_to(Field::NewName);
            }
            let is_saved = matches!(row.unit, UnitRef::Editable(_));
            let remove = || Button::new("Remove name (keeps splats)");
            if is_saved && ui.add(remove()).on_hover_text("undo brings the name back").clicked() {
                output.change(Action::DeleteUnit(DeleteUnit { name: row.name.clone() }));
            }
        });
    }
}
