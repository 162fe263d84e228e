//! Served keys whose requests one event loop answers.

use sg_proto::keys::Request;
use sg_proto::prost::{Message, Name};
use sg_runtime::bus::{Bus, BusError, ServerHandle};
use sg_runtime::fault::Fault;
use tokio::sync::{mpsc, oneshot};

/// Where the answer to a request goes.
pub(crate) type Reply<R> = oneshot::Sender<Result<R, Fault>>;

/// Serves one key: puts each request into the queue and answers with the reply of the event loop.
///
/// `wrap` makes the queue's entry. `closed` is the answer once the event loop has ended.
///
/// # Errors
/// The key cannot be declared.
pub(crate) async fn forward<Q, R, T>(
    bus: &Bus,
    row: &Request<Q, R>,
    queue: &mpsc::Sender<T>,
    wrap: fn(Q, Reply<R>) -> T,
    closed: fn() -> Fault,
) -> Result<ServerHandle, BusError>
where
    Q: Message + Name + Default + 'static,
    R: Message + Name + 'static,
    T: Send + 'static,
{
    let queue = queue.clone();
    bus.serve(row, queue.max_capacity(), move |request, _| {
        let queue = queue.clone();
        async move {
            let (reply, answer) = oneshot::channel();
            queue.send(wrap(request, reply)).await.map_err(|_| closed())?;
            answer.await.map_err(|_| closed())?
        }
    })
    .await
}
