//! What may be seen of a stack from outside.

use sg_proto::launch;

use super::{Goal, Reconciler, Stage, State, Time, Watched};

impl Reconciler {
    /// The services as they stand, in start order.
    #[must_use]
    pub fn services(&self, now: Time) -> Vec<launch::Service> {
        self.services.iter().map(|s| s.view(now)).collect()
    }

    /// One service as it stands.
    #[must_use]
    pub fn service(&self, index: usize, now: Time) -> Option<launch::Service> {
        self.services.get(index).map(|s| s.view(now))
    }

    /// Position of a service by name.
    #[must_use]
    pub fn position(&self, name: &str) -> Option<usize> {
        self.services.iter().position(|s| s.desired.name == name)
    }

    /// Whether the stack is on its way down.
    #[must_use]
    pub fn is_stopping(&self) -> bool {
        self.goal != Goal::Run
    }
}

impl Watched {
    fn view(&self, now: Time) -> launch::Service {
        let (process, state) = match &self.state {
            State::Waiting => (None, launch::ServiceState::Waiting),
            State::Alive(p, Stage::Starting { .. }) => (Some(p), launch::ServiceState::Starting),
            State::Alive(p, Stage::Ready { .. }) => (Some(p), launch::ServiceState::Ready),
            State::Alive(p, Stage::Stopping { .. }) => (Some(p), launch::ServiceState::Stopping),
            State::Backoff { .. } => (None, launch::ServiceState::Backoff),
            State::Stopped => (None, launch::ServiceState::Stopped),
            State::Failed => (None, launch::ServiceState::Failed),
        };
        let uptime = process.map_or(0, |p| now.saturating_sub(p.started).as_millis());
        launch::Service {
            name: self.desired.name.clone(),
            role: self.desired.role.clone(),
            state: state.into(),
            pid: process.and_then(|p| p.pid).unwrap_or(0),
            instance: process.map(|p| p.instance.clone()).unwrap_or_default(),
            restarts: self.starts.saturating_sub(1),
            uptime_ms: u64::try_from(uptime).unwrap_or(u64::MAX),
            memory_bytes: if process.is_some() { self.memory_bytes } else { 0 },
            start_ms: self.start_ms,
            reason: self.reason.clone(),
        }
    }
}
