//! What the service's state has of the newest revision: labels, and the answers to the walk strokes of the selection.

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

/// What the state of the service has of a revision.
pub(super) struct Newest {
    revision: u64,
    answers: Option<selection::Answers>,
    clusters: u32,
    labels_hash: String,
    labels_path: String,
}

impl Newest {
    /// Sets the fields of the state.
    pub(super) fn put_into(self, state: &mut selection::State) {
        let Self { revision, answers, clusters, labels_hash, labels_path } = self;
        (state.revision, state.answers, state.clusters) = (revision, answers, clusters);
        (state.labels_hash, state.labels_path) = (labels_hash, labels_path);
    }
}

/// Publishes the newest revision of the local copy, with the answers to the walk strokes of its selection.
pub(super) async fn publish_revisions(
    mut scene: SceneReplica<Replica>,
    mailbox: Mailbox<Message>,
    owned: RetainedValue<selection::State>,
    mut state_message: selection::State,
) {
    let SceneRevision { mut context, .. } = scene.newest();
    loop {
        if let Some(newest) = newest_answers(&mailbox).await {
            newest.put_into(&mut state_message);
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
async fn newest_answers(mailbox: &Mailbox<Message>) -> Option<Newest> {
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
    /// The newest revision, with its labels and the answers to the walk strokes of its selection.
    pub(super) fn newest_answers(&mut self) -> Newest {
        let state = self.local_state();
        let answers = match self.present(&state) {
            Ok(session) => {
                self.session = session;
                self.answers()
            }
            Err(fault) => {
                tracing::warn!(%fault, "the selection of the scene has no answers");
                None
            }
        };
        if let Err(error) = self.labels.update(&state, self.places.labels()) {
            tracing::warn!(error, "other processes do not know the Super-Gaussians of the duplicates");
        }
        Newest {
            revision: state.revision(),
            answers,
            clusters: u32::try_from(self.session.index().clusters()).unwrap_or(u32::MAX),
            labels_hash: self.labels.hash().to_owned(),
            labels_path: self.labels.path().display().to_string(),
        }
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
