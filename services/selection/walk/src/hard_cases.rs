//! Walks that break ordinary solvers, each with its measured error.
//!
//! The truth is a closed form if one exists. Elsewhere it is the same elimination in twice the digits. It is accurate to about
//! 1e-28 on every graph, because the bound on its error does not depend on the condition.

use std::ops::{Add, Div, Mul};

use proptest::prelude::*;
use rand::RngExt;

use super::gth::{Arithmetic, Real, eliminate};
use super::system::System;
use super::*;
use sg_scene::synthetic::generator;

/// A number of 106 bits: the unevaluated sum of two f64. Range as f64.
#[derive(Debug, Clone, Copy)]
struct Double {
    high: f64,
    low: f64,
}

fn two_sum(a: f64, b: f64) -> Double {
    let high = a + b;
    let b_seen = high - a;
    Double { high, low: (a - (high - b_seen)) + (b - b_seen) }
}

fn quick_sum(a: f64, b: f64) -> Double {
    let high = a + b;
    Double { high, low: b - (high - a) }
}

impl Add for Double {
    type Output = Self;

    fn add(self, o: Self) -> Self {
        let s = two_sum(self.high, o.high);
        quick_sum(s.high, s.low + (self.low + o.low))
    }
}

impl Mul for Double {
    type Output = Self;

    fn mul(self, o: Self) -> Self {
        let high = self.high * o.high;
        let low = self.high.mul_add(o.high, -high);
        quick_sum(high, low + (self.high * o.low + self.low * o.high))
    }
}

impl Div for Double {
    type Output = Self;

    fn div(self, o: Self) -> Self {
        let first = self.high / o.high;
        let back = o * Self { high: first, low: 0.0 };
        let rest = ((self.high - back.high) - back.low) + self.low;
        quick_sum(first, rest / o.high)
    }
}

impl Arithmetic for Double {
    const ZERO: Self = Self { high: 0.0, low: 0.0 };

    fn of(c: Conductance, shift: i64) -> Self {
        Self { high: c.scaled(shift), low: 0.0 }
    }

    fn is_nothing(self) -> bool {
        self.high == 0.0
    }
}

impl Real for Double {
    fn value(self) -> f64 {
        self.high + self.low
    }
}

/// The reference solver.
pub(super) struct Reference;

impl SystemSolver for Reference {
    fn solve(&self, system: &System) -> Result<(Vec<f64>, Vec<f64>), WalkError> {
        assert!(system.range() < 400, "outside the range of the reference");
        Ok(eliminate::<Double>(system))
    }

    fn eliminates(&self, _: usize) -> bool {
        true
    }
}

pub(super) fn network(nodes: usize, edges: &[(u32, u32, f64)]) -> Network {
    Network::new(nodes, edges.iter().map(|&(u, v, w)| (u, v, Conductance::new(w).unwrap())))
}

pub(super) fn seeded(nodes: usize, foreground: &[usize], background: &[usize]) -> Vec<Seed> {
    let mut seeds = vec![Seed::None; nodes];
    foreground.iter().for_each(|&u| seeds[u] = Seed::Foreground);
    background.iter().for_each(|&u| seeds[u] = Seed::Background);
    seeds
}

pub(super) fn run(
    network: &Network,
    seeds: &[Seed],
    leak: f64,
    solver: &dyn SystemSolver,
) -> Result<Solution, WalkError> {
    solve(&Problem { network, seeds, leak, leaking: None }, solver, None)
}

pub(super) fn gth(network: &Network, seeds: &[Seed], leak: f64) -> Solution {
    run(network, seeds, leak, Solver::Gth.with(Precision::F64).as_ref()).unwrap()
}

/// Largest relative error over all entries of p and q.
pub(super) fn error(got: &Solution, want: &Solution) -> f64 {
    let one = |(a, b): (&f64, &f64)| if a == b { 0.0 } else { ((a - b) / b).abs() };
    got.p.iter().zip(&want.p).chain(got.q.iter().zip(&want.q)).map(one).fold(0.0, f64::max)
}

/// Measures all solvers against the reference, prints the row, and returns the error of GTH in f64.
fn table_row(name: &str, network: &Network, seeds: &[Seed], leak: f64) -> f64 {
    let want = run(network, seeds, leak, &Reference).unwrap();
    let measure = |solver: Solver, precision| match run(network, seeds, leak, solver.with(precision).as_ref()) {
        Ok(got) => {
            let wrong = (0..network.len()).filter(|&u| got.is_selected(u) != want.is_selected(u)).count();
            (format!("{:.0e} ({wrong} wrong)", error(&got, &want)), error(&got, &want))
        }
        Err(_) => ("fails".to_owned(), f64::INFINITY),
    };
    let ours = measure(Solver::Gth, Precision::F64);
    println!(
        "{name:38} gth {} | gth f32 {} | cholesky {} | cg {} | cholesky f32 {}",
        ours.0,
        measure(Solver::Gth, Precision::F32).0,
        measure(Solver::Cholesky, Precision::F64).0,
        measure(Solver::Cg, Precision::F64).0,
        measure(Solver::Cholesky, Precision::F32).0,
    );
    ours.1
}

/// A connected random graph: a ring and chords, weights within a factor of ten.
pub(super) fn mesh(first: u32, n: u32, seed: u64) -> Vec<(u32, u32, f64)> {
    let mut r = generator(seed);
    let mut edges: Vec<(u32, u32, f64)> =
        (0..n).map(|i| (first + i, first + (i + 1) % n, r.random_range(0.2..2.0))).collect();
    for i in 0..n {
        for _ in 0..4 {
            let step = r.random_range(2..12);
            edges.push((first + i, first + (i + step) % n, r.random_range(0.2..2.0)));
        }
    }
    edges
}

/// Probabilities on a chain with foreground at its start and background at its end, by the resistances.
fn chain_truth(weights: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let n = weights.len() + 1;
    let before: Vec<f64> = (0..n).map(|k| weights[..k].iter().map(|w| 1.0 / w).sum()).collect();
    let after: Vec<f64> = (0..n).map(|k| weights[k..].iter().rev().map(|w| 1.0 / w).sum()).collect();
    let total = after[0];
    (after.iter().map(|r| r / total).collect(), before.iter().map(|r| r / total).collect())
}

fn chain(weights: &[f64]) -> (Network, Vec<Seed>) {
    let edges: Vec<(u32, u32, f64)> = (0..).zip(weights).map(|(i, &w)| (i, i + 1, w)).collect();
    (network(weights.len() + 1, &edges), seeded(weights.len() + 1, &[0], &[weights.len()]))
}

#[test]
fn an_ordinary_graph() {
    let g = network(296, &mesh(0, 296, 1));
    let seeds = seeded(296, &[3, 4, 5], &[150, 151]);
    assert!(table_row("ordinary (296)", &g, &seeds, 0.0) <= 1e-14);
    assert!(table_row("ordinary (296), leak .03", &g, &seeds, 0.03) <= 1e-14);
}

#[test]
fn an_island_with_a_leak_of_any_smallness() {
    // 150 nodes that hang on foreground by ε and on background by 2ε: p is a third all over.
    for small in [1e-8, 1e-12, 1e-20, 1e-50, 1e-80] {
        let mut edges = mesh(0, 150, 2);
        edges.extend([(7, 150, small), (90, 151, 2.0 * small)]);
        let g = network(152, &edges);
        let seeds = seeded(152, &[150], &[151]);
        assert!(table_row(&format!("island, conductance {small:.0e}"), &g, &seeds, 0.0) <= 1e-14);
        let p = gth(&g, &seeds, 0.0).p;
        assert!((p[40] - 1.0 / 3.0).abs() < 1e-7, "{}", p[40]);
    }
    // The same through the leak itself, down to 1e-100. Every unknown leaks the same share.
    for leak in [1e-8, 1e-12, 1e-20, 1e-100] {
        let mut edges = mesh(0, 150, 3);
        edges.push((7, 150, 1.0));
        let g = network(151, &edges);
        let seeds = seeded(151, &[150], &[]);
        assert!(table_row(&format!("leak {leak:.0e}"), &g, &seeds, leak) <= 1e-14);
        assert!(gth(&g, &seeds, leak).q.iter().take(150).all(|q| *q > 0.0), "q is small, not zero");
    }
}

#[test]
fn chains_of_decaying_weights_both_ways() {
    for decay in [10.0_f64, 0.1] {
        let weights: Vec<f64> = (0..57).map(|i| decay.powi(-i)).collect();
        let (g, seeds) = chain(&weights);
        let (p, q) = chain_truth(&weights);
        let truth = Solution { p, q, reached: vec![true; 58] };
        let e = error(&gth(&g, &seeds, 0.0), &truth);
        table_row(&format!("chain w = {decay}^-i (58)"), &g, &seeds, 0.0);
        println!("{:38} gth against the closed form {e:.0e}", "");
        assert!(e <= 1e-14, "{e}");
    }
    // Beyond the range of f64 in the conductances, 10^±340 apart: exponents of their own.
    let weights: Vec<f64> = (0..40).map(|i| 10.0_f64.powi(17 * (i - 20))).collect();
    let (g, seeds) = chain(&weights[..36]);
    let (p, q) = chain_truth(&weights[..36]);
    let e = error(&gth(&g, &seeds, 0.0), &Solution { p, q, reached: vec![true; 37] });
    println!("chain over 10^595: gth against the closed form {e:.0e}");
    assert!(e <= 1e-14, "{e}");
}

#[test]
fn ties_on_long_symmetric_chains_are_not_selected() {
    for n in [3, 11, 101, 1001, 5001] {
        let (g, seeds) = chain(&vec![1.0; n - 1]);
        let got = gth(&g, &seeds, 0.0);
        let middle = n / 2;
        let off = (got.p[middle] - got.q[middle]).abs();
        println!("symmetric chain of {n}: |p − q| in the middle {off:.0e}");
        assert!(off <= 1e-14 && !got.is_selected(middle));
        assert!(got.is_selected(middle - 1) && !got.is_selected(middle + 1));
        let (p, q) = chain_truth(&vec![1.0; n - 1]);
        assert!(error(&got, &Solution { p, q, reached: vec![true; n] }) <= 1e-13);
    }
}

#[test]
fn weights_that_are_zero_in_f64_still_decide() {
    // 20σ from foreground and 30σ from background: e⁻⁴⁰⁰ and e⁻⁹⁰⁰. Then the other way round, and both at 30σ.
    let solve_two = |a: f64, b: f64| {
        let edges = [(0, 1, Conductance::exp(-a * a)), (1, 2, Conductance::exp(-b * b))];
        gth(&Network::new(3, edges.into_iter()), &seeded(3, &[0], &[2]), 0.0)
    };
    let near = solve_two(20.0, 30.0);
    assert!(near.is_selected(1) && near.p[1] == 1.0);
    assert!((near.q[1] / (-500.0_f64).exp() - 1.0).abs() < 1e-13, "{:e}", near.q[1]);
    assert!(!solve_two(30.0, 20.0).is_selected(1));
    let tie = solve_two(30.0, 30.0);
    assert!(!tie.is_selected(1) && tie.p[1] == 0.5);
    // The same hanging on a part of weight 1. One scale for all would drop it.
    let mut edges: Vec<(u32, u32, Conductance)> =
        mesh(3, 20, 4).into_iter().map(|(u, v, w)| (u, v, Conductance::new(w).unwrap())).collect();
    edges.extend([
        (0, 1, Conductance::exp(-1600.0)),
        (1, 2, Conductance::exp(-2500.0)),
        (1, 5, Conductance::exp(-3000.0)),
    ]);
    let got = gth(&Network::new(23, edges.into_iter()), &seeded(23, &[0], &[2]), 0.0);
    assert!((1..23).filter(|&u| u != 2).all(|u| got.is_selected(u) && got.reached[u]));
}

#[test]
fn three_regions_with_gaps_and_sharp_sigmas() {
    // Weights as the cluster graph makes them, exp(−x²): regions of near neighbours with gaps between them.
    for sharp in [1.0, 4.0] {
        let mut r = generator(5);
        let n = 358_u32;
        let points: Vec<[f64; 3]> = (0..n)
            .map(|i| {
                std::array::from_fn(|a| r.random_range(0.0..1.0) + if a == 0 { 1.4 * f64::from(i % 3) } else { 0.0 })
            })
            .collect();
        let mut edges = Vec::new();
        for i in 0..n {
            for j in 0..i {
                let pairs = points[i as usize].iter().zip(&points[j as usize]);
                let d = pairs.map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt();
                if d < 0.62 {
                    edges.push((i, j, Conductance::exp(-(sharp * d / 0.2).powi(2))));
                }
            }
        }
        let g = Network::new(n as usize, edges.into_iter());
        let seeds = seeded(n as usize, &[0, 3, 6], &[2, 5]);
        for leak in [0.0, 0.03] {
            assert!(table_row(&format!("three regions, σ / {sharp}, leak {leak}"), &g, &seeds, leak) <= 1e-14);
        }
    }
}

#[test]
fn seeds_in_every_combination() {
    let g = network(6, &[(0, 1, 1.0), (1, 2, 2.0), (3, 4, 1.0)]);
    let none = gth(&g, &seeded(6, &[], &[]), 0.0);
    assert_eq!((none.p.clone(), none.q.clone(), none.reached.clone()), (vec![0.0; 6], vec![0.0; 6], vec![false; 6]));
    let all = gth(&g, &seeded(6, &[0, 2, 4], &[1, 3, 5]), 0.03);
    assert_eq!(all.p, [1.0, 0.0, 1.0, 0.0, 1.0, 0.0]);
    assert!((0..6).all(|u| all.is_selected(u) == (u % 2 == 0)));
    let foreground = gth(&g, &seeded(6, &[0], &[]), 0.0);
    assert_eq!(foreground.p, [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]);
    assert_eq!(foreground.reached, [true, true, true, false, false, false]);
    assert!(!foreground.is_selected(3) && !foreground.is_selected(5), "a part without a seed is never selected");
    let background = gth(&g, &seeded(6, &[], &[4]), 0.0);
    assert_eq!((background.p, background.q), (vec![0.0; 6], vec![0.0, 0.0, 0.0, 1.0, 1.0, 0.0]));
    // With a leak a part without a seed belongs to the background. A node without an edge still belongs to no side.
    let leaking = gth(&g, &seeded(6, &[0], &[]), 0.03);
    assert_eq!((leaking.q[3], leaking.p[3], leaking.reached[5]), (1.0, 0.0, false));
    for n in [0, 1] {
        let tiny = gth(&network(n, &[]), &vec![Seed::Foreground; n], 0.03);
        assert_eq!(tiny.p, vec![1.0; n]);
    }
}

#[test]
fn numbers_that_are_no_walk_are_refused() {
    let g = network(2, &[(0, 1, 1.0)]);
    let solver = Solver::Gth.with(Precision::F64);
    for leak in [-0.1, f64::NAN, f64::INFINITY] {
        assert!(matches!(run(&g, &seeded(2, &[0], &[]), leak, solver.as_ref()), Err(WalkError::Leak(_))));
    }
    assert!(matches!(run(&g, &[Seed::None], 0.0, solver.as_ref()), Err(WalkError::Seeds { .. })));
    let problem = Problem { network: &g, seeds: &[Seed::None; 2], leak: 0.0, leaking: None };
    let refused = solve(&problem, solver.as_ref(), Some(&PermOwnedI::identity(3)));
    assert_eq!(refused, Err(WalkError::Order { found: 3, nodes: 2 }));
}

#[test]
fn a_cached_order_changes_nothing_but_rounding() {
    let g = network(300, &mesh(0, 300, 6));
    let seeds = seeded(300, &[1, 2], &[200]);
    let order = ordering::minimum_degree(g.adjacency());
    let solver = Solver::Gth.with(Precision::F64);
    let problem = Problem { network: &g, seeds: &seeds, leak: 0.03, leaking: None };
    let cached = solve(&problem, solver.as_ref(), Some(&order)).unwrap();
    assert!(error(&cached, &gth(&g, &seeds, 0.03)) < 1e-14);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]
    #[test]
    fn random_graphs_of_any_scale(
        n in 2..25_usize,
        edges in proptest::collection::vec((0..25_u32, 0..25_u32, -20..20_i32, 0.5..2.0_f64), 0..80),
        marks in proptest::collection::vec(0..6_u8, 25),
        leak in prop_oneof![Just(0.0), Just(0.03), Just(1e-9)],
    ) {
        let edges: Vec<(u32, u32, f64)> = edges
            .iter()
            .map(|&(u, v, e, m)| (u % n as u32, v % n as u32, m * 2.0_f64.powi(4 * e)))
            .collect();
        let g = network(n, &edges);
        let seeds: Vec<Seed> =
            marks[..n].iter().map(|m| match m { 0 => Seed::Foreground, 1 => Seed::Background, _ => Seed::None }).collect();
        let got = gth(&g, &seeds, leak);
        let want = run(&g, &seeds, leak, &Reference).unwrap();
        prop_assert!(error(&got, &want) <= 1e-14, "{}", error(&got, &want));
        for u in 0..n {
            let sum = got.p[u] + got.q[u];
            let want = f64::from(u8::from(got.reached[u]));
            prop_assert!((sum - want).abs() < 1e-14, "p + q is {}", sum);
        }
        // Duplicates, self-loops and the order of the list mean nothing.
        let mut halves: Vec<(u32, u32, f64)> =
            edges.iter().rev().flat_map(|&(u, v, w)| [(v, u, 0.5 * w), (u, v, 0.5 * w), (u, u, w)]).collect();
        halves.push((0, 1 % n as u32, 0.0));
        prop_assert!(error(&gth(&network(n, &halves), &seeds, leak), &want) <= 1e-14);
        // Well-conditioned graphs: all solvers agree.
        let tame: Vec<(u32, u32, f64)> = edges.iter().map(|&(u, v, w)| (u, v, 1.0 + w.log2().abs())).collect();
        let g = network(n, &tame);
        let want = run(&g, &seeds, leak.max(1e-3), &Reference).unwrap();
        for (solver, precision, limit) in [
            (Solver::Cholesky, Precision::F64, 1e-9),
            (Solver::Cg, Precision::F64, 1e-6),
            (Solver::Gth, Precision::F32, 1e-5),
            (Solver::Cholesky, Precision::F32, 1e-1),
            (Solver::Cg, Precision::F32, 1e-1),
        ] {
            let got = run(&g, &seeds, leak.max(1e-3), solver.with(precision).as_ref()).unwrap();
            let off = got.p.iter().zip(&want.p).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            prop_assert!(off <= limit, "{solver:?} {precision:?}: {off}");
        }
    }
}
