//! The microphone in a panel: a lamp, push-to-talk, mute, and what was not understood.

use egui::{Button, RichText, Sense, Ui, vec2};
use sg_proto::speech::{Control, Phase, State, Trigger};

use super::control::scale;
use super::output::Output;
use super::state::Panels;
use crate::display::{Request, has_microphone, waits_to_talk};

/// Radius of the lamp in points, at the usual text size.
const LAMP: f32 = 5.0;

impl Panels {
    /// The lamp with its controls, and below it a question or a notice.
    pub(super) fn microphone(&mut self, ui: &mut Ui, speech: &State, output: &mut Output) {
        ui.horizontal(|ui| {
            lamp(ui, speech);
            self.talk_button(ui, speech, output);
            if has_microphone(speech) {
                let (label, control) = if speech.muted { ("unmute", Control::Unmute) } else { ("mute", Control::Mute) };
                if ui.button(label).clicked() {
                    output.requests.push(Request::Speech(control));
                }
            }
            if speech.phase() == Phase::Speaking && ui.button("stop speaking").clicked() {
                output.requests.push(Request::Speech(Control::StopSpeaking));
            }
        });
        let line = if speech.question.is_empty() { &speech.notice } else { &speech.question };
        if !line.is_empty() {
            ui.add(egui::Label::new(RichText::new(line).small().weak()).wrap());
        }
    }

    /// The button that is held to talk, where the microphone waits for one.
    pub(super) fn talk_button(&mut self, ui: &mut Ui, speech: &State, output: &mut Output) {
        if !waits_to_talk(speech) {
            return;
        }
        let button = Button::new("talk").selected(speech.held).sense(Sense::drag());
        let is_down = ui.add(button).on_hover_text("hold it while you talk").is_pointer_button_down_on();
        if is_down != self.is_talking {
            self.is_talking = is_down;
            output.requests.push(Request::Speech(if is_down { Control::Press } else { Control::Release }));
        }
    }
}

/// A coloured disc and the phase in a word. Its tooltip says who hears.
fn lamp(ui: &mut Ui, speech: &State) {
    let visuals = ui.visuals();
    let (weak, text) = (visuals.weak_text_color(), visuals.text_color());
    let (accent, warn) = (visuals.hyperlink_color, visuals.warn_fg_color);
    let (color, word) = match speech.phase() {
        _ if !has_microphone(speech) && speech.phase() != Phase::Speaking => (weak, "no microphone"),
        Phase::Listening => (visuals.error_fg_color, "listening"),
        Phase::Thinking => (warn, "thinking"),
        Phase::Speaking => (accent, "speaking"),
        Phase::Muted => (weak, "muted"),
        Phase::Idle | Phase::Unspecified if speech.trigger() == Trigger::Held => (text, "ready"),
        Phase::Idle | Phase::Unspecified => (text, "say a command"),
    };
    let radius = LAMP * scale(ui);
    let (place, disc) = ui.allocate_exact_size(vec2(3.0 * radius, ui.spacing().interact_size.y), Sense::hover());
    if ui.is_rect_visible(place) {
        ui.painter().circle_filled(place.center(), radius, color);
    }
    disc.union(ui.label(word)).on_hover_text(source(speech));
}

/// Who hears, and by what.
fn source(speech: &State) -> String {
    if !has_microphone(speech) {
        return "typed text works without a microphone".to_owned();
    }
    let place = if speech.remote { "an endpoint hears" } else { "this machine hears" };
    let voice = if speech.synthesizer.is_empty() || speech.output.is_empty() {
        "replies are not spoken".to_owned()
    } else {
        format!("replies by {} to {}", speech.synthesizer, speech.output)
    };
    format!("{place}: {}, by {}; {voice}", speech.input, speech.recognizer)
}
