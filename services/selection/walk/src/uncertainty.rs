//! Uncertainty of a walk's nodes, and proposals for the next seed.
//!
//! The *uncertainty* of a node is 1 − |p − q|. It is 0 where one side is certain. It is 1 at a tie and where no terminal is
//! reachable.
//!
//! Let h_i(s) be the probability that a walker from i visits s before its walk ends. It is a column of Green's function
//! over its diagonal, G_is / G_ss ([`Elimination::hitting`]). A foreground seed at s adds h_i(s)·q_s to p_i. A background
//! seed at s subtracts h_i(s)·p_s. Both are exact. The walk predicts a foreground seed with probability p_s. Let node i hold
//! m_i Gaussians. Then the expected effects of a seed at s are:
//!
//! - *shift* = 2·p_s·q_s·Σ m_i·h_i(s), the change of the summed p;
//! - *change* = Σ m_i·(p_s·f_i + q_s·b_i), the number of Gaussians that change sides.
//!
//! Here f_i is 1 if node i becomes selected after a foreground seed, else 0. b_i is 1 if it becomes unselected after a
//! background seed, else 0.
//!
//! Where no terminal is reachable, both seeds count as equally likely, and one of them selects the whole component.
//!
//! Proposals are chosen greedily by the largest discounted change. Each earlier proposal s discounts node i by 1 − ρ² with
//! ρ² = h_i(s)·h_s(i), the probability of a return trip from i over s. So ρ² is near 1 for nodes that the earlier seed
//! decides, and near 0 in other regions.

use super::elimination::Elimination;
use super::{Seed, Solution};

/// Uncertainty of a walk, one entry per node.
#[derive(Debug, Clone, PartialEq)]
pub struct Uncertainty {
    /// 1 − |p − q|; 0 at seeds and at inactive nodes.
    pub uncertainty: Vec<f64>,
    /// Expected Σ m·|Δp| after a seed at this node, in units of the masses; 0 at seeds.
    pub shift: Vec<f64>,
}

/// A proposed node for the next seed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// The node.
    pub node: usize,
    /// 1 − |p − q|.
    pub uncertainty: f64,
    /// Expected Σ m·|Δp| after a seed.
    pub shift: f64,
    /// Expected mass that changes sides after a seed.
    pub change: f64,
}

/// Number of nodes per proposal whose change is computed exactly; at least [`MIN_POOL`] in total.
const POOL: usize = 4;
const MIN_POOL: usize = 64;

/// Parameters of [`node_uncertainty`] and [`proposals`].
#[derive(Debug, Clone, Copy)]
pub struct ProposalQuery<'a> {
    /// Mass of each node, at least 0: its number of Gaussians.
    pub mass: &'a [f64],
    /// Nodes of the walk.
    pub active: &'a [bool],
    /// Smallest p − q of a selected node.
    pub threshold: f64,
}

/// Uncertainty of the last walk of `elimination` with the given seeds and solution. `None` before the first walk.
#[must_use]
pub fn node_uncertainty(
    elimination: &Elimination,
    seeds: &[Seed],
    solution: &Solution,
    query: &ProposalQuery<'_>,
) -> Option<Uncertainty> {
    let n = solution.p.len();
    let open = |u: usize| query.active[u] && seeds[u] == Seed::None;
    let hitting_mass = elimination.hitting_mass(query.mass)?;
    let lost = lost_mass(elimination, solution, query);
    let uncertainty = (0..n).map(|u| if open(u) { 1.0 - (solution.p[u] - solution.q[u]).abs() } else { 0.0 }).collect();
    let shift = (0..n)
        .map(|u| match (open(u), solution.reached[u]) {
            (false, _) => 0.0,
            (true, true) => 2.0 * solution.p[u] * solution.q[u] * hitting_mass[u],
            (true, false) => 0.5 * lost[u],
        })
        .collect();
    Some(Uncertainty { uncertainty, shift })
}

/// Active mass of the component of each unreached node; 0 for reached nodes.
fn lost_mass(elimination: &Elimination, solution: &Solution, query: &ProposalQuery<'_>) -> Vec<f64> {
    let component = elimination.components();
    let mut mass = vec![0.0; component.len()];
    let lost = |u: usize| query.active[u] && !solution.reached[u];
    for u in (0..component.len()).filter(|&u| lost(u)) {
        mass[component[u] as usize] += query.mass[u];
    }
    (0..component.len()).map(|u| if lost(u) { mass[component[u] as usize] } else { 0.0 }).collect()
}

/// At most `count` proposals for the next seed, best first. Empty before the first walk.
#[must_use]
pub fn proposals(
    elimination: &Elimination,
    seeds: &[Seed],
    solution: &Solution,
    query: &ProposalQuery<'_>,
    count: usize,
) -> Vec<Candidate> {
    let Some(nodes) = node_uncertainty(elimination, seeds, solution, query) else { return Vec::new() };
    let mut by_shift: Vec<usize> = (0..nodes.shift.len()).filter(|&u| nodes.shift[u] > 0.0).collect();
    by_shift.sort_by(|&a, &b| nodes.shift[b].total_cmp(&nodes.shift[a]).then(a.cmp(&b)));
    by_shift.truncate((POOL * count).max(MIN_POOL));
    let component = elimination.components();
    let pool: Vec<(Candidate, Vec<f64>)> = by_shift
        .into_iter()
        .map(|node| {
            // Without a terminal, every walk in the component visits the node.
            let hitting = elimination
                .hitting(node)
                .unwrap_or_else(|| component.iter().map(|&c| f64::from(u8::from(c == component[node]))).collect());
            let change = change(solution, query, node, &hitting);
            let (uncertainty, shift) = (nodes.uncertainty[node], nodes.shift[node]);
            (Candidate { node, uncertainty, shift, change }, hitting)
        })
        .collect();
    let mut left: Vec<f64> = vec![1.0; pool.len()];
    let mut out: Vec<Candidate> = Vec::new();
    while out.len() < count {
        let value = |i: usize| (left[i] * pool[i].0.change, left[i] * pool[i].0.shift);
        let best = (0..pool.len()).filter(|&i| left[i] > 0.0).max_by(|&a, &b| {
            let (x, y) = (value(a), value(b));
            x.0.total_cmp(&y.0).then(x.1.total_cmp(&y.1)).then(b.cmp(&a))
        });
        let Some(best) = best else { break };
        let (chosen, hitting) = &pool[best];
        for (i, (other, h)) in pool.iter().enumerate() {
            left[i] *= (1.0 - hitting[other.node] * h[chosen.node]).max(0.0);
        }
        left[best] = 0.0;
        out.push(*chosen);
    }
    out
}

/// Expected mass that changes sides after a seed at `node`.
fn change(solution: &Solution, query: &ProposalQuery<'_>, node: usize, hitting: &[f64]) -> f64 {
    let reached = solution.reached[node];
    let (p, q) = if reached { (solution.p[node], solution.q[node]) } else { (0.5, 0.5) };
    let mut sum = 0.0;
    for (u, &h) in hitting.iter().enumerate().filter(|(u, _)| query.active[*u]) {
        let lead = solution.p[u] - solution.q[u];
        let selected = lead > query.threshold;
        // Unreached, p = q = 0: a seed sets p to 1 or 0 in the whole component.
        let (up, down) = if reached { (2.0 * h * q, 2.0 * h * p) } else { (h, h) };
        if !selected && lead + up > query.threshold {
            sum += p * query.mass[u];
        } else if selected && lead - down <= query.threshold {
            sum += q * query.mass[u];
        }
    }
    sum
}
