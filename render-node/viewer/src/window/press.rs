//! Presses of the left button on the picture.

use egui::{Event, PointerButton, Pos2, Response, Ui};

/// What the left button did in this frame.
pub(super) struct Press {
    /// Places of its presses on the picture, in order: a slow frame takes both of a double click. With Alt it turns the view, so
    /// that none is here.
    pub(super) presses: Vec<Pos2>,
    /// Whether it is down.
    pub(super) is_down: bool,
    /// Where the pointer is.
    pub(super) at: Option<Pos2>,
}

impl Press {
    /// The button over the picture of `response`.
    pub(super) fn of(ui: &Ui, response: &Response, alt: bool) -> Self {
        let press = |event: &Event| match event {
            Event::PointerButton { pos, button: PointerButton::Primary, pressed: true, .. } => Some(*pos),
            _ => None,
        };
        let (mut presses, is_down, at): (Vec<Pos2>, bool, Option<Pos2>) = ui.input(|i| {
            (i.events.iter().filter_map(press).collect(), i.pointer.primary_down(), i.pointer.interact_pos())
        });
        if alt || !(response.is_pointer_button_down_on() || response.hovered()) {
            presses.clear();
        }
        presses.retain(|at| response.rect.contains(*at));
        Self { presses, is_down, at }
    }
}
