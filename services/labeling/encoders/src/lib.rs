//! Encoders of images and texts: CLIP, OpenCLIP and `SigLIP` for both, and BERT for sentences.
//!
//! A model is a folder on this machine, as Hugging Face and OpenCLIP lay it out. Nothing is downloaded. [`ImageTextModel`] and
//! [`SentenceEncoder`] open one and give [`Embedding`]s, whose cosines compare. [`fuse`] makes one embedding of an image's and
//! a text's.
//!
//! [`OnnxImageTextModel`] and [`OnnxSentenceEncoder`] run graphs of ONNX in place of weights, by a library that the user names
//! ([`OnnxRuntime`]).
//!
//! All towers are one pre- or post-norm transformer (`transformer`) with names of tensors by layout (`layout`). Tests compare
//! them with the published implementations, see `tests/fixtures/make.py`.

mod adapter;
mod batches;
mod config;
mod embedding;
mod encoder;
mod error;
mod fusion;
mod hugging_face;
mod image;
mod image_text;
mod layout;
mod logit;
mod onnx_graph;
mod onnx_image_text;
mod onnx_runtime;
mod onnx_sentence;
mod open_clip;
mod preprocess;
mod projection;
mod resample;
mod sentence;
mod sentence_config;
mod text;
mod tokens;
mod transformer;
mod vision;

#[cfg(test)]
mod hostile_tests;
#[cfg(test)]
mod onnx_tests;
#[cfg(test)]
mod parity_tests;

pub use adapter::{RIDGE, adapted};
pub use embedding::{Embedding, EmbeddingError};
pub use encoder::{ImageEncoder, ImageTextEncoder, TextEncoder};
pub use error::EncoderError;
pub use fusion::{Fusion, fuse};
pub use image::{Pixels, RgbImage};
pub use image_text::ImageTextModel;
pub use layout::Layout;
pub use onnx_image_text::OnnxImageTextModel;
pub use onnx_runtime::OnnxRuntime;
pub use onnx_sentence::OnnxSentenceEncoder;
pub use sentence::SentenceEncoder;
pub use sg_layers::{ModelError, Precision};
