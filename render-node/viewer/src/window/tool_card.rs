//! The card of a tool over the picture's upper left corner: its instruction, or its numbers.

use egui::{Area, Frame, Id, Order, Rect, Ui, Vec2};
use sg_scene::orientation::LengthUnit;

/// Points from the picture's edges.
const INSET: f32 = 12.0;

/// Greatest width in line heights of a control, and the share of the picture's width.
const WIDTH: (f32, f32) = (15.0, 0.6);

/// The number of a field that is typed into: without commas, and without a zero after the point that says nothing.
pub(super) fn plain(x: f64, decimals: usize) -> String {
    let text = format!("{x:.decimals$}");
    let digits = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    if digits == "-0" { "0".to_owned() } else { digits.to_owned() }
}

/// The name of a length with the scene's unit.
pub(super) fn in_unit(name: &str, unit: Option<LengthUnit>) -> String {
    let symbol = match unit {
        Some(LengthUnit::Metre) => ", m",
        Some(LengthUnit::Millimetre) => ", mm",
        Some(LengthUnit::Micrometre) => ", µm",
        None => "",
    };
    format!("{name}{symbol}")
}

/// Shows the card of the tool `name` with its content. One without controls lets the mouse through to the picture.
pub(super) fn show(ui: &Ui, rect: Rect, (name, has_controls): (&str, bool), content: impl FnOnce(&mut Ui)) {
    let width = (WIDTH.0 * ui.spacing().interact_size.y).min(WIDTH.1 * rect.width());
    // Above the picture alone: menus, notices and the list of shortcuts lie above it.
    let area = Area::new(Id::unique(("tool card", name))).order(Order::Middle).constrain_to(rect);
    area.interactable(has_controls).fixed_pos(rect.min + Vec2::splat(INSET)).show(ui.ctx(), |ui| {
        Frame::popup(ui.style()).show(ui, |ui| {
            ui.set_max_width(width);
            content(ui);
        });
    });
}
