//! Shortest paths over a neighbour graph: to the nearest source, within a bound, and the envelope of the bound.
//!
//! Path lengths are f64 sums from the source outwards. Rounded addition is monotone, so all variants of the search find the
//! same bits for the same pair of vertices.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::sync::Mutex;

use rayon::prelude::*;

use crate::neighbours::{Adjacency, Graph};

/// Marks a missing vertex or label.
pub const NONE: u32 = u32::MAX;

/// A queue entry as one integer: the bits of the distance, then the ids. An integer compares faster than a tuple.
fn entry(distance: f64, j: u32, v: u32) -> u128 {
    u128::from(distance.to_bits()) << 64 | u128::from(j) << 32 | u128::from(v)
}

/// Distance, j and v of an entry.
fn parts(entry: u128) -> (f64, u32, u32) {
    (f64::from_bits((entry >> 64) as u64), (entry >> 32) as u32, entry as u32)
}

/// Distance and index of the nearest source of every vertex; infinity and [`NONE`] for unreachable vertices.
///
/// Ties go to the first source in the slice.
#[must_use]
pub fn nearest_source(graph: &impl Adjacency, sources: &[u32]) -> (Vec<f64>, Vec<u32>) {
    let mut distance = vec![f64::INFINITY; graph.vertices()];
    let mut label = vec![NONE; graph.vertices()];
    let mut heap = BinaryHeap::new();
    for (j, &v) in (0..).zip(sources) {
        if label[v as usize] == NONE {
            distance[v as usize] = 0.0;
            label[v as usize] = j;
            heap.push(Reverse(entry(0.0, j, v)));
        }
    }
    spread(graph, &mut distance, &mut label, heap);
    (distance, label)
}

/// Propagates (distance, label) from labelled to unlabelled vertices. Labelled vertices are unchanged.
pub fn fill_unlabelled(graph: &impl Adjacency, distance: &mut [f64], label: &mut [u32]) {
    let mut heap = BinaryHeap::new();
    let empty: Vec<u32> = (0..).zip(&*label).filter(|(_, l)| **l == NONE).map(|(v, _)| v).collect();
    for &v in &empty {
        for (w, length) in graph.around(v) {
            let through = (distance[w as usize] + length, label[w as usize]);
            if through.1 != NONE
                && empty.binary_search(&w).is_err()
                && through < (distance[v as usize], label[v as usize])
            {
                (distance[v as usize], label[v as usize]) = through;
            }
        }
        if label[v as usize] != NONE {
            heap.push(Reverse(entry(distance[v as usize], label[v as usize], v)));
        }
    }
    spread(graph, distance, label, heap);
}

fn spread(graph: &impl Adjacency, distance: &mut [f64], label: &mut [u32], mut heap: BinaryHeap<Reverse<u128>>) {
    while let Some(Reverse(first)) = heap.pop() {
        let (d, j, v) = parts(first);
        if (d, j) != (distance[v as usize], label[v as usize]) {
            continue;
        }
        for (w, length) in graph.around(v) {
            let through = (d + length, j);
            if through < (distance[w as usize], label[w as usize]) {
                (distance[w as usize], label[w as usize]) = through;
                heap.push(Reverse(entry(through.0, j, w)));
            }
        }
    }
}

/// Raises `radius` to its envelope P(i) = max over k of (r(k) − d(i,k)).
///
/// A seed farther than P(i) from `i` has no effect on `i`, nor on vertices reached through `i`.
pub fn raise_to_envelope(graph: &Graph, radius: &mut [f64]) {
    let lifting: Vec<u32> = (0..graph.len() as u32)
        .into_par_iter()
        .with_min_len(4096)
        .filter(|&v| graph.neighbours(v).any(|(w, length)| radius[v as usize] - length > radius[w as usize]))
        .collect();
    raise_from(graph, radius, &lifting);
}

/// [`raise_to_envelope`] from the given vertices only. All other entries of `radius` must form an envelope.
pub fn raise_from(graph: &Graph, radius: &mut [f64], lifting: &[u32]) {
    let mut heap: BinaryHeap<u128> = lifting.iter().map(|&v| entry(radius[v as usize], 0, v)).collect();
    while let Some(first) = heap.pop() {
        let (r, _, v) = parts(first);
        if r < radius[v as usize] {
            continue;
        }
        for (w, length) in graph.neighbours(v) {
            if r - length > radius[w as usize] {
                radius[w as usize] = r - length;
                heap.push(entry(r - length, 0, w));
            }
        }
    }
}

/// Reusable memory of a search.
#[derive(Debug, Default)]
pub struct Search {
    /// Entries of a vertex are valid if its turn is that of this search.
    distance: Vec<f64>,
    turns: Vec<u32>,
    turn: u32,
    heap: BinaryHeap<Reverse<u128>>,
    reached: Vec<(u32, f64)>,
}

impl Search {
    /// Turns of this search: `turn` for found vertices and `turn + 1` for given ones. All other turns are older.
    fn start(&mut self, vertices: usize) {
        if self.turns.len() != vertices || self.turn >= u32::MAX - 3 {
            self.distance = vec![0.0; vertices];
            self.turns = vec![0; vertices];
            self.turn = 0;
        }
        self.turn += 2;
        self.heap.clear();
        self.reached.clear();
    }

    /// Vertices reachable from `source`, with distances, in settling order. The source itself is always reached.
    ///
    /// The search continues only through vertices with a distance of at most `bound(vertex)`.
    pub fn reach(&mut self, graph: &impl Adjacency, source: u32, bound: impl Fn(u32) -> f64) -> &[(u32, f64)] {
        self.start(graph.vertices());
        self.offer(source, 0.0, |_| f64::INFINITY);
        self.run(graph, bound);
        &self.reached
    }

    /// Continues a search after a rise of the bound. `before` is the result for the old bound.
    ///
    /// Returns the result of [`Search::reach`] for the new bound, in another order. `frontier` selects the vertices that may
    /// have a neighbour with a higher bound.
    pub fn reach_further(
        &mut self,
        graph: &impl Adjacency,
        before: impl Iterator<Item = (u32, f64)>,
        frontier: impl Fn(u32) -> bool,
        bound: impl Fn(u32) -> f64,
    ) -> &[(u32, f64)] {
        self.start(graph.vertices());
        self.reached.extend(before);
        let had = self.reached.len();
        for &(v, distance) in &self.reached {
            self.distance[v as usize] = distance;
            self.turns[v as usize] = self.turn + 1;
        }
        for i in 0..had {
            let (v, d) = self.reached[i];
            if frontier(v) {
                for (w, length) in graph.around(v) {
                    self.offer(w, d + length, &bound);
                }
            }
        }
        self.run(graph, bound);
        // A path through new vertices may be shorter for a vertex of the old result.
        for (v, d) in &mut self.reached[..had] {
            *d = self.distance[*v as usize];
        }
        &self.reached
    }

    fn run(&mut self, graph: &impl Adjacency, bound: impl Fn(u32) -> f64) {
        while let Some(Reverse(first)) = self.heap.pop() {
            let (d, _, v) = parts(first);
            if d > self.distance[v as usize] {
                continue;
            }
            if self.turns[v as usize] == self.turn {
                self.reached.push((v, d));
            }
            for (w, length) in graph.around(v) {
                self.offer(w, d + length, &bound);
            }
        }
    }

    #[inline]
    fn offer(&mut self, v: u32, distance: f64, bound: impl Fn(u32) -> f64) {
        // Most candidates are no shorter than the known distance. Only the others need the bound.
        let at = v as usize;
        let known = self.turns[at] >= self.turn;
        if (known && distance >= self.distance[at]) || distance > bound(v) {
            return;
        }
        self.distance[at] = distance;
        if !known {
            self.turns[at] = self.turn;
        }
        self.heap.push(Reverse(entry(distance, 0, v)));
    }
}

/// A pool of [`Search`]es for threads. Its size is the largest number of concurrent searches.
#[derive(Debug, Default)]
pub struct SearchPool(Mutex<Vec<Search>>);

impl SearchPool {
    /// Runs `f` with a search of the pool.
    pub fn with<T>(&self, f: impl FnOnce(&mut Search) -> T) -> T {
        let lent = match self.0.lock() {
            Ok(mut idle) => idle.pop(),
            Err(_) => None,
        };
        let mut search = lent.unwrap_or_default();
        let out = f(&mut search);
        if let Ok(mut idle) = self.0.lock() {
            idle.push(search);
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::neighbours::Edge;
    use proptest::prelude::*;

    /// Random graphs with short integer lengths, so that ties and zero edges are common.
    fn graphs() -> impl Strategy<Value = Graph> {
        (2..30_usize).prop_flat_map(|n| {
            proptest::collection::vec((0..n as u32, 0..n as u32, 0..6_u8), 0..3 * n).prop_map(move |edges| {
                Graph::from_edges(n, edges.into_iter().map(|(a, b, l)| Edge { a, b, length: f64::from(l) }))
            })
        })
    }

    fn all_distances(graph: &Graph) -> Vec<Vec<f64>> {
        let n = graph.len();
        let mut d = vec![vec![f64::INFINITY; n]; n];
        for (i, row) in d.iter_mut().enumerate() {
            row[i] = 0.0;
        }
        for e in graph.edges() {
            d[e.a as usize][e.b as usize] = e.length;
            d[e.b as usize][e.a as usize] = e.length;
        }
        for k in 0..n {
            for i in 0..n {
                for j in 0..n {
                    d[i][j] = d[i][j].min(d[i][k] + d[k][j]);
                }
            }
        }
        d
    }

    proptest! {
        #[test]
        fn searches_agree_with_all_pairs(graph in graphs(), picks in proptest::collection::vec(0..30_usize, 1..5)) {
            let n = graph.len();
            let d = all_distances(&graph);
            let sources: Vec<u32> = picks.iter().map(|p| (p % n) as u32).collect();
            let (distance, label) = nearest_source(&graph, &sources);
            let mut search = Search::default();
            for v in 0..n {
                let best = (0..).zip(&sources).map(|(j, &s)| (d[s as usize][v], j)).min_by(|a, b| a.partial_cmp(b).unwrap());
                let best = best.unwrap();
                if best.0.is_finite() {
                    prop_assert_eq!((distance[v], label[v]), best);
                } else {
                    prop_assert_eq!((distance[v], label[v]), (f64::INFINITY, NONE));
                }
                let mut all = search.reach(&graph, v as u32, |_| f64::INFINITY).to_vec();
                all.sort_unstable_by_key(|a| a.0);
                let want: Vec<(u32, f64)> = (0..).zip(&d[v]).filter(|(_, d)| d.is_finite()).map(|(w, &d)| (w, d)).collect();
                prop_assert_eq!(all, want);
            }
        }

        #[test]
        fn the_envelope_is_the_maximum_over_all_vertices(graph in graphs(), seed in 0..1000_u32) {
            let d = all_distances(&graph);
            let r: Vec<f64> = (0..graph.len() as u32).map(|i| f64::from((i * 7919 + seed * 31) % 13)).collect();
            let mut p = r.clone();
            raise_to_envelope(&graph, &mut p);
            for i in 0..graph.len() {
                let want = (0..graph.len()).map(|k| r[k] - d[i][k]).fold(f64::NEG_INFINITY, f64::max);
                prop_assert_eq!(p[i], want);
            }
        }

        #[test]
        fn a_continued_search_equals_a_new_search(graph in graphs(), low in 0..8_u32, source in 0..30_u32) {
            let source = source % graph.len() as u32;
            let first = |v: u32| f64::from((v * 31 + low * 17) % 7);
            let second = |v: u32| first(v) + f64::from((v * 13 + low) % 4);
            let mut search = Search::default();
            let before = search.reach(&graph, source, first).to_vec();
            let frontier = |v| graph.neighbours(v).any(|(w, _)| second(w) > first(w));
            let mut continued = search.reach_further(&graph, before.into_iter(), frontier, second).to_vec();
            let mut anew = search.reach(&graph, source, second).to_vec();
            continued.sort_unstable_by_key(|r| r.0);
            anew.sort_unstable_by_key(|r| r.0);
            prop_assert_eq!(continued, anew);
        }

        #[test]
        fn filling_reaches_every_vertex_of_a_labelled_component(graph in graphs()) {
            let (component, _) = graph.components();
            let (mut distance, mut label) = nearest_source(&graph, &[0]);
            for v in (1..graph.len()).step_by(2) {
                (distance[v], label[v]) = (f64::INFINITY, NONE);
            }
            fill_unlabelled(&graph, &mut distance, &mut label);
            let all = all_distances(&graph);
            for v in 0..graph.len() {
                prop_assert_eq!(label[v] != NONE, component[v] == component[0]);
                prop_assert!(distance[v] >= all[0][v]);
            }
        }
    }
}
