//! Merging of clusters: connected, large enough, and few enough.

use std::cmp::Reverse;
use std::collections::{BTreeSet, BinaryHeap};

use crate::features::{Row, WIDTH};
use crate::neighbours::Adjacency;

/// A connected set of vertices of one label, possibly merged into another piece.
struct Piece {
    size: usize,
    sum: [f64; WIDTH],
    neighbours: BTreeSet<u32>,
    /// The target of the merge.
    into: Option<u32>,
}

impl Piece {
    fn mean_distance_squared(&self, other: &Self) -> f64 {
        let (a, b) = (self.size as f64, other.size as f64);
        (0..WIDTH).map(|c| (self.sum[c] / a - other.sum[c] / b).powi(2)).sum()
    }
}

/// Splits every label into connected pieces, then merges pieces in ascending order of size.
///
/// A piece joins the neighbour with the most similar mean feature. Merging ends when every piece has at least `least`
/// vertices and there are at most `most` pieces. On a connected graph this always succeeds.
///
/// Returns the label of each vertex and the number of labels. Labels are numbered by their first vertex in the order of
/// `rank`.
#[must_use]
pub fn merge_pieces(
    graph: &impl Adjacency,
    rows: &[Row],
    rank: &[u32],
    label: &[u32],
    least: usize,
    most: usize,
) -> (Vec<u32>, usize) {
    let (of, mut pieces) = split(graph, rows, label);
    let mut count = pieces.len();
    let mut heap: BinaryHeap<Reverse<(usize, u32)>> = (0..).zip(&pieces).map(|(i, p)| Reverse((p.size, i))).collect();
    while let Some(Reverse((size, i))) = heap.pop() {
        let piece = &pieces[i as usize];
        if piece.into.is_some() || piece.size != size {
            continue;
        }
        if size >= least && count <= most {
            break;
        }
        let target = piece
            .neighbours
            .iter()
            .map(|&j| (piece.mean_distance_squared(&pieces[j as usize]), j))
            .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let Some((_, j)) = target else { continue };
        absorb(&mut pieces, i, j);
        count -= 1;
        heap.push(Reverse((pieces[j as usize].size, j)));
    }
    number(&of, &mut pieces, rank)
}

fn split(graph: &impl Adjacency, rows: &[Row], label: &[u32]) -> (Vec<u32>, Vec<Piece>) {
    let n = graph.vertices();
    let mut of = vec![u32::MAX; n];
    let mut pieces: Vec<Piece> = Vec::new();
    let mut stack = Vec::new();
    for start in (0..).take(n) {
        if of[start as usize] != u32::MAX {
            continue;
        }
        let id = pieces.len() as u32;
        let mut piece = Piece { size: 0, sum: [0.0; WIDTH], neighbours: BTreeSet::new(), into: None };
        of[start as usize] = id;
        stack.push(start);
        while let Some(v) = stack.pop() {
            piece.size += 1;
            for (sum, x) in piece.sum.iter_mut().zip(&rows[v as usize]) {
                *sum += f64::from(*x);
            }
            for (w, _) in graph.around(v) {
                if of[w as usize] == u32::MAX && label[w as usize] == label[v as usize] {
                    of[w as usize] = id;
                    stack.push(w);
                }
            }
        }
        pieces.push(piece);
    }
    for v in (0..).take(n) {
        let a = of[v as usize];
        for (w, _) in graph.around(v) {
            let b = of[w as usize];
            if w > v && a != b {
                pieces[a as usize].neighbours.insert(b);
                pieces[b as usize].neighbours.insert(a);
            }
        }
    }
    (of, pieces)
}

fn absorb(pieces: &mut [Piece], from: u32, to: u32) {
    let size = pieces[from as usize].size;
    let sum = pieces[from as usize].sum;
    let neighbours = std::mem::take(&mut pieces[from as usize].neighbours);
    pieces[from as usize].into = Some(to);
    for &other in &neighbours {
        let theirs = &mut pieces[other as usize].neighbours;
        theirs.remove(&from);
        if other != to {
            theirs.insert(to);
        }
    }
    let target = &mut pieces[to as usize];
    target.size += size;
    for (a, b) in target.sum.iter_mut().zip(sum) {
        *a += b;
    }
    target.neighbours.extend(neighbours.into_iter().filter(|&other| other != to));
}

fn number(of: &[u32], pieces: &mut [Piece], rank: &[u32]) -> (Vec<u32>, usize) {
    // Resolve the chain of merges once for each piece.
    let roots: Vec<u32> = (0..)
        .take(pieces.len())
        .map(|i| {
            let mut at = i;
            while let Some(next) = pieces[at as usize].into {
                at = next;
            }
            let mut back = i;
            while let Some(next) = pieces[back as usize].into {
                pieces[back as usize].into = Some(at);
                back = next;
            }
            at
        })
        .collect();
    let mut first = vec![u32::MAX; pieces.len()];
    for (piece, &r) in of.iter().zip(rank) {
        let root = roots[*piece as usize] as usize;
        first[root] = first[root].min(r);
    }
    let mut order: Vec<u32> = (0..).take(pieces.len()).filter(|&i| roots[i as usize] == i).collect();
    order.sort_by_key(|&i| first[i as usize]);
    let mut id = vec![u32::MAX; pieces.len()];
    for (k, &i) in (0..).zip(&order) {
        id[i as usize] = k;
    }
    (of.iter().map(|&p| id[roots[p as usize] as usize]).collect(), order.len())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::neighbours::{Edge, Graph};
    use proptest::prelude::*;

    fn path(n: u32) -> Graph {
        Graph::from_edges(n as usize, (1..n).map(|i| Edge { a: i - 1, b: i, length: 1.0 }))
    }

    fn row(x: f32) -> Row {
        let mut r = [0.0; WIDTH];
        r[0] = x;
        r
    }

    #[test]
    fn a_split_label_becomes_two_clusters_and_a_speck_joins_the_more_similar_side() {
        let graph = path(9);
        let label = [0, 0, 0, 1, 0, 0, 0, 2, 2];
        let rows: Vec<Row> = [0.0, 0.0, 0.0, 0.9, 1.0, 1.0, 1.0, 5.0, 5.0].map(row).to_vec();
        let rank: Vec<u32> = (0..9).collect();
        let (merged, count) = merge_pieces(&graph, &rows, &rank, &label, 2, 99);
        assert_eq!((merged, count), (vec![0, 0, 0, 1, 1, 1, 1, 2, 2], 3));
    }

    #[test]
    fn the_least_size_rises_until_there_are_few_enough() {
        let graph = path(10);
        let label: Vec<u32> = (0..10).collect();
        let rows = vec![row(0.0); 10];
        let rank: Vec<u32> = (0..10).rev().collect();
        for most in 1..10 {
            let (merged, count) = merge_pieces(&graph, &rows, &rank, &label, 1, most);
            assert_eq!(count, most);
            assert_eq!(merged[9], 0, "numbered by rank");
        }
    }

    proptest! {
        #[test]
        fn clusters_are_connected_few_and_large(
            n in 1..60_usize, edges in proptest::collection::vec((0..60_u32, 0..60_u32), 0..100),
            labels in proptest::collection::vec(0..6_u32, 60), least in 1..8_usize, most in 1..20_usize
        ) {
            let chain = (1..n as u32).map(|i| Edge { a: i - 1, b: i, length: 1.0 });
            let more = edges.iter().map(|&(a, b)| Edge { a: a % n as u32, b: b % n as u32, length: 1.0 });
            let graph = Graph::from_edges(n, chain.chain(more));
            let rows: Vec<Row> = (0..n).map(|i| row((i % 5) as f32)).collect();
            let rank: Vec<u32> = (0..n as u32).collect();
            let (merged, count) = merge_pieces(&graph, &rows, &rank, &labels[..n], least, most);
            prop_assert!(count <= most && count >= 1);
            let inside = graph.edges().filter(|e| merged[e.a as usize] == merged[e.b as usize]);
            prop_assert_eq!(Graph::from_edges(n, inside).components().1, count);
            let mut sizes = vec![0; count];
            for &l in &merged {
                sizes[l as usize] += 1;
            }
            prop_assert!(count == 1 || sizes.iter().all(|&s| s >= least));
        }
    }
}
