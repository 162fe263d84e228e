//! Machines that joined: which are there, what runs on them, what is asked of them.
//!
//! A node says every second that it is there and what it runs, and is answered. A node that is not answered for its lease
//! ends what it runs; a supervisor that hears nothing for the lease and a little more may therefore take all of that for
//! gone, whether or not it can be reached.

use std::collections::{HashMap, HashSet};
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;
use sg_proto::bus::Code;
use sg_proto::keys;
use sg_proto::launch::{Ended, JoinReply, JoinRequest, SignalRequest, StartReply, StartRequest, Variable};
use sg_runtime::bus::{Bus, Certificates, RemoteMachine, TlsListener};
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;
use tokio::sync::mpsc;

use crate::file::{LaunchFile, Node};
use crate::reconcile::{Event, Exit, ProcessId, Spawn};
use crate::suggestion::suggestion;

/// Beyond its lease: a node's clock begins when it speaks, ours when it is heard, and a kill takes a moment.
const MARGIN: Duration = Duration::from_secs(1);
/// How long a node may take to start a process, or to send a signal.
const ANSWER: Duration = Duration::from_secs(3);

/// A machine of the launch file.
#[derive(Debug)]
pub(super) struct KnownNode {
    lease: Duration,
    /// Of the life that has joined.
    joined: Option<Joined>,
}

#[derive(Debug)]
struct Joined {
    life: String,
    pid: u32,
    heard: Instant,
}

/// A process on another machine.
#[derive(Debug)]
pub(super) struct RemoteProcess {
    pub(super) node: String,
    pub(super) instance: String,
    /// Position of its service.
    pub(super) service: usize,
    /// Number of its start in the life of the node, once that has said so.
    number: Option<u64>,
}

/// What became of a start on another machine.
#[derive(Debug)]
pub(super) struct StartResult {
    id: ProcessId,
    outcome: Result<StartReply, Fault>,
}

/// The machines and what runs on them.
#[derive(Debug)]
pub(super) struct Nodes {
    known: HashMap<String, KnownNode>,
    pub(super) running: HashMap<ProcessId, RemoteProcess>,
    placed: mpsc::Sender<StartResult>,
}

/// Who may come in, from the launch file: each machine for the roles that it runs.
pub(super) fn listen(file: &LaunchFile) -> Option<TlsListener> {
    let listening = file.listen.as_ref()?;
    let guest = |node: &Node| RemoteMachine {
        name: node.name.clone(),
        roles: file.roles_on(&node.name).map(|s| s.role.clone()).collect(),
        instances: file.roles_on(&node.name).map(|s| format!("{}-", s.name)).collect(),
    };
    Some(TlsListener {
        endpoint: listening.endpoint.clone(),
        certificates: Certificates {
            authority: listening.authority.clone(),
            certificate: listening.certificate.clone(),
            key: listening.key.clone(),
        },
        machines: file.nodes.iter().map(guest).collect(),
    })
}

impl Nodes {
    pub(super) fn new(nodes: &[Node], placed: mpsc::Sender<StartResult>) -> Self {
        let known = nodes.iter().map(|n| (n.name.clone(), KnownNode { lease: n.lease, joined: None })).collect();
        Self { known, running: HashMap::new(), placed }
    }

    /// When the next lease runs out.
    pub(super) fn deadline(&self) -> Option<Instant> {
        let ends = |k: &KnownNode| k.joined.as_ref().map(|j| j.heard + k.lease + MARGIN);
        self.known.values().filter_map(ends).min()
    }

    /// Machines whose lease has run out; what they ran is over.
    pub(super) fn expired(&mut self, now: Instant) -> Vec<String> {
        let mut away = Vec::new();
        for (name, known) in &mut self.known {
            if known.joined.as_ref().is_some_and(|j| j.heard + known.lease + MARGIN <= now) {
                known.joined = None;
                away.push(name.clone());
            }
        }
        for name in &away {
            self.running.retain(|_, process| process.node != *name);
        }
        away.sort();
        away
    }

    /// A machine speaks: what is answered and what follows from what it said.
    pub(super) fn handle_join(
        &mut self,
        request: &JoinRequest,
        now: Instant,
    ) -> Result<(JoinReply, Vec<Event>), Fault> {
        let names: Vec<_> = self.known.keys().cloned().collect();
        let known = self.known.get_mut(&request.node).ok_or_else(|| {
            let hint = suggestion(&request.node, names.iter().map(String::as_str));
            Fault::not_found(format!("the launch file has no `[node.{}]`{hint}", request.node))
        })?;
        let mut events = Vec::new();
        match &mut known.joined {
            Some(joined) if joined.life == request.life => joined.heard = now,
            Some(joined) => {
                return Err(Fault::precondition(format!(
                    "node `{}` has joined already (process {}); it is taken for gone {} s after its last word",
                    request.node,
                    joined.pid,
                    (known.lease + MARGIN).as_secs()
                )));
            }
            None => {
                known.joined = Some(Joined { life: request.life.clone(), pid: request.pid, heard: now });
                events.push(Event::Node { name: request.node.clone(), present: true });
            }
        }
        let lease_ms = u64::try_from(known.lease.as_millis()).unwrap_or(u64::MAX);
        events.extend(request.ended.iter().filter_map(|ended| self.ended(&request.node, ended)));
        let running: HashSet<&str> = request.running.iter().map(String::as_str).collect();
        // What it has accepted to start and does not run any more, without having said how it ended.
        let is_gone = |p: &RemoteProcess| {
            p.node == request.node
                && p.number.is_some_and(|n| n <= request.starts)
                && !running.contains(p.instance.as_str())
        };
        let gone: Vec<_> = self.running.iter().filter(|(_, p)| is_gone(p)).map(|(id, _)| *id).collect();
        for id in gone {
            self.running.remove(&id);
            let exit = Exit { status: None, reason: format!("node `{}` runs it no more", request.node) };
            events.push(Event::Exited { id, exit });
        }
        let ours: HashSet<&str> =
            self.running.values().filter(|p| p.node == request.node).map(|p| p.instance.as_str()).collect();
        let strays = running.into_iter().filter(|i| !ours.contains(i)).map(str::to_owned).collect();
        Ok((JoinReply { lease_ms, strays }, events))
    }

    fn ended(&mut self, node: &str, ended: &Ended) -> Option<Event> {
        let is = |p: &RemoteProcess| p.node == node && p.instance == ended.instance;
        let id = self.running.iter().find(|(_, p)| is(p)).map(|(id, _)| *id)?;
        self.running.remove(&id);
        let exit = Exit { status: ended.exited.then_some(ended.status), reason: ended.reason.clone() };
        Some(Event::Exited { id, exit })
    }

    /// Asks a machine to start a process; [`Self::start_finished`] takes what becomes of it.
    pub(super) fn start(&mut self, bus: &Bus, node: String, spawn: &Spawn) {
        let away = RemoteProcess {
            node: node.clone(),
            instance: spawn.instance.clone(),
            service: spawn.service,
            number: None,
        };
        self.running.insert(spawn.id, away);
        let request = StartRequest {
            instance: spawn.instance.clone(),
            role: spawn.role.clone(),
            exec: spawn.start.exec.clone(),
            params: serde_json::Value::Object(spawn.start.params.clone()).to_string(),
            env: spawn.start.env.iter().map(|(n, v)| Variable { name: n.clone(), value: v.clone() }).collect(),
            epoch: spawn.epoch,
            standby: spawn.standby,
            stop_ms: u64::try_from(spawn.stop.as_millis()).unwrap_or(u64::MAX),
        };
        let (bus, placed, id) = (bus.clone(), self.placed.clone(), spawn.id);
        tokio::spawn(async move {
            let context = Context::root().deadline_in(ANSWER);
            let under = keys::instance(&keys::node_instance(&node));
            let outcome = bus.ask_role(&keys::NODE_START, &under, &request, &context).await;
            // Without a supervisor nobody wants to know.
            let _ = placed.send(StartResult { id, outcome }).await;
        });
    }

    /// What became of a start.
    pub(super) fn start_finished(&mut self, placed: StartResult) -> Event {
        let StartResult { id, outcome } = placed;
        match outcome {
            Ok(reply) => {
                if let Some(process) = self.running.get_mut(&id) {
                    process.number = Some(reply.number);
                }
                Event::Started { id, pid: reply.pid }
            }
            Err(fault) => {
                // Should it run all the same, the machine is told to end it when it next says so.
                let node = self.running.remove(&id).map(|p| p.node).unwrap_or_default();
                let status = (fault.code == Code::NotFound).then_some(i32::from(sg_runtime::process::EXIT_INPUT));
                let reason = format!("node `{node}` did not start it: {}", fault.message);
                Event::Exited { id, exit: Exit { status, reason } }
            }
        }
    }

    /// Sends a signal to a process of another machine, if it is one.
    pub(super) fn signal(&self, bus: &Bus, id: ProcessId, signal: Signal) -> bool {
        let Some(process) = self.running.get(&id) else { return false };
        let request = SignalRequest { instance: process.instance.clone(), kill: signal == Signal::SIGKILL };
        let under = keys::instance(&keys::node_instance(&process.node));
        let bus = bus.clone();
        tokio::spawn(async move {
            let context = Context::root().deadline_in(ANSWER);
            // Whether it arrived shows in what the machine runs next.
            let _ = bus.ask_role(&keys::NODE_SIGNAL, &under, &request, &context).await;
        });
        true
    }

    pub(super) fn runs(&self, instance: &str) -> bool {
        self.running.values().any(|p| p.instance == instance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn nodes() -> (Nodes, mpsc::Receiver<StartResult>) {
        let (placed, receiver) = mpsc::channel(4);
        let node = Node { name: "gpu1".into(), lease: Duration::from_secs(5) };
        (Nodes::new(&[node], placed), receiver)
    }

    fn request(life: &str, starts: u64, running: &[&str]) -> JoinRequest {
        JoinRequest {
            node: "gpu1".into(),
            life: life.into(),
            starts,
            running: running.iter().map(|r| (*r).to_owned()).collect(),
            ..JoinRequest::default()
        }
    }

    fn run(nodes: &mut Nodes, id: u64, instance: &str, number: Option<u64>) {
        let away = RemoteProcess { node: "gpu1".into(), instance: instance.into(), service: 0, number };
        nodes.running.insert(ProcessId(id), away);
    }

    #[test]
    fn a_machine_joins_lives_by_its_lease_and_is_taken_for_gone() {
        let (mut nodes, _placed) = nodes();
        let began = Instant::now();
        assert!(nodes.handle_join(&JoinRequest { node: "gpu2".into(), ..JoinRequest::default() }, began).is_err());
        assert_eq!(nodes.deadline(), None);
        let (reply, events) = nodes.handle_join(&request("a", 0, &[]), began).unwrap();
        assert_eq!((reply.lease_ms, events), (5000, vec![Event::Node { name: "gpu1".into(), present: true }]));
        let later = began + Duration::from_secs(4);
        assert_eq!(nodes.handle_join(&request("b", 0, &[]), later).unwrap_err().code, Code::FailedPrecondition);
        assert_eq!(nodes.handle_join(&request("a", 0, &[]), later).unwrap().1, []);
        run(&mut nodes, 1, "view-1", Some(1));
        assert!(nodes.expired(later + Duration::from_millis(5900)).is_empty());
        assert_eq!(nodes.expired(later + Duration::from_secs(6)), ["gpu1"]);
        assert!(nodes.running.is_empty());
        assert!(nodes.handle_join(&request("b", 0, &[]), later + Duration::from_secs(7)).is_ok());
    }

    #[test]
    fn what_a_machine_runs_is_what_it_says_it_runs() {
        let (mut nodes, _placed) = nodes();
        let now = Instant::now();
        run(&mut nodes, 1, "view-1", Some(1));
        run(&mut nodes, 2, "view-2", Some(2));
        run(&mut nodes, 3, "view-3", None);
        // It speaks of its first start only: of the second it could not know.
        let (reply, events) = nodes.handle_join(&request("a", 1, &["other-1"]), now).unwrap();
        assert_eq!(reply.strays, ["other-1"]);
        let gone: Vec<_> =
            events.iter().filter_map(|e| if let Event::Exited { id, .. } = e { Some(id.0) } else { None }).collect();
        assert_eq!(gone, [1]);
        let ended = Ended { instance: "view-2".into(), exited: true, status: 2, reason: "bad input".into() };
        let (_, events) =
            nodes.handle_join(&JoinRequest { ended: vec![ended], ..request("a", 2, &["view-3"]) }, now).unwrap();
        let exit = Exit { status: Some(2), reason: "bad input".into() };
        assert_eq!(events, [Event::Exited { id: ProcessId(2), exit }]);
        assert!(nodes.runs("view-3") && !nodes.runs("view-2"));
    }

    #[test]
    fn a_start_that_was_refused_is_over() {
        let (mut nodes, _placed) = nodes();
        run(&mut nodes, 7, "view-1", None);
        let fault = Fault::not_found("no such executable");
        let event = nodes.start_finished(StartResult { id: ProcessId(7), outcome: Err(fault) });
        let Event::Exited { exit, .. } = event else { panic!("{event:?}") };
        assert_eq!(exit.status, Some(2), "starting it again would not help");
        assert!(nodes.running.is_empty());
    }
}
