//! Read access to the state of a stack.

use sg_proto::launch;

use super::model::Time;
use super::reconciler::{Goal, Reconciler};
use super::slot::{Slot, Stage, State};
use crate::file::Service;

impl Reconciler {
    /// All services in start order. Removed services are listed until their processes are gone.
    #[must_use]
    pub fn services(&self, now: Time) -> Vec<launch::Service> {
        let slots = self.listing.iter().filter_map(|index| self.slots.get(*index));
        slots.filter(|s| !s.removed || s.main().is_some()).map(|s| s.view(now)).collect()
    }

    /// One service.
    #[must_use]
    pub fn service(&self, index: usize, now: Time) -> Option<launch::Service> {
        self.slots.get(index).map(|s| s.view(now))
    }

    /// Position and desired state of a service, by name.
    #[must_use]
    pub fn find_service(&self, name: &str) -> Option<(usize, &Service)> {
        let slot = |(_, s): &(usize, &Slot)| s.service.name == name && !s.removed;
        self.slots.iter().enumerate().find(slot).map(|(index, s)| (index, &s.service))
    }

    /// Number of the next swap of a service; 0 if the service was never started and there is nothing to replace.
    #[must_use]
    pub fn next_swap(&self, index: usize) -> u64 {
        self.slots.get(index).filter(|s| s.starts > 0).map_or(0, Slot::next_swap)
    }

    /// Whether the stack is stopping.
    #[must_use]
    pub fn is_stopping(&self) -> bool {
        self.goal != Goal::Run
    }
}

impl Slot {
    fn view(&self, now: Time) -> launch::Service {
        let process = self.main();
        let state = match (&self.state, process.map(|p| &p.stage)) {
            (State::Waiting, _) => launch::ServiceState::Waiting,
            (State::Alive(_), Some(Stage::Ready { .. })) => launch::ServiceState::Ready,
            (State::Alive(_), Some(Stage::Stopping { .. })) => launch::ServiceState::Stopping,
            (State::Alive(_), _) => launch::ServiceState::Starting,
            (State::Backoff { .. }, _) => launch::ServiceState::Backoff,
            (State::Stopped, _) => launch::ServiceState::Stopped,
            (State::Failed, _) => launch::ServiceState::Failed,
        };
        let uptime = process.map_or(0, |p| now.saturating_sub(p.started).as_millis());
        launch::Service {
            name: self.service.name.clone(),
            role: self.service.role.clone(),
            state: state.into(),
            pid: process.and_then(|p| p.pid).unwrap_or(0),
            instance: process.map(|p| p.instance.clone()).unwrap_or_default(),
            restarts: self.starts.saturating_sub(1),
            uptime_ms: u64::try_from(uptime).unwrap_or(u64::MAX),
            memory_bytes: process.map_or(0, |p| p.memory_bytes),
            start_ms: self.start_ms,
            reason: self.reason.clone(),
            executable: self.service.start.executable.display().to_string(),
            epoch: self.epoch,
            swap: self.swap_view(),
            node: process.map_or(&self.service.start, |p| &p.start).node.clone().unwrap_or_default(),
            answer_ms: process.map_or(0.0, |p| p.answer_ms.0),
            answer_ms_p99: process.map_or(0.0, |p| p.answer_ms.1),
            busy: process.map(|p| p.work.summary.clone()).unwrap_or_default(),
        }
    }
}
