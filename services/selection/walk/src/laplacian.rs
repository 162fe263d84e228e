//! The Laplacian of the unknowns of a walk, for the solvers that subtract.

use sprs::CsMatI;

use super::float::Float;
use super::network::range;
use super::system::System;

/// D − A over the unknowns of a system, in units of 2^[`System::shift`]. D includes the conductances to both terminals.
#[derive(Debug, Clone)]
pub(super) struct Laplacian<T> {
    matrix: CsMatI<T, u32, usize>,
    /// Position of the diagonal entry of each row in the storage.
    diagonal: Vec<usize>,
}

/// Columns and entries of a part of a row.
pub(super) type Entries<'a, T> = (&'a [u32], &'a [T]);

/// A row of a Laplacian.
pub(super) struct Row<'a, T> {
    /// Left of the diagonal.
    pub(super) earlier: Entries<'a, T>,
    /// On the diagonal.
    pub(super) own: T,
    /// Right of the diagonal.
    pub(super) later: Entries<'a, T>,
}

impl<T: Float> Laplacian<T> {
    pub(super) fn of(system: &System) -> Self {
        let (n, shift) = (system.len(), system.shift());
        let entries = system.conductances().nnz() + n;
        let mut offsets = Vec::with_capacity(n + 1);
        let (mut columns, mut values) = (Vec::with_capacity(entries), Vec::with_capacity(entries));
        let mut diagonal = Vec::with_capacity(n);
        offsets.push(0);
        for k in (0..).take(n) {
            let ends = system.foreground()[k as usize] + system.background()[k as usize];
            let mut own = T::of(ends.scaled(shift));
            let links = system.links(k);
            let earlier = system.neighbours(k).partition_point(|&j| j < k);
            diagonal.push(columns.len() + earlier);
            for (at, (j, conductance)) in links.enumerate() {
                if at == earlier {
                    columns.push(k);
                    values.push(own);
                }
                let w = T::of(conductance.scaled(shift));
                own = own + w;
                columns.push(j);
                values.push(T::of(0.0) - w);
            }
            if earlier == system.neighbours(k).len() {
                columns.push(k);
                values.push(own);
            }
            // All conductances of the row are summed now.
            values[diagonal[k as usize]] = own;
            offsets.push(columns.len());
        }
        Self { matrix: CsMatI::new((n, n), offsets, columns, values), diagonal }
    }

    /// The diagonal.
    pub(super) fn diagonal(&self) -> impl Iterator<Item = T> + '_ {
        self.diagonal.iter().map(|&at| self.matrix.data()[at])
    }

    pub(super) fn row(&self, k: usize) -> Row<'_, T> {
        let (columns, values) = (self.matrix.indices(), self.matrix.data());
        let (row, at) = (range(&self.matrix, k), self.diagonal[k]);
        Row {
            earlier: (&columns[row.start..at], &values[row.start..at]),
            own: values[at],
            later: (&columns[at + 1..row.end], &values[at + 1..row.end]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hard_cases::{mesh, network, seeded};
    use crate::{Conductance, Problem, gth};

    #[test]
    fn it_is_the_laplacian_of_the_graph_at_the_unknowns() {
        let g = network(60, &mesh(0, 60, 7));
        let seeds = seeded(60, &[3, 4], &[40]);
        let problem = Problem { network: &g, seeds: &seeds, leak: 0.0, leaking: None };
        let nodes = (0..60).filter(|u| ![3, 4, 40].contains(u)).collect();
        let system = System::new(&problem, nodes, None, &gth::Gth64);
        let made = Laplacian::<f64>::of(&system);
        let (unit, whole) = (Conductance::ONE.scaled(-system.shift()), g.laplacian());
        for (k, &u) in (0..).zip(system.nodes()) {
            for (j, &v) in (0..).zip(system.nodes()) {
                let (got, want) = (made.matrix.get(k, j), whole.get(u as usize, v as usize));
                assert_eq!(got.is_some(), want.is_some());
                let (got, want) = (unit * got.copied().unwrap_or(0.0), want.copied().unwrap_or(0.0));
                assert!((got - want).abs() < 1e-14, "{got} against {want}");
            }
        }
        assert!(sprs::is_symmetric(&made.matrix));
        // Rows in parts are the rows of the whole.
        let x: Vec<f64> = (0..system.len()).map(|k| (k as f64).sin()).collect();
        let mut product = vec![0.0; system.len()];
        sprs::prod::mul_acc_mat_vec_csr(made.matrix.view(), &x[..], &mut product[..]);
        for (k, (want, own)) in product.into_iter().zip(made.diagonal()).enumerate() {
            let row = made.row(k);
            assert_eq!(row.own, own);
            let parts = [row.earlier, (&[k as u32], &[own]), row.later];
            let got: f64 = parts
                .into_iter()
                .flat_map(|(columns, entries)| columns.iter().zip(entries))
                .map(|(&j, entry)| entry * x[j as usize])
                .sum();
            assert!((got - want).abs() < 1e-13, "{got} against {want}");
        }
    }
}
