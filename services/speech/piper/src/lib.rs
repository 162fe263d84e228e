//! Text to speech by the voices of Piper on processor cores.
//!
//! A voice is two files on this machine, `NAME.onnx` and `NAME.onnx.json`. Nothing is downloaded. [`Piper::open`] takes the weights
//! out of the first one. The network is that of VITS (Kim, Kong and Son 2021, arXiv:2106.06103), written out here.
//!
//! Piper's own exporter made the voices that are supported. They have any size (`x_low`, `low`, `medium`, `high`), and one speaker or
//! several. espeak-ng gives the phonemes, as a child process.

mod clauses;
mod config;
mod convolution;
mod decoder;
mod durations;
mod error;
mod flow;
mod frames;
mod network;
mod noise;
mod onnx;
mod phonemes;
mod piper;
mod protobuf;
mod spline;
mod text_encoder;
mod weights;

#[cfg(test)]
mod convolution_tests;
#[cfg(test)]
mod hostile_tests;
#[cfg(test)]
mod made_voice;
#[cfg(test)]
mod parity_tests;
#[cfg(test)]
mod speaking_tests;

pub use error::PiperError;
pub use piper::{LONGEST, Piper, SPEEDS};
