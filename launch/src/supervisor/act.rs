//! Doing what the reconciler wants: processes, signals, proofs, promotions.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use nix::sys::signal::Signal;
use sg_launch::reconcile::{Action, Event, Exit, Incarnation, Spawn};
use sg_proto::bus::PromoteRequest;
use sg_proto::keys;
use sg_runtime::context::Context;
use sg_runtime::session::SessionDir;

use super::Supervisor;
use crate::children::{self, Order};
use crate::console::{self, ServiceLog};
use crate::logs::{self, LogFile};
use crate::proof;

impl Supervisor {
    /// Does what is wanted; what comes of it at once is returned.
    pub(super) async fn act(&mut self, action: Action) -> Option<Event> {
        match action {
            Action::Spawn(spawn) => Some(self.spawn(*spawn)),
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

    fn spawn(&mut self, spawn: Spawn) -> Event {
        let incarnation = spawn.incarnation;
        let order = Order {
            incarnation,
            executable: spawn.start.executable.clone(),
            arguments: arguments(&spawn, &self.stack.session, &self.endpoint),
            env: spawn.start.env.clone(),
        };
        let log = self.log(spawn.service);
        match children::start(order, log, self.exit_sender.clone()) {
            Ok(pid) => {
                self.pids.insert(incarnation, (pid, spawn.instance));
                self.roster.add(pid);
                Event::Started { incarnation, pid }
            }
            Err(error) => {
                let reason = format!("{} cannot be started: {error}", spawn.start.executable.display());
                Event::Exited { incarnation, exit: Exit { status: None, reason } }
            }
        }
    }

    /// Where the lines of a service go; begun with its first process.
    pub(super) fn log(&mut self, index: usize) -> ServiceLog {
        let name = self.mind.service(index, self.now()).unwrap_or_default().name;
        let (width, folder, console) = (self.width, self.stack.session.logs(), &self.console);
        let begin = || ServiceLog {
            service: name.clone(),
            width,
            ink: console::ink_of(index),
            file: Arc::new(Mutex::new(LogFile::begin(logs::path_of(&folder, &name)))),
            console: console.clone(),
        };
        self.logs.entry(name.clone()).or_insert_with(begin).clone()
    }

    /// Looks at a newcomer in a task of its own: supervision goes on meanwhile.
    fn prove(&self, incarnation: Incarnation, instance: &str, role: String) {
        let (bus, sender) = (self.bus.clone(), self.outcome_sender.clone());
        let ready = self.newcomers.get(instance).cloned().unwrap_or_default();
        tokio::spawn(async move {
            let outcome = proof::prove(&bus, &ready, &role).await;
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
        let (pid, _) = self.pids.get(&incarnation)?;
        if let Err(error) = children::signal(*pid, signal) {
            self.console.tell(format!("{signal} could not be sent to process {pid}: {error}"));
        }
        None
    }
}

/// The arguments of a service's process (`sg_runtime::process::ServeArgs`).
fn arguments(spawn: &Spawn, session: &SessionDir, endpoint: &str) -> Vec<String> {
    let params = serde_json::Value::Object(spawn.start.params.clone()).to_string();
    let run_dir = session.path().display().to_string();
    let supervisor = std::process::id().to_string();
    let epoch = spawn.epoch.to_string();
    // A little less than the time until the kill: what is left is for leaving.
    let grace = spawn.stop.mul_f64(0.8).as_millis().to_string();
    let mut arguments = vec!["serve".to_owned()];
    for (name, value) in [
        ("--session", session.name()),
        ("--role", &spawn.role),
        ("--instance", &spawn.instance),
        ("--connect", endpoint),
        ("--run-dir", &run_dir),
        ("--params", &params),
        ("--supervisor-pid", &supervisor),
        ("--epoch", &epoch),
        ("--grace-ms", &grace),
    ] {
        arguments.extend([name.to_owned(), value.to_owned()]);
    }
    arguments.extend(spawn.standby.then(|| "--standby".to_owned()));
    arguments
}
