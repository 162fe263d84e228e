//! Backends of text to speech: espeak-ng, flite, none.
//!
//! Programs get their text through a pipe or file, never as an argument, and as plain text.

use std::ffi::{OsStr, OsString};
use std::time::Duration;

use crate::audio::wav::read_wav;
use crate::audio::{Recording, SPEECH_RATE};
use crate::child_process::{Limits, Program};
use crate::error::SpeechError;
use crate::recognizer::Synthesizer;

/// Longest text that is spoken at once, in bytes.
pub const MAX_TEXT: usize = 4_000;

/// Longest sound of a text.
const LONGEST: Duration = Duration::from_secs(300);

/// Most characters of a voice's name.
pub const MAX_VOICE: usize = 40;

/// Speed of espeak-ng in words a minute.
pub const WORDS_PER_MINUTE: std::ops::RangeInclusive<u32> = 80..=400;

/// espeak-ng as a child process.
#[derive(Debug, Clone)]
pub struct Espeak {
    program: Program,
    voice: String,
    words_per_minute: u32,
}

impl Espeak {
    /// Finds espeak-ng on a search path. Voices are named as by `espeak-ng --voices`, such as `en-us`. The program takes its
    /// default voice for an unknown name.
    ///
    /// # Errors
    /// [`SpeechError::Missing`], or a voice or speed that cannot be one.
    pub fn find(path: Option<&OsStr>, voice: &str, words_per_minute: u32) -> Result<Self, SpeechError> {
        check_voice(voice)?;
        if !WORDS_PER_MINUTE.contains(&words_per_minute) {
            let (least, most) = (WORDS_PER_MINUTE.start(), WORDS_PER_MINUTE.end());
            let problem = format!("{words_per_minute} words a minute cannot be spoken; take {least} to {most}");
            return Err(SpeechError::Limit(problem));
        }
        let program = Program::find("espeak-ng", "espeak-ng", path)?;
        Ok(Self { program, voice: voice.to_owned(), words_per_minute })
    }
}

impl Synthesizer for Espeak {
    fn name(&self) -> &'static str {
        "espeak"
    }

    fn synthesize(&self, sentence: &str, limits: &Limits) -> Result<Recording, SpeechError> {
        let Some(text) = plain_text(sentence)? else { return Ok(silence()) };
        let mut arguments: Vec<OsString> = vec!["-v".into(), self.voice.clone().into(), "-s".into()];
        arguments.extend([self.words_per_minute.to_string().into(), "-b".into(), "1".into(), "--stdin".into()]);
        let folder = temporary_folder()?;
        let sound = folder.path().join("sound.wav");
        arguments.extend(["-w".into(), sound.clone().into()]);
        self.program.run(&arguments, text.as_bytes(), 1 << 16, limits)?;
        spoken(&self.program, &sound)
    }
}

/// flite as a child process.
#[derive(Debug, Clone)]
pub struct Flite {
    program: Program,
    voice: String,
}

impl Flite {
    /// Finds flite on a search path. Voices are named as by `flite -lv`, such as `slt`. The program takes its default voice
    /// for an unknown name.
    ///
    /// # Errors
    /// [`SpeechError::Missing`], or a voice that cannot be one.
    pub fn find(path: Option<&OsStr>, voice: &str) -> Result<Self, SpeechError> {
        check_voice(voice)?;
        Ok(Self { program: Program::find("flite", "flite", path)?, voice: voice.to_owned() })
    }
}

impl Synthesizer for Flite {
    fn name(&self) -> &'static str {
        "flite"
    }

    fn synthesize(&self, sentence: &str, limits: &Limits) -> Result<Recording, SpeechError> {
        let Some(text) = plain_text(sentence)? else { return Ok(silence()) };
        let folder = temporary_folder()?;
        let (words, sound) = (folder.path().join("words.txt"), folder.path().join("sound.wav"));
        std::fs::write(&words, text).map_err(|error| SpeechError::File(format!("{}: {error}", words.display())))?;
        let mut arguments: Vec<OsString> = vec!["-voice".into(), self.voice.clone().into(), "-f".into(), words.into()];
        arguments.extend(["-o".into(), sound.clone().into()]);
        self.program.run(&arguments, &[], 1 << 16, limits)?;
        spoken(&self.program, &sound)
    }
}

/// No speech: replies are text alone.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Synthesizer for Silent {
    fn name(&self) -> &'static str {
        "none"
    }

    fn synthesize(&self, _: &str, _: &Limits) -> Result<Recording, SpeechError> {
        Ok(silence())
    }
}

fn silence() -> Recording {
    Recording { rate: SPEECH_RATE, samples: Vec::new() }
}

fn temporary_folder() -> Result<tempfile::TempDir, SpeechError> {
    tempfile::tempdir().map_err(|error| SpeechError::File(format!("temporary folder: {error}")))
}

fn spoken(program: &Program, sound: &std::path::Path) -> Result<Recording, SpeechError> {
    if !sound.exists() {
        let problem = "it wrote no sound; does it have the voice?".to_owned();
        return Err(SpeechError::Failed { program: program.name().into(), problem });
    }
    Ok(read_wav(sound, LONGEST)?)
}

/// Whether a text may be the name of a program's voice. It is an argument and may be a path for some programs, so it is a plain
/// name of at most [`MAX_VOICE`] characters.
#[must_use]
pub fn is_voice_name(voice: &str) -> bool {
    let fits = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '+');
    let is_name = voice.starts_with(|c: char| c.is_ascii_alphanumeric()) && voice.chars().all(fits);
    is_name && voice.len() <= MAX_VOICE
}

fn check_voice(voice: &str) -> Result<(), SpeechError> {
    if is_voice_name(voice) {
        return Ok(());
    }
    let voice: String = sg_input::printable(voice).chars().take(MAX_VOICE).collect();
    Err(SpeechError::Limit(format!("“{voice}” is no name of a voice; take letters, digits, “-”, “_” and “+”")))
}

/// Whether a text has anything to say.
///
/// # Errors
/// [`SpeechError::Limit`]: it is longer than [`MAX_TEXT`] bytes.
pub fn has_words(text: &str) -> Result<bool, SpeechError> {
    if text.len() > MAX_TEXT {
        let problem = format!("a text of {} bytes is longer than the limit of {MAX_TEXT}; split it", text.len());
        return Err(SpeechError::Limit(problem));
    }
    Ok(text.chars().any(char::is_alphanumeric))
}

/// The text without what a program would interpret; `None` without anything to say.
fn plain_text(sentence: &str) -> Result<Option<String>, SpeechError> {
    if !has_words(sentence)? {
        return Ok(None);
    }
    // espeak-ng reads "[[…]]" as phonemes. Angle brackets are markup to some programs, and no sound to anybody.
    let plain = |c: char| match c {
        '[' | ']' | '<' | '>' => ' ',
        c if c.is_control() => ' ',
        c => c,
    };
    Ok(Some(sentence.chars().map(plain).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_names_are_voices_and_only_text_is_spoken() {
        for good in ["en-us", "slt", "en-us+f3", "mb_en1"] {
            assert!(check_voice(good).is_ok(), "{good}");
        }
        for bad in ["", "-w", "../voice", "a b", "http://x", "a\n"] {
            assert!(check_voice(bad).is_err(), "{bad}");
        }
        assert_eq!(plain_text("<b>[[hello]]</b>\n").unwrap().as_deref(), Some(" b   hello   /b  "));
        assert_eq!(plain_text("…").unwrap(), None);
        assert!(plain_text(&"x".repeat(MAX_TEXT + 1)).is_err());
        assert!(Espeak::find(std::env::var_os("PATH").as_deref(), "en-us", 5_000).is_err());
    }

    #[test]
    fn none_is_silent() {
        let none: &dyn Synthesizer = &Silent;
        assert_eq!(none.name(), "none");
        assert_eq!(none.synthesize("hello", &Limits::within(Duration::ZERO)).unwrap().samples, []);
    }
}
