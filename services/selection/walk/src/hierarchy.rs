//! A hierarchy of coarser and coarser graphs. Each node is an aggregate of strongly connected nodes of the finer graph.
//!
//! Aggregation by pairwise matching (Notay 2010). The hierarchy depends on the graph alone and is computed once per scene.
//! Nodes are renumbered so that the members of an aggregate are contiguous on every level.

use rayon::prelude::*;
use sprs::CsMatI;

use super::network::{links, range};
use super::{Conductance, Network};

/// Storage format of conductances: rounded once, relative to the largest, and summed in f64.
///
/// Diagonals are sums of the stored values. So a rounding of one part in 2²⁴ changes a probability by a few such parts only.
pub(super) trait Stored: Copy + Send + Sync {
    /// Conductances more than this many powers of two below the largest are dropped.
    const REACH: i64;
    fn of(x: f64) -> Self;
    fn get(self) -> f64;
}

impl Stored for f32 {
    const REACH: i64 = 100;

    fn of(x: f64) -> Self {
        x as Self
    }

    fn get(self) -> f64 {
        f64::from(self)
    }
}

impl Stored for f64 {
    const REACH: i64 = 850;

    fn of(x: f64) -> Self {
        x
    }

    fn get(self) -> f64 {
        self
    }
}

/// One level: a graph and the members of its nodes on the finer level.
#[derive(Debug, Clone)]
pub(super) struct Level<W> {
    /// Conductances: symmetric. Those out of range are stored as 0.
    matrix: CsMatI<W, u32>,
    /// Members of node i are `members[i]..members[i + 1]` of the finer level; empty at the finest.
    pub(super) members: Vec<u32>,
    /// Node of the next coarser level; empty at the coarsest.
    pub(super) parent: Vec<u32>,
}

impl<W: Stored> Level<W> {
    pub(super) fn len(&self) -> usize {
        self.matrix.rows()
    }

    /// Neighbours of all nodes, row after row.
    pub(super) fn targets(&self) -> &[u32] {
        self.matrix.indices()
    }

    /// Conductances to these neighbours.
    pub(super) fn weights(&self) -> &[W] {
        self.matrix.data()
    }

    /// Positions of a node's row in [`Level::targets`] and [`Level::weights`].
    pub(super) fn row(&self, i: usize) -> std::ops::Range<usize> {
        range(&self.matrix, i)
    }

    pub(super) fn links(&self, i: usize) -> impl Iterator<Item = (u32, W)> + '_ {
        links(&self.matrix, i as u32)
    }
}

/// The levels of a graph, finest first.
#[derive(Debug, Clone)]
pub(super) struct Hierarchy<W> {
    pub(super) levels: Vec<Level<W>>,
    /// Node of the original graph for each node of the finest level.
    pub(super) order: Vec<u32>,
}

/// Nodes of the coarsest level. That level is eliminated.
const COARSEST: usize = 400;

/// Matching passes repeat until the graph has less than this share of its nodes.
const SHRINK: f64 = 0.25;

/// A neighbour is an eligible partner if no other neighbour has a conductance larger by this factor.
const STRONG: f64 = 0.25;

impl<W: Stored> Hierarchy<W> {
    /// The hierarchy of a graph with conductances divided by 2^`shift`. Conductances out of range become 0.
    pub(super) fn new(network: &Network, shift: i64) -> Self {
        let n = network.len();
        let stored = |w: &Conductance| if within::<W>(*w, shift) { W::of(w.scaled(shift)).get() } else { 0.0 };
        let adjacency = network.adjacency();
        let offsets = adjacency.indptr().raw_storage().iter().map(|&at| at as u32).collect();
        let weights = adjacency.data().par_iter().with_min_len(16_384).map(stored).collect();
        let mut graphs = vec![CsMatI::new((n, n), offsets, adjacency.indices().to_vec(), weights)];
        let mut parents: Vec<Vec<u32>> = Vec::new();
        loop {
            let fine = &graphs[graphs.len() - 1];
            let n = fine.rows();
            if n <= COARSEST {
                break;
            }
            let (mut parent, mut coarse) = matched(fine);
            while coarse.rows() as f64 > SHRINK * n as f64 {
                let (next, graph) = matched(&coarse);
                if graph.rows() as f64 > 0.9 * coarse.rows() as f64 {
                    break;
                }
                parent.iter_mut().for_each(|p| *p = next[*p as usize]);
                coarse = graph;
            }
            if coarse.rows() as f64 > 0.9 * n as f64 {
                break;
            }
            parents.push(parent);
            graphs.push(coarse);
        }
        Self::renumbered(&graphs, &parents)
    }

    /// Renumbers the nodes so that members are contiguous.
    fn renumbered(graphs: &[Graph], parents: &[Vec<u32>]) -> Self {
        let mut levels: Vec<Level<W>> = Vec::new();
        // Coarsest first; its numbers stay.
        let mut order: Vec<u32> = (0..graphs[graphs.len() - 1].rows() as u32).collect();
        let mut rank = order.clone();
        for (l, graph) in graphs.iter().enumerate().rev() {
            if l + 1 < graphs.len() {
                // Members sorted by the new number of their parent, stably.
                let parent = &parents[l];
                let mut members = vec![0_u32; graphs[l + 1].rows() + 1];
                for p in parent {
                    members[rank[*p as usize] as usize + 1] += 1;
                }
                for i in 1..members.len() {
                    members[i] += members[i - 1];
                }
                let mut next = members.clone();
                let mut own_rank = vec![0_u32; graph.rows()];
                order = vec![0; graph.rows()];
                for (i, p) in (0_u32..).zip(parent) {
                    let at = &mut next[rank[*p as usize] as usize];
                    order[*at as usize] = i;
                    own_rank[i as usize] = *at;
                    *at += 1;
                }
                let new_parent = order.iter().map(|&i| rank[parent[i as usize] as usize]).collect();
                if let Some(coarser) = levels.last_mut() {
                    coarser.members = members;
                }
                rank = own_rank;
                levels.push(permuted(graph, &order, &rank, new_parent));
            } else {
                levels.push(permuted(graph, &order, &rank, Vec::new()));
            }
        }
        levels.reverse();
        Self { levels, order }
    }
}

/// A graph in f64 while the hierarchy is made.
type Graph = CsMatI<f64, u32>;

/// The matrix of rows that ascend by column.
fn compressed<W: Stored>(rows: &[Vec<(u32, W)>]) -> CsMatI<W, u32> {
    let entries = rows.iter().map(Vec::len).sum();
    let mut offsets = Vec::with_capacity(rows.len() + 1);
    let (mut targets, mut weights) = (Vec::with_capacity(entries), Vec::with_capacity(entries));
    offsets.push(0);
    for row in rows {
        targets.extend(row.iter().map(|l| l.0));
        weights.extend(row.iter().map(|l| l.1));
        offsets.push(targets.len() as u32);
    }
    CsMatI::new((rows.len(), rows.len()), offsets, targets, weights)
}

/// The level of a graph in a new order. The permutation of `sprs` takes one thread; this one takes all.
fn permuted<W: Stored>(graph: &Graph, order: &[u32], rank: &[u32], parent: Vec<u32>) -> Level<W> {
    let rows: Vec<Vec<(u32, W)>> = order
        .par_iter()
        .with_min_len(1024)
        .map(|&i| {
            let mut row: Vec<(u32, W)> = links(graph, i).map(|(j, w)| (rank[j as usize], W::of(w))).collect();
            row.sort_unstable_by_key(|l| l.0);
            row
        })
        .collect();
    Level { matrix: compressed(&rows), members: Vec::new(), parent }
}

const NONE: u32 = u32::MAX;

/// One matching pass. Each node pairs with its strongest free neighbour, unless that neighbour has a much stronger one.
///
/// Nodes without a partner join the aggregate of their strongest neighbour. Returns the aggregate of each node and the graph
/// of aggregates.
fn matched(graph: &Graph) -> (Vec<u32>, Graph) {
    let n = graph.rows();
    let stronger = |best: Option<(u32, f64)>, l: (u32, f64)| match best {
        Some(b) if b.1 >= l.1 => best,
        _ => Some(l),
    };
    let strongest: Vec<Option<(u32, f64)>> =
        (0..).take(n).map(|i| links(graph, i).filter(|l| l.1 > 0.0).fold(None, stronger)).collect();
    let bond = |i: usize| strongest[i].map_or(0.0, |l| l.1);
    let mut parent = vec![NONE; n];
    let mut count = 0;
    let mut left = Vec::new();
    for i in 0..n {
        if parent[i] != NONE {
            continue;
        }
        let fit = |l: &(u32, f64)| {
            let j = l.0 as usize;
            parent[j] == NONE && j != i && l.1 > 0.0 && l.1 >= STRONG * bond(i).max(bond(j))
        };
        match links(graph, i as u32).filter(fit).fold(None, stronger) {
            Some((j, _)) => {
                (parent[i], parent[j as usize]) = (count, count);
                count += 1;
            }
            None => left.push(i),
        }
    }
    // Chains of strongest neighbours end in a pair, so a few rounds suffice.
    while !left.is_empty() {
        let before = left.len();
        left.retain(|&i| {
            let to = strongest[i].map_or(NONE, |(j, _)| parent[j as usize]);
            parent[i] = to;
            to == NONE
        });
        if left.len() == before {
            // Nodes without a neighbour.
            for i in left.drain(..) {
                parent[i] = count;
                count += 1;
            }
        }
    }
    let coarse = quotient(graph, &parent, count as usize);
    (parent, coarse)
}

/// The graph of aggregates: conductances between members of different ones add up. A product of `sprs` would keep the sums
/// inside an aggregate, and take one thread.
fn quotient(graph: &Graph, parent: &[u32], count: usize) -> Graph {
    let mut offsets = vec![0_usize; count + 1];
    for p in parent {
        offsets[*p as usize + 1] += 1;
    }
    for i in 0..count {
        offsets[i + 1] += offsets[i];
    }
    let mut next = offsets.clone();
    let mut members = vec![0_u32; parent.len()];
    for (i, p) in (0..).zip(parent) {
        members[next[*p as usize]] = i;
        next[*p as usize] += 1;
    }
    let rows: Vec<Vec<(u32, f64)>> = (0..count)
        .into_par_iter()
        .with_min_len(1024)
        .map(|c| {
            let mut row: Vec<(u32, f64)> = members[offsets[c]..offsets[c + 1]]
                .iter()
                .flat_map(|&i| links(graph, i))
                .map(|(j, w)| (parent[j as usize], w))
                .filter(|l| l.0 as usize != c)
                .collect();
            // A stable sort fixes the order of the sums.
            row.sort_by_key(|l| l.0);
            row.dedup_by(|later, first| {
                let same = later.0 == first.0;
                if same {
                    first.1 += later.1;
                }
                same
            });
            row
        })
        .collect();
    compressed(&rows)
}

/// Whether a conductance is in range of the largest one. `shift` is the exponent of the largest.
pub(super) fn within<W: Stored>(w: Conductance, shift: i64) -> bool {
    w.exponent() >= shift - W::REACH
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hard_cases::{mesh, network};

    #[test]
    fn every_level_holds_all_conductance_between_its_aggregates() {
        let g = network(5001, &mesh(0, 5000, 3));
        let made = Hierarchy::<f64>::new(&g, 0);
        let sizes: Vec<usize> = made.levels.iter().map(Level::len).collect();
        println!("levels {sizes:?}");
        assert!(sizes.len() > 2 && *sizes.last().unwrap() <= COARSEST);
        let mut order = made.order.clone();
        order.sort_unstable();
        assert_eq!(order, (0..5001).collect::<Vec<_>>());
        for pair in made.levels.windows(2) {
            let [fine, coarse] = pair else { continue };
            for c in 0..coarse.len() {
                let members = coarse.members[c]..coarse.members[c + 1];
                assert!(!members.is_empty() && members.clone().all(|i| fine.parent[i as usize] as usize == c));
                let out: f64 = members
                    .flat_map(|i| fine.links(i as usize))
                    .filter(|l| fine.parent[l.0 as usize] as usize != c)
                    .map(|l| l.1)
                    .sum();
                let have: f64 = coarse.links(c).map(|l| l.1).sum();
                assert!((out - have).abs() <= 1e-12 * out, "{out} {have}");
            }
        }
    }
}
