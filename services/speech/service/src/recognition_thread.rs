//! The thread of the recognizer: one utterance after another.

use std::sync::Arc;
use std::sync::mpsc::{self, SyncSender, TrySendError};
use std::time::Duration;

use sg_speech::child_process::Limits;
use sg_speech::error::SpeechError;
use sg_speech::phrases::PhraseGrammar;
use sg_speech::recognizer::{Recognition, Recognizer};

/// Most jobs that wait. Jobs that were cancelled end at once.
const QUEUE: usize = 8;
/// Longest preparation of a grammar.
const PREPARATION: Duration = Duration::from_secs(20);

/// Identifies a job.
pub(crate) type JobId = u64;

enum Job {
    Prepare(Arc<PhraseGrammar>),
    Recognize { id: JobId, samples: Vec<f32>, grammar: Arc<PhraseGrammar>, limits: Limits },
}

/// What the thread reports.
pub(crate) enum Report {
    /// A grammar is prepared; with a line about words that cannot be recognised.
    Prepared { notice: Option<String> },
    /// A job is done.
    Recognized { id: JobId, outcome: Result<Recognition, SpeechError> },
}

/// The running thread.
pub(crate) struct RecognitionThread {
    jobs: SyncSender<Job>,
    last: JobId,
}

impl RecognitionThread {
    /// Starts the thread. `report` takes the results and must not wait.
    ///
    /// # Errors
    /// One line: no thread starts.
    pub(crate) fn start(
        mut recognizer: Box<dyn Recognizer>,
        report: impl Fn(Report) + Send + 'static,
    ) -> Result<Self, String> {
        let (jobs, waiting) = mpsc::sync_channel(QUEUE);
        let run = move || {
            for job in waiting {
                report(match job {
                    Job::Prepare(grammar) => Report::Prepared {
                        notice: recognizer
                            .prepare(&grammar, &Limits::within(PREPARATION))
                            .unwrap_or_else(|e| Some(e.to_string())),
                    },
                    Job::Recognize { id, limits, .. } if limits.is_cancelled() => {
                        Report::Recognized { id, outcome: Err(SpeechError::Cancelled) }
                    }
                    Job::Recognize { id, samples, grammar, limits } => {
                        Report::Recognized { id, outcome: recognizer.recognize(&samples, &grammar, &limits) }
                    }
                });
            }
        };
        let named = std::thread::Builder::new().name("recognizer".to_owned());
        named.spawn(run).map_err(|e| format!("no thread for the recognizer: {e}"))?;
        Ok(Self { jobs, last: 0 })
    }

    /// Prepares a grammar before it is needed.
    pub(crate) fn prepare(&self, grammar: &Arc<PhraseGrammar>) {
        // With a full queue, the next recognition prepares it.
        let _ = self.jobs.try_send(Job::Prepare(Arc::clone(grammar)));
    }

    /// Begins a recognition.
    ///
    /// # Errors
    /// One line: too many wait.
    pub(crate) fn recognize(
        &mut self,
        samples: Vec<f32>,
        grammar: &Arc<PhraseGrammar>,
        limits: &Limits,
    ) -> Result<JobId, String> {
        self.last += 1;
        let job = Job::Recognize { id: self.last, samples, grammar: Arc::clone(grammar), limits: limits.clone() };
        match self.jobs.try_send(job) {
            Ok(()) => Ok(self.last),
            Err(TrySendError::Full(_)) => Err("the recognizer is busy; say it again in a moment".to_owned()),
            Err(TrySendError::Disconnected(_)) => Err("the recognizer has ended".to_owned()),
        }
    }
}
