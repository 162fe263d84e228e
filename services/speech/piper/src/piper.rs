//! A Piper voice as one of the synthesizers of `sg-speech`.

use std::ffi::OsStr;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use sg_speech::audio::{Recording, samples_in};
use sg_speech::child_process::Limits;
use sg_speech::error::SpeechError;
use sg_speech::recognizer::Synthesizer;
use sg_speech::synthesis::has_words;

use crate::config::Config;
use crate::error::{NAME, PiperError};
use crate::network::{Network, Request, Scales};
use crate::phonemes::{Phonemizer, SentenceIds, ids_of};

/// Longest sound of a text.
pub const LONGEST: Duration = Duration::from_secs(60);

/// Speeds of speech, as multiples of the voice's own.
pub const SPEEDS: std::ops::RangeInclusive<f32> = 0.5..=2.0;

/// Seed of the noise in all sentences, so that a sentence always sounds the same.
const SEED: u64 = 20_210_611;

/// A voice. It can speak in several threads at once; each takes all processor cores.
pub struct Piper {
    network: Network,
    config: Config,
    phonemizer: Phonemizer,
    speaker: usize,
    scales: Scales,
    unknown: AtomicU64,
}

impl Piper {
    /// Opens a voice: `NAME.onnx` with `NAME.onnx.json` beside it. Nothing is downloaded. Most voices get their phonemes from
    /// espeak-ng, which is looked for in the folders of `search_path`, such as `PATH`.
    ///
    /// # Errors
    /// [`PiperError`]: the files are no voice of Piper's, or of one whose kind is not supported, or espeak-ng is not installed.
    pub fn open(voice: &Path, search_path: Option<&OsStr>) -> Result<Self, PiperError> {
        let config = Config::read(voice)?;
        let phonemizer = Phonemizer::find(&config, search_path)?;
        let network = Network::read(voice)?;
        config.check_ids(network.symbols())?;
        Ok(Self { network, phonemizer, speaker: 0, scales: config.scales, config, unknown: AtomicU64::new(0) })
    }

    /// Samples a second of its sound.
    #[must_use]
    pub fn rate(&self) -> u32 {
        self.config.rate
    }

    /// Number of its speakers, at least 1.
    #[must_use]
    pub fn speakers(&self) -> usize {
        self.network.speakers()
    }

    /// Phonemes that the voice did not know and left out, in all texts so far.
    #[must_use]
    pub fn unknown_phonemes(&self) -> u64 {
        self.unknown.load(Ordering::Relaxed)
    }

    /// Another speaker of the voice, by name or by number from 0. The first one speaks otherwise.
    ///
    /// # Errors
    /// [`PiperError::Limit`]: the voice has no such speaker. The message lists some that it has.
    pub fn with_speaker(mut self, speaker: &str) -> Result<Self, PiperError> {
        let number = self.config.speakers.get(speaker).copied().or_else(|| speaker.parse().ok());
        let Some(number) = number.filter(|number| *number < self.speakers()) else {
            let names: Vec<&str> = self.config.speakers.keys().take(8).map(String::as_str).collect();
            let names = if names.is_empty() { "no names".to_owned() } else { names.join(", ") };
            let (last, names) = (self.speakers() - 1, sg_input::printable(&names).into_owned());
            let problem =
                format!("the voice has no speaker “{}”; take 0 to {last} ({names})", sg_input::printable(speaker));
            return Err(PiperError::Limit(problem));
        };
        self.speaker = number;
        Ok(self)
    }

    /// Faster or slower than the voice's own speed of 1.
    ///
    /// # Errors
    /// [`PiperError::Limit`]: not within [`SPEEDS`].
    pub fn with_speed(mut self, speed: f32) -> Result<Self, PiperError> {
        if !SPEEDS.contains(&speed) {
            let problem = format!("a speed of {speed} cannot be spoken; take {} to {}", SPEEDS.start(), SPEEDS.end());
            return Err(PiperError::Limit(problem));
        }
        self.scales.length = self.config.scales.length / speed;
        Ok(self)
    }

    /// The voice with this share of its own noise, which varies melody and rhythm from sentence to sentence. 0 is flat.
    ///
    /// # Errors
    /// [`PiperError::Limit`]: not from 0 to 1.
    pub fn with_noise(mut self, share: f32) -> Result<Self, PiperError> {
        if !(0.0..=1.0).contains(&share) {
            return Err(PiperError::Limit(format!("a share of {share} of the noise cannot be spoken; take 0 to 1")));
        }
        let own = self.config.scales;
        (self.scales.noise, self.scales.duration_noise) = (share * own.noise, share * own.duration_noise);
        Ok(self)
    }

    /// Speaks a text, sentence by sentence. A text without letters or digits gives no samples.
    ///
    /// # Errors
    /// [`PiperError`]: the text is longer than [`MAX_TEXT`](sg_speech::synthesis::MAX_TEXT) bytes, or its sound would be longer than [`LONGEST`]. The phonemes fail,
    /// the deadline passes, or the work is cancelled.
    pub fn speak(&self, text: &str, limits: &Limits) -> Result<Recording, PiperError> {
        let mut sound = Recording { rate: self.rate(), samples: Vec::new() };
        if !has_words(text)? {
            return Ok(sound);
        }
        let began = Instant::now();
        let go_on = || match () {
            () if limits.is_cancelled() => Err(PiperError::Cancelled),
            () if Instant::now() >= limits.deadline => Err(PiperError::Late(began.elapsed())),
            () => Ok(()),
        };
        let most = samples_in(LONGEST, self.rate());
        for sentence in self.phonemizer.sentences(text, limits)? {
            let SentenceIds { ids, unknown } = ids_of(&sentence, &self.config);
            self.unknown.fetch_add(unknown as u64, Ordering::Relaxed);
            let request = Request {
                ids: &ids,
                speaker: self.speaker,
                scales: self.scales,
                most: most.saturating_sub(sound.samples.len()),
                seed: SEED,
                go_on: &go_on,
            };
            sound.samples.extend(self.network.speak(&request)?);
        }
        Ok(sound)
    }
}

impl Synthesizer for Piper {
    fn name(&self) -> &'static str {
        NAME
    }

    fn synthesize(&self, sentence: &str, limits: &Limits) -> Result<Recording, SpeechError> {
        Ok(self.speak(sentence, limits)?)
    }
}
