//! The part of the 3D prompt about the last walk: its leak and threshold, and where a next stroke would tell most.

use egui::{Button, RichText, Ui};

use super::control::{Number, choice, count, percent};
use super::output::{Output, Place, Wish};
use super::state::Panels;
use crate::display::{LEAKS, Request, Scrubs, Shown, THRESHOLDS, Tools};

/// Places that are asked for at once.
pub(super) const PLACES: u32 = 5;

impl Panels {
    /// What the last walk is done with, and what to brush next.
    pub(super) fn walk(&mut self, ui: &mut Ui, shown: &Shown, tools: &mut Tools, asked: &mut Output) {
        let Some(mut tuning) = self.prompt.scrub.tuning(shown) else { return };
        let number = |name, range, logarithmic, text| Number { name, range, logarithmic, text };
        let leak = |x: f64| format!("{:.2} %", 100.0 * x);
        let threshold = |x: f64| format!("{:.2}", if x.abs() < 0.005 { 0.0 } else { x });
        let mut moved = number("leak", LEAKS.0..=LEAKS.1, true, leak).show(ui, &mut tuning.leak);
        moved |= number("threshold", THRESHOLDS.0..=THRESHOLDS.1, false, threshold).show(ui, &mut tuning.threshold);
        if moved {
            asked.requests.extend(self.prompt.scrub.set(tuning, shown));
        }
        ui.horizontal_wrapped(|ui| {
            ui.label(match self.place {
                Place::Window => "keys , and . change",
                Place::Headset => "the stick changes",
            });
            for scrubs in Scrubs::ALL {
                if choice(ui, tools.scrubs == scrubs, &format!("the {}", scrubs.name())) {
                    tools.scrubs = scrubs;
                }
            }
        });
        self.proposals(ui, shown, asked);
    }

    /// Where a next stroke would tell most, as rows to be looked at or lit up where the display can.
    fn proposals(&self, ui: &mut Ui, shown: &Shown, asked: &mut Output) {
        let most = shown.most_proposals().min(PLACES);
        if most == 0 {
            return;
        }
        let does = "asks where another stroke of the walk, of either kind, would decide most";
        if ui.button("where to brush next?").on_hover_text(does).clicked() {
            asked.requests.push(Request::Propose(most));
        }
        for (k, place) in (0_u8..).zip(shown.proposals()) {
            let change = count(place.expected_change.max(0.0).round() as usize);
            let text = format!("{}: about {change} Gaussians would change", k + 1);
            let unsure =
                format!("{} unsure, {} Gaussians", percent(place.uncertainty), count(place.gaussians as usize));
            let wish = Wish::Proposal(k);
            let does = match self.place {
                Place::Window => "look there",
                Place::Headset => "light up its mark, or no longer",
            };
            if !self.fulfils.contains(&wish) {
                ui.label(text);
                ui.label(RichText::new(unsure).weak());
            } else if ui.add(Button::new(text).wrap()).on_hover_text(format!("{does} ({unsure})")).clicked() {
                asked.wishes.push(wish);
            }
        }
    }
}
