//! Random walks on weighted graphs (Grady 2006): the probability that a walker meets foreground before background.
//!
//! Foreground and background are two terminals. An unseeded node may have a *leak*, a conductance of ε times its degree to
//! the background terminal. With a leak, foreground seeds alone give a bounded region. The solvers compute p and q = 1 − p
//! separately. A node is selected if p − q > 1e-12. So ties and unreached nodes (p = q = 0) are not selected.
//!
//! Graphs, Laplacians and elimination orders are matrices and permutations of [`sprs`], which this crate exports again.
//!
//! - [`Network`], [`Problem`], [`solve`]: one walk.
//! - [`elimination`]: many walks on one graph, with a subtraction-free elimination.
//! - [`multilevel`]: iterative walks on graphs too large to eliminate.
//! - [`uncertainty`]: uncertain nodes and proposals for the next seed.
//!
//! # Example
//!
//! A path of four nodes with a foreground seed at one end and a background seed at the other. The graph is a sparse matrix:
//!
//! ```
//! use sg_walk::sprs::prod::mul_acc_mat_vec_csr;
//! use sg_walk::sprs::{CsMat, TriMat};
//! use sg_walk::{Network, Precision, Problem, Seed, Solver, solve};
//!
//! let mut triplets = TriMat::new((4, 4));
//! for (u, v, w) in [(0, 1, 1.0), (1, 2, 1.0), (2, 3, 2.0)] {
//!     triplets.add_triplet(u, v, w);
//!     triplets.add_triplet(v, u, w);
//! }
//! let adjacency: CsMat<f64> = triplets.to_csr();
//! let network = Network::from_adjacency(adjacency.view())?;
//! let seeds = [Seed::Foreground, Seed::None, Seed::None, Seed::Background];
//! let problem = Problem { network: &network, seeds: &seeds, leak: 0.0, leaking: None };
//! let solver = Solver::Gth.with(Precision::F64);
//! let solution = solve(&problem, solver.as_ref(), None)?;
//!
//! let close = |a: &[f64], b: [f64; 4]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-15);
//! assert!(close(&solution.p, [1.0, 0.6, 0.2, 0.0]));
//! assert!(close(&solution.q, [0.0, 0.4, 0.8, 1.0]));
//! assert!(solution.is_selected(1) && !solution.is_selected(2));
//!
//! // p is harmonic: the Laplacian times p is 0 at the nodes without a seed.
//! let mut flow = [0.0; 4];
//! mul_acc_mat_vec_csr(network.laplacian().view(), &solution.p[..], &mut flow[..]);
//! assert!(flow[1].abs() < 1e-15 && flow[2].abs() < 1e-15);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! [`Network::new`] takes a list of edges instead. Its conductances have exponents of their own ([`Conductance`]), so they may
//! be smaller than any f64.

#![cfg_attr(test, allow(clippy::print_stdout, reason = "tests print what they measure"))]

pub mod cg;
pub mod cholesky;
pub mod conductance;
pub mod elimination;
pub mod float;
pub mod gth;
mod hierarchy;
pub mod multilevel;
mod network;
pub mod ordering;
pub mod system;
pub mod uncertainty;

#[cfg(test)]
mod elimination_tests;
#[cfg(test)]
mod family_tests;
#[cfg(test)]
mod hard_cases;
#[cfg(test)]
mod multilevel_tests;

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

pub use conductance::Conductance;
pub use network::{AdjacencyError, Network};
pub use sprs;
use sprs::PermOwnedI;
use system::System;

/// p − q of a selected node exceeds this number.
pub const THRESHOLD: f64 = 1e-12;

/// Seed of a node.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Seed {
    /// Unseeded.
    #[default]
    None,
    /// The walk ends here as foreground.
    Foreground,
    /// The walk ends here as background.
    Background,
}

/// One walk to solve.
#[derive(Debug, Clone, Copy)]
pub struct Problem<'a> {
    /// The graph.
    pub network: &'a Network,
    /// Seed of each node.
    pub seeds: &'a [Seed],
    /// ε: conductance to the background of every unseeded node, in units of its degree. At least 0.
    pub leak: f64,
    /// Nodes that leak; `None` means all.
    pub leaking: Option<&'a [bool]>,
}

/// The solution of a walk, one entry per node.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// Probability of meeting foreground first: 1 at foreground seeds, 0 at background seeds and at unreached nodes.
    pub p: Vec<f64>,
    /// Probability of meeting background first, computed independently of p.
    pub q: Vec<f64>,
    /// Whether a terminal is reachable.
    pub reached: Vec<bool>,
}

impl Solution {
    /// Whether a node is selected.
    #[must_use]
    pub fn is_selected(&self, node: usize) -> bool {
        self.leads(node, THRESHOLD)
    }

    /// Whether p − q of a node exceeds `threshold`; false for unreached nodes.
    #[must_use]
    pub fn leads(&self, node: usize, threshold: f64) -> bool {
        self.reached[node] && self.p[node] - self.q[node] > threshold
    }
}

/// A failed walk.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum WalkError {
    /// An invalid leak.
    #[error("the leak is {0}; it must be finite and at least 0")]
    Leak(f64),
    /// A wrong number of seeds.
    #[error("{found} seeds were given for a graph of {nodes} nodes")]
    Seeds {
        /// Length of the list.
        found: usize,
        /// Nodes of the graph.
        nodes: usize,
    },
    /// An elimination order of another graph.
    #[error("the elimination order has {found} nodes, and the graph has {nodes}")]
    Order {
        /// Length of the order.
        found: usize,
        /// Nodes of the graph.
        nodes: usize,
    },
    /// The factorization or iteration met zero, infinity or NaN.
    #[error(
        "{solver} broke down on this graph ({reason}); use --solver gth --precision f64, which does not depend on its condition"
    )]
    Breakdown {
        /// Name of the solver.
        solver: &'static str,
        /// The cause.
        reason: String,
    },
}

/// Algorithm of a walk.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Solver {
    /// Subtraction-free elimination, accurate in every entry for any condition.
    #[default]
    Gth,
    /// Sparse LDLᵀ factorization of the Laplacian, for comparison.
    Cholesky,
    /// Conjugate gradients with a diagonal preconditioner, for comparison and for very large graphs.
    Cg,
}

/// Arithmetic of the solver.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    /// 64 bits.
    #[default]
    F64,
    /// 32 bits, for comparison.
    F32,
}

/// Solver of the connected systems of a walk.
pub trait SystemSolver {
    /// p and q of the unknowns, in the order of the system.
    ///
    /// # Errors
    /// [`WalkError::Breakdown`].
    fn solve(&self, system: &System) -> Result<(Vec<f64>, Vec<f64>), WalkError>;

    /// Whether the solver eliminates a system of this size, so that the order matters.
    fn eliminates(&self, unknowns: usize) -> bool;
}

impl Solver {
    /// The solver in the given arithmetic.
    #[must_use]
    pub fn with(self, precision: Precision) -> Box<dyn SystemSolver + Send + Sync> {
        match (self, precision) {
            (Self::Gth, Precision::F64) => Box::new(gth::Gth64),
            (Self::Gth, Precision::F32) => Box::new(gth::Gth32),
            (Self::Cholesky, Precision::F64) => Box::new(cholesky::Cholesky::<f64>::new()),
            (Self::Cholesky, Precision::F32) => Box::new(cholesky::Cholesky::<f32>::new()),
            (Self::Cg, Precision::F64) => Box::new(cg::ConjugateGradients::<f64>::new()),
            (Self::Cg, Precision::F32) => Box::new(cg::ConjugateGradients::<f32>::new()),
        }
    }
}

/// Solves a walk.
///
/// `order` is an elimination order of all nodes (see [`ordering::minimum_degree`]). It saves time for many walks on one
/// graph. Without it, each system is ordered again.
///
/// # Errors
/// [`WalkError`] if the input is invalid or the solver breaks down.
pub fn solve(
    problem: &Problem<'_>,
    solver: &dyn SystemSolver,
    order: Option<&PermOwnedI<u32>>,
) -> Result<Solution, WalkError> {
    let n = problem.network.len();
    if !(problem.leak >= 0.0 && problem.leak.is_finite()) {
        return Err(WalkError::Leak(problem.leak));
    }
    if problem.seeds.len() != n || problem.leaking.is_some_and(|l| l.len() != n) {
        return Err(WalkError::Seeds { found: problem.seeds.len(), nodes: n });
    }
    if let Some(order) = order.filter(|order| order.dim() != n) {
        return Err(WalkError::Order { found: order.dim(), nodes: n });
    }
    let is = |seed| move |s: &Seed| *s == seed;
    let mut solution = Solution {
        p: problem.seeds.iter().map(|s| f64::from(u8::from(is(Seed::Foreground)(s)))).collect(),
        q: problem.seeds.iter().map(|s| f64::from(u8::from(is(Seed::Background)(s)))).collect(),
        reached: problem.seeds.iter().map(|s| *s != Seed::None).collect(),
    };
    let rank = order.map(PermOwnedI::inv_vec);
    for nodes in unknown_components(problem) {
        let foreground = touches(problem, &nodes, Seed::Foreground);
        let background = touches(problem, &nodes, Seed::Background) || leaks(problem, &nodes);
        for &u in &nodes {
            solution.reached[u as usize] = foreground || background;
        }
        match (foreground, background) {
            (false, false) => {}
            // With a single terminal, every walk that ends, ends there.
            (true, false) => nodes.iter().for_each(|&u| solution.p[u as usize] = 1.0),
            (false, true) => nodes.iter().for_each(|&u| solution.q[u as usize] = 1.0),
            (true, true) => {
                let system = System::new(problem, nodes, rank.as_deref(), solver);
                let (p, q) = solver.solve(&system)?;
                for (&u, (p, q)) in system.nodes().iter().zip(p.into_iter().zip(q)) {
                    solution.p[u as usize] = p;
                    solution.q[u as usize] = q;
                }
            }
        }
    }
    Ok(solution)
}

/// Connected components of the nodes without a seed, each ascending.
fn unknown_components(problem: &Problem<'_>) -> Vec<Vec<u32>> {
    let n = problem.network.len();
    let mut seen: Vec<bool> = problem.seeds.iter().map(|s| *s != Seed::None).collect();
    let mut components = Vec::new();
    let mut queue = VecDeque::new();
    for start in (0..).take(n) {
        if seen[start as usize] {
            continue;
        }
        seen[start as usize] = true;
        queue.push_back(start);
        let mut nodes = Vec::new();
        while let Some(u) = queue.pop_front() {
            nodes.push(u);
            for &v in problem.network.neighbours(u) {
                if !seen[v as usize] {
                    seen[v as usize] = true;
                    queue.push_back(v);
                }
            }
        }
        nodes.sort_unstable();
        components.push(nodes);
    }
    components
}

fn touches(problem: &Problem<'_>, nodes: &[u32], seed: Seed) -> bool {
    nodes.iter().any(|&u| problem.network.neighbours(u).iter().any(|&v| problem.seeds[v as usize] == seed))
}

fn leaks(problem: &Problem<'_>, nodes: &[u32]) -> bool {
    problem.leak > 0.0
        && nodes
            .iter()
            .any(|&u| problem.leaking.is_none_or(|l| l[u as usize]) && !problem.network.neighbours(u).is_empty())
}
