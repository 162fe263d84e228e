//! The virtual keyboard: types into the active text field of any panel.

use egui::{Align, Button, Key, RichText, TextWrapMode, Ui, Vec2, vec2};

use super::control::{cell, scale};
use super::output::Output;
use super::panel::{Panel, RoomPlace};
use super::state::Panels;
use super::text_input::TextInput;
use super::theme;
use crate::display::{Tools, ViewState};

/// Letters and signs of each row, as they are and with shift.
const ROWS: [(&str, &str); 4] = [
    ("1234567890-", "!?&/()=+*%_"),
    ("qwertyuiop'", "QWERTYUIOP\""),
    ("asdfghjkl:;", "ASDFGHJKL:;"),
    ("zxcvbnm,.", "ZXCVBNM,."),
];

impl Panel {
    /// The virtual keyboard: letters go to the last field pointed at, in any panel.
    pub const KEYBOARD: Self = Self {
        name: "keyboard",
        title: "Keyboard",
        icon: None,
        size: Vec2::new(760.0, 320.0),
        dock: None,
        place: RoomPlace::Below,
        has_content: |_| true,
        draw: Panels::keyboard,
    };
}

impl Panels {
    fn keyboard(&mut self, ui: &mut Ui, _: &ViewState, _: &mut Tools) -> Output {
        let drawn = theme::frame(ui).show(ui, |ui| {
            ui.set_min_size(ui.available_size());
            self.typed_line(ui);
            let waits = self.text_input.field().is_some();
            ui.add_enabled_ui(waits, |ui| self.keys(ui));
        });
        TextInput::keyboard_at(ui, drawn.response.rect);
        Output::default()
    }

    /// The typed text, in the typist's line of sight.
    fn typed_line(&self, ui: &mut Ui) {
        let width = ui.available_width();
        match self.text_input.field() {
            Some(field) => {
                ui.horizontal(|ui| {
                    cell(ui, 0.28 * width, Align::Min, RichText::new(field.name()).weak());
                    cell(ui, ui.available_width(), Align::Min, RichText::new(self.text_input.text(field)).strong());
                });
            }
            None => {
                cell(ui, width, Align::Min, RichText::new("Point at a text field and press, then type here.").weak());
            }
        }
    }

    fn keys(&mut self, ui: &mut Ui) {
        ui.style_mut().wrap_mode = Some(TextWrapMode::Extend);
        let gap = 6.0 * scale(ui);
        ui.spacing_mut().item_spacing = vec2(gap, gap);
        ui.spacing_mut().button_padding = vec2(2.0, 2.0);
        let unit = (ui.available_width() + gap) / 12.5;
        let height = ((ui.available_height() + gap) / 5.0 - gap).max(ui.spacing().interact_size.y);
        let key = |ui: &mut Ui, text: &str, units: f32, on: bool| {
            let size = vec2(units * unit - gap, height);
            ui.add_sized(size, Button::new(text).selected(on)).clicked()
        };
        let shift = self.shift;
        for (row, (plain, shifted)) in ROWS.into_iter().enumerate() {
            ui.horizontal(|ui| {
                if row == 3 && key(ui, "shift", 2.0, shift) {
                    self.shift = !shift;
                } else if row < 3 && row > 0 {
                    ui.add_space(0.25 * row as f32 * unit);
                }
                for letter in if shift { shifted } else { plain }.chars() {
                    let text = letter.to_string();
                    if key(ui, &text, 1.0, false) {
                        self.text_input.letters(&text);
                        // One capital at a time, as on a telephone.
                        self.shift = false;
                    }
                }
                let rest = |ui: &Ui| (ui.available_width() + gap) / unit;
                match row {
                    0 if key(ui, "back", rest(ui), false) => self.text_input.key(Key::Backspace),
                    2 if key(ui, "enter", rest(ui), false) => self.text_input.key(Key::Enter),
                    _ => {}
                }
            });
        }
        ui.horizontal(|ui| {
            ui.add_space(2.0 * unit);
            if key(ui, "space", 5.5, false) {
                self.text_input.letters(" ");
            }
            for (text, arrow) in [("left", Key::ArrowLeft), ("right", Key::ArrowRight)] {
                if key(ui, text, 1.25, false) {
                    self.text_input.key(arrow);
                }
            }
            if key(ui, "done", (ui.available_width() + gap) / unit, false) {
                self.text_input.leave();
            }
        });
    }
}
