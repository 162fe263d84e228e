//! The thread of the microphone: it reads sound, and finds utterances in it.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc;
use std::time::{Duration, Instant};

use sg_speech::audio::resample::Resampler;
use sg_speech::audio::source::{AudioSource, Block};
use sg_speech::audio::{AudioError, SPEECH_RATE, duration_of, samples_in};
use sg_speech::endpoint::{Control, Endpoint, EndpointSettings, Endpointer};
use sg_speech::vad::GatedDetector;

/// Longest wait for sound, so that changes of the button are taken soon.
const WAIT: Duration = Duration::from_millis(20);

/// Time without samples from which an utterance goes on in silence: the writer of a pipe may stop in the middle of it.
const LOST: Duration = Duration::from_millis(200);

/// What the microphone hears.
#[derive(Debug)]
pub(crate) enum Sound {
    /// An utterance has begun.
    Started,
    /// The utterance so far.
    Partial { samples: Vec<f32> },
    /// The voice has paused: the utterance has perhaps ended.
    Paused { start: u64, voice_end: u64, samples: Vec<f32> },
    /// The utterance is complete. `voice_ended` is when its last voiced sample arrived.
    Ended { start: u64, voice_end: u64, samples: Vec<f32>, voice_ended: Instant },
    /// It was none.
    Dropped,
    /// The file or pipe has ended, or failed with this line.
    Closed { problem: Option<String> },
}

/// The running thread.
#[derive(Clone)]
pub(crate) struct Microphone {
    controls: mpsc::Sender<Control>,
    begun: Instant,
    /// Milliseconds from `begun` to the last turn of the loop; the largest number after its end.
    last_turn: Arc<AtomicU64>,
}

impl Microphone {
    /// Starts the thread. `heard` takes what it hears and must not wait.
    ///
    /// # Errors
    /// [`AudioError`]: a rate out of bounds. The system's error if no thread starts.
    pub(crate) fn start(
        source: Box<dyn AudioSource>,
        settings: EndpointSettings,
        muted: bool,
        heard: impl Fn(Sound) + Send + 'static,
    ) -> Result<Self, String> {
        let resampler = Resampler::new(source.rate(), SPEECH_RATE).map_err(|e| e.to_string())?;
        let mut endpointer = Endpointer::new(Box::new(GatedDetector::default()), settings);
        if muted {
            endpointer.control(Control::Mute);
        }
        let (controls, waiting) = mpsc::channel();
        let microphone = Self { controls, begun: Instant::now(), last_turn: Arc::default() };
        let watched = microphone.clone();
        let listen = move || {
            let mut listener = Listener { source, resampler, endpointer, heard };
            let problem = listener.run(&waiting, &watched).err().map(|e| e.to_string());
            watched.last_turn.store(u64::MAX, Ordering::Relaxed);
            (listener.heard)(Sound::Closed { problem });
        };
        let named = std::thread::Builder::new().name("microphone".to_owned());
        named.spawn(listen).map_err(|e| format!("no thread for the microphone: {e}"))?;
        Ok(microphone)
    }

    /// Applies a change at the present position. After the end of the sound it does nothing.
    pub(crate) fn control(&self, control: Control) {
        // Bounded by the requests of a person, and taken within 20 ms.
        let _ = self.controls.send(control);
    }

    /// Time since the last turn of the loop; zero after its end.
    pub(crate) fn silent_for(&self) -> Duration {
        match self.last_turn.load(Ordering::Relaxed) {
            u64::MAX => Duration::ZERO,
            last => self.begun.elapsed().saturating_sub(Duration::from_millis(last)),
        }
    }
}

struct Listener<F> {
    source: Box<dyn AudioSource>,
    resampler: Resampler,
    endpointer: Endpointer,
    heard: F,
}

impl<F: Fn(Sound)> Listener<F> {
    fn run(&mut self, controls: &mpsc::Receiver<Control>, watched: &Microphone) -> Result<(), AudioError> {
        let mut samples = Vec::new();
        let mut last_samples = Instant::now();
        loop {
            let turn = watched.begun.elapsed().as_millis();
            watched.last_turn.store(u64::try_from(turn).unwrap_or(u64::MAX - 1), Ordering::Relaxed);
            while let Ok(control) = controls.try_recv() {
                let events = self.endpointer.control(control);
                self.report(events);
            }
            match self.source.read(WAIT)? {
                Block::Silent => {
                    if self.endpointer.is_in_speech() && last_samples.elapsed() > LOST {
                        samples.clear();
                        samples.resize(samples_in(WAIT, SPEECH_RATE), 0.0);
                        let events = self.endpointer.step(&samples);
                        self.report(events);
                    }
                }
                Block::Samples(block) => {
                    last_samples = Instant::now();
                    samples.clear();
                    self.resampler.push(&block, &mut samples)?;
                    let events = self.endpointer.step(&samples);
                    self.report(events);
                }
                Block::Ended => {
                    samples.clear();
                    self.resampler.finish(&mut samples)?;
                    let events = self.endpointer.step(&samples);
                    self.report(events);
                    let events = self.endpointer.finish();
                    self.report(events);
                    return Ok(());
                }
            }
        }
    }

    fn report(&self, events: Vec<Endpoint>) {
        for event in events {
            let so_far = || self.endpointer.utterance().to_vec();
            (self.heard)(match event {
                Endpoint::SpeechStarted { .. } => Sound::Started,
                Endpoint::PartialDue { .. } => Sound::Partial { samples: so_far() },
                Endpoint::Paused { start, voice_end } => Sound::Paused { start, voice_end, samples: so_far() },
                Endpoint::SpeechDropped { .. } => Sound::Dropped,
                Endpoint::SpeechEnded { start, samples, voice_end, .. } => {
                    let after =
                        usize::try_from(self.endpointer.position().saturating_sub(voice_end)).unwrap_or(usize::MAX);
                    let now = Instant::now();
                    let voice_ended = now.checked_sub(duration_of(after, SPEECH_RATE)).unwrap_or(now);
                    Sound::Ended { start, voice_end, samples, voice_ended }
                }
            });
        }
    }
}
