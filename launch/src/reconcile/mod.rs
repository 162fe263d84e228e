//! The supervisor's mind: desired state against observed state, as a pure state machine.
//!
//! [`Reconciler::step`] takes one event and the time and says what is to be done; it reads no clock, starts nothing and
//! waits for nothing, so that tests can drive it through years of failures. First start, restart, swap, reload and stop are
//! one path: an event changes what is wished or what is known, and the machine then settles towards its goal.
//!
//! A service is a slot that keeps its position for as long as the supervisor lives. A slot has at most one process that
//! serves and at most one newcomer that stands by to replace it. Every state that has a process, and every pause, has a
//! deadline ([`Reconciler::next_deadline`]).

mod backoff;
mod handover;
mod intensity;
mod reload;
mod slot;
mod start;
mod stop;
mod view;

use std::collections::BTreeSet;
use std::time::Duration;

use sg_proto::launch;

use crate::file::{Service, Start};
use backoff::Jitter;
use slot::{Part, Slot, Stage, State};

/// Time since the supervisor began.
pub type Time = Duration;

/// Exit status by which a process says that its parameters or input are wrong: starting it again would not help.
const EXIT_INPUT: i32 = sg_runtime::process::EXIT_INPUT as i32;

/// How long the system may take to remove a process after a kill.
const KILL_TIME: Duration = Duration::from_secs(5);
/// Kills after which a process counts as one that the system does not remove.
const KILLS: u32 = 2;
/// How long a ready service may be away from the bus.
const AWAY_TIME: Duration = Duration::from_secs(1);
/// How long the proof of a newcomer may take.
pub const PROOF_TIME: Duration = Duration::from_secs(10);

/// One process that was started, never reused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Incarnation(pub u64);

/// Something that happened.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// Time passed.
    Tick,
    /// The process of an incarnation runs.
    Started {
        /// Which.
        incarnation: Incarnation,
        /// Its process id.
        pid: u32,
    },
    /// An incarnation is over: its process is gone, or could not be started.
    Exited {
        /// Which.
        incarnation: Incarnation,
        /// How.
        exit: Exit,
    },
    /// An instance said that it serves, or that it stands by.
    Ready {
        /// Its name.
        instance: String,
        /// From the start of its process to readiness, as it measured.
        start_ms: u64,
        /// Whether it serves under its instance only, until it is promoted.
        standby: bool,
    },
    /// A newcomer was proven or not.
    Proven {
        /// Which.
        incarnation: Incarnation,
        /// What is wrong with it, if anything is.
        outcome: Result<(), String>,
    },
    /// A newcomer took its role or could not.
    Promoted {
        /// Which.
        incarnation: Incarnation,
        /// Why it could not.
        outcome: Result<(), String>,
    },
    /// An instance gave a sign of life.
    Health {
        /// Its name.
        instance: String,
        /// Resident memory.
        memory_bytes: u64,
        /// Milliseconds from the receipt of a request to its answer: median and 99th percentile.
        answer_ms: (f64, f64),
    },
    /// An instance appeared on the bus (true) or left it.
    Seen {
        /// Its name.
        instance: String,
        /// Whether it is there.
        alive: bool,
    },
    /// A machine joined (true), or is away and what ran there is over.
    Node {
        /// Its name.
        name: String,
        /// Whether it is there.
        present: bool,
    },
    /// These are the services from now on, each after those it comes after.
    Desire(Vec<Service>),
    /// A person wants a service replaced by a process that is started like this.
    Swap {
        /// Position of the service.
        service: usize,
        /// What the newcomer is started with.
        start: Start,
    },
    /// A person wants a service restarted.
    Restart {
        /// Position of the service.
        service: usize,
    },
    /// The stack is to stop.
    Down,
    /// The stack is to stop at once, whatever is lost.
    Kill,
}

/// How a process ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Exit {
    /// Exit status; `None` if a signal ended it or it never ran.
    pub status: Option<i32>,
    /// One line for a person: status or signal, and its last words.
    pub reason: String,
}

/// A process that is to be started.
#[derive(Debug, Clone, PartialEq)]
pub struct Spawn {
    /// Position of the service.
    pub service: usize,
    /// Its new incarnation.
    pub incarnation: Incarnation,
    /// Name under which the process goes.
    pub instance: String,
    /// Role that it serves or is to serve.
    pub role: String,
    /// What it is started with.
    pub start: Start,
    /// Epoch of the role; 0 for one that stands by, which gets its epoch with its promotion.
    pub epoch: u64,
    /// Whether it is to serve under its instance only.
    pub standby: bool,
    /// Time between the request to stop and the kill.
    pub stop: Duration,
}

/// What is to be done.
#[derive(Debug, Clone, PartialEq)]
pub enum Action {
    /// Start a process. [`Event::Started`] or [`Event::Exited`] must follow.
    Spawn(Box<Spawn>),
    /// Look whether a newcomer speaks the contract of its role. [`Event::Proven`] must follow within [`PROOF_TIME`].
    Prove {
        /// Which.
        incarnation: Incarnation,
        /// Its name.
        instance: String,
        /// Its role.
        role: String,
    },
    /// Let a newcomer take its role. [`Event::Promoted`] must follow within the time.
    Promote {
        /// Which.
        incarnation: Incarnation,
        /// Its name.
        instance: String,
        /// Epoch of the role from now on.
        epoch: u64,
        /// How long it may take.
        within: Duration,
    },
    /// Ask a process to stop.
    Terminate(Incarnation),
    /// End a process.
    Kill(Incarnation),
    /// An incarnation is over.
    Ended {
        /// Position of the service.
        service: usize,
        /// Which.
        incarnation: Incarnation,
        /// How.
        end: End,
    },
    /// A service changed its state.
    Announce {
        /// Position of the service.
        service: usize,
    },
    /// The swap of a service changed its state.
    AnnounceSwap {
        /// Position of the service.
        service: usize,
        /// As it stands; the service may be swapped anew by now.
        swap: Box<launch::Swap>,
    },
    /// Nothing is left to do.
    Finish(Outcome),
}

/// The terminal state of an incarnation.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum End {
    /// It was asked to stop and did.
    Stopped,
    /// It ended by itself with status 0.
    Finished,
    /// It failed: crashed, was never ready, hung, refused its input or could not be started.
    Failed(String),
    /// The system does not remove its process.
    Lost,
}

/// How the stack ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Outcome {
    /// It was asked to.
    Down,
    /// A critical service failed for good, or no service was left and one had failed.
    Failed {
        /// Name of the service.
        service: String,
        /// Why.
        reason: String,
    },
    /// All services, or a critical one, ended by themselves and had done what they were there for.
    Finished,
}

#[derive(Debug, Clone, PartialEq)]
enum Goal {
    Run,
    Down(Outcome),
    Finished,
}

/// The state of a stack.
#[derive(Debug, Clone)]
pub struct Reconciler {
    slots: Vec<Slot>,
    /// Positions in the order of the launch file; what was removed comes after those until it is gone.
    listing: Vec<usize>,
    goal: Goal,
    incarnations: u64,
    /// Last one granted.
    epoch: u64,
    jitter: Jitter,
    /// Machines that have joined.
    nodes: BTreeSet<String>,
}

impl Reconciler {
    /// A stack of which nothing runs yet. `seed` spreads the pauses between restarts; epochs are granted from above
    /// `epoch` on.
    #[must_use]
    pub fn new(services: Vec<Service>, seed: u64, epoch: u64) -> Self {
        Self {
            listing: (0..services.len()).collect(),
            slots: services.into_iter().map(Slot::new).collect(),
            goal: Goal::Run,
            incarnations: 0,
            epoch,
            jitter: Jitter::new(seed),
            nodes: BTreeSet::new(),
        }
    }

    /// Takes one event into account and says what is to be done, in order.
    pub fn step(&mut self, event: Event, now: Time) -> Vec<Action> {
        let mut actions = Vec::new();
        if self.goal == Goal::Finished {
            return actions;
        }
        match event {
            Event::Tick => {}
            Event::Started { incarnation, pid } => {
                if let Some((_, process)) = self.process_of(|p| p.incarnation == incarnation) {
                    process.pid = Some(pid);
                }
            }
            Event::Exited { incarnation, exit } => self.exited(incarnation, exit, now, &mut actions),
            Event::Ready { instance, start_ms, standby } => {
                if let Some((at, process)) = self.process_of(|p| p.instance == instance) {
                    process.start_ms = Some(start_ms);
                    self.heard(at, standby, now, &mut actions);
                }
            }
            // The token says the same as the announcement, which may come a moment later.
            Event::Seen { instance, alive: true } => {
                if let Some((at, _)) = self.process_of(|p| p.instance == instance) {
                    self.heard(at, false, now, &mut actions);
                    self.postpone(at, now);
                }
            }
            Event::Seen { instance, alive: false } => {
                if let Some((_, process)) = self.process_of(|p| p.instance == instance)
                    // The way to another machine may be cut for a while; its lease says when that is too long.
                    && process.start.node.is_none()
                    && let Stage::Ready { deadline, .. } = &mut process.stage
                {
                    *deadline = (*deadline).min(now + AWAY_TIME);
                }
            }
            Event::Node { name, present: true } => {
                self.nodes.insert(name);
            }
            Event::Node { name, present: false } => self.node_away(&name, now, &mut actions),
            Event::Health { instance, memory_bytes, answer_ms } => {
                if let Some((at, process)) = self.process_of(|p| p.instance == instance) {
                    process.memory_bytes = memory_bytes;
                    process.answer_ms = answer_ms;
                    self.postpone(at, now);
                    self.weigh(at, now, &mut actions);
                }
            }
            Event::Proven { incarnation, outcome } => self.proven(incarnation, outcome, now, &mut actions),
            Event::Promoted { incarnation, outcome } => self.promoted(incarnation, outcome, now, &mut actions),
            Event::Desire(services) => self.desire(services, now, &mut actions),
            Event::Swap { service, start } => self.swap(service, start, now, &mut actions),
            Event::Restart { service } => self.restart(service, now, &mut actions),
            Event::Down => self.down(Outcome::Down),
            Event::Kill => {
                self.down(Outcome::Down);
                for at in self.parts() {
                    self.stop(at, slot::Then::Stay, now, &mut actions);
                    self.kill(at, now, &mut actions);
                }
            }
        }
        self.settle(now, &mut actions);
        actions
    }

    /// When [`Event::Tick`] is due at the latest; `None` if only an event can change anything.
    #[must_use]
    pub fn next_deadline(&self) -> Option<Time> {
        self.slots.iter().flat_map(Slot::deadlines).min()
    }

    /// Brings the stack one step nearer to its goal, until nothing is due at this time.
    fn settle(&mut self, now: Time, actions: &mut Vec<Action>) {
        for at in self.parts() {
            self.overdue(at, now, actions);
        }
        match &self.goal {
            Goal::Finished => {}
            Goal::Run => {
                if let Some((service, reason)) = self.hopeless() {
                    self.down(Outcome::Failed { service, reason });
                    return self.settle(now, actions);
                }
                if self.slots.iter().any(|s| s.service.policy.critical && s.state == State::Stopped && !s.removed) {
                    self.down(Outcome::Finished);
                    return self.settle(now, actions);
                }
                // Whoever is to stop stops before anybody is started who depends on it.
                for index in 0..self.slots.len() {
                    self.hand_over_if_due(index, now, actions);
                }
                for index in 0..self.slots.len() {
                    self.start_if_due(index, now, actions);
                    self.start_newcomer_if_due(index, now, actions);
                }
                // What waits now waits for something that will never be ready.
                if !self.slots.iter().any(|s| s.is_active() || self.waits_for_node(s)) {
                    for index in 0..self.slots.len() {
                        self.retract(index, "the stack ended", now, actions);
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
                    self.withdraw(index, "the stack stops", now, actions);
                    if let Some(slot) = self.slots.get_mut(index)
                        && matches!(slot.state, State::Waiting | State::Backoff { .. })
                    {
                        slot.enter(State::Stopped, "stopped", index, actions);
                    }
                }
                // One after another, the last one started first: nobody loses what it depends on while it drains.
                let last = self.slots.iter().enumerate().filter(|(_, s)| matches!(s.state, State::Alive(_)));
                match last.map(|(index, s)| (s.order.unwrap_or(0), index)).max() {
                    Some((_, index)) => self.stop((index, Part::Main), slot::Then::Stay, now, actions),
                    None if self.slots.iter().any(|s| s.newcomer.is_some()) => {}
                    None => self.finish(outcome, actions),
                }
            }
        }
    }

    fn finish(&mut self, outcome: Outcome, actions: &mut Vec<Action>) {
        self.goal = Goal::Finished;
        actions.push(Action::Finish(outcome));
    }

    fn down(&mut self, outcome: Outcome) {
        if self.goal == Goal::Run {
            self.goal = Goal::Down(outcome);
        }
    }

    /// The first critical service that failed for good.
    fn hopeless(&self) -> Option<(String, String)> {
        let failed = |s: &&Slot| s.service.policy.critical && s.state == State::Failed && !s.removed;
        self.slots.iter().find(failed).map(|s| (s.service.name.clone(), s.reason.clone()))
    }

    fn grant(&mut self) -> u64 {
        self.epoch += 1;
        self.epoch
    }
}

#[cfg(test)]
mod tests;
