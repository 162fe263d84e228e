//! One service: its place in the stack, the process that serves, the candidate beside it.

use std::collections::VecDeque;
use std::time::Duration;

use sg_proto::launch::{self, SwapState};

use super::model::{Action, ProcessId, Time};
use crate::file::{Service, Start};

/// A service and its processes.
#[derive(Debug, Clone)]
pub(super) struct Slot {
    /// As it is to be kept. Its start is the one in force: the next process that serves is started with it.
    pub(super) service: Service,
    /// It is in the launch file no more.
    pub(super) removed: bool,
    pub(super) state: State,
    /// A swap that is to begin.
    pub(super) next: Option<PendingSwap>,
    /// The process that stands by to take over.
    pub(super) candidate: Option<Process>,
    /// The newest swap.
    pub(super) swap: Option<Swap>,
    /// Processes that served a role and that the system does not remove, with the machine they are on: until they are gone
    /// nobody else may serve it.
    pub(super) lost: Vec<(ProcessId, String, Option<String>)>,
    /// Processes started so far.
    pub(super) processes: u32,
    /// Those among them that were started to serve at once.
    pub(super) starts: u32,
    /// Position in the order of first starts.
    pub(super) order: Option<u64>,
    /// Failures since it was last well.
    pub(super) failures: u32,
    /// Automatic restarts within the intensity's window.
    pub(super) recent: VecDeque<Time>,
    pub(super) reason: String,
    pub(super) start_ms: u64,
    pub(super) epoch: u64,
}

/// What a service does.
#[derive(Debug, Clone, PartialEq)]
#[allow(clippy::large_enum_variant, reason = "one for each service, and most have a process")]
pub(super) enum State {
    /// For those it comes after, or for its role to be free.
    Waiting,
    /// Has a process that serves or is about to.
    Alive(Process),
    /// Until the next start.
    Backoff {
        until: Time,
    },
    Stopped,
    Failed,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Process {
    pub(super) id: ProcessId,
    pub(super) instance: String,
    pub(super) role: String,
    pub(super) start: Start,
    /// Known once it runs.
    pub(super) pid: Option<u32>,
    pub(super) started: Time,
    pub(super) memory_bytes: u64,
    /// Milliseconds from the receipt of a request to its answer: median and 99th percentile.
    pub(super) answer_ms: (f64, f64),
    /// Known once it is ready or stands by.
    pub(super) start_ms: Option<u64>,
    /// The swap that it is the candidate of, until it is done.
    pub(super) swap: Option<u64>,
    pub(super) stage: Stage,
}

/// Where a process stands in its life. Each has a deadline.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Stage {
    Starting {
        deadline: Time,
    },
    /// A candidate that stands by is looked at.
    Proving {
        deadline: Time,
    },
    /// A candidate that is proven waits until nobody serves.
    StandingBy {
        deadline: Time,
    },
    /// A candidate takes the role that nobody serves.
    Promoting {
        deadline: Time,
    },
    Ready {
        since: Time,
        deadline: Time,
    },
    Stopping {
        deadline: Time,
        kills: u32,
        then: AfterStop,
    },
}

/// What follows a stop.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum AfterStop {
    Stay,
    Restart,
    /// Its successor takes over.
    HandOver,
    Fail(String),
    /// It served well, but its successor failed after it was asked to stop.
    Recover(String),
}

/// A swap that is to begin.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct PendingSwap {
    pub(super) number: u64,
    pub(super) start: Start,
}

/// A swap as it is told.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Swap {
    /// From 1.
    pub(super) number: u64,
    pub(super) state: SwapState,
    pub(super) executable: String,
    pub(super) reason: String,
}

/// Which of a slot's processes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Occupant {
    Serving,
    Candidate,
}

/// Which process of which slot.
pub(super) type ProcessIndex = (usize, Occupant);

impl Slot {
    pub(super) fn new(service: Service) -> Self {
        Self {
            service,
            removed: false,
            state: State::Waiting,
            next: None,
            candidate: None,
            swap: None,
            lost: Vec::new(),
            processes: 0,
            starts: 0,
            order: None,
            failures: 0,
            recent: VecDeque::new(),
            reason: String::new(),
            start_ms: 0,
            epoch: 0,
        }
    }

    pub(super) fn enter(&mut self, state: State, reason: impl Into<String>, index: usize, actions: &mut Vec<Action>) {
        self.state = state;
        self.reason = reason.into();
        actions.push(Action::Announce { service: index });
    }

    /// Whether something is still to happen to it.
    pub(super) fn is_active(&self) -> bool {
        matches!(self.state, State::Alive(_) | State::Backoff { .. }) || self.candidate.is_some()
    }

    pub(super) fn is_ready(&self) -> bool {
        matches!(&self.state, State::Alive(Process { stage: Stage::Ready { .. }, .. }))
    }

    /// The process that serves or is about to.
    pub(super) fn main(&self) -> Option<&Process> {
        if let State::Alive(process) = &self.state { Some(process) } else { None }
    }

    pub(super) fn process_mut(&mut self, part: Occupant) -> Option<&mut Process> {
        match (part, &mut self.state) {
            (Occupant::Serving, State::Alive(process)) => Some(process),
            (Occupant::Serving, _) => None,
            (Occupant::Candidate, _) => self.candidate.as_mut(),
        }
    }

    pub(super) fn process(&self, part: Occupant) -> Option<&Process> {
        match part {
            Occupant::Serving => self.main(),
            Occupant::Candidate => self.candidate.as_ref(),
        }
    }

    /// Whether a candidate that is past its proof is on its way to take over.
    pub(super) fn hands_over(&self) -> bool {
        let is = |p: &Process| matches!(p.stage, Stage::StandingBy { .. });
        self.candidate.as_ref().is_some_and(is)
            || self.main().is_some_and(|p| matches!(p.stage, Stage::Promoting { .. }))
    }

    pub(super) fn deadlines(&self) -> impl Iterator<Item = Time> {
        let own = match &self.state {
            State::Alive(process) => Some(process.stage.deadline()),
            State::Backoff { until } => Some(*until),
            State::Waiting | State::Stopped | State::Failed => None,
        };
        own.into_iter().chain(self.candidate.as_ref().map(|n| n.stage.deadline()))
    }

    /// The newest swap enters a state; an older one is told no more.
    pub(super) fn swap_enters(
        &mut self,
        number: u64,
        state: SwapState,
        reason: impl Into<String>,
        index: usize,
        actions: &mut Vec<Action>,
    ) {
        if let Some(swap) = self.swap.as_mut().filter(|s| s.number == number) {
            swap.state = state;
            swap.reason = reason.into();
            self.announce_swap(index, actions);
        }
    }

    pub(super) fn announce_swap(&self, index: usize, actions: &mut Vec<Action>) {
        if let Some(swap) = self.swap_view() {
            actions.push(Action::AnnounceSwap { service: index, swap: Box::new(swap) });
        }
    }

    /// The newest swap as it stands.
    pub(super) fn swap_view(&self) -> Option<launch::Swap> {
        self.swap.as_ref().map(|swap| launch::Swap {
            number: swap.number,
            state: swap.state.into(),
            executable: swap.executable.clone(),
            pid: self.candidate.as_ref().and_then(|n| n.pid).unwrap_or(0),
            instance: self.candidate.as_ref().map(|n| n.instance.clone()).unwrap_or_default(),
            reason: swap.reason.clone(),
        })
    }
}

impl Stage {
    pub(super) fn deadline(&self) -> Time {
        match self {
            Self::Starting { deadline }
            | Self::Proving { deadline }
            | Self::StandingBy { deadline }
            | Self::Promoting { deadline }
            | Self::Ready { deadline, .. }
            | Self::Stopping { deadline, .. } => *deadline,
        }
    }
}

pub(super) fn seconds(time: Duration) -> f64 {
    time.as_secs_f64()
}
