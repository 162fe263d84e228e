use super::farthest::FarthestRule;
use super::*;
use crate::refinement::Refiner;
use crate::session::SelectionSession;
use crate::strokes::{Kind, Mode};
use glam::Vec3;
use sg_clusters::cluster_graph::GraphForm;
use sg_clusters::clustering::{ClusteringOptions, cluster};
use sg_clusters::geometry::GeometryOptions;
use sg_clusters::neighbours::{Edge, Graph};
use sg_clusters::progress::Silent;
use sg_scene::synthetic::{normalized, point_scene, random_points, surface_unit, vessel_and_sac};
use sg_walk::multilevel::{Boundary, Multilevel};
use sg_walk::{Problem, Seed, gth, solve};

fn clustered(scene: &Scene, most: usize) -> (Geometry, Clustering, ClusterGraph) {
    let geometry = Geometry::of_scene(scene, GeometryOptions::default(), &Silent).unwrap();
    let options = ClusteringOptions { max_clusters: most, ..ClusteringOptions::default() };
    let (clustering, _) = cluster(&geometry, &options, &Silent).unwrap();
    let graph = ClusterGraph::new(&geometry, &clustering, GraphForm::Contact).unwrap();
    (geometry, clustering, graph)
}

#[test]
fn the_farthest_rule_has_a_quota_in_each_component() {
    // A chain of 40 nodes, and one of 20 joined to its start by a bridge of length 100.
    let chain = |from: u32, to: u32| (from + 1..to).map(|i| Edge { a: i - 1, b: i, length: 1.0 });
    let bridge = Edge { a: 0, b: 40, length: 100.0 };
    let graph = Graph::from_edges(60, chain(0, 40).chain(chain(40, 60)).chain([bridge]));
    let component = (0..60).map(|i| Some(u32::from(i >= 40))).collect();
    let rule = FarthestRule { graph, component };
    let mut seeds = vec![Seed::None; 60];
    seeds[10] = Seed::Foreground;
    assert_eq!(rule.seed(&[true; 60], &mut seeds), 3);
    let chosen: Vec<usize> = (0..60).filter(|&i| seeds[i] == Seed::Background).collect();
    assert_eq!(chosen, [38, 39, 59]);
    let mut none = vec![Seed::None; 60];
    assert_eq!(rule.seed(&[true; 60], &mut none), 0);
}

#[test]
fn a_cluster_hit_by_both_brushes_goes_with_the_majority() {
    let scene = point_scene(&random_points(1500, 3));
    let (_, clustering, graph) = clustered(&scene, 60);
    for leak in [0.0, 0.03] {
        let options = WalkOptions { leak, ..WalkOptions::default() };
        let space = SelectionIndex::of_clusters(&scene, &clustering, &graph, options);
        let both = (0..space.clusters()).find(|&c| space.members(c).len() >= 5).unwrap();
        let other = (0..space.clusters()).find(|&c| c != both).unwrap();
        let (m, far) = (space.members(both).to_vec(), space.members(other)[0]);
        let walk = |foreground: &[u32], background: &[u32]| {
            space.walk(foreground.iter().copied(), background.iter().copied()).unwrap()
        };
        let off = |a: &Walk, b: &Walk| {
            let pairs = a.solution.p.iter().chain(&a.solution.q).zip(b.solution.p.iter().chain(&b.solution.q));
            pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
        };
        // Three against two: as if the two had not been hit.
        let most = walk(&m[..3], &[m[3], m[4], far]);
        assert_eq!((most.seeds[both], most.summary.conflicts), (Seed::Foreground, 1));
        let error = off(&most, &walk(&m[..3], &[far]));
        println!("leak {leak}, three against two: p and q differ from the majority's own walk by {error:.0e}");
        assert_eq!(error, 0.0);
        let least = walk(&m[..2], &[m[2], m[3], m[4], far]);
        assert_eq!((least.seeds[both], least.solution.p[both], least.solution.q[both]), (Seed::Background, 0.0, 1.0));
        // The same Gaussian under both brushes counts for both.
        assert_eq!(walk(&m[..3], &m[..2]).seeds[both], Seed::Foreground);
        // A tie is no seed: as if the cluster had not been hit.
        let tie = walk(&[m[0], m[1]], &[m[2], m[3], far]);
        assert_eq!((tie.seeds[both], tie.summary.conflicts, tie.summary.seeds_foreground), (Seed::None, 1, 0));
        let error = off(&tie, &walk(&[], &[far]));
        println!(
            "leak {leak}, two against two: p and q differ from the walk without the cluster's seeds by {error:.0e}"
        );
        assert_eq!(error, 0.0);
        // With nothing else to end in, a tie ends nowhere, or in the leak.
        let alone = walk(&m[..2], &m[2..4]);
        let reached = if leak > 0.0 { 1.0 } else { 0.0 };
        assert_eq!((alone.solution.p[both], alone.solution.q[both]), (0.0, reached));
        assert!(alone.units[0]);
    }
}

/// Flat Gaussians on a sphere whose walks have conductances over many orders of magnitude.
fn sharp_sphere(n: usize, sigma: f64, leak: f64) -> (Scene, SelectionIndex) {
    let points: Vec<(Vec3, Vec3)> = random_points(n, 8)
        .into_iter()
        .map(|p| (2.0 * Vec3::from_array(p) - Vec3::ONE).normalize())
        .map(|p| (p, p))
        .collect();
    let scene = Scene::compose(vec![surface_unit(&points, 0.02)], None);
    let geometry = Geometry::of_scene(&scene, GeometryOptions::default(), &Silent).unwrap();
    let clustering = Clustering::of_labels(&geometry, vec![-1; n], None).unwrap();
    let options = WalkOptions { leak, sigma_s: sigma, sigma_f: sigma, ..WalkOptions::default() };
    let space = SelectionIndex::of_gaussians(&scene, &geometry, &clustering, options);
    (scene, space)
}

#[test]
fn a_failed_iteration_falls_back_to_elimination_with_a_note() {
    let mut said = 0;
    for (sigma, leak) in [(1.0, 0.03), (0.5, 1e-4), (0.25, 1e-6)] {
        let (scene, space) = sharp_sphere(6000, sigma, leak);
        let of = |side: fn(f64) -> bool| {
            let on = |g: &u32| scene.position(*g as usize).is_some_and(|p| side(p.x));
            (0..6000).filter(on).collect::<Vec<u32>>()
        };
        let (foreground, background) = (of(|x| x > 0.9), of(|x| x < -0.9));
        let walk = space.walk(foreground.into_iter(), background.into_iter()).unwrap();
        let problem = Problem { network: &space.walks.network, seeds: &walk.seeds, leak, leaking: None };
        let want = solve(&problem, &gth::Gth64, None).unwrap();
        let error = walk.solution.p.iter().zip(&want.p).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        let known = Multilevel::known(&walk.seeds);
        let iterated =
            space.walks.multilevel.as_ref().unwrap().solve(&Boundary { known: &known, leak, leaking: None }, TOLERANCE);
        println!(
            "σ × {sigma}, leak {leak}: eliminated instead {}, error {error:.1e}; the iteration: {}",
            walk.summary.eliminated_instead,
            iterated.as_ref().map_or_else(ToString::to_string, |a| format!("{:?}", a.quality))
        );
        assert_eq!(walk.summary.eliminated_instead, iterated.is_err());
        assert_eq!(walk.quality.is_none(), walk.summary.eliminated_instead);
        assert!(error <= if walk.summary.eliminated_instead { 1e-14 } else { TOLERANCE });
        said += usize::from(walk.summary.eliminated_instead);
    }
    assert!(said > 0, "the scenes must hold one that cannot be iterated");
}

#[test]
fn a_walk_on_gaussians_reaches_as_far_as_one_on_clusters_with_the_leak_of_its_steps() {
    let (scene, sac) = vessel_and_sac(12_000, 4);
    let (geometry, clustering, graph) = clustered(&scene, 150);
    let refiner = Refiner::new(&geometry, &graph, 1.0, 1.0);
    let options = WalkOptions::default();
    let ring: Vec<Vec3> = (0..20)
        .map(|i| Vec3::new(0.0, 0.0, 0.36) + 0.3 * Vec3::new((0.15 * i as f32).cos(), 0.0, (0.15 * i as f32).sin()))
        .collect();
    let points = normalized(&scene, &ring);
    let stroke =
        Stroke { mode: Mode::Walk, kind: Kind::Foreground, radius: 0.02, points, pressure: Vec::new(), depth: None };
    let mut session =
        SelectionSession::new(Arc::new(SelectionIndex::of_clusters(&scene, &clustering, &graph, options)));
    session.add_stroke(stroke.clone()).unwrap();
    // Refining a band that holds everything is the walk on all Gaussians, with the leak of their steps.
    let all = refiner.refine(&session, 10_000, 1e-4).unwrap().unwrap();
    let space = SelectionIndex::of_gaussians(&scene, &geometry, &clustering, options);
    let hits = space.hits(&stroke);
    let walk = |leak| space.walk_incremental(&mut None, leak, hits.iter().copied(), std::iter::empty()).unwrap();
    let scaled = walk(refiner.leak(options.leak));
    let off = scaled.solution.p.iter().zip(&all.p).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    let share = |selected: &dyn Fn(usize) -> bool| {
        let found = (0..scene.len()).filter(|&g| sac[g] && selected(g)).count();
        found as f64 / sac.iter().filter(|s| **s).count() as f64
    };
    let bare = walk(options.leak);
    let (by_bare, by_scaled) = (share(&|g| bare.solution.is_selected(g)), share(&|g| scaled.solution.is_selected(g)));
    let by_clusters = share(&|g| session.mask().get(g));
    println!(
        "ε·(h/H)² = {:.1e}: p differs from the refined by {off:.1e}; of the sac are selected: on clusters {by_clusters:.2}, on Gaussians with ε·(h/H)² {by_scaled:.2}, with ε itself {by_bare:.2}",
        refiner.leak(options.leak)
    );
    assert!(off <= TOLERANCE + 1e-4);
    assert!(by_scaled > by_bare && by_bare < 0.5 * by_clusters);
}
