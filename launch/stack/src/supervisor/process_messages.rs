//! Messages of processes about themselves. A message counts only if it comes from the process that it names.

use sg_proto::bus::{Health, Ready};
use sg_proto::keys::{self, Identity};
use sg_proto::launch::LogLines;
use sg_runtime::bus::LivelinessChange;
use sg_runtime::context::Context;

use super::event_loop::Supervisor;
use super::nodes::RemoteProcess;
use super::work::work_of;
use crate::reconcile::Event;
use crate::spawn::LineSink as _;

impl Supervisor {
    /// A candidate is in standby.
    pub(super) fn candidate_ready(&mut self, ready: Ready, context: &Context) -> Event {
        // Keep only announcements of our own processes. Others would stay for ever.
        let here = self.pids.values().any(|(_, instance)| *instance == ready.instance);
        let known = here || self.nodes.node_of(&ready.instance).is_some();
        if known && self.nodes.confirms(context.identity.as_ref(), &ready.instance) {
            self.candidates.insert(ready.instance.clone(), ready.clone());
        }
        self.ready_event(ready, context)
    }

    /// A process serves its role.
    pub(super) fn ready_event(&self, ready: Ready, context: &Context) -> Event {
        let Ready { instance, start_ms, standby, .. } = ready;
        let event = Event::Ready { instance: instance.clone(), start_ms, standby };
        self.confirmed(context.identity.as_ref(), keys::READY.name, &instance, event)
    }

    /// A process reports its health.
    pub(super) fn health_event(&self, health: Health, context: &Context) -> Event {
        let work = work_of(&health);
        let Health { instance, memory_bytes, answer_ms, answer_ms_p99, .. } = health;
        let answer_ms = (answer_ms, answer_ms_p99);
        let event = Event::Health { instance: instance.clone(), memory_bytes, answer_ms, work };
        self.confirmed(context.identity.as_ref(), keys::HEALTH.name, &instance, event)
    }

    /// A process connects or disconnects.
    pub(super) fn presence_event(&self, seen: LivelinessChange) -> Event {
        let LivelinessChange { instance, alive, identity, .. } = seen;
        let event = Event::Presence { instance: instance.clone(), alive };
        self.confirmed(identity.as_ref(), "@alive", &instance, event)
    }

    /// Logs the lines of a process on another machine.
    pub(super) fn log_remote_lines(&mut self, message: &LogLines, context: &Context) {
        let node = context.identity.as_ref().map(|i| i.node.as_str());
        let is_there = |p: &&RemoteProcess| p.instance == message.instance && Some(p.node.as_str()) == node;
        let service = self.nodes.running.values().find(is_there).map(|p| p.service);
        let Some(service) = service else { return self.bus.refuse_message(keys::NODE_LOG.name) };
        let log = self.log(service);
        for line in &message.lines {
            log.line(line);
        }
    }

    /// The event of a message about an instance, or none if another process has sent it.
    fn confirmed(&self, sender: Option<&Identity>, row: &'static str, instance: &str, event: Event) -> Event {
        if self.nodes.confirms(sender, instance) {
            return event;
        }
        self.bus.refuse_message(row);
        Event::Tick
    }
}
