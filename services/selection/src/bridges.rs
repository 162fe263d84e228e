//! The shortest edges that join the components of a neighbour graph (a Euclidean minimum spanning forest over them).

use rayon::prelude::*;

use crate::neighbours::{Edge, Graph};
use crate::tree::PointTree;
use crate::vertices::Vertices;

/// The edges that join all components of the graph, `components − 1` of them, by Borůvka's rounds: each component but
/// the largest names its shortest edge outwards. Ties go to the smaller scene-wide indices.
#[must_use]
pub fn bridges(vertices: &Vertices, graph: &Graph) -> Vec<Edge> {
    let (mut component, mut count) = graph.components();
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
        // Components by the one they were merged into.
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
            // Distances that are no numbers: nothing can be joined.
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
    use crate::test_scenes::random_points_f64;
    use crate::vertices::distance_squared;
    use proptest::prelude::*;

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
            prop_assert_eq!(graph.with_edges(&found).components().1, 1);
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
