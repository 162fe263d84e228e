//! What people ask of a supervisor, over the bus or in the same process.

use std::path::PathBuf;
use std::time::Instant;

use sg_launch::document::suggestion;
use sg_launch::file::Start;
use sg_launch::reconcile::Event;
use sg_proto::bus::MetricsReply;
use sg_proto::keys;
use sg_proto::launch::{
    DownReply, JoinReply, JoinRequest, OpenReply, OpenRequest, PsReply, ReloadReply, ReloadRequest, RestartReply,
    Service as ServiceMessage, SwapReply, SwapRequest,
};
use sg_runtime::bus::{Bus, Serving};
use sg_runtime::fault::Fault;
use sg_runtime::metrics;
use tokio::sync::{mpsc, oneshot};

use super::{CAPACITY, Supervisor, nodes};
use crate::terminal::Failure;
use crate::up;

pub(super) enum Request {
    Ps(oneshot::Sender<PsReply>),
    Restart(String, oneshot::Sender<Result<RestartReply, Fault>>),
    Swap(SwapRequest, oneshot::Sender<Result<SwapReply, Fault>>),
    Reload(ReloadRequest, oneshot::Sender<Result<ReloadReply, Fault>>),
    Join(JoinRequest, oneshot::Sender<Result<JoinReply, Fault>>),
    Open(OpenRequest, oneshot::Sender<Result<OpenReply, Fault>>),
    Down,
}

/// A way to speak to a supervisor in the same process.
#[derive(Debug, Clone)]
pub(crate) struct Handle(pub(super) mpsc::Sender<Request>);

impl Handle {
    /// Begins an orderly stop.
    pub(crate) async fn down(&self) {
        // A supervisor that no longer listens is stopping.
        let _ = self.0.send(Request::Down).await;
    }
}

impl Supervisor {
    /// Answers a request; what follows from it, in order.
    pub(super) fn answer(&mut self, request: Request) -> Vec<Event> {
        let event = match request {
            Request::Ps(reply) => {
                let ps = PsReply {
                    session: self.stack.session.name().to_owned(),
                    launch_file: self.stack.path.display().to_string(),
                    pid: std::process::id(),
                    services: self.mind.services(self.now()),
                };
                // Whoever asked may have given up.
                let _ = reply.send(ps);
                Event::Tick
            }
            Request::Restart(name, reply) => {
                let known = self.known(&name);
                let event = known.as_ref().map_or(Event::Tick, |(service, _)| Event::Restart { service: *service });
                let pid = |(_, service): (usize, ServiceMessage)| RestartReply { old_pid: service.pid };
                let _ = reply.send(known.map(pid));
                event
            }
            Request::Swap(request, reply) => {
                let swap = self.swap(&request);
                let (number, event) = swap.map_or_else(|fault| (Err(fault), Event::Tick), |(n, event)| (Ok(n), event));
                let _ = reply.send(number.map(|number| SwapReply { number }));
                event
            }
            Request::Reload(request, reply) => {
                let reload = self.reload(&request);
                let (answer, event) =
                    reload.map_or_else(|fault| (Err(fault), Event::Tick), |(answer, event)| (Ok(answer), event));
                let _ = reply.send(answer);
                event
            }
            Request::Join(request, reply) => {
                let (answer, events) = match self.nodes.hear(&request, Instant::now()) {
                    Ok((answer, events)) => (Ok(answer), events),
                    Err(fault) => (Err(fault), Vec::new()),
                };
                if events.iter().any(|e| matches!(e, Event::Node { present: true, .. })) {
                    self.console.detail(format!("  node {} has joined, process {}", request.node, request.pid));
                }
                let _ = reply.send(answer);
                return events;
            }
            Request::Open(request, reply) => {
                let _ = reply.send(self.open_beside(&request));
                Event::Tick
            }
            Request::Down => Event::Down,
        };
        vec![event]
    }

    /// A service by name, if there is anything to be done about it.
    fn known(&self, name: &str) -> Result<(usize, ServiceMessage), Fault> {
        if self.mind.is_stopping() {
            return Err(Fault::precondition("the stack is stopping"));
        }
        let known = self.mind.kept(name).and_then(|(index, _)| Some((index, self.mind.service(index, self.now())?)));
        known.ok_or_else(|| {
            let services = self.mind.services(self.now());
            let hint = suggestion(name, services.iter().map(|s| s.name.as_str()));
            Fault::not_found(format!("no service `{name}`{hint}"))
        })
    }

    /// What a swap that is asked for comes to: its number and its event.
    fn swap(&self, request: &SwapRequest) -> Result<(u64, Event), Fault> {
        let (service, _) = self.known(&request.service)?;
        let (_, kept) = self.mind.kept(&request.service).ok_or_else(|| Fault::not_found("it is gone"))?;
        let params = match request.params.as_str() {
            "" => kept.start.params.clone(),
            text => serde_json::from_str(text).map_err(|e| Fault::invalid(format!("parameters: {e}")))?,
        };
        let executable = PathBuf::from(&request.executable);
        match &kept.start.node {
            None if !executable.is_absolute() => {
                return Err(Fault::invalid(format!("executable `{}` must be an absolute path", request.executable)));
            }
            Some(node) if request.executable.contains('/') => {
                return Err(Fault::invalid(format!(
                    "`{}` runs on node `{node}`: name its executable without a path, it is looked for there",
                    request.service
                )));
            }
            _ => {}
        }
        let Start { env, node, .. } = kept.start.clone();
        let start = Start { exec: request.executable.clone(), executable, params, env, node };
        Ok((self.mind.next_swap(service), Event::Swap { service, start }))
    }

    /// What a launch file that is to be read again comes to: what is told of it and its event.
    fn reload(&mut self, request: &ReloadRequest) -> Result<(ReloadReply, Event), Fault> {
        if self.mind.is_stopping() {
            return Err(Fault::precondition("the stack is stopping"));
        }
        let path = PathBuf::from(&request.launch_file);
        let file = up::launch_file(&path, &request.overrides, &request.only).map_err(|f| Fault::invalid(f.text()))?;
        // Who may do what on the bus was settled when it was opened.
        if nodes::listen(&file) != nodes::listen(&self.stack.file) || file.nodes != self.stack.file.nodes {
            return Err(Fault::precondition(
                "what other machines run or may do has changed (`[bus]`, `[node.…]`, `on`); stop the stack and start it again",
            ));
        }
        let differences = self.mind.differences(&file.services);
        self.console.detail(format!("{}: read again", path.display()));
        self.stack.path = path;
        self.all_ready_told = true;
        Ok((ReloadReply { differences }, Event::Desire(file.services)))
    }
}

pub(super) async fn serve(bus: &Bus, requests: &mpsc::Sender<Request>) -> Result<Vec<Serving>, Failure> {
    let stopping = || Fault::unavailable("the supervisor is stopping");
    let sender = requests.clone();
    let ps = bus.serve(&keys::PS, CAPACITY, move |_, _| {
        let sender = sender.clone();
        async move {
            let (reply, answer) = oneshot::channel();
            sender.send(Request::Ps(reply)).await.map_err(|_| stopping())?;
            answer.await.map_err(|_| stopping())
        }
    });
    let sender = requests.clone();
    let restart = bus.serve(&keys::RESTART, CAPACITY, move |request, _| {
        let sender = sender.clone();
        async move {
            let (reply, answer) = oneshot::channel();
            sender.send(Request::Restart(request.service, reply)).await.map_err(|_| stopping())?;
            answer.await.map_err(|_| stopping())?
        }
    });
    let sender = requests.clone();
    let swap = bus.serve(&keys::SWAP, CAPACITY, move |request, _| {
        let sender = sender.clone();
        async move {
            let (reply, answer) = oneshot::channel();
            sender.send(Request::Swap(request, reply)).await.map_err(|_| stopping())?;
            answer.await.map_err(|_| stopping())?
        }
    });
    let sender = requests.clone();
    let reload = bus.serve(&keys::RELOAD, CAPACITY, move |request, _| {
        let sender = sender.clone();
        async move {
            let (reply, answer) = oneshot::channel();
            sender.send(Request::Reload(request, reply)).await.map_err(|_| stopping())?;
            answer.await.map_err(|_| stopping())?
        }
    });
    let sender = requests.clone();
    let join = bus.serve(&keys::JOIN, CAPACITY, move |request, _| {
        let sender = sender.clone();
        async move {
            let (reply, answer) = oneshot::channel();
            sender.send(Request::Join(request, reply)).await.map_err(|_| stopping())?;
            answer.await.map_err(|_| stopping())?
        }
    });
    let sender = requests.clone();
    let open = bus.serve(&keys::OPEN, CAPACITY, move |request, _| {
        let sender = sender.clone();
        async move {
            let (reply, answer) = oneshot::channel();
            sender.send(Request::Open(request, reply)).await.map_err(|_| stopping())?;
            answer.await.map_err(|_| stopping())?
        }
    });
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
        ps.await?,
        restart.await?,
        swap.await?,
        reload.await?,
        join.await?,
        open.await?,
        down.await?,
        metrics.await?,
    ])
}
