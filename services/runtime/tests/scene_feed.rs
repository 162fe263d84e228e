//! A reader of the scene that loses events, joins late, or outlives the scene's process.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail the test")]

mod fixture;

use std::time::Duration;

use fixture::{FakeScene, event};
use sg_proto::keys::role;
use sg_runtime::scene_feed::{SceneFeed, Update};

async fn next(feed: &mut SceneFeed) -> Update {
    tokio::time::timeout(Duration::from_secs(5), feed.next()).await.unwrap().unwrap().0
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn every_revision_arrives_once_despite_losses() {
    let scene = FakeScene::at(4).await;
    let serving = scene.serve_changes().await;
    let reader = scene.join(role::SELECTION).await;
    let mut feed = SceneFeed::open(&reader).await.unwrap();
    assert!(matches!(next(&mut feed).await, Update::Snapshot(s) if s.revision == 4));

    scene.publish(5).await;
    assert_eq!(next(&mut feed).await, Update::Event(event(5)));
    // 6 and 7 are never published; 8 reveals the gap.
    scene.publish(8).await;
    for revision in 6..=8 {
        assert_eq!(next(&mut feed).await, Update::Event(event(revision)));
    }
    // A repeated event changes nothing. The last event is lost and found after a silence.
    scene.publish(8).await;
    scene.set(9);
    assert_eq!(next(&mut feed).await, Update::Event(event(9)));
    // A snapshot bridges a long gap.
    scene.publish(60).await;
    assert!(matches!(next(&mut feed).await, Update::Snapshot(s) if s.revision == 60));

    // The scene is opened anew with a lower revision, so the reader starts over.
    drop(serving);
    scene.set(2);
    let again = tokio::spawn(async move { (next(&mut feed).await, feed) });
    tokio::time::sleep(Duration::from_millis(300)).await;
    let _serving = scene.serve_changes().await;
    let (update, mut feed) = again.await.unwrap();
    assert!(matches!(update, Update::Snapshot(s) if s.revision == 2), "a scene opened anew is read anew");

    feed.restart();
    assert!(matches!(next(&mut feed).await, Update::Snapshot(s) if s.revision == 2));
}
