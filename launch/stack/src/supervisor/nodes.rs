//! Nodes: their leases, their processes, and requests to them.
//!
//! A node reports once a second and is answered. Without an answer for its lease, it ends its processes. Without a
//! report for the lease and a margin, the supervisor takes these processes for ended, reachable or not.

use std::collections::{BTreeSet, HashMap, HashSet};
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;
use sg_proto::bus::Code;
use sg_proto::keys::{self, Identity};
use sg_proto::launch::{Ended, JoinReply, JoinRequest, SignalRequest, StartReply, StartRequest, Variable};
use sg_runtime::bus::{Bus, Certificates, RemoteMachine, RemoteService, TlsListener};
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;
use tokio::sync::mpsc;

use crate::file::{LaunchFile, Node, Service};
use crate::reconcile::{Event, Exit, ProcessId, Spawn};
use crate::suggestion::suggestion;

/// Time beyond the lease. A node counts from its report, the supervisor from the receipt, and a kill takes a moment.
const MARGIN: Duration = Duration::from_secs(1);
/// How long a node may take to start or signal a process.
const ANSWER: Duration = Duration::from_secs(3);

/// A node of the launch file.
#[derive(Debug)]
pub(super) struct KnownNode {
    lease: Duration,
    /// The joined process, if there is one.
    joined: Option<Joined>,
}

#[derive(Debug)]
struct Joined {
    process_id: String,
    pid: u32,
    last_report: Instant,
}

/// A process on a node.
#[derive(Debug)]
pub(super) struct RemoteProcess {
    pub(super) node: String,
    pub(super) instance: String,
    /// Position of its service.
    pub(super) service: usize,
    /// Number of its start, once the node has reported it.
    number: Option<u64>,
    /// Time of the first request to kill it.
    killed: Option<Instant>,
}

/// Result of a start on a node.
#[derive(Debug)]
pub(super) struct StartResult {
    id: ProcessId,
    outcome: Result<StartReply, Fault>,
}

/// All nodes and their processes.
#[derive(Debug)]
pub(super) struct Nodes {
    known: HashMap<String, KnownNode>,
    pub(super) running: HashMap<ProcessId, RemoteProcess>,
    placed: mpsc::Sender<StartResult>,
    /// Nodes whose certificates are refused.
    revoked: BTreeSet<String>,
}

/// Access rules of the bus: each node may hold the roles of its services, unless its certificate is revoked.
pub(super) fn listen(file: &LaunchFile) -> Option<TlsListener> {
    listen_without(file, &file.listen.as_ref()?.revoked)
}

/// [`listen`] with these machines refused instead of the revoked ones.
pub(super) fn listen_without(file: &LaunchFile, refused: &BTreeSet<String>) -> Option<TlsListener> {
    let listening = file.listen.as_ref()?;
    let service = |s: &Service| RemoteService { name: s.name.clone(), role: s.role.clone() };
    let machine = |node: &Node| RemoteMachine {
        name: node.name.clone(),
        services: file.roles_on(&node.name).map(service).collect(),
    };
    Some(TlsListener {
        endpoint: listening.endpoint.clone(),
        certificates: Certificates {
            authority: listening.authority.clone(),
            certificate: listening.certificate.clone(),
            key: listening.key.clone(),
        },
        machines: file.nodes.iter().filter(|n| !refused.contains(&n.name)).map(machine).collect(),
    })
}

/// Machines of a launch file whose certificates are revoked.
pub(super) fn revoked(file: &LaunchFile) -> BTreeSet<String> {
    let listed = file.listen.iter().flat_map(|listening| &listening.revoked);
    listed.filter(|name| file.nodes.iter().any(|n| n.name == **name)).cloned().collect()
}

impl Nodes {
    pub(super) fn new(nodes: &[Node], revoked: BTreeSet<String>, placed: mpsc::Sender<StartResult>) -> Self {
        let known = nodes.iter().map(|n| (n.name.clone(), KnownNode { lease: n.lease, joined: None })).collect();
        Self { known, running: HashMap::new(), placed, revoked }
    }

    /// Refuses these nodes from now on. Returns an event for each of them that had joined.
    ///
    /// Their processes count as ended: the router passes none of their messages any more.
    pub(super) fn revoke(&mut self, revoked: BTreeSet<String>) -> Vec<Event> {
        let mut events = Vec::new();
        for name in &revoked {
            if self.known.get_mut(name).and_then(|known| known.joined.take()).is_some() {
                events.push(Event::Node { name: name.clone(), present: false });
            }
            self.running.retain(|_, process| process.node != *name);
        }
        self.revoked = revoked;
        events
    }

    /// End of the next lease.
    pub(super) fn deadline(&self) -> Option<Instant> {
        let ends = |k: &KnownNode| k.joined.as_ref().map(|j| j.last_report + k.lease + MARGIN);
        let killed = self.running.values().filter_map(|p| self.end_of_killed(p));
        self.known.values().filter_map(ends).chain(killed).min()
    }

    /// Time at which a killed process counts as ended, whatever its node says.
    fn end_of_killed(&self, process: &RemoteProcess) -> Option<Instant> {
        let lease = self.known.get(&process.node).map_or(Duration::ZERO, |k| k.lease);
        process.killed.map(|at| at + lease + MARGIN)
    }

    /// Removes killed processes that their node does not end. Epochs refuse their messages.
    pub(super) fn overdue(&mut self, now: Instant) -> Vec<Event> {
        let is_over = |p: &RemoteProcess| self.end_of_killed(p).is_some_and(|end| end <= now);
        let mut over: Vec<_> = self.running.iter().filter(|(_, p)| is_over(p)).map(|(id, _)| *id).collect();
        over.sort_unstable();
        let ended = |id| {
            let node = self.running.remove(&id).map(|p| p.node).unwrap_or_default();
            let exit = Exit { status: None, reason: format!("node `{node}` did not end it in time") };
            Event::Exited { id, exit }
        };
        over.into_iter().map(ended).collect()
    }

    /// Removes nodes whose lease has run out, with their processes. Returns their names.
    pub(super) fn expired(&mut self, now: Instant) -> Vec<String> {
        let mut away = Vec::new();
        for (name, known) in &mut self.known {
            if known.joined.as_ref().is_some_and(|j| j.last_report + known.lease + MARGIN <= now) {
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

    /// Handles a report: the answer, and the events that follow. `sender` is the node of the certificate.
    pub(super) fn handle_join(
        &mut self,
        request: &JoinRequest,
        sender: Option<&Identity>,
        now: Instant,
    ) -> Result<(JoinReply, Vec<Event>), Fault> {
        if sender.is_none_or(|s| s.node != request.node) {
            let certified = sender.map_or("of no node".to_owned(), |s| format!("of node `{}`", s.node));
            return Err(Fault::new(
                Code::PermissionDenied,
                format!("a machine with the certificate {certified} cannot join as `{}`", request.node.escape_debug()),
            ));
        }
        if self.revoked.contains(&request.node) {
            let text = format!("the certificate of node `{}` has been revoked", request.node);
            return Err(Fault::new(Code::PermissionDenied, text));
        }
        let names: Vec<_> = self.known.keys().cloned().collect();
        let known = self.known.get_mut(&request.node).ok_or_else(|| {
            let hint = suggestion(&request.node, names.iter().map(String::as_str));
            Fault::not_found(format!("the launch file has no `[node.{}]`{hint}", request.node))
        })?;
        let mut events = Vec::new();
        match &mut known.joined {
            Some(joined) if joined.process_id == request.process_id => joined.last_report = now,
            Some(joined) => {
                return Err(Fault::precondition(format!(
                    "node `{}` has joined already (process {}); its lease ends {} s after its last report",
                    request.node,
                    joined.pid,
                    (known.lease + MARGIN).as_secs()
                )));
            }
            None => {
                known.joined =
                    Some(Joined { process_id: request.process_id.clone(), pid: request.pid, last_report: now });
                events.push(Event::Node { name: request.node.clone(), present: true });
            }
        }
        let lease_ms = u64::try_from(known.lease.as_millis()).unwrap_or(u64::MAX);
        events.extend(request.ended.iter().filter_map(|ended| self.ended(&request.node, ended)));
        let running: HashSet<&str> = request.running.iter().map(String::as_str).collect();
        // Processes that the node has started and no longer runs, without a reported end.
        let is_gone = |p: &RemoteProcess| {
            p.node == request.node
                && p.number.is_some_and(|n| n <= request.starts)
                && !running.contains(p.instance.as_str())
        };
        let gone: Vec<_> = self.running.iter().filter(|(_, p)| is_gone(p)).map(|(id, _)| *id).collect();
        for id in gone {
            self.running.remove(&id);
            let exit = Exit { status: None, reason: format!("node `{}` no longer runs it", request.node) };
            events.push(Event::Exited { id, exit });
        }
        let ours: HashSet<&str> =
            self.running.values().filter(|p| p.node == request.node).map(|p| p.instance.as_str()).collect();
        let unknown_instances = running.into_iter().filter(|i| !ours.contains(i)).map(str::to_owned).collect();
        Ok((JoinReply { lease_ms, unknown_instances }, events))
    }

    fn ended(&mut self, node: &str, ended: &Ended) -> Option<Event> {
        let is = |p: &RemoteProcess| p.node == node && p.instance == ended.instance;
        let id = self.running.iter().find(|(_, p)| is(p)).map(|(id, _)| *id)?;
        self.running.remove(&id);
        let exit = Exit { status: ended.exited.then_some(ended.status), reason: ended.reason.clone() };
        Some(Event::Exited { id, exit })
    }

    /// Asks a node to start a process. [`Self::start_finished`] takes the result.
    pub(super) fn start(&mut self, bus: &Bus, node: String, spawn: &Spawn) {
        let away = RemoteProcess {
            node: node.clone(),
            instance: spawn.instance.clone(),
            service: spawn.service,
            number: None,
            killed: None,
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
            // Without a supervisor the result is of no use.
            let _ = placed.send(StartResult { id, outcome }).await;
        });
    }

    /// Handles the result of a start.
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
                // If it runs all the same, the answer to the node's next report ends it.
                let node = self.running.remove(&id).map(|p| p.node).unwrap_or_default();
                let status = (fault.code == Code::NotFound).then_some(i32::from(sg_runtime::process::EXIT_INPUT));
                let reason = format!("node `{node}` did not start it: {}", fault.message);
                Event::Exited { id, exit: Exit { status, reason } }
            }
        }
    }

    /// Sends a signal to a process of a node, at a time of the supervisor's clock. Returns whether there is one.
    pub(super) fn signal(&mut self, bus: &Bus, id: ProcessId, signal: Signal, now: Instant) -> bool {
        let Some(process) = self.running.get_mut(&id) else { return false };
        if signal == Signal::SIGKILL {
            process.killed.get_or_insert(now);
        }
        let request = SignalRequest { instance: process.instance.clone(), kill: signal == Signal::SIGKILL };
        let under = keys::instance(&keys::node_instance(&process.node));
        let bus = bus.clone();
        tokio::spawn(async move {
            let context = Context::root().deadline_in(ANSWER);
            // The next report shows whether the signal arrived.
            let _ = bus.ask_role(&keys::NODE_SIGNAL, &under, &request, &context).await;
        });
        true
    }

    /// Whether a message about an instance comes from the machine that runs it.
    ///
    /// A process of a node speaks for itself alone. A process of this machine cannot speak for one of a node.
    pub(super) fn confirms(&self, sender: Option<&Identity>, instance: &str) -> bool {
        let node = self.node_of(instance);
        match sender {
            Some(sender) => sender.instance == instance && node == Some(&sender.node),
            None => node.is_none(),
        }
    }

    /// Node that runs an instance.
    pub(super) fn node_of(&self, instance: &str) -> Option<&str> {
        self.running.values().find(|p| p.instance == instance).map(|p| p.node.as_str())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn nodes() -> (Nodes, mpsc::Receiver<StartResult>) {
        let (placed, receiver) = mpsc::channel(4);
        let node = Node { name: "gpu1".into(), lease: Duration::from_secs(5) };
        (Nodes::new(&[node], BTreeSet::new(), placed), receiver)
    }

    fn request(process_id: &str, starts: u64, running: &[&str]) -> JoinRequest {
        JoinRequest {
            node: "gpu1".into(),
            process_id: process_id.into(),
            starts,
            running: running.iter().map(|r| (*r).to_owned()).collect(),
            ..JoinRequest::default()
        }
    }

    fn gpu1(instance: &str) -> Identity {
        Identity { node: "gpu1".into(), role: "render-view".into(), instance: instance.into() }
    }

    /// A report of the node that the certificate names.
    fn join(nodes: &mut Nodes, request: &JoinRequest, now: Instant) -> Result<(JoinReply, Vec<Event>), Fault> {
        nodes.handle_join(request, Some(&gpu1("node:gpu1")), now)
    }

    fn run(nodes: &mut Nodes, id: u64, instance: &str, number: Option<u64>) {
        let away = RemoteProcess { node: "gpu1".into(), instance: instance.into(), service: 0, number, killed: None };
        nodes.running.insert(ProcessId(id), away);
    }

    #[test]
    fn a_machine_joins_under_the_name_in_its_certificate_only() {
        let (mut nodes, _placed) = nodes();
        let now = Instant::now();
        let gpu2 = Identity { node: "gpu2".into(), ..gpu1("node:gpu2") };
        for sender in [Some(&gpu2), None] {
            let refused = nodes.handle_join(&request("a", 0, &[]), sender, now).unwrap_err();
            assert_eq!(refused.code, Code::PermissionDenied, "{refused}");
        }
        assert_eq!(nodes.deadline(), None);
        assert!(join(&mut nodes, &request("a", 0, &[]), now).is_ok());
    }

    #[test]
    fn a_revoked_node_is_gone_at_once_and_does_not_come_back() {
        let (mut nodes, _placed) = nodes();
        let now = Instant::now();
        join(&mut nodes, &request("a", 0, &[]), now).unwrap();
        run(&mut nodes, 1, "view.1", Some(1));
        let gone = Event::Node { name: "gpu1".into(), present: false };
        assert_eq!(nodes.revoke(BTreeSet::from(["gpu1".into()])), [gone]);
        assert!(nodes.node_of("view.1").is_none());
        let refused = join(&mut nodes, &request("a", 0, &[]), now).unwrap_err();
        assert!(refused.code == Code::PermissionDenied && refused.message.contains("revoked"), "{refused}");
        assert_eq!(nodes.revoke(BTreeSet::new()), []);
        assert!(join(&mut nodes, &request("a", 0, &[]), now).is_ok());
    }

    #[test]
    fn a_process_speaks_for_itself_only() {
        let (mut nodes, _placed) = nodes();
        run(&mut nodes, 1, "view.1", Some(1));
        assert!(nodes.confirms(Some(&gpu1("view.1")), "view.1"));
        assert!(!nodes.confirms(Some(&gpu1("view.2")), "view.1"), "another instance of the node");
        assert!(!nodes.confirms(Some(&gpu1("scene.1")), "scene.1"), "an instance of the supervisor's machine");
        assert!(!nodes.confirms(Some(&gpu1("view.1")), "scene.1"));
        let gpu2 = Identity { node: "gpu2".into(), ..gpu1("view.1") };
        assert!(!nodes.confirms(Some(&gpu2), "view.1"), "another node");
        assert!(nodes.confirms(None, "scene.1") && !nodes.confirms(None, "view.1"));
    }

    #[test]
    fn node_joins_and_expires_after_its_lease() {
        let (mut nodes, _placed) = nodes();
        let began = Instant::now();
        assert!(join(&mut nodes, &JoinRequest { node: "gpu2".into(), ..JoinRequest::default() }, began).is_err());
        assert_eq!(nodes.deadline(), None);
        let (reply, events) = join(&mut nodes, &request("a", 0, &[]), began).unwrap();
        assert_eq!((reply.lease_ms, events), (5000, vec![Event::Node { name: "gpu1".into(), present: true }]));
        let later = began + Duration::from_secs(4);
        assert_eq!(join(&mut nodes, &request("b", 0, &[]), later).unwrap_err().code, Code::FailedPrecondition);
        assert_eq!(join(&mut nodes, &request("a", 0, &[]), later).unwrap().1, []);
        run(&mut nodes, 1, "view-1", Some(1));
        assert!(nodes.expired(later + Duration::from_millis(5900)).is_empty());
        assert_eq!(nodes.expired(later + Duration::from_secs(6)), ["gpu1"]);
        assert!(nodes.running.is_empty());
        assert!(join(&mut nodes, &request("b", 0, &[]), later + Duration::from_secs(7)).is_ok());
    }

    #[test]
    fn a_killed_process_ends_even_if_its_node_denies_it() {
        let (mut nodes, _placed) = nodes();
        let began = Instant::now();
        join(&mut nodes, &request("a", 0, &[]), began).unwrap();
        run(&mut nodes, 1, "view.1", Some(1));
        nodes.running.get_mut(&ProcessId(1)).unwrap().killed = Some(began);
        let later = began + Duration::from_millis(5900);
        assert_eq!(join(&mut nodes, &request("a", 1, &["view.1"]), later).unwrap().1, []);
        assert!(nodes.overdue(later).is_empty());
        assert_eq!(nodes.deadline(), Some(began + Duration::from_secs(6)));
        let overdue = nodes.overdue(began + Duration::from_secs(6));
        let [Event::Exited { id, exit }] = overdue.as_slice() else { panic!("{overdue:?}") };
        assert_eq!((id.0, exit.reason.as_str()), (1, "node `gpu1` did not end it in time"));
        assert!(nodes.node_of("view.1").is_none());
    }

    #[test]
    fn node_reports_decide_what_runs() {
        let (mut nodes, _placed) = nodes();
        let now = Instant::now();
        run(&mut nodes, 1, "view-1", Some(1));
        run(&mut nodes, 2, "view-2", Some(2));
        run(&mut nodes, 3, "view-3", None);
        // The report covers the first start only. The second is still unknown to the node.
        let (reply, events) = join(&mut nodes, &request("a", 1, &["other-1"]), now).unwrap();
        assert_eq!(reply.unknown_instances, ["other-1"]);
        let gone: Vec<_> =
            events.iter().filter_map(|e| if let Event::Exited { id, .. } = e { Some(id.0) } else { None }).collect();
        assert_eq!(gone, [1]);
        let ended = Ended { instance: "view-2".into(), exited: true, status: 2, reason: "bad input".into() };
        let (_, events) =
            join(&mut nodes, &JoinRequest { ended: vec![ended], ..request("a", 2, &["view-3"]) }, now).unwrap();
        let exit = Exit { status: Some(2), reason: "bad input".into() };
        assert_eq!(events, [Event::Exited { id: ProcessId(2), exit }]);
        assert!(nodes.node_of("view-3").is_some() && nodes.node_of("view-2").is_none());
    }

    #[test]
    fn refused_start_is_an_exit() {
        let (mut nodes, _placed) = nodes();
        run(&mut nodes, 7, "view-1", None);
        let fault = Fault::not_found("no such executable");
        let event = nodes.start_finished(StartResult { id: ProcessId(7), outcome: Err(fault) });
        let Event::Exited { exit, .. } = event else { panic!("{event:?}") };
        assert_eq!(exit.status, Some(2), "starting it again would not help");
        assert!(nodes.running.is_empty());
    }
}
