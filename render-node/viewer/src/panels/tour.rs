//! The tour under way: its present stop with buttons that change it, and a legend of its stops.

use std::ops::Range;

use egui::{
    Button, Color32, CornerRadius, Frame, Label, Margin, RichText, Sense, Stroke, StrokeKind, TextStyle, Ui, Vec2,
};
use glam::Vec3;
use sg_proto::language::{Tour, TourStep};

use super::control::scale;
use super::output::Output;
use super::theme;
use super::transfer::to_color32;
use super::units::swatch_color;
use crate::display::{Request, ViewState};

/// Height of the legend in a panel, points at the usual size of text.
const LEGEND: f32 = 190.0;

/// Points to the sides of a stop in the legend, and above and below it, likewise.
const AROUND: Vec2 = Vec2::new(6.0, 2.0);

/// Side of a swatch, as a share of the height of the text.
const SWATCH: f32 = 0.7;

/// The bar and the legend of the tour under way, as a part of a panel. Nothing is drawn without a tour.
pub(super) fn tour_card(ui: &mut Ui, state: &ViewState, output: &mut Output) {
    if state.tour.is_none() {
        return;
    }
    theme::card(ui).show(ui, |ui| {
        ui.set_min_width(ui.available_width());
        tour_bar(ui, state, output);
        tour_legend(ui, state, LEGEND * scale(ui));
    });
}

/// The place of the tour under way, and the buttons that change it. Nothing is drawn without a tour.
pub(crate) fn tour_bar(ui: &mut Ui, state: &ViewState, output: &mut Output) {
    let Some(tour) = &state.tour else { return };
    ui.horizontal_wrapped(|ui| {
        ui.add(Label::new(RichText::new(place(tour)).strong()).truncate());
        tour_buttons(ui, state, output);
    });
}

/// The buttons alone. Without the agents nothing can be asked for.
pub(super) fn tour_buttons(ui: &mut Ui, state: &ViewState, output: &mut Output) {
    let Some(tour) = state.tour.as_deref().filter(|_| state.services.agents) else { return };
    let wait_or_go_on = if tour.paused {
        (TourStep::Resume, "go on", "go on with the tour")
    } else {
        (TourStep::Pause, "pause", "let the tour wait here")
    };
    for (step, text, does) in [
        (TourStep::Previous, "previous", "go to the previous stop"),
        wait_or_go_on,
        (TourStep::Next, "next", "go to the next stop"),
        (TourStep::End, "stop", "end the tour"),
    ] {
        let button = ui.add(Button::new(text));
        // The field for the agents has a button "stop" too.
        ui.ctx().accesskit_node_builder(button.id, |node| node.set_label(does));
        if button.on_hover_text(does).clicked() {
            output.requests.push(Request::Tour(step));
        }
    }
}

/// The stops of the tour under way within this height in points: each with its number and the colour of its unit, the present
/// one highlighted. Where there is no room for all, those around the present one are shown. Nothing is drawn without a tour.
pub(crate) fn tour_legend(ui: &mut Ui, state: &ViewState, height: f32) {
    let Some(tour) = &state.tour else { return };
    let (at, around) = (tour.at as usize, AROUND * scale(ui));
    let text = ui.text_style_height(&TextStyle::Body);
    let room = (height / (text + 2.0 * around.y)).max(0.0) as usize;
    let rows = shown_rows(tour.stops.len(), at, room);
    ui.scope(|ui| {
        // As close as lines of text, not as controls.
        ui.spacing_mut().item_spacing.y = 0.0;
        ui.spacing_mut().interact_size.y = 0.0;
        for (k, name) in tour.stops.iter().enumerate().skip(rows.start).take(rows.len()) {
            let unit = state.scene.names().find(|(known, _)| known == name).map(|(_, unit)| unit);
            let color = unit.and_then(|unit| swatch_color(&state.scene, unit));
            stop_row(ui, (k + 1, name), color, k == at, (text, around));
        }
    });
}

/// The line of a stop.
fn stop_row(
    ui: &mut Ui,
    (number, name): (usize, &str),
    color: Option<Vec3>,
    is_present: bool,
    (height, around): (f32, Vec2),
) {
    let visuals = ui.visuals();
    let (fill, text) = if is_present {
        (visuals.selection.bg_fill, visuals.selection.stroke.color)
    } else {
        (Color32::TRANSPARENT, visuals.text_color())
    };
    let frame = Frame::new().fill(fill).corner_radius(CornerRadius::same(4));
    frame.inner_margin(Margin::symmetric(around.x as i8, around.y as i8)).show(ui, |ui| {
        ui.horizontal(|ui| {
            let (square, _) = ui.allocate_exact_size(Vec2::splat(SWATCH * height), Sense::hover());
            // Its Gaussians' own colours: an empty square.
            let inside = color.map_or(Color32::TRANSPARENT, to_color32);
            ui.painter().rect(square, 2.0, inside, Stroke::new(1.0, text), StrokeKind::Inside);
            ui.add(Label::new(RichText::new(format!("{number} {name}")).color(text)).truncate());
        });
    });
}

/// The present stop in words: "2 of 5: sac".
fn place(tour: &Tour) -> String {
    let at = tour.at as usize;
    let name = tour.stops.get(at).map_or("", String::as_str);
    format!("{} of {}: {name}", at + 1, tour.stops.len())
}

/// The rows around the present one, where there is room for `room` of them.
fn shown_rows(all: usize, at: usize, room: usize) -> Range<usize> {
    let first = at.saturating_sub(room / 2).min(all.saturating_sub(room));
    first..(first + room).min(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_legend_without_room_for_all_shows_the_stops_around_the_present_one() {
        assert_eq!(shown_rows(5, 1, 9), 0..5);
        assert_eq!(shown_rows(32, 0, 8), 0..8);
        assert_eq!(shown_rows(32, 16, 8), 12..20);
        assert_eq!(shown_rows(32, 31, 8), 24..32);
        assert!(shown_rows(32, 3, 0).is_empty() && shown_rows(0, 0, 8).is_empty());
    }
}
