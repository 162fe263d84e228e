//! A copy of the scene that follows a fake scene over a local bus.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail the test")]

mod fixture;

use std::time::{Duration, Instant};

use fixture::FakeScene;
use sg_proto::bus::Code;
use sg_proto::keys::role;
use sg_proto::scene::{Event, State};
use sg_runtime::scene_replica::{Replica, SceneReplica, SceneReplicaError};

/// Refuses the event of revision 13 and every snapshot of revision 99.
#[derive(Debug, Clone, PartialEq)]
struct FakeReplica {
    revision: u64,
    snapshot: u64,
}

impl Replica for FakeReplica {
    type Error = String;

    fn from_snapshot(snapshot: &State) -> Result<Self, String> {
        let revision = snapshot.revision;
        if revision == 99 { Err("malformed".to_owned()) } else { Ok(Self { revision, snapshot: revision }) }
    }

    fn revision(&self) -> u64 {
        self.revision
    }

    fn apply(&mut self, event: &Event) -> Result<(), String> {
        if event.revision == 13 || event.revision != self.revision + 1 {
            return Err(format!("event {} after {}", event.revision, self.revision));
        }
        self.revision = event.revision;
        Ok(())
    }
}

fn soon() -> Instant {
    Instant::now() + Duration::from_secs(5)
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_copy_follows_events_gaps_and_refusals() {
    let scene = FakeScene::at(4).await;
    let _serving = scene.serve_changes().await;
    let reader = scene.join(role::SELECTION).await;
    let mut replica = SceneReplica::<FakeReplica>::follow(&reader).await.unwrap();
    assert_eq!(*replica.newest().replica, FakeReplica { revision: 4, snapshot: 4 });

    scene.publish(5).await;
    let changed = tokio::time::timeout(Duration::from_secs(5), replica.changed()).await.unwrap().unwrap();
    assert_eq!(*changed.replica, FakeReplica { revision: 5, snapshot: 4 });

    // Events 6 and 7 are lost.
    scene.publish(8).await;
    let newest = replica.at_least(8, soon()).await.unwrap();
    assert_eq!(*newest.replica, FakeReplica { revision: 8, snapshot: 4 });

    // The copy refuses event 13 and starts over with a snapshot.
    scene.publish(13).await;
    let newest = replica.at_least(13, soon()).await.unwrap();
    assert_eq!(*newest.replica, FakeReplica { revision: 13, snapshot: 13 });

    let early = replica.at_least(14, Instant::now() + Duration::from_millis(20)).await.unwrap_err();
    assert_eq!(early.code, Code::DeadlineExceeded);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_refused_first_snapshot_is_an_error() {
    let scene = FakeScene::at(99).await;
    let _serving = scene.serve_changes().await;
    let reader = scene.join(role::SELECTION).await;
    let error = SceneReplica::<FakeReplica>::follow(&reader).await.unwrap_err();
    assert!(matches!(&error, SceneReplicaError::Snapshot(reason) if reason == "malformed"), "{error}");
}
