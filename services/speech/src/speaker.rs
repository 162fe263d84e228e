//! Speaks a reply sentence by sentence: one is synthesised while the one before it sounds. Barge-in stops at once.

use std::sync::mpsc;
use std::time::{Duration, Instant};

use crate::audio::resample::resample;
use crate::audio::samples_in;
use crate::audio::sink::AudioSink;
use crate::child_process::Limits;
use crate::error::SpeechError;
use crate::recognizer::Synthesizer;

/// Length of the blocks that are written to the sink, so that a stop is heard within it.
const BLOCK: Duration = Duration::from_millis(20);

/// What was spoken.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Spoken {
    /// Sentences that were spoken to their end.
    pub sentences: usize,
    /// Whether it was stopped before its end.
    pub stopped: bool,
    /// Time from the call to the first sample at the sink.
    pub first_sound: Option<Duration>,
}

/// Speaks sentences as they come. `limits.cancel` is barge-in: the sink drops what has not been heard, and the program that
/// synthesises is ended.
///
/// # Errors
/// [`SpeechError`] of the synthesizer or the sink. Sentences before it were spoken.
pub fn speak(
    sentences: impl Iterator<Item = String> + Send,
    synthesizer: &dyn Synthesizer,
    sink: &mut dyn AudioSink,
    limits: &Limits,
) -> Result<Spoken, SpeechError> {
    let begun = Instant::now();
    let rate = sink.rate();
    let mut spoken = Spoken::default();
    std::thread::scope(|scope| {
        // Without room: the next sentence is made while one sounds, and waits until it is fetched.
        let (to, from) = mpsc::sync_channel(0);
        scope.spawn(move || {
            for sentence in sentences {
                if limits.is_cancelled() {
                    return;
                }
                let sound = synthesizer.synthesize(&sentence, limits);
                let sound = sound.and_then(|sound| Ok(resample(&sound, rate)?));
                let failed = sound.is_err();
                // The listener is gone: it was stopped.
                if to.send(sound).is_err() || failed {
                    return;
                }
            }
        });
        let outcome = play(&from, sink, limits, begun, &mut spoken);
        drop(from);
        match outcome {
            Ok(()) if spoken.stopped => sink.stop(),
            Ok(()) => sink.finish()?,
            Err(SpeechError::Cancelled) => {
                spoken.stopped = true;
                sink.stop();
            }
            Err(error) => {
                sink.stop();
                return Err(error);
            }
        }
        Ok(spoken)
    })
}

fn play(
    from: &mpsc::Receiver<Result<crate::audio::Recording, SpeechError>>,
    sink: &mut dyn AudioSink,
    limits: &Limits,
    begun: Instant,
    spoken: &mut Spoken,
) -> Result<(), SpeechError> {
    let block = samples_in(BLOCK, sink.rate()).max(1);
    loop {
        // A sentence may be long in coming, and a stop must not wait for it.
        let sound = match from.recv_timeout(BLOCK) {
            Ok(sound) => sound?,
            Err(mpsc::RecvTimeoutError::Timeout) if limits.is_cancelled() => return Err(SpeechError::Cancelled),
            Err(mpsc::RecvTimeoutError::Timeout) => continue,
            Err(mpsc::RecvTimeoutError::Disconnected) => {
                spoken.stopped = limits.is_cancelled();
                return Ok(());
            }
        };
        for block in sound.samples.chunks(block) {
            if limits.is_cancelled() {
                return Err(SpeechError::Cancelled);
            }
            spoken.first_sound.get_or_insert_with(|| begun.elapsed());
            sink.write(block)?;
        }
        spoken.sentences += 1;
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;
    use crate::audio::sink::MemorySink;
    use crate::audio::{AudioError, Recording};

    /// Takes 50 ms for a sentence of a tenth of a second.
    #[derive(Default)]
    struct Slow(AtomicUsize);

    impl Synthesizer for Slow {
        fn name(&self) -> &'static str {
            "slow"
        }

        fn synthesize(&self, sentence: &str, limits: &Limits) -> Result<Recording, SpeechError> {
            self.0.fetch_add(1, Ordering::SeqCst);
            let begun = Instant::now();
            while begun.elapsed() < Duration::from_millis(50) {
                if limits.is_cancelled() {
                    return Err(SpeechError::Cancelled);
                }
                std::thread::sleep(Duration::from_millis(1));
            }
            if sentence == "fail" {
                return Err(SpeechError::Limit("no such word".into()));
            }
            Ok(Recording { rate: 16_000, samples: vec![0.5; 1_600] })
        }
    }

    /// Takes as long as the sound, and stops the speaker after a number of samples.
    struct Loudspeaker {
        heard: MemorySink,
        stop_after: usize,
        limits: Limits,
        made: std::sync::Arc<Slow>,
        /// Sentences begun by the synthesizer when the first block is heard.
        made_at_first: Option<usize>,
    }

    impl AudioSink for Loudspeaker {
        fn rate(&self) -> u32 {
            16_000
        }

        fn write(&mut self, block: &[f32]) -> Result<(), AudioError> {
            std::thread::sleep(Duration::from_millis(block.len() as u64 / 16));
            self.made_at_first.get_or_insert_with(|| self.made.0.load(Ordering::SeqCst));
            self.heard.write(block)?;
            if self.heard.samples.len() >= self.stop_after {
                self.limits.cancel.store(true, Ordering::Relaxed);
            }
            Ok(())
        }

        fn stop(&mut self) {
            self.heard.stop();
        }

        fn finish(&mut self) -> Result<(), AudioError> {
            Ok(())
        }
    }

    fn spoken(sentences: &[&str], stop_after: usize) -> (Result<Spoken, String>, Loudspeaker, usize) {
        let limits = Limits::within(Duration::from_secs(60));
        let made = std::sync::Arc::new(Slow::default());
        let heard = MemorySink::new(16_000);
        let mut sink =
            Loudspeaker { heard, stop_after, limits: limits.clone(), made: made.clone(), made_at_first: None };
        let sentences: Vec<String> = sentences.iter().map(|s| (*s).to_owned()).collect();
        let outcome = speak(sentences.into_iter(), &*made, &mut sink, &limits).map_err(|e| e.to_string());
        let count = made.0.load(Ordering::SeqCst);
        (outcome, sink, count)
    }

    #[test]
    fn one_sentence_is_made_while_another_sounds() {
        let begun = Instant::now();
        let (outcome, sink, made) = spoken(&["one", "two", "three"], usize::MAX);
        let spoken = outcome.unwrap();
        assert_eq!((spoken.sentences, spoken.stopped, made, sink.heard.samples.len()), (3, false, 3, 4_800));
        assert!(sink.made_at_first.unwrap() <= 2, "all were made before the first was heard");
        assert!(spoken.first_sound.unwrap() < begun.elapsed() / 2, "{spoken:?}");
    }

    #[test]
    fn a_stop_is_heard_at_once_and_ends_the_synthesis() {
        let (outcome, sink, made) = spoken(&["one", "two", "three", "four", "five"], 800);
        let spoken = outcome.unwrap();
        assert_eq!((spoken.sentences, spoken.stopped, sink.heard.stops), (0, true, 1));
        assert!(made <= 2 && sink.heard.samples.len() <= 800 + 320, "{made} {}", sink.heard.samples.len());
    }

    #[test]
    fn a_sentence_that_fails_ends_the_reply_behind_those_before_it() {
        let (outcome, sink, made) = spoken(&["one", "fail", "three"], usize::MAX);
        assert_eq!(outcome.unwrap_err(), "no such word");
        assert_eq!((made, sink.heard.samples.len()), (2, 1_600));
        let (outcome, ..) = spoken(&[], usize::MAX);
        assert_eq!(outcome.unwrap(), Spoken::default());
    }
}
