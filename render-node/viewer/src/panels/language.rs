//! The panel "language": a person's utterances, the agents' actions, and their answers.

use egui::style::ScrollAnimation;
use egui::{Align, Button, Id, Label, Rect, RichText, ScrollArea, Ui, Vec2, vec2};
use sg_edit::{EditState, UnitRef};
use sg_proto::limits::MAX_UTTERANCE_BYTES;

use super::control::{button_width, scale};
use super::icon::Icon;
use super::last_turn::LastTurn;
use super::output::Output;
use super::panel::{Dock, Panel, RoomPlace};
use super::state::Panels;
use super::text_input::{Field, FieldEvent};
use super::theme;
use crate::display::{Entry, Request, Tools, Turn, ViewState};

/// Longest name in a sentence that is offered, bytes.
const OFFERED_NAME: usize = 24;

impl Panel {
    /// Language: the conversation with the agents.
    pub const LANGUAGE: Self = Self {
        name: "language",
        title: "Language",
        icon: Some(Icon::Speech),
        size: Vec2::new(560.0, 640.0),
        dock: Some(Dock::Right),
        place: RoomPlace::Around { degrees: 92.0 },
        has_content: |state| state.services.agents,
        draw: Panels::language,
    };
}

impl Panels {
    /// The conversation, with a field to continue it. Empty without agents.
    fn language(&mut self, ui: &mut Ui, state: &ViewState, _: &mut Tools) -> Output {
        let mut output = Output::default();
        if !state.services.agents {
            self.text_input.forget(Field::Say);
            return output;
        }
        theme::frame(ui).show(ui, |ui| {
            ui.set_min_size(ui.available_size());
            Panel::LANGUAGE.heading(ui);
            // The field stays at the bottom, independent of the conversation's length.
            let speech = state.speech.as_deref();
            let row = ui.spacing().interact_size.y + 3.0 * ui.spacing().item_spacing.y;
            let below = match speech {
                Some(speech) if speech.notice.is_empty() && speech.question.is_empty() => 2.0 * row,
                // With a line or two of a notice.
                Some(_) => 3.0 * row,
                None => row,
            };
            let height = (ui.available_height() - below).max(60.0 * scale(ui));
            ScrollArea::vertical()
                .id_salt("conversation")
                .max_height(height)
                .min_scrolled_height(height)
                .auto_shrink(false)
                .show(ui, |ui| self.conversation(ui, state));
            if let Some(speech) = speech {
                self.microphone(ui, speech, &mut output);
            }
            self.say(ui, state, &mut output);
        });
        output
    }

    /// The turns. A new sentence, and each line of its answer, bring the sentence to the top, or as far up as there is room.
    /// So a long answer does not push it out of sight.
    fn conversation(&mut self, ui: &mut Ui, state: &ViewState) {
        if state.conversation.turns.is_empty() {
            self.offers(ui, state);
        }
        let newest = state.conversation.turns.last().map(LastTurn::of);
        let is_new = newest != self.last_turn;
        self.last_turn = newest;
        let last = state.conversation.turns.len().saturating_sub(1);
        for (k, turn) in state.conversation.turns.iter().enumerate() {
            let place = show_turn_in_sight(ui, turn);
            if k == last && is_new {
                ui.scroll_to_rect_animation(place, Some(Align::Min), ScrollAnimation::none());
            }
        }
    }

    /// What can be said at first, for this scene: pressing a line puts it into the field.
    fn offers(&mut self, ui: &mut Ui, state: &ViewState) {
        ui.label(RichText::new("Ask for a change, or ask a question. For example:").weak());
        for sentence in offered(&state.scene) {
            let button = Button::new(sentence.as_str()).wrap().frame_when_inactive(false);
            if ui.add(button).on_hover_text("puts it into the field; Enter says it").clicked() {
                self.text_input.set(Field::Say, sentence);
                self.text_input.turn_to(Field::Say);
            }
        }
    }

    fn say(&mut self, ui: &mut Ui, state: &ViewState, output: &mut Output) {
        ui.horizontal(|ui| {
            let waiting = state.conversation.is_waiting();
            let mut width = ui.available_width() - button_width(ui, "send") - ui.spacing().item_spacing.x;
            if waiting {
                width -= button_width(ui, "stop") + ui.spacing().item_spacing.x;
            }
            let came = self.text_input.edit(ui, Field::Say, "say something to the agents", width, MAX_UTTERANCE_BYTES);
            let text = self.text_input.text(Field::Say).trim().to_owned();
            let sends = ui.add_enabled(!text.is_empty(), Button::new("send")).clicked() || came == FieldEvent::Entered;
            if sends && !text.is_empty() {
                output.requests.push(Request::Say(text));
                self.text_input.set(Field::Say, "");
            }
            if came == FieldEvent::Entered {
                // The focus stays in the field, so that a person can go on.
                self.text_input.turn_to(Field::Say);
            }
            if waiting && ui.button("stop").clicked() {
                output.requests.push(Request::Withdraw);
            }
        });
    }
}

/// Sentences that this scene answers: about its first structure that can be changed, and two without a name.
fn offered(scene: &EditState) -> Vec<String> {
    let is_free = |name: &str, unit: UnitRef| {
        !scene.is_locked(unit) && !name.contains(['"', '“', '”']) && name.len() <= OFFERED_NAME
    };
    let named = scene.names().find(|(name, unit)| is_free(name, *unit)).map(|(name, _)| name);
    let about = named.map(|name| {
        let letters = |word: &str| !word.is_empty() && word.chars().all(char::is_alphabetic);
        // Other names are read as one only in quotation marks.
        let is_plain = name.split(' ').all(letters);
        if is_plain { format!("make the {name} blue") } else { format!("make \"{name}\" blue") }
    });
    about.into_iter().chain(["what is there?".to_owned(), "turn it to the left".to_owned()]).collect()
}

/// Inputs to a turn's height, and the resulting height.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Height {
    width: f32,
    line: f32,
    entries: usize,
    answered: bool,
    points: f32,
}

/// A long conversation costs only its visible part: the rest has known heights only. Returns the turn's place.
fn show_turn_in_sight(ui: &mut Ui, turn: &Turn) -> Rect {
    let known = Id::unique(("height of a turn", &turn.id));
    let now = Height {
        width: ui.available_width(),
        line: ui.spacing().interact_size.y,
        entries: turn.entries.len(),
        answered: turn.answer.is_some(),
        points: 0.0,
    };
    let had = ui.data(|d| d.get_temp::<Height>(known)).filter(|had| now == Height { points: 0.0, ..*had });
    if let Some(Height { width, points, .. }) = had {
        let place = Rect::from_min_size(ui.cursor().min, vec2(width, points));
        if !ui.is_rect_visible(place) {
            return ui.allocate_space(place.size()).1;
        }
    }
    let place = show_turn(ui, turn);
    ui.data_mut(|d| d.insert_temp(known, Height { points: place.height(), ..now }));
    place
}

/// Draws a turn; its place.
fn show_turn(ui: &mut Ui, turn: &Turn) -> Rect {
    let (accent, error) = (ui.visuals().hyperlink_color, ui.visuals().error_fg_color);
    let drawn = theme::card(ui).show(ui, |ui| {
        ui.set_min_width(ui.available_width());
        ui.label(RichText::new("You").small().weak());
        ui.add(Label::new(RichText::new(&turn.said).strong()).wrap());
        let mut heading = "";
        for entry in &turn.entries {
            let (over, text, done) = match entry {
                Entry::Command(text) => ("Agent Commands", text, true),
                Entry::Result(text, done) => ("Query Result", text, *done),
            };
            if over != heading {
                ui.label(RichText::new(over).small().color(accent));
                heading = over;
            }
            let color = if done { ui.visuals().text_color() } else { error };
            ui.indent(over, |ui| ui.add(Label::new(RichText::new(text).color(color)).wrap()));
        }
        match &turn.answer {
            Some((answer, done)) => {
                let (over, color) = if *done { ("Answer", accent) } else { ("Couldn't do this:", error) };
                ui.label(RichText::new(over).small().color(color));
                ui.add(Label::new(RichText::new(answer)).wrap());
            }
            None => {
                ui.label(RichText::new("waiting for an answer …").weak());
            }
        }
    });
    drawn.response.rect
}
