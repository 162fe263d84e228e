//! Sentence encoders that are graphs of ONNX.

use std::num::NonZeroUsize;
use std::path::Path;

use candle_core::{Device, Tensor};
use sg_input::file;

use crate::batches::{embeddings, encode_by_length, rows};
use crate::embedding::Embedding;
use crate::encoder::TextEncoder;
use crate::error::EncoderError;
use crate::onnx_graph::{Filling, Graph, Port};
use crate::onnx_runtime::OnnxRuntime;
use crate::sentence_config::{Pooling, SentenceConfig};
use crate::tokens::TextTokens;

/// Places of the graph in a folder.
const GRAPHS: [&str; 2] = ["onnx/model.onnx", "model.onnx"];
/// The output that is pooled already. Others have a row for each token.
const POOLED: &str = "sentence_embedding";

/// A sentence encoder, run by ONNX Runtime. It gives the embeddings of [`SentenceEncoder`](crate::SentenceEncoder).
pub struct OnnxSentenceEncoder {
    graph: Graph,
    tokens: TextTokens,
    pooling: Pooling,
    context: usize,
    width: usize,
}

impl OnnxSentenceEncoder {
    /// Opens the model in a folder: configurations and `tokenizer.json` as for [`SentenceEncoder`](crate::SentenceEncoder), and
    /// `onnx/model.onnx` or `model.onnx` in f32 with a free batch size. Its `last_hidden_state` or `token_embeddings` is pooled
    /// as `1_Pooling/config.json` says. A graph without either has `sentence_embedding`.
    ///
    /// # Errors
    /// [`EncoderError`] with the file, the name in it and the remedy.
    pub fn open(folder: &Path, runtime: &OnnxRuntime, threads: NonZeroUsize) -> Result<Self, EncoderError> {
        let config = SentenceConfig::read(folder)?;
        let (width, context) = (config.transformer.width, config.context);
        let [usual, other] = GRAPHS.map(|name| folder.join(name));
        let path = if file::open(&usual).is_err() && file::open(&other).is_ok() { other } else { usual };
        let of_tokens = ["last_hidden_state", "token_embeddings"].map(|name| Port::floats(name, &[context, width]));
        let outputs = of_tokens.into_iter().chain([Port::floats(POOLED, &[width])]).collect();
        let graph = Graph::of_texts(&path, runtime, threads, context, outputs)?;
        Ok(Self { graph, tokens: config.tokens, pooling: config.pooling, context, width })
    }

    /// Whether a folder has a graph.
    #[must_use]
    pub fn is_in(folder: &Path) -> bool {
        GRAPHS.iter().any(|name| file::open(&folder.join(name)).is_ok())
    }

    fn encode_tokens(&self, texts: &[Vec<u32>]) -> Result<Vec<Embedding>, EncoderError> {
        let lengths: Vec<usize> = texts.iter().map(Vec::len).collect();
        let longest = lengths.iter().copied().max().unwrap_or_default();
        let length = if self.graph.has_fixed_length() { self.context } else { longest };
        let filling = Filling { length, token: 0, is_seen: false };
        if self.graph.output() == POOLED {
            return rows(&self.graph.run_texts(texts, filling, &[self.width])?, self.width);
        }
        let outputs = self.graph.run_texts(texts, filling, &[length, self.width])?;
        let outputs = Tensor::from_vec(outputs, (texts.len() * length, self.width), &Device::Cpu)?;
        embeddings(&self.pooling.apply(&outputs, &lengths, length)?)
    }
}

impl TextEncoder for OnnxSentenceEncoder {
    fn encode_texts(&self, texts: &[&str]) -> Result<Vec<Embedding>, EncoderError> {
        encode_by_length(self.tokens.encode(texts)?, |batch| self.encode_tokens(batch))
    }

    fn dimension(&self) -> usize {
        self.width
    }
}
