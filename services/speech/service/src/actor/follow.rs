//! Follows the units of the scene.

use std::time::Duration;

use sg_proto::keys::{self, role};
use sg_runtime::actor::Mailbox;
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;

use super::Message;

/// Length of the queue of changes.
const QUEUE: usize = 64;
/// Time without a change after which the state is read.
const SETTLED: Duration = Duration::from_millis(100);
/// Longest wait for the state of the scene.
const TIMEOUT: Duration = Duration::from_secs(5);
/// Pause before the next try where the scene does not answer.
const RETRY: Duration = Duration::from_secs(1);

/// Reports the state of the scene after each change.
pub(super) async fn scene(bus: Bus, mailbox: Mailbox<Message>) {
    let mut changes = match bus.subscribe(&keys::SCENE_EVENT, role::SCENE, QUEUE).await {
        Ok(changes) => changes,
        Err(error) => {
            tracing::warn!(%error, "changes of the scene are not followed");
            return;
        }
    };
    loop {
        let newest = bus.newest(&keys::SCENE_STATE, &Context::root().deadline_in(TIMEOUT)).await;
        let is_known = match newest {
            // A full mailbox has sound that is older; the state comes again with the next try.
            Ok(state) => mailbox.tell(Message::Scene(Box::new(state))).is_ok(),
            Err(_) => false,
        };
        if is_known {
            if changes.next().await.is_none() {
                return;
            }
        } else {
            // A change is worth a try at once.
            let _ = tokio::time::timeout(RETRY, changes.next()).await;
        }
        // A stroke changes the scene many times a second.
        while let Ok(change) = tokio::time::timeout(SETTLED, changes.next()).await {
            if change.is_none() {
                return;
            }
        }
    }
}
