//! Ids of phonemes for a text, by espeak-ng as a child process or by the text's own characters.
//!
//! espeak-ng gets its text through a pipe, as plain text. It is started with a deadline and ends with this process.

use std::ffi::OsStr;

use icu_normalizer::DecomposingNormalizerBorrowed;
use sg_speech::child_process::{Limits, Program};
use sg_speech::synthesis::{MAX_VOICE, is_voice_name};

use crate::clauses::{Clause, clauses};
use crate::config::{Config, MAX_SYMBOL, PhonemeType};
use crate::error::PiperError;

/// Most bytes of phonemes for a text.
const MAX_PHONEMES: usize = 1 << 18;
/// Most clauses that get a process each.
const MAX_CLAUSES: usize = 64;

/// Ids of one sentence.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct SentenceIds {
    pub(crate) ids: Vec<u32>,
    /// Phonemes that the voice does not know.
    pub(crate) unknown: usize,
}

/// Makes phonemes of texts.
pub(crate) enum Phonemizer {
    Espeak { program: Program, voice: String },
    Text,
}

impl Phonemizer {
    pub(crate) fn find(config: &Config, search_path: Option<&OsStr>) -> Result<Self, PiperError> {
        if config.phoneme_type == PhonemeType::Text {
            return Ok(Self::Text);
        }
        let voice = &config.espeak_voice;
        if !is_voice_name(voice) {
            let voice: String = sg_input::printable(voice).chars().take(MAX_VOICE).collect();
            let problem = format!("`{voice}` is no name of a voice of espeak-ng, such as `en-us`");
            return Err(sg_layers::ModelError::config(&config.path, "espeak.voice", problem).into());
        }
        let program = Program::find("espeak-ng", "espeak-ng", search_path)?;
        Ok(Self::Espeak { program, voice: voice.clone() })
    }

    /// The phonemes of each sentence of a text, decomposed (Unicode's NFD) as voices have learnt them.
    pub(crate) fn sentences(&self, text: &str, limits: &Limits) -> Result<Vec<String>, PiperError> {
        let decomposed = |text: &str| DecomposingNormalizerBorrowed::new_nfd().normalize(text).into_owned();
        // Voices of characters have learnt small letters.
        let Self::Espeak { program, voice } = self else { return Ok(vec![decomposed(&text.to_lowercase())]) };
        let clauses = clauses(text);
        let phonemes = phonemes(program, voice, &clauses, limits)?;
        let (mut sentences, mut sentence) = (Vec::new(), String::new());
        for (clause, phonemes) in clauses.iter().zip(phonemes) {
            sentence.push_str(&decomposed(&phonemes));
            sentence.extend(clause.sign);
            if clause.ends_sentence() {
                sentences.push(std::mem::take(&mut sentence));
            } else if clause.sign.is_some() {
                sentence.push(' ');
            }
        }
        if !sentence.is_empty() {
            sentences.push(sentence);
        }
        Ok(sentences)
    }
}

/// The phonemes of each clause.
fn phonemes(program: &Program, voice: &str, clauses: &[Clause], limits: &Limits) -> Result<Vec<String>, PiperError> {
    if clauses.is_empty() {
        return Ok(Vec::new());
    }
    let run = |text: &str| -> Result<Vec<String>, PiperError> {
        let arguments = ["-v", voice, "-b", "1", "-q", "--ipa", "--stdin"].map(Into::into);
        let output = program.run(&arguments, text.as_bytes(), MAX_PHONEMES, limits)?;
        let output = String::from_utf8_lossy(&output);
        let lines = output.lines().map(|line| without_flags(line.trim()));
        Ok(lines.filter(|line| !line.is_empty()).collect())
    };
    let spelled = |clause: &Clause| format!("{}{}", clause.text, clause.sign.map(String::from).unwrap_or_default());
    // Each clause is a paragraph, which gives it a line of its own, or several where the program sees more clauses.
    let all: Vec<String> = clauses.iter().map(spelled).collect();
    let lines = run(&all.join("\n\n"))?;
    if lines.len() == clauses.len() {
        return Ok(lines);
    }
    if clauses.len() > MAX_CLAUSES {
        let problem =
            format!("a text of {} clauses is longer than the limit of {MAX_CLAUSES}; split it", clauses.len());
        return Err(PiperError::Limit(problem));
    }
    all.iter().map(|clause| run(clause).map(|lines| lines.join(" "))).collect()
}

/// Phonemes without what marks a switch of language, such as "(en)".
fn without_flags(line: &str) -> String {
    let mut plain = String::new();
    let mut rest = line;
    while let Some((before, flag)) = rest.split_once('(') {
        plain.push_str(before);
        rest = flag.split_once(')').map_or("", |(_, behind)| behind);
    }
    plain.push_str(rest);
    plain
}

/// The ids of a sentence: `^`, each phoneme, `$`, with `_` behind each of them except the last.
pub(crate) fn ids_of(sentence: &str, config: &Config) -> SentenceIds {
    let ids_of = |symbol: &str| config.ids.get(symbol).map(Vec::as_slice);
    let mark = |symbol: &str| ids_of(symbol).unwrap_or_default();
    let mut found = SentenceIds { ids: [mark("^"), mark("_")].concat(), unknown: 0 };
    let mut rest = sentence;
    while !rest.is_empty() {
        // The longest symbol that fits: some voices have diphthongs as one.
        let ends = rest.char_indices().map(|(at, c)| at + c.len_utf8()).take(MAX_SYMBOL);
        let symbols: Vec<&str> = ends.map(|end| &rest[..end]).collect();
        let known = |symbol: &&&str| config.ids.contains_key(**symbol) || config.replaced.contains_key(**symbol);
        let symbol = symbols.iter().rfind(known).or(symbols.first()).copied().unwrap_or(rest);
        rest = &rest[symbol.len()..];
        let replaced = config.replaced.get(symbol);
        let symbols = replaced.map_or_else(|| vec![symbol], |others| others.iter().map(String::as_str).collect());
        for symbol in symbols {
            match ids_of(symbol) {
                Some(ids) => found.ids.extend([ids, mark("_")].concat()),
                None => found.unknown += 1,
            }
        }
    }
    found.ids.extend(mark("$"));
    found
}
