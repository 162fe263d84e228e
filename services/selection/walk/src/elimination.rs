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
use super::gth::{F64_RANGE, Real};
use super::network::{range, row};
use super::ordering::minimum_degree;
use super::system::Fill;
use super::{Network, Seed, Solution, WalkError};

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

impl<T: Real> Columns<T> {
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

    /// Computes column k from the earlier columns.
    fn compute(&mut self, s: &Structure, k: usize, seeds: &[Seed], leak: Conductance) {
        let rows = s.fill.rows();
        for (j, c) in s.own(k) {
            self.work[j as usize] = T::of(c, self.shift);
        }
        let (mut f, mut b) = (T::ZERO, T::of(s.degree[k] * leak, self.shift));
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

    fn probabilities(&self, s: &Structure, seeds: &[Seed]) -> Solution {
        let n = s.order.len();
        let one = T::of(Conductance::ONE, 0);
        let mut both = vec![[T::ZERO; 2]; n];
        for k in (0..n).rev() {
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
        let mut solution = Solution { p: vec![0.0; n], q: vec![0.0; n], reached: vec![false; n] };
        for (&u, [p, q]) in s.order.iter().zip(both) {
            let u = u as usize;
            solution.reached[u] = !(p.is_nothing() && q.is_nothing());
            // With a single terminal, every walk that ends, ends there.
            solution.p[u] = if solution.reached[u] && q.is_nothing() { 1.0 } else { p.value() };
            solution.q[u] = if solution.reached[u] && p.is_nothing() { 1.0 } else { q.value() };
        }
        solution
    }

    /// Solves (Laplacian of the unknowns)·x = `source`, by rank and in units of this elimination. x is 0 at seeds. It is also 0
    /// where no terminal is reachable.
    fn green(&self, s: &Structure, seeds: &[Seed], mut source: Vec<T>) -> Vec<T> {
        let n = s.order.len();
        let rows = s.fill.rows();
        let open: Vec<bool> = (0..n).map(|k| seeds[k] == Seed::None && !self.total[k].is_nothing()).collect();
        for k in 0..n {
            if !open[k] {
                source[k] = T::ZERO;
            } else if !source[k].is_nothing() {
                let share = source[k] / self.total[k];
                for (&j, &w) in rows[s.fill.column(k)].iter().zip(&self.entry[s.fill.column(k)]) {
                    source[j as usize] = source[j as usize] + share * w;
                }
            }
        }
        for k in (0..n).rev().filter(|&k| open[k]) {
            let mut sum = source[k];
            for (&j, &w) in rows[s.fill.column(k)].iter().zip(&self.entry[s.fill.column(k)]) {
                sum = sum + w * source[j as usize];
            }
            source[k] = sum / self.total[k];
        }
        source
    }

    /// Diagonal of the inverse of the unknowns' Laplacian, by rank (Takahashi, Fagan, Chen 1973). The factors of such a
    /// matrix have one sign, so no subtraction is needed.
    fn green_diagonal(&self, s: &Structure, seeds: &[Seed]) -> Vec<T> {
        let n = s.order.len();
        let rows = s.fill.rows();
        let one = T::of(Conductance::ONE, 0);
        let mut inverse = vec![T::ZERO; self.entry.len()];
        let mut diagonal = vec![T::ZERO; n];
        let mut place = vec![usize::MAX; n];
        let mut sums: Vec<T> = Vec::new();
        for k in (0..n).rev() {
            if seeds[k] != Seed::None || self.total[k].is_nothing() {
                continue;
            }
            let column = s.fill.column(k);
            let own = &self.entry[column.clone()];
            sums.clear();
            sums.resize(own.len(), T::ZERO);
            for (a, &i) in rows[column.clone()].iter().enumerate() {
                place[i as usize] = a;
            }
            for (a, &i) in rows[column.clone()].iter().enumerate() {
                sums[a] = sums[a] + own[a] * diagonal[i as usize];
                let later = s.fill.column(i as usize);
                for (&j, &z) in rows[later.clone()].iter().zip(&inverse[later]) {
                    if let Some(&w) = own.get(place[j as usize]) {
                        let b = place[j as usize];
                        sums[b] = sums[b] + own[a] * z;
                        sums[a] = sums[a] + w * z;
                    }
                }
            }
            let mut sum = one;
            for (&w, &z) in own.iter().zip(&sums) {
                sum = sum + w * (z / self.total[k]);
            }
            diagonal[k] = sum / self.total[k];
            for (at, &j) in column.clone().zip(&rows[column.clone()]) {
                let z = sums[at - column.start] / self.total[k];
                inverse[at] = if seeds[j as usize] == Seed::None { z } else { T::ZERO };
                place[j as usize] = usize::MAX;
            }
        }
        diagonal
    }
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
    seeds: Vec<Seed>,
    leaking: Vec<bool>,
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
        Self { structure, seeds: vec![Seed::None; n], leaking: vec![true; n], leak: 0.0, numbers: None, made: 0 }
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
        if seeds.len() != n || leaking.is_some_and(|l| l.len() != n) {
            return Err(WalkError::Seeds { found: seeds.len(), nodes: n });
        }
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
        for (k, &u) in structure.order.iter().enumerate() {
            let (seed, leaks) = (seeds[u as usize], leaking.is_none_or(|l| l[u as usize]));
            if self.seeds[k] != seed {
                self.seeds[k] = seed;
                if let Some(parent) = structure.fill.parent(k) {
                    changed[parent as usize] = true;
                }
            }
            if self.leaking[k] != leaks {
                self.leaking[k] = leaks;
                changed[k] = true;
            }
        }
        self.leak = leak;
        self.made = 0;
        let mut numbers = numbers;
        for k in 0..n {
            if !changed[k] {
                continue;
            }
            let own = if self.leaking[k] { conductance } else { Conductance::ZERO };
            match &mut numbers {
                Numbers::Plain(columns) => columns.compute(&structure, k, &self.seeds, own),
                Numbers::Wide(columns) => columns.compute(&structure, k, &self.seeds, own),
            }
            self.made += 1;
            if let Some(parent) = structure.fill.parent(k) {
                changed[parent as usize] = true;
            }
        }
        let solution = match &numbers {
            Numbers::Plain(columns) => columns.probabilities(&structure, &self.seeds),
            Numbers::Wide(columns) => columns.probabilities(&structure, &self.seeds),
        };
        if !solution.p.iter().chain(&solution.q).all(|x| x.is_finite()) {
            let reason = "a conductance underflowed or overflowed".to_owned();
            return Err(WalkError::Breakdown { solver: "gth in f64", reason });
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
        let mut out =
            Self { structure, seeds: seeds.clone(), leaking: vec![true; n], leak: 0.0, numbers: None, made: 0 };
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
                put(1.0, columns.shift, &mut columns.green(s, &self.seeds, source).into_iter());
            }
            Some(Numbers::Wide(columns)) => {
                for sign in [1.0, -1.0] {
                    let of = |u: &u32| Conductance::new((sign * b[*u as usize]).max(0.0)).unwrap_or(Conductance::ZERO);
                    let source = s.order.iter().map(of).collect();
                    let x = columns.green(s, &self.seeds, source);
                    put(sign, 0, &mut x.into_iter().map(Conductance::value));
                }
            }
            None => {}
        }
        out
    }

    /// Probability, for each start node, that a walker visits `node` before its walk ends; 1 at `node` itself.
    ///
    /// `None` before the first walk, at a seed, and where no terminal is reachable.
    #[must_use]
    pub fn hitting(&self, node: usize) -> Option<Vec<f64>> {
        match self.numbers.as_ref()? {
            Numbers::Plain(columns) => self.hitting_in(columns, node),
            Numbers::Wide(columns) => self.hitting_in(columns, node),
        }
    }

    fn hitting_in<T: Real>(&self, columns: &Columns<T>, node: usize) -> Option<Vec<f64>> {
        let s = &self.structure;
        let k = s.order.iter().position(|&u| u as usize == node)?;
        if self.seeds[k] != Seed::None || columns.total[k].is_nothing() {
            return None;
        }
        let mut source = vec![T::ZERO; s.order.len()];
        source[k] = T::of(Conductance::ONE, 0);
        let green = columns.green(s, &self.seeds, source);
        let mut out = vec![0.0; green.len()];
        for (&u, &g) in s.order.iter().zip(&green) {
            out[u as usize] = (g / green[k]).value();
        }
        Some(out)
    }

    /// Σ over i of `mass[i]` times the probability that a walker from i visits s, for each node s. Masses are at least 0.
    ///
    /// The cost for all s is about one elimination. The sum is 0 at seeds and where no terminal is reachable. `None` before
    /// the first walk.
    #[must_use]
    pub fn hitting_mass(&self, mass: &[f64]) -> Option<Vec<f64>> {
        match self.numbers.as_ref()? {
            Numbers::Plain(columns) => Some(self.hitting_mass_in(columns, mass)),
            Numbers::Wide(columns) => Some(self.hitting_mass_in(columns, mass)),
        }
    }

    fn hitting_mass_in<T: Real>(&self, columns: &Columns<T>, mass: &[f64]) -> Vec<f64> {
        let s = &self.structure;
        let of = |u: &u32| Conductance::new(mass[*u as usize]).unwrap_or(Conductance::ZERO);
        let green = columns.green(s, &self.seeds, s.order.iter().map(|u| T::of(of(u), 0)).collect());
        let diagonal = columns.green_diagonal(s, &self.seeds);
        let mut out = vec![0.0; green.len()];
        for ((&u, g), d) in s.order.iter().zip(green).zip(diagonal) {
            if !d.is_nothing() {
                out[u as usize] = (g / d).value();
            }
        }
        out
    }
}
