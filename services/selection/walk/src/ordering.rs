//! Elimination orders of sparse graphs: approximate minimum degree on the quotient graph (Amestoy, Davis, Duff 1996,
//! without supervariables).

use sprs::{CsMatViewI, PermOwnedI, SpIndex};

/// An elimination order of a symmetric matrix with little fill. Deterministic. Only the places of the entries count, and those
/// on the diagonal do not.
///
/// Row k of the permutation is the node that is eliminated as number k.
#[must_use]
pub fn minimum_degree<N: Copy, Iptr: SpIndex>(matrix: CsMatViewI<'_, N, u32, Iptr>) -> PermOwnedI<u32> {
    let n = matrix.rows();
    let mut graph = Quotient::new(matrix);
    let mut order = Vec::with_capacity(n);
    while let Some(pivot) = graph.buckets.take_least() {
        order.push(pivot);
        let left = n - order.len();
        if graph.eliminate(pivot, left) == left {
            // The remaining nodes form a clique: any order has the same fill.
            let mut rest: Vec<u32> = (0..).take(n).filter(|&u| !graph.eliminated[u as usize]).collect();
            order.append(&mut rest);
            break;
        }
    }
    PermOwnedI::new(order)
}

/// The quotient graph. Remaining nodes are *variables*. An eliminated node is an *element*, the clique of its neighbours.
struct Quotient {
    /// Neighbours of each variable over edges outside all elements.
    variables: Vec<Vec<u32>>,
    /// Elements a variable belongs to.
    elements: Vec<Vec<u32>>,
    /// Variables of each element, some of them already eliminated. Empty after absorption.
    members: Vec<Vec<u32>>,
    eliminated: Vec<bool>,
    degree: Vec<usize>,
    buckets: Buckets,
    /// For each element at `stamp`: number of its variables outside the current pivot's element.
    outside: Vec<usize>,
    seen: Vec<u32>,
    stamp: u32,
}

impl Quotient {
    fn new<N: Copy, Iptr: SpIndex>(matrix: CsMatViewI<'_, N, u32, Iptr>) -> Self {
        let n = matrix.rows();
        let variables: Vec<Vec<u32>> = (0..)
            .zip(matrix.outer_iterator())
            .map(|(u, row)| row.indices().iter().copied().filter(|&v| v != u).collect())
            .collect();
        let degree: Vec<usize> = variables.iter().map(Vec::len).collect();
        let mut buckets = Buckets::new(n);
        // Inserted in reverse, so that ties go to the smallest index.
        for u in (0..).take(n).collect::<Vec<u32>>().into_iter().rev() {
            buckets.insert(u, degree[u as usize]);
        }
        Self {
            variables,
            elements: vec![Vec::new(); n],
            members: vec![Vec::new(); n],
            eliminated: vec![false; n],
            degree,
            buckets,
            outside: vec![0; n],
            seen: vec![0; n],
            stamp: 0,
        }
    }

    /// Eliminates a variable of `left + 1`. Returns the number of other variables in its clique.
    fn eliminate(&mut self, pivot: u32, left: usize) -> usize {
        self.eliminated[pivot as usize] = true;
        self.stamp += 2;
        let (in_clique, element_seen) = (self.stamp, self.stamp + 1);
        // The clique of the pivot: its variables and those of its elements. It absorbs the elements.
        let absorbed = std::mem::take(&mut self.elements[pivot as usize]);
        let mut clique = Vec::new();
        let own = std::mem::take(&mut self.variables[pivot as usize]);
        let lists = absorbed.iter().map(|&e| std::mem::take(&mut self.members[e as usize]));
        for v in std::iter::once(own).chain(lists).flatten() {
            if !self.eliminated[v as usize] && self.seen[v as usize] != in_clique {
                self.seen[v as usize] = in_clique;
                clique.push(v);
            }
        }
        if clique.len() == left {
            return left;
        }
        // Part of each other element outside the clique.
        let mut element_stamp: Vec<u32> = Vec::new();
        for &v in &clique {
            let elements = std::mem::take(&mut self.elements[v as usize]);
            for &e in &elements {
                if self.members[e as usize].is_empty() {
                    continue;
                }
                // Elements have the numbers of their pivots, and pivots are no variables, so both can share the marks.
                if self.seen[e as usize] != element_seen {
                    self.seen[e as usize] = element_seen;
                    let eliminated = &self.eliminated;
                    self.members[e as usize].retain(|&m| !eliminated[m as usize]);
                    self.outside[e as usize] = self.members[e as usize].len();
                    element_stamp.push(e);
                }
                self.outside[e as usize] -= 1;
            }
            self.elements[v as usize] = elements;
        }
        for &v in &clique {
            let at = v as usize;
            // Edges inside the clique are covered by the new element from now on.
            let (seen, eliminated) = (&self.seen, &self.eliminated);
            self.variables[at].retain(|&w| seen[w as usize] != in_clique && !eliminated[w as usize]);
            let (members, outside) = (&self.members, &self.outside);
            // An element inside the clique is redundant.
            self.elements[at].retain(|&e| !members[e as usize].is_empty() && outside[e as usize] > 0);
            let beyond: usize = self.elements[at].iter().map(|&e| outside[e as usize]).sum();
            let others = clique.len() - 1;
            let degree = (self.variables[at].len() + others + beyond).min(self.degree[at] + others).min(left - 1);
            self.elements[at].push(pivot);
            self.buckets.remove(v, self.degree[at]);
            self.degree[at] = degree;
            self.buckets.insert(v, degree);
        }
        for e in element_stamp {
            if self.outside[e as usize] == 0 {
                self.members[e as usize] = Vec::new();
            }
        }
        let size = clique.len();
        self.members[pivot as usize] = clique;
        size
    }
}

/// Nodes by degree, in doubly linked lists.
struct Buckets {
    head: Vec<u32>,
    next: Vec<u32>,
    previous: Vec<u32>,
    least: usize,
}

const END: u32 = u32::MAX;

impl Buckets {
    fn new(n: usize) -> Self {
        Self { head: vec![END; n.max(1)], next: vec![END; n], previous: vec![END; n], least: 0 }
    }

    fn insert(&mut self, u: u32, degree: usize) {
        let old = self.head[degree];
        self.next[u as usize] = old;
        self.previous[u as usize] = END;
        if old != END {
            self.previous[old as usize] = u;
        }
        self.head[degree] = u;
        self.least = self.least.min(degree);
    }

    fn remove(&mut self, u: u32, degree: usize) {
        let (next, previous) = (self.next[u as usize], self.previous[u as usize]);
        if previous == END {
            self.head[degree] = next;
        } else {
            self.next[previous as usize] = next;
        }
        if next != END {
            self.previous[next as usize] = previous;
        }
    }

    fn take_least(&mut self) -> Option<u32> {
        while *self.head.get(self.least)? == END {
            self.least += 1;
        }
        let u = self.head[self.least];
        self.remove(u, self.least);
        Some(u)
    }
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
