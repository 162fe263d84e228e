//! The state of a stack, and its entry point [`Reconciler::step`].

use std::collections::BTreeSet;
use std::time::Duration;

use super::backoff::Jitter;
use super::model::{AWAKENING_TIME, AWAY_TIME, Action, EXIT_FAILED, Event, Exit, Outcome, PROBE_TIME, Time, Work};
use super::slot::{AfterStop, Occupant, Process, ProcessIndex, Slot, Stage, State, seconds};
use crate::file::Service;

#[derive(Debug, Clone, PartialEq)]
pub(super) enum Goal {
    Run,
    Down(Outcome),
    Finished,
}

/// The state of a stack.
#[derive(Debug, Clone)]
pub struct Reconciler {
    pub(super) slots: Vec<Slot>,
    /// Positions in the order of the launch file. Removed services follow until their processes are gone.
    pub(super) listing: Vec<usize>,
    pub(super) goal: Goal,
    pub(super) processes_started: u64,
    /// Last granted epoch.
    pub(super) epoch: u64,
    pub(super) jitter: Jitter,
    /// Nodes that have joined.
    pub(super) nodes: BTreeSet<String>,
    /// Until then, missing signs of life may be the supervisor's own fault.
    pub(super) awake_at: Time,
    /// End and length of the supervisor's latest standstill.
    pub(super) standstill: Option<(Time, Duration)>,
}

impl Reconciler {
    /// A stack without processes. `seed` spreads the pauses between restarts. Granted epochs are above `epoch`.
    #[must_use]
    pub fn new(services: Vec<Service>, seed: u64, epoch: u64) -> Self {
        Self {
            listing: (0..services.len()).collect(),
            slots: services.into_iter().map(Slot::new).collect(),
            goal: Goal::Run,
            processes_started: 0,
            epoch,
            jitter: Jitter::new(seed),
            nodes: BTreeSet::new(),
            awake_at: Time::ZERO,
            standstill: None,
        }
    }

    /// Applies one event, handles the passed deadlines, and returns the actions, in order.
    pub fn step(&mut self, event: Event, now: Time) -> Vec<Action> {
        self.apply(event, now, true)
    }

    /// As [`Self::step`], but leaves passed deadlines alone. A sign of life that waits behind this event may extend them.
    /// The caller ends its queue with a [`Self::step`].
    pub fn observe(&mut self, event: Event, now: Time) -> Vec<Action> {
        self.apply(event, now, false)
    }

    fn apply(&mut self, event: Event, now: Time, judge: bool) -> Vec<Action> {
        let mut actions = Vec::new();
        if self.goal == Goal::Finished {
            return actions;
        }
        match event {
            Event::Tick => {}
            Event::Started { id, pid } => {
                if let Some((_, process)) = self.find_process(|p| p.id == id) {
                    process.pid = Some(pid);
                }
            }
            Event::Exited { id, exit } => self.on_exited(id, exit, now, &mut actions),
            Event::Ready { instance, start_ms, standby } => {
                if let Some((at, process)) = self.find_process(|p| p.instance == instance) {
                    process.start_ms = Some(start_ms);
                    self.on_ready(at, standby, now, &mut actions);
                }
            }
            // The liveliness token means the same as the announcement. It may come first.
            Event::Presence { instance, alive: true } => {
                if let Some((at, _)) = self.find_process(|p| p.instance == instance) {
                    self.on_ready(at, false, now, &mut actions);
                    self.extend_deadline(at, now);
                }
            }
            Event::Presence { instance, alive: false } => {
                let awake_at = self.awake_at;
                if let Some((_, process)) = self.find_process(|p| p.instance == instance)
                    // The connection to a node may be cut for a while. The lease decides.
                    && process.start.node.is_none()
                    && let Stage::Ready { deadline, .. } = &mut process.stage
                {
                    *deadline = (*deadline).min((now + AWAY_TIME).max(awake_at));
                }
            }
            Event::Awoke(length) => {
                self.awake_at = now + AWAKENING_TIME;
                self.standstill = Some((now, length));
                for at in self.all_processes() {
                    self.extend_deadline(at, now);
                    self.begin_stage_anew(at, now);
                }
            }
            Event::Node { name, present: true } => {
                self.nodes.insert(name);
            }
            Event::Node { name, present: false } => self.node_away(&name, now, &mut actions),
            Event::Health { instance, memory_bytes, answer_ms, work } => {
                if let Some((at, process)) = self.find_process(|p| p.instance == instance) {
                    process.memory_bytes = memory_bytes;
                    process.answer_ms = answer_ms;
                    let loads = work.loading_steps > process.work.loading_steps;
                    process.work = work;
                    self.extend_deadline(at, now);
                    if loads {
                        self.extend_start(at, now);
                    }
                    self.check_memory(at, now, &mut actions);
                    self.check_progress(at, now, &mut actions);
                }
            }
            Event::Verified { id, outcome } => self.on_verified(id, outcome, now, &mut actions),
            Event::Promoted { id, outcome } => self.on_promoted(id, outcome, now, &mut actions),
            Event::SetServices(services) => self.set_services(services, now, &mut actions),
            Event::Swap { service, start } => self.swap(service, start, now, &mut actions),
            Event::Restart { service } => self.restart(service, now, &mut actions),
            Event::Down => self.down(Outcome::Down),
            Event::Kill => {
                self.down(Outcome::Down);
                for at in self.all_processes() {
                    self.stop(at, AfterStop::Stay, now, &mut actions);
                    self.kill(at, now, &mut actions);
                }
            }
        }
        self.settle(now, judge, &mut actions);
        actions
    }

    /// When [`Event::Tick`] is due at the latest; `None` if only an event can change the state.
    #[must_use]
    pub fn next_deadline(&self) -> Option<Time> {
        self.slots.iter().flat_map(Slot::deadlines).min()
    }

    /// Moves the stack towards its goal, until nothing is due at this time.
    fn settle(&mut self, now: Time, judge: bool, actions: &mut Vec<Action>) {
        for at in self.all_processes().into_iter().filter(|_| judge) {
            self.handle_deadline(at, now, actions);
        }
        match &self.goal {
            Goal::Finished => {}
            Goal::Run => {
                if let Some((service, reason)) = self.critical_failure() {
                    self.down(Outcome::Failed { service, reason });
                    return self.settle(now, judge, actions);
                }
                if self.slots.iter().any(|s| s.service.policy.critical && s.state == State::Stopped && !s.removed) {
                    self.down(Outcome::Finished);
                    return self.settle(now, judge, actions);
                }
                // Stop before start: a dependent starts after its dependency has stopped.
                for index in 0..self.slots.len() {
                    self.hand_over_if_due(index, now, actions);
                }
                for index in 0..self.slots.len() {
                    self.start_if_due(index, now, actions);
                    self.start_candidate_if_due(index, now, actions);
                }
                // All remaining services wait for one that will never be ready.
                if !self.slots.iter().any(|s| s.is_active() || self.waits_for_node(s)) {
                    for index in 0..self.slots.len() {
                        self.cancel_before_handover(index, "the stack ended", now, actions);
                    }
                    let failed = self.slots.iter().find(|s| s.state == State::Failed && !s.removed);
                    let outcome = failed.map_or(Outcome::Finished, |s| Outcome::Failed {
                        service: s.service.name.clone(),
                        reason: s.reason.clone(),
                    });
                    self.finish(outcome, actions);
                }
            }
            Goal::Down(outcome) => {
                let outcome = outcome.clone();
                for index in 0..self.slots.len() {
                    self.cancel_swap(index, "the stack stops", now, actions);
                    if let Some(slot) = self.slots.get_mut(index)
                        && matches!(slot.state, State::Waiting | State::Backoff { .. })
                    {
                        slot.enter(State::Stopped, "stopped", index, actions);
                    }
                }
                // Stop in reverse start order, so that a draining service keeps its dependencies.
                let last = self.slots.iter().enumerate().filter(|(_, s)| matches!(s.state, State::Alive(_)));
                match last.map(|(index, s)| (s.order.unwrap_or(0), index)).max() {
                    Some((_, index)) => self.stop((index, Occupant::Serving), AfterStop::Stay, now, actions),
                    None if self.slots.iter().any(|s| s.candidate.is_some()) => {}
                    None => self.finish(outcome, actions),
                }
            }
        }
    }

    pub(super) fn finish(&mut self, outcome: Outcome, actions: &mut Vec<Action>) {
        self.goal = Goal::Finished;
        actions.push(Action::Finish(outcome));
    }

    pub(super) fn down(&mut self, outcome: Outcome) {
        if self.goal == Goal::Run {
            self.goal = Goal::Down(outcome);
        }
    }

    /// The first critical service that failed for good.
    fn critical_failure(&self) -> Option<(String, String)> {
        let failed = |s: &&Slot| s.service.policy.critical && s.state == State::Failed && !s.removed;
        self.slots.iter().find(failed).map(|s| (s.service.name.clone(), s.reason.clone()))
    }

    pub(super) fn grant(&mut self) -> u64 {
        self.epoch += 1;
        self.epoch
    }

    /// All processes. Candidates come first, because they depend on more.
    pub(super) fn all_processes(&self) -> Vec<ProcessIndex> {
        let of = |part| move |(index, slot): (usize, &Slot)| slot.process(part).map(|_| (index, part));
        let candidates = self.slots.iter().enumerate().filter_map(of(Occupant::Candidate));
        candidates.chain(self.slots.iter().enumerate().filter_map(of(Occupant::Serving))).collect()
    }

    pub(super) fn find_process(&mut self, is: impl Fn(&Process) -> bool) -> Option<(ProcessIndex, &mut Process)> {
        self.slots.iter_mut().enumerate().find_map(|(index, slot)| {
            let part =
                [Occupant::Serving, Occupant::Candidate].into_iter().find(|p| slot.process(*p).is_some_and(&is))?;
            Some(((index, part), slot.process_mut(part)?))
        })
    }

    /// Moves the liveness deadline of a process.
    pub(super) fn extend_deadline(&mut self, (index, part): ProcessIndex, now: Time) {
        let Some(slot) = self.slots.get_mut(index) else { return };
        let until = (now + slot.service.policy.liveness).max(self.awake_at);
        if let Some(Process { stage: Stage::Ready { deadline, .. } | Stage::StandingBy { deadline }, .. }) =
            slot.process_mut(part)
        {
            *deadline = until;
        }
    }

    /// Moves the readiness deadline of a process that makes progress while it loads.
    fn extend_start(&mut self, (index, part): ProcessIndex, now: Time) {
        let Some(slot) = self.slots.get_mut(index) else { return };
        let until = now + slot.service.policy.ready;
        if let Some(Process { stage: Stage::Starting { deadline }, .. }) = slot.process_mut(part) {
            *deadline = until;
        }
    }

    /// Gives a process that starts, is probed or takes its role the whole time for it. The bus stood still with the
    /// supervisor, and its clients connect to it again.
    fn begin_stage_anew(&mut self, (index, part): ProcessIndex, now: Time) {
        let Some(slot) = self.slots.get_mut(index) else { return };
        let ready = slot.service.policy.ready;
        match slot.process_mut(part).map(|process| &mut process.stage) {
            Some(Stage::Starting { deadline } | Stage::Promoting { deadline }) => *deadline = now + ready,
            Some(Stage::Verifying { deadline }) => *deadline = now + PROBE_TIME,
            _ => {}
        }
    }

    /// Whether the failed start or promotion of a process may be the supervisor's own fault: the bus stood still during it.
    pub(super) fn excuses_start(&self, process: &Process, exit: &Exit, now: Time) -> bool {
        let Some((awoke, _)) = self.standstill else { return false };
        matches!(process.stage, Stage::Starting { .. } | Stage::Promoting { .. })
            && exit.status == Some(EXIT_FAILED)
            && process.started < awoke
            && now < self.awake_at
    }

    /// Ends a process whose work makes no progress, although it sends signs of life.
    fn check_progress(&mut self, at: ProcessIndex, now: Time, actions: &mut Vec<Action>) {
        let Some(slot) = self.slots.get(at.0) else { return };
        let Some(Process { stage, work, .. }) = slot.process(at.1) else { return };
        let most = slot.service.policy.progress;
        let Work { stalled, stalled_in, .. } = work;
        // While this supervisor was stopped, the bus stood still too, or the whole machine. Work of that time is no hang.
        let stalled = match self.standstill {
            Some((awoke, length)) if *stalled > now.saturating_sub(awoke) => stalled.saturating_sub(length),
            _ => *stalled,
        };
        if stalled < most || now < self.awake_at || !matches!(stage, Stage::Ready { .. } | Stage::StandingBy { .. }) {
            return;
        }
        let reason = format!("hung: {stalled_in} has made no progress for {:.0} s", seconds(stalled));
        self.stop(at, AfterStop::Fail(reason), now, actions);
        // Hung work would delay the answer to SIGTERM.
        self.kill(at, now, actions);
    }

    /// Stops a process above its memory limit.
    pub(super) fn check_memory(&mut self, at: ProcessIndex, now: Time, actions: &mut Vec<Action>) {
        let Some(slot) = self.slots.get(at.0) else { return };
        let (Some(process), Some(most)) = (slot.process(at.1), slot.service.policy.memory_bytes) else { return };
        if process.memory_bytes > most && !matches!(process.stage, Stage::Stopping { .. }) {
            let mib = |bytes: u64| bytes >> 20;
            let reason = format!("uses {} MiB of memory; its limit is {} MiB", mib(process.memory_bytes), mib(most));
            self.stop(at, AfterStop::Fail(reason), now, actions);
        }
    }
}
