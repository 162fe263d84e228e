//! Layers that our neural networks share, and the files that they come from.
//!
//! [`Weights`] reads tensors by name and shape, from safetensors files or through another [`TensorReader`]. It never takes memory that
//! the configuration doesn't ask for. [`Matrix`] keeps a layer's weights in f32, f16 or int8. Nothing is downloaded.

mod activation;
mod attention;
mod config;
mod error;
mod layers;
mod matrix;
mod safetensors;
mod tensor;
mod weights;

pub use activation::Activation;
pub use attention::{Batch, Hidden, SelfAttention, attend, split_heads};
pub use config::{MAX_CONTEXT, MAX_INNER, MAX_LAYERS, MAX_VOCABULARY, MAX_WIDTH, read_json, within};
pub use error::ModelError;
pub use layers::{LayerNorm, Linear, Perceptron};
pub use matrix::{Matrix, Precision};
pub use tensor::{Kind, StoredType, TensorReader, to_f32};
pub use weights::Weights;
