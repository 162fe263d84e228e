//! Requests that every process answers.

use sg_proto::bus::{CancelReply, CancelRequest, Code, MetricsReply, PromoteRequest};
use sg_proto::keys;
use tokio::sync::oneshot;

use super::host::Host;
use crate::bus::BusError;
use crate::context::Context;
use crate::fault::Fault;
use crate::metrics;

impl Host {
    /// Answers the rows of every process: status, cancel, metrics, promote.
    pub(super) async fn serve_standard_requests(&self) -> Result<(), BusError> {
        let host = self.clone();
        self.serve(&keys::STATUS, 16, move |_, _| std::future::ready(Ok(host.health()))).await?;
        let bus = self.bus().clone();
        let cancel = move |request: CancelRequest, context: Context| {
            std::future::ready(Ok(CancelReply { found: bus.cancel_pending(&request.id, &context) }))
        };
        self.serve(&keys::CANCEL, 16, cancel).await?;
        let host = self.clone();
        let render = move |_, _| {
            metrics::health(&host.health());
            std::future::ready(Ok(MetricsReply { text: metrics::render() }))
        };
        self.serve(&keys::METRICS, 4, render).await?;
        let host = self.clone();
        let promote = move |request: PromoteRequest, context: Context| {
            let host = host.clone();
            async move {
                if !host.is_standby() {
                    let message = format!("`{}` is not in standby", host.inner.args.instance);
                    return Err(Fault::new(Code::FailedPrecondition, message));
                }
                let (reply, answer) = oneshot::channel();
                let loading = || Fault::unavailable("the process is still loading; try again in a moment");
                host.inner.promotions.try_send((request, reply)).map_err(|_| loading())?;
                match tokio::time::timeout_at(context.deadline.into(), answer).await {
                    Ok(Ok(outcome)) => outcome,
                    Ok(Err(_)) => Err(Fault::unavailable("the process ended before it took its role")),
                    Err(_) => Err(Fault::deadline("the role was not taken in time")),
                }
            }
        };
        self.serve(&keys::PROMOTE, 1, promote).await
    }
}
