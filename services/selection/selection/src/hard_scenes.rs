//! Scenes that break naive clustering and selecting, from Gaussians to a walk, each with its measured error.

use glam::{DMat4, DVec3, Vec3};
use rand::RngExt;
use sg_scene::model::{BaseUnit, Scene};

use crate::selection_index::{SelectionIndex, WalkOptions};
use sg_clusters::cluster_graph::{ClusterGraph, GraphForm};
use sg_clusters::clustering::{Clustering, ClusteringOptions, Level, Method, cluster};
use sg_clusters::features::{FeatureKind, WIDTH, features};
use sg_clusters::geometry::{Geometry, GeometryOptions};
use sg_clusters::progress::Silent;
use sg_clusters::vertices::Vertices;
use sg_scene::synthetic::{generator, point_scene, random_points, random_unit, vessel_and_sac};

fn one(unit: &BaseUnit) -> Scene {
    Scene::compose(vec![unit.clone()], None)
}

fn geometry(scene: &Scene, neighbours: usize) -> Geometry {
    Geometry::of_scene(scene, GeometryOptions { neighbours, ..GeometryOptions::default() }, &Silent).unwrap()
}

fn clusters(geometry: &Geometry, most: usize) -> Clustering {
    let options = ClusteringOptions { max_clusters: most, ..ClusteringOptions::default() };
    cluster(geometry, &options, &Silent).unwrap().0
}

/// p of every Gaussian's cluster in the walk between two Gaussians; 0 for those without one. Checks p + q.
fn walked(scene: &Scene, geometry: &Geometry, clustering: &Clustering, from: u32, to: u32) -> Vec<f64> {
    let graph = ClusterGraph::new(geometry, clustering, GraphForm::Contact).unwrap();
    let space = SelectionIndex::of_clusters(scene, clustering, &graph, WalkOptions::default());
    let solution = space.walk([from].into_iter(), [to].into_iter()).unwrap().solution;
    for ((p, q), reached) in solution.p.iter().zip(&solution.q).zip(&solution.reached) {
        assert!((p + q - f64::from(u8::from(*reached))).abs() <= 1e-14, "p + q is {}", p + q);
    }
    let between = solution.p.iter().filter(|p| **p > 0.01 && **p < 0.99).count();
    assert!(between >= 3, "the walk must have something to decide");
    (0..scene.len() as u32).map(|g| space.cluster_of(g).map_or(0.0, |c| solution.p[c])).collect()
}

fn largest(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// The share of Gaussians that are in the same cluster by both. Each cluster of one is matched to the cluster of the other that
/// it shares most with, because the numbers of clusters mean nothing.
fn same(a: &Clustering, b: &Clustering) -> f64 {
    let mut shared = std::collections::BTreeMap::<(i32, i32), usize>::new();
    for pair in a.labels.iter().copied().zip(b.labels.iter().copied()) {
        *shared.entry(pair).or_default() += 1;
    }
    let mut pairs: Vec<((i32, i32), usize)> = shared.into_iter().collect();
    pairs.sort_by_key(|p| std::cmp::Reverse(p.1));
    let (mut left, mut right) = (std::collections::BTreeSet::new(), std::collections::BTreeSet::new());
    let mut kept = 0;
    for ((x, y), count) in pairs {
        if !left.contains(&x) && !right.contains(&y) {
            left.insert(x);
            right.insert(y);
            kept += count;
        }
    }
    kept as f64 / a.labels.len().max(1) as f64
}

#[test]
fn offsets_from_a_thousand_to_ten_million() {
    // A third of its size, so that no coordinate is a short binary number that survives any offset.
    let small = DMat4::from_scale(DVec3::splat(1.0 / 3.0));
    let mut unit = random_unit(3000, 8);
    unit.transform = small;
    let here = one(&unit);
    let near = geometry(&here, 10);
    let clean = clusters(&near, 200);
    let p = walked(&here, &near, &clean, 0, 1);
    for offset in [1e3, 1e4, 1e5, 1e6, 1e7] {
        unit.transform = DMat4::from_translation(DVec3::new(offset, -offset, 0.3 * offset)) * small;
        let there = one(&unit);
        let far = geometry(&there, 10);
        let kept = same(&clean, &clusters(&far, 200));
        let given = Clustering::of_labels(&far, clean.labels.clone(), None).unwrap();
        let off = largest(&p, &walked(&there, &far, &given, 0, 1));
        println!(
            "offset {offset:.0e}: {:.2} % are in another cluster; of the same clusters p differs by {off:.1e}",
            100.0 * (1.0 - kept)
        );
        assert!(kept > 0.9 && off < 1e-5);
    }
}

#[test]
fn scales_from_a_millionth_to_a_thousand_in_one_scene() {
    let (mut scene, _) = vessel_and_sac(4000, 3);
    let mut r = generator(9);
    for s in &mut scene.units[0].gaussians.log_scale {
        *s = Vec3::splat(r.random_range(1e-6_f32.ln()..1e3_f32.ln())) + Vec3::new(0.0, 0.0, -0.5);
    }
    let v = Vertices::of_unit(&scene.units[0]).0;
    for (kind, most) in [(FeatureKind::Oriented, 0.6), (FeatureKind::Invariant, 0.6), (FeatureKind::Printed, 1.0)] {
        let rows = features(&scene.units[0], &v, kind).rows;
        let (mut scale, mut all) = (0.0, 0.0);
        for _ in 0..20_000 {
            let (a, b) = (&rows[r.random_range(0..rows.len())], &rows[r.random_range(0..rows.len())]);
            for c in 0..WIDTH {
                let d = f64::from(a[c] - b[c]).powi(2);
                all += d;
                scale += if kind.blocks()[0].contains(&c) { d } else { 0.0 };
            }
        }
        println!("{kind:?}: scales have {:.1} % of the squared feature distance", 100.0 * scale / all);
        assert!(scale.is_finite() && scale / all <= most);
        // Clipped at four spreads, halved: at most 2.
        assert!(kind == FeatureKind::Printed || rows.iter().all(|row| row[0].abs() <= 2.0));
    }
    let g = geometry(&scene, 10);
    let c = clusters(&g, 150);
    assert!(c.labels.iter().all(|l| *l >= 0));
    assert!(walked(&scene, &g, &c, 0, 1).iter().all(|p| (0.0..=1.0).contains(p)));
}

#[test]
fn rotations_scales_and_opacities_that_are_no_numbers() {
    let (mut clean, _) = vessel_and_sac(4000, 5);
    let mut r = generator(10);
    for s in &mut clean.units[0].gaussians.log_scale {
        *s += Vec3::splat(r.random_range(-0.5..0.5));
    }
    let rows = |scene: &Scene| {
        let unit = &scene.units[0];
        features(unit, &Vertices::of_unit(unit).0, FeatureKind::for_unit(unit)).rows
    };
    // Any factor on a quaternion means the same rotation, down to denormal numbers and up to the largest.
    for (factor, most) in [(1e-3_f32, 1e-5), (1e-30, 1e-5), (1e30, 1e-5), (3e38, 1e-5), (1e-41, 1e-2)] {
        let mut scaled = clean.clone();
        scaled.units[0].gaussians.rotation.iter_mut().for_each(|q| *q = q.map(|x| x * factor));
        let off = rows(&clean)
            .iter()
            .flatten()
            .zip(rows(&scaled).iter().flatten())
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f32::max);
        println!("quaternions × {factor:.0e}: features differ by {off:.1e}");
        assert!(off <= most, "{off}");
    }
    // A hundred that are none: they get features, and hardly move those of the others.
    let mut broken = clean.clone();
    let g = &mut broken.units[0].gaussians;
    let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
    for i in 0..100 {
        let at = 40 * i;
        match i % 5 {
            0 => g.rotation[at] = [0.0; 4],
            1 => g.rotation[at] = [bad[i % 3], 0.0, 1.0, 0.0],
            2 => g.log_scale[at].y = bad[i % 3],
            3 => g.log_scale[at] = Vec3::splat(bad[i % 3]),
            _ => g.opacity_logit[at] = bad[i % 3],
        }
    }
    let (before, after) = (rows(&clean), rows(&broken));
    assert!(after.iter().flatten().all(|x| x.is_finite()));
    let vertices = Vertices::of_unit(&clean.units[0]).0;
    let others = (0..before.len()).filter(|&v| !vertices.gaussian[v].is_multiple_of(40));
    let off = others.flat_map(|v| before[v].iter().zip(&after[v])).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    let (here, there) = (geometry(&clean, 10), geometry(&broken, 10));
    let (a, b) = (clusters(&here, 150), clusters(&there, 150));
    let given = Clustering::of_labels(&there, a.labels.clone(), None).unwrap();
    let moved = largest(&walked(&clean, &here, &a, 1, 2), &walked(&broken, &there, &given, 1, 2));
    println!(
        "100 of 4000 without rotation, scale or opacity: features of the others differ by {off:.1e}, {:.1} % are in another cluster, p of the same clusters by {moved:.1e}",
        100.0 * (1.0 - same(&a, &b))
    );
    assert!(off < 0.05 && b.labels.iter().all(|l| *l >= 0) && moved < 0.2);
}

#[test]
fn positions_that_are_no_numbers_change_nothing_for_the_others() {
    let mut unit = random_unit(2000, 11);
    let clean = one(&unit);
    // Bad ones at the end, so that the others keep their indices. Then in front, so that the others do not.
    let broken = |front: bool, unit: &mut BaseUnit| {
        let bad = random_unit(9, 12);
        let mut all = if front { bad.clone() } else { unit.clone() };
        let more = if front { unit.clone() } else { bad };
        let (to, from) = (&mut all.gaussians, &more.gaussians);
        to.position.extend(&from.position);
        to.rotation.extend(&from.rotation);
        to.log_scale.extend(&from.log_scale);
        to.opacity_logit.extend(&from.opacity_logit);
        if let (Some(to), Some(from)) = (&mut to.shading, &from.shading) {
            to.normal.extend(&from.normal);
            to.offset_color.extend(&from.offset_color);
            to.ambient.extend(&from.ambient);
            to.diffuse.extend(&from.diffuse);
            to.specular.extend(&from.specular);
            to.shininess.extend(&from.shininess);
        }
        let first = if front { 0 } else { 2000 };
        for i in 0..9 {
            all.gaussians.position[first + i][i % 3] = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY][i / 3];
        }
        all
    };
    let g = geometry(&clean, 10);
    let c = clusters(&g, 100);
    let p = walked(&clean, &g, &c, 0, 1);
    for front in [false, true] {
        let scene = one(&broken(front, &mut unit));
        let there = geometry(&scene, 10);
        let shift = if front { 9 } else { 0 };
        let labels = clusters(&there, 100);
        let kept = (0..2000).filter(|&i| labels.labels[i + shift] == c.labels[i]).count();
        let q = walked(&scene, &there, &labels, shift as u32, 1 + shift as u32);
        let off = largest(&p, &q[shift..shift + 2000]);
        println!(
            "nine bad positions {}: {} dropped, {} of 2000 labels differ, p by {off:.0e}",
            if front { "in front" } else { "behind" },
            there.dropped,
            2000 - kept
        );
        assert_eq!((there.dropped, kept, off), (9, 2000, 0.0));
        assert!((0..9).all(|i| labels.labels[if front { i } else { 2000 + i }] == -1));
    }
}

#[test]
fn coincident_gaussians_stay_together() {
    // Twenty in one place with eight neighbours each, thirty times; and clouds of a thousand.
    let mut points = random_points(2000, 13);
    for i in 0..30 {
        points.extend(vec![points[i]; 19]);
    }
    points.extend(vec![[0.5; 3]; 1000]);
    let scene = point_scene(&points);
    let g = geometry(&scene, 8);
    let c = clusters(&g, 100);
    let split = (0..30).filter(|&i| (0..19).any(|k| c.labels[2000 + 19 * i + k] != c.labels[i])).count();
    let cloud = (2570..3570).filter(|&i| c.labels[i] != c.labels[3569]).count();
    let unlabelled = c.labels.iter().filter(|l| **l < 0).count();
    let p = walked(&scene, &g, &c, 31, 32);
    println!(
        "{} components before bridges; {split} of 30 places split, {cloud} of 1000 apart from their cloud, {unlabelled} without a cluster",
        g.units[0].components
    );
    assert_eq!((split, cloud, unlabelled), (0, 0, 0));
    // Every cluster is reached: p is 0 in the background's own cluster alone.
    assert!(p.iter().zip(&c.labels).all(|(p, l)| *p > 0.0 || *l == c.labels[32]));
}

#[test]
fn none_one_few_and_flat_sets_of_gaussians() {
    let mut scenes: Vec<(String, Vec<[f32; 3]>)> = vec![("0".into(), vec![])];
    for n in [1, 2, 3, 9, 10, 11] {
        scenes.push((format!("{n} Gaussians, 10 neighbours"), random_points(n, n as u64)));
    }
    scenes.push(("a line".into(), random_points(600, 20).iter().map(|p| [p[0], 0.0, 3.0]).collect()));
    scenes.push(("a plane".into(), random_points(600, 21).iter().map(|p| [p[0], p[1], 7.0]).collect()));
    scenes.push(("a point".into(), vec![[0.25; 3]; 600]));
    scenes.push((
        "an equal-feature lattice".into(),
        (0..1331).map(|i| [i % 11, i / 11 % 11, i / 121].map(|c| 0.1 * c as f32)).collect(),
    ));
    for (name, points) in scenes {
        let scene = point_scene(&points);
        let g = geometry(&scene, 10);
        let (mut unlabelled, mut worst) = (0, 0.0_f64);
        for method in [Method::Geodesic, Method::EuclideanFeature, Method::Euclidean] {
            for level in [Level::Exact, Level::Windowed, Level::Fast] {
                let options = ClusteringOptions { max_clusters: 40, method, level, ..ClusteringOptions::default() };
                let Ok((c, _)) = cluster(&g, &options, &Silent) else {
                    // The greedy pass goes along paths.
                    assert!(level != Level::Exact && method != Method::Geodesic, "{name} {method:?} {level:?}");
                    continue;
                };
                unlabelled += c.labels.iter().filter(|l| **l < 0).count();
                assert!(c.clusters.len() <= 40);
                for form in [GraphForm::Contact, GraphForm::Printed, GraphForm::AllPairs, GraphForm::Euclidean] {
                    let graph = ClusterGraph::new(&g, &c, form).unwrap();
                    let options = WalkOptions { form, ..WalkOptions::default() };
                    let space = SelectionIndex::of_clusters(&scene, &c, &graph, options);
                    let last = points.len().saturating_sub(1) as u32;
                    let ends = (!points.is_empty()).then_some(last);
                    let walk = space.walk((!points.is_empty()).then_some(0).into_iter(), ends.into_iter()).unwrap();
                    let s = &walk.solution;
                    for ((p, q), reached) in s.p.iter().zip(&s.q).zip(&s.reached) {
                        worst = worst.max((p + q - f64::from(u8::from(*reached))).abs());
                    }
                }
            }
        }
        println!("{name}: {unlabelled} without a cluster, |p + q − 1| at most {worst:.0e}");
        assert!(unlabelled == 0 && worst <= 1e-14);
    }
}

#[test]
fn columns_without_variance_weigh_nothing() {
    // The same three scales in other orders: only rounding differs. A z-score would blow that up to ±1.
    let mut unit = random_unit(2000, 14);
    for (i, s) in unit.gaussians.log_scale.iter_mut().enumerate() {
        let t = [0.1, 0.7, 0.3];
        *s = Vec3::new(t[i % 3], t[(i + 1) % 3], t[(i + 2) % 3]) - 4.0;
    }
    let v = Vertices::of_unit(&unit).0;
    let column = features(&unit, &v, FeatureKind::Invariant).rows.iter().map(|r| r[0].abs()).fold(0.0, f32::max);
    // All features equal: δ is 0 on every edge, its median too, and the weight is by length alone.
    let scene = point_scene(&random_points(1500, 15));
    let g = geometry(&scene, 10);
    let c = clusters(&g, 80);
    let graph = ClusterGraph::new(&g, &c, GraphForm::Contact).unwrap();
    let delta = graph.links().map(|l| l.distances.feature).fold(0.0, f64::max);
    println!("equal scales: column at most {column:.1e}; equal features: δ between clusters at most {delta:.1e}");
    assert!(column < 1e-4 && delta < 1e-5);
    let p = |sigma_f: f64| {
        let options = WalkOptions { sigma_f, ..WalkOptions::default() };
        let space = SelectionIndex::of_clusters(&scene, &c, &graph, options);
        space.walk([0].into_iter(), [1].into_iter()).unwrap().solution.p
    };
    let off = largest(&p(1.0), &p(1e-3));
    println!("σ_f × 1 against × 0.001: p differs by {off:.1e}");
    assert!(off < 1e-12);
}
