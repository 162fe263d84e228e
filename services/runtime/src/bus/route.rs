//! Routes: requests of a row that an actor answers.

use prost::{Message, Name};
use sg_proto::keys::Request;

use super::{Bus, BusError, ServerHandle};
use crate::actor::{Mailbox, Reply};
use crate::context::Context;
use crate::progress;

impl Bus {
    /// Answers the requests of a row through an actor's mailbox.
    ///
    /// `message` makes the actor's message from the request, its context and the sender of the reply. At most `capacity`
    /// requests wait; the actor sees one at a time, in order. Everything else is as in [`Bus::serve`]:
    ///
    /// - The caller gets the actor's reply or its [`Fault`](crate::fault::Fault).
    /// - A full mailbox gives `ResourceExhausted`, an ended actor `Unavailable`, a late reply `DeadlineExceeded`.
    /// - After a cancellation the reply is dropped. The actor finishes its message.
    ///
    /// # Errors
    /// [`BusError::Declare`], also for a row of another role.
    pub async fn route<Q, R, M, F>(
        &self,
        row: &Request<Q, R>,
        capacity: usize,
        mailbox: &Mailbox<M>,
        message: F,
    ) -> Result<ServerHandle, BusError>
    where
        Q: Message + Name + Default + 'static,
        R: Message + Name + 'static,
        M: Send + 'static,
        F: FnOnce(Q, Context, Reply<R>) -> M + Clone + Send + 'static,
    {
        let (mailbox, key) = (mailbox.clone(), row.name);
        let handler = move |request: Q, context: Context| {
            let (mailbox, message) = (mailbox.clone(), message.clone());
            async move {
                // From here on the actor's progress counts.
                progress::current().end();
                mailbox.ask_for(key, context.deadline, |reply| message(request, context, reply)).await
            }
        };
        self.serve(row, capacity, handler).await
    }
}
