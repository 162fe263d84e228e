//! Requests to a supervisor, over the bus or in the same process.

use sg_proto::bus::MetricsReply;
use sg_proto::keys;
use sg_proto::launch::{
    DownReply, JoinReply, JoinRequest, OpenReply, OpenRequest, PsReply, PsRequest, ReloadReply, ReloadRequest,
    RestartReply, RestartRequest, SwapReply, SwapRequest,
};
use sg_runtime::bus::{Bus, BusError, ServerHandle};
use sg_runtime::fault::Fault;
use sg_runtime::metrics;
use tokio::sync::mpsc;

use crate::request_queue::{Reply, forward};

/// Most requests, exits and signs of life that wait at a time.
pub(super) const CAPACITY: usize = 256;

/// A request, with the channel for its answer.
pub(super) enum Request {
    Ps(PsRequest, Reply<PsReply>),
    Restart(RestartRequest, Reply<RestartReply>),
    Swap(SwapRequest, Reply<SwapReply>),
    Reload(ReloadRequest, Reply<ReloadReply>),
    Join(JoinRequest, Reply<JoinReply>),
    Open(OpenRequest, Reply<OpenReply>),
    Down,
}

/// A handle for requests in the same process.
#[derive(Debug, Clone)]
pub struct Handle(pub(super) mpsc::Sender<Request>);

impl Handle {
    /// Begins an orderly stop.
    pub async fn down(&self) {
        // A supervisor that does not receive is stopping.
        let _ = self.0.send(Request::Down).await;
    }
}

fn stopping() -> Fault {
    Fault::unavailable("the supervisor is stopping")
}

/// Serves the keys of the supervisor: each request goes into the queue, its answer comes back from the event loop.
pub(super) async fn serve(bus: &Bus, requests: &mpsc::Sender<Request>) -> Result<Vec<ServerHandle>, BusError> {
    let sender = requests.clone();
    let down = bus.serve(&keys::DOWN, CAPACITY, move |_, _| {
        let sender = sender.clone();
        async move {
            sender.send(Request::Down).await.map_err(|_| stopping())?;
            Ok(DownReply {})
        }
    });
    let counted = |_, _| std::future::ready(Ok(MetricsReply { text: metrics::render() }));
    let metrics = bus.serve(&keys::METRICS, CAPACITY, counted);
    Ok(vec![
        forward(bus, &keys::PS, requests, Request::Ps, stopping).await?,
        forward(bus, &keys::RESTART, requests, Request::Restart, stopping).await?,
        forward(bus, &keys::SWAP, requests, Request::Swap, stopping).await?,
        forward(bus, &keys::RELOAD, requests, Request::Reload, stopping).await?,
        forward(bus, &keys::JOIN, requests, Request::Join, stopping).await?,
        forward(bus, &keys::OPEN, requests, Request::Open, stopping).await?,
        down.await?,
        metrics.await?,
    ])
}
