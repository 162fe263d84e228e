//! Text towers of models with images and texts.

use candle_core::{Device, Tensor};
use sg_layers::{Batch, Hidden, Kind, LayerNorm, Linear, Matrix, Precision, Weights};

use crate::config::{TextConfig, TextPooling};
use crate::error::EncoderError;
use crate::layout::Layout;
use crate::transformer::{NormOrder, Transformer};

pub(crate) struct TextTower {
    tokens: Matrix,
    positions: Matrix,
    transformer: Transformer,
    norm_after: LayerNorm,
    projection: Linear,
    pooling: TextPooling,
    context: usize,
}

impl TextTower {
    pub(crate) fn read(
        weights: &mut Weights,
        layout: Layout,
        config: &TextConfig,
        dimension: usize,
        precision: Precision,
    ) -> Result<Self, EncoderError> {
        let (names, transformer) = (layout.text(), &config.transformer);
        let width = transformer.width;
        let mut table = |name: &str, rows| {
            let values = weights.values(name, &[rows, width], Kind::Table)?;
            Ok::<_, EncoderError>(Matrix::of_table(values, rows, width, precision)?)
        };
        Ok(Self {
            tokens: table(names.tokens, config.vocabulary)?,
            positions: table(names.positions, config.context)?,
            transformer: Transformer::read(
                weights,
                names.blocks,
                layout.block(),
                NormOrder::Before,
                transformer,
                precision,
            )?,
            norm_after: LayerNorm::read(weights, names.norm_after, width, transformer.epsilon)?,
            projection: names.projection.read(weights, [dimension, width], precision)?,
            pooling: config.pooling,
            context: config.context,
        })
    }

    /// Embeddings (texts × dimension) of token ids. Each text has at most as many as the context and at least one.
    pub(crate) fn apply(&self, texts: &[Vec<u32>]) -> Result<Tensor, EncoderError> {
        let (length, filling) = self.pooling.filled(texts, self.context);
        let hidden = match self.pooling {
            TextPooling::Last { .. } => Hidden::Nothing,
            TextPooling::First(_) | TextPooling::Highest => Hidden::Later,
        };
        let batch = Batch { sequences: texts.len(), length };
        let filled =
            |ids: &Vec<u32>| ids.iter().copied().chain(std::iter::repeat(filling)).take(length).collect::<Vec<_>>();
        let ids: Vec<u32> = texts.iter().flat_map(filled).collect();
        let positions: Vec<u32> = (0..length as u32).collect();
        let tokens = self.tokens.take(&ids)?.reshape((texts.len(), length, ()))?;
        let rows = tokens.broadcast_add(&self.positions.take(&positions)?)?.flatten(0, 1)?;
        let rows = self.transformer.apply(rows, batch, hidden)?;
        let pooled: Vec<u32> =
            texts.iter().enumerate().map(|(at, ids)| (at * length + self.pooling.place(ids, length)) as u32).collect();
        let pooled = rows.index_select(&Tensor::from_vec(pooled, texts.len(), &Device::Cpu)?, 0)?;
        Ok(self.projection.apply(&self.norm_after.apply(&pooled)?, None)?)
    }
}

impl TextPooling {
    /// The number of tokens that each text is filled up to, and the token that fills.
    pub(crate) fn filled(self, texts: &[Vec<u32>], context: usize) -> (usize, u32) {
        match self {
            // A tower that is not causal was trained on texts filled up to the context, and sees it.
            Self::Last { padding } => (context, padding),
            // A causal tower never sees what stands behind the pooled token, so that texts end with the longest one.
            Self::First(_) | Self::Highest => (texts.iter().map(Vec::len).max().unwrap_or_default(), 0),
        }
    }

    /// Place of the token whose output is the text's, among `length` with those that fill up.
    fn place(self, ids: &[u32], length: usize) -> usize {
        match self {
            Self::Last { .. } => length - 1,
            // As published, the first token where the end of text is missing.
            Self::First(end) => ids.iter().position(|id| *id == end).unwrap_or_default(),
            Self::Highest => {
                let highest = ids.iter().max();
                ids.iter().position(|id| Some(id) == highest).unwrap_or_default()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_is_pooled_at_its_end() {
        let ids = [7, 3, 9, 2, 9];
        assert_eq!(TextPooling::First(2).place(&ids, 8), 3);
        assert_eq!(TextPooling::First(9).place(&ids, 8), 2);
        assert_eq!(TextPooling::First(5).place(&ids, 8), 0);
        assert_eq!(TextPooling::Highest.place(&ids, 8), 2);
        assert_eq!(TextPooling::Last { padding: 0 }.place(&ids, 8), 7);
    }
}
