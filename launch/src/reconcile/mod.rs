//! The supervisor's mind: desired state against observed state, as a pure state machine.
//!
//! [`Reconciler::step`] takes one event and the time and says what is to be done; it reads no clock, starts nothing and
//! waits for nothing, so that tests can drive it through years of failures. First start, restart and stop are one path:
//! whatever happened, the machine then settles towards its goal.
//!
//! Every state that has a process, and every pause, has a deadline ([`Reconciler::next_deadline`]).

mod backoff;
mod view;

use std::collections::VecDeque;
use std::time::Duration;

use crate::file::{Policy, Restart};
use backoff::Jitter;

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

/// One process that was started, never reused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Incarnation(pub u64);

/// A service as it is to be kept.
#[derive(Debug, Clone)]
pub struct Desired {
    /// Name within the launch file.
    pub name: String,
    /// Role.
    pub role: String,
    /// Positions of the services that must be ready before it starts; all smaller than its own.
    pub after: Vec<usize>,
    /// How it is watched.
    pub policy: Policy,
}

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
    /// An instance said that it serves.
    Ready {
        /// Its name.
        instance: String,
        /// From the start of its process to readiness, as it measured.
        start_ms: u64,
    },
    /// An instance gave a sign of life.
    Health {
        /// Its name.
        instance: String,
        /// Resident memory.
        memory_bytes: u64,
    },
    /// An instance appeared on the bus (true) or left it.
    Seen {
        /// Its name.
        instance: String,
        /// Whether it is there.
        alive: bool,
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

/// What is to be done.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Action {
    /// Start a process. [`Event::Started`] or [`Event::Exited`] must follow.
    Spawn {
        /// Position of the service.
        service: usize,
        /// Its new incarnation.
        incarnation: Incarnation,
        /// Name under which the process goes.
        instance: String,
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
    /// All services ended by themselves.
    Finished,
}

#[derive(Debug, Clone, PartialEq)]
enum State {
    /// For those it comes after.
    Waiting,
    /// Has a process.
    Alive(Process, Stage),
    /// Until the next start.
    Backoff {
        until: Time,
    },
    Stopped,
    Failed,
}

#[derive(Debug, Clone, PartialEq)]
struct Process {
    incarnation: Incarnation,
    instance: String,
    /// Known once it runs.
    pid: Option<u32>,
    started: Time,
}

#[derive(Debug, Clone, PartialEq)]
enum Stage {
    Starting { deadline: Time },
    Ready { since: Time, deadline: Time },
    Stopping { deadline: Time, kills: u32, then: Then },
}

/// What follows a stop.
#[derive(Debug, Clone, PartialEq)]
enum Then {
    Stay,
    StartAgain,
    Fail(String),
}

#[derive(Debug, Clone)]
struct Watched {
    desired: Desired,
    state: State,
    /// Processes started so far.
    starts: u32,
    /// Position in the order of first starts.
    order: Option<u64>,
    /// Failures since it was last well.
    failures: u32,
    /// Automatic restarts within the intensity's window.
    recent: VecDeque<Time>,
    reason: String,
    start_ms: u64,
    memory_bytes: u64,
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
    services: Vec<Watched>,
    goal: Goal,
    incarnations: u64,
    jitter: Jitter,
}

impl Reconciler {
    /// A stack of which nothing runs yet. `seed` spreads the pauses between restarts.
    #[must_use]
    pub fn new(services: Vec<Desired>, seed: u64) -> Self {
        let watched = |desired| Watched {
            desired,
            state: State::Waiting,
            starts: 0,
            order: None,
            failures: 0,
            recent: VecDeque::new(),
            reason: String::new(),
            start_ms: 0,
            memory_bytes: 0,
        };
        Self {
            services: services.into_iter().map(watched).collect(),
            goal: Goal::Run,
            incarnations: 0,
            jitter: Jitter::new(seed),
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
                if let Some((_, service)) = self.of_incarnation(incarnation)
                    && let State::Alive(process, _) = &mut service.state
                {
                    process.pid = Some(pid);
                }
            }
            Event::Exited { incarnation, exit } => {
                if let Some((index, _)) = self.of_incarnation(incarnation) {
                    self.exited(index, exit, now, &mut actions);
                }
            }
            Event::Ready { instance, start_ms } => {
                if let Some((index, service)) = self.of_instance(&instance) {
                    service.start_ms = start_ms;
                    if service.ready(now) {
                        actions.push(Action::Announce { service: index });
                    }
                }
            }
            Event::Health { instance, memory_bytes } => {
                if let Some((_, service)) = self.of_instance(&instance) {
                    service.memory_bytes = memory_bytes;
                    service.postpone(now + service.desired.policy.liveness);
                }
            }
            Event::Seen { instance, alive } => {
                if let Some((index, service)) = self.of_instance(&instance) {
                    if alive {
                        // The token says the same as the announcement, which may come a moment later.
                        if service.ready(now) {
                            actions.push(Action::Announce { service: index });
                        }
                        service.postpone(now + service.desired.policy.liveness);
                    } else if let State::Alive(_, Stage::Ready { deadline, .. }) = &mut service.state {
                        *deadline = (*deadline).min(now + AWAY_TIME);
                    }
                }
            }
            Event::Restart { service } => self.restart(service, now, &mut actions),
            Event::Down => self.down(Outcome::Down),
            Event::Kill => {
                self.down(Outcome::Down);
                for index in 0..self.services.len() {
                    self.stop(index, Then::Stay, now, &mut actions);
                    self.kill(index, now, &mut actions);
                }
            }
        }
        self.settle(now, &mut actions);
        actions
    }

    /// When [`Event::Tick`] is due at the latest; `None` if only an event can change anything.
    #[must_use]
    pub fn next_deadline(&self) -> Option<Time> {
        self.services.iter().filter_map(Watched::deadline).min()
    }

    /// Brings the stack one step nearer to its goal, until nothing is due at this time.
    fn settle(&mut self, now: Time, actions: &mut Vec<Action>) {
        for index in 0..self.services.len() {
            self.overdue(index, now, actions);
        }
        match &self.goal {
            Goal::Finished => {}
            Goal::Run => {
                for index in 0..self.services.len() {
                    self.start_if_due(index, now, actions);
                }
                if let Some((service, reason)) = self.hopeless() {
                    self.down(Outcome::Failed { service, reason });
                    return self.settle(now, actions);
                }
                // What waits now waits for something that will never be ready.
                let active = |s: &Watched| matches!(s.state, State::Alive(..) | State::Backoff { .. });
                if !self.services.iter().any(active) {
                    let failed = self.services.iter().find(|s| s.state == State::Failed);
                    let outcome = failed.map_or(Outcome::Finished, |s| Outcome::Failed {
                        service: s.desired.name.clone(),
                        reason: s.reason.clone(),
                    });
                    self.finish(outcome, actions);
                }
            }
            Goal::Down(outcome) => {
                let outcome = outcome.clone();
                for (index, service) in self.services.iter_mut().enumerate() {
                    if matches!(service.state, State::Waiting | State::Backoff { .. }) {
                        service.enter(State::Stopped, "stopped", index, actions);
                    }
                }
                // One after another, the last one started first: nobody loses what it depends on while it drains.
                let alive = |(index, s): (usize, &Watched)| {
                    matches!(s.state, State::Alive(..)).then_some((s.order.unwrap_or(0), index))
                };
                match self.services.iter().enumerate().filter_map(alive).max() {
                    Some((_, index)) => self.stop(index, Then::Stay, now, actions),
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
        let failed = |s: &&Watched| s.desired.policy.critical && s.state == State::Failed;
        self.services.iter().find(failed).map(|s| (s.desired.name.clone(), s.reason.clone()))
    }

    fn of_incarnation(&mut self, incarnation: Incarnation) -> Option<(usize, &mut Watched)> {
        let is = |s: &Watched| matches!(&s.state, State::Alive(p, _) if p.incarnation == incarnation);
        self.services.iter_mut().enumerate().find(|(_, s)| is(s))
    }

    fn of_instance(&mut self, instance: &str) -> Option<(usize, &mut Watched)> {
        let is = |s: &Watched| matches!(&s.state, State::Alive(p, _) if p.instance == instance);
        self.services.iter_mut().enumerate().find(|(_, s)| is(s))
    }

    fn start_if_due(&mut self, index: usize, now: Time, actions: &mut Vec<Action>) {
        let Some(service) = self.services.get(index) else { return };
        match service.state {
            State::Waiting => {}
            State::Backoff { until } if until <= now => {}
            _ => return,
        }
        let ready = |s: &Watched| matches!(s.state, State::Alive(_, Stage::Ready { .. }));
        let missing: Vec<_> = service
            .desired
            .after
            .iter()
            .filter_map(|i| self.services.get(*i))
            .filter(|s| !ready(s))
            .map(|s| match s.state {
                State::Failed => format!("`{}`, which failed", s.desired.name),
                _ => format!("`{}`", s.desired.name),
            })
            .collect();
        let incarnation = Incarnation(self.incarnations + 1);
        let order = self.incarnations;
        let Some(service) = self.services.get_mut(index) else { return };
        if !missing.is_empty() {
            let reason = format!("waits for {}", missing.join(", "));
            if service.state != State::Waiting || service.reason != reason {
                service.enter(State::Waiting, reason, index, actions);
            }
            return;
        }
        self.incarnations += 1;
        service.starts += 1;
        service.order.get_or_insert(order);
        service.memory_bytes = 0;
        service.start_ms = 0;
        let instance = format!("{}-{}", service.desired.name, service.starts);
        let process = Process { incarnation, instance: instance.clone(), pid: None, started: now };
        let stage = Stage::Starting { deadline: now + service.desired.policy.ready };
        // The action comes first: what is announced is what was asked for.
        actions.push(Action::Spawn { service: index, incarnation, instance });
        let reason = std::mem::take(&mut service.reason);
        let reason = if service.starts == 1 || reason.starts_with("waits for") { String::new() } else { reason };
        service.enter(State::Alive(process, stage), reason, index, actions);
    }

    /// What a state's deadline brings when it has passed.
    fn overdue(&mut self, index: usize, now: Time, actions: &mut Vec<Action>) {
        let Some(service) = self.services.get(index) else { return };
        let seconds = |time: Duration| time.as_secs_f64();
        let policy = &service.desired.policy;
        let State::Alive(process, stage) = &service.state else { return };
        match stage {
            Stage::Starting { deadline } if *deadline <= now => {
                let reason = format!("not ready within {} s", seconds(policy.ready));
                self.stop(index, Then::Fail(reason), now, actions);
            }
            Stage::Ready { deadline, .. } if *deadline <= now => {
                let reason = format!("hung: no sign of life for {} s", seconds(policy.liveness));
                self.stop(index, Then::Fail(reason), now, actions);
                // A process that hangs would not hear the request either.
                self.kill(index, now, actions);
            }
            Stage::Stopping { deadline, kills, .. } if *deadline <= now && *kills < KILLS => {
                self.kill(index, now, actions);
            }
            Stage::Stopping { deadline, .. } if *deadline <= now => {
                let pid = process.pid.unwrap_or(0);
                let incarnation = process.incarnation;
                actions.push(Action::Ended { service: index, incarnation, end: End::Lost });
                if let Some(service) = self.services.get_mut(index) {
                    let reason = format!("process {pid} was killed but the system does not remove it");
                    service.enter(State::Failed, reason, index, actions);
                }
            }
            _ => {}
        }
    }

    /// Asks a process to stop, unless that has been done; the last wish for what follows counts.
    fn stop(&mut self, index: usize, then: Then, now: Time, actions: &mut Vec<Action>) {
        let Some(service) = self.services.get_mut(index) else { return };
        let deadline = now + service.desired.policy.stop;
        let State::Alive(process, stage) = &mut service.state else { return };
        match stage {
            Stage::Stopping { then: present, .. } => *present = then,
            _ => {
                let reason = match &then {
                    Then::Stay => "asked to stop".to_owned(),
                    Then::StartAgain => "asked to restart".to_owned(),
                    Then::Fail(reason) => reason.clone(),
                };
                actions.push(Action::Terminate(process.incarnation));
                *stage = Stage::Stopping { deadline, kills: 0, then };
                service.reason = reason;
                actions.push(Action::Announce { service: index });
            }
        }
    }

    /// Ends a process that was asked to stop.
    fn kill(&mut self, index: usize, now: Time, actions: &mut Vec<Action>) {
        let Some(Watched { state: State::Alive(process, stage), .. }) = self.services.get_mut(index) else { return };
        if let Stage::Stopping { deadline, kills, .. } = stage {
            *deadline = now + KILL_TIME;
            *kills += 1;
            actions.push(Action::Kill(process.incarnation));
        }
    }

    fn exited(&mut self, index: usize, exit: Exit, now: Time, actions: &mut Vec<Action>) {
        let running = self.goal == Goal::Run;
        let Some(service) = self.services.get_mut(index) else { return };
        let State::Alive(process, stage) = &service.state else { return };
        let incarnation = process.incarnation;
        let policy = service.desired.policy.clone();
        if let Stage::Ready { since, .. } = stage
            && now.saturating_sub(*since) >= policy.backoff_max
        {
            service.failures = 0;
        }
        let asked = match stage {
            Stage::Stopping { then, .. } => Some(then.clone()),
            _ => None,
        };
        let end = match &asked {
            Some(Then::Stay | Then::StartAgain) => End::Stopped,
            Some(Then::Fail(reason)) => End::Failed(reason.clone()),
            None if exit.status == Some(0) => End::Finished,
            None => End::Failed(exit.reason.clone()),
        };
        actions.push(Action::Ended { service: index, incarnation, end });
        let (reason, failed) = match asked {
            Some(Then::Stay) => return service.enter(State::Stopped, "stopped", index, actions),
            Some(Then::StartAgain) => return service.enter(State::Waiting, "asked to restart", index, actions),
            Some(Then::Fail(reason)) => (reason, true),
            None => (exit.reason, exit.status != Some(0)),
        };
        if !running {
            // It ended by itself before its turn to be stopped came.
            return service.enter(if failed { State::Failed } else { State::Stopped }, reason, index, actions);
        }
        match policy.restart {
            _ if exit.status == Some(EXIT_INPUT) && failed => service.enter(State::Failed, reason, index, actions),
            Restart::Never | Restart::OnFailure if !failed => service.enter(State::Stopped, reason, index, actions),
            Restart::Never => service.enter(State::Failed, reason, index, actions),
            Restart::Always | Restart::OnFailure => {
                service.recent.retain(|t| now.saturating_sub(*t) < policy.within);
                if service.recent.len() >= usize::try_from(policy.restarts).unwrap_or(usize::MAX) {
                    let within = policy.within.as_secs_f64();
                    let reason = format!("failed {} times within {within} s: {reason}", service.recent.len() + 1);
                    return service.enter(State::Failed, reason, index, actions);
                }
                service.recent.push_back(now);
                service.failures = service.failures.saturating_add(1);
                let pause =
                    self.jitter.spread(backoff::pause(policy.backoff_initial, policy.backoff_max, service.failures));
                service.enter(State::Backoff { until: now + pause }, reason, index, actions);
            }
        }
    }

    fn restart(&mut self, index: usize, now: Time, actions: &mut Vec<Action>) {
        if self.goal != Goal::Run {
            return;
        }
        let Some(service) = self.services.get_mut(index) else { return };
        service.failures = 0;
        service.recent.clear();
        match service.state {
            State::Alive(_, Stage::Stopping { ref mut then, .. }) => *then = Then::StartAgain,
            State::Alive(..) => self.stop(index, Then::StartAgain, now, actions),
            State::Waiting => {}
            State::Backoff { .. } | State::Stopped | State::Failed => {
                service.enter(State::Waiting, "asked to restart", index, actions);
            }
        }
    }
}

impl Watched {
    fn enter(&mut self, state: State, reason: impl Into<String>, index: usize, actions: &mut Vec<Action>) {
        self.state = state;
        self.reason = reason.into();
        actions.push(Action::Announce { service: index });
    }

    /// A starting service becomes ready; whether it did.
    fn ready(&mut self, now: Time) -> bool {
        let State::Alive(process, stage @ Stage::Starting { .. }) = &mut self.state else { return false };
        *stage = Stage::Ready { since: now, deadline: now + self.desired.policy.liveness };
        if self.start_ms == 0 {
            self.start_ms = u64::try_from(now.saturating_sub(process.started).as_millis()).unwrap_or(u64::MAX);
        }
        self.reason = String::new();
        true
    }

    fn postpone(&mut self, until: Time) {
        if let State::Alive(_, Stage::Ready { deadline, .. }) = &mut self.state {
            *deadline = until;
        }
    }

    fn deadline(&self) -> Option<Time> {
        match &self.state {
            State::Alive(_, Stage::Starting { deadline } | Stage::Ready { deadline, .. }) => Some(*deadline),
            State::Alive(_, Stage::Stopping { deadline, .. }) => Some(*deadline),
            State::Backoff { until } => Some(*until),
            State::Waiting | State::Stopped | State::Failed => None,
        }
    }
}

#[cfg(test)]
mod tests;
