//! Weights of features by the hash of the feature, in eight bits.

use std::collections::HashMap;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};

/// The hash of a feature. It is the same in all programs that one compiler built.
pub(crate) fn feature(parts: &[&str]) -> u64 {
    let mut hasher = DefaultHasher::new();
    for part in parts {
        part.hash(&mut hasher);
    }
    hasher.finish()
}

/// The features that training counts, by their hash.
pub(crate) type Index = HashMap<u64, u32>;

/// Weights of features, one for each output. A row has one scale, so that a weight is off by less than 1/254 of the largest in its row.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Table {
    /// Number of outputs.
    pub(crate) width: usize,
    /// Hashes of the features, ascending.
    pub(crate) features: Vec<u64>,
    pub(crate) scales: Vec<f32>,
    /// Rows of `width` weights.
    pub(crate) weights: Vec<i8>,
}

impl Table {
    /// The rows of an index whose largest weight is at least `least`.
    pub(crate) fn of(index: &Index, rows: &[f32], width: usize, least: f32) -> Self {
        let largest = |row: &[f32]| row.iter().fold(0.0_f32, |most, weight| most.max(weight.abs()));
        let row = |at: u32| rows.get(at as usize * width..(at as usize + 1) * width).unwrap_or_default();
        let mut kept: Vec<(u64, &[f32])> = index.iter().map(|(hash, at)| (*hash, row(*at))).collect();
        kept.retain(|(_, row)| largest(row) >= least);
        kept.sort_unstable_by_key(|(hash, _)| *hash);
        let mut table =
            Self { width, features: Vec::new(), scales: Vec::new(), weights: Vec::with_capacity(kept.len() * width) };
        for (hash, row) in kept {
            let scale = largest(row).max(f32::MIN_POSITIVE) / f32::from(i8::MAX);
            table.features.push(hash);
            table.scales.push(scale);
            // The quotient lies in −127 to 127.
            #[allow(clippy::cast_possible_truncation)]
            table.weights.extend(row.iter().map(|weight| (weight / scale).round() as i8));
        }
        table
    }

    /// Position of a feature.
    pub(crate) fn row_of(&self, feature: u64) -> Option<usize> {
        self.features.binary_search(&feature).ok()
    }

    /// Adds the weights of a row, times `by`.
    pub(crate) fn add(&self, row: usize, by: f32, sums: &mut [f32]) {
        let by = by * self.scales[row];
        let weights = &self.weights[row * self.width..(row + 1) * self.width];
        sums.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += by * f32::from(*weight));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_kept_within_the_bound() {
        let rows = [0.5, -2.0, 0.013, 1.0, 1e-6, 0.0, 0.3, 0.1, -0.2];
        let index = Index::from([(7, 0), (3, 1), (5, 2)]);
        let table = Table::of(&index, &rows, 3, 0.25);
        assert_eq!(table.features, [3, 5, 7]);
        for (hash, at) in index {
            let mut sums = [0.0; 3];
            table.add(table.row_of(hash).unwrap(), 1.0, &mut sums);
            let row = &rows[at as usize * 3..][..3];
            let largest = row.iter().fold(0.0_f32, |most, weight| most.max(weight.abs()));
            assert!(sums.iter().zip(row).all(|(sum, weight)| (sum - weight).abs() <= largest / 254.0 + 1e-6));
        }
        assert_eq!(Table::of(&Index::from([(7, 0)]), &[0.1, 0.2, 0.0], 3, 0.25).features, []);
    }
}
