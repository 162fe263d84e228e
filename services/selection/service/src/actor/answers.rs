//! The answers to the walk strokes of the scene's selection, as the service's state has them.

use std::time::Duration;

use sg_edit::Replica;
use sg_proto::bus::Code;
use sg_proto::selection;
use sg_runtime::actor::Mailbox;
use sg_runtime::bus::RetainedValue;
use sg_runtime::scene_replica::{SceneReplica, SceneRevision};
use tokio::sync::oneshot;

use super::{Message, Selector};
use crate::wire;

/// Pause before another try to reach the selector while its queue is full.
const FULL_QUEUE_PAUSE: Duration = Duration::from_millis(50);

/// Publishes the newest revision of the local copy, with the answers to the walk strokes of its selection.
pub(super) async fn publish_revisions(
    mut scene: SceneReplica<Replica>,
    mailbox: Mailbox<Message>,
    owned: RetainedValue<selection::State>,
    mut state_message: selection::State,
) {
    let SceneRevision { mut context, .. } = scene.newest();
    loop {
        if let Some((revision, answers)) = newest_answers(&mailbox).await {
            (state_message.revision, state_message.answers) = (revision, answers);
            if let Err(fault) = owned.set(state_message.clone(), &context.next()).await {
                tracing::warn!(%fault, "the state could not be published");
            }
        }
        match scene.changed().await {
            Some(newer) => context = newer.context,
            None => return,
        }
    }
}

/// The selector's answers at the newest revision. `None` once it has ended.
async fn newest_answers(mailbox: &Mailbox<Message>) -> Option<(u64, Option<selection::Answers>)> {
    loop {
        let (reply, answers) = oneshot::channel();
        match mailbox.tell(Message::Answers { reply }) {
            Ok(()) => return answers.await.ok(),
            // Requests of people go first.
            Err(fault) if fault.code == Code::ResourceExhausted => tokio::time::sleep(FULL_QUEUE_PAUSE).await,
            Err(_) => return None,
        }
    }
}

impl Selector {
    /// The newest revision, and the answers to the walk strokes of its selection.
    pub(super) fn newest_answers(&mut self) -> (u64, Option<selection::Answers>) {
        let state = self.local_state();
        match self.present(&state) {
            Ok(session) => self.session = session,
            Err(fault) => {
                tracing::warn!(%fault, "the selection of the scene has no answers");
                return (state.revision(), None);
            }
        }
        (state.revision(), self.answers())
    }

    /// The answers to the walk strokes of the session. A selection with a tuning computes them now.
    pub(super) fn answers(&mut self) -> Option<selection::Answers> {
        if let Err(error) = self.session.answers() {
            tracing::warn!(%error, "the strokes have no answers");
        }
        self.known_answers()
    }

    /// The answers to the walk strokes of the session, where they are known.
    pub(super) fn known_answers(&self) -> Option<selection::Answers> {
        self.session.known_answers().map(|answers| wire::encode_answers(answers, self.session.tuning()))
    }
}
