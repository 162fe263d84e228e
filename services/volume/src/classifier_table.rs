//! A transfer function as a table, for many evaluations.

use glam::{Vec3, Vec4};

use crate::classifier::Classifier;
use crate::field::Field;
use crate::opacity::correct_opacity;

/// Intervals of the table.
const INTERVALS: usize = 1 << 14;

/// Colour, and opacity over one step, at even distances of the scaled value over the range of one field. Values between two
/// entries are mixed.
pub(crate) struct ClassifierTable {
    entries: Vec<Vec4>,
    index: Index,
}

/// From a stored value of the field to the place in the table.
enum Index {
    /// For a linear scale: a factor, and what is added.
    Linear(f32, f32),
    /// For others: by the scaled value.
    Scaled { classifier: Classifier, offset: f64, low: f64, factor: f64 },
}

impl ClassifierTable {
    /// `step` and `reference` are lengths.
    pub(crate) fn new(classifier: &Classifier, field: &Field, step: f64, reference: f64) -> Self {
        let [low, high] = [field.range().low, field.range().high].map(|raw| classifier.scaled(raw));
        let factor = if high > low { INTERVALS as f64 / (high - low) } else { 0.0 };
        let entries = (0..=INTERVALS).map(|k| {
            let (color, opacity) = classifier.evaluate_scaled(low + (high - low) * (k as f64 / INTERVALS as f64));
            color.extend(correct_opacity(f64::from(opacity), step, reference) as f32)
        });
        let index = match classifier.linear() {
            Some((shift, slope)) => {
                Index::Linear((slope * factor) as f32, (((field.offset() - shift) * slope - low) * factor) as f32)
            }
            None => Index::Scaled { classifier: classifier.clone(), offset: field.offset(), low, factor },
        };
        Self { entries: entries.collect(), index }
    }

    /// Colour and opacity over one step of a stored value; transparent for NaN.
    pub(crate) fn at(&self, stored: f32) -> (Vec3, f32) {
        let place = match &self.index {
            Index::Linear(factor, offset) => stored * factor + offset,
            Index::Scaled { classifier, offset, low, factor } => {
                ((classifier.scaled(offset + f64::from(stored)) - low) * factor) as f32
            }
        };
        // A NaN becomes 0 in the cast, and stays in the weight.
        let place = if stored.is_nan() { f32::NAN } else { place.clamp(0.0, INTERVALS as f32) };
        let low = (place as usize).min(INTERVALS - 1);
        let Some([a, b]) = self.entries.get(low..low + 2) else { return (Vec3::ZERO, 0.0) };
        let mixed = *a + (*b - *a) * (place - low as f32);
        if mixed.w > 0.0 { (mixed.truncate(), mixed.w) } else { (Vec3::ZERO, 0.0) }
    }
}
