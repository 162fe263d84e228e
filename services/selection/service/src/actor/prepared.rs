//! Preparation of a scene for the selection process: parameters, clusters and cluster graph.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use serde::Deserialize;
use sg_clusters::cache::{self, ClusterCache, Found};
use sg_clusters::cluster_graph::ClusterGraph;
use sg_clusters::clustering::{Clustering, ClusteringOptions, cluster};
use sg_clusters::geometry::{Geometry, GeometryOptions};
use sg_clusters::progress::{Progress, Stage};
use sg_formats::load_verified::load_verified;
use sg_runtime::process::StartError;
use sg_runtime::progress;
use sg_scene::model::Scene;
use sg_selection::operation_context::OperationContext;
use sg_selection::selection_index::{SelectionIndex, WalkOptions};

/// Parameters in the launch file.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Params {
    /// Most Super-Gaussians in each base unit.
    pub(super) max_clusters: usize,
    /// Nearest neighbours of each Gaussian.
    pub(super) neighbours: usize,
    /// Weight of features against distance.
    pub(super) compactness: f64,
    /// ε of the leak to the background.
    pub(super) leak: f64,
    /// Whether creases weaken edges, and the first answer to a stroke chooses the leak until a step sets it. Clients that show
    /// the leak of `State.tuning` then show another one than that of the first answer.
    pub(super) every_scale: bool,
    /// Factor on σ_s.
    pub(super) sigma_s: f64,
    /// Factor on σ_f.
    pub(super) sigma_f: f64,
    /// Folder of the cluster cache. The default is a folder of the session.
    pub(super) cache: Option<PathBuf>,
}

impl Default for Params {
    fn default() -> Self {
        let (geometry, clustering, walk) =
            (GeometryOptions::default(), ClusteringOptions::default(), WalkOptions::default());
        Self {
            max_clusters: clustering.max_clusters,
            neighbours: geometry.neighbours,
            compactness: clustering.compactness,
            leak: walk.leak,
            every_scale: walk.every_scale,
            sigma_s: walk.sigma_s,
            sigma_f: walk.sigma_f,
            cache: None,
        }
    }
}

/// A scene prepared for selections.
pub(super) struct Prepared {
    pub(super) index: Arc<SelectionIndex>,
    /// Cluster of each Gaussian; -1 without a cluster.
    pub(super) labels: Vec<i32>,
    pub(super) from_cache: bool,
    pub(super) clustering_ms: f64,
}

/// Reads the scene and clusters it, or loads the clusters from the cache.
pub(super) fn prepare(
    path: &Path,
    hash: &str,
    params: &Params,
    walk: WalkOptions,
    cache: &ClusterCache,
) -> Result<Prepared, StartError> {
    let scene = Arc::new(load_verified(path, hash).map_err(|e| StartError::Input(e.to_string()))?);
    let start = Instant::now();
    let geometry_options = GeometryOptions { neighbours: params.neighbours, ..GeometryOptions::default() };
    let options = ClusteringOptions {
        max_clusters: params.max_clusters,
        compactness: params.compactness,
        ..ClusteringOptions::default()
    };
    let key = cache::key(&scene, geometry_options, &options);
    let (clustering, graph, from_cache) = match cache.load(&key, scene.len()) {
        Found::Entry(entry) => (entry.0, entry.1, true),
        found => {
            if let Found::Damaged(why) = found {
                tracing::warn!("cached clusters are computed again: {why}");
            }
            let (clustering, graph) = compute(&scene, geometry_options, &options)?;
            if let Err(error) = cache.store(&key, &clustering, &graph) {
                tracing::warn!(%error, "the clusters could not be cached; a restart will compute them again");
            }
            (clustering, graph, false)
        }
    };
    let clustering_ms = start.elapsed().as_secs_f64() * 1e3;
    let index = SelectionIndex::of_clusters(&scene, &clustering, &graph, walk);
    // The cache holds clusters only. The first operation that needs neighbours and features computes them.
    let index = Arc::new(index.with_operation_context(OperationContext::new(Arc::clone(&scene), geometry_options)));
    Ok(Prepared { index, labels: clustering.labels, from_cache, clustering_ms })
}

/// Reports the stages of clustering as progress of the process: a large scene takes minutes.
struct Steps(progress::Progress);

impl Progress for Steps {
    fn at(&self, _: Stage, _: f64) {
        self.0.step();
    }
}

fn compute(
    scene: &Scene,
    geometry: GeometryOptions,
    options: &ClusteringOptions,
) -> Result<(Clustering, ClusterGraph), StartError> {
    let input = |e: &dyn fmt::Display| StartError::Input(e.to_string());
    let steps = Steps(progress::current());
    let geometry = Geometry::of_scene(scene, geometry, &steps).map_err(|e| input(&e))?;
    let (clustering, _) = cluster(&geometry, options, &steps).map_err(|e| input(&e))?;
    let graph = ClusterGraph::new(&geometry, &clustering, WalkOptions::default().form).map_err(|e| input(&e))?;
    Ok((clustering, graph))
}
