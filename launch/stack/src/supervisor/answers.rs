//! Answers to requests.

use std::collections::BTreeSet;
use std::path::PathBuf;

use sg_proto::launch::{
    PsReply, ReloadReply, ReloadRequest, RestartReply, Service as ServiceMessage, SwapReply, SwapRequest,
};
use sg_runtime::bus::TlsListener;
use sg_runtime::fault::Fault;

use super::event_loop::Supervisor;
use super::nodes;
use super::requests::Request;
use crate::file::{self, LaunchFile, Start};
use crate::reconcile::Event;
use crate::service_rights;
use crate::suggestion::suggestion;

/// Outcome of a reload.
struct Reloaded {
    answer: ReloadReply,
    /// Applies the differences.
    event: Event,
    /// The revoked machines, with the access rules without them, if the list has changed.
    revoked: Option<(BTreeSet<String>, TlsListener)>,
}

impl Supervisor {
    /// Answers a request. Returns the events that follow, in order.
    pub(super) fn answer(&mut self, request: Request) -> Vec<Event> {
        let event = match request {
            Request::Ps(_, reply) => {
                let ps = PsReply {
                    session: self.stack.session.name().to_owned(),
                    launch_file: self.stack.path.display().to_string(),
                    pid: std::process::id(),
                    services: self.reconciler.services(self.now()),
                };
                // The requester may have given up.
                let _ = reply.send(Ok(ps));
                Event::Tick
            }
            Request::Restart(request, reply) => {
                let known = self.service_named(&request.service);
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
                let Reloaded { answer, event, revoked } = match self.reload(&request) {
                    Ok(reloaded) => reloaded,
                    Err(fault) => {
                        let _ = reply.send(Err(fault));
                        return vec![Event::Tick];
                    }
                };
                let Some((revoked, listener)) = revoked else {
                    let _ = reply.send(Ok(answer));
                    return vec![event];
                };
                let mut events = self.nodes.revoke(revoked);
                events.push(event);
                self.print_revoked();
                let (bus, socket, console) = (self.bus.clone(), self.stack.session.socket(), self.console.clone());
                tokio::spawn(async move {
                    // The answer says that the revoked machines are cut off.
                    let opened = bus.open_to_machines(&socket, &listener).await;
                    let answer = opened.map(|()| answer).map_err(|error| {
                        console.print(format!("no node is connected: {error}"));
                        Fault::internal(format!("{error}; no node is connected: start the stack again"))
                    });
                    let _ = reply.send(answer);
                });
                return events;
            }
            Request::Join(request, sender, reply) => {
                let (answer, events) = match self.nodes.handle_join(&request, sender.as_ref(), self.clock.instant()) {
                    Ok((answer, events)) => (Ok(answer), events),
                    Err(fault) => (Err(fault), Vec::new()),
                };
                if events.iter().any(|e| matches!(e, Event::Node { present: true, .. })) {
                    self.console.print_detail(format!("  node {} has joined, process {}", request.node, request.pid));
                }
                let _ = reply.send(answer);
                return events;
            }
            Request::Open(request, reply) => {
                let _ = reply.send(self.open_session(&request));
                Event::Tick
            }
            Request::Save(request, context, reply) => {
                self.save_file(request, context, reply);
                Event::Tick
            }
        };
        vec![event]
    }

    /// A service by name, unless the stack is stopping.
    fn service_named(&self, name: &str) -> Result<(usize, ServiceMessage), Fault> {
        if self.reconciler.is_stopping() {
            return Err(Fault::precondition("the stack is stopping"));
        }
        let known = self
            .reconciler
            .find_service(name)
            .and_then(|(index, _)| Some((index, self.reconciler.service(index, self.now())?)));
        known.ok_or_else(|| {
            let services = self.reconciler.services(self.now());
            let hint = suggestion(name, services.iter().map(|s| s.name.as_str()));
            Fault::not_found(format!("no service `{name}`{hint}"))
        })
    }

    /// Checks a swap request. Returns the number of the swap, and its event.
    fn swap(&self, request: &SwapRequest) -> Result<(u64, Event), Fault> {
        let (service, _) = self.service_named(&request.service)?;
        let (_, current) =
            self.reconciler.find_service(&request.service).ok_or_else(|| Fault::not_found("it is gone"))?;
        let params = match request.params.as_str() {
            "" => current.start.params.clone(),
            text => serde_json::from_str(text).map_err(|e| Fault::invalid(format!("parameters: {e}")))?,
        };
        let executable = PathBuf::from(&request.executable);
        match &current.start.node {
            None if !executable.is_absolute() => {
                return Err(Fault::invalid(format!("executable `{}` must be an absolute path", request.executable)));
            }
            Some(node) if request.executable.contains('/') => {
                return Err(Fault::invalid(format!(
                    "`{}` runs on node `{node}`: give its executable as a name without a path",
                    request.service
                )));
            }
            _ => {}
        }
        let Start { env, node, confinement, .. } = current.start.clone();
        let start = Start { exec: request.executable.clone(), executable, params, env, node, confinement };
        Ok((self.reconciler.next_swap(service), Event::Swap { service, start }))
    }

    /// Reads a launch file again.
    fn reload(&mut self, request: &ReloadRequest) -> Result<Reloaded, Fault> {
        if self.reconciler.is_stopping() {
            return Err(Fault::precondition("the stack is stopping"));
        }
        let path = PathBuf::from(&request.launch_file);
        let file = file::load(&path, &request.overrides, &request.only).map_err(|e| Fault::invalid(e.to_string()))?;
        // The list of revoked machines alone can change while the bus is open.
        let access = |file: &LaunchFile| nodes::listen_without(file, &BTreeSet::new());
        if access(&file) != access(&self.stack.file) || file.nodes != self.stack.file.nodes {
            return Err(Fault::precondition(
                "`[bus]`, `[node.…]` or `on` has changed; stop the stack and start it again",
            ));
        }
        let differences = self.reconciler.differences(&file.services);
        self.console.print_detail(format!("{}: read again", path.display()));
        self.stack.path = path;
        self.all_ready_printed = true;
        self.scene = service_rights::scene_of(&file.services);
        self.manager.reloading();
        let revoked = nodes::revoked(&file);
        let changed = (revoked != nodes::revoked(&self.stack.file)).then(|| nodes::listen(&file)).flatten();
        self.stack.file.listen = file.listen;
        Ok(Reloaded {
            answer: ReloadReply { differences },
            event: Event::SetServices(file.services),
            revoked: changed.map(|listener| (revoked, listener)),
        })
    }
}
