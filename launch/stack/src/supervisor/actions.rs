//! Performs the actions of the reconciler: processes and signals.

use std::sync::{Arc, Mutex};

use nix::sys::signal::Signal;
use sg_runtime::bus::Link;

use super::attempt::{Attempt, CandidateRequest};
use super::event_loop::Supervisor;
use crate::console::{self, ServiceLog};
use crate::log_file::{self, LogFile};
use crate::params_file;
use crate::reconcile::{Action, Event, Exit, ProcessId, Spawn};
use crate::serve_arguments::ServeArguments;
use crate::service_rights;
use crate::spawn::{self, SpawnRequest};

impl Supervisor {
    /// Performs an action. Returns its immediate result.
    pub(super) async fn perform(&mut self, action: Action) -> Option<Event> {
        match action {
            Action::Spawn(spawn) => self.spawn(*spawn),
            Action::Verify { id, instance, role } => {
                let ready = Box::new(self.candidates.get(&instance).cloned().unwrap_or_default());
                self.begin(CandidateRequest::Probe { id, ready, role });
                None
            }
            Action::Promote { id, instance, epoch, within } => {
                self.registry.grant(epoch);
                self.begin(CandidateRequest::Promote { id, instance, epoch, within });
                None
            }
            Action::Terminate(id) => self.signal(id, Signal::SIGTERM),
            Action::Kill(id) => self.signal(id, Signal::SIGKILL),
            Action::Announce { service } => {
                self.announce(service).await;
                None
            }
            Action::AnnounceSwap { service, swap } => {
                self.announce_swap(service, *swap).await;
                None
            }
            // The announced state of the service covers the end.
            Action::Ended { .. } | Action::Finish(_) => None,
        }
    }

    /// Starts a process. For a node, the result arrives later.
    fn spawn(&mut self, spawn: Spawn) -> Option<Event> {
        self.registry.grant(spawn.epoch);
        if let Some(node) = spawn.start.node.clone() {
            self.nodes.start(&self.bus, node, &spawn);
            return None;
        }
        let id = spawn.id;
        let run_dir = self.stack.session.path();
        let params = serde_json::Value::Object(spawn.start.params.clone());
        let failed = |reason: String| Some(Event::Exited { id, exit: Exit { status: None, reason } });
        let params_file = match params_file::write(run_dir, &spawn.instance, &params.to_string()) {
            Ok(path) => path,
            Err(error) => {
                return failed(format!("its parameters cannot be stored in {}: {error}", run_dir.display()));
            }
        };
        let link = Link::from(&self.endpoint);
        let process = service_rights::Process {
            role: &spawn.role,
            instance: &spawn.instance,
            executable: &spawn.start.executable,
            params: &params,
            params_file: &params_file,
            env: &spawn.start.env,
            run_dir,
            link: &link,
            scene: self.scene.as_deref(),
            confinement: &spawn.start.confinement,
        };
        let (rights, scratch) = match process.prepare() {
            Ok(prepared) => prepared,
            Err(reason) => return failed(reason),
        };
        let arguments = ServeArguments {
            session: self.stack.session.name(),
            role: &spawn.role,
            instance: &spawn.instance,
            link: &link,
            run_dir,
            params_file: &params_file,
            epoch: spawn.epoch,
            standby: spawn.standby,
            stop: spawn.stop,
        };
        let request = SpawnRequest {
            id,
            executable: spawn.start.executable.clone(),
            arguments: arguments.arguments(),
            env: spawn.start.env.clone(),
            rights,
            scratch,
        };
        let log = self.log(spawn.service);
        let event = match spawn::start(request, log, self.exit_sender.clone()) {
            Ok(pid) => {
                self.pids.insert(id, (pid, spawn.instance));
                self.registry.add(pid);
                Event::Started { id, pid }
            }
            Err(error) => {
                let reason = format!("{} cannot be started: {error}", spawn.start.executable.display());
                Event::Exited { id, exit: Exit { status: None, reason } }
            }
        };
        Some(event)
    }

    /// The log of a service. Its first use creates the file.
    pub(super) fn log(&mut self, index: usize) -> ServiceLog {
        let name = self.reconciler.service(index, self.now()).unwrap_or_default().name;
        let (width, folder, console) = (self.width, self.stack.session.logs(), &self.console);
        let begin = || ServiceLog {
            service: name.clone(),
            width,
            color: console::color_of(index),
            file: Arc::new(Mutex::new(LogFile::create(log_file::path_of(&folder, &name)))),
            console: console.clone(),
        };
        self.logs.entry(name.clone()).or_insert_with(begin).clone()
    }

    /// Begins an attempt of a request in its own task, so that supervision continues.
    fn begin(&self, request: CandidateRequest) {
        let (bus, sender) = (self.bus.clone(), self.outcome_sender.clone());
        let standstill = self.clock.standstill();
        tokio::spawn(async move {
            let attempt = request.attempt(&bus, standstill).await;
            // Without a supervisor the result is of no use.
            let _ = sender.send(attempt).await;
        });
    }

    /// The event of a finished attempt, or none if it is made again.
    pub(super) fn conclude(&self, attempt: Attempt) -> Option<Event> {
        let id = attempt.request.id();
        // An ended candidate has no second chance.
        let runs = self.pids.contains_key(&id) || self.nodes.running.contains_key(&id);
        if attempt.outcome.is_err() && runs && self.clock.stood_still_since(attempt.standstill) {
            self.begin(attempt.request);
            return None;
        }
        Some(attempt.event())
    }

    fn signal(&mut self, id: ProcessId, signal: Signal) -> Option<Event> {
        if self.nodes.signal(&self.bus, id, signal, self.clock.instant()) {
            return None;
        }
        let (pid, _) = self.pids.get(&id)?;
        if let Err(error) = spawn::signal(*pid, signal) {
            self.console.print(format!("{signal} could not be sent to process {pid}: {error}"));
        }
        None
    }
}
