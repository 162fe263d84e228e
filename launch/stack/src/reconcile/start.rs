//! Starting processes: after those they come after, and never beside one that serves the same role.

use sg_proto::launch::SwapState;

use super::model::{Action, Exit, ProcessId, Spawn, Time};
use super::reconciler::Reconciler;
use super::slot::{AfterStop, Occupant, Process, Slot, Stage, State};
use crate::file::Start;

impl Reconciler {
    /// Starts a service that waits or has paused long enough, if nothing is missing.
    pub(super) fn start_if_due(&mut self, index: usize, now: Time, actions: &mut Vec<Action>) {
        let Some(slot) = self.slots.get(index) else { return };
        match slot.state {
            _ if slot.removed => return,
            State::Waiting => {}
            State::Backoff { until } if until <= now => {}
            _ => return,
        }
        let successor = slot.hands_over().then(|| "its successor".to_owned());
        let node = self.absent_node(&slot.service.start);
        let missing = [self.unready(index), node, self.occupants(index), Vec::from_iter(successor)].concat();
        let Some(slot) = self.slots.get_mut(index) else { return };
        if !missing.is_empty() {
            let reason = format!("waits for {}", missing.join(", "));
            if slot.state != State::Waiting || slot.reason != reason {
                slot.enter(State::Waiting, reason, index, actions);
            }
            return;
        }
        let epoch = self.grant();
        let Some(slot) = self.slots.get_mut(index) else { return };
        slot.starts += 1;
        slot.start_ms = 0;
        slot.epoch = epoch;
        let start = slot.service.start.clone();
        let reason = std::mem::take(&mut slot.reason);
        let reason = if slot.starts == 1 || reason.starts_with("waits for") { String::new() } else { reason };
        // The action comes first: what is announced is what was asked for.
        let Some(process) = self.spawn(index, start, Some(epoch), now, actions) else { return };
        if let Some(slot) = self.slots.get_mut(index) {
            slot.enter(State::Alive(process), reason, index, actions);
        }
    }

    /// Starts the candidate of a swap that is wished.
    pub(super) fn start_candidate_if_due(&mut self, index: usize, now: Time, actions: &mut Vec<Action>) {
        let Some(slot) = self.slots.get(index) else { return };
        let Some(pending) = slot.next.clone() else { return };
        if slot.candidate.is_some() || slot.hands_over() {
            return;
        }
        let missing = [self.unready(index), self.absent_node(&pending.start)].concat();
        let critical_failure = self.slots.iter().any(|s| s.state == State::Failed && after(slot, s));
        let Some(slot) = self.slots.get_mut(index) else { return };
        if !missing.is_empty() {
            let reason = format!("waits for {}", missing.join(", "));
            if critical_failure {
                slot.next = None;
                slot.swap_enters(pending.number, SwapState::Failed, reason, index, actions);
            } else if slot.swap.as_ref().is_some_and(|s| s.reason != reason) {
                slot.swap_enters(pending.number, SwapState::Waiting, reason, index, actions);
            }
            return;
        }
        slot.next = None;
        let Some(mut process) = self.spawn(index, pending.start, None, now, actions) else { return };
        process.swap = Some(pending.number);
        if let Some(slot) = self.slots.get_mut(index) {
            slot.candidate = Some(process);
            slot.swap_enters(pending.number, SwapState::Starting, "", index, actions);
        }
    }

    /// Asks for a process; without an epoch it stands by.
    fn spawn(
        &mut self,
        index: usize,
        start: Start,
        epoch: Option<u64>,
        now: Time,
        actions: &mut Vec<Action>,
    ) -> Option<Process> {
        let order = self.processes_started;
        let id = ProcessId(order + 1);
        let slot = self.slots.get_mut(index)?;
        self.processes_started += 1;
        slot.processes += 1;
        slot.order.get_or_insert(order);
        let instance = format!("{}-{}", slot.service.name, slot.processes);
        actions.push(Action::Spawn(Box::new(Spawn {
            service: index,
            id,
            instance: instance.clone(),
            role: slot.service.role.clone(),
            start: start.clone(),
            epoch: epoch.unwrap_or(0),
            standby: epoch.is_none(),
            stop: slot.service.policy.stop,
        })));
        Some(Process {
            id,
            instance,
            role: slot.service.role.clone(),
            start,
            pid: None,
            started: now,
            memory_bytes: 0,
            answer_ms: (0.0, 0.0),
            start_ms: None,
            swap: None,
            stage: Stage::Starting { deadline: now + slot.service.policy.ready },
        })
    }

    /// What a service comes after and is not ready, in words.
    fn unready(&self, index: usize) -> Vec<String> {
        let Some(slot) = self.slots.get(index) else { return Vec::new() };
        let missing = self.slots.iter().filter(|s| after(slot, s) && !s.is_ready());
        missing
            .map(|s| match s.state {
                State::Failed => format!("`{}`, which failed", s.service.name),
                _ => format!("`{}`", s.service.name),
            })
            .collect()
    }

    /// The machine that a process is to run on, in words, where it has not joined.
    fn absent_node(&self, start: &Start) -> Vec<String> {
        let absent = start.node.iter().filter(|node| !self.nodes.contains(*node));
        absent.map(|node| format!("node `{node}`, which has not joined")).collect()
    }

    /// Whether a service waits for a machine that may yet join.
    pub(super) fn waits_for_node(&self, slot: &Slot) -> bool {
        slot.state == State::Waiting && !slot.removed && !self.absent_node(&slot.service.start).is_empty()
    }

    /// A machine is away: its lease is over, and with it every process that it ran. Nobody is to blame, so no failure is
    /// counted; the services wait for it to come back.
    pub(super) fn node_away(&mut self, name: &str, now: Time, actions: &mut Vec<Action>) {
        self.nodes.remove(name);
        for (index, part) in self.all_processes() {
            let process = self.slots.get(index).and_then(|s| s.process(part));
            let Some(process) = process.filter(|p| p.start.node.as_deref() == Some(name)) else { continue };
            let id = process.id;
            if part == Occupant::Serving
                && process.swap.is_none()
                && let Some(process) = self.slots.get_mut(index).and_then(|s| s.process_mut(part))
            {
                // As if it had been asked to start again when it can. What looked like a failure was its machine's.
                match &mut process.stage {
                    Stage::Stopping { then: then @ AfterStop::Fail(_), .. } => *then = AfterStop::Restart,
                    Stage::Stopping { .. } => {}
                    stage => *stage = Stage::Stopping { deadline: now, kills: 0, then: AfterStop::Restart },
                }
            }
            let reason = format!("node `{name}` is away");
            self.on_exited(id, Exit { status: None, reason }, now, actions);
        }
        for slot in &mut self.slots {
            slot.lost.retain(|(_, _, node)| node.as_deref() != Some(name));
        }
    }

    /// Who still serves the role of a service or may, in words: no second one may, and none before it is gone.
    pub(super) fn occupants(&self, index: usize) -> Vec<String> {
        let Some(slot) = self.slots.get(index) else { return Vec::new() };
        let role = &slot.service.role;
        let has =
            |s: &Slot| s.main().is_some_and(|p| p.role == *role) || s.lost.iter().any(|(_, lost, _)| lost == role);
        let others = self.slots.iter().enumerate().filter(|(i, s)| *i != index && has(s));
        others.map(|(_, s)| format!("the end of `{}`, which has the role", s.service.name)).collect()
    }
}

/// Whether a service comes after another.
fn after(slot: &Slot, other: &Slot) -> bool {
    slot.service.after.contains(&other.service.name)
}
