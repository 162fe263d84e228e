//! Requests of a display to its backend.

use std::path::PathBuf;

use sg_proto::scene::{WalkTuning, command};
use sg_proto::selection::{SampleRequest, StrokesRequest};

/// What a person asks for. Each is carried out in the order in which it was asked, beside the loop that draws.
#[derive(Debug, Clone, PartialEq)]
pub enum Request {
    /// One change of the scene, journaled.
    Change(Box<command::Action>),
    /// New samples of a stroke under way.
    Sample(SampleRequest),
    /// Strokes or operations that are complete.
    Select(StrokesRequest),
    /// The last walk is tried with other numbers. One that is passed by a newer one is never looked at.
    Tune(WalkTuning),
    /// Discards the stroke or trial under way.
    Forget,
    /// At most so many places where a next stroke would tell most.
    Propose(u32),
    /// Something said to the agents.
    Say(String),
    /// Withdraws the last sentence.
    Withdraw,
    /// A scene or volume is opened in a window of its own.
    Open(PathBuf),
}

impl Request {
    /// Whether nobody need look at it once `later` has been asked for.
    pub(super) fn is_superseded_by(&self, later: &Self) -> bool {
        matches!((self, later), (Self::Tune(_), Self::Tune(_) | Self::Select(_) | Self::Forget))
    }
}
