//! The published state of the agent. A tour changes its part of it between utterances.

use std::sync::{Mutex, MutexGuard, PoisonError};

use sg_proto::language::{AgentState, Tour};
use sg_runtime::bus::RetainedValue;
use sg_runtime::context::Context;

/// The state, as readers get it.
pub(crate) struct PublishedState {
    value: RetainedValue<AgentState>,
    newest: Mutex<AgentState>,
}

impl PublishedState {
    pub(crate) fn new(value: RetainedValue<AgentState>, initial: AgentState) -> Self {
        Self { value, newest: Mutex::new(initial) }
    }

    /// Ignores poisoning: each change is one assignment.
    fn newest(&self) -> MutexGuard<'_, AgentState> {
        self.newest.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The tour that is under way.
    pub(crate) fn tour(&self) -> Option<Tour> {
        self.newest().tour.clone()
    }

    /// Replaces everything but the tour.
    pub(crate) async fn set(&self, state: AgentState, context: &Context) {
        let newest = {
            let mut newest = self.newest();
            *newest = AgentState { tour: newest.tour.take(), ..state };
            newest.clone()
        };
        self.publish(newest, context).await;
    }

    /// Replaces the tour.
    pub(crate) async fn set_tour(&self, tour: Option<Tour>) {
        let newest = {
            let mut newest = self.newest();
            newest.tour = tour;
            newest.clone()
        };
        self.publish(newest, &Context::root()).await;
    }

    async fn publish(&self, newest: AgentState, context: &Context) {
        if let Err(fault) = self.value.set(newest, context).await {
            tracing::warn!(%fault, "the state could not be published");
        }
    }
}
