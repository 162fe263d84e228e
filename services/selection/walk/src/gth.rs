//! Subtraction-free elimination (star-mesh; Grassmann, Taksar, Heyman 1985).
//!
//! Let node k have conductances w_kj to its remaining neighbours, f_k to foreground and b_k to background. Elimination of k
//! adds the conductance w_ik·w_kj / s_k between each pair (i, j) of neighbours. Here s_k is the *sum* of all remaining
//! conductances of k, never a stored diagonal. No step subtracts. So each entry of p and q has a small relative error for
//! graphs of any condition.

use std::ops::{Add, Div, Mul};

use super::conductance::Conductance;
use super::system::System;
use super::{SystemSolver, WalkError};

/// Arithmetic that elimination runs in: one number, or the numbers of several walks side by side.
pub(super) trait Arithmetic: Copy + Add<Output = Self> + Mul<Output = Self> + Div<Output = Self> {
    const ZERO: Self;
    fn of(c: Conductance, shift: i64) -> Self;
    /// Whether every number is 0.
    fn is_nothing(self) -> bool;
}

/// Arithmetic of one walk.
pub(super) trait Real: Arithmetic {
    fn value(self) -> f64;
}

impl Arithmetic for f64 {
    const ZERO: Self = 0.0;

    fn of(c: Conductance, shift: i64) -> Self {
        c.scaled(shift)
    }

    fn is_nothing(self) -> bool {
        self == 0.0
    }
}

impl Real for f64 {
    fn value(self) -> f64 {
        self
    }
}

impl Arithmetic for f32 {
    const ZERO: Self = 0.0;

    fn of(c: Conductance, shift: i64) -> Self {
        c.scaled(shift) as Self
    }

    fn is_nothing(self) -> bool {
        self == 0.0
    }
}

impl Real for f32 {
    fn value(self) -> f64 {
        f64::from(self)
    }
}

impl Arithmetic for Conductance {
    const ZERO: Self = Self::ZERO;

    fn of(c: Conductance, _: i64) -> Self {
        c
    }

    fn is_nothing(self) -> bool {
        self.is_zero()
    }
}

impl Real for Conductance {
    fn value(self) -> f64 {
        self.scaled(0)
    }
}

/// Range of conductances in powers of two for plain f64: products of two conductances and a probability do not overflow.
pub(super) const F64_RANGE: i64 = 300;

/// Elimination in f64. Graphs beyond its range use conductances with an exponent of their own.
#[derive(Debug, Clone, Copy)]
pub struct Gth64;

/// Elimination in f32, for comparison. It may underflow where f64 does not.
#[derive(Debug, Clone, Copy)]
pub struct Gth32;

impl SystemSolver for Gth64 {
    fn solve(&self, system: &System) -> Result<(Vec<f64>, Vec<f64>), WalkError> {
        let solution =
            if system.range() <= F64_RANGE { eliminate::<f64>(system) } else { eliminate::<Conductance>(system) };
        checked("gth in f64", solution)
    }

    fn eliminates(&self, _: usize) -> bool {
        true
    }
}

impl SystemSolver for Gth32 {
    fn solve(&self, system: &System) -> Result<(Vec<f64>, Vec<f64>), WalkError> {
        checked("gth in f32", eliminate::<f32>(system))
    }

    fn eliminates(&self, _: usize) -> bool {
        true
    }
}

fn checked(solver: &'static str, solution: (Vec<f64>, Vec<f64>)) -> Result<(Vec<f64>, Vec<f64>), WalkError> {
    if solution.0.iter().chain(&solution.1).all(|x| x.is_finite()) {
        Ok(solution)
    } else {
        Err(WalkError::Breakdown { solver, reason: "a conductance underflowed or overflowed".to_owned() })
    }
}

pub(super) fn eliminate<T: Real>(system: &System) -> (Vec<f64>, Vec<f64>) {
    let n = system.len();
    let shift = system.shift();
    let fill = system.fill();
    let rows = fill.rows();
    let mut entry = vec![T::ZERO; rows.len()];
    let mut foreground: Vec<T> = system.foreground().iter().map(|&c| T::of(c, shift)).collect();
    let mut background: Vec<T> = system.background().iter().map(|&c| T::of(c, shift)).collect();
    let mut total = vec![T::ZERO; n];
    // Left-looking: node k first collects the contributions of its earlier neighbours. Each earlier node waits in the
    // list of its next later neighbour.
    let mut work = vec![T::ZERO; n];
    let mut waiting = vec![NONE; n];
    let mut next_waiting = vec![NONE; n];
    let mut position = vec![0_usize; n];
    for k in 0..n {
        let column = fill.column(k);
        for (j, c) in system.links(k as u32) {
            if j as usize > k {
                work[j as usize] = T::of(c, shift);
            }
        }
        let (mut f, mut b) = (foreground[k], background[k]);
        let mut earlier = waiting[k];
        while earlier != NONE {
            let c = earlier as usize;
            earlier = next_waiting[c];
            let end = fill.column(c).end;
            let at = position[c];
            let share = entry[at] / total[c];
            for (&j, &w) in rows[at + 1..end].iter().zip(&entry[at + 1..end]) {
                work[j as usize] = work[j as usize] + share * w;
            }
            f = f + share * foreground[c];
            b = b + share * background[c];
            wait(c, at + 1, end, rows, &mut position, &mut waiting, &mut next_waiting);
        }
        let mut sum = f + b;
        for (&j, e) in rows[column.clone()].iter().zip(&mut entry[column.clone()]) {
            *e = work[j as usize];
            work[j as usize] = T::ZERO;
            sum = sum + *e;
        }
        (foreground[k], background[k], total[k]) = (f, b, sum);
        wait(k, column.start, column.end, rows, &mut position, &mut waiting, &mut next_waiting);
    }
    let mut p = vec![T::ZERO; n];
    let mut q = vec![T::ZERO; n];
    for k in (0..n).rev() {
        let column = fill.column(k);
        let (mut f, mut b) = (foreground[k], background[k]);
        for (&j, &w) in rows[column.clone()].iter().zip(&entry[column]) {
            f = f + w * p[j as usize];
            b = b + w * q[j as usize];
        }
        p[k] = f / total[k];
        q[k] = b / total[k];
    }
    (p.into_iter().map(T::value).collect(), q.into_iter().map(T::value).collect())
}

const NONE: u32 = u32::MAX;

/// Queues node `c` at the later neighbour of its entry at `at`, if an entry is left.
pub(super) fn wait(
    c: usize,
    at: usize,
    end: usize,
    rows: &[u32],
    position: &mut [usize],
    waiting: &mut [u32],
    next_waiting: &mut [u32],
) {
    if at < end {
        position[c] = at;
        let j = rows[at] as usize;
        next_waiting[c] = waiting[j];
        waiting[j] = c as u32;
    }
}
