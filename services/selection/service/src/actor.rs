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
use sg_formats::npy;
use sg_input::number_format::grouped;
use sg_proto::bus::Code;
use sg_proto::keys::{self, role};
use sg_proto::scene::{Command, CommandResult, CommitSelection, command};
use sg_proto::selection;
use sg_runtime::actor::{Actor, ActorError, Reply};
use sg_runtime::bus::{Bus, RetainedValue};
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;
use sg_runtime::process::{Host, StartError};
use sg_runtime::progress;
use sg_runtime::scene_replica::{SceneReplica, SceneRevision};
use sg_scene::mask::Mask;
use sg_selection::preview::{Preview, differing};
use sg_selection::selection_index::{SelectionIndex, WalkOptions};
use sg_selection::session::{SelectionError, SelectionSession};
use sg_selection::steps::Step;
use sg_selection::strokes::Stroke;

use crate::wire;

mod prepared;

use prepared::{Params, Places, prepare};

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
    let walk = if params.every_scale { WalkOptions::every_scale() } else { WalkOptions::default() };
    let walk = WalkOptions { leak: params.leak, sigma_s: params.sigma_s, sigma_f: params.sigma_f, ..walk };
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

    let labels_path = host.blobs().folder().join("labels.npy");
    let (labels_hash, _) = npy::write_labels(&labels_path, prepared.places.labels())
        .map_err(|e| e.to_string())
        .and_then(|()| host.blobs().offer(&labels_path).map_err(|e| e.to_string()))
        .map_err(StartError::Failed)?;
    let state_message = selection::State {
        revision: state.revision(),
        scene_hash: state.geometry().hash.clone(),
        clusters: u32::try_from(index.clusters()).unwrap_or(u32::MAX),
        clustering_ms: prepared.clustering_ms,
        from_cache: prepared.from_cache,
        labels_hash,
        labels_path: labels_path.display().to_string(),
        tuning: Some(wire::encode_tuning(SelectionSession::new(Arc::clone(&index)).tuning())),
        most_proposals: sg_proto::limits::MAX_PROPOSALS,
    };
    host.serve_content(&keys::SELECTION_CONTENT).await?;
    let owned = host.bus().retain(&keys::SELECTION_STATE, state_message.clone()).await?;
    tokio::spawn(publish_revisions(scene.clone(), owned, state_message));

    let selector = Selector {
        bus: host.bus().clone(),
        session: SelectionSession::new(Arc::clone(&index)),
        indexed: (Arc::clone(&index), index),
        places: prepared.places,
        scene,
        open: None,
        answered: 0,
        last_walk_ms: 0.0,
    };
    let (mailbox, _) = host.spawn(selector, QUEUE);
    host.route(&keys::SELECTION_SAMPLE, QUEUE, &mailbox, |request, _, reply| Message::Sample { request, reply })
        .await?;
    host.route(&keys::SELECTION_TUNE, QUEUE, &mailbox, |request, _, reply| Message::Tune { request, reply }).await?;
    host.route(&keys::SELECTION_PROPOSALS, QUEUE, &mailbox, |request, _, reply| Message::Propose { request, reply })
        .await?;
    host.route(&keys::SELECTION_STROKES, QUEUE, &mailbox, |request, context, reply| Message::Draw {
        request,
        context,
        reply,
    })
    .await?;
    Ok(())
}

/// Publishes the newest revision of the local copy.
async fn publish_revisions(
    mut scene: SceneReplica<Replica>,
    owned: RetainedValue<selection::State>,
    mut state_message: selection::State,
) {
    while let Some(SceneRevision { replica, context }) = scene.changed().await {
        state_message.revision = replica.state().revision();
        if let Err(fault) = owned.set(state_message.clone(), &context.next()).await {
            tracing::warn!(%fault, "the state could not be published");
        }
    }
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
}

/// The preview of an unfinished stroke.
struct OpenStroke {
    name: String,
    /// Hash of the selection below the stroke.
    over: String,
    /// Gaussians that could not be selected then.
    unselectable: Mask,
    /// The state that it was begun in.
    state: Arc<EditState>,
    preview: Preview,
}

/// The actor of the selection. It handles one request at a time.
struct Selector {
    bus: Bus,
    /// The index of the scene wherever edits put its Gaussians.
    places: Places,
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
        let gaussians = self.session.mask().len();
        let steps = steps_of(&request.strokes, &[]).into_iter().chain(request.steps.iter().cloned());
        let steps: Vec<Step> = steps.map(|step| wire::decode(&step, gaussians)).collect::<Result<_, _>>()?;
        if steps.is_empty() && !request.restart {
            return Err(Fault::invalid("no step to take; send at least one, or `restart` to begin anew"));
        }
        let outcome = self.take((request.restart, request.include_hidden), &steps, context).await;
        if outcome.is_err() {
            let state = self.local_state();
            self.show(state.selection().mask(), &state, context).await;
        }
        outcome
    }

    /// Applies steps to the scene's selection, publishes a preview and commits the result.
    async fn take(
        &mut self,
        (restart, include_hidden): (bool, bool),
        steps: &[Step],
        context: &Context,
    ) -> Result<selection::StrokesReply, Fault> {
        // The first attempt uses the local state and requires the same revision of the scene. It saves a round trip in the
        // usual case. Revision 0 means any revision.
        let mut state = self.local_state();
        let mut only_at = state.revision();
        loop {
            if only_at == 0 {
                state = self.newest(context).await?;
            }
            tokio::task::block_in_place(|| self.play(&state, (restart, include_hidden), steps))?;
            self.show(self.session.mask(), &state, context).await;
            match self.commit(&state, only_at, context).await {
                Ok(result) => return Ok(self.reply(&result)),
                // A concurrent change of the scene: retry on the newest state until the deadline.
                Err(fault) if matches!(fault.code, Code::Aborted | Code::FailedPrecondition) => only_at = 0,
                Err(fault) => return Err(fault),
            }
        }
    }

    /// Publishes the coming selection before the commit is durable.
    async fn show(&self, mask: &Mask, state: &EditState, context: &Context) {
        let committed = state.selection();
        let preview = selection::Preview {
            selected: mask.count() as u64,
            changed: runs(&differing(committed.mask(), mask)),
            selection_hash: committed.hash().to_owned(),
            revision: state.revision(),
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
        let gaussians = self.session.mask().len();
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
    fn play(
        &mut self,
        state: &EditState,
        (restart, include_hidden): (bool, bool),
        steps: &[Step],
    ) -> Result<(), Fault> {
        let mut session = if restart { SelectionSession::new(self.index_of(state)) } else { self.present(state)? };
        let start = Instant::now();
        for step in steps {
            session.add_step(step.clone()).map_err(refusal)?;
            progress::current().step();
        }
        if !include_hidden && !steps.is_empty() {
            let kept = state.selection().mask();
            let hidden = hidden(state, (!restart).then_some(&**kept));
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

    /// Adds samples to an unfinished stroke and returns the preview.
    ///
    /// No other service is involved, because the user waits for the reply. A sample is cheaper than moving other work off
    /// this thread, so only the first one blocks in place.
    fn sample(&mut self, request: &selection::SampleRequest) -> Result<selection::SampleReply, Fault> {
        let start = Instant::now();
        let samples = request.samples.as_ref().ok_or_else(|| Fault::invalid("no samples; send some"))?;
        let stroke = wire::decode_stroke(samples)?;
        let state = self.local_state();
        let over = state.selection().hash();
        let unselectable = state.unselectable();
        let goes_on = self.open.as_ref().is_some_and(|o| {
            o.name == request.stroke && o.over == over && o.unselectable == unselectable && o.state.is_placed_as(&state)
        });
        if !goes_on {
            let session = tokio::task::block_in_place(|| self.present(&state))?;
            // The selection below has changed: replay the stroke over the new one.
            let earlier = self.open.take().filter(|o| o.name == request.stroke);
            let mut preview = Preview::begin(&session, &stroke).map_err(|e| Fault::invalid(e.to_string()))?;
            if let Some(earlier) = earlier {
                let Stroke { points, pressure, .. } = earlier.preview.stroke();
                preview.extend(points, pressure).map_err(|e| Fault::invalid(e.to_string()))?;
            }
            let (name, over) = (request.stroke.clone(), over.to_owned());
            self.open = Some(OpenStroke { name, over, unselectable, state: Arc::clone(&state), preview });
            self.session = session;
        }
        let open = self.open.as_mut().ok_or_else(|| Fault::internal("the stroke was not begun"))?;
        let most = sg_proto::limits::MAX_STROKE_POINTS;
        if open.preview.stroke().points.len() + stroke.points.len() > most {
            return Err(Fault::exhausted(format!("a stroke of more than {most} points; begin another one")));
        }
        let changed =
            open.preview.extend(&stroke.points, &stroke.pressure).map_err(|e| Fault::invalid(e.to_string()))?;
        let mask = open.preview.mask();
        let mut changed = if goes_on {
            changed
        } else {
            // Relative to the committed selection. The client displays that.
            differing(state.selection().mask(), mask)
        };
        let mut selected = mask.count();
        if !request.include_hidden {
            let mut hidden = hidden(&state, Some(state.selection().mask()));
            changed.retain(|g| !hidden.get(*g as usize));
            hidden.intersect_with(mask);
            selected -= hidden.count();
        }
        Ok(selection::SampleReply {
            hits: open.preview.hits() as u64,
            selected: selected as u64,
            changed: runs(&changed),
            relative_to_committed: !goes_on,
            selection_hash: over.to_owned(),
            preview_ms: start.elapsed().as_secs_f64() * 1e3,
        })
    }

    /// Previews another leak or threshold, without a change of state.
    ///
    /// Each reply is relative to the committed selection, so a client may skip replies.
    fn tune(&mut self, request: &selection::TuneRequest) -> Result<selection::TuneReply, Fault> {
        let start = Instant::now();
        let tuning = request.tuning.as_ref().ok_or_else(|| Fault::invalid("no leak and threshold; send both"))?;
        let tuning = wire::decode_tuning(tuning)?;
        let state = self.local_state();
        let mut session = self.present(&state)?;
        self.session = session.clone();
        session.tune(tuning).map_err(refusal)?;
        let committed = state.selection();
        Ok(selection::TuneReply {
            selected: session.mask().count() as u64,
            changed: runs(&differing(committed.mask(), session.mask())),
            selection_hash: committed.hash().to_owned(),
            preview_ms: start.elapsed().as_secs_f64() * 1e3,
        })
    }

    /// Proposes places for the next walk stroke.
    fn propose(&mut self, request: &selection::ProposalsRequest) -> Result<selection::ProposalsReply, Fault> {
        let start = Instant::now();
        let most = sg_proto::limits::MAX_PROPOSALS;
        if !(1..=most).contains(&request.count) {
            return Err(Fault::invalid(format!("{} places; ask for 1 to {most}", request.count)));
        }
        let state = self.local_state();
        self.session = self.present(&state)?;
        if self.session.walk().is_none() {
            return Err(Fault::precondition("the selection has no walk to continue; brush in walk mode first"));
        }
        let proposals = self.session.proposals(request.count as usize);
        Ok(selection::ProposalsReply {
            proposals: proposals.iter().map(wire::encode_proposal).collect(),
            selection_hash: state.selection().hash().to_owned(),
            proposals_ms: start.elapsed().as_secs_f64() * 1e3,
        })
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
        // A retry has the same command id.
        let id = format!("strokes-{}", context.id);
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

    fn reply(&self, result: &CommandResult) -> selection::StrokesReply {
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
        }
    }
}

/// The hidden Gaussians that a selection has to leave out; those of `kept` may stay.
fn hidden(state: &EditState, kept: Option<&Mask>) -> Mask {
    let mut hidden = state.visible();
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
        SelectionError::NoWalk => Fault::precondition(error.to_string()),
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
