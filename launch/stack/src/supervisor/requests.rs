//! Requests to a supervisor, over the bus or in the same process.

use std::sync::Arc;

use sg_proto::bus::MetricsReply;
use sg_proto::keys::{self, Identity};
use sg_proto::launch::{
    DownReply, JoinReply, JoinRequest, OpenReply, OpenRequest, PsReply, PsRequest, ReloadReply, ReloadRequest,
    RestartReply, RestartRequest, SaveReply, SaveRequest, SwapReply, SwapRequest,
};
use sg_runtime::actor::{Mailbox, Reply};
use sg_runtime::bus::{Bus, BusError, ServerHandle};
use sg_runtime::context::Context;
use sg_runtime::metrics;
use tokio::sync::Notify;

/// Most requests, exits and signs of life that wait at a time.
pub(super) const CAPACITY: usize = 256;

/// Most files that are written at a time.
pub(super) const MAX_SAVES: usize = 2;

/// A request, with the channel for its answer.
pub(super) enum Request {
    Ps(PsRequest, Reply<PsReply>),
    Restart(RestartRequest, Reply<RestartReply>),
    Swap(SwapRequest, Reply<SwapReply>),
    Reload(ReloadRequest, Reply<ReloadReply>),
    /// With its sender, as its certificate proves.
    Join(JoinRequest, Option<Identity>, Reply<JoinReply>),
    Open(OpenRequest, Reply<OpenReply>),
    /// With its deadline.
    Save(SaveRequest, Context, Reply<SaveReply>),
}

/// A handle that stops the supervisor, for the same process. Cheap to clone.
#[derive(Debug, Clone, Default)]
pub struct Handle {
    // Beside the queue of requests, so that a full queue loses no stop.
    stop: Arc<Notify>,
}

impl Handle {
    /// Begins an orderly stop.
    pub fn down(&self) {
        self.stop.notify_one();
    }

    /// Waits until a stop is requested. A request before the wait counts. Safe to cancel.
    pub(super) async fn stop_requested(&self) {
        self.stop.notified().await;
    }
}

/// Serves the keys of the supervisor. The event loop answers the requests in the mailbox.
pub(super) async fn serve(
    bus: &Bus,
    mailbox: &Mailbox<Request>,
    handle: &Handle,
) -> Result<Vec<ServerHandle>, BusError> {
    let handle = handle.clone();
    let down = bus.serve(&keys::DOWN, CAPACITY, move |_, _| {
        handle.down();
        std::future::ready(Ok(DownReply {}))
    });
    let counted = |_, _| std::future::ready(Ok(MetricsReply { text: metrics::render() }));
    let metrics = bus.serve(&keys::METRICS, CAPACITY, counted);
    Ok(vec![
        bus.route(&keys::PS, CAPACITY, mailbox, |request, _, reply| Request::Ps(request, reply)).await?,
        bus.route(&keys::RESTART, CAPACITY, mailbox, |request, _, reply| Request::Restart(request, reply)).await?,
        bus.route(&keys::SWAP, CAPACITY, mailbox, |request, _, reply| Request::Swap(request, reply)).await?,
        bus.route(&keys::RELOAD, CAPACITY, mailbox, |request, _, reply| Request::Reload(request, reply)).await?,
        bus.route(&keys::JOIN, CAPACITY, mailbox, |request, context, reply| {
            Request::Join(request, context.identity, reply)
        })
        .await?,
        bus.route(&keys::OPEN, CAPACITY, mailbox, |request, _, reply| Request::Open(request, reply)).await?,
        bus.route(&keys::SAVE, CAPACITY, mailbox, Request::Save).await?,
        down.await?,
        metrics.await?,
    ])
}
