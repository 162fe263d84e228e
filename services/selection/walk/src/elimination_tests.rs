//! The kept elimination against one from nothing, stroke by stroke.

use proptest::prelude::*;
use rand::RngExt;

use super::elimination::Elimination;
use super::hard_cases::{Reference, error, gth, mesh, network, run, seeded};
use super::*;
use sg_scene::synthetic::generator;

/// Clusters of a volume: each of `n` joined to its nearest, weights over four orders of magnitude.
fn volume(n: usize, seed: u64) -> Network {
    let points = sg_scene::synthetic::random_points_f64(n, seed);
    let v = sg_clusters::vertices::Vertices::ordered((0..).zip(points).collect());
    let graph = sg_clusters::neighbours::neighbour_graph(&v, 11).unwrap();
    let mut r = generator(seed + 1);
    Network::new(n, graph.edges().map(|e| (e.a, e.b, Conductance::exp(-9.0 * r.random_range(0.0..1.0_f64)))))
}

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
        let order = ordering::minimum_degree(n, |u| g.links(u).iter().map(|l| l.0));
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
            let mut anew = Elimination::new(&g, Some(order.clone()));
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
    fn what_a_seed_would_do_is_what_it_does(
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

#[test]
fn a_further_seed_redoes_only_its_ancestors() {
    for n in [1000, 2000] {
        let g = volume(n, 5);
        let mut kept = Elimination::new(&g, None);
        let mut seeds = seeded(n, &[1, 2, 3], &[n - 2]);
        kept.solve(&seeds, 0.03, None).unwrap();
        assert_eq!(kept.eliminated_columns(), n);
        let mut made = 0;
        for u in 100..140 {
            seeds[u] = Seed::Foreground;
            let got = kept.solve(&seeds, 0.03, None).unwrap();
            made += kept.eliminated_columns();
            if u % 10 == 0 {
                let off = error(&got, &gth(&g, &seeds, 0.03));
                println!("{n} nodes, {} seeds: kept against from nothing {off:.0e}", u - 96);
                assert!(off <= 1e-14);
            }
        }
        println!("{n} nodes, {} entries: {} columns a further seed", kept.entries(), made / 40);
        assert!(made / 40 < n / 2);
        kept.solve(&seeds, 0.03, None).unwrap();
        assert_eq!(kept.eliminated_columns(), 0, "the same walk again costs its substitution alone");
    }
}

/// `cargo test --release --workspace --lib costs_of_a_further_stroke -- --ignored --nocapture`
#[test]
#[ignore = "times, for the documents"]
fn costs_of_a_further_stroke() {
    let best = |f: &mut dyn FnMut()| {
        (0..60)
            .map(|_| {
                let start = std::time::Instant::now();
                f();
                1e3 * start.elapsed().as_secs_f64()
            })
            .fold(f64::INFINITY, f64::min)
    };
    for n in [1000, 2000, 4000] {
        let g = volume(n, 5);
        let order = ordering::minimum_degree(n, |u| g.links(u).iter().map(|l| l.0));
        let seeds = seeded(n, &[1, 2, 3], &[n - 2]);
        let solver = Solver::Gth.with(Precision::F64);
        let problem = Problem { network: &g, seeds: &seeds, leak: 0.03, leaking: None };
        let from_nothing = best(&mut || drop(solve(&problem, solver.as_ref(), Some(&order))));
        let structure = best(&mut || drop(Elimination::new(&g, Some(order.clone()))));
        let mut kept = Elimination::new(&g, Some(order.clone()));
        let mut leak = 0.03;
        let other_leak = best(&mut || {
            leak = 0.04 - leak;
            kept.solve(&seeds, leak, None).unwrap();
        });
        kept.solve(&seeds, 0.03, None).unwrap();
        let same = best(&mut || drop(kept.solve(&seeds, 0.03, None)));
        let mut r = generator(9);
        let mut times = Vec::new();
        for _ in 0..60 {
            let mut more = seeds.clone();
            // A stroke: a handful of neighbouring clusters.
            let u = r.random_range(0..n as u32);
            more[u as usize] = Seed::Foreground;
            g.links(u).iter().take(4).for_each(|l| more[l.0 as usize] = Seed::Foreground);
            let mut made = 0;
            let t = (0..5)
                .map(|_| {
                    kept.solve(&seeds, 0.03, None).unwrap();
                    let start = std::time::Instant::now();
                    kept.solve(&more, 0.03, None).unwrap();
                    made = kept.eliminated_columns();
                    1e3 * start.elapsed().as_secs_f64()
                })
                .fold(f64::INFINITY, f64::min);
            times.push((t, made));
        }
        times.sort_by(|a, b| a.0.total_cmp(&b.0));
        kept.solve(&seeds, 0.03, None).unwrap();
        let mass = vec![1.0; n];
        let hitting_mass = best(&mut || drop(kept.hitting_mass(&mass)));
        let hitting = best(&mut || drop(kept.hitting(77)));
        println!(
            "{n} nodes: from nothing, order known {from_nothing:.2} ms | structure once {structure:.2} | another leak {other_leak:.2} | one more stroke, median {:.2} ({} columns), slowest {:.2} | same again {same:.3} | what each would change {hitting_mass:.2} | one of them {hitting:.3}",
            times[30].0, times[30].1, times[59].0
        );
    }
}
