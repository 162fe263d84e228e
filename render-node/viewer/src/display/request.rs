//! Requests of a display to its backend.

use std::path::PathBuf;

use sg_proto::language::TourStep;
use sg_proto::launch::SaveRequest;
use sg_proto::scene::{WalkTuning, command};
use sg_proto::selection::{SampleRequest, StrokesRequest};

/// A person's request. Requests are carried out in order, beside the loop that draws.
#[derive(Debug, Clone, PartialEq)]
pub enum Request {
    /// One change of the scene, journaled.
    Change(Box<command::Action>),
    /// New samples of a stroke under way.
    Sample(SampleRequest),
    /// Strokes or operations that are complete.
    Select(StrokesRequest),
    /// The last walk is tried with other numbers. A newer trial supersedes a waiting one.
    Tune(WalkTuning),
    /// Discards the stroke or trial under way.
    Forget,
    /// Asks for at most this many proposals for a next stroke.
    Propose(u32),
    /// Asks which units a text means. The answer has this number. A newer question supersedes an older one.
    Find {
        /// Number of the question, greater than those before.
        number: u64,
        /// The text.
        text: String,
    },
    /// Asks for the best views of a unit, likewise.
    Views {
        /// Number of the question, greater than those before.
        number: u64,
        /// Name of the unit; empty for the selection.
        unit: String,
    },
    /// Something said to the agents.
    Say(String),
    /// Begins a tour, or changes the one that is under way. The agents get a sentence ([`super::tour_sentence`]).
    Tour(TourStep),
    /// Withdraws the last sentence.
    Withdraw,
    /// Changes the microphone, or stops the reply that sounds.
    Speech(sg_proto::speech::Control),
    /// Opens a scene or volume in a window of its own. A raw volume may get the millimetres between its voxels along x, y, z.
    Open(PathBuf, Option<[f64; 3]>),
    /// Writes a file under a name that the person has chosen. The picture of such a request is removed afterwards.
    Save(Box<SaveRequest>),
}

impl Request {
    /// Whether the later request makes this one obsolete.
    pub(super) fn is_superseded_by(&self, later: &Self) -> bool {
        matches!(
            (self, later),
            (Self::Tune(_), Self::Tune(_) | Self::Select(_) | Self::Forget)
                | (Self::Find { .. }, Self::Find { .. })
                | (Self::Views { .. }, Self::Views { .. })
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_newer_question_supersedes_an_older_one_of_its_kind() {
        let find = |number| Request::Find { number, text: "the largest vessel".to_owned() };
        let views = |number| Request::Views { number, unit: "vessel".to_owned() };
        assert!(find(1).is_superseded_by(&find(2)) && views(1).is_superseded_by(&views(2)));
        assert!(!find(1).is_superseded_by(&views(2)) && !views(1).is_superseded_by(&Request::Forget));
    }
}
