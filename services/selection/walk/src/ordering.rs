//! Elimination orders of sparse graphs.

use sprs::{CsMatViewI, PermOwnedI, SpIndex};

/// An elimination order of a symmetric matrix with little fill: approximate minimum degree (Amestoy, Davis, Duff 1996).
/// Deterministic. Only the places of the entries count, and those on the diagonal do not.
///
/// Row k of the permutation is the node that is eliminated as number k.
#[must_use]
pub fn minimum_degree<N: Copy, Iptr: SpIndex>(matrix: CsMatViewI<'_, N, u32, Iptr>) -> PermOwnedI<u32> {
    let starts: Vec<i64> = matrix.indptr().to_proper().iter().map(|&start| start.index() as i64).collect();
    let columns: Vec<i64> = matrix.indices().iter().map(|&column| i64::from(column)).collect();
    let order = amd::order(matrix.rows() as i64, &starts, &columns, &amd::Control::default());
    PermOwnedI::new(match order {
        Ok((order, ..)) => order.into_iter().map(|node| node as u32).collect(),
        // The order refuses only malformed matrices, and `CsMat` has none. Every order gives the same solution.
        Err(_) => (0..matrix.rows() as u32).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use sprs::{CsMatI, TriMatI};
    use std::collections::BTreeSet;

    fn fill(n: usize, edges: &[(u32, u32)], order: &[u32]) -> usize {
        let mut rows = vec![BTreeSet::new(); n];
        for &(a, b) in edges {
            if a != b {
                rows[a as usize].insert(b);
                rows[b as usize].insert(a);
            }
        }
        let mut entries = 0;
        for &u in order {
            let row = std::mem::take(&mut rows[u as usize]);
            entries += row.len();
            for &a in &row {
                rows[a as usize].remove(&u);
                rows[a as usize].extend(row.iter().copied().filter(|&b| b != a));
            }
        }
        entries
    }

    fn order_of(n: usize, edges: &[(u32, u32)]) -> Vec<u32> {
        let mut triplets = TriMatI::new((n, n));
        for (a, b) in edges.iter().map(|&(a, b)| (a as usize, b as usize)).filter(|&(a, b)| a.max(b) < n) {
            triplets.add_triplet(a, b, 1);
            triplets.add_triplet(b, a, 1);
        }
        let matrix: CsMatI<u32, u32, usize> = triplets.to_csr();
        minimum_degree(matrix.view()).vec()
    }

    #[test]
    fn a_tree_is_eliminated_without_fill() {
        let edges: Vec<(u32, u32)> = (1..64).map(|i| (i, (i - 1) / 2)).collect();
        assert_eq!(fill(64, &edges, &order_of(64, &edges)), 63);
    }

    #[test]
    fn a_grid_fills_far_less_than_row_by_row() {
        let side = 20;
        let at = |x: u32, y: u32| x + side * y;
        let mut edges = Vec::new();
        for y in 0..side {
            for x in 0..side {
                if x + 1 < side {
                    edges.push((at(x, y), at(x + 1, y)));
                }
                if y + 1 < side {
                    edges.push((at(x, y), at(x, y + 1)));
                }
            }
        }
        let n = (side * side) as usize;
        let natural = fill(n, &edges, &(0..n as u32).collect::<Vec<_>>());
        let ours = fill(n, &edges, &order_of(n, &edges));
        println!("entries: natural {natural}, minimum degree {ours}");
        assert!(2 * ours < natural, "{ours} against {natural}");
    }

    proptest! {
        #[test]
        fn every_node_comes_once(n in 0..40_usize, edges in proptest::collection::vec((0..40_u32, 0..40_u32), 0..150)) {
            let edges: Vec<(u32, u32)> = edges.iter().map(|&(a, b)| (a % n.max(1) as u32, b % n.max(1) as u32)).collect();
            let mut order = order_of(n, &edges);
            prop_assert_eq!(&order, &order_of(n, &edges));
            order.sort_unstable();
            prop_assert_eq!(order, (0..n as u32).collect::<Vec<_>>());
        }
    }
}
