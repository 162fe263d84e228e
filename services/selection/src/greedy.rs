//! The `fast` level: one greedy pass that grows all clusters at once (as SNIC does on pixels).
//!
//! Whichever vertex is nearest in D to a growing cluster joins it, and the cluster's mean feature follows. Path lengths
//! are measured inside the cluster, so clusters are connected by construction; the result is a few percent worse in the
//! objective than the exact assignment.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::assignment::{Assignment, Centre, Metric};
use crate::features::{Row, WIDTH};
use crate::neighbours::Graph;
use crate::shortest::NONE;

/// Grows one cluster from each centre's source. The cost of a vertex is D to its cluster's final mean feature, with the
/// length of the path it was reached by.
#[must_use]
pub fn grow(graph: &Graph, rows: &[Row], metric: Metric, centres: &[Centre]) -> Assignment {
    let n = graph.len();
    let mut label = vec![NONE; n];
    let mut length = vec![f64::INFINITY; n];
    let mut sums = vec![[0.0_f64; WIDTH]; centres.len()];
    let mut sizes = vec![0.0_f64; centres.len()];
    let mut means: Vec<Row> = centres.iter().map(|c| c.feature).collect();
    // Candidates: (bits of D, cluster, vertex, bits of the path length).
    let mut heap: BinaryHeap<Reverse<(u64, u32, u32, u64)>> = BinaryHeap::new();
    for (j, c) in (0..).zip(centres) {
        heap.push(Reverse((0, j, c.source, 0)));
    }
    while let Some(Reverse((_, j, v, bits))) = heap.pop() {
        let at = v as usize;
        if label[at] != NONE {
            continue;
        }
        let own = j as usize;
        label[at] = j;
        length[at] = f64::from_bits(bits);
        sizes[own] += 1.0;
        for c in 0..WIDTH {
            sums[own][c] += f64::from(rows[at][c]);
            means[own][c] = (sums[own][c] / sizes[own]) as f32;
        }
        for (w, step) in graph.neighbours(v) {
            if label[w as usize] == NONE {
                let d = length[at] + step;
                let cost = metric.cost(d, &rows[w as usize], &means[own]);
                heap.push(Reverse((cost.to_bits(), j, w, d.to_bits())));
            }
        }
    }
    let cost = (0..n)
        .map(|v| means.get(label[v] as usize).map_or(f64::INFINITY, |m| metric.cost(length[v], &rows[v], m)))
        .collect();
    Assignment { label, cost }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::neighbours::{Edge, neighbour_graph};
    use crate::test_scenes::random_points_f64;
    use crate::vertices::Vertices;

    #[test]
    fn clusters_are_connected_and_cover_what_seeds_reach() {
        let v = Vertices::ordered((0..).zip(random_points_f64(3000, 1)).collect());
        let graph = neighbour_graph(&v, 8).unwrap();
        let rows: Vec<Row> =
            v.position.iter().map(|p| std::array::from_fn(|c| if c < 3 { p[c] as f32 } else { 0.0 })).collect();
        let centres: Vec<Centre> =
            (0..60).map(|i| Centre { source: 50 * i, position: [0.0; 3], feature: rows[50 * i as usize] }).collect();
        let metric = Metric { cell: 0.2, feature_weight: 0.25 };
        let got = grow(&graph, &rows, metric, &centres);
        assert!(!got.label.contains(&NONE));
        let inside = graph.edges().filter(|e| got.label[e.a as usize] == got.label[e.b as usize]);
        let within = Graph::from_edges(v.len(), inside.map(|e| Edge { ..e }));
        assert_eq!(within.components().1, centres.len());
    }
}
