//! The part of the Select panel about the last Region stroke: its Reach and Strictness, and proposals for a next stroke.

use egui::{Button, RichText, Ui};

use super::control::Number;
use super::output::{DisplayAction, Output, PanelHost};
use super::state::Panels;
use crate::display::number_format::{count, decimal, percent};
use crate::display::{
    Request, THRESHOLD_RANGE, Tools, ViewState, WalkParameter, answer_place, beside_answer, leak_of, other_answer,
    reach_of,
};

/// Number of proposals per request.
pub(super) const PLACES: u32 = 5;

impl Panels {
    /// Reach and Strictness of the last Region stroke, and places to brush next.
    pub(super) fn walk(&mut self, ui: &mut Ui, state: &ViewState, tools: &mut Tools, output: &mut Output) {
        let Some(mut tuning) = self.select.drag.tuning(state) else { return };
        let number = |name, range, logarithmic, text| Number { name, range, logarithmic, text };
        // To the right selects more: less leak reaches farther.
        let before = reach_of(tuning.leak);
        let mut reach = before;
        let mut moved = number("Reach", 0.0..=1.0, false, percent).show(ui, &mut reach);
        // Rounding on the way from leak to reach and back is no motion.
        if moved && (reach - before).abs() > 1e-9 {
            tuning.leak = leak_of(reach);
        }
        moved |=
            number("Strictness", THRESHOLD_RANGE.0..=THRESHOLD_RANGE.1, false, decimal).show(ui, &mut tuning.threshold);
        if moved {
            self.select.dragged_in = self.drawing;
            output.requests.extend(self.select.drag.set(tuning, state));
        }
        ui.horizontal_wrapped(|ui| {
            ui.label(match self.host {
                PanelHost::Window => "keys , and . change",
                PanelHost::Headset => "the stick changes",
            });
            for &walk_parameter in WalkParameter::of(state) {
                let is_chosen = tools.walk_parameter.in_state(state) == walk_parameter;
                let button = Button::new(walk_parameter.name()).selected(is_chosen);
                let response = ui.add(button);
                let hears = format!("tune {}", walk_parameter.name());
                ui.ctx().accesskit_node_builder(response.id, |node| node.set_label(hears.as_str()));
                if response.clicked() {
                    tools.walk_parameter = walk_parameter;
                }
            }
        });
        self.proposals(ui, state, output);
    }

    /// Buttons that take a narrower or a wider answer to the Region strokes, and the place of the present one.
    pub(super) fn answers(&self, ui: &mut Ui, state: &ViewState, tools: &Tools, output: &mut Output) {
        let Some(answers) = state.answers() else { return };
        let button = |ui: &mut Ui, wider: bool| {
            let (text, key) = if wider { ("More", ".") } else { ("Less", ",") };
            let beside = beside_answer(wider, state);
            let keys = match self.host {
                PanelHost::Window => format!(" ({key})"),
                PanelHost::Headset => String::new(),
            };
            let does = beside.map_or_else(String::new, |answer| {
                let way = if wider { "wider" } else { "narrower" };
                format!("the next {way} answer to the strokes: {} splats{keys}", count(answer.gaussians as usize))
            });
            let none = if wider { "this is the widest answer" } else { "this is the narrowest answer" };
            let response = ui.add_enabled(beside.is_some(), Button::new(text));
            response.on_hover_text(does).on_disabled_hover_text(none).clicked()
        };
        ui.horizontal(|ui| {
            let less = button(ui, false);
            ui.label(answer_place(answers))
                .on_hover_text("its place among the answers to the strokes, narrowest first");
            let more = button(ui, true);
            if less || more {
                output.requests.extend(other_answer(more, tools.include_hidden, state));
            }
        });
    }

    /// Proposals for a next stroke, as rows. A click looks at the place, or lights it up, if the display can.
    fn proposals(&self, ui: &mut Ui, state: &ViewState, output: &mut Output) {
        let most = state.most_proposals().min(PLACES);
        if most == 0 {
            return;
        }
        let does = "finds the places where another Region stroke would be most informative";
        if ui.button("where to brush next?").on_hover_text(does).clicked() {
            output.requests.push(Request::Propose(most));
        }
        for (k, place) in (0_u8..).zip(state.proposals()) {
            let change = count(place.expected_change.max(0.0).round() as usize);
            let text = format!("{}: about {change} Gaussians would change", k + 1);
            let unsure =
                format!("uncertainty {}, {} Gaussians", percent(place.uncertainty), count(place.gaussians as usize));
            let action = DisplayAction::Proposal(k);
            let does = match self.host {
                PanelHost::Window => "look there",
                PanelHost::Headset => "highlight its mark, or stop that",
            };
            if !self.supported_actions.contains(&action) {
                ui.label(text);
                ui.label(RichText::new(unsure).weak());
            } else if ui.add(Button::new(text).wrap()).on_hover_text(format!("{does} ({unsure})")).clicked() {
                output.actions.push(action);
            }
        }
    }
}
