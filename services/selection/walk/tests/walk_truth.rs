//! Walks that break ordinary solvers against exact answers in rational arithmetic (`walk_truth.py` makes them).

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a test fails by panicking and tells what it measured")]

use serde::Deserialize;
use sg_walk::elimination::Elimination;
use sg_walk::{Conductance, Network, Precision, Problem, Seed, Solution, Solver, solve};

#[derive(Deserialize)]
struct Case {
    name: String,
    nodes: usize,
    edges: Vec<(u32, u32, f64)>,
    foreground: Vec<usize>,
    background: Vec<usize>,
    leak: f64,
    p: Vec<f64>,
    q: Vec<f64>,
}

impl Case {
    fn network(&self) -> Network {
        Network::new(self.nodes, self.edges.iter().map(|&(u, v, w)| (u, v, Conductance::new(w).unwrap())))
    }

    fn seeds(&self) -> Vec<Seed> {
        (0..self.nodes)
            .map(|u| match (self.foreground.contains(&u), self.background.contains(&u)) {
                (true, false) => Seed::Foreground,
                (false, true) => Seed::Background,
                _ => Seed::None,
            })
            .collect()
    }

    /// Largest entrywise relative error of p and q, and how many nodes are on the wrong side.
    fn error(&self, got: &Solution) -> (f64, usize) {
        // Below the normal numbers f64 itself has fewer digits.
        let one = |(a, b): (&f64, &f64)| if a == b { 0.0 } else { (a - b).abs() / b.abs().max(f64::MIN_POSITIVE) };
        let worst = got.p.iter().zip(&self.p).chain(got.q.iter().zip(&self.q)).map(one).fold(0.0, f64::max);
        let wrong = (0..self.nodes).filter(|&u| got.is_selected(u) != (self.p[u] - self.q[u] > 1e-12)).count();
        (worst, wrong)
    }
}

#[test]
fn every_hard_case_is_exact_to_fourteen_digits() {
    let cases: Vec<Case> = serde_json::from_str(include_str!("walk_truth.json")).unwrap();
    assert!(cases.len() >= 30);
    let mut failed = [0; 5];
    for case in &cases {
        let (network, seeds) = (case.network(), case.seeds());
        let problem = Problem { network: &network, seeds: &seeds, leak: case.leak, leaking: None };
        let kept = Elimination::new(&network, None).solve(&seeds, case.leak, None).unwrap();
        let (kept, _) = case.error(&kept);
        let others = [
            (Solver::Gth, Precision::F64),
            (Solver::Gth, Precision::F32),
            (Solver::Cholesky, Precision::F64),
            (Solver::Cholesky, Precision::F32),
            (Solver::Cg, Precision::F64),
        ];
        let mut row = format!("{:34} kept gth {kept:.0e}", case.name);
        for (at, (solver, precision)) in others.into_iter().enumerate() {
            match solve(&problem, solver.with(precision).as_ref(), None) {
                Ok(got) => {
                    let (error, wrong) = case.error(&got);
                    row += &format!(" | {solver:?} {precision:?} {error:.0e} ({wrong} wrong)");
                    failed[at] += usize::from(wrong > 0 || error > 0.1);
                    if at == 0 {
                        assert!(error <= 1e-14 && wrong == 0, "{}: {error:e}", case.name);
                        assert_eq!(
                            got.reached,
                            case.p.iter().zip(&case.q).map(|(p, q)| p + q > 0.0).collect::<Vec<_>>()
                        );
                    }
                }
                Err(_) => {
                    row += &format!(" | {solver:?} {precision:?} fails");
                    failed[at] += 1;
                }
            }
        }
        println!("{row}");
        assert!(kept <= 1e-14, "{}: {kept:e}", case.name);
    }
    println!("cases with a failure, a wrong side or an error above 0.1: {failed:?} of {}", cases.len());
    // The failures of the others on these are the reason for elimination without subtractions in f64.
    assert_eq!(failed[0], 0);
    assert!(failed[1] > 0 && failed[2] > 0 && failed[3] > failed[2] && failed[4] > 0, "{failed:?}");
}
