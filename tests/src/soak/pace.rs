//! The common pace of all users: how much of the session is due, begun and done.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use sg_proto::bus::Code;
use sg_runtime::fault::Fault;

use super::options::Options;

/// Pause of a user who is ahead of the pace.
const PAUSE: Duration = Duration::from_millis(5);
/// Most failures whose text is kept.
const MAX_TEXTS: usize = 20;

/// One kind of work, spread evenly over the session.
#[derive(Debug)]
pub struct Work {
    total: u64,
    begun: AtomicU64,
    done: AtomicU64,
}

impl Work {
    fn new(total: u64) -> Self {
        Self { total, begun: AtomicU64::new(0), done: AtomicU64::new(0) }
    }

    /// How often it is to be done.
    #[must_use]
    pub fn total(&self) -> u64 {
        self.total
    }

    /// How often it was done.
    #[must_use]
    pub fn done(&self) -> u64 {
        self.done.load(Ordering::Relaxed)
    }

    /// Counts one that was done.
    pub fn finish(&self) {
        self.done.fetch_add(1, Ordering::Relaxed);
    }
}

/// The pace and the tally of a session.
#[derive(Debug)]
pub struct Pace {
    began: Instant,
    length: Duration,
    limit: Duration,
    stopped: AtomicBool,
    /// Commands, strokes and utterances among them.
    pub commands: Work,
    /// Pictures.
    pub captures: Work,
    /// Restarts of services.
    pub restarts: Work,
    /// Answers by kind of work and code.
    answers: Mutex<BTreeMap<(&'static str, &'static str), u64>>,
    failures: Mutex<Vec<String>>,
}

impl Pace {
    /// A session that begins now.
    #[must_use]
    pub fn new(options: &Options) -> Self {
        Self {
            began: Instant::now(),
            length: options.length(),
            limit: options.limit(),
            stopped: AtomicBool::new(false),
            commands: Work::new(options.commands),
            captures: Work::new(options.captures),
            restarts: Work::new(options.restarts),
            answers: Mutex::default(),
            failures: Mutex::default(),
        }
    }

    /// Time since the begin of the session.
    #[must_use]
    pub fn elapsed(&self) -> Duration {
        self.began.elapsed()
    }

    /// Ends the session before its time.
    pub fn stop(&self) {
        self.stopped.store(true, Ordering::Relaxed);
    }

    /// Whether nothing more is to begin.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.stopped.load(Ordering::Relaxed) || self.elapsed() >= self.limit
    }

    /// Waits until the next one of this work is due. Its number, or `None` at the end of the session.
    pub async fn next(&self, work: &Work) -> Option<u64> {
        loop {
            if self.is_over() {
                return None;
            }
            let due = (work.total as f64 * self.elapsed().as_secs_f64() / self.length.as_secs_f64()).ceil() as u64;
            let due = due.min(work.total);
            let taken = work
                .begun
                .fetch_update(Ordering::Relaxed, Ordering::Relaxed, |begun| (begun < due).then_some(begun + 1));
            match taken {
                Ok(number) => return Some(number),
                Err(begun) if begun >= work.total => return None,
                Err(_) => tokio::time::sleep(PAUSE).await,
            }
        }
    }

    /// Notes how a request ended. A refusal belongs to the session: users get in each other's way. Another fault is a failure.
    pub fn note<T>(&self, work: &'static str, outcome: &Result<T, Fault>) {
        let code = outcome.as_ref().err().map(|fault| fault.code);
        let name = code.map_or("OK", |code| code.as_str_name().trim_start_matches("CODE_"));
        *self.answers.lock().unwrap_or_else(PoisonError::into_inner).entry((work, name)).or_default() += 1;
        if let Err(fault) = outcome
            && !is_refusal(fault.code)
        {
            self.fail(&format!("{work}: {name}: {fault}"));
        }
    }

    /// Notes a failure.
    pub fn fail(&self, text: &str) {
        let mut failures = self.failures.lock().unwrap_or_else(PoisonError::into_inner);
        let after = format!("after {:.0} s: {text}", self.elapsed().as_secs_f64());
        if failures.len() < MAX_TEXTS {
            failures.push(after);
        }
        *self.answers.lock().unwrap_or_else(PoisonError::into_inner).entry(("all", "FAILED")).or_default() += 1;
    }

    /// Answers by kind of work and code.
    #[must_use]
    pub fn answers(&self) -> BTreeMap<(&'static str, &'static str), u64> {
        self.answers.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Number of failures, and the texts of the first ones.
    #[must_use]
    pub fn failures(&self) -> (u64, Vec<String>) {
        let count = self.answers().get(&("all", "FAILED")).copied().unwrap_or(0);
        (count, self.failures.lock().unwrap_or_else(PoisonError::into_inner).clone())
    }
}

/// Whether a code says that a request did not fit the scene as it was.
fn is_refusal(code: Code) -> bool {
    matches!(
        code,
        Code::InvalidArgument | Code::NotFound | Code::AlreadyExists | Code::FailedPrecondition | Code::Aborted
    )
}
