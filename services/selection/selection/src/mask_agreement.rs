//! Agreement of a mask, or of a clustering, with the ground truth.

use std::collections::BTreeMap;

use serde::Serialize;

/// Agreement of a mask with the ground truth, over all Gaussians.
///
/// A ratio with a zero denominator is 1 if the masks agree, else 0.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Agreement {
    /// Accuracy: share of correctly classified Gaussians.
    pub acc: f64,
    /// Matthews correlation coefficient, −1 to 1.
    pub mcc: f64,
    /// Harmonic mean of precision and recall.
    pub f1: f64,
    /// Intersection over union.
    pub iou: f64,
    /// Share of true Gaussians among the selected.
    pub precision: f64,
    /// Share of selected Gaussians among the true.
    pub recall: f64,
}

impl Agreement {
    /// Computes the measures over pairs of (selected, true).
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

/// Agreement of a clustering with a true partition into parts.
///
/// More clusters improve all measures, so compare at an equal number.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PartitionAgreement {
    /// Achievable segmentation accuracy (Liu et al. 2011): share of correct elements if every cluster takes the part of the
    /// majority of its members.
    pub achievable_accuracy: f64,
    /// Share of edges between different parts that also cross a cluster boundary; 1 without such edges. There is no spatial
    /// tolerance.
    pub boundary_recall: f64,
    /// Under-segmentation error (Neubert and Protzel 2012). It is Σ min(inside, outside) over intersecting pairs of part and
    /// cluster, divided by the number of elements. 0 is best.
    pub under_segmentation: f64,
}

impl PartitionAgreement {
    /// Compares clusters with parts, one entry per element. Elements with a negative cluster are ignored. `edges` are the
    /// neighbour pairs for the boundary recall.
    #[must_use]
    pub fn of(clusters: &[i32], parts: &[i32], edges: impl Iterator<Item = (u32, u32)>) -> Self {
        let mut shared: BTreeMap<(i32, i32), u64> = BTreeMap::new();
        for (&c, &p) in clusters.iter().zip(parts).filter(|(c, _)| **c >= 0) {
            *shared.entry((c, p)).or_default() += 1;
        }
        let rows: Vec<(i32, u64)> = shared.iter().map(|(&(c, _), &n)| (c, n)).collect();
        let (mut elements, mut right, mut astray) = (0, 0, 0);
        for cluster in rows.chunk_by(|a, b| a.0 == b.0) {
            let size: u64 = cluster.iter().map(|r| r.1).sum();
            elements += size;
            right += cluster.iter().map(|r| r.1).max().unwrap_or(0);
            astray += cluster.iter().map(|r| r.1.min(size - r.1)).sum::<u64>();
        }
        let (mut borders, mut kept) = (0_u64, 0_u64);
        for (a, b) in edges.map(|(a, b)| (a as usize, b as usize)) {
            if parts[a] != parts[b] {
                borders += 1;
                kept += u64::from(clusters[a] != clusters[b]);
            }
        }
        let share = |a: u64, b: u64, empty: f64| if b > 0 { a as f64 / b as f64 } else { empty };
        Self {
            achievable_accuracy: share(right, elements, 1.0),
            boundary_recall: share(kept, borders, 1.0),
            under_segmentation: share(astray, elements, 0.0),
        }
    }
}

/// The largest IoU of a union of clusters with the truth. Elements with a negative cluster count as unselected.
///
/// Each cluster adds its true members to the numerator and its false members to the denominator. So the best union is a
/// prefix of the clusters in descending order of their share of true members.
#[must_use]
pub fn best_union_iou(clusters: &[i32], truth: &[bool]) -> f64 {
    let mut counts: BTreeMap<i32, (u64, u64)> = BTreeMap::new();
    let mut wanted = 0;
    for (&c, &t) in clusters.iter().zip(truth) {
        wanted += u64::from(t);
        if c >= 0 {
            let entry = counts.entry(c).or_default();
            if t { entry.0 += 1 } else { entry.1 += 1 }
        }
    }
    let mut rows: Vec<(u64, u64)> = counts.into_values().collect();
    // Compares a/b with c/d without division: exact, so the order is total.
    rows.sort_by(|a, b| (u128::from(b.0) * u128::from(a.1)).cmp(&(u128::from(a.0) * u128::from(b.1))));
    let (mut inside, mut outside) = (0, 0);
    let mut best = if wanted == 0 { 1.0 } else { 0.0_f64 };
    for (t, f) in rows {
        inside += t;
        outside += f;
        best = best.max(inside as f64 / (wanted + outside) as f64);
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_division_worked_out_by_hand() {
        // Cluster 0: parts 7 7 9; cluster 1: 9 9; one element without a cluster.
        let clusters = [0, 0, 0, 1, 1, -1];
        let parts = [7, 7, 9, 9, 9, 7];
        let edges = [(0, 1), (1, 2), (2, 3), (0, 3)];
        let a = PartitionAgreement::of(&clusters, &parts, edges.into_iter());
        assert!((a.achievable_accuracy - 4.0 / 5.0).abs() < 1e-15);
        assert!((a.boundary_recall - 0.5).abs() < 1e-15, "(1, 2) is lost, (0, 3) kept");
        assert!((a.under_segmentation - 2.0 / 5.0).abs() < 1e-15);
        let perfect = PartitionAgreement::of(&parts, &parts, edges.into_iter());
        assert_eq!((perfect.achievable_accuracy, perfect.boundary_recall, perfect.under_segmentation), (1.0, 1.0, 0.0));
    }

    proptest! {
        #[test]
        fn no_union_of_clusters_is_better(
            labels in proptest::collection::vec((-1..6_i32, any::<bool>()), 1..40)
        ) {
            let (clusters, truth): (Vec<i32>, Vec<bool>) = labels.into_iter().unzip();
            let best = (0..64_u32)
                .map(|chosen| {
                    let is = |c: i32| c >= 0 && chosen >> c & 1 == 1;
                    Agreement::of(clusters.iter().zip(&truth).map(|(c, t)| (is(*c), *t))).iou
                })
                .fold(0.0, f64::max);
            prop_assert!((best_union_iou(&clusters, &truth) - best).abs() < 1e-12);
        }
    }

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
