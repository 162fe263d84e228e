//! The labeling service for a display: its state, and a person's questions to it.

use std::sync::Arc;
use std::time::Duration;

use sg_edit::Replica;
use sg_proto::keys::{self, role};
use sg_proto::labeling::{Embedding, FindRequest, ViewsRequest};
use sg_runtime::bus::{Bus, LivelinessChange, Subscription};
use sg_runtime::context::Context;
use sg_runtime::scene_replica::SceneRevision;
use sg_viewer::display::{Answer, REGION_VIEWS, RegionViews, StateWriter};
use tokio::sync::{mpsc, watch};
use tokio::task::JoinHandle;

/// Timeout of a state query.
const STATE_TIMEOUT: Duration = Duration::from_secs(5);

/// Tries while the service takes in a revision, and their period.
const SOON: u32 = 20;
const SOON_AFTER: Duration = Duration::from_millis(25);

/// Period of tries after that, and while embeddings are to come.
const RETRY_AFTER: Duration = Duration::from_secs(1);

/// Timeout of a question for units, long enough for a service's restart.
const FIND_TIMEOUT: Duration = Duration::from_secs(10);

/// Timeout of a question for views: the service draws some dozens of pictures, for a large unit in some seconds.
const VIEWS_TIMEOUT: Duration = Duration::from_secs(60);

/// Side of a view's picture, pixels.
const PIXELS: u32 = 128;

/// Follows the state of the labeling service while one is there.
pub(super) async fn follow(
    bus: Bus,
    mut embeddings: Subscription<Embedding>,
    mut liveliness: mpsc::Receiver<LivelinessChange>,
    mut revisions: watch::Receiver<SceneRevision<Replica>>,
    writer: StateWriter,
) {
    let mut instances: Vec<String> = Vec::new();
    let mut tries = 0;
    loop {
        let revision = revisions.borrow_and_update().replica.state().revision();
        let newest = if instances.is_empty() {
            None
        } else {
            bus.newest(&keys::LABELING_STATE, &Context::root().deadline_in(STATE_TIMEOUT)).await.ok()
        };
        let is_behind = newest.as_ref().is_none_or(|state| state.revision < revision);
        let is_waiting = newest.as_ref().is_some_and(|state| state.pending > 0);
        // A service that is busy keeps its last state here.
        let known = writer.newest().labeling.state.clone();
        let shown = if instances.is_empty() { None } else { newest.map(Arc::new).or_else(|| known.clone()) };
        if shown != known {
            writer.update(|state| Arc::make_mut(&mut state.labeling).state = shown);
        }
        tries = if is_behind { tries + 1 } else { 0 };
        let pause = if is_behind && tries < SOON { SOON_AFTER } else { RETRY_AFTER };
        let retries = !instances.is_empty() && (is_behind || is_waiting);
        tokio::select! {
            change = liveliness.recv() => match change {
                Some(change) if change.role == role::LABELING => {
                    instances.retain(|instance| *instance != change.instance);
                    if change.alive {
                        instances.push(change.instance);
                    }
                    tries = 0;
                }
                Some(_) => (),
                None => return,
            },
            event = embeddings.next() => if event.is_none() { return },
            changed = revisions.changed() => {
                if changed.is_err() {
                    return;
                }
                tries = 0;
            }
            () = tokio::time::sleep(pause), if retries => (),
        }
    }
}

/// Asks the service beside all other requests. A newer question supersedes the one of its kind that is under way.
pub(super) struct Questions {
    bus: Bus,
    writer: StateWriter,
    find: Option<Pending>,
    views: Option<Pending>,
}

/// A question under way.
struct Pending {
    /// Id of its request.
    id: String,
    task: JoinHandle<()>,
}

impl Questions {
    pub(super) fn new(bus: Bus, writer: StateWriter) -> Self {
        Self { bus, writer, find: None, views: None }
    }

    /// Asks which units a text means.
    pub(super) fn find(&mut self, number: u64, text: String) {
        supersede(&self.bus, self.find.take());
        let request = FindRequest { text, at_least_revision: self.revision(), regions: true, ..FindRequest::default() };
        let context = Context::root().deadline_in(FIND_TIMEOUT);
        let id = context.id.clone();
        let (bus, writer) = (self.bus.clone(), self.writer.clone());
        let task = tokio::spawn(async move {
            let reply = bus.ask(&keys::LABELING_FIND, &request, &context).await;
            let answer = Answer { number, result: reply.map_err(|fault| fault.message) };
            writer.update(|state| Arc::make_mut(&mut state.labeling).take_found(answer));
        });
        self.find = Some(Pending { id, task });
    }

    /// Asks for the best views of a unit; of the selection where the name is empty.
    pub(super) fn views(&mut self, number: u64, unit: String) {
        supersede(&self.bus, self.views.take());
        let request = ViewsRequest {
            unit,
            at_least_revision: self.revision(),
            count: REGION_VIEWS as u32,
            pixels: PIXELS,
            pictures: true,
            ..ViewsRequest::default()
        };
        let context = Context::root().deadline_in(VIEWS_TIMEOUT);
        let id = context.id.clone();
        let (bus, writer) = (self.bus.clone(), self.writer.clone());
        let task = tokio::spawn(async move {
            let reply = bus.ask(&keys::LABELING_VIEWS, &request, &context).await;
            let result = reply.map(|reply| RegionViews::of(&reply)).map_err(|fault| fault.message);
            writer.update(|state| Arc::make_mut(&mut state.labeling).take_views(Answer { number, result }));
        });
        self.views = Some(Pending { id, task });
    }

    /// Revision of the scene that a person sees.
    fn revision(&self) -> u64 {
        self.writer.newest().scene.revision()
    }
}

/// Gives a question up that has no answer yet, here and in the service.
fn supersede(bus: &Bus, pending: Option<Pending>) {
    let Some(Pending { id, task }) = pending.filter(|pending| !pending.task.is_finished()) else { return };
    task.abort();
    let bus = bus.clone();
    tokio::spawn(async move {
        // One that was answered meanwhile is unknown there, and a service that is away has none.
        let _ = bus.cancel(role::LABELING, &id).await;
    });
}
