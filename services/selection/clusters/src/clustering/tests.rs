use super::*;
use crate::geometry::GeometryOptions;
use crate::neighbours::{Edge, Graph};
use crate::progress::Silent;
use crate::shortest::Search;
use glam::Vec3;
use proptest::prelude::*;
use rand::RngExt;
use sg_scene::model::Scene;
use sg_scene::synthetic::{generator, point_scene, random_points, random_unit, surface_unit, vessel_and_sac};
use std::cell::Cell;

fn geometry(scene: &Scene) -> Geometry {
    Geometry::of_scene(scene, GeometryOptions::default(), &Silent).unwrap()
}

fn run(scene: &Scene, options: &ClusteringOptions) -> (Geometry, Clustering, ClusteringReport) {
    let g = geometry(scene);
    let (c, r) = cluster(&g, options, &Silent).unwrap();
    (g, c, r)
}

/// Invariants of every clustering: ids are complete, no unit has too many, none crosses units, each is connected.
fn check_clusters(g: &Geometry, c: &Clustering, most: usize) {
    let mut seen = vec![0_u32; c.clusters.len()];
    for &l in &c.labels {
        if l >= 0 {
            seen[l as usize] += 1;
        }
    }
    assert_eq!(seen, c.clusters.iter().map(|c| c.size).collect::<Vec<_>>());
    assert!(seen.iter().all(|s| *s > 0));
    for (u, unit) in (0..).zip(&g.units) {
        let own = c.clusters.iter().filter(|c| c.unit == u).count();
        assert!(own <= most);
        let label = |v: u32| c.labels[unit.vertices.gaussian[v as usize] as usize];
        assert!((0..unit.vertices.len() as u32).all(|v| label(v) >= 0));
        let inside = unit.joined().edges().filter(|e| label(e.a) == label(e.b));
        assert_eq!(Graph::from_edges(unit.vertices.len(), inside).components().1, own, "connected");
    }
}

#[test]
fn a_vessel_is_clustered_by_every_method_and_level() {
    let (scene, _) = vessel_and_sac(12_000, 1);
    let mut exact = f64::NAN;
    for (method, level) in [
        (Method::Geodesic, Level::Exact),
        (Method::Geodesic, Level::Windowed),
        (Method::Geodesic, Level::Fast),
        (Method::EuclideanFeature, Level::Exact),
        (Method::EuclideanFeature, Level::Windowed),
        (Method::Euclidean, Level::Exact),
    ] {
        let options = ClusteringOptions { method, level, max_clusters: 300, ..ClusteringOptions::default() };
        let (g, c, r) = run(&scene, &options);
        check_clusters(&g, &c, 300);
        assert!(r.clusters > 150 && r.objective.len() <= 10, "{r:?}");
        println!(
            "{method:?} {level:?}: {} clusters, size cv {:.2}, compactness {:.4}, same label {:.3}, objective {:.0} in {} rounds, {:.2} s",
            r.clusters,
            r.size_cv,
            r.compactness,
            r.same_label_knn,
            r.objective[r.objective.len() - 1],
            r.objective.len(),
            r.seconds["total"]
        );
        let last = r.objective[r.objective.len() - 1];
        if (method, level) == (Method::Geodesic, Level::Exact) {
            exact = last;
            assert!(r.objective.windows(2).all(|w| w[1] < 1.01 * w[0]), "{:?}", r.objective);
        }
        if level == Level::Fast {
            assert!(last < 1.15 * exact, "two rounds {last} against {exact}");
        }
    }
}

#[test]
fn given_seeds_and_one_round_are_the_definition() {
    // --seeds --cell --rounds 1 --no-merge: the least D over all seeds, ids by position in the list.
    let scene = Scene::compose(vec![random_unit(1500, 2)], None);
    let g = geometry(&scene);
    let unit = &g.units[0];
    let mut r = generator(3);
    let seeds: Vec<u32> = (0..40).map(|_| r.random_range(0..1500)).collect();
    let cell = 0.4;
    let options = ClusteringOptions {
        seeds: Some(FixedSeeds { gaussians: seeds.clone(), cell }),
        rounds: Some(1),
        merge: false,
        ..ClusteringOptions::default()
    };
    let (c, report) = cluster(&g, &options, &Silent).unwrap();
    let vertex = |g: u32| unit.vertices.gaussian.iter().position(|&x| x == g).unwrap() as u32;
    let mut best = vec![(f64::INFINITY, 0); 1500];
    let mut search = Search::default();
    for (j, &s) in seeds.iter().enumerate() {
        for &(v, d) in search.reach(&unit.graph, vertex(s), |_| f64::INFINITY) {
            let f = crate::features::distance_squared(
                &unit.features.rows[v as usize],
                &unit.features.rows[vertex(s) as usize],
            );
            let cost = (d / cell).powi(2) + 0.25 * f;
            let at = unit.vertices.gaussian[v as usize] as usize;
            if cost < best[at].0 {
                best[at] = (cost, j as i32);
            }
        }
    }
    assert_eq!(c.labels, best.iter().map(|b| b.1).collect::<Vec<_>>());
    assert_eq!(report.objective.len(), 1);
    let sum: f64 = best.iter().map(|b| b.0).sum();
    assert!((report.objective[0] / sum - 1.0).abs() < 1e-12);
}

#[test]
fn the_same_labels_for_any_number_of_threads() {
    let (scene, _) = vessel_and_sac(5000, 4);
    for (level, adaptive) in [
        (Level::Exact, false),
        (Level::Exact, true),
        (Level::Windowed, false),
        (Level::Fast, false),
        (Level::Fast, true),
    ] {
        let options = ClusteringOptions { level, adaptive, ..ClusteringOptions::default() };
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let (_, c, r) = run(&scene, &options);
                (c, r.objective.iter().map(|x| x.to_bits()).collect::<Vec<_>>())
            })
        };
        assert_eq!(run(1), run(5));
    }
}

#[test]
fn adaptive_clusters_are_smaller_where_a_surface_bends() {
    // A sphere on a plane: of equal density, but only the sphere bends.
    let mut r = generator(8);
    let mut points = Vec::new();
    for i in 0..16_000 {
        if i % 2 == 0 {
            points.push((Vec3::new(r.random_range(-2.0..2.0), r.random_range(-2.0..2.0), -1.5), Vec3::Z));
        } else {
            let z = r.random_range(-1.0..1.0_f32);
            let (ring, angle) = ((1.0 - z * z).sqrt(), r.random_range(0.0..std::f32::consts::TAU));
            let n = Vec3::new(ring * angle.cos(), ring * angle.sin(), z);
            points.push((n * 1.128, n));
        }
    }
    let scene = Scene::compose(vec![surface_unit(&points, 0.02)], None);
    let on_sphere = |adaptive| {
        let options = ClusteringOptions { adaptive, max_clusters: 600, ..ClusteringOptions::default() };
        let (g, c, r) = run(&scene, &options);
        check_clusters(&g, &c, 600);
        let own = c.clusters.iter().filter(|c| c.position[2] > -1.4).count();
        println!("adaptive {adaptive}: {own} of {} clusters on the sphere", r.clusters);
        own as f64 / r.clusters as f64
    };
    assert!(on_sphere(true) > on_sphere(false) + 0.1);
}

#[test]
fn thin_sheets_keep_their_sides_where_normals_are_oriented() {
    // Two sheets half a point spacing apart with opposite normals.
    let side = 70;
    let spacing = 1.0 / side as f32;
    let mut r = generator(5);
    let mut points = Vec::new();
    let mut jitter = || r.random_range(-0.3..0.3_f32);
    for i in 0..side * side {
        let at =
            |j: &mut dyn FnMut() -> f32| Vec3::new((i % side) as f32 + j(), (i / side) as f32 + j(), 0.0) * spacing;
        points.push((at(&mut jitter), Vec3::NEG_Z));
        points.push((at(&mut jitter) + Vec3::Z * 0.5 * spacing, Vec3::Z));
    }
    let mut unit = surface_unit(&points, spacing);
    let mut accuracy = |oriented: bool| {
        unit.oriented_normals = oriented;
        let scene = Scene::compose(vec![unit.clone()], None);
        let (g, c, _) = run(&scene, &ClusteringOptions { max_clusters: 150, ..ClusteringOptions::default() });
        check_clusters(&g, &c, 150);
        // Achievable segmentation accuracy: each cluster goes to the side most of it is on.
        let mut tops = vec![0_u32; c.clusters.len()];
        for (i, &l) in c.labels.iter().enumerate() {
            tops[l as usize] += u32::from(i % 2 == 1);
        }
        let right: u32 = tops.iter().zip(&c.clusters).map(|(&t, c)| t.max(c.size - t)).sum();
        f64::from(right) / points.len() as f64
    };
    let (with, without) = (accuracy(true), accuracy(false));
    println!("achievable accuracy on two sheets: oriented {with:.3}, invariant {without:.3}");
    assert!(with > 0.85 && with > without + 0.1);
}

#[test]
fn fragments_of_every_size() {
    // One large part, a medium one that deserves clusters, and crumbs that join their nearest.
    let mut points = random_points(4000, 6);
    points.extend(random_points(400, 7).iter().map(|p| p.map(|x| 0.3 * x + 2.0)));
    let crumbs: Vec<[f32; 3]> = (0..15)
        .flat_map(|i| random_points(2, i).into_iter().map(move |p| p.map(|x| 0.001 * x + 4.0 + i as f32)))
        .collect();
    points.extend(crumbs);
    let scene = point_scene(&points);
    let g =
        Geometry::of_scene(&scene, GeometryOptions { neighbours: 1, ..GeometryOptions::default() }, &Silent).unwrap();
    assert!(g.units[0].components > 100, "with one neighbour each the scene is in pieces");
    let (c, _) = cluster(&g, &ClusteringOptions { max_clusters: 60, ..ClusteringOptions::default() }, &Silent).unwrap();
    check_clusters(&g, &c, 60);
    let (g, c, r) = run(&scene, &ClusteringOptions { max_clusters: 60, ..ClusteringOptions::default() });
    check_clusters(&g, &c, 60);
    assert!(r.clusters > 30, "{}", r.clusters);
    // More components than clusters.
    let (g, c, _) = run(&scene, &ClusteringOptions { max_clusters: 2, ..ClusteringOptions::default() });
    check_clusters(&g, &c, 2);
}

#[test]
fn far_from_the_origin_and_with_bad_positions() {
    let mut unit = random_unit(3000, 8);
    let clean = run(&Scene::compose(vec![unit.clone()], None), &ClusteringOptions::default()).1;
    // A transform to 1e7: the same clusters.
    unit.transform = glam::DMat4::from_translation(glam::DVec3::new(1e7, -1e7, 1e6));
    let moved = run(&Scene::compose(vec![unit.clone()], None), &ClusteringOptions::default()).1;
    let same = clean.labels.iter().zip(&moved.labels).filter(|(a, b)| a == b).count();
    println!("at 1e7 {same} of 3000 labels are the same");
    assert!(same > 2950);
    // NaN and infinite positions are dropped and counted; every other Gaussian keeps its own index.
    unit.transform = glam::DMat4::IDENTITY;
    for (i, bad) in [(0, f32::NAN), (1500, f32::INFINITY), (2999, f32::NEG_INFINITY)] {
        unit.gaussians.position[i].y = bad;
    }
    let (g, c, r) = run(&Scene::compose(vec![unit], None), &ClusteringOptions::default());
    check_clusters(&g, &c, 999);
    assert_eq!(r.dropped, 3);
    let dropped: Vec<usize> = (0..3000).filter(|&i| c.labels[i] < 0).collect();
    assert_eq!(dropped, [0, 1500, 2999]);
}

#[test]
fn coincident_points_and_a_lattice() {
    let lattice: Vec<[f32; 3]> = (0..3375).map(|i| [i % 15, i / 15 % 15, i / 225].map(|c| 0.1 * c as f32)).collect();
    let (g, c, _) =
        run(&point_scene(&lattice), &ClusteringOptions { max_clusters: 40, ..ClusteringOptions::default() });
    check_clusters(&g, &c, 40);
    let mut doubled = random_points(1000, 9);
    for i in 0..20 {
        doubled.extend(vec![doubled[i]; 30]);
    }
    let (g, c, _) =
        run(&point_scene(&doubled), &ClusteringOptions { max_clusters: 50, ..ClusteringOptions::default() });
    check_clusters(&g, &c, 50);
    let (g, c, _) = run(&point_scene(&vec![[0.5; 3]; 5000]), &ClusteringOptions::default());
    check_clusters(&g, &c, 999);
    assert_eq!(c.clusters.len(), 1);
}

#[test]
#[ignore = "a minute of work: run with --ignored"]
fn a_million_gaussians_in_one_voxel() {
    // A far outlier makes the voxel of the rest as large as the scene at first.
    let mut points = random_points(1_000_000, 10);
    points.iter_mut().for_each(|p| *p = p.map(|x| 1e-3 * x));
    points.push([1000.0; 3]);
    let (g, c, r) = run(&point_scene(&points), &ClusteringOptions::default());
    println!("{r:?}");
    check_clusters(&g, &c, 999);
    assert!(r.clusters > 500);
}

#[test]
fn options_and_seeds_that_make_no_sense_are_refused() {
    let scene = point_scene(&[[0.0; 3], [1.0; 3], [f32::NAN; 3]]);
    let g = geometry(&scene);
    let base = ClusteringOptions::default();
    let seeds = |gaussians: Vec<u32>, cell| Some(FixedSeeds { gaussians, cell });
    let bad = [
        (ClusteringOptions { max_clusters: 0, ..base.clone() }, "number of clusters is 0"),
        (ClusteringOptions { compactness: -1.0, ..base.clone() }, "compactness is -1"),
        (ClusteringOptions { compactness: f64::NAN, ..base.clone() }, "compactness is NaN"),
        (ClusteringOptions { rounds: Some(0), ..base.clone() }, "rounds is 0"),
        (ClusteringOptions { seeds: seeds(vec![0], 0.0), ..base.clone() }, "cell is 0"),
        (ClusteringOptions { seeds: seeds(vec![2], 1.0), ..base.clone() }, "seed 0 names Gaussian 2"),
        (ClusteringOptions { seeds: seeds(vec![0, 7], 1.0), ..base.clone() }, "seed 1 names Gaussian 7"),
        (ClusteringOptions { seeds: seeds(vec![], 1.0), ..base.clone() }, "no seed"),
        (ClusteringOptions { level: Level::Fast, method: Method::Euclidean, ..base.clone() }, "fast"),
    ];
    for (options, part) in bad {
        let message = cluster(&g, &options, &Silent).unwrap_err().to_string();
        assert!(message.contains(part), "{message}");
    }
}

#[test]
fn labels_that_do_not_fit_are_refused() {
    let mut b = random_unit(5, 2);
    b.name = "b".into();
    let scene = Scene::compose(vec![random_unit(5, 1), b], None);
    let g = geometry(&scene);
    for (labels, part) in [
        (vec![0; 9], "9 labels for 10"),
        (vec![0; 10], "base units 0 and 1"),
        (vec![0, 0, 0, 0, -2, 1, 1, 1, 1, 1], "Gaussian 4 is -2"),
        (vec![0, 0, 0, 0, 10, 1, 1, 1, 1, 1], "Gaussian 4 is 10"),
    ] {
        let message = Clustering::of_labels(&g, labels, None).unwrap_err().to_string();
        assert!(message.contains(part), "{message}");
    }
    let skipping = Clustering::of_labels(&g, vec![0, 0, 0, -1, 0, 3, 3, 3, 3, 3], None).unwrap();
    assert_eq!(skipping.clusters.iter().map(|c| c.size).collect::<Vec<_>>(), [4, 0, 0, 5]);
}

struct StopAfter(Cell<u32>);

impl Progress for StopAfter {
    fn at(&self, _: Stage, fraction: f64) {
        assert!((0.0..=1.0).contains(&fraction), "{fraction}");
        self.0.set(self.0.get().saturating_sub(1));
    }

    fn cancelled(&self) -> bool {
        self.0.get() == 0
    }
}

#[test]
fn clustering_stops_when_asked() {
    let scene = Scene::compose(vec![random_unit(2000, 3)], None);
    let g = geometry(&scene);
    let stopped = cluster(&g, &ClusteringOptions::default(), &StopAfter(Cell::new(3)));
    assert_eq!(stopped.unwrap_err(), ClusterError::Geometry(GeometryError::Cancelled));
    assert!(cluster(&g, &ClusteringOptions::default(), &StopAfter(Cell::new(100))).is_ok());
    let early = Geometry::of_scene(&scene, GeometryOptions::default(), &StopAfter(Cell::new(1)));
    assert_eq!(early.unwrap_err(), GeometryError::Cancelled);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]
    #[test]
    fn any_points_give_connected_clusters_within_the_limit(
        points in proptest::collection::vec([-4..4_i8, -4..4_i8, -2..2_i8], 0..150),
        scale in prop_oneof![Just(1.0_f32), Just(1e-20), Just(1e15)],
        most in 1..30_usize, k in 1..12_usize,
        level in prop_oneof![Just(Level::Exact), Just(Level::Windowed), Just(Level::Fast)],
        adaptive in any::<bool>(),
    ) {
        let points: Vec<[f32; 3]> = points.iter().map(|p| p.map(|x| f32::from(x) * scale)).collect();
        let scene = point_scene(&points);
        let options = GeometryOptions { neighbours: k, ..GeometryOptions::default() };
        let g = Geometry::of_scene(&scene, options, &Silent).unwrap();
        let (c, _) = cluster(&g, &ClusteringOptions { max_clusters: most, level, adaptive, ..ClusteringOptions::default() }, &Silent).unwrap();
        check_clusters(&g, &c, most);
        // Given back as labels they are the same clusters.
        prop_assert_eq!(&Clustering::of_labels(&g, c.labels.clone(), None).unwrap(), &c);
    }

    #[test]
    fn rounds_of_a_second_unit_add_up(a in proptest::collection::vec(0.0..9.0_f64, 1..6), b in proptest::collection::vec(0.0..9.0_f64, 1..6)) {
        let mut total = Vec::new();
        add_rounds(&mut total, &a);
        add_rounds(&mut total, &b);
        let at = |v: &[f64], i: usize| v[i.min(v.len() - 1)];
        let want: Vec<f64> = (0..a.len().max(b.len())).map(|i| at(&a, i) + at(&b, i)).collect();
        prop_assert_eq!(total, want);
    }
}

#[test]
fn an_edge_list_keeps_the_shorter_of_two() {
    let graph = Graph::from_edges(2, [Edge { a: 0, b: 1, length: 2.0 }, Edge { a: 1, b: 0, length: 1.0 }].into_iter());
    assert_eq!(graph.edges().map(|e| e.length).collect::<Vec<_>>(), [1.0]);
}
