//! Conjugate gradients on the walk's Laplacian with its diagonal as preconditioner.
//!
//! The memory is linear in the size of the graph. The error grows with the condition of the graph.

use std::marker::PhantomData;

use rayon::prelude::*;
use sprs::CsMatI;

use super::conductance::Conductance;
use super::float::Float;
use super::network::row;
use super::system::System;
use super::{SystemSolver, WalkError};

/// Conjugate gradients in `T`. The iteration ends when the preconditioned residual has fallen by a given factor.
#[derive(Debug, Clone, Copy)]
pub struct ConjugateGradients<T> {
    /// Factor by which the residual must fall.
    pub tolerance: f64,
    arithmetic: PhantomData<T>,
}

impl<T: Float> ConjugateGradients<T> {
    /// A solver with a tolerance that suits the arithmetic: 1e-10 in f64, 1e-5 in f32.
    #[must_use]
    pub fn new() -> Self {
        Self { tolerance: if size_of::<T>() == 8 { 1e-10 } else { 1e-5 }, arithmetic: PhantomData }
    }
}

impl<T: Float> Default for ConjugateGradients<T> {
    fn default() -> Self {
        Self::new()
    }
}

/// The Laplacian D − A of a system in units of 2^[`System::shift`]. D includes the conductances to both terminals.
struct Laplacian<T> {
    /// D.
    diagonal: Vec<T>,
    /// A.
    conductances: CsMatI<T, u32, usize>,
}

impl<T: Float> Laplacian<T> {
    fn of(system: &System) -> Self {
        let shift = system.shift();
        let conductances = system.conductances().map(|c| T::of(c.scaled(shift)));
        let ends = system.foreground().iter().zip(system.background());
        let diagonal = (0..)
            .zip(ends)
            .map(|(k, (&f, &b))| row(&conductances, k).1.iter().fold(T::of((f + b).scaled(shift)), |d, &w| d + w))
            .collect();
        Self { diagonal, conductances }
    }

    /// Its product with x. Every row starts at its diagonal, in parallel; a product of `sprs` takes one thread.
    fn times(&self, x: &[T], out: &mut [T]) {
        const ROWS: usize = 1024;
        let (offsets, columns, weights) =
            (self.conductances.indptr(), self.conductances.indices(), self.conductances.data());
        out.par_chunks_mut(ROWS).enumerate().for_each(|(chunk, out)| {
            let first = chunk * ROWS;
            let ends = offsets.raw_storage()[first..].windows(2);
            let own = self.diagonal[first..].iter().zip(&x[first..]);
            for ((out, ends), (&d, &own)) in out.iter_mut().zip(ends).zip(own) {
                let row = ends[0]..ends[1];
                let mut sum = d * own;
                for (&j, &w) in columns[row.clone()].iter().zip(&weights[row]) {
                    sum = sum - w * x[j as usize];
                }
                *out = sum;
            }
        });
    }
}

/// Σ a·b by fixed blocks, so that the sum does not depend on the number of threads.
fn dot<T: Float>(a: &[T], b: &[T]) -> T {
    let blocks: Vec<T> = a
        .par_chunks(4096)
        .zip(b.par_chunks(4096))
        .map(|(a, b)| a.iter().zip(b).fold(T::of(0.0), |s, (&a, &b)| s + a * b))
        .collect();
    blocks.into_iter().fold(T::of(0.0), |s, b| s + b)
}

impl<T: Float> ConjugateGradients<T> {
    fn solve_for(&self, laplacian: &Laplacian<T>, terminal: &[Conductance], shift: i64) -> Result<Vec<f64>, WalkError> {
        let n = terminal.len();
        let most = 20 * n + 1000;
        let mut x = vec![T::of(0.0); n];
        let mut residual: Vec<T> = terminal.iter().map(|c| T::of(c.scaled(shift))).collect();
        let zero = T::of(0.0);
        // Nodes whose conductances all underflow are skipped here. The final sweep sets their values.
        let inverse: Vec<T> =
            laplacian.diagonal.iter().map(|&d| if d > zero { T::of(1.0) / d } else { zero }).collect();
        let mut z: Vec<T> = residual.iter().zip(&inverse).map(|(&r, &i)| r * i).collect();
        let mut direction = z.clone();
        let mut product = vec![T::of(0.0); n];
        let mut rz = dot(&residual, &z);
        let start = rz.value();
        let enough = start * self.tolerance * self.tolerance;
        let broken = |reason: String| WalkError::Breakdown { solver: "cg", reason };
        for _ in 0..most {
            if rz.value() <= enough {
                return Ok(x.into_iter().map(T::value).collect());
            }
            laplacian.times(&direction, &mut product);
            let curvature = dot(&direction, &product);
            let step = rz / curvature;
            if curvature.partial_cmp(&T::of(0.0)) != Some(std::cmp::Ordering::Greater) || !step.value().is_finite() {
                return Err(broken(format!("a search direction has curvature {:e} in {}", curvature.value(), T::NAME)));
            }
            for k in 0..n {
                x[k] = x[k] + step * direction[k];
                residual[k] = residual[k] - step * product[k];
                z[k] = residual[k] * inverse[k];
            }
            let next = dot(&residual, &z);
            let turn = next / rz;
            for (d, &z) in direction.iter_mut().zip(&z) {
                *d = z + turn * *d;
            }
            rz = next;
        }
        let left = (rz.value() / start).sqrt();
        Err(broken(format!("after {most} iterations the residual has fallen by {left:.1e} only, in {}", T::NAME)))
    }
}

/// One Jacobi step with each row in units of its own degree: every node becomes the mean of its neighbours.
///
/// The scaling also covers nodes whose conductances underflow beside the largest one.
fn sweep(system: &System, terminal: &[Conductance], x: &[f64]) -> Vec<f64> {
    (0..system.len() as u32)
        .into_par_iter()
        .with_min_len(1024)
        .map(|k| {
            let links = system.links(k);
            let ends = system.foreground()[k as usize] + system.background()[k as usize];
            let total = links.clone().fold(ends, |sum, l| sum + l.1);
            let share = |c: Conductance| (c / total).scaled(0);
            links.fold(share(terminal[k as usize]), |sum, l| sum + share(l.1) * x[l.0 as usize])
        })
        .collect()
}

impl<T: Float> SystemSolver for ConjugateGradients<T> {
    fn solve(&self, system: &System) -> Result<(Vec<f64>, Vec<f64>), WalkError> {
        let laplacian = Laplacian::<T>::of(system);
        let p = self.solve_for(&laplacian, system.foreground(), system.shift())?;
        let q = self.solve_for(&laplacian, system.background(), system.shift())?;
        Ok((sweep(system, system.foreground(), &p), sweep(system, system.background(), &q)))
    }

    fn eliminates(&self, _: usize) -> bool {
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hard_cases::{mesh, network, seeded};
    use crate::{Problem, gth};
    use sprs::prod::mul_acc_mat_vec_csr;

    #[test]
    fn the_product_is_that_of_the_graphs_laplacian() {
        let g = network(60, &mesh(0, 60, 7));
        let seeds = seeded(60, &[3, 4], &[40]);
        let problem = Problem { network: &g, seeds: &seeds, leak: 0.0, leaking: None };
        let nodes: Vec<u32> = (0..60).filter(|u| ![3, 4, 40].contains(u)).collect();
        for order in [None, Some(&(0..60).rev().collect::<Vec<u32>>()[..])] {
            let system = System::new(&problem, nodes.clone(), order, &gth::Gth64);
            let made = Laplacian::<f64>::of(&system);
            assert!(sprs::is_symmetric(&made.conductances));
            let x: Vec<f64> = (0..system.len()).map(|k| (k as f64).sin()).collect();
            let mut got = vec![0.0; system.len()];
            made.times(&x, &mut got);
            // At a seed x is 0.
            let (mut whole, mut want) = (vec![0.0; 60], vec![0.0; 60]);
            system.nodes().iter().zip(&x).for_each(|(&u, &x)| whole[u as usize] = x);
            mul_acc_mat_vec_csr(g.laplacian().view(), &whole[..], &mut want[..]);
            let unit = Conductance::ONE.scaled(-system.shift());
            for (&u, got) in system.nodes().iter().zip(got) {
                assert!((unit * got - want[u as usize]).abs() < 1e-13, "{got} against {}", want[u as usize]);
            }
        }
    }
}
