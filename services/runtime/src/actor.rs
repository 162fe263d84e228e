//! Actors: a bounded mailbox, typed messages, an observable state, an exit reason.

use std::collections::VecDeque;
use std::fmt::Display;
use std::future::Future;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use sg_proto::bus::ActorHealth;
use tokio::sync::{Notify, mpsc, oneshot, watch};
use tokio::task::JoinHandle;
use tracing::Instrument as _;

use crate::fault::Fault;
use crate::progress::Progress;

/// State that one task owns. It handles one message at a time.
pub trait Actor: Send + 'static {
    /// Messages of the actor. A message with an answer carries a [`Reply`].
    type Message: Send + 'static;
    /// Observable state; its `Display` is one line.
    type State: Clone + Display + Send + Sync + 'static;

    /// Name of the actor, unique within its process.
    fn name(&self) -> &'static str;

    /// Current observable state; called after every message.
    fn state(&self) -> Self::State;

    /// Handles one message. An error ends the actor and, with it, its process.
    ///
    /// The health of the process tells how long this takes. Long work reports its parts by
    /// [`progress::current`](crate::progress::current).
    ///
    /// # Errors
    /// [`ActorError`] with the reason.
    fn handle(&mut self, message: Self::Message) -> impl Future<Output = Result<(), ActorError>> + Send;

    /// Closes its resources after the last message.
    fn stop(&mut self) -> impl Future<Output = ()> + Send {
        async {}
    }
}

/// Reason why an actor cannot continue, one line.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct ActorError(String);

impl ActorError {
    /// Makes an error from its reason.
    #[must_use]
    pub fn new(reason: impl Into<String>) -> Self {
        Self(reason.into())
    }
}

/// Sender of the answer to a message.
pub type Reply<T> = oneshot::Sender<Result<T, Fault>>;

/// Reason for the end of an actor.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Exit {
    /// All mailboxes were dropped or closed, and every message was handled.
    Finished,
    /// [`Actor::handle`] returned this error.
    Failed(ActorError),
}

/// The sending end of an actor's mailbox. Cheap to clone.
#[derive(Debug)]
pub struct Mailbox<M> {
    sender: mpsc::Sender<Traced<M>>,
    shared: Arc<Shared>,
}

/// A message with the span of its sender, so that logs about it carry the trace, and the key of its request.
type Traced<M> = (tracing::Span, &'static str, M);

/// Name of the work of a message that is no request.
const NO_KEY: &str = "a message";

// Written out because a derive would require the message to be `Clone`.
impl<M> Clone for Mailbox<M> {
    fn clone(&self) -> Self {
        Self { sender: self.sender.clone(), shared: Arc::clone(&self.shared) }
    }
}

#[derive(Debug)]
struct Shared {
    name: &'static str,
    handled: AtomicU64,
    dropped: AtomicU64,
    closing: Notify,
    progress: Progress,
    /// Times at which the waiting messages came, oldest first. As many as the mailbox has messages.
    waiting: Mutex<VecDeque<Instant>>,
}

impl Shared {
    /// Ignores poisoning: each change is a single push or take.
    fn waiting(&self) -> MutexGuard<'_, VecDeque<Instant>> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<M: Send + 'static> Mailbox<M> {
    /// Puts a message into the mailbox without waiting.
    ///
    /// # Errors
    /// `ResourceExhausted` (counted) if the mailbox is full; `Unavailable` if the actor has ended.
    pub fn tell(&self, message: M) -> Result<(), Fault> {
        self.send(NO_KEY, message)
    }

    fn send(&self, key: &'static str, message: M) -> Result<(), Fault> {
        // Locked while sending, so that the receiver finds the time of each message.
        let mut waiting = self.shared.waiting();
        let sent = self.sender.try_send((tracing::Span::current(), key, message));
        if sent.is_ok() {
            waiting.push_back(Instant::now());
        }
        drop(waiting);
        sent.map_err(|error| match error {
            mpsc::error::TrySendError::Full(_) => {
                self.shared.dropped.fetch_add(1, Ordering::Relaxed);
                Fault::exhausted(format!("the mailbox of `{}` is full; try again in a moment", self.shared.name))
            }
            mpsc::error::TrySendError::Closed(_) => {
                Fault::unavailable(format!("`{}` is stopping; try again in a moment", self.shared.name))
            }
        })
    }

    /// Sends a message with a [`Reply`] and waits for the answer until `deadline`.
    ///
    /// # Errors
    /// The fault of the actor; those of [`Mailbox::tell`]; `DeadlineExceeded`.
    pub async fn ask<T>(&self, deadline: Instant, message: impl FnOnce(Reply<T>) -> M) -> Result<T, Fault> {
        self.ask_for(NO_KEY, deadline, message).await
    }

    /// As [`Mailbox::ask`], for the request of a key.
    pub(crate) async fn ask_for<T>(
        &self,
        key: &'static str,
        deadline: Instant,
        message: impl FnOnce(Reply<T>) -> M,
    ) -> Result<T, Fault> {
        let (reply, answer) = oneshot::channel();
        self.send(key, message(reply))?;
        match tokio::time::timeout_at(deadline.into(), answer).await {
            Ok(Ok(outcome)) => outcome,
            Ok(Err(_)) => Err(Fault::unavailable(format!("`{}` ended before it answered", self.shared.name))),
            Err(_) => Err(Fault::deadline(format!("`{}` did not answer in time", self.shared.name))),
        }
    }
}

/// The receiving end of a mailbox, for a loop that waits for other things as well.
///
/// An [`Actor`] needs none: [`spawn`] reads its mailbox.
#[derive(Debug)]
pub struct Inbox<M> {
    receiver: mpsc::Receiver<Traced<M>>,
    shared: Arc<Shared>,
}

impl<M> Inbox<M> {
    /// The next message, or `None` when all mailboxes are dropped. Safe to cancel: no message is lost.
    pub async fn recv(&mut self) -> Option<M> {
        self.next().await.map(|(_, _, message)| message)
    }

    async fn next(&mut self) -> Option<Traced<M>> {
        let message = self.receiver.recv().await;
        if message.is_some() {
            self.shared.waiting().pop_front();
        }
        message
    }
}

/// Makes a mailbox of `capacity` messages and its receiving end.
#[must_use]
pub fn mailbox<M>(name: &'static str, capacity: usize) -> (Mailbox<M>, Inbox<M>) {
    let (sender, receiver) = mpsc::channel(capacity);
    let (handled, dropped) = (AtomicU64::new(0), AtomicU64::new(0));
    let (progress, waiting) = (Progress::default(), Mutex::default());
    let shared = Arc::new(Shared { name, handled, dropped, closing: Notify::new(), progress, waiting });
    (Mailbox { sender, shared: Arc::clone(&shared) }, Inbox { receiver, shared })
}

/// Handle of a running actor.
pub struct ActorHandle<S> {
    /// Observable state.
    pub state: watch::Receiver<S>,
    /// Health and shutdown.
    pub control: Arc<dyn ActorControl>,
    /// Ends with the exit reason.
    pub exit: JoinHandle<Exit>,
}

/// Health and shutdown of an actor, for its process.
pub trait ActorControl: Send + Sync {
    /// Current health.
    fn health(&self) -> ActorHealth;

    /// Closes the mailbox. The actor ends after the messages in it, even if mailboxes still exist.
    fn close(&self);
}

struct Control<M, S> {
    mailbox: mpsc::WeakSender<Traced<M>>,
    shared: Arc<Shared>,
    state: watch::Receiver<S>,
}

impl<M: Send, S: Display + Send + Sync> ActorControl for Control<M, S> {
    fn health(&self) -> ActorHealth {
        let (queued, capacity) = self
            .mailbox
            .upgrade()
            .map_or((0, 0), |sender| (sender.max_capacity() - sender.capacity(), sender.max_capacity()));
        let (busy_with, busy) = self.shared.progress.busy().unwrap_or_default();
        let oldest = self.shared.waiting().front().map(Instant::elapsed).unwrap_or_default();
        ActorHealth {
            name: self.shared.name.to_owned(),
            queued: u32::try_from(queued).unwrap_or(u32::MAX),
            capacity: u32::try_from(capacity).unwrap_or(u32::MAX),
            handled: self.shared.handled.load(Ordering::Relaxed),
            dropped: self.shared.dropped.load(Ordering::Relaxed),
            state: self.state.borrow().to_string(),
            busy_with: busy_with.to_owned(),
            busy_ms: millis(busy),
            waited_ms: millis(oldest),
        }
    }

    fn close(&self) {
        self.shared.closing.notify_one();
    }
}

/// Whole milliseconds of a time.
pub(crate) fn millis(time: Duration) -> u64 {
    u64::try_from(time.as_millis()).unwrap_or(u64::MAX)
}

/// Starts an actor with a mailbox of `capacity` messages.
pub fn spawn<A: Actor>(mut actor: A, capacity: usize) -> (Mailbox<A::Message>, ActorHandle<A::State>) {
    let (mailbox, mut inbox) = mailbox(actor.name(), capacity);
    let (publish, state) = watch::channel(actor.state());
    let shared = Arc::clone(&mailbox.shared);
    let control = Control { mailbox: mailbox.sender.downgrade(), shared, state: state.clone() };
    let counters = Arc::clone(&mailbox.shared);
    let progress = mailbox.shared.progress.clone();
    let exit = tokio::spawn(progress.clone().scope(async move {
        let mut exit = Exit::Finished;
        loop {
            let message = tokio::select! {
                message = inbox.next() => message,
                () = counters.closing.notified() => {
                    inbox.receiver.close();
                    continue;
                }
            };
            let Some((span, key, message)) = message else { break };
            progress.begin(key);
            let outcome = actor.handle(message).instrument(span).await;
            progress.end();
            counters.handled.fetch_add(1, Ordering::Relaxed);
            publish.send_replace(actor.state());
            if let Err(reason) = outcome {
                exit = Exit::Failed(reason);
                break;
            }
        }
        inbox.receiver.close();
        actor.stop().await;
        exit
    }));
    (mailbox, ActorHandle { state, exit, control: Arc::new(control) })
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Counter {
        sum: u64,
    }

    enum Message {
        Add(u64),
        Get(Reply<u64>),
        Wait(Duration),
        Break,
    }

    impl Actor for Counter {
        type Message = Message;
        type State = u64;

        fn name(&self) -> &'static str {
            "counter"
        }

        fn state(&self) -> u64 {
            self.sum
        }

        async fn handle(&mut self, message: Message) -> Result<(), ActorError> {
            match message {
                Message::Add(n) => self.sum += n,
                Message::Get(reply) => drop(reply.send(Ok(self.sum))),
                Message::Wait(time) => tokio::time::sleep(time).await,
                Message::Break => return Err(ActorError::new("broken on purpose")),
            }
            Ok(())
        }
    }

    fn soon() -> Instant {
        Instant::now() + Duration::from_secs(5)
    }

    #[tokio::test]
    async fn messages_are_handled_in_order_and_state_is_published() {
        let (mailbox, running) = spawn(Counter { sum: 0 }, 8);
        for n in 1..=4 {
            mailbox.tell(Message::Add(n)).unwrap();
        }
        assert_eq!(mailbox.ask(soon(), Message::Get).await, Ok(10));
        assert_eq!(*running.state.borrow(), 10);
        assert_eq!(running.control.health().handled, 5);
        drop(mailbox);
        assert_eq!(running.exit.await.unwrap(), Exit::Finished);
    }

    #[tokio::test]
    async fn a_closed_mailbox_is_emptied_while_senders_exist() {
        let (mailbox, running) = spawn(Counter { sum: 0 }, 8);
        mailbox.tell(Message::Wait(Duration::from_millis(20))).unwrap();
        mailbox.tell(Message::Add(1)).unwrap();
        tokio::task::yield_now().await;
        running.control.close();
        let exit = tokio::time::timeout(Duration::from_secs(5), running.exit).await;
        assert_eq!(exit.unwrap().unwrap(), Exit::Finished);
        assert_eq!(*running.state.borrow(), 1);
        assert_eq!(mailbox.tell(Message::Add(1)).unwrap_err().code, sg_proto::bus::Code::Unavailable);
    }

    #[tokio::test]
    async fn a_full_mailbox_refuses_and_counts() {
        let (mailbox, running) = spawn(Counter { sum: 0 }, 2);
        mailbox.tell(Message::Wait(Duration::from_secs(5))).unwrap();
        tokio::task::yield_now().await;
        let refused = (0..10).filter(|_| mailbox.tell(Message::Add(1)).is_err()).count();
        assert!(refused >= 8, "{refused}");
        assert_eq!(running.control.health().dropped, refused as u64);
    }

    #[tokio::test]
    async fn health_tells_the_work_its_duration_and_the_oldest_message() {
        let (mailbox, running) = spawn(Counter { sum: 0 }, 4);
        let idle = running.control.health();
        assert_eq!((idle.busy_with.as_str(), idle.busy_ms, idle.waited_ms), ("", 0, 0));
        let asking = mailbox.ask_for("cmd/wait", soon(), |reply| {
            // The reply is dropped with the message.
            drop::<Reply<u64>>(reply);
            Message::Wait(Duration::from_secs(5))
        });
        assert_eq!(asking.await.unwrap_err().code, sg_proto::bus::Code::Unavailable);
        tokio::time::sleep(Duration::from_millis(20)).await;
        mailbox.tell(Message::Add(1)).unwrap();
        tokio::time::sleep(Duration::from_millis(20)).await;
        mailbox.tell(Message::Add(1)).unwrap();
        let busy = running.control.health();
        assert_eq!((busy.busy_with.as_str(), busy.queued), ("cmd/wait", 2));
        assert!(busy.busy_ms >= 40 && (20..busy.busy_ms).contains(&busy.waited_ms), "{busy:?}");
    }

    #[tokio::test]
    async fn an_answer_has_a_deadline() {
        let (mailbox, _running) = spawn(Counter { sum: 0 }, 4);
        mailbox.tell(Message::Wait(Duration::from_secs(5))).unwrap();
        let late = mailbox.ask(Instant::now() + Duration::from_millis(20), Message::Get).await;
        assert_eq!(late.unwrap_err().code, sg_proto::bus::Code::DeadlineExceeded);
    }

    #[tokio::test]
    async fn a_failed_actor_reports_its_reason_and_refuses_messages() {
        let (mailbox, running) = spawn(Counter { sum: 0 }, 4);
        mailbox.tell(Message::Break).unwrap();
        assert_eq!(running.exit.await.unwrap(), Exit::Failed(ActorError::new("broken on purpose")));
        assert_eq!(mailbox.tell(Message::Add(1)).unwrap_err().code, sg_proto::bus::Code::Unavailable);
    }
}
