//! What all recognizers and synthesizers have in common.

use std::time::Duration;

use crate::audio::Recording;
use crate::child_process::Limits;
use crate::error::SpeechError;
use crate::phrases::PhraseGrammar;
use crate::vad::voiced;

/// Longest utterance that a recognizer takes.
pub const MAX_UTTERANCE: Duration = Duration::from_secs(60);

/// Shortest voice that a recognizer looks at. Less is a click or a breath.
const SHORTEST_VOICE: Duration = Duration::from_millis(96);

/// Whether samples of 16 kHz hold enough voice for a recognizer to look at them.
#[must_use]
pub fn has_voice(samples: &[f32]) -> bool {
    voiced(samples) >= SHORTEST_VOICE
}

/// A part of the text with its place in the utterance: a word, or words between two pauses.
#[derive(Debug, Clone, PartialEq)]
pub struct TimedText {
    /// As it is said.
    pub text: String,
    /// Its begin.
    pub start: Duration,
    /// Its end.
    pub end: Duration,
}

/// Another text that the utterance may be.
#[derive(Debug, Clone, PartialEq)]
pub struct Alternative {
    /// As it is written.
    pub text: String,
    /// Log-likelihood beside the best one; its scale depends on the recognizer. Above 0 for a text that is likelier than the expected
    /// sentence that was accepted.
    pub score: f32,
}

/// What was recognised.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Recognition {
    /// As it is written. Empty if nothing was heard.
    pub text: String,
    /// Probability that the text is what was said, 0 to 1, as calibrated.
    pub confidence: f32,
    /// Whether the confidence suffices to act. A text that does not is shown, not obeyed.
    pub accepted: bool,
    /// Other texts, the likeliest first, without the best one. Empty where a recognizer gives none, as sphinx.
    pub alternatives: Vec<Alternative>,
    /// Parts of the best text with their times. Empty where a recognizer gives none.
    pub parts: Vec<TimedText>,
    /// Time that the recognizer took.
    pub elapsed: Duration,
}

impl Recognition {
    /// The same sound as another text, whose only part is the whole.
    #[must_use]
    pub fn with_text(self, text: String) -> Self {
        let ends = self.parts.first().zip(self.parts.last()).map(|(first, last)| (first.start, last.end));
        let parts = ends.map(|(start, end)| TimedText { text: text.clone(), start, end });
        Self { text, parts: parts.into_iter().collect(), ..self }
    }
}

/// Turns an utterance into text.
pub trait Recognizer: Send {
    /// Its name, such as "sphinx".
    fn name(&self) -> &'static str;

    /// Takes in the sentences that are expected, before somebody speaks. Returns a line about names that cannot be recognised, if
    /// there are any. A recognition does this by itself; doing it before saves its time.
    ///
    /// # Errors
    /// [`SpeechError`].
    fn prepare(&mut self, _phrases: &PhraseGrammar, _limits: &Limits) -> Result<Option<String>, SpeechError> {
        Ok(None)
    }

    /// Recognises an utterance of 16 kHz samples. `phrases` are the sentences that are expected; what a recognizer makes of
    /// them is its own: a grammar, a bias, or nothing.
    ///
    /// # Errors
    /// [`SpeechError`].
    fn recognize(
        &mut self,
        samples: &[f32],
        phrases: &PhraseGrammar,
        limits: &Limits,
    ) -> Result<Recognition, SpeechError>;
}

/// Turns text into sound.
pub trait Synthesizer: Send + Sync {
    /// Its name, such as "espeak".
    fn name(&self) -> &'static str;

    /// Speaks one sentence. A text without words gives no samples.
    ///
    /// # Errors
    /// [`SpeechError`].
    fn synthesize(&self, sentence: &str, limits: &Limits) -> Result<Recording, SpeechError>;
}
