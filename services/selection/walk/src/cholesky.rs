//! Sparse LDLᵀ factorization of the walk's Laplacian over the same elimination order, for comparison.
//!
//! It subtracts from a stored diagonal, so its error grows with the condition of the graph.

use std::marker::PhantomData;

use super::float::Float;
use super::gth::wait;
use super::system::System;
use super::{SystemSolver, WalkError};

/// Sparse LDLᵀ factorization in `T`.
#[derive(Debug, Clone, Copy, Default)]
pub struct Cholesky<T>(PhantomData<T>);

impl<T> Cholesky<T> {
    /// A solver.
    #[must_use]
    pub fn new() -> Self {
        Self(PhantomData)
    }
}

impl<T: Float> SystemSolver for Cholesky<T> {
    fn solve(&self, system: &System) -> Result<(Vec<f64>, Vec<f64>), WalkError> {
        let broken = |reason: String| WalkError::Breakdown { solver: "cholesky", reason };
        let n = system.len();
        let shift = system.shift();
        let zero = T::of(0.0);
        let fill = system.fill();
        let rows = fill.rows();
        let mut lower = vec![zero; rows.len()];
        let mut diagonal = vec![zero; n];
        let mut work = vec![zero; n];
        let mut waiting = vec![u32::MAX; n];
        let mut next_waiting = vec![u32::MAX; n];
        let mut position = vec![0_usize; n];
        for k in 0..n {
            let column = fill.column(k);
            let mut d = T::of((system.foreground()[k] + system.background()[k]).scaled(shift));
            for (j, c) in system.links(k as u32) {
                let w = T::of(c.scaled(shift));
                d = d + w;
                if j as usize > k {
                    work[j as usize] = zero - w;
                }
            }
            let mut earlier = waiting[k];
            while earlier != u32::MAX {
                let c = earlier as usize;
                earlier = next_waiting[c];
                let end = fill.column(c).end;
                let at = position[c];
                let share = lower[at] * diagonal[c];
                d = d - share * lower[at];
                for (&j, &l) in rows[at + 1..end].iter().zip(&lower[at + 1..end]) {
                    work[j as usize] = work[j as usize] - share * l;
                }
                wait(c, at + 1, end, rows, &mut position, &mut waiting, &mut next_waiting);
            }
            if d.partial_cmp(&zero) != Some(std::cmp::Ordering::Greater) || !d.value().is_finite() {
                return Err(broken(format!("pivot {k} of {n} is {:e} in {}", d.value(), T::NAME)));
            }
            diagonal[k] = d;
            for (&j, l) in rows[column.clone()].iter().zip(&mut lower[column.clone()]) {
                *l = work[j as usize] / d;
                work[j as usize] = zero;
            }
            wait(k, column.start, column.end, rows, &mut position, &mut waiting, &mut next_waiting);
        }
        let substitute = |terminal: &[super::Conductance]| {
            let mut x: Vec<T> = terminal.iter().map(|c| T::of(c.scaled(shift))).collect();
            for k in 0..n {
                let own = x[k];
                for (&j, &l) in rows[fill.column(k)].iter().zip(&lower[fill.column(k)]) {
                    x[j as usize] = x[j as usize] - l * own;
                }
            }
            for k in (0..n).rev() {
                let mut own = x[k] / diagonal[k];
                for (&j, &l) in rows[fill.column(k)].iter().zip(&lower[fill.column(k)]) {
                    own = own - l * x[j as usize];
                }
                x[k] = own;
            }
            x.into_iter().map(T::value).collect::<Vec<f64>>()
        };
        let (p, q) = (substitute(system.foreground()), substitute(system.background()));
        if p.iter().chain(&q).all(|x| x.is_finite()) {
            Ok((p, q))
        } else {
            Err(broken(format!("the solution is not finite in {}", T::NAME)))
        }
    }

    fn eliminates(&self, _: usize) -> bool {
        true
    }
}
