//! Messages of the labeling service.

use sg_edit::wire::{encode_color, encode_vector};
use sg_labeling::attributes::Attributes;
use sg_labeling::query::{Outcome, Ranked};
use sg_proto::labeling;

use crate::measured_units::Units;

/// Most candidates in a reply.
const MAX_CANDIDATES: usize = 64;

/// The reply to a text or a picture.
pub(crate) fn encode(outcome: Outcome, units: &Units) -> labeling::FindReply {
    let candidates = |ranked: Vec<Ranked>| {
        let encoded = ranked.into_iter().filter_map(|r| {
            let unit = units.names.get(r.item)?.clone();
            Some(labeling::Candidate { unit, score: r.score, explanation: r.explanation(), inferred: r.is_inferred() })
        });
        encoded.take(MAX_CANDIDATES).collect::<Vec<_>>()
    };
    let (outcome, units_found, reason) = match outcome {
        Outcome::Match { items } => (labeling::Outcome::Match, candidates(items), String::new()),
        Outcome::Ambiguous { candidates: found } => (labeling::Outcome::Ambiguous, candidates(found), String::new()),
        Outcome::NothingMatches { best, why } => {
            (labeling::Outcome::NoMatch, candidates(best.into_iter().collect()), why.to_string())
        }
    };
    labeling::FindReply {
        outcome: outcome.into(),
        units: units_found,
        reason,
        revision: units.revision,
        regions: Vec::new(),
    }
}

/// The measured look of a unit, or of the selection where the name is empty.
pub(crate) fn encode_look(name: &str, attributes: &Attributes) -> labeling::Look {
    labeling::Look {
        unit: name.to_owned(),
        gaussians: attributes.count as u64,
        color: Some(encode_color(attributes.color.into())),
        opacity: attributes.opacity,
        center: Some(encode_vector(attributes.center)),
        deviations: attributes.deviations.to_vec(),
    }
}
