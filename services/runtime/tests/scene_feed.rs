//! A reader of the scene that loses events, joins late, or outlives the scene's process.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail the test")]

use std::sync::{Arc, Mutex};
use std::time::Duration;

use sg_proto::keys::{self, role};
use sg_proto::scene::{Changes, ChangesRequest, Event, State};
use sg_runtime::bus::{Bus, Serving, endpoint_of};
use sg_runtime::context::Context;
use sg_runtime::scene_feed::{SceneFeed, Update};

/// Answers from a revision that the test sets: events for short gaps, a snapshot for those over ten.
async fn serve_changes(scene: &Bus, revision: &Arc<Mutex<u64>>) -> Serving {
    let revision = Arc::clone(revision);
    scene
        .serve(&keys::SCENE_CHANGES, 8, move |request: ChangesRequest, _| {
            let revision = *revision.lock().unwrap();
            let gap = revision.saturating_sub(request.from);
            let snapshot = (request.snapshot || gap > 10).then(|| State { revision, ..State::default() });
            let range = request.from + 1..=revision;
            let events = range.filter(|_| snapshot.is_none()).map(event).collect();
            std::future::ready(Ok(Changes { revision, events, snapshot }))
        })
        .await
        .unwrap()
}

fn event(revision: u64) -> Event {
    Event { revision, ..Event::default() }
}

async fn next(feed: &mut SceneFeed) -> Update {
    tokio::time::timeout(Duration::from_secs(5), feed.next()).await.unwrap().unwrap().0
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn every_revision_comes_once_whatever_is_lost() {
    let folder = tempfile::tempdir().unwrap();
    let socket = folder.path().join("bus.sock");
    let _router = Bus::open_router("test", role::SUPERVISOR, &socket, None).await.unwrap();
    let join = |role: &'static str| {
        let endpoint = endpoint_of(&socket);
        async move { Bus::connect("test", role, &endpoint).await.unwrap() }
    };
    let scene = join(role::SCENE).await;
    let revision = Arc::new(Mutex::new(4));
    let serving = serve_changes(&scene, &revision).await;
    let publish = async |r: u64| {
        *revision.lock().unwrap() = r;
        scene.publish(&keys::SCENE_EVENT, &event(r), &Context::root()).await.unwrap();
    };

    let reader = join(role::SELECTION).await;
    let mut feed = SceneFeed::open(&reader).await.unwrap();
    assert!(matches!(next(&mut feed).await, Update::Snapshot(s) if s.revision == 4));

    publish(5).await;
    assert_eq!(next(&mut feed).await, Update::Event(event(5)));
    // 6 and 7 are never published; 8 tells of the gap.
    publish(8).await;
    for r in 6..=8 {
        assert_eq!(next(&mut feed).await, Update::Event(event(r)));
    }
    // A repeated event changes nothing; the last event is lost and found by asking after a silence.
    publish(8).await;
    *revision.lock().unwrap() = 9;
    assert_eq!(next(&mut feed).await, Update::Event(event(9)));
    // A long gap is bridged by a snapshot.
    publish(60).await;
    assert!(matches!(next(&mut feed).await, Update::Snapshot(s) if s.revision == 60));

    // The scene goes away and comes back with less: another life, so the reader starts over.
    drop(serving);
    *revision.lock().unwrap() = 2;
    let again = tokio::spawn(async move { (next(&mut feed).await, feed) });
    tokio::time::sleep(Duration::from_millis(300)).await;
    let _serving = serve_changes(&scene, &revision).await;
    let (update, _feed) = again.await.unwrap();
    assert!(matches!(update, Update::Snapshot(s) if s.revision == 2), "a scene opened anew is read anew");
}
