//! Assignment of Gaussians to cluster centres: the exact minimum of D over all centres in near-linear time.
//!
//! D(i, j) = (d(i, s_j) / S)² + m²·‖f_i − f_j‖². Here d is the length of the shortest path over the neighbour graph to the source
//! s_j of centre j. S is the voxel edge, and m is the weight of the features.
//!
//! Let U(i) be an upper bound of the smallest D at i, at first D of the graph-nearest source. It gives the radius
//! r(i) = S·√U(i), beyond which no source can win at i. The envelope is P(i) = max over k of (r(k) − d(i,k)). A search from
//! source j may stop at i if d_j(i) > P(i). Proof: let the shortest path from j to k pass i. Then
//! d_j(k) = d_j(i) + d(i,k) > P(i) + d(i,k) ≥ r(k), so D_j(k) > U(k).
//!
//! Any envelope that is pointwise at least P is valid. An envelope G with r ≤ G everywhere satisfies P ≤ G, because an
//! envelope falls no faster than the distance grows. So the first round starts with a constant G. All sources search up to
//! G, and the smallest D found is U. Where r exceeds G, the envelope rises and the affected searches continue. Most sources
//! do not move between rounds. Their searches are cached; only moved sources search again.

use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

use crate::features::{Row, distance_squared as feature_distance_squared};
use crate::neighbours::Graph;
use crate::shortest::{NONE, SearchPool, fill_unlabelled, nearest_source, raise_from, raise_to_envelope};

/// Slack on the envelope for the rounding of path lengths. Without it, tied points (lattices) would stay unlabelled.
const SLACK: f64 = 1.0 + 1e-12;

/// Number of searches per batch of results.
const BATCH: usize = 128;

/// Constant envelope of the first round, in cells. For m of about ½, most costs lie below its square.
const FIRST_REACH: f64 = 0.8;

/// If more than one in this many vertices needs a higher envelope, all searches restart in batches.
const FEW: usize = 8;

/// Extra factor on a rising envelope, to avoid another rise in the next round.
const MARGIN: f64 = 1.05;

/// Capacity of the search cache: entries per vertex of the graph.
const MAX_CACHED: usize = 12;

/// The centre of a cluster.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Centre {
    /// Source vertex of the distances.
    pub source: u32,
    /// Mean position of the members, in the scene frame.
    pub position: [f64; 3],
    /// Mean feature of the members.
    pub feature: Row,
}

/// The clustering distance D.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Metric {
    /// S, in the scene's length unit.
    pub cell: f64,
    /// m², the weight of the squared feature distance.
    pub feature_weight: f64,
}

impl Metric {
    /// D from a path length (or straight distance) and two features.
    #[inline]
    #[must_use]
    pub fn cost(&self, length: f64, a: &Row, b: &Row) -> f64 {
        let geometric = length / self.cell;
        let features = if self.feature_weight == 0.0 { 0.0 } else { feature_distance_squared(a, b) };
        geometric * geometric + self.feature_weight * features
    }

    /// The distance beyond which D exceeds `cost` for all features.
    #[must_use]
    pub fn radius(&self, cost: f64) -> f64 {
        self.cell * cost.sqrt()
    }
}

/// The centre of each vertex.
#[derive(Debug, Clone, PartialEq)]
pub struct Assignment {
    /// Index of the centre of each vertex; [`NONE`] where no source is reachable.
    pub label: Vec<u32>,
    /// D to the centre; infinite without one.
    pub cost: Vec<f64>,
}

impl Assignment {
    fn none(vertices: usize) -> Self {
        Self { label: vec![NONE; vertices], cost: vec![f64::INFINITY; vertices] }
    }

    /// Σ D over the labelled vertices, summed in fixed blocks. The sum does not depend on the number of threads.
    #[must_use]
    pub fn objective(&self) -> f64 {
        let blocks: Vec<f64> =
            self.cost.par_chunks(4096).map(|c| c.iter().filter(|x| x.is_finite()).sum::<f64>()).collect();
        blocks.iter().sum()
    }
}

/// Number of consecutive vertices that share a lock.
const STRIPE: usize = 64;

/// A concurrent minimum of (D, index) for each vertex. The result does not depend on the order of updates.
struct ConcurrentMinimum {
    label: Vec<AtomicU32>,
    cost: Vec<AtomicU64>,
    stripes: Vec<Mutex<()>>,
}

impl ConcurrentMinimum {
    fn to(assignment: Assignment) -> Self {
        let stripes = (0..assignment.label.len().div_ceil(STRIPE)).map(|_| Mutex::new(())).collect();
        Self {
            label: assignment.label.into_iter().map(AtomicU32::new).collect(),
            cost: assignment.cost.into_iter().map(|c| AtomicU64::new(c.to_bits())).collect(),
            stripes,
        }
    }

    #[inline]
    fn offer(&self, v: u32, cost: f64, label: u32) {
        let at = v as usize;
        // Costs only fall, so a worse cost stays worse.
        if cost > f64::from_bits(self.cost[at].load(Ordering::Relaxed)) {
            return;
        }
        let _held = self.stripes[at / STRIPE].lock().unwrap_or_else(PoisonError::into_inner);
        let best = f64::from_bits(self.cost[at].load(Ordering::Relaxed));
        if (cost, label) < (best, self.label[at].load(Ordering::Relaxed)) {
            self.cost[at].store(cost.to_bits(), Ordering::Relaxed);
            self.label[at].store(label, Ordering::Relaxed);
        }
    }

    fn into_assignment(self) -> Assignment {
        Assignment {
            label: self.label.into_iter().map(AtomicU32::into_inner).collect(),
            cost: self.cost.into_iter().map(|c| f64::from_bits(c.into_inner())).collect(),
        }
    }
}

/// A vertex that a search reached, with its distance. Packed to twelve bytes, because each vertex has several.
#[derive(Debug, Clone, Copy)]
#[repr(C, packed(4))]
struct ReachedVertex {
    vertex: u32,
    distance: f64,
}

/// Copies the entries into an allocation of exact size.
fn packed(reached: &[(u32, f64)]) -> Vec<ReachedVertex> {
    reached.iter().map(|&(vertex, distance)| ReachedVertex { vertex, distance }).collect()
}

/// Searches of the last round, and the envelope for which they are complete.
#[derive(Debug)]
struct SearchCache {
    sources: Vec<u32>,
    reach: Vec<Vec<ReachedVertex>>,
    envelope: Vec<f64>,
}

/// Assigns vertices to centres by D over the graph, in rounds.
#[derive(Debug)]
pub struct GeodesicAssigner<'a> {
    graph: &'a Graph,
    rows: &'a [Row],
    metric: Metric,
    /// Largest distance of a considered source, except for the nearest one. Infinite for the exact assignment.
    window: f64,
    pool: SearchPool,
    kept: Option<SearchCache>,
    /// Number of vertices settled by all searches so far.
    settled: u64,
}

impl<'a> GeodesicAssigner<'a> {
    /// An assigner over a graph with one feature row per vertex. `window` is in the scene's length unit.
    #[must_use]
    pub fn new(graph: &'a Graph, rows: &'a [Row], metric: Metric, window: f64) -> Self {
        Self { graph, rows, metric, window, pool: SearchPool::default(), kept: None, settled: 0 }
    }

    /// Number of vertices settled by all searches so far.
    #[must_use]
    pub fn settled(&self) -> u64 {
        self.settled
    }

    /// The centre of smallest D for each vertex. Ties go to the smaller index.
    ///
    /// Without a window, the result is the exact minimum over all centres. With a window, it is exact over the sources in
    /// the window, or else the graph-nearest source.
    pub fn assign(&mut self, centres: &[Centre]) -> Assignment {
        if self.window.is_finite() {
            return self.assign_windowed(centres);
        }
        let kept = match self.kept.take() {
            Some(kept) if kept.sources.len() == centres.len() => kept,
            _ => SearchCache {
                sources: vec![NONE; centres.len()],
                reach: vec![Vec::new(); centres.len()],
                envelope: vec![FIRST_REACH * self.metric.cell; self.graph.len()],
            },
        };
        self.assign_from(centres, kept)
    }

    fn assign_windowed(&mut self, centres: &[Centre]) -> Assignment {
        let sources: Vec<u32> = centres.iter().map(|c| c.source).collect();
        let (distance, label) = nearest_source(self.graph, &sources);
        let cost: Vec<f64> = distance
            .par_iter()
            .zip(&label)
            .zip(self.rows)
            .map(|((&d, &l), row)| {
                centres.get(l as usize).map_or(f64::INFINITY, |c| self.metric.cost(d, row, &c.feature))
            })
            .collect();
        let mut envelope: Vec<f64> =
            cost.iter().map(|&c| if c.is_finite() { self.metric.radius(c) } else { 0.0 }).collect();
        raise_to_envelope(self.graph, &mut envelope);
        let mut kept = SearchCache { sources, reach: vec![Vec::new(); centres.len()], envelope };
        self.search_in_batches(centres, &mut kept, Assignment { label, cost }).0
    }

    /// Searches from all sources again, in batches. Far searches (large m) are dropped to limit the memory. Returns whether
    /// all searches were kept.
    fn search_in_batches(
        &mut self,
        centres: &[Centre],
        kept: &mut SearchCache,
        mut assignment: Assignment,
    ) -> (Assignment, bool) {
        let all: Vec<usize> = (0..centres.len()).collect();
        kept.reach.iter_mut().for_each(|r| *r = Vec::new());
        let mut held = Some(0);
        for batch in all.chunks(BATCH) {
            self.search(batch, &kept.sources, &kept.envelope, &mut kept.reach);
            assignment = self.collect(centres, &kept.reach, batch, assignment);
            let more: usize = batch.iter().map(|&j| kept.reach[j].len()).sum();
            held = held.map(|h| h + more).filter(|&h| h <= MAX_CACHED * self.graph.len());
            if held.is_none() {
                kept.reach.iter_mut().for_each(|r| *r = Vec::new());
            }
        }
        (assignment, held.is_some())
    }

    fn assign_from(&mut self, centres: &[Centre], mut kept: SearchCache) -> Assignment {
        let moved: Vec<usize> = (0..centres.len()).filter(|&j| kept.sources[j] != centres[j].source).collect();
        for &j in &moved {
            kept.sources[j] = centres[j].source;
        }
        self.search(&moved, &kept.sources, &kept.envelope, &mut kept.reach);
        let all: Vec<usize> = (0..centres.len()).collect();
        let mut assignment = self.collect(centres, &kept.reach, &all, Assignment::none(self.graph.len()));

        // Unreached vertices get an upper bound from the label of a neighbour, over the path through it.
        let mut lost: Vec<(u32, f64)> = Vec::new();
        if assignment.label.contains(&NONE) {
            let mut label = assignment.label.clone();
            let mut distance = self.distances(&kept.reach, &label);
            fill_unlabelled(self.graph, &mut distance, &mut label);
            for v in (0..).take(label.len()).filter(|&v| assignment.label[v as usize] == NONE) {
                let at = v as usize;
                if let Some(c) = centres.get(label[at] as usize) {
                    lost.push((v, self.metric.cost(distance[at], &self.rows[at], &c.feature)));
                }
            }
        }
        let higher =
            |&(v, bound): &(u32, f64)| bound.is_finite() && self.metric.radius(bound) > kept.envelope[v as usize];
        let mut raised: Vec<(u32, f64)> = (0..assignment.cost.len() as u32)
            .into_par_iter()
            .with_min_len(4096)
            .map(|v| (v, assignment.cost[v as usize]))
            .filter(higher)
            .collect();
        raised.extend(lost.into_iter().filter(higher));
        if !raised.is_empty() {
            let before = kept.envelope.clone();
            let many = raised.len() > self.graph.len() / FEW;
            let margin = if many { 1.0 } else { MARGIN };
            for &(v, bound) in &raised {
                kept.envelope[v as usize] = margin * self.metric.radius(bound);
            }
            let raised: Vec<u32> = raised.into_iter().map(|r| r.0).collect();
            raise_from(self.graph, &mut kept.envelope, &raised);
            if many {
                drop(before);
                let (assignment, complete) = self.search_in_batches(centres, &mut kept, assignment);
                self.kept = complete.then_some(kept);
                return assignment;
            }
            let further = self.continue_searches(&mut kept, &before);
            drop(before);
            assignment = self.collect(centres, &kept.reach, &further, assignment);
        }
        let held: usize = kept.reach.iter().map(Vec::len).sum();
        self.kept = (held <= MAX_CACHED * self.graph.len()).then_some(kept);
        assignment
    }

    /// Continues the searches that the risen envelope lets advance. Returns their indices.
    fn continue_searches(&mut self, kept: &mut SearchCache, before: &[f64]) -> Vec<usize> {
        let SearchCache { reach, envelope, .. } = kept;
        let higher = |v: u32| envelope[v as usize] > before[v as usize];
        let mut doorstep = vec![false; before.len()];
        for v in (0..).take(before.len()).filter(|&v| higher(v)) {
            self.graph.neighbours(v).for_each(|(w, _)| doorstep[w as usize] = true);
        }
        let enters = |d: f64, w: u32| higher(w) && d > before[w as usize] * SLACK && d <= envelope[w as usize] * SLACK;
        let settled: Vec<Option<usize>> = reach
            .par_iter_mut()
            .map(|reached| {
                let stopped = reached
                    .iter()
                    .filter(|r| doorstep[r.vertex as usize])
                    .any(|r| self.graph.neighbours(r.vertex).any(|(w, length)| enters(r.distance + length, w)));
                stopped.then(|| {
                    let had = reached.len();
                    *reached = self.pool.with(|s| {
                        let before = reached.iter().map(|r| (r.vertex, r.distance));
                        let within = |v: u32| envelope[v as usize] * SLACK;
                        packed(s.reach_further(self.graph, before, |v| doorstep[v as usize], within))
                    });
                    reached.len() - had
                })
            })
            .collect();
        self.settled += settled.iter().flatten().sum::<usize>() as u64;
        (0..settled.len()).filter(|&j| settled[j].is_some()).collect()
    }

    fn search(&mut self, which: &[usize], sources: &[u32], envelope: &[f64], reach: &mut [Vec<ReachedVertex>]) {
        which.iter().for_each(|&j| reach[j] = Vec::new());
        let found: Vec<Vec<ReachedVertex>> = which
            .par_iter()
            .map(|&j| {
                let within = |v: u32| (envelope[v as usize] * SLACK).min(self.window);
                self.pool.with(|s| packed(s.reach(self.graph, sources[j], within)))
            })
            .collect();
        for (&j, found) in which.iter().zip(found) {
            self.settled += found.len() as u64;
            reach[j] = found;
        }
    }

    /// Updates the minimum with every pair that the given searches reached.
    fn collect(
        &self,
        centres: &[Centre],
        reach: &[Vec<ReachedVertex>],
        which: &[usize],
        assignment: Assignment,
    ) -> Assignment {
        let offers = ConcurrentMinimum::to(assignment);
        which.par_iter().for_each(|&j| {
            let feature = &centres[j].feature;
            for r in &reach[j] {
                let cost = self.metric.cost(r.distance, &self.rows[r.vertex as usize], feature);
                offers.offer(r.vertex, cost, j as u32);
            }
        });
        offers.into_assignment()
    }

    /// Path lengths to the assigned centres; infinite without one.
    fn distances(&self, reach: &[Vec<ReachedVertex>], label: &[u32]) -> Vec<f64> {
        let mut distance = vec![f64::INFINITY; label.len()];
        for (j, reach) in (0..).zip(reach) {
            for r in reach {
                if label[r.vertex as usize] == j {
                    distance[r.vertex as usize] = r.distance;
                }
            }
        }
        distance
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::features::WIDTH;
    use crate::neighbours::{Edge, neighbour_graph};
    use crate::shortest::Search;
    use crate::vertices::Vertices;
    use proptest::prelude::*;
    use rand::RngExt;
    use sg_scene::synthetic::{generator, random_points_f64};

    fn offer(out: &mut Assignment, v: u32, cost: f64, label: u32) {
        let at = v as usize;
        if (cost, label) < (out.cost[at], out.label[at]) {
            (out.cost[at], out.label[at]) = (cost, label);
        }
    }

    /// The definition: the least D over all centres, by a full search from each.
    fn brute(graph: &Graph, rows: &[Row], metric: Metric, centres: &[Centre]) -> Assignment {
        let mut out = Assignment::none(graph.len());
        let mut search = Search::default();
        for (j, c) in (0..).zip(centres) {
            for &(v, d) in search.reach(graph, c.source, |_| f64::INFINITY) {
                offer(&mut out, v, metric.cost(d, &rows[v as usize], &c.feature), j);
            }
        }
        out
    }

    fn random_rows(n: usize, levels: u32, seed: u64) -> Vec<Row> {
        let mut r = generator(seed);
        (0..n)
            .map(|_| {
                let mut row = [0.0; WIDTH];
                for x in &mut row[..4] {
                    *x = r.random_range(0..levels) as f32 / levels as f32;
                }
                row
            })
            .collect()
    }

    fn centres(rows: &[Row], sources: &[u32]) -> Vec<Centre> {
        sources.iter().map(|&s| Centre { source: s, position: [0.0; 3], feature: rows[s as usize] }).collect()
    }

    /// Some rounds in which a few sources move and all features change a little.
    fn rounds(rows: &[Row], sources: &[u32], moves: &[(usize, u32)], n: usize) -> Vec<Vec<Centre>> {
        let mut sources = sources.to_vec();
        let mut all = vec![centres(rows, &sources)];
        for (round, chunk) in moves.chunks(3).enumerate() {
            for &(j, v) in chunk {
                let j = j % sources.len();
                sources[j] = v % n as u32;
            }
            let mut next = centres(rows, &sources);
            for (j, c) in next.iter_mut().enumerate() {
                c.feature[round % 4] += 0.07 * (j % 5) as f32;
            }
            all.push(next);
        }
        all
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(200))]
        #[test]
        fn every_round_equals_the_full_search(
            n in 2..40_usize,
            edges in proptest::collection::vec((0..40_u32, 0..40_u32, 0..6_u8), 1..120),
            picks in proptest::collection::vec(0..40_u32, 1..8),
            moves in proptest::collection::vec((0..8_usize, 0..40_u32), 0..12),
            levels in 1..4_u32, weight in 0.0..9.0_f64, seed in 0..50_u64,
        ) {
            let graph = Graph::from_edges(n, edges.iter().map(|&(a, b, l)| Edge {
                a: a % n as u32, b: b % n as u32, length: f64::from(l) * 0.1,
            }));
            let rows = random_rows(n, levels, seed);
            let metric = Metric { cell: 0.3, feature_weight: weight };
            let sources: Vec<u32> = picks.iter().map(|p| p % n as u32).collect();
            let mut assigner = GeodesicAssigner::new(&graph, &rows, metric, f64::INFINITY);
            for centres in rounds(&rows, &sources, &moves, n) {
                prop_assert_eq!(assigner.assign(&centres), brute(&graph, &rows, metric, &centres));
            }
        }

        #[test]
        fn a_window_is_exact_inside_and_nearest_outside(
            n in 30..200_usize, seed in 0..50_u64, window in 0.05..0.6_f64
        ) {
            let v = Vertices::ordered((0..).zip(random_points_f64(n, seed)).collect());
            let graph = neighbour_graph(&v, 6).unwrap();
            let rows = random_rows(n, 3, seed);
            let metric = Metric { cell: 0.2, feature_weight: 4.0 };
            let centres = centres(&rows, &[0, n as u32 / 3, n as u32 / 2]);
            let got = GeodesicAssigner::new(&graph, &rows, metric, window).assign(&centres);
            let sources: Vec<u32> = centres.iter().map(|c| c.source).collect();
            let (_, nearest) = nearest_source(&graph, &sources);
            let mut want = Assignment::none(n);
            let mut search = Search::default();
            for (j, c) in (0..).zip(&centres) {
                for &(v, d) in search.reach(&graph, c.source, |_| f64::INFINITY) {
                    if d <= window || nearest[v as usize] == j {
                        offer(&mut want, v, metric.cost(d, &rows[v as usize], &c.feature), j);
                    }
                }
            }
            prop_assert_eq!(got.label, want.label);
        }
    }

    #[test]
    fn a_point_cloud_equals_the_full_search_over_ten_rounds() {
        let n = 4000;
        let v = Vertices::ordered((0..).zip(random_points_f64(n, 1)).collect());
        let graph = neighbour_graph(&v, 10).unwrap();
        let rows = random_rows(n, 1000, 2);
        for weight in [0.0625, 0.25, 1.0, 16.0] {
            let metric = Metric { cell: 0.15, feature_weight: weight };
            let mut r = generator(3);
            let mut sources: Vec<u32> = (0..120).map(|_| r.random_range(0..n as u32)).collect();
            let mut assigner = GeodesicAssigner::new(&graph, &rows, metric, f64::INFINITY);
            let mut work = Vec::new();
            for round in 0..10 {
                let mut c = centres(&rows, &sources);
                for c in &mut c {
                    c.feature[round % 4] *= 0.9;
                }
                let before = assigner.settled();
                assert_eq!(assigner.assign(&c), brute(&graph, &rows, metric, &c), "m² = {weight}, round {round}");
                work.push((assigner.settled() - before) as f64 / n as f64);
                for _ in 0..12 {
                    let j = r.random_range(0..sources.len());
                    sources[j] = graph.neighbours(sources[j]).next().map_or(sources[j], |n| n.0);
                }
            }
            println!("m² = {weight}: vertices settled per vertex and round {work:.2?}");
        }
    }

    #[test]
    fn every_point_of_an_equal_feature_lattice_is_labelled() {
        let points: Vec<[f64; 3]> =
            (0..1331).map(|i| [i % 11, i / 11 % 11, i / 121].map(|c| 0.1 * f64::from(c))).collect();
        let v = Vertices::ordered((0..).zip(points).collect());
        let graph = neighbour_graph(&v, 10).unwrap();
        let rows = vec![[0.25; WIDTH]; v.len()];
        let metric = Metric { cell: 0.3, feature_weight: 0.25 };
        let centres = centres(&rows, &(0..40).map(|i| i * 33).collect::<Vec<_>>());
        let got = GeodesicAssigner::new(&graph, &rows, metric, f64::INFINITY).assign(&centres);
        assert!(!got.label.contains(&NONE));
        assert_eq!(got, brute(&graph, &rows, metric, &centres));
    }

    #[test]
    fn the_same_bits_for_any_number_of_threads() {
        let n = 3000;
        let v = Vertices::ordered((0..).zip(random_points_f64(n, 4)).collect());
        let graph = neighbour_graph(&v, 10).unwrap();
        let rows = random_rows(n, 7, 5);
        let metric = Metric { cell: 0.1, feature_weight: 1.0 };
        let centres = centres(&rows, &(0..300).map(|i| i * 10).collect::<Vec<_>>());
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let a = GeodesicAssigner::new(&graph, &rows, metric, f64::INFINITY).assign(&centres);
                (a.objective().to_bits(), a)
            })
        };
        assert_eq!(run(1), run(3));
    }
}
