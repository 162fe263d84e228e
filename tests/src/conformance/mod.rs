//! Conformance: checks over the bus of a program that is to fill a role.
//!
//! The program is started as a supervisor would start it: in a session of its own, with a small scene. Other roles that it needs
//! run from the executables of this build. The checks know nothing of it but the contract. `everyone` and `refusals` hold the
//! checks of every role. One file for each role holds its own checks.

mod agent_core;
mod agent_function;
mod agent_intent;
mod content;
mod everyone;
mod labeling;
mod process;
mod question;
mod refusals;
mod render_capture;
mod render_view;
mod scene;
mod selection;
mod speech;
mod stage;

use std::path::PathBuf;
use std::time::Duration;

use question::Question;
use stage::Stage;

/// An executable that is to fill a role.
#[derive(Debug, Clone)]
pub struct Candidate {
    /// The role.
    pub role: String,
    /// The executable; it is called with `serve` and the arguments of the service mode.
    pub executable: PathBuf,
    /// Its parameters, as in a launch file; those of the made scene are added for the role `scene`.
    pub params: serde_json::Map<String, serde_json::Value>,
    /// How long it may take until it is ready.
    pub ready: Duration,
}

/// One thing that was tried.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Check {
    /// What.
    pub what: &'static str,
    /// Why it failed.
    pub outcome: Result<(), String>,
}

/// The description of a role under test.
struct Subject {
    role: &'static str,
    /// Other roles that have to be there.
    needs: &'static [&'static str],
    /// A question that may be put any number of times, under an id.
    question: fn(&str) -> Question,
    /// The part that all answers to one question under one id must share.
    essence: fn(&[u8]) -> Result<String, String>,
}

const SUBJECTS: [Subject; 9] = [
    scene::SUBJECT,
    selection::SUBJECT,
    labeling::SUBJECT,
    speech::SUBJECT,
    render_view::SUBJECT,
    render_capture::SUBJECT,
    agent_core::SUBJECT,
    agent_intent::SUBJECT,
    agent_function::SUBJECT,
];

/// Roles that can be tried.
#[must_use]
pub fn roles() -> Vec<&'static str> {
    SUBJECTS.iter().map(|s| s.role).collect()
}

/// Checks tried so far.
struct Checks<'a> {
    tell: &'a mut dyn FnMut(&Check),
    failed: bool,
}

impl Checks<'_> {
    fn note(&mut self, what: &'static str, outcome: Result<(), String>) {
        self.failed |= outcome.is_err();
        (self.tell)(&Check { what, outcome });
    }
}

/// Tries a candidate and reports every check as it is done. Returns whether all of them held.
///
/// # Errors
/// A line with the reason for not trying it at all: no such role, or a needed role cannot be started.
pub async fn conform(candidate: &Candidate, tell: &mut dyn FnMut(&Check)) -> Result<bool, String> {
    let subject = SUBJECTS
        .iter()
        .find(|s| s.role == candidate.role)
        .ok_or_else(|| format!("no role `{}` that can be tried; there are: {}", candidate.role, roles().join(", ")))?;
    let mut stage = Stage::open(candidate, subject).await?;
    let mut checks = Checks { tell, failed: false };
    everyone::before_service(&mut stage, &mut checks).await;
    // Without a process that serves, nothing else can be tried.
    if everyone::begin(&mut stage, &mut checks).await {
        everyone::answers(&mut stage, &mut checks).await;
        refusals::checks(&mut stage, &mut checks).await;
        match subject.role {
            scene::ROLE => scene::checks(&mut stage, &mut checks).await,
            selection::ROLE => selection::checks(&mut stage, &mut checks).await,
            labeling::ROLE => labeling::checks(&mut stage, &mut checks).await,
            speech::ROLE => speech::checks(&mut stage, &mut checks).await,
            render_view::ROLE => render_view::checks(&mut stage, &mut checks).await,
            render_capture::ROLE => render_capture::checks(&mut stage, &mut checks).await,
            agent_core::ROLE => agent_core::checks(&mut stage, &mut checks).await,
            agent_intent::ROLE => agent_intent::checks(&mut stage, &mut checks).await,
            _ => agent_function::checks(&mut stage, &mut checks).await,
        }
        everyone::restart(&mut stage, &mut checks).await;
        everyone::hand_over(&mut stage, &mut checks).await;
        everyone::ends(&mut stage, &mut checks).await;
    }
    Ok(!checks.failed)
}
