//! Restart intensity, as in OTP: a limited number of failures within a time is tolerated.

use super::backoff;
use super::model::{Action, Time};
use super::reconciler::Reconciler;
use super::slot::{State, seconds};

impl Reconciler {
    /// Handles a failure: a restart after a pause, or the final state after too many.
    pub(super) fn fail(&mut self, index: usize, reason: String, now: Time, actions: &mut Vec<Action>) {
        let Some(slot) = self.slots.get_mut(index) else { return };
        let policy = &slot.service.policy;
        slot.recent.retain(|t| now.saturating_sub(*t) < policy.within);
        if slot.recent.len() >= usize::try_from(policy.restarts).unwrap_or(usize::MAX) {
            let within = seconds(policy.within);
            let reason = format!("failed {} times within {within} s: {reason}", slot.recent.len() + 1);
            return slot.enter(State::Failed, reason, index, actions);
        }
        slot.recent.push_back(now);
        slot.failures = slot.failures.saturating_add(1);
        let pause = backoff::pause(policy.backoff_initial, policy.backoff_max, slot.failures);
        let until = now + self.jitter.spread(pause);
        slot.enter(State::Backoff { until }, reason, index, actions);
    }
}
