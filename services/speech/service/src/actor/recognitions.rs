//! From sound to text: recognitions under way, early ones that begin in a pause, and their results.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use sg_proto::keys;
use sg_proto::scene::State as SceneState;
use sg_proto::speech;
use sg_runtime::context::Context;
use sg_speech::child_process::Limits;
use sg_speech::conversation::{Event, Turn};
use sg_speech::endpoint::Control;
use sg_speech::error::SpeechError;
use sg_speech::phrases::PhraseGrammar;
use sg_speech::recognizer::Recognition;

use super::{Message, Speech};
use crate::commands;
use crate::devices;
use crate::microphone::{Microphone, Sound};
use crate::recognition_thread::{JobId, RecognitionThread, Report};

/// Longest recognition.
const LONGEST: Duration = Duration::from_secs(10);

type Outcome = Result<Recognition, SpeechError>;

/// A recognition under way.
struct Running {
    id: JobId,
    limits: Limits,
}

impl Running {
    fn cancel(&self) {
        self.limits.cancel.store(true, Ordering::Relaxed);
    }
}

/// A recognition that began in a pause, before the utterance has ended.
struct Early {
    running: Running,
    start: u64,
    voice_end: u64,
    outcome: Option<Outcome>,
}

/// An utterance that waits for its text.
struct Awaited {
    turn: Turn,
    running: Running,
    voice_ended: Instant,
    /// All samples, where the recognition began early. The rest may hold soft speech, so a text that is no command is looked for
    /// again in all of them.
    whole: Option<Vec<f32>>,
}

/// The utterance that has ended, until the conversation asks for its recognition.
struct Complete {
    start: u64,
    voice_end: u64,
    samples: Vec<f32>,
    voice_ended: Instant,
}

/// Recognitions under way.
pub(super) struct Recognitions {
    thread: Option<RecognitionThread>,
    scene: SceneState,
    /// The sentences that are expected, without and with a yes or no.
    expected: [Arc<PhraseGrammar>; 2],
    utterances: u64,
    partial: Option<Running>,
    early: Option<Early>,
    complete: Option<Complete>,
    awaited: Option<Awaited>,
}

impl Recognitions {
    pub(super) fn new(thread: Option<RecognitionThread>) -> Self {
        Self {
            thread,
            scene: SceneState::default(),
            expected: Default::default(),
            utterances: 0,
            partial: None,
            early: None,
            complete: None,
            awaited: None,
        }
    }

    pub(super) fn utterances(&self) -> u64 {
        self.utterances
    }

    pub(super) fn scene(&self) -> &SceneState {
        &self.scene
    }

    /// Takes the state of the scene, and prepares its sentences.
    pub(super) fn expect(&mut self, scene: SceneState, state: &mut speech::State) {
        self.scene = scene;
        let Some(thread) = &self.thread else { return };
        let both = commands::expected(&self.scene, false)
            .and_then(|plain| Ok([Arc::new(plain), Arc::new(commands::expected(&self.scene, true)?)]));
        match both {
            Ok(expected) if expected[0] != self.expected[0] => {
                thread.prepare(&expected[0]);
                self.expected = expected;
            }
            Ok(_) => {}
            Err(error) => state.notice = format!("commands with names of units are not recognised: {error}"),
        }
    }

    /// Cancels everything under way.
    pub(super) fn cancel(&mut self) {
        let early = self.early.take().map(|early| early.running);
        let awaited = self.awaited.take().map(|awaited| awaited.running);
        [self.partial.take(), early, awaited].iter().flatten().for_each(Running::cancel);
        self.complete = None;
    }

    fn begin(&mut self, samples: Vec<f32>, with_answers: bool) -> Result<Running, String> {
        let Some(thread) = &mut self.thread else { return Err("nothing recognises speech".to_owned()) };
        let limits = Limits::within(LONGEST);
        let id = thread.recognize(samples, &self.expected[usize::from(with_answers)], &limits)?;
        Ok(Running { id, limits })
    }
}

impl Speech {
    /// Opens the microphone.
    pub(super) fn open(&mut self) {
        let Some(input) = self.input.clone().filter(|_| self.microphone.is_none()) else { return };
        let mailbox = self.mailbox.clone();
        let opened = self.params.endpoints().and_then(|settings| {
            let source = devices::input(&input, self.params.input_rate).map_err(|e| e.to_string())?;
            Microphone::start(source, settings, self.params.muted, move |sound| mailbox.send(Message::Sound(sound)))
        });
        match opened {
            Ok(microphone) => {
                let watched = microphone.clone();
                self.host.watch_loop("microphone", move || watched.silent_for());
                self.microphone = Some(microphone);
            }
            Err(problem) => {
                self.state.input = String::new();
                self.state.notice = format!("no microphone: {problem}");
                tracing::error!(problem, "the microphone could not be opened");
            }
        }
    }

    /// Tells the microphone of a change.
    pub(super) fn control_microphone(&self, control: Control) {
        if let Some(microphone) = &self.microphone {
            microphone.control(control);
        }
    }

    /// Takes what the microphone hears.
    pub(super) async fn hear(&mut self, sound: Sound) {
        match sound {
            Sound::Started => {
                self.recognitions.cancel_partial_and_early();
                self.step(Event::SpeechStarted).await;
            }
            Sound::Partial { samples } => {
                // A partial text is worth no wait: one at a time, and only if nothing else runs. An early one that has ended was of a
                // pause within the sentence.
                if self.recognitions.partial.is_none()
                    && self.recognitions.early.as_ref().is_none_or(|early| early.outcome.is_some())
                    && self.recognitions.awaited.is_none()
                {
                    self.recognitions.partial = self.recognitions.begin(samples, self.dialogue.has_question()).ok();
                }
            }
            Sound::Paused { start, voice_end, samples } => {
                self.recognitions.cancel_partial_and_early();
                if let Ok(running) = self.recognitions.begin(samples, self.dialogue.has_question()) {
                    self.recognitions.early = Some(Early { running, start, voice_end, outcome: None });
                }
            }
            Sound::Ended { start, voice_end, samples, voice_ended } => {
                self.recognitions.utterances += 1;
                self.recognitions.complete = Some(Complete { start, voice_end, samples, voice_ended });
                self.step(Event::SpeechEnded).await;
                self.recognitions.complete = None;
            }
            Sound::Dropped => {
                self.recognitions.cancel_partial_and_early();
                self.step(Event::SpeechDropped).await;
            }
            Sound::Closed { problem } => {
                self.state.notice = match problem {
                    Some(problem) => format!("the microphone has failed: {problem}; restart the service `speech`"),
                    None => format!("{} has ended", self.state.input),
                };
                self.state.input = String::new();
                tracing::info!(notice = self.state.notice, "the microphone is closed");
            }
        }
    }

    /// Recognises the utterance that has ended.
    pub(super) async fn recognize(&mut self, turn: Turn) {
        let Some(Complete { start, voice_end, samples, voice_ended }) = self.recognitions.complete.take() else {
            return;
        };
        if let Some(partial) = self.recognitions.partial.take() {
            partial.cancel();
        }
        let early = self.recognitions.early.take();
        let (running, outcome, whole) = match early {
            Some(Early { running, start: from, voice_end: end, outcome }) if (from, end) == (start, voice_end) => {
                (Ok(running), outcome, Some(samples))
            }
            other => {
                if let Some(other) = other {
                    other.running.cancel();
                }
                (self.recognitions.begin(samples, self.dialogue.has_question()), None, None)
            }
        };
        match running {
            Ok(running) => {
                let awaited = Awaited { turn, running, voice_ended, whole };
                match outcome {
                    Some(outcome) => self.take_result(awaited, outcome).await,
                    None => self.recognitions.awaited = Some(awaited),
                }
            }
            Err(problem) => {
                self.state.notice = problem;
                self.step_later(Event::NotUnderstood { turn });
            }
        }
    }

    /// Takes the result for the utterance that is awaited, or looks again in all of its sound.
    async fn take_result(&mut self, mut awaited: Awaited, outcome: Outcome) {
        let accept = |heard| commands::with_acceptance(heard, &self.recognitions.scene, self.params.free_text);
        let outcome = outcome.map(accept);
        let again = awaited.whole.take().filter(|_| !outcome.as_ref().is_ok_and(|heard| heard.accepted));
        if let Some(samples) = again
            && let Ok(running) = self.recognitions.begin(samples, self.dialogue.has_question())
        {
            awaited.running = running;
            self.recognitions.awaited = Some(awaited);
            return;
        }
        self.understand(awaited.turn, outcome, awaited.voice_ended).await;
    }

    /// Gives up the recognition of a turn.
    pub(super) fn cancel_recognition(&mut self, turn: Turn) {
        if let Some(awaited) = self.recognitions.awaited.take_if(|awaited| awaited.turn == turn) {
            awaited.running.cancel();
        }
    }

    /// Takes a result of the recognizer.
    pub(super) async fn recognized(&mut self, report: Report) {
        let (id, outcome) = match report {
            Report::Prepared { notice } => {
                if let Some(notice) = notice {
                    self.state.notice = notice;
                }
                return;
            }
            Report::Recognized { id, outcome } => (id, outcome),
        };
        if let Some(awaited) = self.recognitions.awaited.take_if(|awaited| awaited.running.id == id) {
            return self.take_result(awaited, outcome).await;
        }
        if let Some(early) = self.recognitions.early.as_mut().filter(|early| early.running.id == id) {
            early.outcome = Some(outcome);
            return;
        }
        if self.recognitions.partial.take_if(|partial| partial.id == id).is_some()
            && let Ok(recognition) = outcome
            && !recognition.text.is_empty()
        {
            self.publish_recognition(&recognition, false, None).await;
        }
    }

    /// Takes the text of an utterance, whose acceptance is decided.
    async fn understand(&mut self, turn: Turn, outcome: Outcome, voice_ended: Instant) {
        let recognition = match outcome {
            Ok(recognition) => recognition,
            Err(SpeechError::Cancelled) => return self.step_later(Event::NotUnderstood { turn }),
            Err(error) => {
                self.state.notice = format!("the utterance was not recognised: {error}");
                tracing::warn!(%error, "an utterance was not recognised");
                return self.step_later(Event::NotUnderstood { turn });
            }
        };
        let accepted = recognition.accepted;
        self.publish_recognition(&recognition, true, Some(voice_ended.elapsed())).await;
        if accepted {
            self.state.notice.clear();
            self.step_later(Event::Understood { turn, text: recognition.text });
        } else {
            self.state.notice = match recognition.text.as_str() {
                "" => "no word was recognised".to_owned(),
                text => format!("“{text}” is no command"),
            };
            self.step_later(Event::NotUnderstood { turn });
        }
    }

    async fn publish_recognition(&mut self, recognition: &Recognition, is_final: bool, after_voice: Option<Duration>) {
        let milliseconds = |time: Duration| time.as_secs_f64() * 1e3;
        let message = speech::Recognition {
            utterance: self.recognitions.utterances + u64::from(!is_final),
            text: recognition.text.clone(),
            r#final: is_final,
            confidence: recognition.confidence,
            accepted: recognition.accepted && is_final,
            recognizer: self.state.recognizer.clone(),
            elapsed_ms: milliseconds(recognition.elapsed),
            after_voice_ms: after_voice.map_or(0.0, milliseconds),
        };
        if let Err(fault) = self.bus.publish(&keys::SPEECH_RECOGNITION, &message, &Context::root()).await {
            tracing::warn!(%fault, "a recognition could not be published");
        }
    }
}

impl Recognitions {
    fn cancel_partial_and_early(&mut self) {
        let early = self.early.take().map(|early| early.running);
        [self.partial.take(), early].iter().flatten().for_each(Running::cancel);
    }
}
