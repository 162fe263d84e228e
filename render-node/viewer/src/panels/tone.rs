//! Saturation, brightness and temperature of a unit.

use egui::Ui;
use sg_proto::scene::SetTone;
use sg_scene::tone::Tone;

use super::commands;
use super::control::{Number, section};
use super::output::Output;
use super::state::Panels;
use crate::display::number_format::{decimal, percent};

impl Panels {
    /// The sliders of a unit's tone, folded where it is that of the file.
    pub(super) fn tone(&mut self, ui: &mut Ui, name: &str, tone: Tone, output: &mut Output) {
        section(ui, "Colours", !tone.is_neutral(), |ui| {
            let factor = |name| Number { name, range: 0.0..=2.0, logarithmic: false, text: percent };
            let (mut saturation, mut brightness) = (f64::from(tone.saturation), f64::from(tone.brightness));
            let mut temperature = f64::from(tone.temperature);
            let mut moved = SetTone::default();
            if factor("saturation").show(ui, &mut saturation) {
                moved.saturation = Some(saturation as f32);
            }
            if factor("brightness").show(ui, &mut brightness) {
                moved.brightness = Some(brightness as f32);
            }
            let number = Number { name: "temperature", range: -1.0..=1.0, logarithmic: false, text: decimal };
            if number.show(ui, &mut temperature) {
                moved.temperature = Some(temperature as f32);
            }
            if moved != SetTone::default() {
                self.hold(commands::set_tone(name, &moved));
            }
            let neutral = ui.add_enabled(!tone.is_neutral(), egui::Button::new("as in the file"));
            if neutral.on_hover_text("saturation and brightness 100 %, temperature 0").clicked() {
                let Tone { saturation, brightness, temperature } = Tone::NEUTRAL;
                let (saturation, brightness, temperature) = (Some(saturation), Some(brightness), Some(temperature));
                let terms = SetTone { saturation, brightness, temperature, ..SetTone::default() };
                output.change(commands::set_tone(name, &terms));
            }
        });
    }
}
