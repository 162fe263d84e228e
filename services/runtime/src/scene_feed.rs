//! Changes of the scene for a reader: in order and without gaps.

use std::collections::VecDeque;
use std::time::Duration;

use sg_proto::bus::Code;
use sg_proto::keys::{self, role};
use sg_proto::scene::{Changes, ChangesRequest, Event, State};

use crate::bus::{Bus, BusError, Subscription};
use crate::context::Context;
use crate::fault::Fault;

/// Most waiting events. A reader further behind asks for the missing ones.
const CAPACITY: usize = 256;

/// Time without an event after which the feed asks whether it missed the last one.
const IDLE_TIMEOUT: Duration = Duration::from_secs(2);

/// Deadline of one request to the scene.
const REQUEST_TIMEOUT: Duration = Duration::from_secs(5);

/// The next update of a reader's copy.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Update {
    /// Replace the copy by this state.
    Snapshot(Box<State>),
    /// Apply this event. Its revision follows that of the copy.
    Event(Event),
}

/// Snapshots and events of the scene, in order.
///
/// Events may be lost in transit. The feed detects gaps by the revisions and asks the scene for the missing events. While
/// the scene is away, the feed waits.
#[derive(Debug)]
pub(crate) struct SceneFeed {
    bus: Bus,
    events: Subscription<Event>,
    revision: Option<u64>,
    pending: VecDeque<(Update, Context)>,
}

impl SceneFeed {
    /// Subscribes to the scene. The first update is a snapshot.
    ///
    /// # Errors
    /// The events cannot be subscribed to.
    pub(crate) async fn open(bus: &Bus) -> Result<Self, BusError> {
        let events = bus.subscribe(&keys::SCENE_EVENT, role::SCENE, CAPACITY).await?;
        Ok(Self { bus: bus.clone(), events, revision: None, pending: VecDeque::new() })
    }

    /// Waits for the next update and its context; `None` when the bus is closed.
    pub(crate) async fn next(&mut self) -> Option<(Update, Context)> {
        loop {
            if let Some(update) = self.pending.pop_front() {
                return Some(update);
            }
            let Some(revision) = self.revision else {
                self.catch_up(None).await;
                continue;
            };
            match tokio::time::timeout(IDLE_TIMEOUT, self.events.next()).await {
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
    pub(crate) fn restart(&mut self) {
        self.revision = None;
        self.pending.clear();
    }

    /// Asks for the missing events. While the scene is away, the next call asks again.
    async fn catch_up(&mut self, from: Option<u64>) {
        let request = ChangesRequest { from: from.unwrap_or(0), snapshot: from.is_none() };
        let context = Context::root().deadline_in(REQUEST_TIMEOUT);
        match self.bus.ask_identified(&keys::SCENE_CHANGES, &request, &context).await {
            Ok((changes, identity)) => self.accept(changes, from, &Context { identity, ..context }),
            Err(fault) => self.wait_after(&fault).await,
        }
    }

    fn accept(&mut self, changes: Changes, from: Option<u64>, context: &Context) {
        if let Some(state) = changes.snapshot {
            self.revision = Some(state.revision);
            self.pending.push_back((Update::Snapshot(Box::new(state)), context.clone()));
            return;
        }
        // A lower revision than the reader's means that the scene was opened anew.
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
            // Neither events nor a snapshot lead to the newest revision: start over.
            self.revision = None;
        }
    }

    async fn wait_after(&mut self, fault: &Fault) {
        if !matches!(fault.code, Code::Unavailable | Code::DeadlineExceeded) {
            tracing::warn!(%fault, "the scene did not return its changes");
        }
        tokio::time::sleep(fault.retry_after.unwrap_or(Duration::from_millis(100))).await;
    }
}
