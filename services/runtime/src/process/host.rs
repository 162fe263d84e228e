//! The running process: its bus, files, actors and served rows.

use std::future::Future;
use std::path::{Path, PathBuf};
use std::pin::Pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use prost::{Message, Name};
use serde::de::DeserializeOwned;
use sg_proto::bus::{ActorHealth, Code, ContentReply, ContentRequest, Health, Phase, PromoteReply, PromoteRequest};
use sg_proto::keys::Request;
use tokio::sync::{mpsc, oneshot, watch};

use super::arguments::ServeArgs;
use super::memory::resident_bytes;
use super::start_error::StartError;
use crate::actor::{self, Actor, ActorControl, ActorError, ActorHandle, Exit, Mailbox, Reply, millis};
use crate::blobs::Blobs;
use crate::bus::{Bus, BusError, ServerHandle};
use crate::context::Context;
use crate::fault::Fault;
use crate::progress::Progress;
use crate::{scene_files, wire};

/// The running process, for its loading code and its handlers. Cheap to clone.
#[derive(Clone)]
pub struct Host {
    pub(super) inner: Arc<Inner>,
}

pub(super) struct Inner {
    pub(super) args: ServeArgs,
    pub(super) version: &'static str,
    pub(super) started: Instant,
    pub(super) bus: Bus,
    pub(super) blobs: Blobs,
    pub(super) phase: watch::Sender<Phase>,
    pub(super) serving: Mutex<Vec<ServerHandle>>,
    pub(super) actors: Mutex<Vec<Arc<dyn ActorControl>>>,
    pub(super) exits: mpsc::Sender<(&'static str, Exit)>,
    pub(super) before_promotion: Mutex<Vec<Hook>>,
    pub(super) promotions: mpsc::Sender<Promotion>,
    pub(super) stop: tokio::sync::Notify,
    pub(super) failures: mpsc::Sender<String>,
    /// Progress of the loading code.
    pub(super) loading: Progress,
    /// Loops outside the actors.
    pub(super) loops: Mutex<Vec<WatchedLoop>>,
}

/// A loop on a thread of its own, such as a window's.
pub(super) struct WatchedLoop {
    name: &'static str,
    silent_for: Box<dyn Fn() -> Duration + Send + Sync>,
}

impl WatchedLoop {
    fn health(&self) -> ActorHealth {
        // A turn may take its time.
        let silent = Some((self.silent_for)()).filter(|time| *time >= LONG_TURN);
        ActorHealth {
            name: self.name.to_owned(),
            busy_with: silent.map_or("", |_| "a turn of its loop").to_owned(),
            busy_ms: silent.map_or(0, millis),
            ..ActorHealth::default()
        }
    }
}

/// Duration from which a turn of a loop is reported.
const LONG_TURN: Duration = Duration::from_secs(1);

/// Work before a promotion.
type Hook = Box<dyn FnOnce() -> Pin<Box<dyn Future<Output = Result<(), StartError>> + Send>> + Send>;

/// A granted role, and the sender of the reply.
pub(super) type Promotion = (PromoteRequest, oneshot::Sender<Result<PromoteReply, Fault>>);

impl Host {
    /// Bus of the session.
    #[must_use]
    pub fn bus(&self) -> &Bus {
        &self.inner.bus
    }

    /// Role of this process.
    #[must_use]
    pub fn role(&self) -> &str {
        &self.inner.args.role
    }

    /// Whether this process waits for its role.
    ///
    /// In standby it works on scratch state. [`Host::before_promotion`] opens resources of the role, such as a journal.
    #[must_use]
    pub fn is_standby(&self) -> bool {
        self.bus().is_standby()
    }

    /// Registers work between the grant of the role and the declaration of its keys.
    ///
    /// The former holder of the role has ended by then, and no request arrives yet. An error ends the process. Without
    /// effect in a process that starts with its role.
    pub fn before_promotion<F, Fut>(&self, hook: F)
    where
        F: FnOnce() -> Fut + Send + 'static,
        Fut: Future<Output = Result<(), StartError>> + Send + 'static,
    {
        lock(&self.inner.before_promotion).push(Box::new(move || Box::pin(hook())));
    }

    /// Stops this process as a request to stop does: accepted work is finished. For a window that a person closes.
    pub fn stop(&self) {
        self.inner.stop.notify_one();
    }

    /// Ends this process as failed, so that its supervisor restarts it. For work outside the actors, such as a render loop.
    ///
    /// The first of several reasons counts.
    pub fn fail(&self, reason: String) {
        // The first failure wins.
        let _ = self.inner.failures.try_send(reason);
    }

    /// Folder of the session.
    #[must_use]
    pub fn run_dir(&self) -> &Path {
        &self.inner.args.run_dir
    }

    /// Store of pictures and other bulk data of the session.
    #[must_use]
    pub fn blobs(&self) -> &Blobs {
        &self.inner.blobs
    }

    /// Returns a local path of the scene's geometry.
    ///
    /// On the machine of the scene that is `path` itself. On another machine the files are fetched once. `scene` is the
    /// context of the scene's message with the path.
    ///
    /// # Errors
    /// [`StartError::Input`] if the scene can't be sent; [`StartError::Failed`] if a transfer failed.
    pub async fn scene_path(&self, path: &str, geometry_hash: &str, scene: &Context) -> Result<PathBuf, StartError> {
        if scene.identity.as_ref().map(|i| i.node.as_str()) == self.bus().node() {
            return Ok(PathBuf::from(path));
        }
        scene_files::fetch(self.bus(), self.run_dir(), geometry_hash).await.map_err(|fault| match fault.code {
            // The scene cannot be sent in its current form, so a restart is useless.
            Code::FailedPrecondition | Code::InvalidArgument => StartError::Input(fault.message),
            _ => fault.into(),
        })
    }

    /// Answers a row with parts of the files that [`Host::blobs`] holds or offers.
    ///
    /// # Errors
    /// As in [`Bus::serve`].
    pub async fn serve_content(&self, row: &Request<ContentRequest, ContentReply>) -> Result<(), BusError> {
        let blobs = self.blobs().clone();
        let part =
            move |request: ContentRequest, _| std::future::ready(tokio::task::block_in_place(|| blobs.part(&request)));
        self.serve(row, 8, part).await
    }

    /// Parses the parameters from the launch file. Give the type `#[serde(deny_unknown_fields)]`.
    ///
    /// # Errors
    /// [`StartError::Input`] with the name of the wrong parameter.
    pub fn params<T: DeserializeOwned>(&self) -> Result<T, StartError> {
        serde_json::from_str(&self.inner.args.params)
            .map_err(|e| StartError::Input(format!("parameters of `{}`: {e}", self.role())))
    }

    /// Starts an actor of this process. The health lists it, and its failure ends the process.
    pub fn spawn<A: Actor>(&self, actor: A, capacity: usize) -> (Mailbox<A::Message>, watch::Receiver<A::State>) {
        let name = actor.name();
        let (mailbox, ActorHandle { state, exit, control }) = actor::spawn(actor, capacity);
        lock(&self.inner.actors).push(control);
        let exits = self.inner.exits.clone();
        tokio::spawn(async move {
            let exit = exit.await.unwrap_or_else(|e| Exit::Failed(ActorError::new(format!("panicked: {e}"))));
            // The channel closes only at the end of the process.
            let _ = exits.send((name, exit)).await;
        });
        (mailbox, state)
    }

    /// Watches a loop outside the actors, such as a window's. The health lists it as an actor, and a loop that hangs is
    /// treated as one.
    ///
    /// `silent_for` returns the time since the begin of the loop's last turn. It must not wait for the loop.
    pub fn watch_loop(&self, name: &'static str, silent_for: impl Fn() -> Duration + Send + Sync + 'static) {
        lock(&self.inner.loops).push(WatchedLoop { name, silent_for: Box::new(silent_for) });
    }

    /// Answers the requests of a row of this process's role until the process drains.
    ///
    /// # Errors
    /// As in [`Bus::serve`].
    pub async fn serve<Q, R, H, F>(&self, row: &Request<Q, R>, capacity: usize, handler: H) -> Result<(), BusError>
    where
        Q: Message + Name + Default + 'static,
        R: Message + Name + 'static,
        H: FnMut(Q, Context) -> F + Send + 'static,
        F: Future<Output = Result<R, Fault>> + Send,
    {
        let serving = self.bus().serve(row, capacity, handler).await?;
        lock(&self.inner.serving).push(serving);
        Ok(())
    }

    /// Answers the requests of a row of this process's role through an actor's mailbox, until the process drains.
    ///
    /// `message` makes the actor's message from the request, its context and the sender of the reply. The method of the
    /// same name on [`Bus`] lists the errors that callers get.
    ///
    /// ```
    /// use sg_proto::keys;
    /// use sg_proto::scene::{Command, CommandResult};
    /// use sg_runtime::actor::{Actor, ActorError, Reply};
    /// use sg_runtime::bus::BusError;
    /// use sg_runtime::context::Context;
    /// use sg_runtime::process::Host;
    ///
    /// struct Scene {
    ///     revision: u64,
    /// }
    ///
    /// enum Message {
    ///     Apply { command: Command, context: Context, reply: Reply<CommandResult> },
    /// }
    ///
    /// impl Actor for Scene {
    ///     type Message = Message;
    ///     type State = u64;
    ///
    ///     fn name(&self) -> &'static str {
    ///         "scene"
    ///     }
    ///
    ///     fn state(&self) -> u64 {
    ///         self.revision
    ///     }
    ///
    ///     async fn handle(&mut self, message: Message) -> Result<(), ActorError> {
    ///         let Message::Apply { command, context, reply } = message;
    ///         self.revision += 1;
    ///         tracing::debug!(conversation = context.conversation, "applied");
    ///         // A caller that has gone away misses only the reply.
    ///         let _ = reply.send(Ok(CommandResult { id: command.id, ..CommandResult::default() }));
    ///         Ok(())
    ///     }
    /// }
    ///
    /// async fn load(host: Host) -> Result<(), BusError> {
    ///     let (mailbox, _) = host.spawn(Scene { revision: 0 }, 8);
    ///     host.route(&keys::SCENE_APPLY, 8, &mailbox, |command, context, reply| Message::Apply { command, context, reply })
    ///         .await
    /// }
    /// ```
    ///
    /// # Errors
    /// As in [`Host::serve`].
    pub async fn route<Q, R, M, F>(
        &self,
        row: &Request<Q, R>,
        capacity: usize,
        mailbox: &Mailbox<M>,
        message: F,
    ) -> Result<(), BusError>
    where
        Q: Message + Name + Default + 'static,
        R: Message + Name + 'static,
        M: Send + 'static,
        F: FnOnce(Q, Context, Reply<R>) -> M + Clone + Send + 'static,
    {
        let serving = self.bus().route(row, capacity, mailbox, message).await?;
        lock(&self.inner.serving).push(serving);
        Ok(())
    }

    /// Current health of this process.
    #[must_use]
    pub fn health(&self) -> Health {
        let counters = self.bus().counters();
        let loops = lock(&self.inner.loops).iter().map(WatchedLoop::health).collect::<Vec<_>>();
        let (answer_ms, answer_ms_p99) = counters.answer_ms();
        Health {
            role: self.role().to_owned(),
            instance: self.inner.args.instance.clone(),
            phase: (*self.inner.phase.borrow()).into(),
            pid: std::process::id(),
            uptime_ms: millis(self.inner.started.elapsed()),
            memory_bytes: resident_bytes(),
            actors: lock(&self.inner.actors).iter().map(|o| o.health()).chain(loops).collect(),
            refused: counters.refused(),
            dropped: counters.dropped(),
            answered: counters.answered(),
            version: self.inner.version.to_owned(),
            schema_hash: wire::SCHEMA_HASH.clone(),
            epoch: self.bus().epoch(),
            answer_ms,
            answer_ms_p99,
            rows: self.bus().row_health(),
            loading_steps: self.inner.loading.steps(),
        }
    }
}

/// Locks a list. Poisoning is ignored: each change is a single push or take.
pub(super) fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
