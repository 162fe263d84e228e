//! Events that go into the reconciler and actions that come out of it.

use std::time::Duration;

use sg_proto::launch;

use crate::file::{Service, Start};

/// Time since the supervisor began.
pub type Time = Duration;

/// Exit status by which a process says that its parameters or input are wrong: starting it again would not help.
pub(super) const EXIT_INPUT: i32 = sg_runtime::process::EXIT_INPUT as i32;

/// How long the system may take to remove a process after a kill.
pub(super) const KILL_TIME: Duration = Duration::from_secs(5);
/// Kills after which a process counts as one that the system does not remove.
pub(super) const KILLS: u32 = 2;
/// How long a ready service may be away from the bus.
pub(super) const AWAY_TIME: Duration = Duration::from_secs(1);
/// How long the proof of a candidate may take.
pub const PROBE_TIME: Duration = Duration::from_secs(10);

/// One process that was started, never reused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ProcessId(pub u64);

/// Something that happened.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// Time passed.
    Tick,
    /// The process of an id runs.
    Started {
        /// Which.
        id: ProcessId,
        /// Its process id.
        pid: u32,
    },
    /// An id is over: its process is gone, or could not be started.
    Exited {
        /// Which.
        id: ProcessId,
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
    /// A candidate was proven or not.
    Proven {
        /// Which.
        id: ProcessId,
        /// What is wrong with it, if anything is.
        outcome: Result<(), String>,
    },
    /// A candidate took its role or could not.
    Promoted {
        /// Which.
        id: ProcessId,
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
    Presence {
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
    SetServices(Vec<Service>),
    /// A person wants a service replaced by a process that is started like this.
    Swap {
        /// Position of the service.
        service: usize,
        /// What the candidate is started with.
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
    /// Its new id.
    pub id: ProcessId,
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
    /// Look whether a candidate speaks the contract of its role. [`Event::Proven`] must follow within [`PROBE_TIME`].
    Prove {
        /// Which.
        id: ProcessId,
        /// Its name.
        instance: String,
        /// Its role.
        role: String,
    },
    /// Let a candidate take its role. [`Event::Promoted`] must follow within the time.
    Promote {
        /// Which.
        id: ProcessId,
        /// Its name.
        instance: String,
        /// Epoch of the role from now on.
        epoch: u64,
        /// How long it may take.
        within: Duration,
    },
    /// Ask a process to stop.
    Terminate(ProcessId),
    /// End a process.
    Kill(ProcessId),
    /// An id is over.
    Ended {
        /// Position of the service.
        service: usize,
        /// Which.
        id: ProcessId,
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

/// The terminal state of an id.
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
