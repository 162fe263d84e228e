//! One row of a table: clusters at a given number, or walks over many trials.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

use rayon::prelude::*;
use serde::Serialize;
use sg_clusters::cluster_graph::ClusterGraph;
use sg_clusters::clustering::{Clustering, ClusteringOptions, ClusteringReport, cluster};
use sg_clusters::geometry::Geometry;
use sg_clusters::progress::Silent;
use sg_selection::mask_agreement::{Agreement, PartitionAgreement, best_union_iou};
use sg_selection::selection_index::{SelectionIndex, WalkOptions};
use sg_selection::session::SelectionSession;
use sg_selection::strokes::Mode;

use super::EvalError;
use super::hand::Trial;
use super::subject::Subject;

/// The permitted relative difference between the number of clusters and the wanted one.
pub const EQUAL: f64 = 0.02;

/// Clusters of a scene, as many as wanted.
pub struct Made {
    /// The clusters.
    pub clustering: Clustering,
    /// Numbers about them.
    pub report: ClusteringReport,
}

/// Clusters a scene into `wanted` clusters, within [`EQUAL`] if possible. Merging leaves fewer clusters than there were seeds, so
/// this searches for the number of seeds.
///
/// # Errors
/// [`EvalError::Cluster`].
pub fn at_equal_number(geometry: &Geometry, options: &ClusteringOptions, wanted: usize) -> Result<Made, EvalError> {
    let off = |found: usize| (found as f64 / wanted as f64 - 1.0).abs();
    let (mut low, mut high) = (0, usize::MAX);
    let mut most = wanted;
    let mut best: Option<Made> = None;
    for _ in 0..14 {
        let options = ClusteringOptions { max_clusters: most, ..options.clone() };
        let (clustering, report) = cluster(geometry, &options, &Silent)?;
        let found = report.clusters;
        if best.as_ref().is_none_or(|b| off(found) < off(b.report.clusters)) {
            best = Some(Made { clustering, report });
        }
        // Half the tolerance, so that two rows are within it of each other as well.
        if off(found) <= 0.5 * EQUAL {
            break;
        }
        if found < wanted {
            low = most;
        } else {
            high = most;
        }
        let scaled = (most as f64 * wanted as f64 / found.max(1) as f64).round() as usize;
        let next = if scaled > low && scaled < high {
            scaled
        } else if high == usize::MAX {
            2 * most
        } else {
            low.midpoint(high)
        };
        if next == most || high - low <= 1 {
            break;
        }
        most = next;
    }
    best.ok_or(EvalError::Nothing)
}

/// The quality of clusters, independent of any later selection.
#[derive(Debug, Clone, Serialize)]
pub struct ClusterRow {
    /// What was varied.
    pub variant: String,
    /// Clusters.
    pub clusters: usize,
    /// Mean members of a cluster.
    pub mean_size: f64,
    /// Standard deviation of the members over their mean.
    pub size_cv: f64,
    /// Mean distance to the cluster's mean position, over the box's longest edge.
    pub compactness_box_share: f64,
    /// Share of neighbour pairs in one cluster.
    pub same_label_knn: f64,
    /// See [`PartitionAgreement`].
    #[serde(flatten)]
    pub partition: PartitionAgreement,
    /// The IoU of the best union of clusters with the target.
    pub best_union_iou: f64,
    /// Wall seconds of the clustering, without features and graph.
    pub cluster_seconds: f64,
    /// The default walk on these clusters.
    pub walk: WalkRow,
}

/// How often a value lies where.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Spread {
    /// Twentieth part from below.
    pub p05: f64,
    /// First quartile.
    pub p25: f64,
    /// Median.
    pub median: f64,
    /// Third quartile.
    pub p75: f64,
    /// Twentieth part from above.
    pub p95: f64,
}

impl Spread {
    /// Of at least one value.
    #[must_use]
    pub fn of(mut values: Vec<f64>) -> Self {
        values.sort_by(f64::total_cmp);
        let at = |q: f64| {
            let place = q * (values.len().max(1) - 1) as f64;
            let (below, above) = (place.floor() as usize, place.ceil() as usize);
            let value = |i: usize| values.get(i).copied().unwrap_or(f64::NAN);
            value(below) + (place - place.floor()) * (value(above) - value(below))
        };
        Self { p05: at(0.05), p25: at(0.25), median: at(0.5), p75: at(0.75), p95: at(0.95) }
    }
}

/// Medians of each agreement.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Medians {
    /// IoU with its spread.
    pub iou: Spread,
    /// IoU in which each Gaussian counts by its opacity.
    pub iou_by_opacity: f64,
    /// Share of Gaussians on the right side.
    pub acc: f64,
    /// Harmonic mean of precision and recall.
    pub f1: f64,
    /// Precision.
    pub precision: f64,
    /// Recall.
    pub recall: f64,
    /// Matthews correlation coefficient.
    pub mcc: f64,
}

/// The selections of walks over many trials.
#[derive(Debug, Clone, Serialize)]
pub struct WalkRow {
    /// What was varied.
    pub variant: String,
    /// Trials.
    pub trials: usize,
    /// Trials in which the walk could not be solved.
    pub failed: usize,
    /// After the green stroke alone.
    pub green: Medians,
    /// After the green and the red stroke.
    pub both: Medians,
    /// Median wall milliseconds of the second stroke: hit test, walk, mask.
    pub stroke_ms: f64,
}

/// The tool of a selection.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum With {
    /// Walks on clusters.
    Walk(WalkOptions),
    /// The same with three green strokes instead of one.
    WalkOfThree(WalkOptions),
    /// Walks on single Gaussians.
    GaussianWalk(WalkOptions),
    /// The clusters or Gaussians that are hit.
    Hits(Mode),
}

/// Plays every trial.
///
/// # Errors
/// [`EvalError::Graph`].
pub fn play(
    subject: &Subject,
    geometry: &Geometry,
    clustering: &Clustering,
    with: With,
    variant: &str,
    trials: &[Trial],
) -> Result<WalkRow, EvalError> {
    let scene = &subject.scene;
    let space = match with {
        With::GaussianWalk(options) => SelectionIndex::of_gaussians(scene, geometry, clustering, options),
        With::Walk(options) | With::WalkOfThree(options) => {
            let graph = ClusterGraph::new(geometry, clustering, options.form)?;
            SelectionIndex::of_clusters(scene, clustering, &graph, options)
        }
        With::Hits(_) => {
            let options = WalkOptions::default();
            let graph = ClusterGraph::new(geometry, clustering, options.form)?;
            SelectionIndex::of_clusters(scene, clustering, &graph, options)
        }
    };
    let space = Arc::new(space);
    let opacity: Vec<f64> = opacities(subject);
    let played: Vec<Option<[(Agreement, f64, f64); 2]>> = trials
        .par_iter()
        .map(|trial| {
            let mut session = SelectionSession::new(Arc::clone(&space));
            if let With::WalkOfThree(_) = with {
                trial.more.iter().try_for_each(|stroke| session.add_stroke(stroke.clone()).map(|_| ())).ok()?;
            }
            let mut outcome = Vec::with_capacity(2);
            for stroke in [&trial.green, &trial.red] {
                let mut stroke = stroke.clone();
                if let With::Hits(mode) = with {
                    stroke.mode = mode;
                }
                let start = Instant::now();
                session.add_stroke(stroke).ok()?;
                let milliseconds = 1e3 * start.elapsed().as_secs_f64();
                let pairs = || (0..scene.len()).map(|g| (session.mask().get(g), subject.target[g]));
                outcome.push((Agreement::of(pairs()), weighted_iou(pairs(), &opacity), milliseconds));
            }
            outcome.try_into().ok()
        })
        .collect();
    let failed = played.iter().filter(|p| p.is_none()).count();
    let side = |k: usize| -> Vec<(Agreement, f64, f64)> { played.iter().flatten().map(|p| p[k]).collect() };
    let (green, both) = (side(0), side(1));
    Ok(WalkRow {
        variant: variant.to_owned(),
        trials: trials.len(),
        failed,
        stroke_ms: Spread::of(both.iter().map(|b| b.2).collect()).median,
        green: medians(&green),
        both: medians(&both),
    })
}

fn medians(all: &[(Agreement, f64, f64)]) -> Medians {
    let spread = |f: &dyn Fn(&(Agreement, f64, f64)) -> f64| Spread::of(all.iter().map(f).collect());
    Medians {
        iou: spread(&|a| a.0.iou),
        iou_by_opacity: spread(&|a| a.1).median,
        acc: spread(&|a| a.0.acc).median,
        f1: spread(&|a| a.0.f1).median,
        precision: spread(&|a| a.0.precision).median,
        recall: spread(&|a| a.0.recall).median,
        mcc: spread(&|a| a.0.mcc).median,
    }
}

fn opacities(subject: &Subject) -> Vec<f64> {
    let units = &subject.scene.units;
    units.iter().flat_map(|u| (0..u.gaussians.len()).map(|i| f64::from(u.gaussians.opacity(i)))).collect()
}

fn weighted_iou(pairs: impl Iterator<Item = (bool, bool)>, weight: &[f64]) -> f64 {
    let (mut shared, mut either) = (0.0, 0.0);
    for ((selected, wanted), w) in pairs.zip(weight) {
        shared += if selected && wanted { *w } else { 0.0 };
        either += if selected || wanted { *w } else { 0.0 };
    }
    if either > 0.0 { shared / either } else { 1.0 }
}

/// Judges clusters by the subject's parts and by the default walk on them.
///
/// # Errors
/// [`EvalError`].
pub fn judge(
    subject: &Subject,
    geometry: &Geometry,
    made: &Made,
    variant: &str,
    trials: &[Trial],
) -> Result<ClusterRow, EvalError> {
    let labels = &made.clustering.labels;
    let edges = geometry.units.iter().flat_map(|unit| {
        let index = &unit.vertices.gaussian;
        unit.graph.edges().map(|e| (index[e.a as usize], index[e.b as usize]))
    });
    let seconds: &BTreeMap<&'static str, f64> = &made.report.seconds;
    let of = |stage: &str| seconds.get(stage).copied().unwrap_or(0.0);
    Ok(ClusterRow {
        variant: variant.to_owned(),
        clusters: made.report.clusters,
        mean_size: made.report.mean_size,
        size_cv: made.report.size_cv,
        compactness_box_share: made.report.compactness / subject.scene.bounds.longest_edge(),
        same_label_knn: made.report.same_label_knn,
        partition: PartitionAgreement::of(labels, &subject.part, edges),
        best_union_iou: best_union_iou(labels, &subject.target),
        cluster_seconds: of("total") - of("features") - of("graph"),
        walk: play(subject, geometry, &made.clustering, With::Walk(WalkOptions::default()), "default walk", trials)?,
    })
}
