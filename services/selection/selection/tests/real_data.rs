//! Trained captures: clustered whole, connected, within the limit, and walked in.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a test fails by panicking and tells what it measured")]

use std::path::PathBuf;
use std::sync::Arc;

use sg_clusters::cluster_graph::{ClusterGraph, GraphForm};
use sg_clusters::clustering::{ClusteringOptions, cluster};
use sg_clusters::geometry::{Geometry, GeometryOptions};
use sg_clusters::neighbours::Graph;
use sg_clusters::progress::Silent;
use sg_formats::{LoadOptions, load};
use sg_selection::selection_index::{SelectionIndex, WalkOptions};
use sg_selection::session::SelectionSession;
use sg_selection::strokes::{Kind, Mode, Stroke};

/// The file, or none after saying so; a missing file is an error where the data is required.
fn data(name: &str) -> Option<PathBuf> {
    let path = std::env::var_os("SUPERGAUSSIAN_DATA").map(|folder| PathBuf::from(folder).join(name));
    match path.filter(|p| p.exists()) {
        Some(path) => Some(path),
        None => {
            assert_ne!(std::env::var("SUPERGAUSSIAN_REQUIRE_DATA").as_deref(), Ok("1"), "{name} is required");
            println!("SKIPPED: set SUPERGAUSSIAN_DATA to a folder with {name}");
            None
        }
    }
}

#[test]
fn a_trained_capture_is_clustered_and_walked_in() {
    for name in ["splats/donut_fused.ply", "splats/biker.compressed.ply"] {
        let Some(path) = data(name) else { continue };
        let scene = load(&path, &LoadOptions::default()).unwrap().scene;
        let geometry = Geometry::of_scene(&scene, GeometryOptions::default(), &Silent).unwrap();
        let (clustering, report) = cluster(&geometry, &ClusteringOptions::default(), &Silent).unwrap();
        println!(
            "{name}: {} Gaussians, {} components, {} clusters, size cv {:.2}, same label {:.2}, {:.2} s",
            report.gaussians,
            geometry.units[0].components,
            report.clusters,
            report.size_cv,
            report.same_label_knn,
            report.seconds["total"]
        );
        assert!(report.clusters <= 999 && report.clusters > 300);
        let unit = &geometry.units[0];
        let label = |v: u32| clustering.labels[unit.vertices.gaussian[v as usize] as usize];
        let inside = unit.joined().edges().filter(|e| label(e.a) == label(e.b));
        assert_eq!(Graph::from_edges(unit.vertices.len(), inside).components().1, report.clusters);

        let graph = ClusterGraph::new(&geometry, &clustering, GraphForm::Contact).unwrap();
        let space = SelectionIndex::of_clusters(&scene, &clustering, &graph, WalkOptions::default());
        let mut session = SelectionSession::new(Arc::new(space));
        let start = scene.bounds.normalize(scene.position(clustering.clusters[0].centre as usize).unwrap()).to_array();
        let stroke = Stroke {
            mode: Mode::Walk,
            kind: Kind::Foreground,
            radius: 0.02,
            points: vec![start],
            pressure: Vec::new(),
            depth: None,
        };
        assert!(session.add_stroke(stroke).unwrap() > 0);
        let walk = session.walk().unwrap();
        assert!(walk.summary.seeds_foreground > 0 && walk.summary.unreached == 0);
        let selected = session.mask().count();
        assert!(selected > 0 && selected < scene.len());
    }
}
