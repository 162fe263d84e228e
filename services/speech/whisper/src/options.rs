//! How a sound is decoded.

/// Most tokens of a transcript: half of the published models' context.
pub const MAX_TOKENS: usize = 224;
/// Most beams.
pub const MAX_BEAMS: usize = 16;

/// How a sound becomes text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Options {
    /// Code of the spoken language, such as `en`. A multilingual model finds it out without one. A model of English knows no other.
    pub language: Option<String>,
    /// Whether the transcript has times.
    pub timestamps: bool,
    /// Hypotheses that are kept: 1 is greedy decoding. At most [`MAX_BEAMS`].
    pub beams: usize,
    /// Most tokens of the transcript, at most [`MAX_TOKENS`].
    pub most_tokens: usize,
    /// Text before the sound, such as names that may come. What exceeds half of the model's context is cut at its start.
    pub prompt: Option<String>,
    /// Whether tokens that the model's files suppress, such as those of brackets, are barred.
    pub suppress: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self { language: None, timestamps: false, beams: 1, most_tokens: MAX_TOKENS, prompt: None, suppress: true }
    }
}
