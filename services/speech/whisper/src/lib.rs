//! Speech to text by Whisper (Radford et al. 2022) on processor cores.
//!
//! A model is a folder on this machine, in Hugging Face's layout or CTranslate2's. Nothing is downloaded. [`Whisper::listen`] hears a
//! sound once; [`Whisper::transcribe`] gives its text, [`Whisper::score`] the likelihood of each sentence of a list, and
//! [`Whisper::recognize`] the likeliest sentence if it is nearly as likely as free text.

mod config;
mod ctranslate2;
mod decoder;
mod encoder;
mod error;
mod free_decoding;
mod layout;
mod model;
mod options;
mod phrase_scoring;
mod phrases;
mod probability;
mod recognition;
mod recognizer;
mod rules;
mod spectrogram;
mod spelling;
mod start;
mod vocabulary;

#[cfg(test)]
mod decoding_tests;
#[cfg(test)]
mod hostile_tests;
#[cfg(test)]
mod parity_tests;

pub use error::WhisperError;
pub use free_decoding::{OtherText, Segment, Transcript};
pub use model::{AudioContext, Hearing, Whisper};
pub use options::{MAX_BEAMS, MAX_TOKENS, Options};
pub use phrase_scoring::{PhraseScore, PhraseSearch, TOKEN_BONUS};
pub use phrases::{MAX_SENTENCE_TOKENS, MAX_SENTENCES, Phrases};
pub use recognition::{Acceptance, Candidate, Recognition, Source};
pub use recognizer::{RecognizerSettings, WhisperRecognizer};
pub use sg_layers::Precision;
pub use spectrogram::{MelFilters, SAMPLE_RATE, Spectrogram};
pub use spelling::normalized;
