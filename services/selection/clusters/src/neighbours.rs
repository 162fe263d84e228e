//! The symmetric k-nearest-neighbour graph of points.

use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicU32, Ordering};

use glam::{DMat3, DQuat, DVec3};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;
use sprs::{CsMatI, CsMatViewI};

use crate::vertices::{Vertices, distance_squared};

/// An undirected graph with edge lengths: a symmetric sparse matrix of Euclidean lengths in the points' unit.
///
/// An edge between coincident points is a stored entry of 0.
#[derive(Debug, Clone, PartialEq)]
pub struct Graph {
    lengths: CsMatI<f64, u32>,
}

/// An undirected edge between two vertices.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Edge {
    /// One end.
    pub a: u32,
    /// The other end.
    pub b: u32,
    /// Euclidean length.
    pub length: f64,
}

/// An adjacency structure for searches: vertices from 0, and edges with lengths.
pub trait Adjacency: Sync {
    /// Number of vertices.
    fn vertices(&self) -> usize;

    /// Neighbours of a vertex, ascending, with the lengths of the edges to them.
    fn around(&self, v: u32) -> impl Iterator<Item = (u32, f64)> + '_;
}

impl Adjacency for Graph {
    fn vertices(&self) -> usize {
        self.len()
    }

    #[inline]
    fn around(&self, v: u32) -> impl Iterator<Item = (u32, f64)> + '_ {
        self.neighbours(v)
    }
}

/// A failed construction of a graph.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum GraphError {
    /// More edges than 32-bit offsets address.
    #[error("{vertices} Gaussians with {neighbours} neighbours each are more edges than one base unit can hold")]
    TooManyEdges {
        /// Number of vertices.
        vertices: usize,
        /// Requested number of neighbours.
        neighbours: usize,
    },
    /// The search tree rejected the points.
    #[error("the search tree could not be built: {0}")]
    Tree(String),
}

impl Graph {
    /// Number of vertices.
    #[must_use]
    pub fn len(&self) -> usize {
        self.lengths.rows()
    }

    /// Whether there is no vertex.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The matrix of lengths, in compressed rows.
    #[must_use]
    pub fn lengths(&self) -> CsMatViewI<'_, f64, u32> {
        self.lengths.view()
    }

    /// Neighbours of a vertex, ascending, and the lengths of the edges to them.
    #[inline]
    #[must_use]
    pub fn row(&self, v: u32) -> (&[u32], &[f64]) {
        // An owned matrix is never a part of another one, so its storage starts at 0.
        let offsets = self.lengths.indptr();
        let offsets = offsets.raw_storage();
        let row = offsets[v as usize] as usize..offsets[v as usize + 1] as usize;
        (&self.lengths.indices()[row.clone()], &self.lengths.data()[row])
    }

    /// Neighbours of a vertex with the lengths of the edges to them.
    #[inline]
    pub fn neighbours(&self, v: u32) -> impl Iterator<Item = (u32, f64)> + '_ {
        let (neighbours, lengths) = self.row(v);
        neighbours.iter().copied().zip(lengths.iter().copied())
    }

    /// The graph of `n` vertices with the given edges. Of duplicate edges the shorter is kept. Self-loops are dropped.
    #[must_use]
    pub fn from_edges(n: usize, edges: impl Iterator<Item = Edge>) -> Self {
        let mut edges: Vec<(u32, u32, f64)> =
            edges.filter(|e| e.a != e.b).map(|e| (e.a.min(e.b), e.a.max(e.b), e.length)).collect();
        edges.sort_unstable_by(|x, y| (x.0, x.1).cmp(&(y.0, y.1)).then(x.2.total_cmp(&y.2)));
        edges.dedup_by(|later, first| (later.0, later.1) == (first.0, first.1));
        Self { lengths: symmetric(n, &edges) }
    }

    /// Every edge once, `a < b`, ascending.
    pub fn edges(&self) -> impl Iterator<Item = Edge> + '_ {
        (0..).take(self.len()).flat_map(move |a| {
            self.neighbours(a).filter(move |n| n.0 > a).map(move |(b, length)| Edge { a, b, length })
        })
    }

    /// The graph with additional edges.
    #[must_use]
    pub fn with_edges(&self, more: &[Edge]) -> Self {
        Self::from_edges(self.len(), self.edges().chain(more.iter().copied()))
    }

    /// Connected components, numbered by their first vertex, and their number.
    #[must_use]
    pub fn components(&self) -> (Vec<u32>, usize) {
        let mut component = vec![u32::MAX; self.len()];
        let mut count = 0;
        let mut stack = Vec::new();
        for start in (0..).take(self.len()) {
            if component[start as usize] != u32::MAX {
                continue;
            }
            component[start as usize] = count;
            stack.push(start);
            while let Some(v) = stack.pop() {
                for (w, _) in self.neighbours(v) {
                    if component[w as usize] == u32::MAX {
                        component[w as usize] = count;
                        stack.push(w);
                    }
                }
            }
            count += 1;
        }
        (component, count as usize)
    }
}

/// The symmetric matrix of edges (a, b, entry) with a < b, ascending by (a, b).
pub(crate) fn symmetric<N: Copy + Default>(n: usize, edges: &[(u32, u32, N)]) -> CsMatI<N, u32> {
    let mut offsets = vec![0_u32; n + 1];
    for end in edges.iter().flat_map(|e| [e.0, e.1]) {
        offsets[end as usize + 1] += 1;
    }
    for i in 0..n {
        offsets[i + 1] += offsets[i];
    }
    // Row b gets its entries left of the diagonal first, with the rows a < b.
    let mut next = offsets.clone();
    let mut columns = vec![0; 2 * edges.len()];
    let mut entries = vec![N::default(); 2 * edges.len()];
    for &(a, b, entry) in edges {
        for (row, column) in [(a, b), (b, a)] {
            let at = &mut next[row as usize];
            (columns[*at as usize], entries[*at as usize]) = (column, entry);
            *at += 1;
        }
    }
    CsMatI::new((n, n), offsets, columns, entries)
}

/// The symmetric union of the `k` nearest neighbours of each point, in order of (distance, index).
///
/// Ties go to the smaller scene-wide index, so the graph does not depend on the search tree. A point with fewer than `k`
/// others is joined to all of them.
///
/// # Errors
/// [`GraphError`] if the graph exceeds 32-bit offsets.
pub fn neighbour_graph(vertices: &Vertices, k: usize) -> Result<Graph, GraphError> {
    let n = vertices.len();
    let k = k.min(n.saturating_sub(1));
    if n.saturating_mul(k).saturating_mul(2) >= u32::MAX as usize {
        return Err(GraphError::TooManyEdges { vertices: n, neighbours: k });
    }
    if k == 0 {
        return Ok(Graph { lengths: CsMatI::zero((n, n)) });
    }
    let forward = nearest_lists(vertices, k)?;
    Ok(symmetric_union(vertices, &forward, k))
}

/// The `k` nearest vertices of each vertex, in consecutive rows.
fn nearest_lists(vertices: &Vertices, k: usize) -> Result<Vec<u32>, GraphError> {
    // One tree entry per distinct position, because a bucket tree degenerates on coincident points. A generic rotation
    // comes first, because cyclic split axes degenerate on axis-aligned planes and lines. The centre is subtracted before
    // the rotation. Exact distances come from the original positions.
    let runs = vertices.coincident_runs();
    let centre = middle(&vertices.position);
    let turn = DMat3::from_quat(DQuat::from_xyzw(0.3607, -0.1933, 0.5147, 0.7532).normalize());
    let turned: Vec<[f64; 3]> = runs[..runs.len() - 1]
        .par_iter()
        .map(|&v| (turn * (DVec3::from_array(vertices.position[v as usize]) - centre)).to_array())
        .collect();
    let tree: ImmutableKdTree<f64, 3> =
        ImmutableKdTree::new_from_slice(&turned).map_err(|e| GraphError::Tree(e.to_string()))?;

    // Each block of runs writes its own part of the lists.
    const BLOCK: usize = 512;
    let mut lists = vec![0_u32; vertices.len() * k];
    let mut parts: Vec<&mut [u32]> = Vec::with_capacity(turned.len().div_ceil(BLOCK));
    let mut rest = lists.as_mut_slice();
    for block in (0..turned.len()).step_by(BLOCK) {
        let members = runs[(block + BLOCK).min(turned.len())] - runs[block];
        let (part, after) = rest.split_at_mut(members as usize * k);
        parts.push(part);
        rest = after;
    }
    turned.par_chunks(BLOCK).zip(parts).enumerate().for_each(|(block, (queries, part))| {
        let mut rows = part.chunks_exact_mut(k);
        let mut others: Vec<(f64, u32, u32)> = Vec::new();
        for (query, run) in queries.iter().zip(block * BLOCK..) {
            let members = runs[run]..runs[run + 1];
            let mates = members.len() - 1;
            others.clear();
            if mates < k {
                nearest_others(&tree, vertices, &runs, query, run, k - mates, &mut others);
            }
            for (v, row) in members.clone().zip(&mut rows) {
                let found = members.clone().filter(|&m| m != v).chain(others.iter().map(|o| o.2));
                row.iter_mut().zip(found).for_each(|(to, w)| *to = w);
            }
        }
    });
    Ok(lists)
}

/// At least the `need` nearest vertices outside the run: (squared distance, scene-wide index, vertex), ascending.
fn nearest_others(
    tree: &ImmutableKdTree<f64, 3>,
    vertices: &Vertices,
    runs: &[u32],
    query: &[f64; 3],
    run: usize,
    need: usize,
    others: &mut Vec<(f64, u32, u32)>,
) {
    let own = &vertices.position[runs[run] as usize];
    // The query itself, the needed entries, and one more to detect a cut tie.
    let asked = need + 2;
    let mut expand = |found: &mut dyn Iterator<Item = u32>| {
        others.clear();
        let mut farthest = 0.0_f64;
        let mut count = 0;
        for other in found {
            count += 1;
            let other = other as usize;
            if other == run {
                continue;
            }
            let start = runs[other];
            let d = distance_squared(own, &vertices.position[start as usize]);
            farthest = farthest.max(d);
            others.extend((start..runs[other + 1]).take(need).map(|v| (d, vertices.gaussian[v as usize], v)));
        }
        others.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        (count, farthest, others.get(need - 1).map_or(f64::INFINITY, |o| o.0))
    };
    let quantity = NonZeroUsize::new(asked).unwrap_or(NonZeroUsize::MIN);
    let found = tree.query(query).nearest_n::<SquaredEuclidean<f64>>(quantity).execute();
    let (count, farthest, needed) = expand(&mut found.iter().map(|f| f.item));
    // The rotation rounds positions, so within this margin the order of the tree is unreliable.
    let margin = 1e-14 * (DVec3::from_array(*query).abs().max_element() + needed.sqrt());
    if count == asked && farthest.sqrt() <= needed.sqrt() + margin {
        let radius = needed.sqrt() + 2.0 * margin;
        let found = tree.query(query).within::<SquaredEuclidean<f64>>(radius * radius).unsorted().execute();
        expand(&mut found.iter().map(|f| f.item));
    }
}

/// The coordinate-wise median, a centre that is robust to outliers.
fn middle(positions: &[[f64; 3]]) -> DVec3 {
    let axis = |a: usize| {
        let mut values: Vec<f64> = positions.iter().map(|p| p[a]).collect();
        crate::features::median(&mut values).unwrap_or(0.0)
    };
    DVec3::new(axis(0), axis(1), axis(2))
}

fn symmetric_union(vertices: &Vertices, forward: &[u32], k: usize) -> Graph {
    let n = vertices.len();
    let row = |v: usize| &forward[v * k..(v + 1) * k];
    // Number of one-sided neighbours of v: rows that contain v but are not in the row of v.
    let extra: Vec<AtomicU32> = (0..n).map(|_| AtomicU32::new(0)).collect();
    (0..n).into_par_iter().for_each(|u| {
        for &v in row(u) {
            if !row(v as usize).contains(&(u as u32)) {
                extra[v as usize].fetch_add(1, Ordering::Relaxed);
            }
        }
    });
    let mut offsets = vec![0_u32; n + 1];
    for v in 0..n {
        offsets[v + 1] = offsets[v] + k as u32 + extra[v].load(Ordering::Relaxed);
    }
    let edges = offsets[n] as usize;
    let slots: Vec<AtomicU32> = (0..edges).map(|_| AtomicU32::new(0)).collect();
    (0..n).into_par_iter().for_each(|u| {
        let start = offsets[u] as usize;
        for (slot, &v) in slots[start..].iter().zip(row(u)) {
            slot.store(v, Ordering::Relaxed);
            if !row(v as usize).contains(&(u as u32)) {
                let left = extra[v as usize].fetch_sub(1, Ordering::Relaxed) - 1;
                slots[offsets[v as usize] as usize + k + left as usize].store(u as u32, Ordering::Relaxed);
            }
        }
    });
    // The order of the slots depends on the threads. Sorted rows do not.
    let mut targets: Vec<u32> = slots.into_iter().map(AtomicU32::into_inner).collect();
    let mut lengths = vec![0.0_f64; edges];
    const BLOCK: usize = 1024;
    let mut parts: Vec<(&[u32], &mut [u32], &mut [f64])> = Vec::with_capacity(n.div_ceil(BLOCK));
    let (mut targets_left, mut lengths_left) = (targets.as_mut_slice(), lengths.as_mut_slice());
    for first in (0..n).step_by(BLOCK) {
        let rows = &offsets[first..=(first + BLOCK).min(n)];
        let size = (rows[rows.len() - 1] - rows[0]) as usize;
        let (own_targets, more_targets) = targets_left.split_at_mut(size);
        let (own_lengths, more_lengths) = lengths_left.split_at_mut(size);
        parts.push((rows, own_targets, own_lengths));
        (targets_left, lengths_left) = (more_targets, more_lengths);
    }
    parts.into_par_iter().enumerate().for_each(|(block, (rows, targets, lengths))| {
        for (row, own) in rows.windows(2).zip(&vertices.position[block * BLOCK..]) {
            let row = (row[0] - rows[0]) as usize..(row[1] - rows[0]) as usize;
            targets[row.clone()].sort_unstable();
            for (length, &w) in lengths[row.clone()].iter_mut().zip(&targets[row]) {
                *length = distance_squared(own, &vertices.position[w as usize]).sqrt();
            }
        }
    });
    Graph { lengths: CsMatI::new((n, n), offsets, targets, lengths) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use sg_scene::synthetic::random_points_f64 as random_points;

    fn vertices(points: &[[f64; 3]]) -> Vertices {
        Vertices::ordered(points.iter().copied().enumerate().map(|(i, p)| (i as u32, p)).collect())
    }

    /// The definition, by sorting all pairs; edges as pairs of scene-wide indices.
    fn brute(points: &[[f64; 3]], k: usize) -> Vec<(u32, u32)> {
        let mut edges = Vec::new();
        for (i, p) in points.iter().enumerate() {
            let mut all: Vec<(f64, usize)> =
                points.iter().enumerate().filter(|(j, _)| *j != i).map(|(j, q)| (distance_squared(p, q), j)).collect();
            all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            edges.extend(all.iter().take(k).map(|&(_, j)| (i.min(j) as u32, i.max(j) as u32)));
        }
        edges.sort_unstable();
        edges.dedup();
        edges
    }

    fn by_index(v: &Vertices, graph: &Graph) -> Vec<(u32, u32)> {
        let mut edges: Vec<(u32, u32)> = graph
            .edges()
            .map(|e| {
                let (a, b) = (v.gaussian[e.a as usize], v.gaussian[e.b as usize]);
                (a.min(b), a.max(b))
            })
            .collect();
        edges.sort_unstable();
        edges
    }

    fn check(points: &[[f64; 3]], k: usize) {
        let v = vertices(points);
        let graph = neighbour_graph(&v, k).unwrap();
        assert_eq!(by_index(&v, &graph), brute(points, k));
        assert!(sprs::is_symmetric(&graph.lengths));
        for a in 0..graph.len() as u32 {
            let (row, _) = graph.row(a);
            assert!(row.is_sorted() && !row.contains(&a));
        }
    }

    #[test]
    fn equals_the_definition_on_random_points() {
        check(&random_points(700, 1), 10);
    }

    #[test]
    fn equals_the_definition_on_a_lattice_where_every_distance_ties() {
        let lattice: Vec<[f64; 3]> = (0..729).map(|i| [i % 9, i / 9 % 9, i / 81].map(|c| 0.1 * f64::from(c))).collect();
        check(&lattice, 10);
    }

    #[test]
    fn coincident_points_keep_their_zero_edges() {
        // 20 coincident points with k = 8, and a bucket's worth more than once.
        let mut points = random_points(60, 2);
        points.extend(vec![[0.5, 0.5, 0.5]; 20]);
        points.extend(vec![[0.25, 0.5, 0.75]; 100]);
        check(&points, 8);
        let v = vertices(&points);
        let graph = neighbour_graph(&v, 8).unwrap();
        let zero = graph.lengths().data().iter().filter(|l| **l == 0.0).count();
        assert!(zero > 2 * 8 * 100, "{zero}");
    }

    #[test]
    fn flat_and_thin_sets_and_fewer_points_than_neighbours() {
        check(&random_points(300, 3).iter().map(|p| [p[0], 0.25, p[2]]).collect::<Vec<_>>(), 10);
        check(&random_points(300, 4).iter().map(|p| [7.0, p[1], -1.0]).collect::<Vec<_>>(), 10);
        check(&[[1.0; 3]; 50], 10);
        for n in 0..6 {
            check(&random_points(n, 5), 10);
        }
    }

    #[test]
    fn an_outlier_at_1e30_changes_nothing_for_the_others() {
        let mut points = random_points(400, 6);
        points.push([1e30, -1e30, 1e30]);
        check(&points, 10);
    }

    #[test]
    fn narrowing_before_the_centre_is_subtracted_loses_the_neighbours() {
        // Why positions stay in f64: the same points, 1e7 away from the origin through a unit's transform.
        let points = random_points(2000, 8);
        let want = brute(&points, 10);
        let kept = |edges: &[(u32, u32)]| {
            want.iter().filter(|e| edges.binary_search(e).is_ok()).count() as f64 / want.len() as f64
        };
        for (offset, most) in [(1e5, 0.99), (1e7, 0.1)] {
            let far: Vec<[f64; 3]> = points.iter().map(|p| p.map(|x| x + offset)).collect();
            let v = vertices(&far);
            let ours = kept(&by_index(&v, &neighbour_graph(&v, 10).unwrap()));
            let narrowed: Vec<[f64; 3]> = far.iter().map(|p| p.map(|x| f64::from(x as f32))).collect();
            let v = vertices(&narrowed);
            let naive = kept(&by_index(&v, &neighbour_graph(&v, 10).unwrap()));
            println!("offset {offset:.0e}: f64 keeps {ours:.4} of the edges, f32 {naive:.4}");
            assert!(ours > 0.999);
            assert!(naive < most);
        }
    }

    #[test]
    fn the_same_graph_for_any_number_of_threads() {
        let v = vertices(&random_points(3000, 9));
        let run = |threads| {
            rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap()
                .install(|| neighbour_graph(&v, 10).unwrap())
        };
        assert_eq!(run(1), run(4));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn equals_the_definition_on_small_grids(
            cells in proptest::collection::vec((0..4_i8, 0..4_i8, 0..3_i8), 0..60), k in 1..12_usize
        ) {
            let points: Vec<[f64; 3]> = cells.iter().map(|c| [c.0, c.1, c.2].map(f64::from)).collect();
            check(&points, k);
        }
    }
}
