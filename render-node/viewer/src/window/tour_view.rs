//! The tour under way in a window: a bar above the picture, and a legend of the stops over it.

use egui::{Align2, Area, Frame, Id, Order, Rect, Ui, Vec2};

use super::orientation_cube;
use crate::display::{Request, ViewState};
use crate::panels::{Output, tour_bar, tour_legend};

/// Points from the picture's edges at the usual size of text, and of the legend's frame.
const INSET: f32 = 12.0;

/// Greatest width of the legend, likewise, and its share of the picture's width.
const WIDTH: (f32, f32) = (220.0, 0.4);

/// Least height of a legend, likewise.
const LEAST: f32 = 60.0;

/// Shows the bar between the docks, above the picture: it stays where panels are hidden.
pub(super) fn show_bar(ui: &mut Ui, state: &ViewState, requests: &mut Vec<Request>) {
    if state.tour.is_none() {
        return;
    }
    let mut output = Output::default();
    egui::Panel::top("tour").show(ui, |ui| tour_bar(ui, state, &mut output));
    requests.extend(output.requests);
}

/// Shows the legend of the stops below the orientation cube, while a tour is under way. It lets the mouse through.
pub(super) fn show_legend(ui: &Ui, picture: Rect, scale: f32, state: &ViewState) {
    if state.tour.is_none() {
        return;
    }
    let corner = picture.right_top() + Vec2::new(-INSET, 2.0 * orientation_cube::INSET) * scale;
    let height = picture.bottom() - corner.y - 3.0 * INSET * scale;
    if height < LEAST * scale {
        return;
    }
    let width = (WIDTH.0 * scale).min(WIDTH.1 * picture.width());
    let area = Area::new(Id::unique("legend of the tour")).order(Order::Middle).constrain_to(picture);
    area.interactable(false).pivot(Align2::RIGHT_TOP).fixed_pos(corner).show(ui.ctx(), |ui| {
        Frame::popup(ui.style()).show(ui, |ui| {
            ui.set_max_width(width);
            tour_legend(ui, state, height);
        });
    });
}
