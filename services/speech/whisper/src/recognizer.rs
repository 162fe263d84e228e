//! Whisper as one of the recognizers of `sg-speech`.

use std::time::{Duration, Instant};

use sg_speech::child_process::Limits;
use sg_speech::error::SpeechError;
use sg_speech::phrases::PhraseGrammar;
use sg_speech::recognizer::{self, Alternative, Recognizer, TimedText, has_voice};

use crate::error::WhisperError;
use crate::model::{AudioContext, Hearing, Whisper};
use crate::options::Options;
use crate::phrase_scoring::PhraseSearch;
use crate::phrases::Phrases;
use crate::recognition::{Acceptance, Source};
use crate::spelling::normalized;

/// Name of this recognizer.
const NAME: &str = "whisper";

/// Most sentences that the decoder knows. More would take longer to tell apart than a person waits.
const MAX_KNOWN: usize = 8_000;

/// Most names in the prompt.
const MAX_PROMPT_NAMES: usize = 24;

/// How the recognizer hears.
#[derive(Clone, Debug, PartialEq)]
pub struct RecognizerSettings {
    /// How much the encoder looks at.
    pub context: AudioContext,
    /// When a sentence of the grammar is taken for what was said.
    pub acceptance: Acceptance,
    /// Code of the spoken language; without one a multilingual model finds it out.
    pub language: Option<String>,
    /// Slot of the grammar whose values stand in the prompt, so that free text spells them well.
    pub prompt_slot: String,
    /// Texts that are followed where nobody expects them, from 1 to [`MAX_BEAMS`](crate::options::MAX_BEAMS). Those beside the best
    /// one are alternatives.
    pub beams: usize,
    /// Whether parts of the text have times. They take a further decoding.
    pub times: bool,
}

impl Default for RecognizerSettings {
    fn default() -> Self {
        Self {
            // 10 s: commands are shorter, and the time of the encoder grows with it.
            context: AudioContext::Frames(500),
            acceptance: Acceptance::default(),
            language: None,
            prompt_slot: "unit".to_owned(),
            beams: 4,
            times: false,
        }
    }
}

/// Whisper with a grammar. The likeliest sentence of the grammar is accepted if it is nearly as likely as free text. Else the free
/// text is returned, not accepted.
pub struct WhisperRecognizer {
    model: Whisper,
    settings: RecognizerSettings,
    prepared: Option<(PhraseGrammar, Option<Phrases>)>,
}

impl WhisperRecognizer {
    /// A recognizer with a model.
    #[must_use]
    pub fn new(model: Whisper, settings: RecognizerSettings) -> Self {
        Self { model, settings, prepared: None }
    }

    /// Makes the tree of the grammar's sentences, if the grammar is a new one, and returns the number of sentences. A recognition
    /// does this by itself; doing it before saves its time.
    ///
    /// # Errors
    /// [`SpeechError::Limit`]: a sentence that is too long for the model.
    pub fn prepare_sentences(&mut self, grammar: &PhraseGrammar) -> Result<usize, SpeechError> {
        if self.prepared.as_ref().is_none_or(|(known, _)| known != grammar) {
            let sentences: Vec<String> =
                grammar.balanced_sentences(MAX_KNOWN).into_iter().map(|sentence| sentence.written).collect();
            let phrases =
                if sentences.is_empty() { None } else { Some(self.model.phrases(&sentences).map_err(fault)?) };
            self.prepared = Some((grammar.clone(), phrases));
        }
        let phrases = self.prepared.as_ref().and_then(|(_, phrases)| phrases.as_ref());
        Ok(phrases.map_or(0, |phrases| phrases.sentences().len()))
    }

    /// When the parts of a text were said, by a decoding with times. Where that reads otherwise, the text is one part.
    fn parts(
        &self,
        hearing: &Hearing,
        text: &str,
        grammar: &PhraseGrammar,
        limits: &Limits,
    ) -> Result<Vec<TimedText>, SpeechError> {
        if !self.settings.times || text.is_empty() {
            return Ok(Vec::new());
        }
        let options = Options { timestamps: true, beams: 1, ..self.options(grammar) };
        let segments = self.model.transcribe(hearing, &options, &limits.cancel).map_err(fault)?.segments;
        let time = |seconds: f32| Duration::from_secs_f32(seconds.clamp(0.0, hearing.seconds));
        // A text without an end goes on to the end of the sound.
        let parts: Vec<TimedText> = segments
            .into_iter()
            .map(|s| TimedText { text: s.text, start: time(s.from), end: time(s.to.unwrap_or(hearing.seconds)) })
            .collect();
        let spoken: Vec<&str> = parts.iter().map(|part| part.text.as_str()).collect();
        let is_same = normalized(&spoken.join(" ")) == normalized(text);
        let timed = recognizer::Recognition { parts, ..recognizer::Recognition::default() };
        Ok(if is_same { timed.parts } else { timed.with_text(text.to_owned()).parts })
    }

    fn options(&self, grammar: &PhraseGrammar) -> Options {
        let names: Vec<&str> = grammar.slot(&self.settings.prompt_slot).take(MAX_PROMPT_NAMES).collect();
        let prompt = (!names.is_empty()).then(|| format!("{}.", names.join(", ")));
        Options { prompt, language: self.settings.language.clone(), beams: self.settings.beams, ..Options::default() }
    }
}

impl Recognizer for WhisperRecognizer {
    fn name(&self) -> &'static str {
        NAME
    }

    fn prepare(&mut self, grammar: &PhraseGrammar, _: &Limits) -> Result<Option<String>, SpeechError> {
        self.prepare_sentences(grammar)?;
        Ok(None)
    }

    fn recognize(
        &mut self,
        samples: &[f32],
        grammar: &PhraseGrammar,
        limits: &Limits,
    ) -> Result<recognizer::Recognition, SpeechError> {
        let began = Instant::now();
        if !has_voice(samples) {
            return Ok(recognizer::Recognition::default());
        }
        self.prepare_sentences(grammar)?;
        let options = self.options(grammar);
        let hearing = self.model.listen(samples, self.settings.context, &limits.cancel).map_err(fault)?;
        let phrases = self.prepared.as_ref().and_then(|(_, phrases)| phrases.as_ref());
        let Some(phrases) = phrases else {
            let free = self.model.transcribe(&hearing, &options, &limits.cancel).map_err(fault)?;
            let text = unrepeated(&free.text);
            return Ok(recognizer::Recognition {
                confidence: free.average_log_probability.exp().clamp(0.0, 1.0),
                parts: self.parts(&hearing, &text, grammar, limits)?,
                text,
                elapsed: began.elapsed(),
                ..recognizer::Recognition::default()
            });
        };
        let acceptance = self.settings.acceptance;
        let found = self
            .model
            .recognize(&hearing, phrases, PhraseSearch::default(), acceptance, &options, &limits.cancel)
            .map_err(fault)?;
        let accepted = found.source != Source::Free;
        let expected = found.best.filter(|_| !accepted).and_then(|best| {
            Some(Alternative { text: phrases.sentences().get(best.sentence)?.clone(), score: best.ratio.min(0.0) })
        });
        // The ratio of an accepted sentence is that to the best free text.
        let lead = found.best.filter(|_| accepted).map_or(0.0, |best| -best.ratio);
        let free = found.free.others.iter().map(|other| Alternative {
            text: unrepeated(&other.text),
            score: lead + (other.log_probability - found.free.log_probability).min(0.0),
        });
        let best_free = accepted.then(|| Alternative { text: unrepeated(&found.free.text), score: lead });
        let mut alternatives: Vec<Alternative> = best_free.into_iter().chain(free).chain(expected).collect();
        alternatives.sort_by(|a, b| b.score.total_cmp(&a.score));
        let mean = match (found.best, found.source) {
            (Some(best), Source::Command(at)) => {
                best.log_probability / phrases.lengths.get(at).copied().unwrap_or(1).max(1) as f32
            }
            _ => found.free.average_log_probability,
        };
        let text = if accepted { found.text } else { unrepeated(&found.text) };
        Ok(recognizer::Recognition {
            parts: self.parts(&hearing, &text, grammar, limits)?,
            text,
            // The geometric mean of the tokens' probabilities.
            confidence: mean.exp().clamp(0.0, 1.0),
            accepted,
            alternatives,
            elapsed: began.elapsed(),
        })
    }
}

/// The text without its repetitions: a model that looks at less sound than in training may say a sentence again and again.
fn unrepeated(text: &str) -> String {
    let words: Vec<&str> = text.split_whitespace().collect();
    // The copies of a sentence may differ in their signs.
    let plain: Vec<String> = words.iter().map(|word| normalized(word)).collect();
    let is_period = |period: &usize| {
        let repeats = || plain.chunks(*period).all(|chunk| plain.starts_with(chunk));
        // Two equal words, as in "no no", may be what was said.
        *period >= 2 && words.len().is_multiple_of(*period) && repeats()
    };
    let period = (1..=words.len() / 2).find(is_period).unwrap_or(words.len());
    words[..period].join(" ").trim_end_matches([',', ';']).to_owned()
}

fn fault(error: WhisperError) -> SpeechError {
    match error {
        WhisperError::Cancelled => SpeechError::Cancelled,
        WhisperError::Sound(problem) => SpeechError::Limit(format!("the utterance cannot be recognised: {problem}")),
        other => SpeechError::Failed { program: NAME.to_owned(), problem: other.to_string() },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sentence_that_repeats_itself_is_said_once() {
        for (text, once) in [
            ("What a nice day. What a nice day.", "What a nice day."),
            ("Undo it. Undo it. Undo it.", "Undo it."),
            ("bone window, bone window.", "bone window"),
            ("Use a headlight, use a headlight,", "Use a headlight"),
            ("no no", "no no"),
            ("hide the sac and hide the bone", "hide the sac and hide the bone"),
            ("", ""),
        ] {
            assert_eq!(unrepeated(text), once);
        }
    }
}
