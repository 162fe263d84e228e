//! One service: its state, its serving process and its candidate.

use std::collections::VecDeque;
use std::time::Duration;

use sg_proto::launch::{self, SwapState};

use super::model::{Action, ProcessId, Time, Work};
use crate::file::{Service, Start};

/// A service and its processes.
#[derive(Debug, Clone)]
pub(super) struct Slot {
    /// Desired service. Its start is the one in force, used for the next process.
    pub(super) service: Service,
    /// Whether the launch file has dropped it.
    pub(super) removed: bool,
    pub(super) state: State,
    /// A swap that has not begun.
    pub(super) next: Option<PendingSwap>,
    /// The process in standby.
    pub(super) candidate: Option<Process>,
    /// The newest swap.
    pub(super) swap: Option<Swap>,
    /// Processes with a role that the system does not remove: id, role and node. They block the role.
    pub(super) lost: Vec<(ProcessId, String, Option<String>)>,
    /// Number of started processes, candidates included.
    pub(super) processes: u32,
    /// Number of processes that were started to serve at once.
    pub(super) starts: u32,
    /// Position in the order of first starts.
    pub(super) order: Option<u64>,
    /// Failures since its last recovery.
    pub(super) failures: u32,
    /// Automatic restarts within the intensity's time.
    pub(super) recent: VecDeque<Time>,
    pub(super) reason: String,
    pub(super) start_ms: u64,
    pub(super) epoch: u64,
}

/// State of a service.
#[derive(Debug, Clone, PartialEq)]
#[allow(clippy::large_enum_variant, reason = "one for each service, and most have a process")]
pub(super) enum State {
    /// Waits for its dependencies, or for its role to be free.
    Waiting,
    /// Has a process that serves or starts.
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
    /// `None` until it runs.
    pub(super) pid: Option<u32>,
    pub(super) started: Time,
    pub(super) memory_bytes: u64,
    /// Milliseconds from a request's receipt to its answer: median and 99th percentile.
    pub(super) answer_ms: (f64, f64),
    /// Its present work.
    pub(super) work: Work,
    /// `None` until it is ready or in standby.
    pub(super) start_ms: Option<u64>,
    /// Number of the swap that it is the candidate of.
    pub(super) swap: Option<u64>,
    pub(super) stage: Stage,
}

/// Stage of a process. Each has a deadline.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Stage {
    Starting {
        deadline: Time,
    },
    /// A candidate in standby is probed.
    Verifying {
        deadline: Time,
    },
    /// A probed candidate waits until the role is free.
    StandingBy {
        deadline: Time,
    },
    /// A candidate takes the free role.
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
    /// Its candidate takes over.
    HandOver,
    Fail(String),
    /// It served well, but its candidate failed after the stop request.
    Recover(String),
}

/// A swap that has not begun.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct PendingSwap {
    pub(super) number: u64,
    pub(super) start: Start,
}

/// The newest swap, as announced.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Swap {
    /// From 1.
    pub(super) number: u64,
    pub(super) state: SwapState,
    pub(super) executable: String,
    pub(super) reason: String,
}

/// Which process of a slot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Occupant {
    Serving,
    Candidate,
}

/// A process by slot and occupant.
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

    /// Whether it has a process or a pending restart.
    pub(super) fn is_active(&self) -> bool {
        matches!(self.state, State::Alive(_) | State::Backoff { .. }) || self.candidate.is_some()
    }

    pub(super) fn is_ready(&self) -> bool {
        matches!(&self.state, State::Alive(Process { stage: Stage::Ready { .. }, .. }))
    }

    /// The process that serves or starts.
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

    /// Whether a probed candidate is about to take over.
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

    /// Changes the state of the newest swap. Older numbers are ignored.
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

    /// The newest swap, as a message.
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
            | Self::Verifying { deadline }
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
