//! Walks on large graphs: conjugate gradients with a multilevel preconditioner and an error estimate.
//!
//! The preconditioner is a K-cycle (Notay and Vassilevski 2008) over the aggregates of `hierarchy`. On each level it runs
//! a forward Gauss–Seidel sweep, the coarse correction and a backward sweep. The coarse correction takes up to two steps of
//! conjugate gradients on the sums of the aggregates. The coarsest level is eliminated without subtractions. Sweeps and sums
//! run in fixed blocks, so the result does not depend on the number of threads. Seeds and leak enter the levels for each
//! walk. The aggregates are computed once per graph.
//!
//! **Error.** The preconditioned residual is z = M⁻¹·A·e with the remaining error e. So |e| is about |z| over the smallest
//! eigenvalue of M⁻¹·A. The coefficients of conjugate gradients form a tridiagonal matrix. Its smallest eigenvalue (the
//! smallest Ritz value) approximates that eigenvalue. The *estimate* is twice max |z| over the Ritz value. The iteration
//! ends when the estimate is within the tolerance, and adds z once more.
//!
//! If every unknown leaks, the Laplacian applied to the constant 1 is at least ε·degree in every row. So
//! |p − p*| ≤ max |r_i| / (ε·d_i) with the final residual r. This proven *bound* ignores rounding only.

use std::sync::Arc;

use rayon::prelude::*;

use super::conductance::Conductance;
use super::elimination::Elimination;
use super::gth::Gth64;
use super::hierarchy::{Hierarchy, Level, Stored, within};
use super::{Network, Precision, Problem, Seed, WalkError, solve};

/// Largest share of a node's conductances that may be dropped as too small beside the largest of the graph.
///
/// Nodes whose conductances are all dropped are eliminated at the end, and so are groups of such nodes.
const MAX_LEFT_OUT: f64 = 1e-9;

/// Largest number of such nodes.
const MAX_FAINT: usize = 20_000;

/// Factor on the estimate: the smallest Ritz value lies above the smallest eigenvalue.
const SAFETY: f64 = 2.0;

/// Error of a probability from rounding the conductances to f32.
const NARROW_ROUNDING: f64 = 1.2e-7;

/// Number of rows of a Gauss–Seidel block, and of terms of a partial sum.
const BLOCK: usize = 4096;

/// Largest number of iterations.
const MAX_ITERATIONS: usize = 200;

/// A graph prepared for iterative walks.
#[derive(Debug, Clone)]
pub struct Multilevel {
    stored: Levels,
    /// Degree of each node in units of the largest conductance, by rank.
    degree: Vec<f64>,
    network: Arc<Network>,
    /// Nodes whose conductances are all out of range of the largest one.
    faint: Vec<bool>,
    /// Connected components over all conductances, and over those in range.
    whole: Components,
    near: Components,
    /// Whether a node has too much out of range to drop, but not everything.
    torn: bool,
}

/// Component of each node, and number of components.
#[derive(Debug, Clone)]
struct Components {
    of: Vec<u32>,
    count: usize,
}

#[derive(Debug, Clone)]
enum Levels {
    Narrow(Hierarchy<f32>),
    Wide(Hierarchy<f64>),
}

/// Boundary values and leak of a walk.
#[derive(Debug, Clone, Copy)]
pub struct Boundary<'a> {
    /// Fixed p of each node: 1 at foreground seeds, 0 at background seeds, or the result of another walk. `None` for
    /// unknowns.
    pub known: &'a [Option<f64>],
    /// ε, as in [`super::Problem`].
    pub leak: f64,
    /// Nodes that leak; `None` means all.
    pub leaking: Option<&'a [bool]>,
}

/// An approximate solution.
#[derive(Debug, Clone, PartialEq)]
pub struct Answer {
    /// Probability of foreground of each node; 0 where no terminal is reachable.
    pub p: Vec<f64>,
    /// Whether a fixed node or the leak is reachable, for each node.
    pub reached: Vec<bool>,
    /// Quality of the solution.
    pub quality: Quality,
}

/// Quality of an approximate solution.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize)]
pub struct Quality {
    /// Number of unknowns.
    pub unknowns: usize,
    /// Number of iterations of conjugate gradients.
    pub iterations: usize,
    /// Estimate of the largest |p − p*|.
    pub estimate: f64,
    /// Proven bound of the largest |p − p*|, if every unknown leaks.
    pub bound: Option<f64>,
}

impl Multilevel {
    /// Prepares a graph. With [`Precision::F32`], conductances are stored in f32 if their range suffices. Sums and unknowns
    /// are always f64.
    #[must_use]
    pub fn new(network: Arc<Network>, precision: Precision) -> Self {
        let shift = network.adjacency().data().iter().map(|w| w.exponent()).max().unwrap_or(0);
        let narrow = (precision == Precision::F32).then(|| reach::<f32>(&network, shift)).filter(|r| !r.1);
        let (stored, (faint, torn)) = match narrow {
            Some(reach) => (Levels::Narrow(Hierarchy::new(&network, shift)), reach),
            None => (Levels::Wide(Hierarchy::new(&network, shift)), reach::<f64>(&network, shift)),
        };
        let (order, least) = match &stored {
            Levels::Narrow(h) => (&h.order, shift - f32::REACH),
            Levels::Wide(h) => (&h.order, shift - f64::REACH),
        };
        let degree = order.iter().map(|&u| network.degree(u).scaled(shift)).collect();
        let (whole, near) = (components(&network, i64::MIN), components(&network, least));
        Self { stored, degree, faint, whole, near, torn, network }
    }

    /// Number of nodes of each level, finest first.
    #[must_use]
    pub fn sizes(&self) -> Vec<usize> {
        match &self.stored {
            Levels::Narrow(h) => h.levels.iter().map(Level::len).collect(),
            Levels::Wide(h) => h.levels.iter().map(Level::len).collect(),
        }
    }

    /// Fixed values of seeds, for [`Boundary::known`].
    #[must_use]
    pub fn known(seeds: &[Seed]) -> Vec<Option<f64>> {
        seeds
            .iter()
            .map(|s| match s {
                Seed::None => None,
                Seed::Foreground => Some(1.0),
                Seed::Background => Some(0.0),
            })
            .collect()
    }

    /// Iterates until the estimated error is at most `tolerance`.
    ///
    /// # Errors
    /// [`WalkError`] if the input is invalid, the graph exceeds the range of f64, or the tolerance is below the rounding of the
    /// stored conductances. It is also an error if the iteration breaks down or does not converge.
    pub fn solve(&self, boundary: &Boundary<'_>, tolerance: f64) -> Result<Answer, WalkError> {
        let n = self.degree.len();
        if !(boundary.leak >= 0.0 && boundary.leak.is_finite()) {
            return Err(WalkError::Leak(boundary.leak));
        }
        if boundary.known.len() != n || boundary.leaking.is_some_and(|l| l.len() != n) {
            return Err(WalkError::Seeds { found: boundary.known.len(), nodes: n });
        }
        if self.torn {
            return Err(broken("a node's conductances are too small beside the largest of the graph".to_owned()));
        }
        match &self.stored {
            Levels::Narrow(h) => {
                let left = tolerance - NARROW_ROUNDING;
                if left <= NARROW_ROUNDING {
                    return Err(broken(format!("{tolerance:e} is too little for conductances in f32")));
                }
                let mut answer = self.solve_in(h, boundary, left)?;
                answer.quality.estimate += NARROW_ROUNDING;
                if let Some(bound) = &mut answer.quality.bound {
                    *bound += NARROW_ROUNDING;
                }
                Ok(answer)
            }
            Levels::Wide(h) => self.solve_in(h, boundary, tolerance),
        }
    }

    fn solve_in<W: Stored>(
        &self,
        hierarchy: &Hierarchy<W>,
        boundary: &Boundary<'_>,
        tolerance: f64,
    ) -> Result<Answer, WalkError> {
        let n = self.degree.len();
        let order = &hierarchy.order;
        let leaks = |u: usize| boundary.leak > 0.0 && boundary.leaking.is_none_or(|l| l[u]);
        let ends = |components: &Components| {
            // Boundary of each component: a value above 0, a value below 1.
            let mut ends = vec![[false; 2]; components.count];
            for u in 0..n {
                let end = &mut ends[components.of[u] as usize];
                match boundary.known[u] {
                    Some(p) => {
                        end[0] |= p > 0.0;
                        end[1] |= p < 1.0;
                    }
                    // A node without a neighbour has no leak.
                    None => end[1] |= leaks(u) && !self.network.neighbours(u as u32).is_empty(),
                }
            }
            ends
        };
        let (whole, near) = (ends(&self.whole), ends(&self.near));
        let mut answer = Answer { p: vec![0.0; n], reached: vec![false; n], quality: Quality::default() };
        let mut free = vec![false; n];
        let mut rest = Vec::new();
        for (k, &u) in order.iter().enumerate() {
            let u = u as usize;
            let (far, end) = (whole[self.whole.of[u] as usize], near[self.near.of[u] as usize]);
            answer.reached[u] = boundary.known[u].is_some() || far != [false; 2];
            match boundary.known[u] {
                Some(p) => answer.p[u] = p,
                None if far == [false; 2] => {}
                None if self.faint[u] || end == [false; 2] => rest.push(u as u32),
                None => {
                    // With a single terminal, every walk that ends, ends there.
                    answer.p[u] = f64::from(u8::from(end == [true, false]));
                    free[k] = end == [true, true];
                }
            }
        }
        let value: Vec<f64> = order.iter().map(|&u| boundary.known[u as usize].unwrap_or(0.0)).collect();
        let leak: Vec<f64> = order
            .iter()
            .zip(&self.degree)
            .map(|(&u, d)| if leaks(u as usize) { boundary.leak * d } else { 0.0 })
            .collect();
        if free.contains(&true) {
            let walk = Cycle::new(hierarchy, free, &leak)?;
            let (x, quality) = walk.iterate(&value, &leak, tolerance)?;
            answer.quality = quality;
            for ((&u, &free), x) in order.iter().zip(&walk.free).zip(x) {
                if free {
                    answer.p[u as usize] = x.clamp(0.0, 1.0);
                }
            }
        }
        self.settle(&mut answer, rest, boundary.leak, &leaks)?;
        Ok(answer)
    }

    /// Eliminates the nodes out of range, with the iterated solution as their boundary.
    fn settle(
        &self,
        answer: &mut Answer,
        mut rest: Vec<u32>,
        leak: f64,
        leaks: &dyn Fn(usize) -> bool,
    ) -> Result<(), WalkError> {
        if rest.is_empty() {
            return Ok(());
        }
        if rest.len() > MAX_FAINT {
            return Err(broken(format!("{} nodes are too far from all others for f64", rest.len())));
        }
        rest.sort_unstable();
        let (foreground, background) = (rest.len() as u32, rest.len() as u32 + 1);
        let of = |p: f64| Conductance::new(p).unwrap_or(Conductance::ZERO);
        let mut edges = Vec::new();
        for (k, &u) in (0..).zip(&rest) {
            for (v, w) in self.network.links(u) {
                match rest.binary_search(&v) {
                    Ok(j) if j as u32 > k => edges.push((k, j as u32, w)),
                    Ok(_) => {}
                    Err(_) => {
                        let p = answer.p[v as usize];
                        edges.extend([(k, foreground, w * of(p)), (k, background, w * of(1.0 - p))]);
                    }
                }
            }
            if leaks(u as usize) {
                edges.push((k, background, self.network.degree(u) * of(leak)));
            }
        }
        let network = Network::new(rest.len() + 2, edges.into_iter());
        let mut seeds = vec![Seed::None; rest.len()];
        seeds.extend([Seed::Foreground, Seed::Background]);
        let problem = Problem { network: &network, seeds: &seeds, leak: 0.0, leaking: None };
        let solution = solve(&problem, &Gth64, None)?;
        for (&u, p) in rest.iter().zip(solution.p) {
            answer.p[u as usize] = p;
        }
        Ok(())
    }
}

fn broken(reason: String) -> WalkError {
    WalkError::Breakdown { solver: "multilevel", reason }
}

/// Nodes whose conductances are all out of range of the largest one. Also returns whether a node has too much out of range
/// to drop, but not everything.
fn reach<W: Stored>(network: &Network, shift: i64) -> (Vec<bool>, bool) {
    let nodes: Vec<(bool, bool)> = (0..network.len() as u32)
        .into_par_iter()
        .with_min_len(1024)
        .map(|u| {
            let out = network.links(u).map(|l| l.1).filter(|w| !within::<W>(*w, shift));
            let (count, sum) = out.fold((0, Conductance::ZERO), |(count, sum), w| (count + 1, sum + w));
            let faint = count == network.neighbours(u).len();
            (faint, !faint && (sum / network.degree(u)).scaled(0) > MAX_LEFT_OUT)
        })
        .collect();
    let torn = nodes.iter().any(|n| n.1);
    (nodes.into_iter().map(|n| n.0).collect(), torn)
}

/// Connected components over the conductances of at least 2^`least`.
fn components(network: &Network, least: i64) -> Components {
    let mut of = vec![u32::MAX; network.len()];
    let mut count = 0;
    let mut stack = Vec::new();
    for start in 0..network.len() as u32 {
        if of[start as usize] != u32::MAX {
            continue;
        }
        of[start as usize] = count;
        stack.push(start);
        while let Some(u) = stack.pop() {
            for (v, w) in network.links(u) {
                if w.exponent() >= least && of[v as usize] == u32::MAX {
                    of[v as usize] = count;
                    stack.push(v);
                }
            }
        }
        count += 1;
    }
    Components { of, count: count as usize }
}

/// The levels with the seeds and the leak of one walk.
struct Cycle<'a, W> {
    hierarchy: &'a Hierarchy<W>,
    /// Unknowns of the finest level.
    free: Vec<bool>,
    /// Conductances of the coarser levels between unknowns alone.
    weights: Vec<Vec<W>>,
    /// Diagonal of each level and its inverse; 0 for fixed nodes.
    diagonal: Vec<Vec<f64>>,
    inverse: Vec<Vec<f64>>,
    bottom: Elimination,
}

impl<'a, W: Stored> Cycle<'a, W> {
    fn new(hierarchy: &'a Hierarchy<W>, free: Vec<bool>, leak: &[f64]) -> Result<Self, WalkError> {
        let finest = &hierarchy.levels[0];
        // For each row: conductance to fixed nodes and the leak, and whether the row differs from the graph.
        let rows: Vec<(f64, f64, bool)> = (0..finest.len())
            .into_par_iter()
            .with_min_len(BLOCK)
            .map(|i| {
                if !free[i] {
                    return (0.0, 0.0, true);
                }
                let (mut out, mut all, mut changed) = (leak[i], leak[i], false);
                for (j, w) in finest.links(i) {
                    all += w.get();
                    if !free[j as usize] {
                        out += w.get();
                        changed = true;
                    }
                }
                (out, all, changed)
            })
            .collect();
        let mut ground: Vec<f64> = rows.iter().map(|r| r.0).collect();
        let mut changed: Vec<bool> = rows.iter().map(|r| r.2).collect();
        let mut diagonal = vec![rows.iter().map(|r| r.1).collect::<Vec<f64>>()];
        let mut weights: Vec<Vec<W>> = Vec::new();
        if free.iter().zip(&diagonal[0]).any(|(&free, &d)| free && !(d > 0.0 && d.is_finite())) {
            return Err(broken("a node's conductances underflow beside the largest".to_owned()));
        }
        for pair in hierarchy.levels.windows(2) {
            let [fine, coarse] = pair else { continue };
            let fine_weights = weights.last();
            let coarse_ground: Vec<f64> =
                (0..coarse.len()).map(|c| members(coarse, c).map(|i| ground[i]).sum()).collect();
            let coarse_changed: Vec<bool> = (0..coarse.len()).map(|c| members(coarse, c).any(|i| changed[i])).collect();
            let own: Vec<Option<Vec<W>>> = (0..coarse.len())
                .into_par_iter()
                .with_min_len(256)
                .map(|c| {
                    coarse_changed[c].then(|| {
                        let targets = &coarse.targets()[coarse.row(c)];
                        let mut sums = vec![0.0; targets.len()];
                        for i in members(coarse, c).filter(|&i| fine_weights.is_some() || free[i]) {
                            for at in fine.row(i) {
                                let j = fine.targets()[at] as usize;
                                let w = match fine_weights {
                                    Some(weights) => weights[at],
                                    None if free[j] => fine.weights()[at],
                                    None => continue,
                                };
                                if let Ok(slot) = targets.binary_search(&fine.parent[j]) {
                                    sums[slot] += w.get();
                                }
                            }
                        }
                        sums.into_iter().map(W::of).collect()
                    })
                })
                .collect();
            let mut made = coarse.weights().to_vec();
            for (c, row) in own.into_iter().enumerate() {
                if let Some(row) = row {
                    made[coarse.row(c)].copy_from_slice(&row);
                }
            }
            diagonal.push(
                (0..coarse.len())
                    .map(|c| coarse_ground[c] + made[coarse.row(c)].iter().map(|w| w.get()).sum::<f64>())
                    .collect(),
            );
            weights.push(made);
            (ground, changed) = (coarse_ground, coarse_changed);
        }
        let inverse: Vec<Vec<f64>> =
            diagonal.iter().map(|d| d.iter().map(|&d| if d > 0.0 { 1.0 / d } else { 0.0 }).collect()).collect();
        let last = hierarchy.levels.len() - 1;
        let level = &hierarchy.levels[last];
        let own = weights.last().map_or(level.weights(), Vec::as_slice);
        let links = (0..level.len()).flat_map(|i| {
            let open = |i: usize| inverse[last][i] > 0.0;
            level.row(i).filter(move |_| open(i)).filter_map(move |at| {
                let j = level.targets()[at];
                (i < j as usize && open(j as usize))
                    .then(|| Some((i as u32, j, Conductance::new(own[at].get())?)))
                    .flatten()
            })
        });
        let bottom = Elimination::grounded(&Network::new(level.len(), links), &ground)?;
        Ok(Self { hierarchy, free, weights, diagonal, inverse, bottom })
    }

    fn weights(&self, l: usize) -> &[W] {
        if l == 0 { self.hierarchy.levels[0].weights() } else { &self.weights[l - 1] }
    }

    /// Contribution of the rows' neighbours: Σ w·x.
    fn gathered(level: &Level<W>, weights: &[W], i: usize, x: &[f64]) -> f64 {
        let row = level.row(i);
        let links = level.targets()[row.clone()].iter().zip(&weights[row]);
        links.fold(0.0, |sum, (&j, w)| sum + w.get() * x[j as usize])
    }

    /// `base` − A·x, or A·x without a base.
    fn applied(&self, l: usize, x: &[f64], base: Option<&[f64]>) -> Vec<f64> {
        let (level, weights) = (&self.hierarchy.levels[l], self.weights(l));
        let (diagonal, inverse) = (&self.diagonal[l], &self.inverse[l]);
        let mut out = vec![0.0; level.len()];
        out.par_iter_mut().with_min_len(BLOCK).enumerate().for_each(|(i, out)| {
            if inverse[i] > 0.0 {
                let ax = diagonal[i] * x[i] - Self::gathered(level, weights, i, x);
                *out = base.map_or(ax, |base| base[i] - ax);
            }
        });
        out
    }

    /// Forward sweep from 0.
    fn forwards(&self, l: usize, r: &[f64]) -> Vec<f64> {
        let (level, weights, inverse) = (&self.hierarchy.levels[l], self.weights(l), &self.inverse[l]);
        let targets = level.targets();
        let mut x = vec![0.0; level.len()];
        x.par_chunks_mut(BLOCK).enumerate().for_each(|(b, block)| {
            let start = b * BLOCK;
            for i in start..start + block.len() {
                if inverse[i] == 0.0 {
                    continue;
                }
                let mut sum = r[i];
                for at in level.row(i) {
                    let j = targets[at] as usize;
                    if j >= i {
                        break;
                    }
                    if j >= start {
                        sum += weights[at].get() * block[j - start];
                    }
                }
                block[i - start] = sum * inverse[i];
            }
        });
        x
    }

    /// Backward sweep from `old`.
    fn backwards(&self, l: usize, r: &[f64], old: &[f64]) -> Vec<f64> {
        let (level, weights, inverse) = (&self.hierarchy.levels[l], self.weights(l), &self.inverse[l]);
        let targets = level.targets();
        let mut x = old.to_vec();
        x.par_chunks_mut(BLOCK).enumerate().for_each(|(b, block)| {
            let start = b * BLOCK;
            for i in (start..start + block.len()).rev() {
                if inverse[i] == 0.0 {
                    continue;
                }
                let mut sum = r[i];
                for at in level.row(i) {
                    let j = targets[at] as usize;
                    let x = block.get(j.wrapping_sub(start)).copied().unwrap_or_else(|| old[j]);
                    sum += weights[at].get() * x;
                }
                block[i - start] = sum * inverse[i];
            }
        });
        x
    }

    /// Preconditioner of a level: approximates A⁻¹·r.
    fn cycle(&self, l: usize, r: &[f64]) -> Result<Vec<f64>, WalkError> {
        if l + 1 == self.hierarchy.levels.len() {
            return Ok(self.bottom.grounded_solution(r));
        }
        let mut x = self.forwards(l, r);
        let rest = self.applied(l, &x, Some(r));
        let coarse = &self.hierarchy.levels[l + 1];
        let correction = self.two_steps(l + 1, &restrict(&coarse.members, &rest))?;
        prolong(&self.hierarchy.levels[l].parent, &self.inverse[l], &correction, &mut x);
        Ok(self.backwards(l, r, &x))
    }

    /// Up to two steps of conjugate gradients on a coarse level, preconditioned by its cycle.
    fn two_steps(&self, l: usize, r: &[f64]) -> Result<Vec<f64>, WalkError> {
        let c = self.cycle(l, r)?;
        if l + 1 == self.hierarchy.levels.len() {
            return Ok(c);
        }
        let v = self.applied(l, &c, None);
        let (rho, alpha) = (dot(&c, &v), dot(&c, r));
        if rho == 0.0 && alpha == 0.0 {
            return Ok(c);
        }
        positive(rho)?;
        let step = alpha / rho;
        let rest: Vec<f64> = r.iter().zip(&v).map(|(r, v)| r - step * v).collect();
        if dot(&rest, &rest) <= 0.0625 * dot(r, r) {
            return Ok(c.iter().map(|c| step * c).collect());
        }
        let d = self.cycle(l, &rest)?;
        let w = self.applied(l, &d, None);
        let (gamma, beta, other) = (dot(&d, &v), dot(&d, &w), dot(&d, &rest));
        let second = beta - gamma * (gamma / rho);
        if !(second > 0.0 && second.is_finite()) {
            // The second direction is the first one again.
            return Ok(c.iter().map(|c| step * c).collect());
        }
        let (own, new) = (step - gamma / rho * (other / second), other / second);
        Ok(c.iter().zip(&d).map(|(c, d)| own * c + new * d).collect())
    }

    fn iterate(&self, value: &[f64], leak: &[f64], tolerance: f64) -> Result<(Vec<f64>, Quality), WalkError> {
        let finest = &self.hierarchy.levels[0];
        let n = finest.len();
        let free = &self.free;
        let mut b = vec![0.0; n];
        b.par_iter_mut().with_min_len(BLOCK).enumerate().for_each(|(i, b)| {
            if free[i] {
                let known = finest.links(i).filter(|l| !free[l.0 as usize]);
                *b = known.map(|(j, w)| w.get() * value[j as usize]).sum();
            }
        });
        let mut x = vec![0.0; n];
        let mut r = b.clone();
        let mut last: Option<(Vec<f64>, Vec<f64>, f64)> = None;
        let mut estimate = f64::INFINITY;
        let mut ritz = Ritz::default();
        for iterations in 1..=MAX_ITERATIONS {
            let z = self.cycle(0, &r)?;
            // f64::max skips NaN, a sum does not.
            if !z.iter().sum::<f64>().is_finite() {
                return Err(broken("the preconditioner gave no number".to_owned()));
            }
            let turn = last.as_ref().map(|(_, image, curvature)| dot(&z, image) / curvature);
            if let Some(turn) = turn {
                ritz.turned(-turn);
            }
            estimate = z.iter().fold(0.0, |most: f64, z| most.max(z.abs())) * SAFETY / ritz.least();
            if estimate <= tolerance {
                x.iter_mut().zip(&z).for_each(|(x, z)| *x += z);
                let bound = free.iter().zip(leak).all(|(free, leak)| !free || *leak > 0.0).then(|| {
                    let rest = self.applied(0, &x, Some(&b));
                    let free = rest.iter().zip(leak).zip(free).filter(|(_, free)| **free);
                    free.fold(0.0, |most: f64, ((r, leak), _)| most.max(r.abs() / leak))
                });
                let unknowns = free.iter().filter(|f| **f).count();
                return Ok((x, Quality { unknowns, iterations, estimate, bound }));
            }
            let mut direction = z;
            if let (Some((old, _, _)), Some(turn)) = (&last, turn) {
                direction.iter_mut().zip(old).for_each(|(d, o)| *d -= turn * o);
            }
            let image = self.applied(0, &direction, None);
            let curvature = dot(&direction, &image);
            positive(curvature)?;
            let step = dot(&direction, &r) / curvature;
            ritz.stepped(step);
            x.iter_mut().zip(&direction).for_each(|(x, d)| *x += step * d);
            r.iter_mut().zip(&image).for_each(|(r, v)| *r -= step * v);
            last = Some((direction, image, curvature));
        }
        Err(broken(format!(
            "after {MAX_ITERATIONS} iterations the estimated error is {estimate:.1e}, not {tolerance:.1e}"
        )))
    }
}

/// The tridiagonal matrix of conjugate gradients for the preconditioned operator (Lanczos).
#[derive(Debug, Default)]
struct Ritz {
    steps: Vec<f64>,
    turns: Vec<f64>,
}

impl Ritz {
    fn stepped(&mut self, step: f64) {
        self.steps.push(step);
    }

    fn turned(&mut self, turn: f64) {
        self.turns.push(turn.max(0.0));
    }

    /// The smallest eigenvalue, limited to ½ as a precaution.
    fn least(&self) -> f64 {
        let (steps, turns) = (&self.steps, &self.turns);
        // Number of eigenvalues below x: negative pivots of T − x.
        let any_below = |x: f64| {
            let mut pivot = 1.0;
            for k in 0..steps.len() {
                let own = 1.0 / steps[k] + if k > 0 { turns[k - 1] / steps[k - 1] } else { 0.0 };
                let beside = if k > 0 { turns[k - 1] / (steps[k - 1] * steps[k - 1]) } else { 0.0 };
                pivot = own - x - beside / pivot;
                if pivot <= 0.0 {
                    return true;
                }
            }
            false
        };
        if !any_below(0.5) {
            return 0.5;
        }
        let (mut low, mut high) = (0.0, 0.5);
        for _ in 0..20 {
            let middle = 0.5 * (low + high);
            *(if any_below(middle) { &mut high } else { &mut low }) = middle;
        }
        high
    }
}

/// Members of an aggregate on the finer level.
fn members<W>(coarse: &Level<W>, c: usize) -> std::ops::Range<usize> {
    coarse.members[c] as usize..coarse.members[c + 1] as usize
}

/// Sums of a fine vector over the members of each coarse node. `offsets` bounds the members, which are contiguous.
fn restrict(offsets: &[u32], fine: &[f64]) -> Vec<f64> {
    offsets
        .par_windows(2)
        .with_min_len(BLOCK)
        .map(|ends| fine[ends[0] as usize..ends[1] as usize].iter().sum())
        .collect()
}

/// Adds a coarse vector to the unknowns of a fine one. `inverse` is 0 where a fine node is fixed.
fn prolong(parent: &[u32], inverse: &[f64], coarse: &[f64], fine: &mut [f64]) {
    fine.par_iter_mut().with_min_len(BLOCK).enumerate().for_each(|(i, fine)| {
        if inverse[i] > 0.0 {
            *fine += coarse[parent[i] as usize];
        }
    });
}

/// Σ a·b by fixed blocks.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let block = |(a, b): (&[f64], &[f64])| a.iter().zip(b).fold(0.0, |s, (a, b)| s + a * b);
    if a.len() <= BLOCK {
        return block((a, b));
    }
    let blocks: Vec<f64> = a.par_chunks(BLOCK).zip(b.par_chunks(BLOCK)).map(block).collect();
    blocks.into_iter().sum()
}

fn positive(curvature: f64) -> Result<(), WalkError> {
    if curvature > 0.0 && curvature.is_finite() {
        return Ok(());
    }
    Err(broken(format!("a search direction has curvature {curvature:e}")))
}
