//! The history: steps done, undone and redone.

use egui::{Align, Button, Label, Layout, RichText, Ui};
use sg_proto::scene::command::Action;
use sg_proto::scene::{Redo, Reset, Undo};

use super::control::capital;
use super::output::Output;
use super::state::Panels;
use crate::display::ViewState;
use crate::display::number_format::count;

/// Most lines of the history shown.
const LINES: usize = 12;

impl Panels {
    /// Undo and redo by one step, with a description of the step.
    pub(super) fn steps_back(&self, ui: &mut Ui, state: &ViewState, output: &mut Output) {
        ui.horizontal(|ui| {
            let step = |ui: &mut Ui, text: &str, enabled: bool, first: Option<&String>| {
                let response = ui.add_enabled(enabled, Button::new(text));
                match first {
                    Some(first) => response.on_hover_text(capital(first)).clicked(),
                    None => response.clicked(),
                }
            };
            // The scene knows its steps, also before their names are known here.
            if step(ui, "undo", !state.undo.is_empty() || !state.knows_steps(), state.undo_step()) {
                output.change(Action::Undo(Undo { steps: 1 }));
            }
            if step(ui, "redo", !state.redo.is_empty(), state.redo_step()) {
                output.change(Action::Redo(Redo { steps: 1 }));
            }
            if let Some(last) = state.undo_step() {
                ui.add(Label::new(RichText::new(capital(last)).weak()).truncate());
            }
        });
    }

    /// Both lists, newest first: a line takes back or brings back all down to itself.
    pub(super) fn history(&self, ui: &mut Ui, state: &ViewState, output: &mut Output) {
        // A line goes as far as itself: in a list of an earlier revision that would be another step.
        let (undo, redo): (&[String], &[String]) =
            if state.knows_steps() { (&state.undo, &state.redo) } else { (&[], &[]) };
        if !state.knows_steps() {
            ui.label(RichText::new("The steps are being read …").weak());
        } else if undo.is_empty() && redo.is_empty() {
            ui.label(RichText::new("Nothing has been changed yet.").weak());
        }
        let list = |ui: &mut Ui, title: &str, verb: &str, lines: &[String]| {
            if lines.is_empty() {
                return None;
            }
            ui.label(RichText::new(title).weak());
            let mut steps = None;
            for (i, line) in lines.iter().take(LINES).enumerate() {
                ui.push_id((verb, i), |ui| {
                    let shape = Layout::top_down_justified(Align::Min);
                    let button = Button::new(capital(line)).truncate().frame_when_inactive(false);
                    let response = ui.with_layout(shape, |ui| ui.add(button)).inner;
                    if response.on_hover_text(format!("{verb} {}", counted(i + 1))).clicked() {
                        steps = u32::try_from(i + 1).ok();
                    }
                });
            }
            if lines.len() > LINES {
                ui.label(RichText::new(format!("and {} earlier", count(lines.len() - LINES))).weak());
            }
            steps
        };
        if let Some(steps) = list(ui, "Undone, next first", "redo", redo) {
            output.change(Action::Redo(Redo { steps }));
        }
        if let Some(steps) = list(ui, "Done, newest first", "undo", undo) {
            output.change(Action::Undo(Undo { steps }));
        }
        let reset = ui.button("reset all looks");
        if reset.on_hover_text("restores the initial colours, opacities, light and viewpoint; units stay").clicked() {
            output.change(Action::Reset(Reset {}));
        }
    }
}

fn counted(n: usize) -> String {
    if n == 1 { "this".to_owned() } else { format!("these {n}") }
}
