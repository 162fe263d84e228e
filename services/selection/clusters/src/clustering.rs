//! Super-Gaussians: connected clusters of nearby Gaussians with similar features.
//!
//! The algorithm is geodesic SLIC. Seeds come from a voxel grid. Each round assigns Gaussians by D (see
//! [`crate::assignment`]) and updates the centres: the feature is the mean of the members, and the source is the member
//! nearest to their mean position. Finally small pieces are merged. Then every cluster is connected, and each base unit has
//! at most `max_clusters`. A cluster never crosses base units.

use std::collections::BTreeMap;
use std::time::Instant;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::assignment::{Assignment, Centre, GeodesicAssigner, Metric};
use crate::euclidean::assign_straight;
use crate::features::{FeatureKind, Row, WIDTH};
use crate::geometry::{Geometry, GeometryError, UnitGeometry};
use crate::merge::merge_pieces;
use crate::neighbours::GraphError;
use crate::progress::{Progress, Stage};
use crate::seeds::{MIN_SHARE, adaptive_seeds, contrast, voxel_seeds};
use crate::shortest::{NONE, fill_unlabelled};
use crate::vertices::{Vertices, distance_squared};

/// Distance of the clustering.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Path length over the neighbour graph, and features.
    #[default]
    Geodesic,
    /// Straight-line distance, and features.
    EuclideanFeature,
    /// Straight-line distance alone.
    Euclidean,
}

/// Accuracy of the assignment.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Level {
    /// The smallest D over all centres.
    #[default]
    Exact,
    /// The smallest D over centres within 2S, or else the nearest centre.
    Windowed,
    /// The smallest D over all centres, in two rounds.
    Fast,
}

/// Seeds of the caller in place of the voxel grid.
#[derive(Debug, Clone, PartialEq)]
pub struct FixedSeeds {
    /// Scene-wide indices of the seed Gaussians.
    pub gaussians: Vec<u32>,
    /// S, in the scene's length unit.
    pub cell: f64,
}

/// Parameters of the clustering.
#[derive(Debug, Clone, PartialEq)]
pub struct ClusteringOptions {
    /// Most clusters of each base unit.
    pub max_clusters: usize,
    /// m: the weight of features against distance in D = (d/S)² + m²·‖Δf‖². Smaller is more compact.
    pub compactness: f64,
    /// Distance.
    pub method: Method,
    /// Accuracy of the assignment.
    pub level: Level,
    /// Fixed seeds; `None` means the voxel grid.
    pub seeds: Option<FixedSeeds>,
    /// Exact number of rounds. `None` means up to ten (two at the fast level), until the objective improves by less than a
    /// thousandth.
    pub rounds: Option<usize>,
    /// Whether small pieces are merged. Without merging, labels are positions in the list of seeds.
    pub merge: bool,
    /// Adaptive granularity: dense seeds where features differ between neighbours, sparse seeds elsewhere. Fixed seeds are
    /// not changed.
    pub adaptive: bool,
}

impl Default for ClusteringOptions {
    fn default() -> Self {
        Self {
            max_clusters: 999,
            compactness: 0.5,
            method: Method::Geodesic,
            level: Level::Exact,
            seeds: None,
            rounds: None,
            merge: true,
            adaptive: false,
        }
    }
}

const MAX_ROUNDS: usize = 10;
/// The first round uses features of single Gaussians, the second one features of clusters. Later rounds gain little.
const FAST_ROUNDS: usize = 2;
const MIN_IMPROVEMENT: f64 = 1e-3;

/// A failed clustering.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ClusterError {
    /// From the geometry.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
    /// From the search tree.
    #[error(transparent)]
    Graph(#[from] GraphError),
    /// An option outside its range.
    #[error("{name} is {found}; it must be {want}")]
    Option {
        /// Name of the option.
        name: &'static str,
        /// The value.
        found: String,
        /// Allowed values.
        want: &'static str,
    },
    /// A seed that is not a Gaussian with a finite position.
    #[error("seed {position} names Gaussian {gaussian}, which {reason}")]
    Seed {
        /// Position in the list of seeds.
        position: usize,
        /// Index of the Gaussian.
        gaussian: u32,
        /// The problem.
        reason: &'static str,
    },
    /// A base unit without a fixed seed.
    #[error("base unit {0} (counted from 0) has no seed; give at least one Gaussian of every base unit")]
    NoSeed(usize),
    /// Labels that do not fit the scene.
    #[error("{0}")]
    Labels(String),
}

/// One Super-Gaussian.
#[derive(Debug, Clone, PartialEq)]
pub struct Cluster {
    /// Base unit of the members, counted from 0.
    pub unit: u32,
    /// Number of members; zero only if labels from outside skip an id.
    pub size: u32,
    /// Scene-wide index of the member nearest to the mean position; `u32::MAX` without members.
    pub centre: u32,
    /// Mean position of the members in the scene frame.
    pub position: [f64; 3],
    /// Mean feature of the members, in the columns of the unit's feature form.
    pub feature: [f64; WIDTH],
}

/// The clusters of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Clustering {
    /// Cluster of each Gaussian; −1 where its position is not finite.
    pub labels: Vec<i32>,
    /// The clusters, grouped by base unit.
    pub clusters: Vec<Cluster>,
    /// Feature form of each base unit.
    pub kinds: Vec<FeatureKind>,
}

/// Statistics and times of a clustering.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ClusteringReport {
    /// Number of Gaussians in the scene.
    pub gaussians: usize,
    /// Gaussians without a finite position.
    pub dropped: usize,
    /// Number of clusters.
    pub clusters: usize,
    /// Mean number of members.
    pub mean_size: f64,
    /// Standard deviation of the number of members over their mean.
    pub size_cv: f64,
    /// Mean distance of a Gaussian to the mean position of its cluster, in the scene's length unit.
    pub compactness: f64,
    /// Share of neighbour pairs (both directions) whose ends lie in the same cluster.
    pub same_label_knn: f64,
    /// Σ D after each round's assignment, over all base units.
    pub objective: Vec<f64>,
    /// S of each base unit, in the scene's length unit.
    pub cell: Vec<f64>,
    /// Seconds by stage.
    pub seconds: BTreeMap<&'static str, f64>,
}

/// Clusters a scene.
///
/// # Errors
/// [`ClusterError`] for an invalid option or seed, or if the caller cancels.
pub fn cluster(
    geometry: &Geometry,
    options: &ClusteringOptions,
    progress: &dyn Progress,
) -> Result<(Clustering, ClusteringReport), ClusterError> {
    check(options)?;
    let start = Instant::now();
    let given = options.seeds.as_ref().map(|g| seeds_by_unit(geometry, g)).transpose()?;
    let mut labels = vec![-1; geometry.gaussians];
    let mut objective: Vec<f64> = Vec::new();
    let mut clock = Clock::default();
    let mut cells = Vec::new();
    let mut first = 0;
    let mut done = 0;
    for (u, unit) in geometry.units.iter().enumerate() {
        let share = |stage| done as f64 / geometry.gaussians.max(1) as f64 + stage;
        progress.at(Stage::Seeds, share(0.0));
        let seeds = clock.time(Stage::Seeds, || match (&given, &options.seeds) {
            (Some(by_unit), Some(seeds)) => (by_unit[u].clone(), seeds.cell),
            _ => {
                let (vertices, component, most) = (&unit.vertices, &unit.component, options.max_clusters);
                let s = if options.adaptive {
                    adaptive_seeds(
                        vertices,
                        component,
                        unit.components,
                        most,
                        &contrast(&unit.graph, &unit.features.rows),
                    )
                } else {
                    voxel_seeds(vertices, component, unit.components, most)
                };
                (s.sources, s.cell)
            }
        });
        cells.push(seeds.1);
        let (label, count) = cluster_unit(unit, options, seeds, &mut objective, &mut clock, &mut |stage, fraction| {
            progress.at(stage, share(fraction * unit.vertices.len() as f64 / geometry.gaussians.max(1) as f64));
            if progress.cancelled() { Err(GeometryError::Cancelled.into()) } else { Ok(()) }
        })?;
        for (&g, &l) in unit.vertices.gaussian.iter().zip(&label) {
            labels[g as usize] = first + l as i32;
        }
        first += count as i32;
        done += unit.vertices.len();
    }
    let clustering = Clustering::of_labels(geometry, labels, Some(first as usize))?;
    progress.at(Stage::Assignment, 1.0);
    progress.at(Stage::Merge, 1.0);
    let mut seconds = clock.seconds;
    seconds.insert("features", geometry.feature_seconds);
    seconds.insert("graph", geometry.graph_seconds);
    seconds.insert("total", start.elapsed().as_secs_f64() + geometry.feature_seconds + geometry.graph_seconds);
    let report = report(geometry, &clustering, objective, cells, seconds);
    Ok((clustering, report))
}

fn check(options: &ClusteringOptions) -> Result<(), ClusterError> {
    let wrong = |name, found: String, want| Err(ClusterError::Option { name, found, want });
    if options.max_clusters == 0 || options.max_clusters > 1_000_000 {
        return wrong("the number of clusters", options.max_clusters.to_string(), "between 1 and 1000000");
    }
    if !(options.compactness >= 0.0 && options.compactness.is_finite()) {
        return wrong("the compactness", options.compactness.to_string(), "finite and at least 0");
    }
    if options.rounds == Some(0) || options.rounds > Some(1000) {
        return wrong("the number of rounds", options.rounds.unwrap_or(0).to_string(), "between 1 and 1000");
    }
    if let Some(seeds) = &options.seeds
        && !(seeds.cell > 0.0 && seeds.cell.is_finite())
    {
        return wrong("the cell", seeds.cell.to_string(), "finite and above 0");
    }
    if options.level == Level::Fast && options.method != Method::Geodesic {
        return wrong("the level", "fast".to_owned(), "exact or windowed for a Euclidean method");
    }
    Ok(())
}

/// Fixed seeds as vertices of each unit.
fn seeds_by_unit(geometry: &Geometry, given: &FixedSeeds) -> Result<Vec<Vec<u32>>, ClusterError> {
    let mut place: Vec<Option<(u32, u32)>> = vec![None; geometry.gaussians];
    for (u, unit) in (0..).zip(&geometry.units) {
        for (v, &g) in (0..).zip(&unit.vertices.gaussian) {
            place[g as usize] = Some((u, v));
        }
    }
    let mut by_unit = vec![Vec::new(); geometry.units.len()];
    for (position, &gaussian) in given.gaussians.iter().enumerate() {
        let reason = match place.get(gaussian as usize) {
            Some(Some((u, v))) => {
                by_unit[*u as usize].push(*v);
                continue;
            }
            Some(None) => "has no finite position",
            None => "the scene does not have",
        };
        return Err(ClusterError::Seed { position, gaussian, reason });
    }
    match (0..)
        .zip(&geometry.units)
        .zip(&by_unit)
        .find(|((_, unit), seeds)| !unit.vertices.is_empty() && seeds.is_empty())
    {
        Some(((u, _), _)) => Err(ClusterError::NoSeed(u)),
        None => Ok(by_unit),
    }
}

/// Seconds by stage.
#[derive(Debug, Default)]
struct Clock {
    seconds: BTreeMap<&'static str, f64>,
}

impl Clock {
    fn time<T>(&mut self, stage: Stage, f: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let out = f();
        *self.seconds.entry(stage.name()).or_default() += start.elapsed().as_secs_f64();
        out
    }
}

fn cluster_unit(
    unit: &UnitGeometry,
    options: &ClusteringOptions,
    (sources, cell): (Vec<u32>, f64),
    objective: &mut Vec<f64>,
    clock: &mut Clock,
    tell: &mut dyn FnMut(Stage, f64) -> Result<(), ClusterError>,
) -> Result<(Vec<u32>, usize), ClusterError> {
    let n = unit.vertices.len();
    if n == 0 {
        return Ok((Vec::new(), 0));
    }
    let count = sources.len();
    let rows = &unit.features.rows;
    let feature_weight =
        if options.method == Method::Euclidean { 0.0 } else { options.compactness * options.compactness };
    let metric = Metric { cell, feature_weight };
    let window = if options.level == Level::Windowed { 2.0 * cell } else { f64::INFINITY };
    let mut centres: Vec<Centre> = sources
        .iter()
        .map(|&s| Centre { source: s, position: unit.vertices.position[s as usize], feature: rows[s as usize] })
        .collect();
    let mut assigner = GeodesicAssigner::new(&unit.graph, rows, metric, window);
    let most = if options.level == Level::Fast { FAST_ROUNDS } else { MAX_ROUNDS };
    let rounds = options.rounds.unwrap_or(most);
    let mut sums: Vec<f64> = Vec::new();
    let mut assignment = Assignment { label: Vec::new(), cost: Vec::new() };
    for round in 0..rounds {
        assignment = clock.time(Stage::Assignment, || match options.method {
            Method::Geodesic => Ok(assigner.assign(&centres)),
            _ => assign_straight(&unit.vertices.position, rows, metric, window, &centres),
        })?;
        sums.push(assignment.objective());
        tell(Stage::Assignment, (round + 1) as f64 / rounds as f64)?;
        let improved = match sums[..] {
            [.., before, now] => before - now >= MIN_IMPROVEMENT * before,
            _ => true,
        };
        if round + 1 == rounds || (options.rounds.is_none() && !improved) {
            break;
        }
        let next = clock.time(Stage::Assignment, || update(&unit.vertices, rows, &assignment.label, &centres));
        if next == centres {
            break;
        }
        centres = next;
        // Frees memory for the next round.
        assignment = Assignment { label: Vec::new(), cost: Vec::new() };
    }
    add_rounds(objective, &sums);
    drop(assigner);
    let mut label = assignment.label;
    let out = clock.time(Stage::Merge, || {
        if label.contains(&NONE) {
            // Components without a seed join the nearest cluster over the bridges.
            let mut distance: Vec<f64> = label.iter().map(|&l| if l == NONE { f64::INFINITY } else { 0.0 }).collect();
            fill_unlabelled(&unit.joined(), &mut distance, &mut label);
        }
        if options.merge {
            // Adaptive clusters differ in size by design, so small ones are kept.
            let share = if options.adaptive { MIN_SHARE / 4.0 } else { MIN_SHARE };
            let least = (share * n as f64 / count as f64) as usize;
            merge_pieces(&unit.joined(), rows, &unit.vertices.gaussian, &label, least.max(1), options.max_clusters)
        } else {
            (label, count)
        }
    });
    tell(Stage::Merge, 1.0)?;
    Ok(out)
}

/// Adds the objective of a unit for each round. A unit with fewer rounds keeps its last value.
fn add_rounds(total: &mut Vec<f64>, unit: &[f64]) {
    let Some(&unit_last) = unit.last() else { return };
    let total_last = total.last().copied().unwrap_or(0.0);
    total.resize(total.len().max(unit.len()), total_last);
    for (t, u) in total.iter_mut().zip(unit.iter().copied().chain(std::iter::repeat(unit_last))) {
        *t += u;
    }
}

/// Members of each label, as one list with offsets.
struct Members {
    offsets: Vec<usize>,
    list: Vec<u32>,
}

impl Members {
    fn of(label: impl Iterator<Item = Option<usize>> + Clone, count: usize) -> Self {
        let mut offsets = vec![0; count + 1];
        for l in label.clone().flatten() {
            offsets[l + 1] += 1;
        }
        for l in 0..count {
            offsets[l + 1] += offsets[l];
        }
        let mut next = offsets.clone();
        let mut list = vec![0; offsets[count]];
        for (v, l) in (0..).zip(label) {
            if let Some(l) = l {
                list[next[l]] = v;
                next[l] += 1;
            }
        }
        Self { offsets, list }
    }

    fn get(&self, l: usize) -> &[u32] {
        &self.list[self.offsets[l]..self.offsets[l + 1]]
    }
}

/// Mean position, mean feature, and the member nearest to the mean position (ties to the smaller scene-wide index).
fn summary(vertices: &Vertices, rows: &[Row], members: &[u32]) -> Option<(u32, [f64; 3], [f64; WIDTH])> {
    let share = 1.0 / members.len() as f64;
    let mut position = [0.0; 3];
    let mut feature = [0.0; WIDTH];
    for &v in members {
        for (sum, x) in position.iter_mut().zip(&vertices.position[v as usize]) {
            *sum += x * share;
        }
        for (sum, x) in feature.iter_mut().zip(&rows[v as usize]) {
            *sum += f64::from(*x) * share;
        }
    }
    let nearest = members.iter().copied().min_by(|&a, &b| {
        let d = |v: u32| distance_squared(&vertices.position[v as usize], &position);
        d(a).total_cmp(&d(b)).then(vertices.gaussian[a as usize].cmp(&vertices.gaussian[b as usize]))
    })?;
    Some((nearest, position, feature))
}

/// Updates the centres. A centre without members is unchanged.
fn update(vertices: &Vertices, rows: &[Row], label: &[u32], centres: &[Centre]) -> Vec<Centre> {
    let members = Members::of(label.iter().map(|&l| (l != NONE).then_some(l as usize)), centres.len());
    centres
        .par_iter()
        .enumerate()
        .map(|(j, old)| match summary(vertices, rows, members.get(j)) {
            Some((source, position, feature)) => Centre { source, position, feature: feature.map(|x| x as f32) },
            None => *old,
        })
        .collect()
}

impl Clustering {
    /// The clusters of given labels. `count` is the number of ids; `None` means the largest label plus one.
    ///
    /// # Errors
    /// [`ClusterError::Labels`] for a wrong number of labels, a label out of range, or a label in several base units.
    pub fn of_labels(geometry: &Geometry, mut labels: Vec<i32>, count: Option<usize>) -> Result<Self, ClusterError> {
        if labels.len() != geometry.gaussians {
            return Err(ClusterError::Labels(format!(
                "there are {} labels for {} Gaussians; use labels made from this scene",
                labels.len(),
                geometry.gaussians
            )));
        }
        let limit = labels.len().max(count.unwrap_or(0));
        if let Some((i, l)) = labels.iter().enumerate().find(|(_, l)| **l < -1 || **l >= limit as i32) {
            return Err(ClusterError::Labels(format!(
                "the label of Gaussian {i} is {l}; labels run from 0 to at most {}, and -1 means none",
                limit.saturating_sub(1)
            )));
        }
        let count = count.unwrap_or_else(|| labels.iter().map(|l| (l + 1) as usize).max().unwrap_or(0));
        let empty = Cluster { unit: 0, size: 0, centre: u32::MAX, position: [0.0; 3], feature: [0.0; WIDTH] };
        let mut clusters = vec![empty; count];
        for (u, unit) in (0..).zip(&geometry.units) {
            let of = |g: &u32| usize::try_from(labels[*g as usize]).ok();
            let members = Members::of(unit.vertices.gaussian.iter().map(of), count);
            let found: Vec<Option<Cluster>> = (0..count)
                .into_par_iter()
                .map(|l| {
                    let members = members.get(l);
                    let (v, position, feature) = summary(&unit.vertices, &unit.features.rows, members)?;
                    let centre = unit.vertices.gaussian[v as usize];
                    Some(Cluster { unit: u, size: members.len() as u32, centre, position, feature })
                })
                .collect();
            for (l, (cluster, found)) in clusters.iter_mut().zip(found).enumerate() {
                let Some(found) = found else { continue };
                if cluster.size > 0 {
                    return Err(ClusterError::Labels(format!(
                        "cluster {l} has members in base units {} and {u} (counted from 0); a cluster lies within one",
                        cluster.unit
                    )));
                }
                *cluster = found;
            }
        }
        let mut finite = vec![false; labels.len()];
        for unit in &geometry.units {
            unit.vertices.gaussian.iter().for_each(|&g| finite[g as usize] = true);
        }
        for (label, _) in labels.iter_mut().zip(&finite).filter(|(_, finite)| !**finite) {
            *label = -1;
        }
        let kinds = geometry.units.iter().map(|u| u.features.kind).collect();
        Ok(Self { labels, clusters, kinds })
    }
}

fn report(
    geometry: &Geometry,
    clustering: &Clustering,
    objective: Vec<f64>,
    cell: Vec<f64>,
    seconds: BTreeMap<&'static str, f64>,
) -> ClusteringReport {
    let sizes: Vec<f64> = clustering.clusters.iter().map(|c| f64::from(c.size)).collect();
    let count = sizes.len().max(1) as f64;
    let mean = sizes.iter().sum::<f64>() / count;
    let variance = sizes.iter().map(|s| (s - mean).powi(2)).sum::<f64>() / count;
    let (mut away, mut members, mut same, mut pairs) = (0.0, 0_u64, 0_u64, 0_u64);
    for unit in &geometry.units {
        let label = |v: u32| clustering.labels[unit.vertices.gaussian[v as usize] as usize];
        for (v, p) in (0..).zip(&unit.vertices.position) {
            if let Some(c) = usize::try_from(label(v)).ok().and_then(|l| clustering.clusters.get(l)) {
                away += distance_squared(p, &c.position).sqrt();
                members += 1;
            }
            for (w, _) in unit.graph.neighbours(v) {
                pairs += 1;
                same += u64::from(label(v) == label(w) && label(v) >= 0);
            }
        }
    }
    ClusteringReport {
        gaussians: geometry.gaussians,
        dropped: geometry.dropped,
        clusters: clustering.clusters.len(),
        mean_size: mean,
        size_cv: if mean > 0.0 { variance.sqrt() / mean } else { 0.0 },
        compactness: away / members.max(1) as f64,
        same_label_knn: same as f64 / pairs.max(1) as f64,
        objective,
        cell,
        seconds,
    }
}

#[cfg(test)]
mod tests;
