//! Batches of one model's inputs.

use candle_core::Tensor;

use crate::embedding::Embedding;
use crate::error::EncoderError;

/// Most texts in one pass. More of them take memory and no less time for each.
const TEXTS: usize = 32;

/// One embedding for each row of `dimension` values.
pub(crate) fn rows(values: &[f32], dimension: usize) -> Result<Vec<Embedding>, EncoderError> {
    values.chunks_exact(dimension).map(|row| Embedding::new(row).map_err(EncoderError::from)).collect()
}

/// One embedding for each row.
pub(crate) fn embeddings(rows: &Tensor) -> Result<Vec<Embedding>, EncoderError> {
    let rows = rows.to_vec2::<f32>()?;
    rows.iter().map(|row| Embedding::new(row).map_err(EncoderError::from)).collect()
}

/// Encodes texts of similar lengths together, as a batch costs as much as if all of its texts had the longest one's length.
pub(crate) fn encode_by_length(
    texts: Vec<Vec<u32>>,
    encode: impl Fn(&[Vec<u32>]) -> Result<Vec<Embedding>, EncoderError>,
) -> Result<Vec<Embedding>, EncoderError> {
    let mut order: Vec<(usize, Vec<u32>)> = texts.into_iter().enumerate().collect();
    order.sort_by_key(|(_, ids)| ids.len());
    let (places, sorted): (Vec<usize>, Vec<Vec<u32>>) = order.into_iter().unzip();
    let mut encoded = Vec::with_capacity(places.len());
    for batch in sorted.chunks(TEXTS) {
        encoded.extend(encode(batch)?);
    }
    let mut placed: Vec<(usize, Embedding)> = places.into_iter().zip(encoded).collect();
    placed.sort_by_key(|(place, _)| *place);
    Ok(placed.into_iter().map(|(_, embedding)| embedding).collect())
}
