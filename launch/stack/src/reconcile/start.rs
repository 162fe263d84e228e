//! Starting processes: after their dependencies, and never two in one role.

use sg_proto::keys;
use sg_proto::launch::SwapState;

use super::model::{Action, Exit, ProcessId, Spawn, Time, Work};
use super::reconciler::Reconciler;
use super::slot::{AfterStop, Occupant, Process, Slot, Stage, State};
use crate::file::Start;

impl Reconciler {
    /// Starts a waiting or paused service if nothing is missing.
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
        // Spawn first, so that the announcement reports the new process.
        let Some(process) = self.spawn(index, start, Some(epoch), now, actions) else { return };
        if let Some(slot) = self.slots.get_mut(index) {
            slot.enter(State::Alive(process), reason, index, actions);
        }
    }

    /// Starts the candidate of a pending swap.
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

    /// Adds the action that spawns a process. Without an epoch it starts in standby.
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
        let instance = format!("{}{}", keys::instance_prefix(&slot.service.name), slot.processes);
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
            work: Work::default(),
            start_ms: None,
            swap: None,
            stage: Stage::Starting { deadline: now + slot.service.policy.ready },
        })
    }

    /// Dependencies that are not ready, in words.
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

    /// The node of a process if it has not joined, in words.
    fn absent_node(&self, start: &Start) -> Vec<String> {
        let absent = start.node.iter().filter(|node| !self.nodes.contains(*node));
        absent.map(|node| format!("node `{node}`, which has not joined")).collect()
    }

    /// Whether a service waits for a node that may still join.
    pub(super) fn waits_for_node(&self, slot: &Slot) -> bool {
        slot.state == State::Waiting && !slot.removed && !self.absent_node(&slot.service.start).is_empty()
    }

    /// Handles the end of a node's lease: all its processes count as ended. This is no failure of the services, which
    /// wait for the node.
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
                // Treat it as a requested restart: the apparent failure was the node's.
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

    /// Other processes that hold or may hold the role, in words. They block a start.
    pub(super) fn occupants(&self, index: usize) -> Vec<String> {
        let Some(slot) = self.slots.get(index) else { return Vec::new() };
        let role = &slot.service.role;
        let has =
            |s: &Slot| s.main().is_some_and(|p| p.role == *role) || s.lost.iter().any(|(_, lost, _)| lost == role);
        let others = self.slots.iter().enumerate().filter(|(i, s)| *i != index && has(s));
        others.map(|(_, s)| format!("the end of `{}`, which has the role", s.service.name)).collect()
    }
}

/// Whether a service depends on another.
fn after(slot: &Slot, other: &Slot) -> bool {
    slot.service.after.contains(&other.service.name)
}
