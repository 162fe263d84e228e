//! The changes of a tour in words. The agents take a tour from an utterance alone, so a button says what a person would say.

use sg_proto::language::TourStep;

/// The sentence that asks the agents for a change of the tour.
#[must_use]
pub fn tour_sentence(step: TourStep) -> &'static str {
    match step {
        TourStep::Unspecified | TourStep::Start => "give me a tour",
        TourStep::Pause => "pause the tour",
        TourStep::Resume => "go on",
        TourStep::Next => "next stop",
        TourStep::Previous => "previous stop",
        TourStep::End => "stop the tour",
    }
}
