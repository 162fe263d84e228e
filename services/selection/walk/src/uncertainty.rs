//! How sure a walk is of each node, and where one seed more would tell most.
//!
//! The *uncertainty* of a node is 1 − |p − q|: 0 where one side is certain, 1 at a tie and where no terminal is reached.
//!
//! Let h_i(s) be the probability that a walker from i comes to s before it ends: a column of Green's function over its
//! diagonal, G_is / G_ss ([`Elimination::hitting`]). If s became foreground, p_i would grow by h_i(s)·q_s, if background,
//! it would fall by h_i(s)·p_s; exactly, not to first order. Somebody who is asked about s says foreground with
//! probability p_s as far as the walk knows. So, with m_i Gaussians in node i, the answer moves
//! *shift* = 2·p_s·q_s·Σ m_i·h_i(s) of the summed p in expectation, and *change* = Σ m_i·(p_s·\[i becomes selected if s is
//! foreground\] + q_s·\[i ceases to be if s is background\]) Gaussians change sides. Where no terminal is reached both
//! answers are taken as equally likely, and one of them selects the whole component.
//!
//! Proposals are taken one after another, each the node with the largest change discounted by 1 − ρ² for every proposal
//! before it, where ρ² = h_i(s)·h_s(i) is the probability of going from i to s and back again before the walk ends: 1 for
//! a node that the earlier answer will decide as well, near 0 for one in another region.

use super::elimination::Elimination;
use super::{Seed, Solution};

/// What a walk leaves open, one entry a node.
#[derive(Debug, Clone, PartialEq)]
pub struct Uncertainty {
    /// 1 − |p − q|; 0 at seeds and at nodes that take no part.
    pub uncertainty: Vec<f64>,
    /// Expected Σ m·|Δp| after one seed more at this node, in units of the masses; 0 at seeds.
    pub shift: Vec<f64>,
}

/// A node where one seed more is worth having.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// The node.
    pub node: usize,
    /// 1 − |p − q|.
    pub uncertainty: f64,
    /// Expected Σ m·|Δp| after an answer.
    pub shift: f64,
    /// Expected mass that changes sides after an answer.
    pub change: f64,
}

/// Nodes whose change is worked out exactly for every proposal asked for, at least [`LEAST_POOL`].
const POOL: usize = 4;
const LEAST_POOL: usize = 64;

/// What is asked of [`proposals`].
#[derive(Debug, Clone, Copy)]
pub struct ProposalQuery<'a> {
    /// Mass of each node, at least 0: how many Gaussians it stands for.
    pub mass: &'a [f64],
    /// Nodes that take part.
    pub active: &'a [bool],
    /// The least p − q of a selected node.
    pub threshold: f64,
}

/// The uncertainty of the last walk of `elimination`, whose result was `solution`. None before the first walk.
#[must_use]
pub fn node_uncertainty(
    elimination: &Elimination,
    seeds: &[Seed],
    solution: &Solution,
    query: &ProposalQuery<'_>,
) -> Option<Uncertainty> {
    let n = solution.p.len();
    let open = |u: usize| query.active[u] && seeds[u] == Seed::None;
    let attention = elimination.attention(query.mass)?;
    let lost = lost_mass(elimination, solution, query);
    let uncertainty = (0..n).map(|u| if open(u) { 1.0 - (solution.p[u] - solution.q[u]).abs() } else { 0.0 }).collect();
    let shift = (0..n)
        .map(|u| match (open(u), solution.reached[u]) {
            (false, _) => 0.0,
            (true, true) => 2.0 * solution.p[u] * solution.q[u] * attention[u],
            (true, false) => 0.5 * lost[u],
        })
        .collect();
    Some(Uncertainty { uncertainty, shift })
}

/// For each node that no terminal reaches the active mass of its component.
fn lost_mass(elimination: &Elimination, solution: &Solution, query: &ProposalQuery<'_>) -> Vec<f64> {
    let component = elimination.components();
    let mut mass = vec![0.0; component.len()];
    let lost = |u: usize| query.active[u] && !solution.reached[u];
    for u in (0..component.len()).filter(|&u| lost(u)) {
        mass[component[u] as usize] += query.mass[u];
    }
    (0..component.len()).map(|u| if lost(u) { mass[component[u] as usize] } else { 0.0 }).collect()
}

/// At most `count` nodes where one seed more is worth most, best first. Empty before the first walk.
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
    by_shift.truncate((POOL * count).max(LEAST_POOL));
    let component = elimination.components();
    let pool: Vec<(Candidate, Vec<f64>)> = by_shift
        .into_iter()
        .map(|node| {
            // Where nothing is reached every walk from the component comes by.
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

/// Expected mass that changes sides when `node` is asked about.
fn change(solution: &Solution, query: &ProposalQuery<'_>, node: usize, hitting: &[f64]) -> f64 {
    let reached = solution.reached[node];
    let (p, q) = if reached { (solution.p[node], solution.q[node]) } else { (0.5, 0.5) };
    let mut sum = 0.0;
    for (u, &h) in hitting.iter().enumerate().filter(|(u, _)| query.active[*u]) {
        let lead = solution.p[u] - solution.q[u];
        let selected = lead > query.threshold;
        // Unreached, p = q = 0: an answer makes it 1 or 0 all over the component.
        let (up, down) = if reached { (2.0 * h * q, 2.0 * h * p) } else { (h, h) };
        if !selected && lead + up > query.threshold {
            sum += p * query.mass[u];
        } else if selected && lead - down <= query.threshold {
            sum += q * query.mass[u];
        }
    }
    sum
}
