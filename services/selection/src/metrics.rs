//! How well a selection agrees with a known truth.

use serde::Serialize;

/// Agreement of a predicted selection with the true one, over all Gaussians.
///
/// A ratio whose denominator is zero is 1 if nothing was missed or added, else 0.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Agreement {
    /// Share of Gaussians on the right side.
    pub acc: f64,
    /// Matthews correlation coefficient, −1 to 1.
    pub mcc: f64,
    /// Harmonic mean of precision and recall.
    pub f1: f64,
    /// Intersection over union.
    pub iou: f64,
    /// Share of the selected that are true.
    pub precision: f64,
    /// Share of the true that are selected.
    pub recall: f64,
}

impl Agreement {
    /// Counts over pairs of (selected, true).
    #[must_use]
    pub fn of(pairs: impl Iterator<Item = (bool, bool)>) -> Self {
        let (mut tp, mut fp, mut fn_, mut tn) = (0.0_f64, 0.0_f64, 0.0_f64, 0.0_f64);
        for pair in pairs {
            match pair {
                (true, true) => tp += 1.0,
                (true, false) => fp += 1.0,
                (false, true) => fn_ += 1.0,
                (false, false) => tn += 1.0,
            }
        }
        let empty = f64::from(u8::from(fp + fn_ == 0.0));
        let ratio = |a: f64, b: f64| if b > 0.0 { a / b } else { empty };
        let spread = ((tp + fp) * (tp + fn_)).sqrt() * ((tn + fp) * (tn + fn_)).sqrt();
        Self {
            acc: ratio(tp + tn, tp + tn + fp + fn_),
            mcc: ratio(tp * tn - fp * fn_, spread),
            f1: ratio(2.0 * tp, 2.0 * tp + fp + fn_),
            iou: ratio(tp, tp + fp + fn_),
            precision: ratio(tp, tp + fp),
            recall: ratio(tp, tp + fn_),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(tp: usize, fp: usize, fn_: usize, tn: usize) -> Agreement {
        let repeat = |pair, n| std::iter::repeat_n(pair, n);
        Agreement::of(
            repeat((true, true), tp)
                .chain(repeat((true, false), fp))
                .chain(repeat((false, true), fn_))
                .chain(repeat((false, false), tn)),
        )
    }

    #[test]
    fn values_worked_out_by_hand() {
        let a = of(6, 2, 3, 9);
        assert!((a.acc - 0.75).abs() < 1e-15);
        assert!((a.iou - 6.0 / 11.0).abs() < 1e-15);
        assert!((a.f1 - 12.0 / 17.0).abs() < 1e-15);
        assert!((a.precision - 0.75).abs() < 1e-15 && (a.recall - 2.0 / 3.0).abs() < 1e-15);
        assert!((a.mcc - (54.0 - 6.0) / (8.0_f64 * 9.0 * 11.0 * 12.0).sqrt()).abs() < 1e-15);
        // F1 = 2·IoU / (1 + IoU) always: equal only at 0 and 1.
        assert!((a.f1 - 2.0 * a.iou / (1.0 + a.iou)).abs() < 1e-15);
    }

    #[test]
    fn empty_sides_are_numbers() {
        let perfect = Agreement { acc: 1.0, mcc: 1.0, f1: 1.0, iou: 1.0, precision: 1.0, recall: 1.0 };
        assert_eq!(of(0, 0, 0, 5), perfect);
        assert_eq!(of(5, 0, 0, 0), perfect);
        assert_eq!(of(0, 0, 0, 0), perfect);
        let missed = of(0, 0, 5, 5);
        assert_eq!((missed.iou, missed.f1, missed.precision, missed.recall, missed.mcc), (0.0, 0.0, 0.0, 0.0, 0.0));
    }
}
