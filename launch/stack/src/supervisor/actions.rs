//! Doing what the reconciler wants: processes, signals, proofs, promotions.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use nix::sys::signal::Signal;
use sg_proto::bus::PromoteRequest;
use sg_proto::keys;
use sg_runtime::bus::Link;
use sg_runtime::context::Context;

use super::event_loop::Supervisor;
use crate::console::{self, ServiceLog};
use crate::log_file::{self, LogFile};
use crate::probe;
use crate::reconcile::{Action, Event, Exit, Incarnation, Spawn};
use crate::serve_arguments::Serving;
use crate::spawn::{self, Order};

impl Supervisor {
    /// Does what is wanted; what comes of it at once is returned.
    pub(super) async fn act(&mut self, action: Action) -> Option<Event> {
        match action {
            Action::Spawn(spawn) => self.spawn(*spawn),
            Action::Prove { incarnation, instance, role } => {
                self.prove(incarnation, &instance, role);
                None
            }
            Action::Promote { incarnation, instance, epoch, within } => {
                self.promote(incarnation, &instance, epoch, within);
                None
            }
            Action::Terminate(incarnation) => self.signal(incarnation, Signal::SIGTERM),
            Action::Kill(incarnation) => self.signal(incarnation, Signal::SIGKILL),
            Action::Announce { service } => {
                self.announce(service).await;
                None
            }
            Action::AnnounceSwap { service, swap } => {
                self.announce_swap(service, *swap).await;
                None
            }
            // What ended has been told by the state that its service entered.
            Action::Ended { .. } | Action::Finish(_) => None,
        }
    }

    /// Starts a process; what becomes of one on another machine comes later.
    fn spawn(&mut self, spawn: Spawn) -> Option<Event> {
        if let Some(node) = spawn.start.node.clone() {
            self.nodes.start(&self.bus, node, &spawn);
            return None;
        }
        let incarnation = spawn.incarnation;
        let serving = Serving {
            session: self.stack.session.name(),
            role: &spawn.role,
            instance: &spawn.instance,
            link: &Link::from(&self.endpoint),
            run_dir: self.stack.session.path(),
            params: &serde_json::Value::Object(spawn.start.params.clone()).to_string(),
            epoch: spawn.epoch,
            standby: spawn.standby,
            stop: spawn.stop,
        };
        let order = Order {
            incarnation,
            executable: spawn.start.executable.clone(),
            arguments: serving.arguments(),
            env: spawn.start.env.clone(),
        };
        let log = self.log(spawn.service);
        let event = match spawn::start(order, log, self.exit_sender.clone()) {
            Ok(pid) => {
                self.pids.insert(incarnation, (pid, spawn.instance));
                self.roster.add(pid);
                Event::Started { incarnation, pid }
            }
            Err(error) => {
                let reason = format!("{} cannot be started: {error}", spawn.start.executable.display());
                Event::Exited { incarnation, exit: Exit { status: None, reason } }
            }
        };
        Some(event)
    }

    /// Where the lines of a service go; begun with its first process.
    pub(super) fn log(&mut self, index: usize) -> ServiceLog {
        let name = self.mind.service(index, self.now()).unwrap_or_default().name;
        let (width, folder, console) = (self.width, self.stack.session.logs(), &self.console);
        let begin = || ServiceLog {
            service: name.clone(),
            width,
            color: console::color_of(index),
            file: Arc::new(Mutex::new(LogFile::begin(log_file::path_of(&folder, &name)))),
            console: console.clone(),
        };
        self.logs.entry(name.clone()).or_insert_with(begin).clone()
    }

    /// Looks at a newcomer in a task of its own: supervision goes on meanwhile.
    fn prove(&self, incarnation: Incarnation, instance: &str, role: String) {
        let (bus, sender) = (self.bus.clone(), self.outcome_sender.clone());
        let ready = self.newcomers.get(instance).cloned().unwrap_or_default();
        tokio::spawn(async move {
            let outcome = probe::prove(&bus, &ready, &role).await;
            // Without a supervisor nobody wants to know.
            let _ = sender.send(Event::Proven { incarnation, outcome }).await;
        });
    }

    fn promote(&self, incarnation: Incarnation, instance: &str, epoch: u64, within: Duration) {
        let (bus, sender) = (self.bus.clone(), self.outcome_sender.clone());
        let under = keys::instance(instance);
        tokio::spawn(async move {
            let context = Context::root().deadline_in(within);
            let reply = bus.ask_role(&keys::PROMOTE, &under, &PromoteRequest { epoch }, &context).await;
            let outcome = reply.map(|_| ()).map_err(|fault| fault.to_string());
            let _ = sender.send(Event::Promoted { incarnation, outcome }).await;
        });
    }

    fn signal(&self, incarnation: Incarnation, signal: Signal) -> Option<Event> {
        if self.nodes.signal(&self.bus, incarnation, signal) {
            return None;
        }
        let (pid, _) = self.pids.get(&incarnation)?;
        if let Err(error) = spawn::signal(*pid, signal) {
            self.console.tell(format!("{signal} could not be sent to process {pid}: {error}"));
        }
        None
    }
}
