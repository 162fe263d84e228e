//! Speech to text and text to speech, without a process and without a bus.
#![cfg_attr(test, allow(clippy::unwrap_used, reason = "a test fails by panicking"))]

pub mod audio;
pub mod endpoint;
pub mod vad;

#[cfg(test)]
mod endpoint_tests;
