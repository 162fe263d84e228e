//! The thread of the loudspeaker: one text after another.

use std::sync::mpsc::{self, SyncSender};
use std::time::Duration;

use sg_speech::child_process::Limits;
use sg_speech::recognizer::Synthesizer;
use sg_speech::sentences::sentences;
use sg_speech::speaker::{Spoken, speak};

use crate::devices::{self, Place};

/// Most texts that wait.
const QUEUE: usize = 4;
/// Longest time of one text.
const LONGEST: Duration = Duration::from_secs(120);

/// Identifies a text.
pub(crate) type SpeechId = u64;

struct Job {
    id: SpeechId,
    text: String,
    limits: Limits,
}

/// The running thread.
pub(crate) struct Loudspeaker {
    jobs: SyncSender<Job>,
    last: SpeechId,
}

impl Loudspeaker {
    /// Starts the thread. `done` takes the end of each text and must not wait.
    ///
    /// # Errors
    /// One line: no thread starts.
    pub(crate) fn start(
        synthesizer: Box<dyn Synthesizer>,
        (output, rate): (Place, u32),
        done: impl Fn(SpeechId, Result<Spoken, String>) + Send + 'static,
    ) -> Result<Self, String> {
        let (jobs, waiting) = mpsc::sync_channel::<Job>(QUEUE);
        let run = move || {
            for Job { id, text, limits } in waiting {
                let spoken = devices::output(&output, rate).map_err(|e| e.to_string()).and_then(|mut sink| {
                    let spoken = speak(sentences(&text).into_iter(), &*synthesizer, &mut *sink, &limits);
                    spoken.map_err(|e| e.to_string())
                });
                done(id, spoken);
            }
        };
        let named = std::thread::Builder::new().name("loudspeaker".to_owned());
        named.spawn(run).map_err(|e| format!("no thread for the loudspeaker: {e}"))?;
        Ok(Self { jobs, last: 0 })
    }

    /// Begins to speak a text after those that wait. Its limits stop it.
    ///
    /// # Errors
    /// One line: too many wait.
    pub(crate) fn speak(&mut self, text: String) -> Result<(SpeechId, Limits), String> {
        self.last += 1;
        let limits = Limits::within(LONGEST);
        let job = Job { id: self.last, text, limits: limits.clone() };
        self.jobs.try_send(job).map_err(|_| "too many texts wait to be spoken; try again in a moment".to_owned())?;
        Ok((self.last, limits))
    }
}
