//! A copy of the scene that stays current while the process runs.
//!
//! The copy itself is any [`Replica`]. This module asks for the snapshot, applies the events, fills gaps and notifies readers
//! of each new revision.

use std::fmt;
use std::sync::Arc;
use std::time::{Duration, Instant};

pub use sg_proto::replica::Replica;
use tokio::sync::watch;

use crate::bus::{Bus, BusError};
use crate::context::Context;
use crate::fault::Fault;
use crate::scene_feed::{SceneFeed, Update};

/// Pause after the first refused update.
const FIRST_PAUSE: Duration = Duration::from_millis(100);

/// Longest pause between two tries after refused updates.
const LONGEST_PAUSE: Duration = Duration::from_secs(5);

/// A scene that cannot be followed.
#[derive(Debug, thiserror::Error)]
pub enum SceneReplicaError {
    /// The events cannot be subscribed to.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// The bus closed before the first snapshot.
    #[error("the bus closed before the scene sent a snapshot")]
    Closed,
    /// The first snapshot was refused.
    #[error("scene snapshot: {0}")]
    Snapshot(String),
}

/// The copy at one revision.
#[derive(Debug)]
pub struct SceneRevision<R> {
    /// The copy.
    pub replica: Arc<R>,
    /// Context of the event or snapshot that led to this revision.
    pub context: Context,
}

// Written out because a derive would require `R: Clone`, although only the pointer is cloned.
impl<R> Clone for SceneRevision<R> {
    fn clone(&self) -> Self {
        Self { replica: Arc::clone(&self.replica), context: self.context.clone() }
    }
}

/// The newest copy of the scene, shared by all its readers. Cheap to clone.
///
/// A task in the background follows the scene until the bus closes or the last reader is dropped. It asks for missing
/// events, starts over with a snapshot after a refused update, and waits while the scene is away.
pub struct SceneReplica<R> {
    newest: watch::Receiver<SceneRevision<R>>,
}

impl<R> Clone for SceneReplica<R> {
    fn clone(&self) -> Self {
        Self { newest: self.newest.clone() }
    }
}

impl<R: Replica> fmt::Debug for SceneReplica<R> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let revision = self.newest.borrow().replica.revision();
        f.debug_struct("SceneReplica").field("revision", &revision).finish_non_exhaustive()
    }
}

impl<R: Replica> SceneReplica<R> {
    /// Waits for the first snapshot, then follows the scene in the background.
    ///
    /// # Errors
    /// [`SceneReplicaError`].
    pub async fn follow(bus: &Bus) -> Result<Self, SceneReplicaError> {
        let mut feed = SceneFeed::open(bus).await?;
        let (state, context) = loop {
            match feed.next().await {
                Some((Update::Snapshot(state), context)) => break (state, context),
                Some((Update::Event(_), _)) => (),
                None => return Err(SceneReplicaError::Closed),
            }
        };
        let replica = R::from_snapshot(&state).map_err(|e| SceneReplicaError::Snapshot(e.to_string()))?;
        let (sender, newest) = watch::channel(SceneRevision { replica: Arc::new(replica), context });
        tokio::spawn(keep_current(feed, sender));
        Ok(Self { newest })
    }

    /// The newest copy.
    #[must_use]
    pub fn newest(&self) -> SceneRevision<R> {
        self.newest.borrow().clone()
    }

    /// Waits for a revision that this reader has not seen; `None` after the bus has closed. Revisions in between are
    /// skipped.
    pub async fn changed(&mut self) -> Option<SceneRevision<R>> {
        self.newest.changed().await.ok()?;
        Some(self.newest.borrow_and_update().clone())
    }

    /// Waits until the copy is at `revision` or a newer one.
    ///
    /// # Errors
    /// `DeadlineExceeded` if the revision did not arrive in time; `Unavailable` after the bus has closed.
    pub async fn at_least(&self, revision: u64, deadline: Instant) -> Result<SceneRevision<R>, Fault> {
        let mut newest = self.newest.clone();
        let arrived = newest.wait_for(|newest| newest.replica.revision() >= revision);
        match tokio::time::timeout_at(deadline.into(), arrived).await {
            Ok(Ok(newest)) => Ok(newest.clone()),
            Ok(Err(_)) => Err(Fault::unavailable("the scene is no longer followed; try again in a moment")),
            Err(_) => Err(Fault::deadline(format!("revision {revision} of the scene did not arrive in time"))),
        }
    }

    /// The channel behind this reader, for loops that wait for other things as well.
    #[must_use]
    pub fn receiver(&self) -> watch::Receiver<SceneRevision<R>> {
        self.newest.clone()
    }
}

async fn keep_current<R: Replica>(mut feed: SceneFeed, newest: watch::Sender<SceneRevision<R>>) {
    let mut pause = FIRST_PAUSE;
    loop {
        let update = tokio::select! {
            update = feed.next() => update,
            () = newest.closed() => return,
        };
        let Some((update, context)) = update else { return };
        let present = Arc::clone(&newest.borrow().replica);
        match advance(present.as_ref(), &update) {
            Ok(replica) => {
                pause = FIRST_PAUSE;
                newest.send_replace(SceneRevision { replica: Arc::new(replica), context });
            }
            Err(error) => {
                tracing::error!(%error, "a change of the scene was refused; asking for a snapshot");
                feed.restart();
                tokio::time::sleep(pause).await;
                pause = (pause * 2).min(LONGEST_PAUSE);
            }
        }
    }
}

fn advance<R: Replica>(present: &R, update: &Update) -> Result<R, R::Error> {
    match update {
        Update::Snapshot(state) => R::from_snapshot(state),
        Update::Event(event) => {
            let mut next = present.clone();
            next.apply(event)?;
            Ok(next)
        }
    }
}
