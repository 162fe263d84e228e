//! Walks for several leaks at once: one elimination whose numbers are those of several walks side by side.
//!
//! The leaks of a family differ in the conductances to the background terminal alone. So the order, the structure and the
//! places of all entries are common, and one pass over them serves several leaks (four side by side). Every leak goes
//! through the operations of [`Elimination::solve`] in the same order. So the bits are those of one ordinary walk a leak,
//! as long as no conductance underflows; conductances beyond the range of f64 are eliminated one leak after another.
//!
//! A larger leak ends more walks in the background, so p falls and q rises at every node that is reached. The selected sets
//! of one family are therefore nested for any seeds, any leaking nodes and any threshold, up to the rounding of p − q.

use std::array::from_fn;
use std::ops::{Add, Div, Mul};
use std::sync::Arc;

use rayon::prelude::*;

use super::{Columns, Elimination, Structure, Terminals, broken_down, check};
use crate::conductance::Conductance;
use crate::gth::{Arithmetic, F64_RANGE};
use crate::{Seed, Solution, WalkError};

/// Leaks side by side in one pass.
const WIDTH: usize = 4;

/// The numbers of [`WIDTH`] walks side by side. 0 / 0 is 0: a walk without any conductance here has no share to pass on.
#[derive(Debug, Clone, Copy)]
#[repr(align(32))]
struct Lanes([f64; WIDTH]);

impl Add for Lanes {
    type Output = Self;

    #[inline(always)]
    fn add(self, o: Self) -> Self {
        let ([a, b, c, d], [e, f, g, h]) = (self.0, o.0);
        Self([a + e, b + f, c + g, d + h])
    }
}

impl Mul for Lanes {
    type Output = Self;

    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        let ([a, b, c, d], [e, f, g, h]) = (self.0, o.0);
        Self([a * e, b * f, c * g, d * h])
    }
}

impl Div for Lanes {
    type Output = Self;

    #[inline(always)]
    fn div(self, o: Self) -> Self {
        let ([a, b, c, d], [e, f, g, h]) = (self.0, o.0);
        let quotient = [a / e, b / f, c / g, d / h];
        Self(from_fn(|lane| if self.0[lane] == 0.0 { 0.0 } else { quotient[lane] }))
    }
}

impl Arithmetic for Lanes {
    const ZERO: Self = Self([0.0; WIDTH]);

    fn of(c: Conductance, shift: i64) -> Self {
        Self([c.scaled(shift); WIDTH])
    }

    #[inline(always)]
    fn is_nothing(self) -> bool {
        self.0 == [0.0; WIDTH]
    }
}

/// Some leaks of the family, and their numbers.
#[derive(Debug, Clone)]
struct Group {
    /// Conductance of the leak of each rank.
    leak: Arc<[Lanes]>,
    columns: Columns<Lanes>,
}

#[derive(Debug, Clone)]
enum Numbers {
    /// Groups of [`WIDTH`] leaks. The last one repeats its last leak.
    Together(Vec<Group>),
    /// One elimination a leak.
    Apart(Vec<Elimination>),
}

/// A reusable elimination of a graph for several leaks, with the seeds of its last walk. See the page of the module.
#[derive(Debug, Clone)]
pub struct EliminationFamily {
    structure: Arc<Structure>,
    leaks: Arc<[f64]>,
    terminals: Terminals,
    numbers: Numbers,
    /// Whether the numbers are those of the terminals.
    valid: bool,
    made: usize,
}

impl Elimination {
    /// The same graph for several leaks at once.
    ///
    /// # Errors
    /// [`WalkError::Leak`] for a negative or infinite leak.
    pub fn family(&self, leaks: &[f64]) -> Result<EliminationFamily, WalkError> {
        let structure = Arc::clone(&self.structure);
        let n = structure.order.len();
        let mut range = structure.exponents(Conductance::ZERO);
        let mut conductances = Vec::with_capacity(leaks.len());
        for &leak in leaks {
            let conductance = Conductance::new(leak).ok_or(WalkError::Leak(leak))?;
            let (least, largest) = structure.exponents(conductance);
            range = (range.0.min(least), range.1.max(largest));
            conductances.push(conductance);
        }
        let numbers = if range.1 - range.0 > F64_RANGE {
            Numbers::Apart(vec![Self { numbers: None, terminals: Terminals::none(n), ..self.clone() }; leaks.len()])
        } else {
            let group = |some: &[Conductance]| {
                let lane = |lane: usize| some.get(lane).or(some.last()).copied().unwrap_or(Conductance::ZERO);
                let lanes: [Conductance; WIDTH] = from_fn(lane);
                let leak = structure.degree.iter().map(|d| Lanes(lanes.map(|l| (*d * l).scaled(range.1)))).collect();
                Group { leak, columns: Columns::new(&structure, range.1) }
            };
            Numbers::Together(conductances.chunks(WIDTH).map(group).collect())
        };
        let terminals = Terminals::none(n);
        Ok(EliminationFamily { structure, leaks: leaks.into(), terminals, numbers, valid: false, made: 0 })
    }
}

impl EliminationFamily {
    /// The leaks.
    #[must_use]
    pub fn leaks(&self) -> &[f64] {
        &self.leaks
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

    /// Number of columns that the last walks eliminated, at most [`EliminationFamily::len`].
    #[must_use]
    pub fn eliminated_columns(&self) -> usize {
        self.made
    }

    /// Solves one walk for each leak, in the order of the leaks. Seeds and leaking nodes are as in [`crate::Problem`].
    ///
    /// Changed seeds cost the columns of their ancestors in the elimination tree. Leaks are spread over the threads; the
    /// result does not depend on their number.
    ///
    /// # Errors
    /// [`WalkError`] if the input is invalid or the numbers break down. The next walks then eliminate all columns.
    pub fn solve(&mut self, seeds: &[Seed], leaking: Option<&[bool]>) -> Result<Vec<Solution>, WalkError> {
        let n = self.len();
        check(seeds, leaking, n)?;
        let Self { structure, leaks, terminals, numbers, valid, made } = self;
        let mut changed = vec![!std::mem::replace(valid, false); n];
        structure.update(seeds, leaking, terminals, &mut changed);
        *made = changed.iter().filter(|c| **c).count();
        let solutions = match numbers {
            Numbers::Together(groups) => {
                let of = |group: &mut Group| group.solve(structure, terminals, &changed);
                let solutions: Vec<[Solution; WIDTH]> = groups.par_iter_mut().map(of).collect();
                solutions.into_iter().flatten().take(leaks.len()).collect()
            }
            Numbers::Apart(eliminations) => eliminations
                .par_iter_mut()
                .zip(&**leaks)
                .map(|(elimination, leak)| elimination.solve(seeds, *leak, leaking))
                .collect::<Result<Vec<Solution>, WalkError>>()?,
        };
        if !solutions.iter().flat_map(|s| s.p.iter().chain(&s.q)).all(|x| x.is_finite()) {
            return Err(broken_down());
        }
        *valid = true;
        Ok(solutions)
    }
}

impl Group {
    fn solve(&mut self, s: &Structure, terminals: &Terminals, changed: &[bool]) -> [Solution; WIDTH] {
        for k in (0..changed.len()).filter(|k| changed[*k]) {
            let background = if terminals.leaking[k] { self.leak[k] } else { Lanes::ZERO };
            self.columns.compute(s, k, &terminals.seeds, background);
        }
        self.probabilities(s, &terminals.seeds)
    }

    /// As `Columns::probabilities` for each lane.
    fn probabilities(&self, s: &Structure, seeds: &[Seed]) -> [Solution; WIDTH] {
        let n = s.order.len();
        let both = self.columns.ends(s, seeds);
        from_fn(|lane| {
            let mut solution = Solution { p: vec![0.0; n], q: vec![0.0; n], reached: vec![false; n] };
            for (&u, [p, q]) in s.order.iter().zip(&both) {
                let (u, p, q) = (u as usize, p.0[lane], q.0[lane]);
                solution.reached[u] = p != 0.0 || q != 0.0;
                // With a single terminal, every walk that ends, ends there.
                solution.p[u] = if solution.reached[u] && q == 0.0 { 1.0 } else { p };
                solution.q[u] = if solution.reached[u] && p == 0.0 { 1.0 } else { q };
            }
            solution
        })
    }
}
