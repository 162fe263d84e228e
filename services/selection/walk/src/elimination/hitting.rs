//! Green's function of an elimination, and probabilities of visits.

use super::{Columns, Elimination, Numbers, Structure};
use crate::Seed;
use crate::conductance::Conductance;
use crate::gth::Real;

impl<T: Real> Columns<T> {
    /// Solves (Laplacian of the unknowns)·x = `source`, by rank and in units of this elimination. x is 0 at seeds. It is also 0
    /// where no terminal is reachable.
    pub(super) fn green(&self, s: &Structure, seeds: &[Seed], mut source: Vec<T>) -> Vec<T> {
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
    pub(super) fn green_diagonal(&self, s: &Structure, seeds: &[Seed]) -> Vec<T> {
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

impl Elimination {
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
        if self.terminals.seeds[k] != Seed::None || columns.total[k].is_nothing() {
            return None;
        }
        let mut source = vec![T::ZERO; s.order.len()];
        source[k] = T::of(Conductance::ONE, 0);
        let green = columns.green(s, &self.terminals.seeds, source);
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
        let green = columns.green(s, &self.terminals.seeds, s.order.iter().map(|u| T::of(of(u), 0)).collect());
        let diagonal = columns.green_diagonal(s, &self.terminals.seeds);
        let mut out = vec![0.0; green.len()];
        for ((&u, g), d) in s.order.iter().zip(green).zip(diagonal) {
            if !d.is_nothing() {
                out[u as usize] = (g / d).value();
            }
        }
        out
    }
}
