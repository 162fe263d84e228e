//! Which unit a text means, without a neural network: views, attributes, words.
#![cfg_attr(test, allow(clippy::unwrap_used, reason = "a test fails by panicking"))]

pub mod attributes;
pub mod entropy;
pub mod frame;
pub mod lexical;
pub mod meaning;
pub mod pictures;
pub mod proposals;
pub mod query;
pub mod region;
pub mod relation;
pub mod retrieval;
pub mod text;
mod usage;
pub mod views;
pub mod wordnet;
