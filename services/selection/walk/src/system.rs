//! One connected part of a walk: unknowns, conductances, and the structure of the elimination.

use sprs::{CsMatI, CsMatViewI};

use super::network::{links, row};
use super::ordering::minimum_degree;
use super::{Conductance, Problem, Seed, SystemSolver};

/// A connected set of unknowns in elimination order, with conductances between them and to the two terminals.
///
/// Division by 2^[`System::shift`] scales the largest conductance to about 1. Scaling changes no probability.
#[derive(Debug, Clone)]
pub struct System {
    nodes: Vec<u32>,
    conductances: CsMatI<Conductance, u32, usize>,
    foreground: Vec<Conductance>,
    background: Vec<Conductance>,
}

impl System {
    /// The system of the given unknowns. They must form a connected component of the nodes without a seed.
    pub(super) fn new(
        problem: &Problem<'_>,
        mut nodes: Vec<u32>,
        rank: Option<&[u32]>,
        solver: &dyn SystemSolver,
    ) -> Self {
        if solver.eliminates(nodes.len()) {
            match rank {
                Some(rank) => nodes.sort_by_key(|&u| rank[u as usize]),
                None => {
                    let natural = Self::in_order(problem, nodes);
                    nodes = &minimum_degree(natural.conductances()) * &natural.nodes[..];
                }
            }
        }
        Self::in_order(problem, nodes)
    }

    fn in_order(problem: &Problem<'_>, nodes: Vec<u32>) -> Self {
        let mut local = vec![u32::MAX; problem.network.len()];
        for (k, &u) in (0..).zip(&nodes) {
            local[u as usize] = k;
        }
        let n = nodes.len();
        let leak = Conductance::new(problem.leak).unwrap_or(Conductance::ZERO);
        let (mut foreground, mut background) = (vec![Conductance::ZERO; n], vec![Conductance::ZERO; n]);
        let mut offsets = Vec::with_capacity(n + 1);
        offsets.push(0);
        for (k, &u) in nodes.iter().enumerate() {
            if problem.leaking.is_none_or(|l| l[u as usize]) {
                background[k] = problem.network.degree(u) * leak;
            }
            let mut unknown = 0;
            for (v, w) in problem.network.links(u) {
                match problem.seeds[v as usize] {
                    Seed::None => unknown += 1,
                    Seed::Foreground => foreground[k] = foreground[k] + w,
                    Seed::Background => background[k] = background[k] + w,
                }
            }
            offsets.push(offsets[k] + unknown);
        }
        // The matrix is symmetric: its columns in order fill its rows in order, without a sort.
        let mut next = offsets.clone();
        let mut columns = vec![0; offsets[n]];
        let mut values = vec![Conductance::ZERO; offsets[n]];
        for (k, &u) in (0..).zip(&nodes) {
            for (v, w) in problem.network.links(u) {
                if let Some(next) = next.get_mut(local[v as usize] as usize) {
                    (columns[*next], values[*next]) = (k, w);
                    *next += 1;
                }
            }
        }
        let conductances = CsMatI::new((n, n), offsets, columns, values);
        Self { nodes, conductances, foreground, background }
    }

    /// The unknowns as nodes of the walk's graph, in this system's order.
    #[must_use]
    pub fn nodes(&self) -> &[u32] {
        &self.nodes
    }

    /// Number of unknowns.
    #[must_use]
    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Whether there is no unknown.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// Conductances between the unknowns: symmetric, in compressed rows, with an empty diagonal.
    #[must_use]
    pub fn conductances(&self) -> CsMatViewI<'_, Conductance, u32, usize> {
        self.conductances.view()
    }

    /// Neighbours of an unknown, ascending.
    #[must_use]
    pub fn neighbours(&self, k: u32) -> &[u32] {
        row(&self.conductances, k).0
    }

    /// Neighbours of an unknown, with conductances, ascending.
    pub fn links(&self, k: u32) -> impl ExactSizeIterator<Item = (u32, Conductance)> + Clone + '_ {
        links(&self.conductances, k)
    }

    /// Conductance of each unknown to the foreground terminal.
    #[must_use]
    pub fn foreground(&self) -> &[Conductance] {
        &self.foreground
    }

    /// Conductance of each unknown to the background terminal.
    #[must_use]
    pub fn background(&self) -> &[Conductance] {
        &self.background
    }

    fn exponents(&self) -> impl Iterator<Item = i64> + '_ {
        self.conductances
            .data()
            .iter()
            .copied()
            .chain(self.foreground.iter().copied())
            .chain(self.background.iter().copied())
            .filter(|c| !c.is_zero())
            .map(Conductance::exponent)
    }

    /// Binary exponent of the largest conductance.
    #[must_use]
    pub fn shift(&self) -> i64 {
        self.exponents().max().unwrap_or(0)
    }

    /// Powers of two between the smallest and the largest conductance.
    #[must_use]
    pub fn range(&self) -> i64 {
        self.shift() - self.exponents().min().unwrap_or(0)
    }

    /// Structure of the elimination of the unknowns in order.
    #[must_use]
    pub fn fill(&self) -> Fill {
        Fill::new(&self.conductances)
    }
}

/// Fill pattern: for each unknown, its later neighbours at the time of its elimination, ascending.
#[derive(Debug, Clone)]
pub struct Fill {
    offsets: Vec<usize>,
    rows: Vec<u32>,
}

impl Fill {
    /// The structure of eliminating the unknowns of a symmetric matrix in order.
    #[must_use]
    pub fn new<N>(matrix: &CsMatI<N, u32, usize>) -> Self {
        // The later neighbours of an unknown become neighbours of the first of them, its parent in the elimination tree.
        let n = matrix.rows();
        const NONE: u32 = u32::MAX;
        let mut first_child = vec![NONE; n];
        let mut next_child = vec![NONE; n];
        let mut mark = vec![u32::MAX; n];
        let mut offsets = Vec::with_capacity(n + 1);
        let mut rows: Vec<u32> = Vec::new();
        offsets.push(0);
        for k in (0..).take(n) {
            let start = rows.len();
            mark[k as usize] = k;
            let neighbours = row(matrix, k).0;
            for &j in &neighbours[neighbours.partition_point(|&j| j <= k)..] {
                mark[j as usize] = k;
                rows.push(j);
            }
            let mut next = first_child[k as usize];
            while next != NONE {
                let c = next;
                next = next_child[c as usize];
                for at in offsets[c as usize]..offsets[c as usize + 1] {
                    let j = rows[at];
                    if mark[j as usize] != k {
                        mark[j as usize] = k;
                        rows.push(j);
                    }
                }
            }
            rows[start..].sort_unstable();
            if let Some(&parent) = rows.get(start) {
                next_child[k as usize] = first_child[parent as usize];
                first_child[parent as usize] = k;
            }
            offsets.push(rows.len());
        }
        Self { offsets, rows }
    }

    /// Positions of the entries of an unknown in [`Fill::rows`].
    #[must_use]
    pub fn column(&self, k: usize) -> std::ops::Range<usize> {
        self.offsets[k]..self.offsets[k + 1]
    }

    /// Parent of an unknown in the elimination tree: its first later neighbour.
    #[must_use]
    pub fn parent(&self, k: usize) -> Option<u32> {
        self.rows[self.column(k)].first().copied()
    }

    /// All entries, grouped by unknown.
    #[must_use]
    pub fn rows(&self) -> &[u32] {
        &self.rows
    }
}
