//! Times the parts of a selection on a scene file: neighbour graph, rounds of clustering, walk, other leaks and thresholds,
//! proposals, brush.
//!
//! `cargo run --release --workspace --example selection_times -- bonsai/scene.toml`
#![allow(clippy::print_stdout, reason = "a bench prints its table")]

use std::error::Error;
use std::hint::black_box;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use sg_clusters::assignment::{Centre, GeodesicAssigner, Metric};
use sg_clusters::cluster_graph::{ClusterGraph, GraphForm};
use sg_clusters::clustering::{ClusteringOptions, cluster};
use sg_clusters::geometry::{Geometry, GeometryOptions};
use sg_clusters::progress::Silent;
use sg_clusters::seeds::voxel_seeds;
use sg_formats::{LoadOptions, load};
use sg_selection::brush::{Brush, OpenStroke};
use sg_selection::selection_index::{SelectionIndex, WalkOptions};
use sg_selection::session::SelectionSession;
use sg_selection::strokes::{Kind, Mode, Stroke};
use sg_selection::tuning::Tuning;

/// Seconds of one call, and its result.
fn timed<T>(f: impl FnOnce() -> T) -> (f64, T) {
    let start = Instant::now();
    let out = black_box(f());
    (start.elapsed().as_secs_f64(), out)
}

fn main() -> Result<(), Box<dyn Error>> {
    let file = std::env::args().nth(1).ok_or("give a scene file")?;
    let scene = load(Path::new(&file), &LoadOptions::default())?.scene;
    println!("{file}: {} Gaussians in {} base units", scene.len(), scene.units.len());
    let (seconds, geometry) = timed(|| Geometry::of_scene(&scene, GeometryOptions::default(), &Silent));
    let geometry = geometry?;
    println!("geometry {seconds:.3} s (features {:.3}, graph {:.3})", geometry.feature_seconds, geometry.graph_seconds);

    for (u, unit) in geometry.units.iter().enumerate() {
        let n = unit.vertices.len();
        let degree = unit.graph.lengths().nnz() as f64 / n.max(1) as f64;
        println!("unit {u}: {n} Gaussians, {degree:.1} neighbours each, {} components", unit.components);
        let seeds = voxel_seeds(&unit.vertices, &unit.component, unit.components, 999);
        for m in [0.25, 0.5, 1.0, 2.0] {
            let metric = Metric { cell: seeds.cell, feature_weight: m * m };
            let centres: Vec<Centre> = seeds
                .sources
                .iter()
                .map(|&s| Centre {
                    source: s,
                    position: unit.vertices.position[s as usize],
                    feature: unit.features.rows[s as usize],
                })
                .collect();
            let mut assigner = GeodesicAssigner::new(&unit.graph, &unit.features.rows, metric, f64::INFINITY);
            let (seconds, first) = timed(|| assigner.assign(&centres));
            println!(
                "  m = {m}: first assignment {seconds:.3} s, {:.2} vertices settled each, Σ D {:.0}",
                assigner.settled() as f64 / n.max(1) as f64,
                first.objective()
            );
        }
    }
    let (seconds, made) = timed(|| cluster(&geometry, &ClusteringOptions::default(), &Silent));
    let (clustering, report) = made?;
    println!("clustering {seconds:.3} s: {} clusters, {:?}", report.clusters, report.seconds);

    let (seconds, graph) = timed(|| ClusterGraph::new(&geometry, &clustering, GraphForm::Contact));
    let graph = graph?;
    println!("contact graph {seconds:.4} s, {} edges", graph.links().count());
    let (seconds, space) = timed(|| SelectionIndex::of_clusters(&scene, &clustering, &graph, WalkOptions::default()));
    println!("space (brush, order) {seconds:.4} s");
    let space = Arc::new(space);
    let Some(first) = clustering.clusters.first() else { return Ok(()) };
    let middle = scene.bounds.normalize(glam::DVec3::from_array(first.position)).to_array();
    let stroke = |kind, shift: f64| Stroke {
        mode: Mode::Walk,
        kind,
        radius: 0.03,
        points: vec![middle, middle.map(|x| x + shift)],
        pressure: Vec::new(),
        depth: None,
    };
    let mut walks = Vec::new();
    for i in 0..50 {
        let mut session = SelectionSession::new(Arc::clone(&space));
        let shift = 0.1 + 0.001 * f64::from(i);
        let (seconds, hits) = timed(|| session.add_stroke(stroke(Kind::Foreground, shift)));
        hits?;
        walks.push(1e3 * seconds);
    }
    walks.sort_by(f64::total_cmp);
    println!("stroke and walk: median {:.2} ms, slowest {:.2} ms", walks[25], walks[49]);
    let mut session = SelectionSession::new(Arc::clone(&space));
    session.add_stroke(stroke(Kind::Foreground, 0.1))?;
    let first = session.tuning();
    for (what, leaks) in [("leak", true), ("threshold", false)] {
        let mut tries = Vec::new();
        for i in 0..50 {
            let by = f64::from(i) / 50.0;
            let tuning = match leaks {
                true => Tuning { leak: 1e-4 * 1e4_f64.powf(by), ..first },
                false => Tuning { threshold: 1.9 * by - 0.95, ..first },
            };
            let (seconds, done) = timed(|| session.tune(tuning));
            done?;
            tries.push(1e3 * seconds);
        }
        tries.sort_by(f64::total_cmp);
        println!("another {what}: median {:.2} ms, slowest {:.2} ms", tries[25], tries[49]);
    }
    session.tune(first)?;
    let (seconds, places) = timed(|| session.proposals(5).len());
    println!("{places} proposals: {:.2} ms", 1e3 * seconds);

    let brush = Brush::of_scene(&scene);
    let radius = 0.03 * scene.bounds.longest_edge();
    let mut open = OpenStroke::new(scene.len(), radius);
    let mut samples = Vec::new();
    for i in 0..300 {
        let at = scene.bounds.denormalize(glam::DVec3::from_array(middle) + glam::DVec3::splat(0.001 * f64::from(i)));
        samples.push(1e3 * timed(|| open.extend(&brush, at).len()).0);
    }
    samples.sort_by(f64::total_cmp);
    println!(
        "one sample of a stroke: median {:.3} ms, 99 % {:.3} ms, {} hits",
        samples[150],
        samples[297],
        open.hits().len()
    );
    Ok(())
}
