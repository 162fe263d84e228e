//! Commands and their slots in sentences of people's own words, learned from examples.
//!
//! An example is a sentence with its slots in braces, and the command that it means: "dip {thing} in {color}" means "make {thing}
//! {color}". [`Model::train`] learns two things from many of them:
//!
//! - **The command**, by multinomial logistic regression over words, pairs and triples of words, and parts of words. Weights are
//!   learned by AdaGrad (J. Duchi, E. Hazan, Y. Singer, "Adaptive Subgradient Methods for Online Learning and Stochastic Optimization",
//!   JMLR 12, 2011, figure 1).
//! - **The slots of its words**, by a linear chain whose weights an averaged perceptron learns (M. Collins, "Discriminative Training
//!   Methods for Hidden Markov Models: Theory and Experiments with Perceptron Algorithms", EMNLP 2002, figure 1). The best chain is found
//!   by Viterbi's algorithm among the slots of the command.
//!
//! Names of the scene, colours and numbers count as one word each, so that a sentence about a sac teaches the one about a leaf. Commands
//! of [`Examples`] without a slot, in capitals, are sentences that ask for nothing.
//!
//! Training is deterministic: a fixed seed chooses the values that fill the slots.

mod chain;
mod classifier;
mod encoding;
mod examples;
mod model;
mod table;
mod words;

pub use encoding::ModelError;
pub use examples::{ExampleError, Examples, Slot, Spoken};
pub use model::{Model, Reading};
