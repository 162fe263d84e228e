//! An elimination that is reused for many walks on one graph. A new stroke costs only the columns that it changes.
//!
//! All nodes, seeded or not, are unknowns of one elimination in one order (`Structure`). Column k holds the conductances
//! from node k, at its turn, to later nodes and to the two terminals. A seed is *not* eliminated: each later neighbour
//! gets its conductance to the seed as a conductance to a terminal. So a change of a seed affects only the columns of its
//! ancestors in the elimination tree. Only these columns are computed again.
//!
//! The algorithm uses sums, products and quotients of non-negative numbers only, so entries are as accurate as those of
//! [`super::gth`]. A column is always summed in the same order. So the bits of a solution do not depend on earlier seeds.

use std::ops::Range;
use std::sync::Arc;

use sprs::{CsMatI, PermOwnedI, transform_mat_papt};

use super::conductance::Conductance;
use super::gth::{Arithmetic, F64_RANGE, Real};
use super::network::{range, row};
use super::ordering::minimum_degree;
use super::system::Fill;
use super::{Network, Seed, Solution, WalkError};

mod family;
mod hitting;

pub use family::EliminationFamily;

/// The structure of the elimination of a graph. It does not depend on the seeds.
#[derive(Debug)]
struct Structure {
    /// Node of each rank.
    order: Vec<u32>,
    fill: Fill,
    /// For each rank: the earlier columns with an entry for it and the position of that entry, ascending.
    before_offsets: Vec<usize>,
    before: Vec<(u32, u32)>,
    /// First position of the contiguous rows at the end of each column.
    dense: Vec<usize>,
    /// The matrix of the graph in elimination order.
    ordered: CsMatI<Conductance, u32, usize>,
    /// First position of each row right of the diagonal: the conductances to later ranks.
    later: Vec<usize>,
    /// Smallest and largest binary exponent of the conductances.
    exponents: Option<(i64, i64)>,
    degree: Vec<Conductance>,
}

impl Structure {
    fn new(network: &Network, order: &PermOwnedI<u32>) -> Self {
        let n = network.len();
        let ordered = transform_mat_papt(network.adjacency(), order.view());
        let order = order.vec();
        let fill = Fill::new(&ordered);
        let rows = fill.rows();
        let mut before_offsets = vec![0_usize; n + 1];
        for &j in rows {
            before_offsets[j as usize + 1] += 1;
        }
        for k in 0..n {
            before_offsets[k + 1] += before_offsets[k];
        }
        let mut next = before_offsets.clone();
        let mut before = vec![(0, 0); rows.len()];
        let mut dense = Vec::with_capacity(n);
        for k in 0..n {
            let column = fill.column(k);
            for at in column.clone() {
                let j = rows[at] as usize;
                before[next[j]] = (k as u32, at as u32);
                next[j] += 1;
            }
            let mut from = column.end;
            while from > column.start && (from == column.end || rows[from - 1] + 1 == rows[from]) {
                from -= 1;
            }
            dense.push(from);
        }
        let later = (0..)
            .take(n)
            .map(|k| range(&ordered, k as usize).start + row(&ordered, k).0.partition_point(|&j| j < k))
            .collect();
        let exponents = exponent_range(ordered.data().iter().copied());
        let degree = order.iter().map(|&u| network.degree(u)).collect();
        Self { order, fill, before_offsets, before, dense, ordered, later, exponents, degree }
    }

    /// Updates seeds and leaking states, and marks all columns that change with them: those marked before, and their ancestors.
    fn update(&self, seeds: &[Seed], leaking: Option<&[bool]>, own: &mut Terminals, changed: &mut [bool]) {
        for (k, &u) in self.order.iter().enumerate() {
            let (seed, leaks) = (seeds[u as usize], leaking.is_none_or(|l| l[u as usize]));
            if own.seeds[k] != seed {
                own.seeds[k] = seed;
                if let Some(parent) = self.fill.parent(k) {
                    changed[parent as usize] = true;
                }
            }
            if own.leaking[k] != leaks {
                own.leaking[k] = leaks;
                changed[k] = true;
            }
        }
        for k in 0..changed.len() {
            if let Some(parent) = self.fill.parent(k).filter(|_| changed[k]) {
                changed[parent as usize] = true;
            }
        }
    }

    /// Smallest and largest binary exponent of the conductances, including a leak.
    fn exponents(&self, leak: Conductance) -> (i64, i64) {
        let leaks = exponent_range(self.degree.iter().map(|&d| d * leak));
        match (self.exponents, leaks) {
            (Some(a), Some(b)) => (a.0.min(b.0), a.1.max(b.1)),
            (range, other) => range.or(other).unwrap_or((0, 0)),
        }
    }

    /// Ranks and conductances of the later neighbours of a rank in the graph.
    fn own(&self, k: usize) -> impl Iterator<Item = (u32, Conductance)> + '_ {
        let later = self.later[k]..range(&self.ordered, k).end;
        self.ordered.indices()[later.clone()].iter().copied().zip(self.ordered.data()[later].iter().copied())
    }
}

/// Smallest and largest binary exponent of conductances above 0.
fn exponent_range(conductances: impl Iterator<Item = Conductance>) -> Option<(i64, i64)> {
    conductances
        .filter(|c| !c.is_zero())
        .map(Conductance::exponent)
        .fold(None, |range, e| Some(range.map_or((e, e), |r: (i64, i64)| (r.0.min(e), r.1.max(e)))))
}

/// The values of an elimination.
#[derive(Debug, Clone)]
struct Columns<T> {
    shift: i64,
    entry: Vec<T>,
    foreground: Vec<T>,
    background: Vec<T>,
    total: Vec<T>,
    work: Vec<T>,
    /// Contiguous column parts that are pending for `work`: factor and position.
    runs: Vec<(T, Range<usize>)>,
}

impl<T: Arithmetic> Columns<T> {
    fn new(structure: &Structure, shift: i64) -> Self {
        let n = structure.order.len();
        Self {
            shift,
            entry: vec![T::ZERO; structure.fill.rows().len()],
            foreground: vec![T::ZERO; n],
            background: vec![T::ZERO; n],
            total: vec![T::ZERO; n],
            work: vec![T::ZERO; n],
            runs: Vec::new(),
        }
    }

    /// Adds the runs to `work` from `first` on, four at a time.
    fn add_runs(&mut self, first: usize) {
        let runs = std::mem::take(&mut self.runs);
        let entry = &self.entry;
        for four in runs.chunks(4) {
            if let [(s, a), (t, b), (u, c), (v, d)] = four
                && [b, c, d].iter().all(|r| r.len() == a.len())
            {
                let columns =
                    entry[a.clone()].iter().zip(&entry[b.clone()]).zip(&entry[c.clone()]).zip(&entry[d.clone()]);
                for (x, (((&a, &b), &c), &d)) in self.work[first..].iter_mut().zip(columns) {
                    *x = *x + ((*s * a + *t * b) + (*u * c + *v * d));
                }
            } else {
                for (share, run) in four {
                    for (x, &e) in self.work[first..].iter_mut().zip(&entry[run.clone()]) {
                        *x = *x + *share * e;
                    }
                }
            }
        }
        self.runs = runs;
        self.runs.clear();
    }

    /// Computes column k from the earlier columns. `background` is the conductance of the node's leak.
    fn compute(&mut self, s: &Structure, k: usize, seeds: &[Seed], background: T) {
        let rows = s.fill.rows();
        for (j, c) in s.own(k) {
            self.work[j as usize] = T::of(c, self.shift);
        }
        let (mut f, mut b) = (T::ZERO, background);
        for &(c, at) in &s.before[s.before_offsets[k]..s.before_offsets[k + 1]] {
            let (c, at) = (c as usize, at as usize);
            let w = self.entry[at];
            match seeds[c] {
                Seed::Foreground => f = f + w,
                Seed::Background => b = b + w,
                Seed::None => {
                    if w.is_nothing() {
                        continue;
                    }
                    let share = w / self.total[c];
                    f = f + share * self.foreground[c];
                    b = b + share * self.background[c];
                    let end = s.fill.column(c).end;
                    if s.dense[c] <= at {
                        // The row after this one is k + 1.
                        self.runs.push((share, at + 1..end));
                        continue;
                    }
                    let dense = s.dense[c];
                    for (&j, &e) in rows[at + 1..dense].iter().zip(&self.entry[at + 1..dense]) {
                        self.work[j as usize] = self.work[j as usize] + share * e;
                    }
                    if dense < end {
                        let first = rows[dense] as usize;
                        for (x, &e) in self.work[first..].iter_mut().zip(&self.entry[dense..end]) {
                            *x = *x + share * e;
                        }
                    }
                }
            }
        }
        self.add_runs(k + 1);
        let column = s.fill.column(k);
        let mut sum = f + b;
        for (&j, e) in rows[column.clone()].iter().zip(&mut self.entry[column]) {
            *e = self.work[j as usize];
            self.work[j as usize] = T::ZERO;
            sum = sum + *e;
        }
        (self.foreground[k], self.background[k], self.total[k]) = (f, b, sum);
    }

    /// Probabilities of foreground and background by rank; both 0 where no terminal is reached.
    fn ends(&self, s: &Structure, seeds: &[Seed]) -> Vec<[T; 2]> {
        let one = T::of(Conductance::ONE, 0);
        let mut both = vec![[T::ZERO; 2]; s.order.len()];
        for k in (0..both.len()).rev() {
            both[k] = match seeds[k] {
                Seed::Foreground => [one, T::ZERO],
                Seed::Background => [T::ZERO, one],
                Seed::None if self.total[k].is_nothing() => [T::ZERO; 2],
                Seed::None => {
                    let column = s.fill.column(k);
                    let (mut f, mut b) = (self.foreground[k], self.background[k]);
                    for (&j, &w) in s.fill.rows()[column.clone()].iter().zip(&self.entry[column]) {
                        let [p, q] = both[j as usize];
                        f = f + w * p;
                        b = b + w * q;
                    }
                    [f / self.total[k], b / self.total[k]]
                }
            };
        }
        both
    }
}

impl<T: Real> Columns<T> {
    /// Computes column k with a leak in units of the node's degree.
    fn compute_leaking(&mut self, s: &Structure, k: usize, seeds: &[Seed], leak: Conductance) {
        self.compute(s, k, seeds, T::of(s.degree[k] * leak, self.shift));
    }

    fn probabilities(&self, s: &Structure, seeds: &[Seed]) -> Solution {
        let n = s.order.len();
        let mut solution = Solution { p: vec![0.0; n], q: vec![0.0; n], reached: vec![false; n] };
        for (&u, [p, q]) in s.order.iter().zip(self.ends(s, seeds)) {
            let u = u as usize;
            solution.reached[u] = !(p.is_nothing() && q.is_nothing());
            // With a single terminal, every walk that ends, ends there.
            solution.p[u] = if solution.reached[u] && q.is_nothing() { 1.0 } else { p.value() };
            solution.q[u] = if solution.reached[u] && p.is_nothing() { 1.0 } else { q.value() };
        }
        solution
    }
}

/// Seeds and leaking nodes of a walk, by rank.
#[derive(Debug, Clone)]
struct Terminals {
    seeds: Vec<Seed>,
    leaking: Vec<bool>,
}

impl Terminals {
    fn none(n: usize) -> Self {
        Self { seeds: vec![Seed::None; n], leaking: vec![true; n] }
    }
}

fn check(seeds: &[Seed], leaking: Option<&[bool]>, n: usize) -> Result<(), WalkError> {
    if seeds.len() != n || leaking.is_some_and(|l| l.len() != n) {
        return Err(WalkError::Seeds { found: seeds.len(), nodes: n });
    }
    Ok(())
}

fn broken_down() -> WalkError {
    WalkError::Breakdown { solver: "gth in f64", reason: "a conductance underflowed or overflowed".to_owned() }
}

#[derive(Debug, Clone)]
enum Numbers {
    Plain(Columns<f64>),
    Wide(Columns<Conductance>),
}

/// A reusable elimination of a graph, with the seeds and the leak of its last walk.
#[derive(Debug, Clone)]
pub struct Elimination {
    structure: Arc<Structure>,
    terminals: Terminals,
    leak: f64,
    numbers: Option<Numbers>,
    made: usize,
}

impl Elimination {
    /// Prepares the elimination of a graph. `order` is as for [`super::solve`].
    ///
    /// # Panics
    /// If the order is that of a graph with another number of nodes.
    #[must_use]
    pub fn new(network: &Network, order: Option<&PermOwnedI<u32>>) -> Self {
        let n = network.len();
        let structure = Arc::new(match order {
            Some(order) => Structure::new(network, order),
            None => Structure::new(network, &minimum_degree(network.adjacency())),
        });
        Self { structure, terminals: Terminals::none(n), leak: 0.0, numbers: None, made: 0 }
    }

    /// Number of nodes.
    #[must_use]
    pub fn len(&self) -> usize {
        self.structure.order.len()
    }

    /// Whether there is no node.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Number of columns that the last walk eliminated, at most [`Elimination::len`].
    #[must_use]
    pub fn eliminated_columns(&self) -> usize {
        self.made
    }

    /// Number of stored conductances.
    #[must_use]
    pub fn entries(&self) -> usize {
        self.structure.fill.rows().len()
    }

    /// Connected component of each node. The id of a component is one of its nodes.
    #[must_use]
    pub fn components(&self) -> Vec<u32> {
        let s = &self.structure;
        let mut root: Vec<u32> = (0..).take(self.len()).collect();
        let mut out = vec![0; self.len()];
        for k in (0..self.len()).rev() {
            if let Some(parent) = s.fill.parent(k) {
                root[k] = root[parent as usize];
            }
            out[s.order[k] as usize] = s.order[root[k] as usize];
        }
        out
    }

    /// Solves a walk. Seeds, leak and leaking nodes are as in [`super::Problem`].
    ///
    /// Changed seeds cost the columns of their ancestors in the elimination tree. A changed leak costs all columns.
    ///
    /// # Errors
    /// [`WalkError`] if the input is invalid or the numbers break down. The next walk then eliminates all columns.
    pub fn solve(&mut self, seeds: &[Seed], leak: f64, leaking: Option<&[bool]>) -> Result<Solution, WalkError> {
        let n = self.len();
        if !(leak >= 0.0 && leak.is_finite()) {
            return Err(WalkError::Leak(leak));
        }
        check(seeds, leaking, n)?;
        let structure = Arc::clone(&self.structure);
        let conductance = Conductance::new(leak).unwrap_or(Conductance::ZERO);
        let (least, largest) = structure.exponents(conductance);
        let wide = largest - least > F64_RANGE;
        let old = self.numbers.take();
        let mut changed = vec![false; n];
        let numbers = match old {
            Some(numbers) if leak == self.leak && matches!(numbers, Numbers::Wide(_)) == wide => numbers,
            _ => {
                changed.fill(true);
                if wide {
                    Numbers::Wide(Columns::new(&structure, largest))
                } else {
                    Numbers::Plain(Columns::new(&structure, largest))
                }
            }
        };
        structure.update(seeds, leaking, &mut self.terminals, &mut changed);
        self.leak = leak;
        self.made = changed.iter().filter(|c| **c).count();
        let mut numbers = numbers;
        for k in (0..n).filter(|k| changed[*k]) {
            let own = if self.terminals.leaking[k] { conductance } else { Conductance::ZERO };
            match &mut numbers {
                Numbers::Plain(columns) => columns.compute_leaking(&structure, k, &self.terminals.seeds, own),
                Numbers::Wide(columns) => columns.compute_leaking(&structure, k, &self.terminals.seeds, own),
            }
        }
        let solution = match &numbers {
            Numbers::Plain(columns) => columns.probabilities(&structure, &self.terminals.seeds),
            Numbers::Wide(columns) => columns.probabilities(&structure, &self.terminals.seeds),
        };
        if !solution.p.iter().chain(&solution.q).all(|x| x.is_finite()) {
            return Err(broken_down());
        }
        self.numbers = Some(numbers);
        Ok(solution)
    }

    /// Eliminates (Laplacian + diagonal of `ground`), without seeds.
    ///
    /// # Errors
    /// [`WalkError`] if the numbers break down.
    pub(super) fn grounded(network: &Network, ground: &[f64]) -> Result<Self, WalkError> {
        let n = network.len();
        let mut structure = Structure::new(network, &minimum_degree(network.adjacency()));
        let of = |u: &u32| Conductance::new(ground[*u as usize]).unwrap_or(Conductance::ZERO);
        structure.degree = structure.order.iter().map(of).collect();
        let structure = Arc::new(structure);
        let seeds = vec![Seed::None; n];
        let mut out = Self { structure, terminals: Terminals::none(n), leak: 0.0, numbers: None, made: 0 };
        out.solve(&seeds, 1.0, None)?;
        Ok(out)
    }

    /// Solves A·x = `b` for an elimination from [`Elimination::grounded`]. x is 0 where A is singular.
    pub(super) fn grounded_solution(&self, b: &[f64]) -> Vec<f64> {
        let s = &self.structure;
        let mut out = vec![0.0; b.len()];
        let mut put = |scale: f64, shift: i64, x: &mut dyn Iterator<Item = f64>| {
            // Columns are in units of 2^shift.
            let unit = scale * 2.0_f64.powi(-(shift as i32));
            s.order.iter().zip(x).for_each(|(&u, x)| out[u as usize] += unit * x);
        };
        match &self.numbers {
            Some(Numbers::Plain(columns)) => {
                let source = s.order.iter().map(|&u| b[u as usize]).collect();
                put(1.0, columns.shift, &mut columns.green(s, &self.terminals.seeds, source).into_iter());
            }
            Some(Numbers::Wide(columns)) => {
                for sign in [1.0, -1.0] {
                    let of = |u: &u32| Conductance::new((sign * b[*u as usize]).max(0.0)).unwrap_or(Conductance::ZERO);
                    let source = s.order.iter().map(of).collect();
                    let x = columns.green(s, &self.terminals.seeds, source);
                    put(sign, 0, &mut x.into_iter().map(Conductance::value));
                }
            }
            None => {}
        }
        out
    }
}
