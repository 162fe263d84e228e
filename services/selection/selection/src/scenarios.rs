//! Whole selections on made shapes, from a scene to an overlap with the truth.

use std::sync::Arc;

use glam::{DQuat, DVec3, Quat, Vec3};
use rand::RngExt;
use sg_scene::model::Scene;

use crate::mask_agreement::Agreement;
use crate::selection_index::{Background, SelectionIndex, WalkOptions};
use crate::session::SelectionSession;
use crate::strokes::{Kind, Mode, Stroke};
use sg_clusters::cluster_graph::{ClusterGraph, GraphForm};
use sg_clusters::clustering::{Clustering, ClusteringOptions, cluster};
use sg_clusters::geometry::{Geometry, GeometryOptions};
use sg_clusters::progress::Silent;
use sg_scene::synthetic::{HALF_LENGTH, generator, normalized, vessel_and_sac};

struct Made {
    geometry: Geometry,
    clustering: Clustering,
}

fn made(scene: &Scene, options: &ClusteringOptions) -> Made {
    let geometry = Geometry::of_scene(scene, GeometryOptions::default(), &Silent).unwrap();
    let (clustering, _) = cluster(&geometry, options, &Silent).unwrap();
    Made { geometry, clustering }
}

fn space(scene: &Scene, made: &Made, options: WalkOptions) -> Arc<SelectionIndex> {
    let graph = ClusterGraph::new(&made.geometry, &made.clustering, options.form).unwrap();
    Arc::new(SelectionIndex::of_clusters(scene, &made.clustering, &graph, options))
}

fn walk(scene: &Scene, kind: Kind, points: &[Vec3]) -> Stroke {
    Stroke {
        mode: Mode::Walk,
        kind,
        radius: 0.03,
        points: normalized(scene, points),
        pressure: Vec::new(),
        depth: None,
    }
}

/// A green stroke over the sac, to and fro so many times, and a red one along the vessel. The red one spares the neck; both are
/// jittered.
fn strokes(scene: &Scene, sweeps: u32, seed: u64) -> [Stroke; 2] {
    let mut r = generator(seed);
    let mut jitter =
        || Vec3::new(r.random_range(-0.05..0.05), r.random_range(-0.05..0.05), r.random_range(-0.05..0.05));
    let (centre, radius) = (Vec3::new(0.0, 0.0, 0.36), 0.30);
    let mut sac = Vec::new();
    for sweep in 0..sweeps {
        let side = 0.9 * (sweep as f32 - 0.5 * (sweeps - 1) as f32);
        for i in 0..12 {
            let along = i as f32 / 11.0;
            let angle = 0.3 + 2.5 * if sweep % 2 == 0 { along } else { 1.0 - along };
            sac.push(centre + radius * Vec3::new(angle.cos(), side, angle.sin()).normalize() + 0.3 * jitter());
        }
    }
    let vessel = [-0.9, -0.3, 0.3, 0.9].map(|x| Vec3::new(x * HALF_LENGTH, 0.0, -0.12) + 0.5 * jitter());
    [walk(scene, Kind::Foreground, &sac), walk(scene, Kind::Background, &vessel)]
}

/// Overlaps with green alone and with both brushes, one of each a jittered pair of strokes.
fn play(scene: &Scene, space: &Arc<SelectionIndex>, truth: &[bool], sweeps: u32, runs: u64) -> (Vec<f64>, Vec<f64>) {
    (0..runs)
        .map(|seed| {
            let [foreground, vessel] = strokes(scene, sweeps, 100 + seed);
            let mut session = SelectionSession::new(Arc::clone(space));
            session.add_stroke(foreground).unwrap();
            let green = iou(&session, truth);
            session.add_stroke(vessel).unwrap();
            (green, iou(&session, truth))
        })
        .unzip()
}

fn iou(session: &SelectionSession, truth: &[bool]) -> f64 {
    Agreement::of(truth.iter().enumerate().map(|(g, t)| (session.mask().get(g), *t))).iou
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

#[test]
fn the_sac_of_a_vessel_is_selected_with_both_brushes_and_with_green_alone() {
    let (scene, truth) = vessel_and_sac(20_000, 1);
    let made = made(&scene, &ClusteringOptions::default());
    let best = {
        let mut own = vec![0_u32; made.clustering.clusters.len()];
        truth.iter().zip(&made.clustering.labels).filter(|(t, _)| **t).for_each(|(_, l)| own[*l as usize] += 1);
        let chosen: Vec<bool> = own.iter().zip(&made.clustering.clusters).map(|(o, c)| 2 * o > c.size).collect();
        Agreement::of(truth.iter().zip(&made.clustering.labels).map(|(t, l)| (chosen[*l as usize], *t))).iou
    };
    println!("best union of {} clusters: IoU {best:.3}", made.clustering.clusters.len());
    assert!(best > 0.95);
    for leak in [0.0, 0.003, 0.01, 0.03, 0.1] {
        let space = space(&scene, &made, WalkOptions { leak, ..WalkOptions::default() });
        for sweeps in [1, 3] {
            let (green, both) = play(&scene, &space, &truth, sweeps, 7);
            println!("leak {leak}, {sweeps} sweeps: green alone {:.3}, both {:.3}", median(green), median(both));
        }
    }
    for (form, background) in [
        (GraphForm::Contact, Background::Leak),
        (GraphForm::Printed, Background::Leak),
        (GraphForm::AllPairs, Background::Leak),
        (GraphForm::Euclidean, Background::Leak),
        (GraphForm::Contact, Background::Farthest),
    ] {
        let space = space(&scene, &made, WalkOptions { form, background, ..WalkOptions::default() });
        let (green, both) = play(&scene, &space, &truth, 3, if form == GraphForm::AllPairs { 3 } else { 20 });
        let least = both.iter().copied().fold(1.0, f64::min);
        let (green, both) = (median(green), median(both));
        println!("{form:?}, {background:?}: median IoU green alone {green:.3}, both {both:.3} (least {least:.3})");
        if (form, background) == (GraphForm::Contact, Background::Leak) {
            assert!(both >= 0.9, "{both}");
            assert!(green >= 0.9, "{green}");
        }
    }
}

#[test]
fn following_the_proposals_beats_strokes_at_random() {
    // An oracle answers with the side most of a cluster's Gaussians are on.
    let mut rows = Vec::new();
    for seed in [1, 2] {
        let (scene, truth) = vessel_and_sac(12_000, seed);
        let made = made(&scene, &ClusteringOptions { max_clusters: 600, ..ClusteringOptions::default() });
        let space = space(&scene, &made, WalkOptions::default());
        let answer = |point: [f64; 3]| {
            let stroke = |kind| Stroke {
                mode: Mode::Walk,
                kind,
                radius: 0.0,
                points: vec![point],
                pressure: Vec::new(),
                depth: None,
            };
            let cluster = space.cluster_of(space.hits(&stroke(Kind::Foreground))[0]).unwrap();
            let own = space.members(cluster);
            let is_sac = 2 * own.iter().filter(|g| truth[**g as usize]).count() > own.len();
            stroke(if is_sac { Kind::Foreground } else { Kind::Background })
        };
        for start in 0..4_u64 {
            let mut r = generator(50 + start);
            // The first stroke: a dab somewhere on the sac.
            let sac: Vec<usize> = (0..truth.len()).filter(|&g| truth[g]).collect();
            let first = normalized(&scene, &[scene.units[0].gaussians.position[sac[r.random_range(0..sac.len())]]])[0];
            let play = |next: &mut dyn FnMut(&SelectionSession) -> Option<[f64; 3]>| {
                let mut session = SelectionSession::new(Arc::clone(&space));
                session.add_stroke(answer(first)).unwrap();
                let mut reached = vec![iou(&session, &truth)];
                for _ in 0..8 {
                    if let Some(point) = next(&session) {
                        session.add_stroke(answer(point)).unwrap();
                    }
                    reached.push(iou(&session, &truth));
                }
                reached
            };
            let proposed = play(&mut |s| s.proposals(1).first().map(|p| p.point));
            let random = play(&mut |_| {
                let g = r.random_range(0..truth.len());
                Some(normalized(&scene, &[scene.units[0].gaussians.position[g]])[0])
            });
            rows.push((proposed, random));
        }
    }
    let mean = |runs: &[Vec<f64>], at: usize| runs.iter().map(|r| r[at]).sum::<f64>() / runs.len() as f64;
    let (proposed, random): (Vec<_>, Vec<_>) = rows.into_iter().unzip();
    for at in 0..=8 {
        let (proposed, random) = (mean(&proposed, at), mean(&random, at));
        println!("after {at} more strokes: mean IoU proposed {proposed:.3}, random {random:.3}");
    }
    assert!(mean(&proposed, 8) > mean(&random, 8) + 0.05);
    assert!(mean(&proposed, 4) > mean(&random, 4));
}

/// The scene turned and re-parametrised: same ellipsoids, other numbers.
fn turned(scene: &Scene, q: DQuat) -> Scene {
    let mut other = scene.clone();
    for unit in &mut other.units {
        let g = &mut unit.gaussians;
        for p in &mut g.position {
            *p = (q * p.as_dvec3()).as_vec3();
        }
        for (i, r) in g.rotation.iter_mut().enumerate() {
            let own = DQuat::from_xyzw(f64::from(r[1]), f64::from(r[2]), f64::from(r[3]), f64::from(r[0])).normalize();
            let mut new = q * own;
            if i % 2 == 0 {
                // Another order of the axes: a quarter turn about z swaps x and y.
                new *= DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2);
                let s = &mut g.log_scale[i];
                *s = Vec3::new(s.y, s.x, s.z);
            }
            let new = if i % 3 == 0 { -new } else { new };
            *r = [new.w, new.x, new.y, new.z].map(|x| x as f32);
        }
        if let Some(s) = &mut g.shading {
            for n in &mut s.normal {
                *n = (q * n.as_dvec3()).as_vec3();
            }
        }
    }
    Scene::compose(other.units, None)
}

#[test]
fn a_turned_and_reparametrised_copy_has_the_same_probabilities() {
    for oriented in [true, false] {
        let (mut scene, _) = vessel_and_sac(5000, 2);
        scene.units[0].oriented_normals = oriented;
        // Anisotropic in the plane, too, so that the order of the axes matters.
        for (i, s) in scene.units[0].gaussians.log_scale.iter_mut().enumerate() {
            s.x += 0.2 + 0.1 * (i % 7) as f32;
        }
        let options = ClusteringOptions { max_clusters: 200, ..ClusteringOptions::default() };
        let here = made(&scene, &options);
        let there_scene = turned(&scene, DQuat::from_axis_angle(DVec3::new(0.3, -0.8, 0.5).normalize(), 1.234));
        let geometry = Geometry::of_scene(&there_scene, GeometryOptions::default(), &Silent).unwrap();
        let clustering = Clustering::of_labels(&geometry, here.clustering.labels.clone(), None).unwrap();
        let there = Made { geometry, clustering };
        let (a, b) =
            (space(&scene, &here, WalkOptions::default()), space(&there_scene, &there, WalkOptions::default()));
        let mut r = generator(3);
        let picks = |r: &mut rand_chacha::ChaCha8Rng| (0..25).map(|_| r.random_range(0..5000_u32)).collect::<Vec<_>>();
        let (foreground, background) = (picks(&mut r), picks(&mut r));
        let run =
            |s: &SelectionIndex| s.walk(foreground.iter().copied(), background.iter().copied()).unwrap().solution.p;
        let off = run(&a).iter().zip(run(&b)).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
        println!("turned and re-parametrised, oriented {oriented}: p differs by {off:.1e}");
        assert!(off <= 1e-6, "{off}");
    }
}

#[test]
fn a_green_stroke_on_one_wall_of_a_thin_shell_stays_there() {
    // Two concentric spheres, a gap of a twentieth of the radius.
    let mut r = generator(4);
    let mut points = Vec::new();
    let mut outer = Vec::new();
    for i in 0..16_000 {
        let z = r.random_range(-1.0..1.0_f32);
        let ring = (1.0 - z * z).sqrt();
        let angle = r.random_range(0.0..std::f32::consts::TAU);
        let n = Vec3::new(ring * angle.cos(), ring * angle.sin(), z);
        let is_outer = i % 2 == 0;
        points.push(if is_outer { (n, n) } else { (0.95 * n, -n) });
        outer.push(is_outer);
    }
    let scene = Scene::compose(vec![sg_scene::synthetic::surface_unit(&points, 0.02)], None);
    let made = made(&scene, &ClusteringOptions::default());
    let space = space(&scene, &made, WalkOptions::default());
    let mut session = SelectionSession::new(space);
    let arc: Vec<Vec3> = (0..30).map(|i| Quat::from_rotation_z(0.1 * i as f32) * Vec3::new(1.03, 0.0, 0.0)).collect();
    session
        .add_stroke(Stroke {
            mode: Mode::Walk,
            kind: Kind::Foreground,
            radius: 0.02,
            points: normalized(&scene, &arc),
            pressure: Vec::new(),
            depth: None,
        })
        .unwrap();
    let agreement = Agreement::of((0..scene.len()).map(|g| (session.mask().get(g), outer[g])));
    println!("thin shell, green alone: precision {:.3}, recall {:.3}", agreement.precision, agreement.recall);
    assert!(agreement.precision > 0.95, "{agreement:?}");
}
