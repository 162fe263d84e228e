//! Carries calls out over the bus, in the name of the command line.

use std::time::Duration;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use rmcp::model::CallToolResult;
use sg_input::file;
use sg_language::prompt::clip;
use sg_proto::keys;
use sg_proto::language::{Act, Clause, Reply, Source, Utterance};
use sg_proto::limits::MAX_UTTERANCE_BYTES;
use sg_proto::render::CaptureRequest;
use sg_proto::scene::command::Action;
use sg_proto::scene::{ChangesRequest, Command, State, Undo};
use sg_runtime::blobs::StoredFile;
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;
use sg_runtime::session::SessionDir;

use super::call::{Edit, Look, Screenshot};
use super::undo_steps::{Change, History, change, last_revision, revisions};
use super::{results, scene_json};
use crate::capture;
use crate::supervisor_client::{ANSWER, refused};
use crate::terminal::Failure;

/// Longest time for actions or a sentence. A model may take part.
const TURN: Duration = Duration::from_secs(30);

/// Longest time to draw a picture.
const PICTURE: Duration = Duration::from_secs(60);

/// Largest picture file, bytes. Clients refuse larger ones.
const MAX_PICTURE_BYTES: u64 = 3 << 20;

/// The session, for one call.
#[derive(Debug, Clone, Copy)]
pub(super) struct Client<'a> {
    pub(super) bus: &'a Bus,
    pub(super) session: &'a SessionDir,
    /// Conversation of all calls.
    pub(super) conversation: &'a str,
}

impl Client<'_> {
    /// Carries out a call that changes nothing.
    pub(super) async fn look(&self, look: &Look) -> Result<CallToolResult, Failure> {
        match look {
            Look::Scene => self.state().await.map(|state| results::scene(scene_json::scene(&state))),
            Look::Screenshot(screenshot) => self.picture(screenshot).await,
        }
    }

    /// Carries out a call that may change the scene.
    pub(super) async fn edit(&self, edit: &Edit, history: &mut History) -> Result<CallToolResult, Failure> {
        match edit {
            Edit::Command(clauses) => self.command(clauses, history).await,
            Edit::Say(text) => self.say(text, history).await,
            Edit::Undo(steps) => {
                let steps = match steps {
                    Some(steps) => *steps,
                    None => history.undo(self.state().await?.revision),
                };
                let (result, change) = self.step_back_or_forth(Act::Undo, steps).await?;
                history.note_undone(change);
                Ok(result)
            }
            Edit::Redo(steps) => {
                let steps = match steps {
                    Some(steps) => *steps,
                    None => history.redo(self.state().await?.revision),
                };
                let (result, change) = self.step_back_or_forth(Act::Redo, steps).await?;
                history.note_done(Some(change));
                Ok(result)
            }
        }
    }

    async fn state(&self) -> Result<State, Failure> {
        Ok(self.bus.newest(&keys::SCENE_STATE, &Context::root().deadline_in(ANSWER)).await?)
    }

    /// Has the agents do actions or a sentence.
    async fn utter(&self, text: &str, clauses: Vec<Clause>) -> Result<Reply, Failure> {
        let utterance = Utterance { text: text.to_owned(), source: Source::Program.into(), clauses };
        let context = Context::root().deadline_in(TURN).at_step(self.conversation, 1);
        Ok(self.bus.ask(&keys::UTTER, &utterance, &context).await?)
    }

    /// All of the actions, or none of them.
    async fn command(&self, clauses: &[Clause], history: &mut History) -> Result<CallToolResult, Failure> {
        let reply = self.utter(&told(clauses), clauses.to_vec()).await?;
        let change = self.change_of(&reply).await;
        if reply.ok {
            history.note_done(change);
            return Ok(results::reply(&reply, change));
        }
        let what = if revisions(&reply).is_empty() {
            "Nothing was changed."
        } else if self.take_back(change).await {
            "The actions before it were taken back."
        } else {
            // Undo would take back what somebody else has done meanwhile.
            "The actions before it stay, since the scene has changed meanwhile."
        };
        Err(Failure::Work(format!("{} {what}", reply.text)))
    }

    /// What was understood of a sentence stays done, as for a person.
    async fn say(&self, text: &str, history: &mut History) -> Result<CallToolResult, Failure> {
        let reply = self.utter(text, Vec::new()).await?;
        let change = self.change_of(&reply).await;
        history.note_done(change);
        match change {
            _ if reply.ok => Ok(results::reply(&reply, change)),
            Some(_) => Err(Failure::Work(format!("{} `undo` takes back what was done.", reply.text))),
            None => Err(Failure::Work(reply.text)),
        }
    }

    async fn step_back_or_forth(&self, act: Act, steps: u32) -> Result<(CallToolResult, Change), Failure> {
        let words = format!("{} {steps}", if act == Act::Undo { "undo" } else { "redo" });
        let amount = Some(f64::from(steps));
        let clause = Clause { act: act.into(), amount, words: words.clone(), ..Clause::default() };
        let reply = self.utter(&words, vec![clause]).await?;
        if !reply.ok {
            return Err(Failure::Work(reply.text));
        }
        let change = Change { steps, revision: last_revision(&reply) };
        Ok((results::history(&reply, change), change))
    }

    /// The steps of the history that a reply tells of. Without an answer they are unknown.
    async fn change_of(&self, reply: &Reply) -> Option<Change> {
        let made = revisions(reply);
        let from = made.first()?.saturating_sub(1);
        let request = ChangesRequest { from, snapshot: false };
        let context = Context::root().deadline_in(ANSWER);
        let since = self.bus.ask(&keys::SCENE_CHANGES, &request, &context).await.ok()?;
        change(&made, &since.events)
    }

    /// Takes a change back, if nothing has changed the scene since.
    async fn take_back(&self, change: Option<Change>) -> bool {
        let Some(change) = change else { return false };
        let context = Context::root().deadline_in(ANSWER);
        let action = Some(Action::Undo(Undo { steps: change.steps }));
        let command = Command { id: context.id.clone(), expected_revision: change.revision, action };
        self.bus.ask(&keys::SCENE_APPLY, &command, &context).await.is_ok()
    }

    async fn picture(&self, screenshot: &Screenshot) -> Result<CallToolResult, Failure> {
        let request = CaptureRequest {
            width: screenshot.width,
            height: screenshot.height,
            highlight_selection: screenshot.highlight_selection,
            only_units: screenshot.only_units.clone(),
            // With every change that an earlier call made.
            at_least_revision: self.state().await?.revision,
            ..CaptureRequest::default()
        };
        let context = Context::root().deadline_in(PICTURE);
        let (frame, sender) = self.bus.ask_identified(&keys::CAPTURE, &request, &context).await.map_err(refused)?;
        let stored = StoredFile { path: &frame.png_path, hash: &frame.png_hash, sender: sender.as_ref() };
        let path = capture::local_picture(self.bus, self.session, stored).await?;
        let bytes = tokio::task::block_in_place(|| file::read(&path, MAX_PICTURE_BYTES));
        let bytes =
            bytes.map_err(|e| Failure::Work(format!("the picture cannot be sent: {e}; ask for a smaller one")))?;
        let about = format!("{} x {} pixels, revision {}", frame.width, frame.height, frame.revision);
        Ok(results::picture(&about, STANDARD.encode(bytes)))
    }
}

/// Actions in words, for the conversation.
fn told(clauses: &[Clause]) -> String {
    let words: Vec<&str> = clauses.iter().map(|clause| clause.words.as_str()).collect();
    clip(&words.join(", then "), MAX_UTTERANCE_BYTES).to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn actions_are_told_in_a_bounded_text() {
        let clause = |words: &str| Clause { words: words.to_owned(), ..Clause::default() };
        assert_eq!(told(&[clause("set color"), clause("hide the rest")]), "set color, then hide the rest");
        assert!(told(&vec![clause(&"ö".repeat(2000)); 16]).len() <= MAX_UTTERANCE_BYTES);
    }
}
