//! The runtime, as services use it.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use sg_proto::keys::{self, role};
use sg_proto::scene::CommandResult;
use sg_runtime::bus::{Bus, endpoint_of};
use sg_runtime::context::Context;
use sg_runtime::metrics;

use crate::{Link, command, small};

async fn join(folder: &Path, role: &str) -> Bus {
    // Counting is part of the runtime's cost.
    metrics::install(role, "bench-1");
    Bus::connect("bench", role, &endpoint_of(&folder.join("bus.sock"))).await.unwrap()
}

pub(crate) async fn serve(folder: &Path) {
    let bus = join(folder, role::SCENE).await;
    let heard = Arc::new(AtomicU64::new(0));
    let mut frames = bus.subscribe(&keys::VIEW_FRAME, role::RENDER_VIEW, 1 << 16).await.unwrap();
    let counter = Arc::clone(&heard);
    tokio::spawn(async move {
        while frames.next().await.is_some() {
            counter.fetch_add(1, Ordering::Relaxed);
        }
    });
    let _serving = bus
        .serve(&keys::SCENE_APPLY, 16, move |request: sg_proto::scene::Command, _| {
            let revision = heard.load(Ordering::Relaxed);
            std::future::ready(Ok(CommandResult { id: request.id, revision, ..Default::default() }))
        })
        .await
        .unwrap();
    std::future::pending::<()>().await;
}

pub(crate) struct Ours(Bus);

impl Ours {
    pub(crate) async fn connect(folder: &Path) -> Self {
        let link = Self(join(folder, role::RENDER_VIEW).await);
        link.ask("ready?").await;
        link
    }

    async fn ask(&self, text: &str) -> CommandResult {
        self.0.ask(&keys::SCENE_APPLY, &command(text), &Context::root()).await.unwrap()
    }
}

impl Link for Ours {
    async fn echo(&mut self, text: &str) {
        assert_eq!(self.ask(text).await.id.len(), text.len());
    }

    async fn flood(&mut self, time: Duration) -> u64 {
        let before = self.ask("").await.revision;
        let frame = small();
        let context = Context::root();
        let begun = Instant::now();
        while begun.elapsed() < time {
            for _ in 0..64 {
                self.0.publish(&keys::VIEW_FRAME, &frame, &context).await.unwrap();
            }
        }
        // Messages in transit arrive before the next answer.
        self.ask("").await.revision - before
    }
}
