//! The selection process: it turns strokes into a committed selection.
//!
//! It keeps no state of its own. The scene stores each selection together with its steps. So undo also removes strokes, and
//! a restart loses nothing.

use std::fmt;
use std::sync::Arc;
use std::time::{Duration, Instant};

use sg_clusters::cache::ClusterCache;
use sg_edit::wire::{encode_mask, steps_of, strokes_alone};
use sg_edit::{EditState, Replica};
use sg_input::number_format::grouped;
use sg_proto::bus::Code;
use sg_proto::keys::{self, role};
use sg_proto::scene::{Command, CommandResult, CommitSelection, command};
use sg_proto::selection;
use sg_runtime::actor::{Actor, ActorError, Reply};
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;
use sg_runtime::process::{Host, StartError};
use sg_runtime::progress;
use sg_runtime::scene_replica::{SceneReplica, SceneRevision};
use sg_scene::mask::Mask;
use sg_selection::answers::AnswerChange;
use sg_selection::preview::differing;
use sg_selection::selection_index::SelectionIndex;
use sg_selection::session::{SelectionError, SelectionSession};
use sg_selection::steps::Step;
use tokio::sync::oneshot;

use crate::wire;

mod answers;
mod labels;
mod prepared;
mod regions;
mod trials;

use answers::{Newest, publish_revisions};
use labels::PublishedLabels;
use prepared::{Params, Places, prepare};
use trials::OpenStroke;

/// Length of the request queue.
const QUEUE: usize = 8;

/// Loads the scene and starts to serve.
///
/// # Errors
/// [`StartError`] for invalid parameters, an unreadable scene or a failure of the bus.
pub(crate) async fn start(host: Host) -> Result<(), StartError> {
    if host.role() != role::SELECTION {
        return Err(StartError::Input(format!("role `{}`: this executable serves `{}`", host.role(), role::SELECTION)));
    }
    let params: Params = host.params()?;
    let walk = params.walk_options();
    walk.check().map_err(|e| StartError::Input(format!("parameters of `{}`: {e}", host.role())))?;

    let scene = SceneReplica::<Replica>::follow(host.bus()).await?;
    let newest = scene.newest();
    let state = Arc::clone(newest.replica.state());
    let cache = ClusterCache::new(&params.cache.clone().unwrap_or_else(|| host.run_dir().join("clusters")));
    let geometry = state.geometry();
    let path = host.scene_path(&geometry.path, &geometry.hash, &newest.context).await?;
    let prepared = tokio::task::block_in_place(|| prepare(&path, &geometry.hash, &params, walk, &cache))?;
    let mut prepared = prepared;
    let index = tokio::task::block_in_place(|| prepared.places.index_of(&state));
    tracing::info!(
        clusters = index.clusters(),
        from_cache = prepared.from_cache,
        clustering_ms = prepared.clustering_ms,
        "clustered"
    );

    let labels = PublishedLabels::publish(host.blobs().clone(), &state, prepared.places.labels());
    let labels = labels.map_err(StartError::Failed)?;
    let mut state_message = selection::State {
        revision: state.revision(),
        scene_hash: state.geometry().hash.clone(),
        clusters: u32::try_from(index.clusters()).unwrap_or(u32::MAX),
        clustering_ms: prepared.clustering_ms,
        from_cache: prepared.from_cache,
        labels_hash: labels.hash().to_owned(),
        labels_path: labels.path().display().to_string(),
        tuning: Some(wire::encode_tuning(SelectionSession::new(Arc::clone(&index)).tuning())),
        most_proposals: sg_proto::limits::MAX_PROPOSALS,
        answers: None,
    };
    let revisions = scene.clone();
    let mut selector = Selector {
        bus: host.bus().clone(),
        session: SelectionSession::new(Arc::clone(&index)),
        indexed: (Arc::clone(&index), index),
        places: prepared.places,
        labels,
        scene,
        open: None,
        answered: 0,
        last_walk_ms: 0.0,
    };
    // After a restart the first state has the answers to what the scene has kept.
    tokio::task::block_in_place(|| selector.newest_answers()).put_into(&mut state_message);
    host.serve_content(&keys::SELECTION_CONTENT).await?;
    let owned = host.bus().retain(&keys::SELECTION_STATE, state_message.clone()).await?;
    let (mailbox, _) = host.spawn(selector, QUEUE);
    tokio::spawn(publish_revisions(revisions, mailbox.clone(), owned, state_message));
    host.route(&keys::SELECTION_SAMPLE, QUEUE, &mailbox, |request, _, reply| Message::Sample { request, reply })
        .await?;
    host.route(&keys::SELECTION_TUNE, QUEUE, &mailbox, |request, _, reply| Message::Tune { request, reply }).await?;
    host.route(&keys::SELECTION_PROPOSALS, QUEUE, &mailbox, |request, _, reply| Message::Propose { request, reply })
        .await?;
    host.route(&keys::SELECTION_REGIONS, QUEUE, &mailbox, |request, _, reply| Message::Regions { request, reply })
        .await?;
    host.route(&keys::SELECTION_STROKES, QUEUE, &mailbox, |request, context, reply| Message::Draw {
        request,
        context,
        reply,
    })
    .await?;
    Ok(())
}

/// Requests to the selector.
enum Message {
    /// Applies steps and commits the result.
    Draw { request: selection::StrokesRequest, context: Context, reply: Reply<selection::StrokesReply> },
    /// Adds samples to an unfinished stroke.
    Sample { request: selection::SampleRequest, reply: Reply<selection::SampleReply> },
    /// Previews another leak or threshold.
    Tune { request: selection::TuneRequest, reply: Reply<selection::TuneReply> },
    /// Proposes places for the next stroke.
    Propose { request: selection::ProposalsRequest, reply: Reply<selection::ProposalsReply> },
    /// Asks for regions of whole Super-Gaussians.
    Regions { request: selection::RegionsRequest, reply: Reply<selection::RegionsReply> },
    /// Asks for the newest revision, with its labels and the answers to the walk strokes of its selection.
    Answers { reply: oneshot::Sender<Newest> },
}

/// What a request asks for.
struct Draft {
    restart: bool,
    include_hidden: bool,
    steps: Vec<Step>,
    /// Another answer, after the steps.
    answer: Option<AnswerChange>,
}

/// The actor of the selection. It handles one request at a time.
struct Selector {
    bus: Bus,
    /// The index of the scene wherever edits put its Gaussians.
    places: Places,
    /// The cluster of each Gaussian, for other processes.
    labels: PublishedLabels,
    /// The newest index of the whole scene, and the same one without Gaussians that cannot be selected.
    indexed: (Arc<SelectionIndex>, Arc<SelectionIndex>),
    session: SelectionSession,
    scene: SceneReplica<Replica>,
    open: Option<OpenStroke>,
    answered: u64,
    last_walk_ms: f64,
}

/// Observable state of the selector.
#[derive(Clone)]
struct SelectorState {
    revision: u64,
    answered: u64,
    steps: usize,
    last_walk_ms: f64,
}

impl fmt::Display for SelectorState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { revision, answered, steps, last_walk_ms } = self;
        write!(f, "revision {revision}, {answered} requests, {steps} steps, last walk {last_walk_ms:.1} ms")
    }
}

impl Actor for Selector {
    type Message = Message;
    type State = SelectorState;

    fn name(&self) -> &'static str {
        "selector"
    }

    fn state(&self) -> SelectorState {
        SelectorState {
            revision: self.local_state().revision(),
            answered: self.answered,
            steps: self.session.steps().len(),
            last_walk_ms: self.last_walk_ms,
        }
    }

    async fn handle(&mut self, message: Message) -> Result<(), ActorError> {
        // A caller that has gone away loses only the reply. The commit stays.
        match message {
            Message::Draw { request, context, reply } => {
                let _ = reply.send(self.draw(&request, &context).await);
            }
            Message::Sample { request, reply } => {
                let _ = reply.send(self.sample(&request));
            }
            Message::Tune { request, reply } => {
                let _ = reply.send(tokio::task::block_in_place(|| self.tune(&request)));
            }
            Message::Propose { request, reply } => {
                let _ = reply.send(tokio::task::block_in_place(|| self.propose(&request)));
            }
            Message::Regions { request, reply } => {
                let _ = reply.send(tokio::task::block_in_place(|| self.regions(&request)));
            }
            Message::Answers { reply } => {
                let _ = reply.send(tokio::task::block_in_place(|| self.newest_answers()));
                return Ok(());
            }
        }
        self.answered += 1;
        Ok(())
    }
}

impl Selector {
    async fn draw(
        &mut self,
        request: &selection::StrokesRequest,
        context: &Context,
    ) -> Result<selection::StrokesReply, Fault> {
        let gaussians = self.local_state().count();
        let steps = steps_of(&request.strokes, &[]).into_iter().chain(request.steps.iter().cloned());
        let steps: Vec<Step> = steps.map(|step| wire::decode(&step, gaussians)).collect::<Result<_, _>>()?;
        let answer = wire::decode_answer(request.answer)?;
        if steps.is_empty() && !request.restart && answer.is_none() {
            return Err(Fault::invalid("no step to take; send at least one, or `restart` to begin anew"));
        }
        let draft = Draft { restart: request.restart, include_hidden: request.include_hidden, steps, answer };
        let outcome = match self.take(&draft, context).await {
            // An earlier process may have taken the answer already, and no other one is left beyond it.
            Err(fault) if answer.is_some() && fault.code == Code::FailedPrecondition => {
                self.earlier_result(context).await.ok_or(fault)
            }
            outcome => outcome,
        };
        if outcome.is_err() {
            let state = self.local_state();
            self.show(state.selection().mask(), None, &state, context).await;
        }
        outcome
    }

    /// Applies steps to the scene's selection, publishes a preview and commits the result.
    async fn take(&mut self, draft: &Draft, context: &Context) -> Result<selection::StrokesReply, Fault> {
        // The first attempt uses the local state and requires the same revision of the scene. It saves a round trip in the
        // usual case. Revision 0 means any revision.
        let mut state = self.local_state();
        let mut only_at = state.revision();
        loop {
            if only_at == 0 {
                state = self.newest(context).await?;
            }
            tokio::task::block_in_place(|| self.play(&state, draft))?;
            self.show(self.session.mask(), self.known_answers(), &state, context).await;
            match self.commit(&state, only_at, context).await {
                // An earlier process committed these strokes, and this one played them over the result.
                Ok(result) if result.repeated => {
                    let state = self.newest(context).await?;
                    self.session = tokio::task::block_in_place(|| self.present(&state))?;
                    return Ok(self.reply(&result));
                }
                Ok(result) => return Ok(self.reply(&result)),
                // A concurrent change of the scene: retry on the newest state until the deadline.
                Err(fault) if matches!(fault.code, Code::Aborted | Code::FailedPrecondition) => only_at = 0,
                Err(fault) => return Err(fault),
            }
        }
    }

    /// Publishes the coming selection before the commit is durable.
    async fn show(&self, mask: &Mask, answers: Option<selection::Answers>, state: &EditState, context: &Context) {
        let committed = state.selection();
        let preview = selection::Preview {
            selected: mask.count() as u64,
            changed: runs(&differing(committed.mask(), mask)),
            selection_hash: committed.hash().to_owned(),
            revision: state.revision(),
            answers,
        };
        // A lost preview is harmless: the scene publishes the committed selection.
        if let Err(fault) = self.bus.publish(&keys::SELECTION_PREVIEW, &preview, &context.next()).await {
            tracing::warn!(%fault, "a preview could not be published");
        }
    }

    /// The newest local state. The scene may be ahead of it.
    fn local_state(&self) -> Arc<EditState> {
        Arc::clone(self.scene.newest().replica.state())
    }

    /// Waits until the local state is at least as new as the scene, and returns it.
    async fn newest(&self, context: &Context) -> Result<Arc<EditState>, Fault> {
        let revision = self.bus.newest(&keys::SCENE_STATE, &context.next()).await?.revision;
        let SceneRevision { replica, .. } = self.scene.at_least(revision, context.deadline).await?;
        Ok(Arc::clone(replica.state()))
    }

    /// The session of the scene's selection, rebuilt if another client changed it.
    fn present(&mut self, state: &EditState) -> Result<SelectionSession, Fault> {
        let gaussians = state.count();
        let selection = state.selection();
        let decoded = selection.steps().iter().map(|step| wire::decode(step, gaussians));
        let mut steps: Vec<Step> = decoded.collect::<Result<_, _>>()?;
        if steps.is_empty() && !selection.mask().is_none() {
            // A selection without steps, for example by name.
            steps.push(Step::FixedMask(Mask::clone(selection.mask())));
        }
        let index = self.index_of(state);
        if Arc::ptr_eq(&index, self.session.index()) && self.session.steps().eq(&steps) {
            return Ok(self.session.clone());
        }
        SelectionSession::of_steps(&index, &steps).map_err(|e| Fault::internal(e.to_string()))
    }

    /// The index of the places of `state`, without the Gaussians that are deleted or locked in it: the former one, unless these
    /// are others now.
    fn index_of(&mut self, state: &EditState) -> Arc<SelectionIndex> {
        let (whole, unselectable) = (self.places.index_of(state), state.unselectable());
        let is_known = Arc::ptr_eq(&self.indexed.0, &whole) && **self.indexed.1.left_out() == unselectable;
        if !is_known {
            let index = if unselectable.is_none() {
                Arc::clone(&whole)
            } else {
                Arc::new(whole.without(&Arc::new(unselectable)))
            };
            self.indexed = (whole, index);
        }
        Arc::clone(&self.indexed.1)
    }

    /// Updates the session to the scene's selection and adds the new steps. On an error nothing changes.
    ///
    /// Hidden Gaussians stay out of the selection, unless they were in it before or `include_hidden` is set.
    fn play(&mut self, state: &EditState, draft: &Draft) -> Result<(), Fault> {
        let mut session =
            if draft.restart { SelectionSession::new(self.index_of(state)) } else { self.present(state)? };
        let start = Instant::now();
        for step in &draft.steps {
            session.add_step(step.clone()).map_err(refusal)?;
            progress::current().step();
        }
        if let Some(change) = draft.answer {
            let choice = session.other_answer(change).map_err(refusal)?;
            session.add_step(choice.into()).map_err(refusal)?;
        }
        if !draft.include_hidden && (!draft.steps.is_empty() || draft.answer.is_some()) {
            let kept = state.selection().mask();
            let hidden = hidden(state, &self.places.hidden(state), (!draft.restart).then_some(&**kept));
            // A later change of the walk's parameters may let it grow into what is hidden now.
            let may_grow = session.walk().is_some() && !hidden.is_none() && !session.excludes(&hidden);
            if may_grow || session.mask().intersects(&hidden) {
                session.add_step(Step::Exclude(hidden)).map_err(refusal)?;
            }
        }
        self.last_walk_ms = start.elapsed().as_secs_f64() * 1e3;
        self.session = session;
        // The finished stroke is among the steps, so its preview ends.
        self.open = None;
        Ok(())
    }

    /// Commits the session's selection over that of `state`. The scene must be at revision `only_at`, unless that is 0.
    async fn commit(&self, state: &EditState, only_at: u64, context: &Context) -> Result<CommandResult, Fault> {
        let steps: Vec<_> = self.session.steps().map(wire::encode).collect();
        let alone = strokes_alone(&steps);
        let commit = CommitSelection {
            mask: Some(encode_mask(self.session.mask())),
            steps: if alone.is_some() { Vec::new() } else { steps },
            strokes: alone.unwrap_or_default(),
            expected_hash: state.selection().hash().to_owned(),
        };
        let id = commit_id(context);
        let action = Some(command::Action::CommitSelection(commit));
        let context = context.next().with_id(id.clone()).within(Duration::from_secs(10));
        let command = Command { id: id.clone(), expected_revision: only_at, action };
        match self.bus.ask(&keys::SCENE_APPLY, &command, &context).await {
            // An earlier process committed these strokes, and this one played them over the result. A command without an
            // action asks for the first result.
            Err(fault) if fault.code == Code::AlreadyExists => {
                self.bus.ask(&keys::SCENE_APPLY, &Command { id, ..Command::default() }, &context).await
            }
            outcome => outcome,
        }
    }

    /// The reply to a request that an earlier process of this service has committed. `None` if there was none.
    async fn earlier_result(&mut self, context: &Context) -> Option<selection::StrokesReply> {
        let id = commit_id(context);
        let probe = Command { id: id.clone(), ..Command::default() };
        let context = context.next().with_id(id);
        let result = self.bus.ask(&keys::SCENE_APPLY, &probe, &context).await.ok()?;
        let state = self.newest(&context).await.ok()?;
        self.session = tokio::task::block_in_place(|| self.present(&state)).ok()?;
        Some(self.reply(&result))
    }

    fn reply(&mut self, result: &CommandResult) -> selection::StrokesReply {
        let answers = tokio::task::block_in_place(|| self.answers());
        let small = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
        let summary = self.session.walk().map(|w| w.summary).unwrap_or_default();
        let selected = self.session.mask().count();
        let existing = self.local_state().existing_count();
        let (some, all) = (grouped(selected as u64), grouped(existing as u64));
        let mut line = format!("{some} of {all} Gaussians selected");
        if summary.conflicts > 0 {
            line.push_str(&format!("; {} clusters were brushed both ways", grouped(summary.conflicts as u64)));
        }
        selection::StrokesReply {
            selected: selected as u64,
            selection_hash: result.selection_hash.clone(),
            revision: result.revision,
            clusters: small(self.session.index().clusters()),
            seeds_foreground: small(summary.seeds_foreground),
            seeds_background: small(summary.seeds_background),
            conflicts: small(summary.conflicts),
            walk_ms: self.last_walk_ms,
            summary: line,
            answers,
        }
    }
}

/// The id of the command that commits a request. A retry has the same one.
fn commit_id(context: &Context) -> String {
    format!("strokes-{}", context.id)
}

/// The hidden Gaussians that a selection has to leave out, with those that the transfer function hides; those of `kept` may stay.
fn hidden(state: &EditState, by_function: &Mask, kept: Option<&Mask>) -> Mask {
    let mut hidden = state.visible();
    hidden.subtract(by_function);
    if let Some(kept) = kept {
        hidden.union_with(kept);
    }
    hidden.invert();
    // A selection leaves out deleted ones anyway.
    hidden.subtract(state.deleted());
    hidden
}

/// The fault of a rejected step.
fn refusal(error: SelectionError) -> Fault {
    match error {
        SelectionError::NoWalk | SelectionError::NoAnswer(_) => Fault::precondition(error.to_string()),
        error => Fault::invalid(error.to_string()),
    }
}

/// Run lengths of ascending indices: skipped, set, skipped, set, and so on.
fn runs(indices: &[u32]) -> Vec<u32> {
    let mut runs: Vec<u32> = Vec::new();
    let mut end = 0;
    for &index in indices {
        match runs.last_mut() {
            Some(length) if index == end => *length += 1,
            _ => runs.extend([index - end, 1]),
        }
        end = index + 1;
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn run_lengths_alternate() {
        assert_eq!(runs(&[]), [] as [u32; 0]);
        assert_eq!(runs(&[0, 1, 2]), [0, 3]);
        assert_eq!(runs(&[3, 4, 9, 10, 11, 20]), [3, 2, 4, 3, 8, 1]);
    }
}
