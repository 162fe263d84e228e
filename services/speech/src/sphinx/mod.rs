//! Recognizer with a grammar: CMU's `pocketsphinx` as a child process.
//!
//! Two decodings of an utterance run side by side: by the grammar, and as free phones. [`Features`] compares them.

mod confidence;
mod jsgf;
pub mod pronunciation;
mod segmentation;

use std::ffi::{OsStr, OsString};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use tempfile::TempDir;

pub use self::confidence::Features;
use self::pronunciation::{Dictionary, LetterToSound};
use self::segmentation::{FRAME_RATE, Segment};
use crate::audio::wav::to_i16;
use crate::audio::{SPEECH_RATE, duration_of};
use crate::child_process::{Limits, Program};
use crate::error::SpeechError;
use crate::phrases::PhraseGrammar;
use crate::recognizer::{MAX_UTTERANCE, Recognition, Recognizer, TimedText, has_voice};

/// Where Debian's packages put the models.
pub const MODELS: &str = "/usr/share/pocketsphinx/model/en-us";

/// Most bytes of a result.
const MAX_RESULT: u64 = 1 << 20;

/// Confidence from which a result is accepted, unless set otherwise.
pub const ACCEPTED_FROM: f32 = 0.6;

/// A result with what its confidence was computed from, for calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct SphinxResult {
    /// The result.
    pub recognition: Recognition,
    /// What the two decodings say; `None` if nothing was recognised.
    pub features: Option<Features>,
}

/// A grammar that the program can load.
struct Prepared {
    phrases: PhraseGrammar,
    folder: TempDir,
    is_empty: bool,
    unpronounceable: Vec<String>,
}

/// The recognizer.
pub struct Sphinx {
    program: Program,
    models: PathBuf,
    dictionary: Dictionary,
    letter_to_sound: Result<LetterToSound, SpeechError>,
    prepared: Option<Prepared>,
    accepted_from: f32,
}

impl Sphinx {
    /// Finds the program on a search path, and its models in a folder such as [`MODELS`].
    ///
    /// # Errors
    /// [`SpeechError::Missing`] with Debian's package, or a dictionary that cannot be read.
    pub fn find(path: Option<&OsStr>, models: &Path) -> Result<Self, SpeechError> {
        let program = Program::find("pocketsphinx_batch", "pocketsphinx", path)?;
        if !models.join("en-us/mdef").is_file() {
            return Err(SpeechError::Missing { program: "the acoustic model en-us", package: "pocketsphinx-en-us" });
        }
        let dictionary = Dictionary::read(&models.join("cmudict-en-us.dict"))?;
        let letter_to_sound = LetterToSound::find(path);
        let (models, accepted_from) = (models.to_owned(), ACCEPTED_FROM);
        Ok(Self { program, models, dictionary, letter_to_sound, prepared: None, accepted_from })
    }

    /// Sets the confidence from which a result is accepted.
    pub fn set_accepted_from(&mut self, confidence: f32) {
        self.accepted_from = confidence;
    }

    /// Makes the grammar's files, if it is a new one. A recognition does this by itself; doing it before saves its time.
    ///
    /// Returns the words that cannot be pronounced. Sentences with them are left out.
    ///
    /// # Errors
    /// [`SpeechError`]: no room for the files, or letter-to-sound fails.
    pub fn prepare_grammar(&mut self, phrases: &PhraseGrammar, limits: &Limits) -> Result<&[String], SpeechError> {
        if self.prepared.as_ref().is_none_or(|prepared| prepared.phrases != *phrases) {
            self.prepared = Some(self.prepare_anew(phrases, limits)?);
        }
        Ok(self.prepared.as_ref().map_or(&[], |prepared| &prepared.unpronounceable))
    }

    fn prepare_anew(&self, phrases: &PhraseGrammar, limits: &Limits) -> Result<Prepared, SpeechError> {
        let vocabulary = phrases.vocabulary();
        let missing: Vec<&str> = vocabulary
            .iter()
            .map(String::as_str)
            .filter(|word| self.dictionary.look_up(word).next().is_none())
            .collect();
        let guessed = match &self.letter_to_sound {
            Ok(rules) => rules.pronounce(&missing, limits)?,
            Err(_) => vec![None; missing.len()],
        };
        let mut lines = String::new();
        let mut unpronounceable = Vec::new();
        for word in &vocabulary {
            for (k, phones) in self.dictionary.look_up(word).enumerate() {
                let _ = match k {
                    0 => writeln!(lines, "{word} {phones}"),
                    _ => writeln!(lines, "{word}({}) {phones}", k + 1),
                };
            }
        }
        for (word, phones) in missing.iter().zip(guessed) {
            match phones {
                Some(phones) => drop(writeln!(lines, "{word} {phones}")),
                None => unpronounceable.push((*word).to_owned()),
            }
        }
        let folder = tempfile::tempdir().map_err(|error| SpeechError::File(format!("temporary folder: {error}")))?;
        let grammar = jsgf::jsgf(phrases, &|word| !unpronounceable.iter().any(|other| other == word));
        write(&folder.path().join("words.dict"), lines.as_bytes())?;
        write(&folder.path().join("commands.jsgf"), grammar.as_deref().unwrap_or_default().as_bytes())?;
        write(&folder.path().join("silence.dict"), b"silence SIL\n")?;
        write(&folder.path().join("utterances"), b"u\n")?;
        Ok(Prepared { phrases: phrases.clone(), folder, is_empty: grammar.is_none(), unpronounceable })
    }

    /// Recognises, and says what the confidence was computed from.
    ///
    /// # Errors
    /// As [`Recognizer::recognize`].
    pub fn recognize_with_features(
        &mut self,
        samples: &[f32],
        phrases: &PhraseGrammar,
        limits: &Limits,
    ) -> Result<SphinxResult, SpeechError> {
        let began = Instant::now();
        let length = duration_of(samples.len(), SPEECH_RATE);
        if length > MAX_UTTERANCE {
            return Err(SpeechError::Limit(format!(
                "an utterance of {:.0} s is longer than the limit of {} s; speak in sentences",
                length.as_secs_f64(),
                MAX_UTTERANCE.as_secs()
            )));
        }
        self.prepare_grammar(phrases, limits)?;
        let Some(prepared) = &self.prepared else { return Err(SpeechError::Cancelled) };
        // A grammar finds a sentence in silence too, and free phones explain silence no better.
        if prepared.is_empty || !has_voice(samples) {
            return Ok(SphinxResult { recognition: Recognition::default(), features: None });
        }
        let folder = prepared.folder.path();
        let bytes: Vec<u8> = samples.iter().flat_map(|sample| to_i16(*sample).to_le_bytes()).collect();
        write(&folder.join("u.raw"), &bytes)?;
        let (grammar, phones) = std::thread::scope(|scope| {
            let phones = scope.spawn(|| self.decode(folder, "phones", &self.phone_arguments(folder), limits));
            let grammar = self.decode(folder, "words", &grammar_arguments(folder), limits);
            let phones = phones.join();
            (grammar, phones.unwrap_or(Err(SpeechError::Cancelled)))
        });
        let (grammar, phones) = (grammar?, phones?);
        let said: Vec<&str> = grammar.iter().filter(|s| !s.is_filler()).map(|s| s.word.as_str()).collect();
        let said = said.join(" ");
        let Some(features) = Features::of(&grammar, &phones) else {
            let recognition = Recognition { elapsed: began.elapsed(), ..Recognition::default() };
            return Ok(SphinxResult { recognition, features: None });
        };
        // An utterance that stops in the middle of a sentence is decoded to its part: that is no command.
        let written = phrases.written(&said);
        let whole = written.is_some();
        let confidence = if whole { features.confidence() } else { 0.0 };
        let recognition = Recognition {
            text: written.unwrap_or(said),
            confidence,
            accepted: whole && confidence >= self.accepted_from,
            alternatives: Vec::new(),
            parts: grammar.iter().filter(|segment| !segment.is_filler()).map(timed_word).collect(),
            elapsed: began.elapsed(),
        };
        Ok(SphinxResult { recognition, features: Some(features) })
    }

    fn phone_arguments(&self, folder: &Path) -> Vec<OsString> {
        // Phones need no words, but the program wants a dictionary, and loads a small one faster.
        let mut arguments: Vec<OsString> = vec!["-dict".into(), folder.join("silence.dict").into()];
        arguments.extend(["-allphone".into(), self.models.join("en-us-phone.lm.bin").into()]);
        // Phones without context decode at a tenth of real time; with context they take more than real time.
        let more = ["-allphone_ci", "yes", "-lw", "2.0", "-pip", "0.3", "-beam", "1e-20", "-pbeam", "1e-20"];
        arguments.extend(more.map(Into::into));
        arguments
    }

    fn decode(
        &self,
        folder: &Path,
        name: &str,
        arguments: &[OsString],
        limits: &Limits,
    ) -> Result<Vec<Segment>, SpeechError> {
        let result = folder.join(format!("{name}.seg"));
        let _ = std::fs::remove_file(&result);
        let mut all: Vec<OsString> = vec!["-hmm".into(), self.models.join("en-us").into()];
        all.extend(["-ctl".into(), folder.join("utterances").into(), "-cepdir".into(), folder.into()]);
        all.extend(["-cepext", ".raw", "-adcin", "yes", "-remove_silence", "no"].map(Into::into));
        all.extend(["-hypseg".into(), result.clone().into(), "-logfn".into(), "/dev/null".into()]);
        all.extend_from_slice(arguments);
        self.program.run(&all, &[], 1 << 16, limits)?;
        let failed = |problem: String| SpeechError::Failed { program: self.program.name().into(), problem };
        let text = sg_input::file::read_text(&result, MAX_RESULT).map_err(|error| failed(error.to_string()))?;
        let line = text.lines().next().unwrap_or_default();
        segmentation::parse(line).ok_or_else(|| {
            let line: String = sg_input::printable(line).chars().take(80).collect();
            failed(format!("its result “{line}” is not of the known form"))
        })
    }
}

impl Recognizer for Sphinx {
    fn name(&self) -> &'static str {
        "sphinx"
    }

    fn prepare(&mut self, phrases: &PhraseGrammar, limits: &Limits) -> Result<Option<String>, SpeechError> {
        let unknown = self.prepare_grammar(phrases, limits)?;
        let line = || {
            let unknown = unknown.join(", ");
            format!("names with these words cannot be recognised, since no rule says how they sound: {unknown}")
        };
        Ok((!unknown.is_empty()).then(line))
    }

    fn recognize(
        &mut self,
        samples: &[f32],
        phrases: &PhraseGrammar,
        limits: &Limits,
    ) -> Result<Recognition, SpeechError> {
        self.recognize_with_features(samples, phrases, limits).map(|result| result.recognition)
    }
}

fn grammar_arguments(folder: &Path) -> Vec<OsString> {
    let mut arguments: Vec<OsString> = vec!["-dict".into(), folder.join("words.dict").into()];
    arguments.extend(["-jsgf".into(), folder.join("commands.jsgf").into()]);
    // Wide beams: in babble at 12 dB they raise the commands that are right from 79 to 109 of 136. Wider ones change nothing.
    arguments.extend(["-beam", "1e-80", "-pbeam", "1e-80", "-wbeam", "1e-60"].map(Into::into));
    // No list of alternatives: the program's search for it takes ten times as long as the decoding where speech is off topic.
    arguments.extend(["-bestpath", "no"].map(Into::into));
    arguments
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), SpeechError> {
    std::fs::write(path, bytes).map_err(|error| SpeechError::File(format!("{}: {error}", path.display())))
}

fn timed_word(segment: &Segment) -> TimedText {
    let at = |frame: usize| Duration::from_secs_f32(frame as f32 / FRAME_RATE);
    TimedText { text: segment.word.clone(), start: at(segment.start), end: at(segment.end) }
}
