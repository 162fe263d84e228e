//! The multilevel walk against the elimination. Walks on the neighbours of points are tested in `sg-clusters`.

use std::sync::Arc;

use proptest::prelude::*;
use rand::RngExt;

use super::hard_cases::{gth, mesh, network, run, seeded};
use super::multilevel::{Answer, Boundary, Multilevel};
use super::*;
use sg_scene::synthetic::generator;

fn walk(made: &Multilevel, seeds: &[Seed], leak: f64, tolerance: f64) -> Result<Answer, WalkError> {
    let known = Multilevel::known(seeds);
    made.solve(&Boundary { known: &known, leak, leaking: None }, tolerance)
}

/// Largest |p − p*|, and how many nodes are on the other side though |p* − ½| > 1e-3.
fn off(got: &Answer, want: &Solution) -> (f64, usize) {
    let pairs = || got.p.iter().zip(&want.p).zip(&want.reached).filter(|(_, r)| **r).map(|(x, _)| x);
    let flips = pairs().filter(|(a, b)| (**b - 0.5).abs() > 1e-3 && (**a > 0.5) != (**b > 0.5)).count();
    (pairs().map(|(a, b)| (a - b).abs()).fold(0.0, f64::max), flips)
}

#[test]
fn boundaries_of_every_kind() {
    let g = network(6, &[(0, 1, 1.0), (1, 2, 2.0), (3, 4, 1.0)]);
    let made = Multilevel::new(Arc::new(g.clone()), Precision::F64);
    for (foreground, background) in
        [(&[][..], &[][..]), (&[0, 2, 4], &[1, 3, 5]), (&[0], &[]), (&[], &[4]), (&[0], &[2])]
    {
        for leak in [0.0, 0.03] {
            let seeds = seeded(6, foreground, background);
            let (got, want) = (walk(&made, &seeds, leak, 1e-10).unwrap(), gth(&g, &seeds, leak));
            assert!(off(&got, &want).0 <= 1e-10 && got.reached == want.reached, "{foreground:?} {background:?} {leak}");
            assert!(got.p.iter().zip(&want.reached).all(|(p, r)| *r || *p == 0.0));
        }
    }
    // Values in between: the walk along a chain is linear.
    let chain = network(5, &[(0, 1, 1.0), (1, 2, 1.0), (2, 3, 1.0), (3, 4, 1.0)]);
    let known = [Some(0.2), None, None, None, Some(0.6)];
    let answer = Multilevel::new(Arc::new(chain), Precision::F64)
        .solve(&Boundary { known: &known, leak: 0.0, leaking: None }, 1e-10)
        .unwrap();
    assert!(answer.p.iter().zip([0.2, 0.3, 0.4, 0.5, 0.6]).all(|(p, w)| (p - w).abs() < 1e-9), "{:?}", answer.p);
    for n in [0, 1] {
        assert_eq!(
            walk(&Multilevel::new(Arc::new(network(n, &[])), Precision::F32), &vec![Seed::None; n], 0.03, 1e-6)
                .unwrap()
                .p,
            vec![0.0; n]
        );
    }
    assert!(matches!(walk(&made, &[], 0.0, 1e-6), Err(WalkError::Seeds { .. })));
    assert!(matches!(walk(&made, &[Seed::None; 6], f64::NAN, 1e-6), Err(WalkError::Leak(_))));
}

#[test]
fn far_off_nodes_and_islands_are_settled_exactly() {
    // e⁻¹⁰⁰⁰ to a single node, e⁻²⁰⁰⁰ to an island of weight 1, and beyond it another node.
    for precision in [Precision::F32, Precision::F64] {
        let mut edges: Vec<(u32, u32, Conductance)> = mesh(0, 600, 4)
            .into_iter()
            .chain(mesh(610, 50, 5))
            .map(|(u, v, w)| (u, v, Conductance::new(w).unwrap()))
            .collect();
        edges.extend([(0, 600, Conductance::exp(-1000.0)), (200, 600, Conductance::exp(-1001.0))]);
        edges.extend([(100, 610, Conductance::exp(-2000.0)), (250, 620, Conductance::exp(-2000.5))]);
        edges.push((630, 601, Conductance::exp(-3000.0)));
        let g = Network::new(660, edges.into_iter());
        for leak in [0.0, 0.03] {
            let seeds = seeded(660, &[3], &[90]);
            let (got, want) = (
                walk(&Multilevel::new(Arc::new(g.clone()), precision), &seeds, leak, 1e-6).unwrap(),
                gth(&g, &seeds, leak),
            );
            assert!(off(&got, &want).0 <= 1e-6 && got.reached == want.reached, "{:?}", off(&got, &want));
        }
    }
}

#[test]
fn unsupported_requests_are_refused() {
    // A chain whose every conductance is e⁻¹⁰⁰ of the one before: each node is faint beside the largest, none beside the next.
    let chain = (0..40).map(|i| (i, i + 1, Conductance::exp(-100.0 * f64::from(i))));
    let mut edges: Vec<_> = chain.collect();
    edges.extend((1..40).map(|i| (0, i, Conductance::exp(-590.0))));
    let g = Network::new(41, edges.into_iter());
    let seeds = seeded(41, &[0], &[40]);
    match walk(&Multilevel::new(Arc::new(g.clone()), Precision::F64), &seeds, 0.0, 1e-6) {
        Ok(answer) => assert!(off(&answer, &gth(&g, &seeds, 0.0)).0 <= 1e-6),
        Err(e) => {
            println!("{e}");
            assert!(matches!(e, WalkError::Breakdown { solver: "multilevel", .. }));
        }
    }
    // Never above the requested tolerance, even if rounding does not allow that tolerance.
    let g = network(600, &mesh(0, 600, 4));
    let seeds = seeded(600, &[3], &[90]);
    assert!(walk(&Multilevel::new(Arc::new(g.clone()), Precision::F32), &seeds, 0.0, 1e-8).is_err());
    let answer = walk(&Multilevel::new(Arc::new(g), Precision::F64), &seeds, 0.0, 1e-300);
    assert!(answer.is_err() || answer.unwrap().quality.estimate <= 1e-300);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]
    #[test]
    fn random_graphs(
        n in 2..900_usize,
        seed in 0..1000_u64,
        spread in 0.0..20.0_f64,
        leak in prop_oneof![Just(0.0), Just(0.03), Just(1e-6)],
    ) {
        let mut r = generator(seed);
        let edges: Vec<(u32, u32, f64)> = (0..3 * n)
            .map(|_| {
                let u = r.random_range(0..n as u32);
                let v = (u + r.random_range(1..20)) % n as u32;
                (u, v, (-r.random_range(0.0..1.0) * spread).exp())
            })
            .collect();
        let g = network(n, &edges);
        let seeds: Vec<Seed> = (0..n).map(|_| match r.random_range(0..30) { 0 => Seed::Foreground, 1 => Seed::Background, _ => Seed::None }).collect();
        let want = run(&g, &seeds, leak, Solver::Gth.with(Precision::F64).as_ref()).unwrap();
        let got = walk(&Multilevel::new(Arc::new(g.clone()), Precision::F32), &seeds, leak, 1e-6);
        // Conductances over more than three orders of magnitude at random may be refused, never answered wrongly.
        prop_assert!(got.is_ok() || spread > 7.0, "{got:?}");
        let Ok(got) = got else { return Ok(()) };
        prop_assert!(off(&got, &want).0 <= 1e-6, "{:?} {:?}", off(&got, &want), got.quality);
        prop_assert_eq!(got.reached, want.reached);
    }
}
