//! Stopping processes, and what follows when one is gone or does not go.

use sg_proto::launch::SwapState;

use super::model::{Action, EXIT_INPUT, End, Exit, Incarnation, KILL_TIME, KILLS, PROOF_TIME, Time};
use super::reconciler::{Goal, Reconciler};
use super::slot::{At, Part, Stage, State, Then, seconds};
use crate::file::Restart;

impl Reconciler {
    /// What a stage's deadline brings when it has passed.
    pub(super) fn overdue(&mut self, at: At, now: Time, actions: &mut Vec<Action>) {
        let Some(slot) = self.slots.get(at.0) else { return };
        let policy = &slot.service.policy;
        let Some(process) = slot.process(at.1) else { return };
        if process.stage.deadline() > now {
            return;
        }
        match &process.stage {
            Stage::Starting { .. } => {
                let reason = format!("not ready within {} s", seconds(policy.ready));
                self.stop(at, Then::Fail(reason), now, actions);
            }
            Stage::Proving { .. } => {
                let reason = format!("not proven within {} s", seconds(PROOF_TIME));
                self.stop(at, Then::Fail(reason), now, actions);
            }
            Stage::Promoting { .. } => {
                let reason = format!("did not take its role within {} s", seconds(policy.ready));
                self.stop(at, Then::Fail(reason), now, actions);
            }
            Stage::Ready { .. } | Stage::StandingBy { .. } => {
                let reason = format!("hung: no sign of life for {} s", seconds(policy.liveness));
                self.stop(at, Then::Fail(reason), now, actions);
                // A process that hangs would not hear the request either.
                self.kill(at, now, actions);
            }
            // What another machine runs is over with its lease at the latest: it is told again until then.
            Stage::Stopping { kills, .. } if *kills < KILLS || process.start.node.is_some() => {
                self.kill(at, now, actions);
            }
            Stage::Stopping { .. } => self.lose(at, actions),
        }
    }

    /// Asks a process to stop, unless that has been done; the last wish for what follows counts.
    pub(super) fn stop(&mut self, at: At, then: Then, now: Time, actions: &mut Vec<Action>) {
        let (index, part) = at;
        let Some(slot) = self.slots.get_mut(index) else { return };
        let deadline = now + slot.service.policy.stop;
        let Some(process) = slot.process_mut(part) else { return };
        if let Stage::Stopping { then: present, .. } = &mut process.stage {
            *present = then;
            return;
        }
        actions.push(Action::Terminate(process.incarnation));
        let swap = process.swap;
        process.stage = Stage::Stopping { deadline, kills: 0, then: then.clone() };
        let reason = match then {
            Then::Stay => "asked to stop".to_owned(),
            Then::StartAgain => "asked to restart".to_owned(),
            Then::HandOver => "hands over".to_owned(),
            Then::Fail(reason) | Then::Recover(reason) => reason,
        };
        if let Some(number) = swap {
            self.swap_failed(at, number, &reason, actions);
        }
        if let Some(slot) = self.slots.get_mut(index).filter(|_| part == Part::Main) {
            slot.reason = reason;
            actions.push(Action::Announce { service: index });
        }
    }

    /// Ends a process that was asked to stop.
    pub(super) fn kill(&mut self, (index, part): At, now: Time, actions: &mut Vec<Action>) {
        let Some(process) = self.slots.get_mut(index).and_then(|s| s.process_mut(part)) else { return };
        if let Stage::Stopping { deadline, kills, .. } = &mut process.stage {
            *deadline = now + KILL_TIME;
            *kills = kills.saturating_add(1);
            actions.push(Action::Kill(process.incarnation));
        }
    }

    /// Gives a process up that the system does not remove.
    fn lose(&mut self, (index, part): At, actions: &mut Vec<Action>) {
        let Some(slot) = self.slots.get_mut(index) else { return };
        let Some(process) = slot.process(part) else { return };
        let (incarnation, pid, role) = (process.incarnation, process.pid.unwrap_or(0), process.role.clone());
        let node = process.start.node.clone();
        actions.push(Action::Ended { service: index, incarnation, end: End::Lost });
        match part {
            Part::Newcomer => slot.newcomer = None,
            Part::Main => {
                slot.lost.push((incarnation, role, node));
                let reason = format!("process {pid} was killed but the system does not remove it");
                slot.enter(State::Failed, reason, index, actions);
            }
        }
    }

    /// An incarnation is over.
    pub(super) fn exited(&mut self, incarnation: Incarnation, exit: Exit, now: Time, actions: &mut Vec<Action>) {
        let Some(((index, part), _)) = self.process_of(|p| p.incarnation == incarnation) else {
            // One that was given up may be removed after all; it was counted when it was given up.
            self.slots.iter_mut().for_each(|s| s.lost.retain(|(i, _, _)| *i != incarnation));
            return;
        };
        match part {
            Part::Main => self.main_exited(index, exit, now, actions),
            Part::Newcomer => self.newcomer_exited(index, &exit, actions),
        }
    }

    fn newcomer_exited(&mut self, index: usize, exit: &Exit, actions: &mut Vec<Action>) {
        let Some(process) = self.slots.get_mut(index).and_then(|s| s.newcomer.take()) else { return };
        let end = match &process.stage {
            Stage::Stopping { then: Then::Fail(reason), .. } => End::Failed(reason.clone()),
            Stage::Stopping { .. } => End::Stopped,
            _ if exit.status == Some(0) => End::Finished,
            _ => End::Failed(exit.reason.clone()),
        };
        actions.push(Action::Ended { service: index, incarnation: process.incarnation, end });
        if let Some(number) = process.swap
            && !matches!(process.stage, Stage::Stopping { .. })
        {
            self.swap_failed((index, Part::Newcomer), number, &exit.reason, actions);
        }
    }

    fn main_exited(&mut self, index: usize, exit: Exit, now: Time, actions: &mut Vec<Action>) {
        let running = self.goal == Goal::Run;
        let Some(slot) = self.slots.get_mut(index) else { return };
        let State::Alive(process) = &slot.state else { return };
        let (incarnation, swap) = (process.incarnation, process.swap);
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
            Some(Then::Stay | Then::StartAgain | Then::HandOver | Then::Recover(_)) => End::Stopped,
            Some(Then::Fail(reason)) => End::Failed(reason.clone()),
            None if exit.status == Some(0) => End::Finished,
            None => End::Failed(exit.reason.clone()),
        };
        actions.push(Action::Ended { service: index, incarnation, end });
        if let Some(number) = swap
            && asked.is_none()
        {
            self.swap_failed((index, Part::Main), number, &exit.reason, actions);
        }
        let Some(slot) = self.slots.get_mut(index) else { return };
        let wrong_input = exit.status == Some(EXIT_INPUT);
        // Where a newcomer failed that had been let in, the start in force is another one, which served well.
        let (reason, failed, recover) = match asked {
            Some(Then::Stay) => return slot.enter(State::Stopped, "stopped", index, actions),
            Some(Then::StartAgain) => return slot.enter(State::Waiting, "asked to restart", index, actions),
            Some(Then::HandOver) => {
                slot.state = State::Waiting;
                return self.hand_over_if_due(index, now, actions);
            }
            Some(Then::Fail(reason)) => (reason, true, swap.is_some()),
            Some(Then::Recover(reason)) => (reason, true, true),
            None => (exit.reason, exit.status != Some(0) || swap.is_some(), swap.is_some()),
        };
        if !running || slot.removed {
            // It ended by itself before its turn to be stopped came.
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

    /// A person wants a service restarted; a swap under way is withdrawn.
    pub(super) fn restart(&mut self, index: usize, now: Time, actions: &mut Vec<Action>) {
        if self.goal != Goal::Run || self.slots.get(index).is_none_or(|s| s.removed) {
            return;
        }
        self.withdraw(index, "a restart was asked for", now, actions);
        let Some(slot) = self.slots.get_mut(index) else { return };
        slot.failures = 0;
        slot.recent.clear();
        match slot.state {
            _ if !slot.lost.is_empty() => {}
            State::Alive(_) => self.stop((index, Part::Main), Then::StartAgain, now, actions),
            State::Waiting => {}
            State::Backoff { .. } | State::Stopped | State::Failed => {
                slot.enter(State::Waiting, "asked to restart", index, actions);
            }
        }
    }

    /// A swap failed while this process of it ran or stopped. What served before goes on; if it was asked to stop
    /// already, it is started again.
    fn swap_failed(&mut self, (index, part): At, number: u64, reason: &str, actions: &mut Vec<Action>) {
        let Some(slot) = self.slots.get_mut(index) else { return };
        slot.swap_enters(number, SwapState::Failed, reason, index, actions);
        if part == Part::Newcomer
            && let Some(Stage::Stopping { then: then @ Then::HandOver, .. }) =
                slot.process_mut(Part::Main).map(|p| &mut p.stage)
        {
            *then = Then::Recover(format!("its successor failed: {reason}"));
        }
    }
}
