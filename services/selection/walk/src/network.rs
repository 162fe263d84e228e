//! Weighted undirected graphs as sparse matrices.

use sprs::{CsMatI, CsMatViewI, SpIndex};

use super::conductance::Conductance;

/// A weighted undirected graph: a symmetric sparse matrix of conductances with an empty diagonal.
///
/// Entry (u, v) is the conductance between the nodes u and v. Indices are 32 bits wide. Rows are compressed and ascend.
#[derive(Debug, Clone, PartialEq)]
pub struct Network {
    adjacency: CsMatI<Conductance, u32, usize>,
}

/// A matrix that is no adjacency matrix of a graph.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum AdjacencyError {
    /// The numbers of rows and columns differ.
    #[error("the matrix has {rows} rows and {columns} columns; an adjacency matrix is square")]
    NotSquare {
        /// Number of rows.
        rows: usize,
        /// Number of columns.
        columns: usize,
    },
    /// Indices of nodes are 32 bits wide.
    #[error("the matrix has {0} rows; a graph has at most 4294967295 nodes")]
    TooLarge(usize),
    /// An entry is no conductance.
    #[error("entry ({row}, {column}) is {value}; conductances are finite and at least 0")]
    NoConductance {
        /// Row of the entry.
        row: usize,
        /// Column of the entry.
        column: usize,
        /// The entry.
        value: f64,
    },
    /// An entry and its mirror image differ.
    #[error(
        "entry ({row}, {column}) is {value} and entry ({column}, {row}) is {mirror}; an adjacency matrix is symmetric"
    )]
    NotSymmetric {
        /// Row of the entry.
        row: usize,
        /// Column of the entry.
        column: usize,
        /// The entry.
        value: f64,
        /// The mirrored entry; 0 if it is not stored.
        mirror: f64,
    },
}

impl Network {
    /// The graph of `nodes` nodes. Duplicate edges add up. Self-loops and zero conductances are ignored.
    ///
    /// Edges with an end outside `0..nodes` are also ignored; check input from files first.
    ///
    /// # Panics
    /// If there are more than 4294967295 nodes, since indices are 32 bits wide.
    #[must_use]
    pub fn new(nodes: usize, edges: impl Iterator<Item = (u32, u32, Conductance)>) -> Self {
        let edges: Vec<(u32, u32, Conductance)> = edges
            .filter(|(u, v, w)| u != v && !w.is_zero() && (*u as usize) < nodes && (*v as usize) < nodes)
            .collect();
        Self::from_edges(nodes, &edges)
    }

    /// The part of [`Self::new`] that does not depend on the iterator, so that it is compiled once.
    fn from_edges(nodes: usize, edges: &[(u32, u32, Conductance)]) -> Self {
        let mut starts = vec![0; nodes + 1];
        for end in edges.iter().flat_map(|&(u, v, _)| [u, v]) {
            starts[end as usize + 1] += 1;
        }
        for u in 0..nodes {
            starts[u + 1] += starts[u];
        }
        let mut next = starts.clone();
        let mut links = vec![(0, Conductance::ZERO); 2 * edges.len()];
        for &(u, v, w) in edges {
            for (from, to) in [(u, v), (v, u)] {
                links[next[from as usize]] = (to, w);
                next[from as usize] += 1;
            }
        }
        let mut offsets = Vec::with_capacity(nodes + 1);
        let mut neighbours: Vec<u32> = Vec::with_capacity(links.len());
        let mut conductances: Vec<Conductance> = Vec::with_capacity(links.len());
        offsets.push(0);
        for u in 0..nodes {
            let row = &mut links[starts[u]..starts[u + 1]];
            // A stable sort: duplicates add up in the order of the list, the same from both ends. Triplets of `sprs` are
            // sorted without that order, so their sums could differ between the ends.
            row.sort_by_key(|l| l.0);
            for &(v, w) in &*row {
                match conductances.last_mut() {
                    Some(sum) if neighbours.len() > offsets[u] && neighbours.last() == Some(&v) => *sum = *sum + w,
                    _ => {
                        neighbours.push(v);
                        conductances.push(w);
                    }
                }
            }
            offsets.push(neighbours.len());
        }
        Self { adjacency: CsMatI::new((nodes, nodes), offsets, neighbours, conductances) }
    }

    /// The graph of a symmetric matrix of conductances, in compressed rows or columns of any index type.
    ///
    /// The diagonal and stored zeros are ignored: a self-loop changes no probability of a walk.
    ///
    /// # Errors
    /// [`AdjacencyError`] if the matrix is not square or not exactly symmetric, or if an entry is negative, infinite or NaN.
    pub fn from_adjacency<I: SpIndex, Iptr: SpIndex>(
        matrix: CsMatViewI<'_, f64, I, Iptr>,
    ) -> Result<Self, AdjacencyError> {
        let (rows, columns) = matrix.shape();
        if rows != columns {
            return Err(AdjacencyError::NotSquare { rows, columns });
        }
        if u32::try_from(rows).is_err() {
            return Err(AdjacencyError::TooLarge(rows));
        }
        let mut offsets = Vec::with_capacity(rows + 1);
        let mut neighbours = Vec::with_capacity(matrix.nnz());
        let mut conductances = Vec::with_capacity(matrix.nnz());
        offsets.push(0);
        for (outer, entries) in matrix.outer_iterator().enumerate() {
            for (inner, &value) in entries.iter() {
                // Of a matrix in compressed columns these are the rows of its transpose.
                let (row, column) = if matrix.is_csr() { (outer, inner) } else { (inner, outer) };
                let conductance =
                    Conductance::new(value).ok_or(AdjacencyError::NoConductance { row, column, value })?;
                let mirror = matrix.get_outer_inner(inner, outer).copied().unwrap_or(0.0);
                if mirror != value {
                    return Err(AdjacencyError::NotSymmetric { row, column, value, mirror });
                }
                if inner != outer && !conductance.is_zero() {
                    neighbours.push(inner as u32);
                    conductances.push(conductance);
                }
            }
            offsets.push(neighbours.len());
        }
        Ok(Self { adjacency: CsMatI::new((rows, rows), offsets, neighbours, conductances) })
    }

    /// The adjacency matrix: symmetric, in compressed rows, with an empty diagonal.
    #[must_use]
    pub fn adjacency(&self) -> CsMatViewI<'_, Conductance, u32, usize> {
        self.adjacency.view()
    }

    /// The Laplacian D − A in f64. A is the adjacency matrix, and D has the degrees on its diagonal.
    ///
    /// Conductances out of the range of f64 become 0 or infinity.
    #[must_use]
    pub fn laplacian(&self) -> CsMatI<f64, u32, usize> {
        let n = self.len();
        let nodes = (0..).take(n);
        let degrees = nodes.clone().map(|u| self.degree(u).scaled(0)).collect();
        let diagonal = CsMatI::new((n, n), (0..=n).collect(), nodes.collect(), degrees);
        &diagonal - &self.adjacency.map(|w| w.scaled(0))
    }

    /// Number of nodes.
    #[must_use]
    pub fn len(&self) -> usize {
        self.adjacency.rows()
    }

    /// Whether there is no node.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Neighbours of a node, ascending.
    #[must_use]
    pub fn neighbours(&self, u: u32) -> &[u32] {
        row(&self.adjacency, u).0
    }

    /// Neighbours of a node with the conductances to them, ascending.
    pub fn links(&self, u: u32) -> impl ExactSizeIterator<Item = (u32, Conductance)> + Clone + '_ {
        links(&self.adjacency, u)
    }

    /// Sum of the conductances at a node.
    #[must_use]
    pub fn degree(&self, u: u32) -> Conductance {
        row(&self.adjacency, u).1.iter().copied().sum()
    }
}

/// Columns and values of a row of a matrix in compressed rows, as slices of its storage.
pub(super) fn row<N, Iptr: SpIndex>(matrix: &CsMatI<N, u32, Iptr>, k: u32) -> (&[u32], &[N]) {
    let row = range(matrix, k as usize);
    (&matrix.indices()[row.clone()], &matrix.data()[row])
}

/// Columns and values of a row of a matrix in compressed rows.
pub(super) fn links<N: Copy, Iptr: SpIndex>(
    matrix: &CsMatI<N, u32, Iptr>,
    k: u32,
) -> impl ExactSizeIterator<Item = (u32, N)> + Clone + '_ {
    let (columns, values) = row(matrix, k);
    columns.iter().copied().zip(values.iter().copied())
}

/// Positions of a row in the storage of a matrix in compressed rows.
pub(super) fn range<N, Iptr: SpIndex>(matrix: &CsMatI<N, u32, Iptr>, k: usize) -> std::ops::Range<usize> {
    // An owned matrix is never a part of another one, so its storage starts at 0.
    let offsets = matrix.indptr();
    let offsets = offsets.raw_storage();
    offsets[k].index_unchecked()..offsets[k + 1].index_unchecked()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use sprs::{CsMat, TriMat};

    fn symmetric(n: usize, edges: &[(usize, usize, f64)]) -> TriMat<f64> {
        let mut triplets = TriMat::new((n, n));
        for &(u, v, w) in edges {
            triplets.add_triplet(u, v, w);
            if u != v {
                triplets.add_triplet(v, u, w);
            }
        }
        triplets
    }

    #[test]
    fn a_matrix_of_any_storage_is_the_graph_of_its_edges() {
        let edges = [(0, 1, 1.5), (1, 2, 0.0), (3, 2, 1e-300), (3, 3, 7.0), (4, 0, 2.0)];
        let want = Network::new(5, edges.iter().map(|&(u, v, w)| (u as u32, v as u32, Conductance::new(w).unwrap())));
        let triplets = symmetric(5, &edges);
        let rows: CsMat<f64> = triplets.to_csr();
        let columns: CsMat<f64> = triplets.to_csc();
        assert_eq!(Network::from_adjacency(rows.view()).unwrap(), want);
        assert_eq!(Network::from_adjacency(columns.view()).unwrap(), want);
        assert_eq!(Network::from_adjacency(rows.to_other_types::<u16, f64, u32>().view()).unwrap(), want);
        assert_eq!((want.len(), want.adjacency().nnz()), (5, 6));
        assert!(sprs::is_symmetric(&want.adjacency()));
        // A view of some rows, whose storage does not start at 0.
        let corner: CsMat<f64> = symmetric(3, &edges[..2]).to_csr();
        let stacked = sprs::vstack(&[CsMat::zero((2, 3)).view(), CsMat::eye(3).view(), corner.view()]);
        let part = stacked.slice_outer(5..8);
        let want = Network::from_adjacency(corner.view()).unwrap();
        assert_eq!(Network::from_adjacency(part).unwrap(), want);
        for n in [0, 1] {
            let empty = Network::from_adjacency(CsMat::<f64>::zero((n, n)).view()).unwrap();
            assert_eq!(empty, Network::new(n, std::iter::empty()));
            assert_eq!(empty.laplacian().shape(), (n, n));
        }
    }

    #[test]
    fn a_matrix_that_is_no_graph_is_refused() {
        let refused = |shape, entries: &[(usize, usize, f64)]| {
            let mut triplets = TriMat::new(shape);
            entries.iter().for_each(|&(u, v, w)| triplets.add_triplet(u, v, w));
            let rows: CsMat<f64> = triplets.to_csr();
            let columns: CsMat<f64> = triplets.to_csc();
            let errors = [rows, columns].map(|m| Network::from_adjacency(m.view()).unwrap_err());
            errors.map(|e| e.to_string())
        };
        let [rows, columns] = refused((2, 3), &[]);
        assert_eq!(rows, "the matrix has 2 rows and 3 columns; an adjacency matrix is square");
        assert_eq!(rows, columns);
        for w in [-1.0, f64::NAN, f64::INFINITY] {
            let [rows, columns] = refused((3, 3), &[(0, 2, w), (2, 0, w)]);
            assert_eq!(rows, format!("entry (0, 2) is {w}; conductances are finite and at least 0"));
            assert_eq!(columns, format!("entry (2, 0) is {w}; conductances are finite and at least 0"));
            let [diagonal, _] = refused((3, 3), &[(1, 1, w)]);
            assert!(diagonal.starts_with("entry (1, 1) is"), "{diagonal}");
        }
        let end = "an adjacency matrix is symmetric";
        let [rows, columns] = refused((3, 3), &[(0, 2, 1.0), (2, 0, 1.5)]);
        assert_eq!(rows, format!("entry (0, 2) is 1 and entry (2, 0) is 1.5; {end}"));
        assert_eq!(columns, format!("entry (2, 0) is 1.5 and entry (0, 2) is 1; {end}"));
        for one in [(0, 2, 1.0), (2, 0, 1.0)] {
            let [rows, _] = refused((3, 3), &[one]);
            assert!(rows.contains("is 1 and entry") && rows.contains("is 0;"), "{rows}");
        }
    }

    proptest! {
        #[test]
        fn the_laplacian_is_degrees_minus_conductances(
            n in 1..20_usize, edges in proptest::collection::vec((0..20_u32, 0..20_u32, 0.0..4.0_f64), 0..60)
        ) {
            let edges = edges.iter().map(|&(u, v, w)| (u % n as u32, v % n as u32, Conductance::new(w).unwrap()));
            let network = Network::new(n, edges);
            let laplacian = network.laplacian();
            prop_assert!(sprs::is_symmetric(&laplacian));
            for u in 0..n as u32 {
                let own = laplacian.get(u as usize, u as usize).copied().unwrap_or(0.0);
                prop_assert_eq!(own, network.degree(u).scaled(0));
                prop_assert_eq!(network.neighbours(u).len(), network.links(u).len());
                for (v, w) in network.links(u) {
                    prop_assert_eq!(laplacian.get(u as usize, v as usize), Some(&-w.scaled(0)));
                    prop_assert_eq!(network.adjacency().get(v as usize, u as usize).copied(), Some(w));
                }
            }
            // The rows sum to 0.
            let mut zero = vec![0.0; n];
            sprs::prod::mul_acc_mat_vec_csr(laplacian.view(), &vec![1.0; n][..], &mut zero[..]);
            prop_assert!(zero.iter().all(|x| x.abs() < 1e-12), "{:?}", zero);
            // The same graph again from its matrix.
            let matrix = network.adjacency().map(|w| w.scaled(0));
            prop_assert_eq!(Network::from_adjacency(matrix.view()).unwrap(), network);
        }
    }
}
