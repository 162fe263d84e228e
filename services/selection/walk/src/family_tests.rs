//! The walks of a family against one ordinary walk a leak.

use proptest::prelude::*;

use super::elimination::Elimination;
use super::hard_cases::{Reference, error, mesh, network, run, seeded};
use super::*;

/// Twelve leaks from 10^-4.5 to 1.
fn leaks() -> Vec<f64> {
    (0..12).map(|i| 10.0_f64.powf(-4.5 * (11 - i) as f64 / 11.0)).collect()
}

/// Solves the family and checks every walk against the ordinary one, and that the selected sets are nested.
fn checked(g: &Network, seeds: &[Seed], leaks: &[f64], leaking: Option<&[bool]>) -> f64 {
    let mut kept = Elimination::new(g, None);
    let solutions = kept.family(leaks).unwrap().solve(seeds, leaking).unwrap();
    assert_eq!(solutions.len(), leaks.len());
    let mut largest = 0.0_f64;
    for (got, leak) in solutions.iter().zip(leaks) {
        let want = kept.solve(seeds, *leak, leaking).unwrap();
        largest = largest.max(error(got, &want));
        assert_eq!(got.reached, want.reached);
        assert!((0..g.len()).all(|u| got.is_selected(u) == want.is_selected(u)), "masks at {leak}");
    }
    nested(&solutions, leaks);
    largest
}

/// Where p − q is farther from the threshold than rounding, a smaller leak selects whatever a larger one does.
fn nested(solutions: &[Solution], leaks: &[f64]) {
    let mut order: Vec<usize> = (0..leaks.len()).collect();
    order.sort_by(|a, b| leaks[*a].total_cmp(&leaks[*b]));
    for threshold in [THRESHOLD, -0.5, 0.3] {
        for pair in order.windows(2) {
            let (small, large) = (&solutions[pair[0]], &solutions[pair[1]]);
            for u in (0..small.p.len()).filter(|u| large.leads(*u, threshold + 1e-13)) {
                assert!(
                    small.leads(u, threshold - 1e-13),
                    "node {u} between {} and {}",
                    leaks[pair[0]],
                    leaks[pair[1]]
                );
            }
        }
    }
}

#[test]
fn ordinary_graphs_and_islands_equal_one_walk_a_leak() {
    let g = network(296, &mesh(0, 296, 1));
    for seeds in [seeded(296, &[3, 4, 5], &[150, 151]), seeded(296, &[3, 4, 5], &[]), seeded(296, &[], &[1])] {
        assert_eq!(checked(&g, &seeds, &leaks(), None), 0.0, "the same bits");
        let leaking: Vec<bool> = (0..296).map(|u| u % 3 > 0).collect();
        assert_eq!(checked(&g, &seeds, &leaks(), Some(&leaking)), 0.0);
    }
    for small in [1e-8, 1e-12, 1e-20, 1e-50, 1e-80] {
        let mut edges = mesh(0, 150, 2);
        edges.extend([(7, 150, small), (90, 151, 2.0 * small)]);
        let g = network(152, &edges);
        for some in [leaks(), vec![0.0, 1e-8, 0.03], vec![1e-100, 1e-20, 1e-12, 1.0, 1000.0]] {
            let off = checked(&g, &seeded(152, &[150], &[151]), &some, None);
            println!("island, conductance {small:.0e}, {} leaks: off by {off:.0e}", some.len());
            assert!(off <= 1e-14);
        }
    }
    for decay in [10.0_f64, 0.1] {
        let edges: Vec<(u32, u32, f64)> = (0..57).map(|i| (i, i + 1, decay.powi(-(i as i32)))).collect();
        let g = network(58, &edges);
        for seeds in [seeded(58, &[0], &[57]), seeded(58, &[57], &[])] {
            assert!(checked(&g, &seeds, &leaks(), None) <= 1e-14);
        }
    }
    // Beyond the range of f64: one leak after another, in conductances with exponents of their own.
    let edges = (0..36).map(|i| (i, i + 1, Conductance::new(10.0_f64.powi(17 * (i as i32 - 20))).unwrap()));
    assert!(checked(&Network::new(37, edges), &seeded(37, &[0], &[]), &leaks(), None) <= 1e-14);
}

#[test]
fn wrong_numbers_are_refused_and_empty_families_are_families() {
    let g = network(4, &[(0, 1, 1.0), (1, 2, 1.0)]);
    let kept = Elimination::new(&g, None);
    for leak in [-0.1, f64::NAN, f64::INFINITY] {
        assert!(matches!(kept.family(&[0.03, leak]), Err(WalkError::Leak(_))));
    }
    assert_eq!(kept.family(&[]).unwrap().solve(&seeded(4, &[0], &[]), None), Ok(Vec::new()));
    let mut family = kept.family(&[0.03; 5]).unwrap();
    assert!(matches!(family.solve(&[Seed::None], None), Err(WalkError::Seeds { .. })));
    // Nothing seeded, no edge at node 3: no terminal but the leak, and none at all.
    let found = family.solve(&[Seed::None; 4], None).unwrap();
    assert!(found.iter().all(|s| s.q == [1.0, 1.0, 1.0, 0.0] && !s.reached[3]));
    let none = network(0, &[]);
    assert_eq!(Elimination::new(&none, None).family(&[0.1]).unwrap().solve(&[], None).unwrap().len(), 1);
}

#[test]
fn the_same_bits_for_any_number_of_threads() {
    let g = network(300, &mesh(0, 300, 9));
    let seeds = seeded(300, &[1, 2], &[200]);
    let of = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| Elimination::new(&g, None).family(&leaks()).unwrap().solve(&seeds, None).unwrap())
    };
    let one = of(1);
    assert!([2, 3, 7].into_iter().all(|threads| of(threads) == one));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(80))]
    #[test]
    fn any_strokes_and_undos_give_the_walks_from_nothing(
        n in 1..30_usize,
        edges in proptest::collection::vec((0..30_u32, 0..30_u32, -8..8_i32, 0.5..2.0_f64), 0..90),
        wide in any::<bool>(),
        count in 1..10_usize,
        strokes in proptest::collection::vec((0..3_u8, proptest::collection::vec(0..30_usize, 1..5)), 1..6),
    ) {
        let spread = if wide { 40 } else { 4 };
        let edges: Vec<(u32, u32, f64)> = edges
            .iter()
            .map(|&(u, v, e, m)| (u % n as u32, v % n as u32, m * 2.0_f64.powi(spread * e)))
            .collect();
        let g = network(n, &edges);
        let leaks: Vec<f64> = leaks().into_iter().take(count).collect();
        let mut kept = Elimination::new(&g, None).family(&leaks).unwrap();
        let mut seeds = vec![Seed::None; n];
        for (kind, nodes) in strokes {
            let seed = [Seed::Foreground, Seed::Background, Seed::None][kind as usize];
            nodes.iter().for_each(|&u| seeds[u % n] = seed);
            let got = kept.solve(&seeds, None).unwrap();
            prop_assert!(kept.eliminated_columns() <= n);
            let anew = Elimination::new(&g, None).family(&leaks).unwrap().solve(&seeds, None).unwrap();
            prop_assert_eq!(&got, &anew, "bit for bit");
            for (got, leak) in got.iter().zip(&leaks) {
                let want = Elimination::new(&g, None).solve(&seeds, *leak, None).unwrap();
                prop_assert!(error(got, &want) <= 1e-14, "{}", error(got, &want));
                prop_assert_eq!(&got.reached, &want.reached);
                if !wide {
                    let truth = run(&g, &seeds, *leak, &Reference).unwrap();
                    prop_assert!(error(got, &truth) <= 1e-14, "{}", error(got, &truth));
                    let masks = |s: &Solution| (0..n).map(|u| s.is_selected(u)).collect::<Vec<_>>();
                    let near = (0..n).any(|u| (truth.p[u] - truth.q[u] - THRESHOLD).abs() < 1e-13);
                    prop_assert!(near || masks(got) == masks(&truth));
                }
            }
            nested(&got, &leaks);
        }
    }
}
