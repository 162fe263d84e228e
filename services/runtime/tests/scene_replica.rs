//! A copy of the scene that follows a fake scene over a local bus.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail the test")]

mod fixture;

use std::time::{Duration, Instant};

use fixture::FakeScene;
use sg_proto::bus::Code;
use sg_proto::keys::role;
use sg_proto::scene::{Event, State};
use sg_runtime::scene_replica::{Replica, SceneReplica, SceneReplicaError};

/// Remembers its snapshot and the events after it. Refuses the event of revision 13 and every snapshot of revision 99.
#[derive(Debug, Clone, PartialEq)]
struct FakeReplica {
    snapshot: u64,
    applied: Vec<u64>,
}

impl FakeReplica {
    fn new(snapshot: u64, applied: &[u64]) -> Self {
        Self { snapshot, applied: applied.to_vec() }
    }
}

impl Replica for FakeReplica {
    type Error = String;

    fn from_snapshot(snapshot: &State) -> Result<Self, String> {
        if snapshot.revision == 99 { Err("malformed".to_owned()) } else { Ok(Self::new(snapshot.revision, &[])) }
    }

    fn revision(&self) -> u64 {
        self.applied.last().copied().unwrap_or(self.snapshot)
    }

    fn apply(&mut self, event: &Event) -> Result<(), String> {
        if event.revision == 13 || event.revision != self.revision() + 1 {
            return Err(format!("event {} after {}", event.revision, self.revision()));
        }
        self.applied.push(event.revision);
        Ok(())
    }
}

fn soon() -> Instant {
    Instant::now() + Duration::from_secs(5)
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_copy_starts_over_after_a_refused_event() {
    let scene = FakeScene::at(11).await;
    let _serving = scene.serve_changes().await;
    let reader = scene.join(role::SELECTION).await;
    let mut replica = SceneReplica::<FakeReplica>::follow(&reader).await.unwrap();
    assert_eq!(*replica.newest().replica, FakeReplica::new(11, &[]));

    scene.publish(12).await;
    let changed = tokio::time::timeout(Duration::from_secs(5), replica.changed()).await.unwrap().unwrap();
    assert_eq!(*changed.replica, FakeReplica::new(11, &[12]));
    assert_eq!(changed.context.sender, role::SCENE, "the context is that of the event");

    // The copy refuses event 13 and asks for a snapshot.
    scene.publish(13).await;
    let newest = replica.at_least(13, soon()).await.unwrap();
    assert_eq!(*newest.replica, FakeReplica::new(13, &[]));

    let early = replica.at_least(14, Instant::now() + Duration::from_millis(20)).await.unwrap_err();
    assert_eq!(early.code, Code::DeadlineExceeded);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn every_event_is_applied_once_despite_losses() {
    let scene = FakeScene::at(4).await;
    let serving = scene.serve_changes().await;
    let reader = scene.join(role::SELECTION).await;
    let mut replica = SceneReplica::<FakeReplica>::follow(&reader).await.unwrap();

    scene.publish(5).await;
    // 6 and 7 are never published; 8 reveals the gap.
    scene.publish(8).await;
    let newest = replica.at_least(8, soon()).await.unwrap();
    assert_eq!(*newest.replica, FakeReplica::new(4, &[5, 6, 7, 8]));
    // A repeated event changes nothing. The last event is lost and found after a silence.
    scene.publish(8).await;
    scene.set(9);
    let newest = replica.at_least(9, soon()).await.unwrap();
    assert_eq!(*newest.replica, FakeReplica::new(4, &[5, 6, 7, 8, 9]));
    // A snapshot bridges a long gap.
    scene.publish(60).await;
    let newest = replica.at_least(60, soon()).await.unwrap();
    assert_eq!(*newest.replica, FakeReplica::new(60, &[]));

    // The scene is opened anew with a lower revision, so the copy starts over.
    drop(serving);
    scene.set(2);
    tokio::time::sleep(Duration::from_millis(300)).await;
    let _serving = scene.serve_changes().await;
    let start_over = async { while replica.changed().await.unwrap().replica.revision() != 2 {} };
    tokio::time::timeout(Duration::from_secs(20), start_over).await.unwrap();
    assert_eq!(*replica.newest().replica, FakeReplica::new(2, &[]));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_refused_first_snapshot_is_an_error() {
    let scene = FakeScene::at(99).await;
    let _serving = scene.serve_changes().await;
    let reader = scene.join(role::SELECTION).await;
    let error = SceneReplica::<FakeReplica>::follow(&reader).await.unwrap_err();
    assert!(matches!(&error, SceneReplicaError::Snapshot(reason) if reason == "malformed"), "{error}");
}
