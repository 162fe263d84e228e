//! Stopping processes, and handling their ends.

use sg_proto::launch::SwapState;

use super::model::{Action, EXIT_INPUT, End, Exit, KILL_TIME, KILLS, PROBE_TIME, ProcessId, Time};
use super::reconciler::{Goal, Reconciler};
use super::slot::{AfterStop, Occupant, PendingSwap, Process, ProcessIndex, Slot, Stage, State, seconds};
use crate::file::Restart;

impl Reconciler {
    /// Handles a passed deadline.
    pub(super) fn handle_deadline(&mut self, at: ProcessIndex, now: Time, actions: &mut Vec<Action>) {
        let Some(slot) = self.slots.get(at.0) else { return };
        let policy = &slot.service.policy;
        let Some(process) = slot.process(at.1) else { return };
        if process.stage.deadline() > now {
            return;
        }
        match &process.stage {
            Stage::Starting { .. } => {
                let reason = format!("not ready within {} s", seconds(policy.ready));
                self.stop(at, AfterStop::Fail(reason), now, actions);
            }
            Stage::Verifying { .. } => {
                let reason = format!("no result of the probe within {} s", seconds(PROBE_TIME));
                self.stop(at, AfterStop::Fail(reason), now, actions);
            }
            Stage::Promoting { .. } => {
                let reason = format!("did not take its role within {} s", seconds(policy.ready));
                self.stop(at, AfterStop::Fail(reason), now, actions);
            }
            Stage::Ready { .. } | Stage::StandingBy { .. } => {
                let reason = format!("hung: no sign of life for {} s", seconds(policy.liveness));
                self.stop(at, AfterStop::Fail(reason), now, actions);
                // A hung process would ignore SIGTERM too.
                self.kill(at, now, actions);
            }
            // The lease ends the processes of a node at the latest. Repeat the kill until then.
            Stage::Stopping { kills, .. } if *kills < KILLS || process.start.node.is_some() => {
                self.kill(at, now, actions);
            }
            Stage::Stopping { .. } => self.mark_lost(at, actions),
        }
    }

    /// Asks a process to stop. A later call replaces the follow-up of an earlier one.
    pub(super) fn stop(&mut self, at: ProcessIndex, then: AfterStop, now: Time, actions: &mut Vec<Action>) {
        let (index, part) = at;
        let Some(slot) = self.slots.get_mut(index) else { return };
        let deadline = now + slot.service.policy.stop;
        let Some(process) = slot.process_mut(part) else { return };
        if let Stage::Stopping { then: present, .. } = &mut process.stage {
            *present = then;
            return;
        }
        actions.push(Action::Terminate(process.id));
        let swap = process.swap;
        process.stage = Stage::Stopping { deadline, kills: 0, then: then.clone() };
        let reason = match then {
            AfterStop::Stay => "asked to stop".to_owned(),
            AfterStop::Restart => "asked to restart".to_owned(),
            AfterStop::HandOver => "hands over".to_owned(),
            AfterStop::Fail(reason) | AfterStop::Recover(reason) => reason,
        };
        if let Some(number) = swap {
            self.swap_failed(at, number, &reason, actions);
        }
        if let Some(slot) = self.slots.get_mut(index).filter(|_| part == Occupant::Serving) {
            slot.reason = reason;
            actions.push(Action::Announce { service: index });
        }
    }

    /// Kills a process that was asked to stop.
    pub(super) fn kill(&mut self, (index, part): ProcessIndex, now: Time, actions: &mut Vec<Action>) {
        let Some(process) = self.slots.get_mut(index).and_then(|s| s.process_mut(part)) else { return };
        if let Stage::Stopping { deadline, kills, .. } = &mut process.stage {
            *deadline = now + KILL_TIME;
            *kills = kills.saturating_add(1);
            actions.push(Action::Kill(process.id));
        }
    }

    /// Gives up a process that the system does not remove.
    fn mark_lost(&mut self, (index, part): ProcessIndex, actions: &mut Vec<Action>) {
        let Some(slot) = self.slots.get_mut(index) else { return };
        let Some(process) = slot.process(part) else { return };
        let (id, pid, role) = (process.id, process.pid.unwrap_or(0), process.role.clone());
        let node = process.start.node.clone();
        actions.push(Action::Ended { service: index, id, end: End::Lost });
        match part {
            Occupant::Candidate => slot.candidate = None,
            Occupant::Serving => {
                slot.lost.push((id, role, node));
                let reason = format!("process {pid} was killed, but the system does not remove it");
                slot.enter(State::Failed, reason, index, actions);
            }
        }
    }

    /// Handles the end of a process.
    pub(super) fn on_exited(&mut self, id: ProcessId, exit: Exit, now: Time, actions: &mut Vec<Action>) {
        let Some(((index, part), _)) = self.find_process(|p| p.id == id) else {
            // A lost process may still end. It was counted when it was given up.
            self.slots.iter_mut().for_each(|s| s.lost.retain(|(i, _, _)| *i != id));
            return;
        };
        match part {
            Occupant::Serving => self.main_exited(index, exit, now, actions),
            Occupant::Candidate => self.candidate_exited(index, &exit, now, actions),
        }
    }

    fn candidate_exited(&mut self, index: usize, exit: &Exit, now: Time, actions: &mut Vec<Action>) {
        let Some(process) = self.slots.get_mut(index).and_then(|s| s.candidate.take()) else { return };
        let end = match &process.stage {
            Stage::Stopping { then: AfterStop::Fail(reason), .. } => End::Failed(reason.clone()),
            Stage::Stopping { .. } => End::Stopped,
            _ if exit.status == Some(0) => End::Finished,
            _ => End::Failed(exit.reason.clone()),
        };
        actions.push(Action::Ended { service: index, id: process.id, end });
        if self.excuses_start(&process, exit, now) {
            return self.swap_again(index, process, &exit.reason, actions);
        }
        if let Some(number) = process.swap
            && !matches!(process.stage, Stage::Stopping { .. })
        {
            self.swap_failed((index, Occupant::Candidate), number, &exit.reason, actions);
        }
    }

    /// Goes on with the swap of an ended candidate: with another process of the same start.
    fn swap_again(&mut self, index: usize, ended: Process, reason: &str, actions: &mut Vec<Action>) {
        let Some(slot) = self.slots.get_mut(index) else { return };
        if let (Some(number), None) = (ended.swap, &slot.next) {
            slot.next = Some(PendingSwap { number, start: ended.start });
            slot.swap_enters(number, SwapState::Waiting, reason, index, actions);
        }
    }

    fn main_exited(&mut self, index: usize, exit: Exit, now: Time, actions: &mut Vec<Action>) {
        let running = self.goal == Goal::Run;
        let Some(slot) = self.slots.get_mut(index) else { return };
        let State::Alive(process) = &slot.state else { return };
        let (id, swap) = (process.id, process.swap);
        if let Stage::Ready { since, .. } = process.stage
            && now.saturating_sub(since) >= slot.service.policy.backoff_max
        {
            slot.failures = 0;
        }
        let asked = match &process.stage {
            Stage::Stopping { then, .. } => Some(then.clone()),
            _ => None,
        };
        let end = match &asked {
            Some(AfterStop::Stay | AfterStop::Restart | AfterStop::HandOver | AfterStop::Recover(_)) => End::Stopped,
            Some(AfterStop::Fail(reason)) => End::Failed(reason.clone()),
            None if exit.status == Some(0) => End::Finished,
            None => End::Failed(exit.reason.clone()),
        };
        let excused = self.slots.get(index).and_then(Slot::main).filter(|p| self.excuses_start(p, &exit, now)).cloned();
        actions.push(Action::Ended { service: index, id, end });
        if let Some(process) = excused.filter(|_| running && !self.slots.get(index).is_none_or(|s| s.removed)) {
            // It starts again at once, and no failure is counted.
            self.swap_again(index, process, &exit.reason, actions);
            let Some(slot) = self.slots.get_mut(index) else { return };
            return slot.enter(State::Waiting, exit.reason, index, actions);
        }
        if let Some(number) = swap
            && asked.is_none()
        {
            self.swap_failed((index, Occupant::Serving), number, &exit.reason, actions);
        }
        let Some(slot) = self.slots.get_mut(index) else { return };
        let wrong_input = exit.status == Some(EXIT_INPUT);
        // If a promoted candidate failed, the start in force is the old one, which worked.
        let (reason, failed, recover) = match asked {
            Some(AfterStop::Stay) => return slot.enter(State::Stopped, "stopped", index, actions),
            Some(AfterStop::Restart) => return slot.enter(State::Waiting, "asked to restart", index, actions),
            Some(AfterStop::HandOver) => {
                slot.state = State::Waiting;
                return self.hand_over_if_due(index, now, actions);
            }
            Some(AfterStop::Fail(reason)) => (reason, true, swap.is_some()),
            Some(AfterStop::Recover(reason)) => (reason, true, true),
            None => (exit.reason, exit.status != Some(0) || swap.is_some(), swap.is_some()),
        };
        if !running || slot.removed {
            // It ended by itself before its turn to stop.
            return slot.enter(if failed { State::Failed } else { State::Stopped }, reason, index, actions);
        }
        if recover {
            return self.fail(index, reason, now, actions);
        }
        match (slot.service.policy.restart, failed) {
            (_, true) if wrong_input => slot.enter(State::Failed, reason, index, actions),
            (Restart::Never | Restart::OnFailure, false) => {
                slot.enter(State::Stopped, reason, index, actions);
            }
            (Restart::Never, true) => slot.enter(State::Failed, reason, index, actions),
            _ => self.fail(index, reason, now, actions),
        }
    }

    /// Restarts a service on request. Cancels a running swap.
    pub(super) fn restart(&mut self, index: usize, now: Time, actions: &mut Vec<Action>) {
        if self.goal != Goal::Run || self.slots.get(index).is_none_or(|s| s.removed) {
            return;
        }
        self.cancel_swap(index, "a restart was requested", now, actions);
        let Some(slot) = self.slots.get_mut(index) else { return };
        slot.failures = 0;
        slot.recent.clear();
        match slot.state {
            _ if !slot.lost.is_empty() => {}
            State::Alive(_) => self.stop((index, Occupant::Serving), AfterStop::Restart, now, actions),
            State::Waiting => {}
            State::Backoff { .. } | State::Stopped | State::Failed => {
                slot.enter(State::Waiting, "asked to restart", index, actions);
            }
        }
    }

    /// Handles a failed swap. The old process goes on serving, or is started again if it was asked to stop.
    fn swap_failed(&mut self, (index, part): ProcessIndex, number: u64, reason: &str, actions: &mut Vec<Action>) {
        let Some(slot) = self.slots.get_mut(index) else { return };
        slot.swap_enters(number, SwapState::Failed, reason, index, actions);
        if part == Occupant::Candidate
            && let Some(Stage::Stopping { then: then @ AfterStop::HandOver, .. }) =
                slot.process_mut(Occupant::Serving).map(|p| &mut p.stage)
        {
            *then = AfterStop::Recover(format!("its candidate failed: {reason}"));
        }
    }
}
