//! Bridges: the shortest edges that join the components of a neighbour graph (a Euclidean minimum spanning forest).

use std::iter::Peekable;

use rayon::prelude::*;

use crate::bvh::PointTree;
use crate::neighbours::{Adjacency, Edge, Graph};
use crate::vertices::Vertices;

/// A graph together with its bridges, as one connected graph without a copy.
#[derive(Debug, Clone, Copy)]
pub struct Joined<'a> {
    graph: &'a Graph,
    /// Both directions of every bridge, ascending by (a, b).
    ways: &'a [Edge],
}

impl<'a> Joined<'a> {
    /// A graph with additional edges in both directions (see [`both_ways`]). None of them may be in the graph.
    #[must_use]
    pub fn new(graph: &'a Graph, ways: &'a [Edge]) -> Self {
        Self { graph, ways }
    }

    /// Number of vertices.
    #[must_use]
    pub fn len(self) -> usize {
        self.graph.len()
    }

    /// Whether there is no vertex.
    #[must_use]
    pub fn is_empty(self) -> bool {
        self.graph.is_empty()
    }

    /// Neighbours of a vertex, ascending, with the lengths of the edges to them.
    #[inline]
    pub fn neighbours(self, v: u32) -> impl Iterator<Item = (u32, f64)> + 'a {
        let (targets, lengths) = self.graph.row(v);
        let ways = &self.ways[self.ways.partition_point(|e| e.a < v)..];
        Neighbours { targets, lengths, ways: ways.iter().take_while(move |e| e.a == v).peekable() }
    }

    /// Every edge once, `a < b`, ascending.
    pub fn edges(self) -> impl Iterator<Item = Edge> + 'a {
        (0..).take(self.len()).flat_map(move |a| {
            self.neighbours(a).filter(move |n| n.0 > a).map(move |(b, length)| Edge { a, b, length })
        })
    }
}

impl Adjacency for Joined<'_> {
    fn vertices(&self) -> usize {
        self.graph.len()
    }

    #[inline]
    fn around(&self, v: u32) -> impl Iterator<Item = (u32, f64)> + '_ {
        self.neighbours(v)
    }
}

/// Merges a row of the graph with the bridges of its vertex, ascending by neighbour.
struct Neighbours<'a, W: Iterator<Item = &'a Edge>> {
    targets: &'a [u32],
    lengths: &'a [f64],
    ways: Peekable<W>,
}

impl<'a, W: Iterator<Item = &'a Edge>> Iterator for Neighbours<'a, W> {
    type Item = (u32, f64);

    #[inline]
    fn next(&mut self) -> Option<(u32, f64)> {
        let first = self.targets.first().copied();
        if let Some(way) = self.ways.next_if(|way| first.is_none_or(|t| way.b < t)) {
            return Some((way.b, way.length));
        }
        let (length, lengths) = self.lengths.split_first()?;
        self.lengths = lengths;
        self.targets = &self.targets[1..];
        first.map(|t| (t, *length))
    }
}

/// Both directions of every edge, ascending by (a, b).
#[must_use]
pub fn both_ways(edges: &[Edge]) -> Vec<Edge> {
    let mut ways: Vec<Edge> = edges.iter().flat_map(|&e| [e, Edge { a: e.b, b: e.a, ..e }]).collect();
    ways.sort_by_key(|e| (e.a, e.b));
    ways
}

/// The `components − 1` shortest edges that join all components, by Borůvka's algorithm.
///
/// In each round, every component except the largest selects its shortest outgoing edge. Ties go to the smaller scene-wide
/// indices.
#[must_use]
pub fn bridges(vertices: &Vertices, graph: &Graph) -> Vec<Edge> {
    let (component, count) = graph.components();
    bridges_between(vertices, component, count)
}

/// [`bridges`] for given components: one number below `count` per vertex, as from [`Graph::components`].
#[must_use]
pub fn bridges_between(vertices: &Vertices, mut component: Vec<u32>, mut count: usize) -> Vec<Edge> {
    let mut found = Vec::new();
    if count < 2 {
        return found;
    }
    let tree = PointTree::new(&vertices.position);
    while count > 1 {
        let nodes = tree.node_components(&component);
        let mut members: Vec<Vec<u32>> = vec![Vec::new(); count];
        for (v, &c) in (0..).zip(&component) {
            members[c as usize].push(v);
        }
        let largest = (0..count).max_by_key(|&c| (members[c].len(), std::cmp::Reverse(c)));
        let mut shortest: Vec<(f64, [u32; 2], Edge)> = members
            .par_iter()
            .enumerate()
            .filter(|(c, _)| Some(*c) != largest)
            .filter_map(|(c, own)| {
                let mut best: Option<(f64, [u32; 2], Edge)> = None;
                for &a in own {
                    let limit = best.map_or(f64::INFINITY, |b| b.0);
                    let from = &vertices.position[a as usize];
                    if let Some((d, b)) = tree.nearest_foreign(from, c as u32, &component, &nodes, limit) {
                        let mut ends = [vertices.gaussian[a as usize], vertices.gaussian[b as usize]];
                        ends.sort_unstable();
                        if best.is_none_or(|best| (d, ends) < (best.0, best.1)) {
                            best = Some((d, ends, Edge { a, b, length: d.sqrt() }));
                        }
                    }
                }
                best
            })
            .collect();
        shortest.sort_by(|x, y| x.0.total_cmp(&y.0).then(x.1.cmp(&y.1)));
        // Root of each component after the merges.
        let mut into: Vec<u32> = (0..count as u32).collect();
        let root = |into: &mut Vec<u32>, mut c: u32| {
            while into[c as usize] != c {
                into[c as usize] = into[into[c as usize] as usize];
                c = into[c as usize];
            }
            c
        };
        let before = found.len();
        for (_, _, edge) in shortest {
            let a = root(&mut into, component[edge.a as usize]);
            let b = root(&mut into, component[edge.b as usize]);
            if a != b {
                into[a.max(b) as usize] = a.min(b);
                found.push(edge);
            }
        }
        if found.len() == before {
            // NaN distances: no component can be joined.
            break;
        }
        let mut number = vec![u32::MAX; count];
        let mut next = 0;
        for c in &mut component {
            let r = root(&mut into, *c) as usize;
            if number[r] == u32::MAX {
                number[r] = next;
                next += 1;
            }
            *c = number[r];
        }
        count = next as usize;
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::neighbours::neighbour_graph;
    use crate::vertices::distance_squared;
    use proptest::prelude::*;
    use sg_scene::synthetic::random_points_f64;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn bridges_are_the_shortest_that_join_everything(n in 1..120_usize, seed in 0..200_u64, k in 1..3_usize) {
            let points = random_points_f64(n, seed);
            let v = Vertices::ordered(points.iter().copied().enumerate().map(|(i, p)| (i as u32, p)).collect());
            let graph = neighbour_graph(&v, k).unwrap();
            let (component, count) = graph.components();
            let found = bridges(&v, &graph);
            prop_assert_eq!(found.len(), count - 1);
            let copy = graph.with_edges(&found);
            prop_assert_eq!(copy.components().1, 1);
            let ways = both_ways(&found);
            let joined = Joined::new(&graph, &ways);
            for v in 0..n as u32 {
                prop_assert_eq!(joined.neighbours(v).collect::<Vec<_>>(), copy.neighbours(v).collect::<Vec<_>>());
            }
            prop_assert_eq!(joined.edges().collect::<Vec<_>>(), copy.edges().collect::<Vec<_>>());
            // Kruskal over all pairs between components.
            let mut pairs: Vec<(f64, usize, usize)> = (0..n)
                .flat_map(|i| (i + 1..n).map(move |j| (i, j)))
                .filter(|&(i, j)| component[i] != component[j])
                .map(|(i, j)| (distance_squared(&v.position[i], &v.position[j]).sqrt(), i, j))
                .collect();
            pairs.sort_by(|a, b| a.partial_cmp(b).unwrap());
            let mut of: Vec<u32> = component;
            let mut want = 0.0;
            for (d, i, j) in pairs {
                if of[i] != of[j] {
                    want += d;
                    let (old, new) = (of[i], of[j]);
                    for c in &mut of {
                        if *c == old {
                            *c = new;
                        }
                    }
                }
            }
            let sum: f64 = found.iter().map(|e| e.length).sum();
            prop_assert!((sum - want).abs() <= 1e-12 * want.max(1.0), "{sum} against {want}");
        }
    }
}
