//! The kept elimination against one from nothing, stroke by stroke.

use proptest::prelude::*;

use super::elimination::Elimination;
use super::hard_cases::{Reference, error, gth, mesh, network, run, seeded};
use super::*;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(120))]
    #[test]
    fn any_sequence_of_strokes_and_undos_is_the_walk_from_nothing(
        n in 1..30_usize,
        edges in proptest::collection::vec((0..30_u32, 0..30_u32, -8..8_i32, 0.5..2.0_f64), 0..90),
        wide in any::<bool>(),
        strokes in proptest::collection::vec((0..4_u8, proptest::collection::vec(0..30_usize, 1..5), 0..4_u8), 1..9),
    ) {
        let spread = if wide { 40 } else { 4 };
        let edges: Vec<(u32, u32, f64)> = edges
            .iter()
            .map(|&(u, v, e, m)| (u % n as u32, v % n as u32, m * 2.0_f64.powi(spread * e)))
            .collect();
        let g = network(n, &edges);
        let mut kept = Elimination::new(&g, None);
        let order = ordering::minimum_degree(g.adjacency());
        let mut history = vec![(vec![Seed::None; n], 0.0)];
        for (kind, nodes, leak) in strokes {
            let (mut seeds, mut epsilon) = history.last().unwrap().clone();
            match kind {
                3 if history.len() > 1 => {
                    history.pop();
                    (seeds, epsilon) = history.last().unwrap().clone();
                }
                kind => {
                    let seed = [Seed::Foreground, Seed::Background, Seed::None][kind as usize % 3];
                    nodes.iter().for_each(|&u| seeds[u % n] = seed);
                    if leak < 2 {
                        epsilon = [0.0, 0.03][leak as usize];
                    }
                    history.push((seeds.clone(), epsilon));
                }
            }
            let got = kept.solve(&seeds, epsilon, None).unwrap();
            let mut anew = Elimination::new(&g, Some(&order));
            prop_assert_eq!(&got, &anew.solve(&seeds, epsilon, None).unwrap(), "bit for bit");
            let want = gth(&g, &seeds, epsilon);
            prop_assert!(error(&got, &want) <= 1e-14, "{}", error(&got, &want));
            prop_assert_eq!(&got.reached, &want.reached);
            if !wide {
                let truth = run(&g, &seeds, epsilon, &Reference).unwrap();
                prop_assert!(error(&got, &truth) <= 1e-14, "{}", error(&got, &truth));
            }
        }
    }

    #[test]
    fn the_predicted_effect_of_a_seed_equals_its_effect(
        seed in 0..1000_u64,
        marks in proptest::collection::vec(0..40_usize, 2..5),
        node in 0..40_usize,
        leak in prop_oneof![Just(0.0), Just(0.03)],
    ) {
        let g = network(43, &[mesh(0, 40, seed), vec![(40, 41, 1.0)]].concat());
        let seeds = seeded(43, &marks[..1], &marks[1..]);
        let mut kept = Elimination::new(&g, None);
        let before = kept.solve(&seeds, leak, None).unwrap();
        let hitting = kept.hitting(node);
        prop_assert_eq!(hitting.is_none(), seeds[node] != Seed::None || !before.reached[node]);
        let Some(h) = hitting else { return Ok(()) };
        for kind in [Seed::Foreground, Seed::Background] {
            let mut more = seeds.clone();
            more[node] = kind;
            let after = kept.solve(&more, leak, None).unwrap();
            // A walker that would have ended on the other side now ends here if it comes by.
            let moved = if kind == Seed::Foreground { before.q[node] } else { -before.p[node] };
            for ((h, b), a) in h.iter().zip(&before.p).zip(&after.p).take(40) {
                prop_assert!((b + h * moved - a).abs() < 1e-14);
            }
        }
        kept.solve(&seeds, leak, None).unwrap();
        let mass: Vec<f64> = (0..43).map(|u| 1.0 + (u % 5) as f64).collect();
        let hitting_mass = kept.hitting_mass(&mass).unwrap();
        let want: f64 = h.iter().zip(&mass).map(|(h, m)| h * m).sum();
        prop_assert!((hitting_mass[node] / want - 1.0).abs() < 1e-13, "{} against {want}", hitting_mass[node]);
    }
}
