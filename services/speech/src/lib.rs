//! Speech to text and text to speech, without a process and without a bus.
//!
//! | module | content |
//! | --- | --- |
//! | [`audio`] | samples, WAV files, named pipes, resampling, level |
//! | [`vad`], [`endpoint`] | voice activity; where an utterance begins and ends |
//! | [`phrases`], [`spoken`] | sentences that are expected; words as they are said |
//! | [`recognizer`] | what all backends have in common |
//! | [`sphinx`] | recognizer with a grammar: `pocketsphinx` as a child process |
//! | [`synthesis`], [`sentences`], [`speaker`] | backends of text to speech; a reply sentence by sentence |
//! | [`conversation`] | idle, listening, thinking, speaking, muted: a state machine |
//! | [`accuracy`] | word error rate, commands right and false |
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::panic, reason = "a test fails by panicking"))]

pub mod accuracy;
pub mod audio;
pub mod child_process;
pub mod conversation;
pub mod endpoint;
pub mod error;
pub mod phrases;
pub mod recognizer;
pub mod sentences;
pub mod speaker;
pub mod sphinx;
pub mod spoken;
pub mod synthesis;
pub mod vad;

#[cfg(test)]
mod endpoint_tests;
