//! The lifecycle: connect, load, ready, serve, drain, stop.

use std::future::Future;
use std::panic::AssertUnwindSafe;
use std::process::ExitCode;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use sg_proto::bus::{Phase, PromoteReply, PromoteRequest, Ready};
use sg_proto::keys;
use sg_proto::limits::HEALTH_PERIOD;
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::{mpsc, watch};

use super::arguments::ServeArgs;
use super::host::{Host, Inner, lock};
use super::panics;
use super::start_error::{EXIT_FAILED, StartError};
use super::supervision::exit_with_supervisor;
use crate::actor::{Exit, millis};
use crate::blobs::Blobs;
use crate::bus::{Bus, LivelinessToken};
use crate::context::Context;
use crate::fault::Fault;
use crate::progress::Progress;
use crate::{metrics, telemetry, wire};

impl Host {
    /// Takes the role. Returns the elapsed time in milliseconds.
    async fn take_role(&self, request: &PromoteRequest) -> Result<(LivelinessToken, f64), StartError> {
        let start = Instant::now();
        let hooks = std::mem::take(&mut *lock(&self.inner.before_promotion));
        for hook in hooks {
            hook().await?;
        }
        self.bus().promote(request.epoch).await?;
        let alive = self.bus().declare_liveliness(&self.inner.args.instance).await?;
        self.announce().await?;
        Ok((alive, start.elapsed().as_secs_f64() * 1e3))
    }

    /// Announces that this process serves its role, or is in standby.
    async fn announce(&self) -> Result<(), Fault> {
        let standby = self.is_standby();
        let phase = if standby { Phase::Standby } else { Phase::Ready };
        self.inner.phase.send_replace(phase);
        let ready = self.announcement(standby);
        self.bus().publish(&keys::READY, &ready, &Context::root()).await?;
        tracing::info!(
            start_ms = ready.start_ms,
            epoch = ready.epoch,
            "{}",
            if standby { "in standby" } else { "ready" }
        );
        Ok(())
    }

    fn announcement(&self, standby: bool) -> Ready {
        Ready {
            role: self.role().to_owned(),
            instance: self.inner.args.instance.clone(),
            version: self.inner.version.to_owned(),
            schema_hash: wire::SCHEMA_HASH.clone(),
            pid: std::process::id(),
            start_ms: millis(self.inner.started.elapsed()),
            epoch: self.bus().epoch(),
            standby,
            declares: self.bus().declares().into_iter().map(str::to_owned).collect(),
        }
    }
}

/// Runs a process from its arguments to its exit status.
///
/// 1. Join the bus.
/// 2. Call `load`, which reads the input, starts actors and declares rows.
/// 3. Announce readiness and serve, until a request to stop or a failure.
/// 4. Drain: finish accepted requests, stop the actors, leave the bus.
///
/// The exit status is 0 after a request to stop, [`EXIT_INPUT`](super::EXIT_INPUT) for wrong parameters or input, and
/// [`EXIT_FAILED`] for other failures.
pub fn run<F, Fut>(mut args: ServeArgs, version: &'static str, load: F) -> ExitCode
where
    F: FnOnce(Host) -> Fut,
    Fut: Future<Output = Result<(), StartError>>,
{
    telemetry::init_service(&args.role);
    metrics::install(&args.role, &args.instance);
    if let Some(supervisor) = args.supervisor_pid {
        exit_with_supervisor(supervisor);
    }
    if let Err(error) = args.read_params() {
        tracing::error!("{error}");
        return error.into();
    }
    let panicked = panics::report();
    // A panic on this thread, such as one while loading, ends the process as every other one.
    let ended = std::panic::catch_unwind(AssertUnwindSafe(|| block_on(lifecycle(args, version, load, panicked))));
    match ended {
        Ok(Ok(Ok(()))) => ExitCode::SUCCESS,
        Ok(Ok(Err(error))) => {
            tracing::error!("{error}");
            error.into()
        }
        Ok(Err(error)) => {
            tracing::error!("the async runtime could not be started: {error}");
            ExitCode::from(EXIT_FAILED)
        }
        Err(_) => {
            tracing::error!("{}", panics::first().unwrap_or_else(|| "panicked".to_owned()));
            ExitCode::from(EXIT_FAILED)
        }
    }
}

/// Runs a future on a new multi-threaded runtime. The bus needs several threads.
///
/// # Errors
/// The threads could not be started.
pub fn block_on<F: Future>(future: F) -> std::io::Result<F::Output> {
    // Two threads suffice for messages; services compute in rayon's pool.
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build()?;
    let output = runtime.block_on(future);
    runtime.shutdown_timeout(Duration::from_millis(500));
    Ok(output)
}

async fn lifecycle<F, Fut>(
    args: ServeArgs,
    version: &'static str,
    load: F,
    mut panicked: watch::Receiver<Option<String>>,
) -> Result<(), StartError>
where
    F: FnOnce(Host) -> Fut,
    Fut: Future<Output = Result<(), StartError>>,
{
    let started = Instant::now();
    let signal_error = |e: std::io::Error| StartError::Failed(format!("signals cannot be watched: {e}"));
    let mut terminate = signal(SignalKind::terminate()).map_err(signal_error)?;
    let mut interrupt = signal(SignalKind::interrupt()).map_err(signal_error)?;
    let supervised = args.supervisor_pid.is_some();
    let stop_signal = async move {
        loop {
            tokio::select! {
                _ = terminate.recv() => return,
                // Ctrl-C reaches all processes of the terminal. A supervised process waits for its supervisor's SIGTERM.
                _ = interrupt.recv() => if !supervised { return },
            }
        }
    };

    let ServeArgs { session, role, instance, epoch, standby, .. } = &args;
    let bus = Bus::connect_instance(session, role, instance, *epoch, *standby, args.link()).await?;
    // A folder for each process, so that the supervisor can clear those of dead ones.
    let blobs =
        Blobs::open(&args.run_dir.join("blobs").join(&args.instance)).map_err(|e| StartError::Failed(e.to_string()))?;
    let grace = Duration::from_millis(args.grace_ms);
    let (exits, mut exited) = mpsc::channel(16);
    let (promotions, mut granted) = mpsc::channel(1);
    let (failures, mut failed) = mpsc::channel(1);
    let inner = Inner {
        args,
        version,
        started,
        bus,
        blobs,
        phase: watch::channel(Phase::Loading).0,
        serving: Mutex::default(),
        actors: Mutex::default(),
        exits,
        before_promotion: Mutex::default(),
        promotions,
        stop: tokio::sync::Notify::new(),
        failures,
        loading: Progress::default(),
        loops: Mutex::default(),
    };
    let host = Host { inner: Arc::new(inner) };
    let stopping = host.clone();
    let stop = async move {
        tokio::select! {
            () = stop_signal => (),
            () = stopping.inner.stop.notified() => (),
        }
    };
    tokio::pin!(stop);
    tokio::spawn(publish_health(host.clone()));
    host.serve_standard_requests().await?;

    let panic = async move {
        match panicked.wait_for(Option::is_some).await {
            Ok(text) => text.clone().unwrap_or_default(),
            // The hook stays for the life of the process.
            Err(_) => std::future::pending().await,
        }
    };
    tokio::pin!(panic);
    let loading = host.inner.loading.clone().scope(load(host.clone()));
    tokio::select! {
        outcome = loading => outcome?,
        () = &mut stop => return Ok(()),
        reason = &mut panic => return Err(StartError::Failed(reason)),
    }

    let mut ended_actors = 0;
    let mut describe_exit = |(name, exit): (&str, Exit)| {
        ended_actors = 1;
        match exit {
            Exit::Failed(reason) => format!("actor `{name}` failed: {reason}"),
            Exit::Finished => format!("actor `{name}` ended unexpectedly"),
        }
    };
    let mut alive = None;
    let failure = if host.is_standby() {
        host.announce().await?;
        tokio::select! {
            // A panic often ends an actor too. It tells more.
            biased;
            reason = &mut panic => Some(reason),
            () = &mut stop => return Ok(()),
            Some(exit) = exited.recv() => Some(describe_exit(exit)),
            Some(reason) = failed.recv() => Some(reason),
            Some((request, reply)) = granted.recv() => {
                let outcome = host.take_role(&request).await;
                let answer = match &outcome {
                    Ok((_, elapsed_ms)) => Ok(PromoteReply { elapsed_ms: *elapsed_ms }),
                    Err(error) => Err(Fault::internal(error.to_string())),
                };
                // The supervisor may have given up at its deadline. It then stops this process.
                let _ = reply.send(answer);
                alive = Some(outcome?.0);
                None
            }
        }
    } else {
        alive = Some(host.bus().declare_liveliness(&host.inner.args.instance).await?);
        host.announce().await?;
        None
    };
    let failure = match failure {
        Some(reason) => Some(reason),
        None => tokio::select! {
            biased;
            reason = &mut panic => Some(reason),
            () = &mut stop => None,
            Some(exit) = exited.recv() => Some(describe_exit(exit)),
            Some(reason) = failed.recv() => Some(reason),
        },
    };

    host.inner.phase.send_replace(Phase::Draining);
    drop(alive);
    let deadline = Instant::now() + grace;
    let serving = std::mem::take(&mut *lock(&host.inner.serving));
    let draining = serving.into_iter().map(|s| tokio::spawn(s.drain(grace)));
    for drained in draining.collect::<Vec<_>>() {
        let _ = drained.await;
    }
    let actors = lock(&host.inner.actors).clone();
    for actor in &actors {
        // Tasks from `load` may hold mailboxes until the runtime ends, so the actors are closed explicitly.
        actor.close();
    }
    for _ in ended_actors..actors.len() {
        if tokio::time::timeout_at(deadline.into(), exited.recv()).await.is_err() {
            break;
        }
    }
    host.inner.phase.send_replace(Phase::Stopped);
    host.bus().close().await;
    failure.map_or(Ok(()), |reason| Err(StartError::Failed(reason)))
}

/// Publishes the health of the process every period, with the progress of its actors and rows. It runs on the serving
/// threads, so a blocked process stops publishing.
///
/// A process in standby has no token, and its announcement may be lost with a connection. So it repeats the announcement.
async fn publish_health(host: Host) {
    let mut period = tokio::time::interval(HEALTH_PERIOD);
    period.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Skip);
    loop {
        period.tick().await;
        metrics::upkeep();
        let mut published = host.bus().publish(&keys::HEALTH, &host.health(), &Context::root()).await;
        if published.is_ok() && *host.inner.phase.borrow() == Phase::Standby {
            published = host.bus().publish(&keys::READY, &host.announcement(true), &Context::root()).await;
        }
        if let Err(fault) = published {
            tracing::debug!(%fault, "health could not be published");
            return;
        }
    }
}
