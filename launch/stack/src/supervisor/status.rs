//! Status of services, on the bus and at the terminal.

use std::time::Instant;

use sg_confinement::Support;
use sg_proto::keys;
use sg_proto::launch::{Service as ServiceMessage, ServiceEvent, ServiceState, Swap, SwapState};
use sg_runtime::context::Context;
use sg_runtime::metrics;

use super::event_loop::Supervisor;
use super::nodes;
use crate::service_manager::StackState;
use crate::terminal::{Color, format_time, paint};

impl Supervisor {
    pub(super) async fn announce(&mut self, index: usize) {
        let Some(service) = self.reconciler.service(index, self.now()) else { return };
        self.print_state(&service);
        metrics::service(&service.name, service.restarts, service.state() == ServiceState::Ready);
        let event = ServiceEvent { service: Some(service) };
        // Ignore a missing subscriber: the state can be requested.
        let _ = self.bus.publish(&keys::SERVICE, &event, &Context::root()).await;
        if !self.all_ready_printed {
            let services = self.reconciler.services(self.now());
            if services.iter().all(|s| s.state() == ServiceState::Ready) {
                self.all_ready_printed = true;
                let after = format_time(self.now().as_secs_f64() * 1000.0);
                let name = self.stack.session.name();
                self.console.print_detail(format!(
                    "all {} services ready after {after}; `supergaussian say \"help\" --session {name}` sends an utterance, Ctrl-C stops the stack",
                    services.len()
                ));
            }
        }
    }

    /// Prints once how far the kernel confines the services of this machine.
    pub(super) fn print_confinement(&self) {
        let here = self.stack.file.services.iter().filter(|s| s.start.node.is_none());
        let free: Vec<&str> = here.filter(|s| !s.start.confinement.confined).map(|s| s.name.as_str()).collect();
        self.console.print_detail(match sg_confinement::support() {
            support @ Support::Version(_) if free.is_empty() => format!("services are confined ({support})"),
            support @ Support::Version(_) => {
                format!("services are confined ({support}), except for {}", free.join(", "))
            }
            missing => format!("services are not confined: {missing}"),
        });
    }

    /// Prints the nodes whose certificates are revoked.
    pub(super) fn print_revoked(&self) {
        for name in nodes::revoked(&self.stack.file) {
            self.console.print(format!("  node {name}: its certificate is revoked; it cannot join"));
        }
    }

    /// Tells the service manager of this turn.
    pub(super) fn tell_service_manager(&mut self) {
        if !self.manager.is_there() {
            return;
        }
        let services = self.reconciler.services(self.now());
        let critical = |name: &str| self.reconciler.find_service(name).is_some_and(|(_, s)| s.policy.critical);
        let needed: Vec<&ServiceMessage> = services.iter().filter(|s| critical(&s.name)).collect();
        // Without a critical service every one counts.
        let needed = if needed.is_empty() { services.iter().collect() } else { needed };
        let is_ready = |s: &ServiceMessage| s.state() == ServiceState::Ready;
        let missing: Vec<&str> = services.iter().filter(|s| !is_ready(s)).map(|s| s.name.as_str()).collect();
        let session = self.stack.session.name();
        let stopping = self.reconciler.is_stopping();
        let status = if stopping {
            format!("session {session}: stopping")
        } else if missing.is_empty() {
            format!("session {session}: all {} services ready", services.len())
        } else {
            format!("session {session}: waits for {}", missing.join(", "))
        };
        let ready = needed.into_iter().all(is_ready);
        self.manager.turn(Instant::now(), StackState { ready, stopping, status });
    }

    pub(super) async fn announce_swap(&self, index: usize, swap: Swap) {
        let Some(service) = self.reconciler.service(index, self.now()) else { return };
        let colored = self.console.colored();
        let name = format!("{:<width$}", service.name, width = self.width);
        let executable = &swap.executable;
        match swap.state() {
            SwapState::Starting => self.console.print_detail(format!("  {name}  swap: {executable} starts in standby")),
            SwapState::HandingOver => self.console.print_detail(format!("  {name}  swap: probe passed, handing over")),
            SwapState::Done => {
                let mark = paint(Color::Green, "swapped", colored);
                self.console.print(format!("  {name}  {mark} to {executable}, pid {}", service.pid));
            }
            SwapState::Failed => {
                let mark = paint(Color::Yellow, "swap failed", colored);
                self.console.print(format!("  {name}  {mark}: {}; the old executable stays in force", swap.reason));
            }
            SwapState::Waiting | SwapState::Verifying | SwapState::Promoting | SwapState::Unspecified => {}
        }
        let event = ServiceEvent { service: Some(ServiceMessage { swap: Some(swap), ..service }) };
        // Ignore a missing subscriber: the state can be requested.
        let _ = self.bus.publish(&keys::SERVICE, &event, &Context::root()).await;
    }

    fn print_state(&self, service: &ServiceMessage) {
        let colored = self.console.colored();
        let width = self.width;
        let name = format!("{:<width$}", service.name);
        let reason = &service.reason;
        let line = match service.state() {
            ServiceState::Ready => {
                let mark = paint(Color::Green, "ready", colored);
                let again =
                    if service.restarts > 0 { format!("  restart {}", service.restarts) } else { String::new() };
                let row = format!(
                    "  {name}  {mark} after {:>8}  pid {}{again}",
                    format_time(service.start_ms as f64),
                    service.pid
                );
                return if service.restarts > 0 { self.console.print(row) } else { self.console.print_detail(row) };
            }
            ServiceState::Failed => format!("  {name}  {}: {reason}", paint(Color::Red, "FAILED", colored)),
            ServiceState::Backoff => {
                format!("  {name}  {}: {reason}; restarting", paint(Color::Yellow, "down", colored))
            }
            ServiceState::Stopping if !reason.starts_with("asked") && reason != "hands over" => {
                format!("  {name}  {}: {reason}", paint(Color::Yellow, "stopping", colored))
            }
            ServiceState::Stopping => return self.console.print_detail(format!("  {name}  stopping")),
            ServiceState::Stopped => return self.console.print_detail(format!("  {name}  {reason}")),
            ServiceState::Waiting | ServiceState::Starting | ServiceState::Unspecified => return,
        };
        self.console.print(line);
    }
}
