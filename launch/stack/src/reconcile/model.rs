//! Events that go into the reconciler and actions that come out of it.

use std::time::Duration;

use sg_proto::launch;

use crate::file::{Service, Start};

/// Time since the supervisor started.
pub type Time = Duration;

/// Exit status for wrong parameters or input: another start would not help.
pub(super) const EXIT_INPUT: i32 = sg_runtime::process::EXIT_INPUT as i32;
/// Exit status for other failures.
pub(super) const EXIT_FAILED: i32 = sg_runtime::process::EXIT_FAILED as i32;

/// How long the system may take to remove a killed process.
pub(super) const KILL_TIME: Duration = Duration::from_secs(5);
/// Kills after which a process counts as not removable.
pub(super) const KILLS: u32 = 2;
/// How long a ready service may be missing from the bus.
pub(super) const AWAY_TIME: Duration = Duration::from_secs(1);
/// How long signs of life may take after the supervisor was stopped: services connect to the bus again.
pub(super) const AWAKENING_TIME: Duration = Duration::from_secs(5);
/// Longest time of a candidate's probe.
pub const PROBE_TIME: Duration = Duration::from_secs(10);

/// Id of one start of a process. Never reused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ProcessId(pub u64);

/// An observation or request.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// Time passed.
    Tick,
    /// A process runs.
    Started {
        /// Id of the process.
        id: ProcessId,
        /// Process id of the system.
        pid: u32,
    },
    /// A process ended, or could not be started.
    Exited {
        /// Id of the process.
        id: ProcessId,
        /// How it ended.
        exit: Exit,
    },
    /// An instance announced that it serves or stands by.
    Ready {
        /// Name of the instance.
        instance: String,
        /// Milliseconds from the start of its process to readiness, by its own clock.
        start_ms: u64,
        /// Whether it serves under its instance only, until its promotion.
        standby: bool,
    },
    /// A candidate's probe finished.
    Verified {
        /// Id of the process.
        id: ProcessId,
        /// The mismatch, if there is one.
        outcome: Result<(), String>,
    },
    /// A candidate's promotion finished.
    Promoted {
        /// Id of the process.
        id: ProcessId,
        /// Reason of the failure, if it failed.
        outcome: Result<(), String>,
    },
    /// An instance published its health.
    Health {
        /// Name of the instance.
        instance: String,
        /// Resident memory, bytes.
        memory_bytes: u64,
        /// Milliseconds from a request's receipt to its answer: median and 99th percentile.
        answer_ms: (f64, f64),
        /// Its present work.
        work: Work,
    },
    /// The supervisor runs again after a standstill of this length: it was stopped or starved. Signs of life may still be
    /// under way.
    Awoke(Duration),
    /// An instance appeared on the bus (true) or left it.
    Presence {
        /// Name of the instance.
        instance: String,
        /// Whether it is present.
        alive: bool,
    },
    /// A node joined (true) or its lease ran out.
    Node {
        /// Name of the node.
        name: String,
        /// Whether it is present.
        present: bool,
    },
    /// The desired services from now on, each behind its dependencies.
    SetServices(Vec<Service>),
    /// Request to swap a service.
    Swap {
        /// Position of the service.
        service: usize,
        /// Start of the candidate.
        start: Start,
    },
    /// Request to restart a service.
    Restart {
        /// Position of the service.
        service: usize,
    },
    /// Request to stop the stack.
    Down,
    /// Request to stop the stack at once, by kill.
    Kill,
}

/// Work of an instance, from its health.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Work {
    /// Longest time without progress of any of its actors and rows.
    pub stalled: Duration,
    /// That actor or row, in words; empty without work.
    pub stalled_in: String,
    /// Everything that takes long, one line for people; may be empty.
    pub summary: String,
    /// Number of steps that it has reported while loading.
    pub loading_steps: u64,
}

/// How a process ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Exit {
    /// Exit status; `None` if a signal ended it or it never ran.
    pub status: Option<i32>,
    /// One line for people: status or signal, and the last line of output.
    pub reason: String,
}

/// A process to start.
#[derive(Debug, Clone, PartialEq)]
pub struct Spawn {
    /// Position of the service.
    pub service: usize,
    /// Id of the process.
    pub id: ProcessId,
    /// Name of the instance.
    pub instance: String,
    /// Role of the service.
    pub role: String,
    /// Executable, parameters and environment.
    pub start: Start,
    /// Epoch of the role; 0 in standby, because the promotion grants one.
    pub epoch: u64,
    /// Whether it serves under its instance only.
    pub standby: bool,
    /// Time between SIGTERM and SIGKILL.
    pub stop: Duration,
}

/// An action for the supervisor.
#[derive(Debug, Clone, PartialEq)]
pub enum Action {
    /// Start a process. [`Event::Started`] or [`Event::Exited`] must follow.
    Spawn(Box<Spawn>),
    /// Probe a candidate. [`Event::Verified`] must follow within [`PROBE_TIME`].
    Verify {
        /// Id of the process.
        id: ProcessId,
        /// Name of the instance.
        instance: String,
        /// Its role.
        role: String,
    },
    /// Promote a candidate. [`Event::Promoted`] must follow within the time.
    Promote {
        /// Id of the process.
        id: ProcessId,
        /// Name of the instance.
        instance: String,
        /// New epoch of the role.
        epoch: u64,
        /// Time limit.
        within: Duration,
    },
    /// Send SIGTERM.
    Terminate(ProcessId),
    /// Send SIGKILL.
    Kill(ProcessId),
    /// A process ended.
    Ended {
        /// Position of the service.
        service: usize,
        /// Id of the process.
        id: ProcessId,
        /// How it ended.
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
        /// The swap at this moment. The service may be swapped again by now.
        swap: Box<launch::Swap>,
    },
    /// The stack has ended.
    Finish(Outcome),
}

/// How a process ended, as the reconciler judges it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum End {
    /// It stopped on request.
    Stopped,
    /// It ended by itself with status 0.
    Finished,
    /// It failed: crash, missed deadline, hang, refused input, or failed start.
    Failed(String),
    /// The system does not remove it.
    Lost,
}

/// How the stack ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Outcome {
    /// On request.
    Down,
    /// A critical service failed for good, or no service was left and one had failed.
    Failed {
        /// Name of the service.
        service: String,
        /// Reason.
        reason: String,
    },
    /// All services, or a critical one, ended by themselves with status 0.
    Finished,
}
