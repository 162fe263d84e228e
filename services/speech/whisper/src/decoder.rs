//! Whisper's decoder, over a tree of tokens.
//!
//! Keys and values of each token are kept. A token attends to those before it on its way from the root. So one tree serves free
//! decoding, where it is a chain, beams, and sentences that share their beginnings.

use candle_core::{Device, Tensor};
use rayon::prelude::*;
use sg_layers::{Batch, LayerNorm, Linear, Matrix, ModelError, Perceptron, attend, split_heads};

use crate::config::ModelSize;
use crate::layout::{CrossAttention, LayerReader, Part};

struct Block {
    self_norm: LayerNorm,
    /// Queries, keys and values of all heads, in this order.
    query_key_value: Linear,
    self_output: Linear,
    cross_norm: LayerNorm,
    cross: CrossAttention,
    perceptron_norm: LayerNorm,
    perceptron: Perceptron,
}

pub(crate) struct Decoder {
    tokens: Matrix,
    positions: Matrix,
    blocks: Vec<Block>,
    last_norm: LayerNorm,
    width: usize,
    heads: usize,
}

/// Keys and values of a sound for each block, 1 × heads × frames × width of a head.
pub(crate) struct SoundKeys(Vec<[Tensor; 2]>);

/// A token's place in a tree.
pub(crate) type Node = usize;

/// A token to add to a tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Branch {
    /// The token before it; none for the first of all.
    pub(crate) parent: Option<Node>,
    pub(crate) token: u32,
}

/// Tokens that were decoded, with their keys and values in each block.
pub(crate) struct TokenTree {
    parents: Vec<Option<Node>>,
    depths: Vec<usize>,
    /// For each block, nodes × width.
    keys: Vec<Vec<f32>>,
    values: Vec<Vec<f32>>,
}

impl TokenTree {
    /// Number of nodes. The next one has this place.
    pub(crate) fn len(&self) -> usize {
        self.parents.len()
    }

    /// The nodes from the root to this one, itself included.
    fn path(&self, node: Node) -> Vec<Node> {
        let mut path: Vec<Node> = std::iter::successors(Some(node), |node| self.parents[*node]).collect();
        path.reverse();
        path
    }

    fn push(&mut self, branches: &[Branch]) {
        for branch in branches {
            self.depths.push(branch.parent.map_or(0, |parent| self.depths[parent] + 1));
            self.parents.push(branch.parent);
        }
    }
}

impl Decoder {
    pub(crate) fn read(reader: &mut LayerReader, size: &ModelSize) -> Result<Self, ModelError> {
        let tokens = reader.tokens(size.vocabulary)?;
        let positions = reader.positions(Part::Decoder, size.context)?;
        let mut blocks = Vec::with_capacity(size.decoder.layers);
        for at in 0..size.decoder.layers {
            let self_norm = reader.self_attention_norm(Part::Decoder, at)?;
            let [query_key_value, self_output] = reader.self_attention_layers(Part::Decoder, at)?;
            let (cross_norm, cross) = reader.cross_attention(at)?;
            let (perceptron_norm, perceptron) = reader.perceptron(Part::Decoder, at, size.decoder)?;
            blocks.push(Block {
                self_norm,
                query_key_value,
                self_output,
                cross_norm,
                cross,
                perceptron_norm,
                perceptron,
            });
        }
        Ok(Self {
            tokens,
            positions: Matrix::of_table(positions, size.context, size.width, reader.precision)?,
            blocks,
            last_norm: reader.last_norm(Part::Decoder)?,
            width: size.width,
            heads: size.decoder.heads,
        })
    }

    /// Number of tokens that there are.
    pub(crate) fn vocabulary(&self) -> usize {
        self.tokens.rows()
    }

    /// Most tokens on the way from the root to a token.
    pub(crate) fn context(&self) -> usize {
        self.positions.rows()
    }

    /// Keys and values of a sound's frames (frames × width).
    pub(crate) fn sound_keys(&self, frames: &Tensor) -> Result<SoundKeys, ModelError> {
        let batch = Batch { sequences: 1, length: frames.dim(0)? };
        let of_block = |block: &Block| -> Result<[Tensor; 2], ModelError> {
            let both = block.cross.key_value.apply(frames, None)?;
            let part = |at| split_heads(&both.narrow(1, at * self.width, self.width)?, batch, self.heads);
            Ok([part(0)?, part(1)?])
        };
        Ok(SoundKeys(self.blocks.iter().map(of_block).collect::<Result<_, _>>()?))
    }

    /// A tree without tokens.
    pub(crate) fn tree(&self) -> TokenTree {
        let empty = || vec![Vec::new(); self.blocks.len()];
        TokenTree { parents: Vec::new(), depths: Vec::new(), keys: empty(), values: empty() }
    }

    /// Adds tokens to a tree and gives their outputs (branches × width). A branch's parent may be one of those before it. The
    /// tree's way to each is at most [`Self::context`] long, and each token below [`Self::vocabulary`].
    pub(crate) fn advance(
        &self,
        sound: &SoundKeys,
        tree: &mut TokenTree,
        branches: &[Branch],
    ) -> Result<Tensor, ModelError> {
        let (first, count) = (tree.len(), branches.len());
        tree.push(branches);
        let paths: Vec<Vec<Node>> = (first..first + count).map(|node| tree.path(node)).collect();
        let ids: Vec<u32> = branches.iter().map(|branch| branch.token).collect();
        let places: Vec<u32> = tree.depths[first..].iter().map(|depth| *depth as u32).collect();
        let mut rows = (self.tokens.take(&ids)? + self.positions.take(&places)?)?;
        let own = Batch { sequences: 1, length: count };
        for (at, (block, [sound_keys, sound_values])) in self.blocks.iter().zip(&sound.0).enumerate() {
            let all = block.query_key_value.apply(&block.self_norm.apply(&rows)?, None)?;
            let all = all.flatten_all()?.to_vec1::<f32>()?;
            for row in all.chunks_exact(3 * self.width) {
                tree.keys[at].extend_from_slice(&row[self.width..2 * self.width]);
                tree.values[at].extend_from_slice(&row[2 * self.width..]);
            }
            let attended = self.attend_to_paths(&all, &paths, &tree.keys[at], &tree.values[at]);
            let attended = Tensor::from_vec(attended, (count, self.width), &Device::Cpu)?;
            rows = (&rows + block.self_output.apply(&attended, None)?)?;

            let queries = block.cross.query.apply(&block.cross_norm.apply(&rows)?, None)?;
            let attended = attend(&split_heads(&queries, own, self.heads)?, sound_keys, sound_values, None)?;
            rows = (&rows + block.cross.output.apply(&attended, None)?)?;

            rows = (&rows + block.perceptron.apply(&block.perceptron_norm.apply(&rows)?)?)?;
        }
        self.last_norm.apply(&rows)
    }

    /// How well each token fits behind each output: rows × vocabulary, one row behind the other.
    pub(crate) fn logits(&self, outputs: &Tensor) -> Result<Vec<f32>, ModelError> {
        Ok(self.tokens.apply(outputs)?.flatten_all()?.to_vec1::<f32>()?)
    }

    /// softmax(q Kᵀ/√d) V of each head over each token's path. `all` has queries, keys and values of the tokens, row by row.
    fn attend_to_paths(&self, all: &[f32], paths: &[Vec<Node>], keys: &[f32], values: &[f32]) -> Vec<f32> {
        let (width, of_head) = (self.width, self.width / self.heads);
        let scale = (of_head as f32).sqrt().recip();
        let mut attended = vec![0.0; paths.len() * width];
        let rows = attended.par_chunks_mut(width).zip(all.par_chunks(3 * width)).zip(paths);
        rows.for_each_init(Vec::new, |scores, ((attended, row), path)| {
            for (head, attended) in attended.chunks_exact_mut(of_head).enumerate() {
                let query = &row[head * of_head..][..of_head];
                scores.clear();
                scores.extend(path.iter().map(|node| {
                    let key = &keys[node * width + head * of_head..][..of_head];
                    query.iter().zip(key).map(|(a, b)| a * b).sum::<f32>() * scale
                }));
                let most = scores.iter().copied().fold(f32::NEG_INFINITY, f32::max);
                scores.iter_mut().for_each(|score| *score = (*score - most).exp());
                let sum: f32 = scores.iter().sum();
                for (score, node) in scores.iter().zip(path) {
                    let share = score / sum;
                    let value = &values[node * width + head * of_head..][..of_head];
                    attended.iter_mut().zip(value).for_each(|(to, from)| *to += share * from);
                }
            }
        });
        attended
    }
}
