//! Signals as rows of components, one row for each step of time, and what is done with each row alone.

use rayon::prelude::*;

/// ε of layer norms.
const EPSILON: f32 = 1e-5;
/// Fewest values that are worth another thread.
const MIN_PART: usize = 1 << 14;

/// A signal: `values` has `width` components for each step of time, step by step.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Frames {
    pub(crate) width: usize,
    pub(crate) values: Vec<f32>,
}

impl Frames {
    pub(crate) fn zeros(length: usize, width: usize) -> Self {
        Self { width, values: vec![0.0; length * width] }
    }

    /// Number of steps of time.
    pub(crate) fn len(&self) -> usize {
        self.values.len() / self.width.max(1)
    }

    /// One step of time.
    pub(crate) fn row(&self, at: usize) -> &[f32] {
        &self.values[at * self.width..][..self.width]
    }

    pub(crate) fn rows(&self) -> std::slice::ChunksExact<'_, f32> {
        self.values.chunks_exact(self.width)
    }

    pub(crate) fn rows_mut(&mut self) -> std::slice::ChunksExactMut<'_, f32> {
        self.values.chunks_exact_mut(self.width)
    }

    /// Steps of time from `from` until `until`.
    pub(crate) fn between(&self, from: usize, until: usize) -> Self {
        Self { width: self.width, values: self.values[from * self.width..until * self.width].to_vec() }
    }

    /// Components from `from` until `until` of each step.
    pub(crate) fn components(&self, from: usize, until: usize) -> Self {
        let values = self.rows().flat_map(|row| &row[from..until]).copied().collect();
        Self { width: until - from, values }
    }

    pub(crate) fn each(&mut self, function: impl Fn(f32) -> f32 + Sync) {
        let parts = self.values.par_chunks_mut(MIN_PART);
        parts.for_each(|part| part.iter_mut().for_each(|value| *value = function(*value)));
    }

    /// Adds a signal of the same shape.
    pub(crate) fn add(&mut self, other: &Self) {
        let parts = self.values.par_chunks_mut(MIN_PART).zip(other.values.par_chunks(MIN_PART));
        parts.for_each(|(to, from)| to.iter_mut().zip(from).for_each(|(to, from)| *to += from));
    }

    /// Adds one row to each step.
    pub(crate) fn add_row(&mut self, row: &[f32]) {
        for own in self.rows_mut() {
            own.iter_mut().zip(row).for_each(|(value, other)| *value += other);
        }
    }

    /// Multiplies values below zero by `slope`, which is less than one (leaky ReLU; `0` is ReLU).
    pub(crate) fn rectify(&mut self, slope: f32) {
        let parts = self.values.par_chunks_mut(MIN_PART);
        parts.for_each(|part| part.iter_mut().for_each(|value| *value = value.max(slope * *value)));
    }

    /// A copy with values below zero times `slope`.
    pub(crate) fn rectified(&self, slope: f32) -> Self {
        let mut copy = Self::zeros(self.len(), self.width);
        let parts = copy.values.par_chunks_mut(MIN_PART).zip(self.values.par_chunks(MIN_PART));
        parts.for_each(|(to, from)| to.iter_mut().zip(from).for_each(|(to, from)| *to = from.max(slope * from)));
        copy
    }
}

/// Layer norm over the components of a step (Ba et al. 2016).
#[derive(Debug)]
pub(crate) struct Norm {
    pub(crate) scale: Vec<f32>,
    pub(crate) shift: Vec<f32>,
}

impl Norm {
    pub(crate) fn apply(&self, frames: &mut Frames) {
        for row in frames.rows_mut() {
            let count = row.len() as f32;
            let mean = row.iter().sum::<f32>() / count;
            let variance = row.iter().map(|value| (value - mean).powi(2)).sum::<f32>() / count;
            let factor = (variance + EPSILON).sqrt().recip();
            for ((value, scale), shift) in row.iter_mut().zip(&self.scale).zip(&self.shift) {
                *value = (*value - mean) * factor * scale + shift;
            }
        }
    }
}

/// x·Φ(x) (Hendrycks and Gimpel 2016).
pub(crate) fn gelu(x: f32) -> f32 {
    0.5 * x * (1.0 + libm::erff(x * std::f32::consts::FRAC_1_SQRT_2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_normalized_and_cut() {
        let mut frames = Frames { width: 2, values: vec![1.0, 3.0, -5.0, 5.0] };
        assert_eq!((frames.len(), frames.row(1)), (2, &[-5.0, 5.0][..]));
        assert_eq!(frames.components(1, 2).values, [3.0, 5.0]);
        let rectified = frames.rectified(0.1);
        assert_eq!(rectified.values, [1.0, 3.0, -0.5, 5.0]);
        let mut copy = frames.clone();
        copy.rectify(0.1);
        assert_eq!(copy, rectified);
        Norm { scale: vec![1.0, 2.0], shift: vec![0.0, 1.0] }.apply(&mut frames);
        for (found, expected) in frames.values.iter().zip([-1.0, 3.0, -1.0, 3.0]) {
            assert!((found - expected).abs() < 1e-4, "{frames:?}");
        }
        assert!((gelu(1.0) - 0.841_344_7).abs() < 1e-6);
    }
}
