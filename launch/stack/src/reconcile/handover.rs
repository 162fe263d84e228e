//! Swaps: a candidate loads beside the serving process, is probed, and takes over when the old process is gone.
//!
//! A candidate that fails before the hand-over leaves the old process serving. A candidate that fails after it causes
//! an ordinary restart with the old start, which stays in force until the swap is done. If the old process dies during
//! a swap, it is restarted and the swap continues. A candidate in standby then takes over at once.

use sg_proto::launch::SwapState;

use super::model::{Action, PROBE_TIME, ProcessId, Time};
use super::reconciler::{Goal, Reconciler};
use super::slot::{AfterStop, Occupant, PendingSwap, Process, ProcessIndex, Stage, State, Swap};
use crate::file::Start;

impl Reconciler {
    /// Requests a swap. A service that was never started takes the new start without a swap.
    pub(super) fn swap(&mut self, index: usize, start: Start, now: Time, actions: &mut Vec<Action>) {
        if self.goal != Goal::Run {
            return;
        }
        let Some(slot) = self.slots.get_mut(index).filter(|s| !s.removed) else { return };
        if slot.starts == 0 {
            slot.service.start = start;
            return;
        }
        self.cancel_before_handover(index, "replaced by another swap", now, actions);
        let Some(slot) = self.slots.get_mut(index) else { return };
        let number = slot.next_swap();
        let executable = start.executable.display().to_string();
        slot.next = Some(PendingSwap { number, start });
        slot.swap = Some(Swap { number, state: SwapState::Waiting, executable, reason: String::new() });
        slot.announce_swap(index, actions);
    }

    /// Cancels a swap if the serving process has not been asked to stop for it.
    pub(super) fn cancel_before_handover(&mut self, index: usize, why: &str, now: Time, actions: &mut Vec<Action>) {
        let Some(slot) = self.slots.get_mut(index) else { return };
        let reason = format!("withdrawn: {why}");
        if let Some(pending) = slot.next.take() {
            slot.swap_enters(pending.number, SwapState::Failed, reason.as_str(), index, actions);
        }
        let early = |stage: &Stage| matches!(stage, Stage::Starting { .. } | Stage::Verifying { .. });
        if let Some(number) = slot.candidate.as_ref().filter(|n| early(&n.stage)).and_then(|n| n.swap) {
            slot.swap_enters(number, SwapState::Failed, reason, index, actions);
            self.stop_candidate(index, now, actions);
        }
    }

    /// Cancels a swap at any stage. The candidate stops, even while it takes the role.
    pub(super) fn cancel_swap(&mut self, index: usize, why: &str, now: Time, actions: &mut Vec<Action>) {
        self.cancel_before_handover(index, why, now, actions);
        let Some(slot) = self.slots.get_mut(index) else { return };
        let reason = format!("withdrawn: {why}");
        let standing = |stage: &Stage| matches!(stage, Stage::StandingBy { .. });
        if let Some(number) = slot.candidate.as_ref().filter(|n| standing(&n.stage)).and_then(|n| n.swap) {
            slot.swap_enters(number, SwapState::Failed, reason, index, actions);
            if let Some(Stage::Stopping { then: then @ AfterStop::HandOver, .. }) =
                slot.process_mut(Occupant::Serving).map(|p| &mut p.stage)
            {
                *then = AfterStop::Restart;
            }
            self.stop_candidate(index, now, actions);
        } else if let Some(process) = slot.process_mut(Occupant::Serving)
            && !matches!(process.stage, Stage::Stopping { .. })
            && let Some(number) = process.swap.take()
        {
            slot.swap_enters(number, SwapState::Failed, reason, index, actions);
            self.stop((index, Occupant::Serving), AfterStop::Restart, now, actions);
        }
    }

    /// Stops a candidate whose swap has been announced as failed.
    fn stop_candidate(&mut self, index: usize, now: Time, actions: &mut Vec<Action>) {
        if let Some(candidate) = self.slots.get_mut(index).and_then(|s| s.candidate.as_mut()) {
            candidate.swap = None;
            self.stop((index, Occupant::Candidate), AfterStop::Stay, now, actions);
        }
    }

    /// Handles the announcement of a process that serves or stands by.
    pub(super) fn on_ready(&mut self, at: ProcessIndex, standby: bool, now: Time, actions: &mut Vec<Action>) {
        let (index, part) = at;
        let Some(slot) = self.slots.get_mut(index) else { return };
        let Some(process) = slot.process_mut(part) else { return };
        match (part, standby, &process.stage) {
            (Occupant::Serving, false, Stage::Starting { .. } | Stage::Promoting { .. }) => {
                self.serves(index, now, actions);
            }
            (Occupant::Candidate, true, Stage::Starting { .. }) => {
                process.stage = Stage::Verifying { deadline: now + PROBE_TIME };
                actions.push(Action::Verify {
                    id: process.id,
                    instance: process.instance.clone(),
                    role: process.role.clone(),
                });
                if let Some(number) = process.swap {
                    slot.swap_enters(number, SwapState::Verifying, "", index, actions);
                }
            }
            (
                Occupant::Candidate,
                false,
                Stage::Starting { .. } | Stage::Verifying { .. } | Stage::StandingBy { .. },
            ) => {
                let reason = "it took the role without waiting for its promotion";
                self.stop(at, AfterStop::Fail(reason.to_owned()), now, actions);
                // Two processes in one role are worse than one that could not finish.
                self.kill(at, now, actions);
            }
            _ => {}
        }
    }

    /// A starting or promoted process serves.
    fn serves(&mut self, index: usize, now: Time, actions: &mut Vec<Action>) {
        let Some(slot) = self.slots.get_mut(index) else { return };
        let deadline = now + slot.service.policy.liveness;
        let State::Alive(process) = &mut slot.state else { return };
        process.stage = Stage::Ready { since: now, deadline };
        let measured = || u64::try_from(now.saturating_sub(process.started).as_millis()).unwrap_or(u64::MAX);
        slot.start_ms = process.start_ms.unwrap_or_else(measured);
        slot.reason = String::new();
        let swap = process.swap.take();
        if swap.is_some() {
            slot.service.start = process.start.clone();
            slot.failures = 0;
        }
        actions.push(Action::Announce { service: index });
        if let Some(number) = swap {
            slot.swap_enters(number, SwapState::Done, "", index, actions);
        }
    }

    pub(super) fn on_verified(
        &mut self,
        id: ProcessId,
        outcome: Result<(), String>,
        now: Time,
        actions: &mut Vec<Action>,
    ) {
        let waited = |p: &Process| p.id == id && matches!(p.stage, Stage::Verifying { .. });
        let Some((at, process)) = self.find_process(waited) else { return };
        if let Err(reason) = outcome {
            return self.stop(at, AfterStop::Fail(format!("it failed its probe: {reason}")), now, actions);
        }
        let number = process.swap;
        let Some(slot) = self.slots.get_mut(at.0) else { return };
        let deadline = now + slot.service.policy.liveness;
        if let Some(process) = slot.process_mut(at.1) {
            process.stage = Stage::StandingBy { deadline };
        }
        if let Some(number) = number {
            slot.swap_enters(number, SwapState::HandingOver, "", at.0, actions);
        }
    }

    /// Hands over to a probed candidate: stops the serving process, then promotes the candidate once the role is free.
    pub(super) fn hand_over_if_due(&mut self, index: usize, now: Time, actions: &mut Vec<Action>) {
        let free = self.occupants(index).is_empty();
        let Some(slot) = self.slots.get_mut(index) else { return };
        let Some(candidate) = &slot.candidate else { return };
        if !matches!(candidate.stage, Stage::StandingBy { .. }) || self.goal != Goal::Run {
            return;
        }
        match &mut slot.state {
            State::Alive(process) => match &mut process.stage {
                Stage::Stopping { then, .. } => *then = AfterStop::HandOver,
                _ => self.stop((index, Occupant::Serving), AfterStop::HandOver, now, actions),
            },
            _ if !slot.lost.is_empty() => {
                let reason = "the system does not remove the old process";
                self.stop((index, Occupant::Candidate), AfterStop::Fail(reason.to_owned()), now, actions);
            }
            _ if free => self.promote(index, now, actions),
            _ => {}
        }
    }

    fn promote(&mut self, index: usize, now: Time, actions: &mut Vec<Action>) {
        let epoch = self.grant();
        let Some(slot) = self.slots.get_mut(index) else { return };
        let Some(mut process) = slot.candidate.take() else { return };
        let within = slot.service.policy.ready;
        slot.epoch = epoch;
        process.stage = Stage::Promoting { deadline: now + within };
        let (id, instance, swap) = (process.id, process.instance.clone(), process.swap);
        actions.push(Action::Promote { id, instance, epoch, within });
        slot.enter(State::Alive(process), "takes its role", index, actions);
        if let Some(number) = swap {
            slot.swap_enters(number, SwapState::Promoting, "", index, actions);
        }
    }

    pub(super) fn on_promoted(
        &mut self,
        id: ProcessId,
        outcome: Result<(), String>,
        now: Time,
        actions: &mut Vec<Action>,
    ) {
        let waited = |p: &Process| p.id == id && matches!(p.stage, Stage::Promoting { .. });
        let Some((at, _)) = self.find_process(waited) else { return };
        match outcome {
            Ok(()) => self.serves(at.0, now, actions),
            Err(reason) => self.stop(at, AfterStop::Fail(format!("could not take its role: {reason}")), now, actions),
        }
    }
}
