//! A reader's view of the scene's changes: in order, without gaps, for as long as the reader lives.

use std::collections::VecDeque;
use std::time::Duration;

use sg_proto::bus::Code;
use sg_proto::keys::{self, role};
use sg_proto::scene::{Changes, ChangesRequest, Event, State};

use crate::bus::{Bus, BusError, Following};
use crate::context::Context;
use crate::fault::Fault;

/// How many events may wait for a reader; one that falls further behind asks for what it missed.
const CAPACITY: usize = 256;

/// How long the feed may be silent before it asks whether it missed the last event.
const SILENCE: Duration = Duration::from_secs(2);

/// How long one question to the scene may take.
const PATIENCE: Duration = Duration::from_secs(5);

/// What a reader does next.
#[derive(Debug, Clone, PartialEq)]
pub enum Update {
    /// Take this state in place of whatever it holds.
    Snapshot(Box<State>),
    /// Apply this event, whose revision follows the one it holds.
    Event(Event),
}

/// Snapshots and events of the scene, in order.
///
/// Events are streamed and may be lost; the feed notices by their revisions, and asks the scene for what is missing. While
/// the scene is away the feed waits.
#[derive(Debug)]
pub struct SceneFeed {
    bus: Bus,
    events: Following<Event>,
    revision: Option<u64>,
    pending: VecDeque<(Update, Context)>,
}

impl SceneFeed {
    /// Begins to follow; the first update is a snapshot.
    ///
    /// # Errors
    /// The stream cannot be followed.
    pub async fn open(bus: &Bus) -> Result<Self, BusError> {
        let events = bus.follow(&keys::SCENE_EVENT, role::SCENE, CAPACITY).await?;
        Ok(Self { bus: bus.clone(), events, revision: None, pending: VecDeque::new() })
    }

    /// The next update and the chain it belongs to; `None` when the bus is closed.
    pub async fn next(&mut self) -> Option<(Update, Context)> {
        loop {
            if let Some(update) = self.pending.pop_front() {
                return Some(update);
            }
            let Some(revision) = self.revision else {
                self.catch_up(None).await;
                continue;
            };
            match tokio::time::timeout(SILENCE, self.events.next()).await {
                Err(_) => self.catch_up(Some(revision)).await,
                Ok(None) => return None,
                Ok(Some((event, _))) if event.revision <= revision => (),
                Ok(Some((event, context))) if event.revision == revision + 1 => {
                    self.revision = Some(event.revision);
                    return Some((Update::Event(event), context));
                }
                Ok(Some(_)) => self.catch_up(Some(revision)).await,
            }
        }
    }

    /// Forgets the reader's revision, so that the next update is a snapshot.
    pub fn restart(&mut self) {
        self.revision = None;
        self.pending.clear();
    }

    /// Asks for what is missing; a scene that is away is asked again by the next call.
    async fn catch_up(&mut self, from: Option<u64>) {
        let request = ChangesRequest { from: from.unwrap_or(0), snapshot: from.is_none() };
        let context = Context::root().deadline_in(PATIENCE);
        match self.bus.ask(&keys::SCENE_CHANGES, &request, &context).await {
            Ok(changes) => self.take(changes, from, &context),
            Err(fault) => self.wait_after(&fault).await,
        }
    }

    fn take(&mut self, changes: Changes, from: Option<u64>, context: &Context) {
        if let Some(state) = changes.snapshot {
            self.revision = Some(state.revision);
            self.pending.push_back((Update::Snapshot(Box::new(state)), context.clone()));
            return;
        }
        // A scene that knows less than its reader was opened anew: what the reader holds is of another life.
        let Some(mut at) = from.filter(|from| changes.revision >= *from) else {
            self.revision = None;
            return;
        };
        for event in changes.events {
            if event.revision == at + 1 {
                at = event.revision;
                self.pending.push_back((Update::Event(event), context.clone()));
            }
        }
        self.revision = Some(at);
        if at < changes.revision {
            // Neither events nor a snapshot led there: start over rather than live with a hole.
            self.revision = None;
        }
    }

    async fn wait_after(&mut self, fault: &Fault) {
        if !matches!(fault.code, Code::Unavailable | Code::DeadlineExceeded) {
            tracing::warn!(%fault, "the scene did not tell what changed");
        }
        tokio::time::sleep(fault.retry_after.unwrap_or(Duration::from_millis(100))).await;
    }
}
