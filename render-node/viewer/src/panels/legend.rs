//! The current functions of the buttons, and notices for a person.

use egui::{Align, Grid, Label, Mesh, RichText, Sense, Stroke, Ui, vec2};

use super::control::{cell, scale};
use super::state::Panels;
use super::theme;
use super::transfer::to_color32;
use crate::display::ViewState;
use crate::display::number_format::number;
use sg_raster::attributes::Legend;

/// Seconds that a line stays, and an error line.
const STAYS: [f64; 2] = [6.0, 12.0];

/// Seconds of its final fade.
const FADES: f64 = 1.0;

/// Most points that a line is wide at the usual size of text, and that it leaves to both sides.
const WIDTH: (f32, f32) = (560.0, 32.0);

/// The tool legend: the current function of each button or key, one pair a line.
pub fn legend(ui: &mut Ui, does: &[(&str, &str)]) {
    theme::card(ui).show(ui, |ui| {
        Grid::new("tool legend").num_columns(2).striped(false).show(ui, |ui| {
            for (button, does) in does {
                ui.label(RichText::new(*button).color(ui.visuals().hyperlink_color));
                ui.label(*does);
                ui.end_row();
            }
        });
    });
}

impl Panels {
    /// Notices, newest last, each for some seconds. They cannot be pressed and block no input. The clock is that of the
    /// context: call it of one context only.
    pub fn notices(&mut self, ui: &mut Ui, state: &ViewState) {
        // Its area keeps the width of its last content, even of none.
        ui.set_max_width((WIDTH.0 * scale(ui)).min(ui.ctx().content_rect().width() - WIDTH.1));
        let now = ui.input(|i| i.time);
        let seen = &mut self.shown_notices.0;
        let oldest = state.notices.first().map_or(u64::MAX, |n| n.number);
        seen.retain(|number, _| *number >= oldest);
        for notice in state.notices.iter() {
            let since = now - *seen.entry(notice.number).or_insert(now);
            let left = STAYS[usize::from(notice.refused)] - since;
            if left <= 0.0 {
                continue;
            }
            ui.ctx().request_repaint_after_secs((left - FADES).max(0.05) as f32);
            let strength = (left / FADES).clamp(0.0, 1.0) as f32;
            ui.scope(|ui| {
                ui.multiply_opacity(strength);
                let edge = if notice.refused { ui.visuals().error_fg_color } else { ui.visuals().hyperlink_color };
                theme::card(ui).stroke(Stroke::new(1.5, edge)).show(ui, |ui| {
                    ui.horizontal(|ui| {
                        if notice.refused {
                            ui.label(RichText::new("Not done").color(edge).strong());
                        }
                        ui.add(Label::new(&notice.text).wrap());
                    });
                });
            });
        }
    }
}

/// Draws a colour map with the values at its ends.
pub(super) fn color_numbers(ui: &mut Ui, legend: &Legend) {
    let (rect, _) = ui.allocate_exact_size(vec2(ui.available_width(), 16.0 * scale(ui)), Sense::hover());
    let mut mesh = Mesh::default();
    const STEPS: u32 = 32;
    for k in 0..=STEPS {
        let t = f64::from(k) / f64::from(STEPS);
        let x = rect.left() + t as f32 * rect.width();
        let color = to_color32(legend.map.at(t));
        mesh.colored_vertex(egui::pos2(x, rect.top()), color);
        mesh.colored_vertex(egui::pos2(x, rect.bottom()), color);
        if k > 0 {
            mesh.add_triangle(2 * k - 2, 2 * k - 1, 2 * k);
            mesh.add_triangle(2 * k - 1, 2 * k, 2 * k + 1);
        }
    }
    ui.painter().add(mesh);
    ui.horizontal(|ui| {
        let half = 0.5 * (ui.available_width() - ui.spacing().item_spacing.x);
        cell(ui, half, Align::Min, RichText::new(number(legend.low)).weak());
        let scale = if legend.logarithmic { " (logarithmic)" } else { "" };
        cell(ui, half, Align::Max, RichText::new(format!("{}{scale}", number(legend.high))).weak());
    });
}
