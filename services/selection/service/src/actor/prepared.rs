//! Preparation of a scene for the selection process: parameters, clusters and cluster graph.
//!
//! Super-Gaussians are those of the file, also where edits have moved Gaussians: their numbers stay. Duplicated Gaussians have
//! those of their originals, with numbers behind all others. Hits, distances and the neighbours of operations are those of the
//! present places. A walk follows the contacts of the file, except between Super-Gaussians that were moved apart.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use serde::Deserialize;
use sg_clusters::cache::{self, ClusterCache, Found};
use sg_clusters::cluster_graph::ClusterGraph;
use sg_clusters::clustering::{Clustering, ClusteringOptions, cluster};
use sg_clusters::duplicates::with_copies;
use sg_clusters::geometry::{Geometry, GeometryOptions};
use sg_clusters::progress::{Progress, Stage};
use sg_edit::{EditState, PlacedScene};
use sg_formats::load_verified::load_verified;
use sg_reclassify::sources;
use sg_runtime::process::StartError;
use sg_runtime::progress;
use sg_scene::mask::Mask;
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
    /// ε of a fixed leak to the background. It turns `every_scale` off, unless that is set too.
    pub(super) leak: Option<f64>,
    /// Whether creases weaken edges, and the first answer to a stroke chooses the leak until a step sets it. The default is
    /// yes.
    pub(super) every_scale: Option<bool>,
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
            leak: None,
            every_scale: None,
            sigma_s: walk.sigma_s,
            sigma_f: walk.sigma_f,
            cache: None,
        }
    }
}

impl Params {
    /// Parameters of walks.
    pub(super) fn walk_options(&self) -> WalkOptions {
        let every_scale = self.every_scale.unwrap_or(self.leak.is_none());
        let base = if every_scale { WalkOptions::every_scale() } else { WalkOptions::default() };
        WalkOptions { leak: self.leak.unwrap_or(base.leak), sigma_s: self.sigma_s, sigma_f: self.sigma_f, ..base }
    }
}

/// A scene prepared for selections.
pub(super) struct Prepared {
    pub(super) places: Places,
    pub(super) from_cache: bool,
    pub(super) clustering_ms: f64,
}

/// The index of a scene wherever edits put its Gaussians.
pub(super) struct Places {
    scene: PlacedScene,
    /// Of the file.
    of_file: Arc<Clustered>,
    /// Of the newest state with duplicates, and the state.
    with_duplicates: Option<(EditState, Arc<Clustered>)>,
    walk: WalkOptions,
    geometry: GeometryOptions,
    /// The index of the file, and the one of the newest other places with its scene.
    index_of_file: Arc<SelectionIndex>,
    newest: Option<(Arc<Scene>, Arc<SelectionIndex>)>,
    /// What the transfer function hides in the newest scene that this was asked of.
    hidden: Option<(Arc<Scene>, Arc<Mask>)>,
}

/// The clusters of a scene and their graph.
pub(super) struct Clustered {
    pub(super) clustering: Clustering,
    graph: ClusterGraph,
}

impl Places {
    fn new(
        scene: PlacedScene,
        (clustering, graph): (Clustering, ClusterGraph),
        walk: WalkOptions,
        geometry: GeometryOptions,
    ) -> Self {
        let of_file = Arc::new(Clustered { clustering, graph });
        let index_of_file = index_of(scene.file(), &of_file.clustering, &of_file.graph, walk, geometry);
        Self { scene, of_file, with_duplicates: None, walk, geometry, index_of_file, newest: None, hidden: None }
    }

    /// The Gaussians of a state that its transfer function hides. The same scene is read once.
    pub(super) fn hidden(&mut self, state: &EditState) -> Arc<Mask> {
        let scene = self.scene.of(state);
        if let Some((_, hidden)) = self.hidden.as_ref().filter(|(of, _)| Arc::ptr_eq(of, &scene)) {
            return Arc::clone(hidden);
        }
        let hidden = Arc::new(sources::hidden(&scene));
        self.hidden = Some((scene, Arc::clone(&hidden)));
        hidden
    }

    /// Cluster of each Gaussian of the newest state that an index was asked for; -1 without a cluster.
    pub(super) fn labels(&self) -> &[i32] {
        let clustered = self.with_duplicates.as_ref().map_or(&self.of_file, |(_, clustered)| clustered);
        &clustered.clustering.labels
    }

    /// The clusters of a state: those of the file and those of duplicates. `scene` is that of the state.
    fn clustered(&mut self, state: &EditState, scene: &Scene) -> Arc<Clustered> {
        if state.duplicates().is_empty() {
            self.with_duplicates = None;
            return Arc::clone(&self.of_file);
        }
        if let Some((_, known)) = self.with_duplicates.as_ref().filter(|(of, _)| of.has_gaussians_of(state)) {
            return Arc::clone(known);
        }
        let mut clustered = Arc::clone(&self.of_file);
        for duplicate in state.duplicates().iter() {
            let Clustered { clustering, graph } = &*clustered;
            let (clustering, graph) = with_copies(clustering, graph, scene, duplicate.originals());
            clustered = Arc::new(Clustered { clustering, graph });
        }
        self.with_duplicates = Some((state.clone(), Arc::clone(&clustered)));
        clustered
    }

    /// The scene of a state, its clusters, and their edges.
    pub(super) fn contacts(&mut self, state: &EditState) -> (Arc<Scene>, Arc<Clustered>, ClusterGraph) {
        let scene = self.scene.of(state);
        let (clustered, graph) = self.edges(state, &scene);
        (scene, clustered, graph)
    }

    /// The clusters of a state, and the edges between those that were not moved apart.
    fn edges(&mut self, state: &EditState, scene: &Scene) -> (Arc<Clustered>, ClusterGraph) {
        let clustered = self.clustered(state, scene);
        let part = parts_of_clusters(state, &clustered.clustering);
        let graph = clustered.graph.keeping(|u, v| part.get(u as usize) == part.get(v as usize));
        (clustered, graph)
    }

    /// The index of a scene in this state. Without a move since the last call it costs nothing.
    pub(super) fn index_of(&mut self, state: &EditState) -> Arc<SelectionIndex> {
        let scene = self.scene.of(state);
        if Arc::ptr_eq(&scene, self.scene.file()) {
            (self.newest, self.with_duplicates) = (None, None);
            return Arc::clone(&self.index_of_file);
        }
        if let Some((_, index)) = self.newest.as_ref().filter(|(of, _)| Arc::ptr_eq(of, &scene)) {
            return Arc::clone(index);
        }
        let (clustered, graph) = self.edges(state, &scene);
        let index = index_of(&scene, &clustered.clustering, &graph, self.walk, self.geometry);
        self.newest = Some((scene, Arc::clone(&index)));
        index
    }
}

/// The part of the placements that most Gaussians of each cluster belong to; 0 for those that are where the file has them.
fn parts_of_clusters(state: &EditState, clustering: &Clustering) -> Vec<usize> {
    let parts = state.placements();
    let mut counts = vec![vec![0_u32; parts.len() + 1]; clustering.clusters.len()];
    for (g, label) in clustering.labels.iter().enumerate() {
        let Some(counts) = usize::try_from(*label).ok().and_then(|c| counts.get_mut(c)) else { continue };
        let part = parts.iter().position(|part| part.members.get(g)).map_or(0, |k| k + 1);
        if let Some(count) = counts.get_mut(part) {
            *count += 1;
        }
    }
    let most = |counts: &Vec<u32>| counts.iter().enumerate().rev().max_by_key(|(_, n)| **n).map_or(0, |(k, _)| k);
    counts.iter().map(most).collect()
}

fn index_of(
    scene: &Arc<Scene>,
    clustering: &Clustering,
    graph: &ClusterGraph,
    walk: WalkOptions,
    geometry: GeometryOptions,
) -> Arc<SelectionIndex> {
    let index = SelectionIndex::of_clusters(scene, clustering, graph, walk);
    // The cache holds clusters only. The first operation that needs neighbours and features computes them.
    Arc::new(index.with_operation_context(OperationContext::new(Arc::clone(scene), geometry)))
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
    let places = Places::new(PlacedScene::new(scene), (clustering, graph), walk, geometry_options);
    Ok(Prepared { places, from_cache, clustering_ms })
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

#[cfg(test)]
impl Places {
    /// A scene with at most so many clusters in each base unit.
    pub(super) fn of_scene(scene: &Arc<Scene>, max_clusters: usize) -> Self {
        use sg_clusters::progress::Silent;

        let geometry = GeometryOptions::default();
        let found = Geometry::of_scene(scene, geometry, &Silent).unwrap();
        let options = ClusteringOptions { max_clusters, ..ClusteringOptions::default() };
        let (clustering, _) = cluster(&found, &options, &Silent).unwrap();
        let walk = WalkOptions::default();
        let graph = ClusterGraph::new(&found, &clustering, walk.form).unwrap();
        Self::new(PlacedScene::new(Arc::clone(scene)), (clustering, graph), walk, geometry)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    use sg_proto::scene::command::Action;
    use sg_proto::scene::{DuplicateGaussians, Target, TransformGaussians, Vector};
    use sg_scene::synthetic::test_scene;
    use sg_selection::session::SelectionSession;
    use sg_selection::strokes::{Kind, Mode, Stroke};

    fn places(scene: &Arc<Scene>) -> Places {
        Places::of_scene(scene, 40)
    }

    fn shifted(scene: &Arc<Scene>, state: &EditState, name: &str, x: f64) -> EditState {
        let target = Some(Target { units: vec![name.to_owned()], ..Target::default() });
        let shift = Some(Vector { x, y: 0.0, z: 0.0 });
        let action = TransformGaussians { target, shift, ..TransformGaussians::default() };
        state.after(scene, Action::TransformGaussians(action)).unwrap()
    }

    fn stroke(mode: Mode, at: [f64; 3]) -> Stroke {
        let (kind, points) = (Kind::Foreground, vec![at]);
        Stroke { mode, kind, radius: 1e-5, points, pressure: Vec::new(), depth: None }
    }

    #[test]
    fn strokes_hit_moved_gaussians_where_they_are_and_nothing_where_they_were() {
        let scene = Arc::new(test_scene(&[("still", 300), ("moved", 300)]));
        let opened = EditState::of_scene(&scene, "", "");
        let mut places = places(&scene);
        let first = places.index_of(&opened);
        assert!(Arc::ptr_eq(&first, &places.index_of(&opened)), "one index for one state");
        let far = 5.0 * scene.bounds.longest_edge();
        let moved = shifted(&scene, &opened, "moved", far);
        let index = places.index_of(&moved);
        assert!(Arc::ptr_eq(&index, &places.index_of(&moved)) && !Arc::ptr_eq(&index, &first));
        let at = |i: usize, by: f64| {
            let place = scene.position(i).unwrap() + by * glam::DVec3::X;
            scene.bounds.normalize(place).to_array()
        };
        let hits = |index: &Arc<SelectionIndex>, at| {
            let mut session = SelectionSession::new(Arc::clone(index));
            session.add_stroke(stroke(Mode::Point, at)).unwrap();
            session.mask().ones().collect::<Vec<_>>()
        };
        assert_eq!((hits(&first, at(400, 0.0)), hits(&index, at(400, far))), (vec![400], vec![400]));
        assert_eq!((hits(&index, at(400, 0.0)), hits(&index, at(20, 0.0))), (vec![], vec![20]));
        assert!(Arc::ptr_eq(&first, &places.index_of(&opened)), "undone: the file's own index again");
    }

    #[test]
    fn strokes_on_a_duplicate_select_the_structure_there_and_nothing_of_the_original() {
        let scene = Arc::new(test_scene(&[("other", 300), ("source", 300)]));
        let opened = EditState::of_scene(&scene, "", "");
        let mut places = places(&scene);
        let target = Some(Target { units: vec!["source".to_owned()], ..Target::default() });
        let duplicate = DuplicateGaussians { target, name: "copy".to_owned() };
        let copied = opened.after(&scene, Action::DuplicateGaussians(duplicate)).unwrap();
        let with_copy = PlacedScene::new(Arc::clone(&scene)).of(&copied);
        let far = 5.0 * scene.bounds.longest_edge();
        let moved = shifted(&with_copy, &copied, "copy", far);
        let index = places.index_of(&moved);
        assert_eq!((index.gaussians(), places.labels().len()), (900, 900));
        let selected = |at: [f64; 3], mode| {
            let mut session = SelectionSession::new(Arc::clone(&index));
            session.add_stroke(stroke(mode, at)).unwrap();
            session.mask().ones().collect::<Vec<_>>()
        };
        let at = |by: f64| scene.bounds.normalize(scene.position(400).unwrap() + by * glam::DVec3::X).to_array();
        for mode in [Mode::Point, Mode::Cluster, Mode::Walk] {
            let (original, copy) = (selected(at(0.0), mode), selected(at(far), mode));
            assert!(!original.is_empty() && original.iter().all(|i| (300..600).contains(i)), "{mode:?}: {original:?}");
            assert_eq!(copy, original.iter().map(|i| i + 300).collect::<Vec<_>>(), "{mode:?}");
        }
        assert_eq!(places.index_of(&opened).gaussians(), 600);
        assert_eq!(places.labels().len(), 600, "undone");
    }

    #[test]
    fn no_walk_crosses_to_what_was_moved_away() {
        let scene = Arc::new(test_scene(&[("all", 600)]));
        let mut opened = EditState::of_scene(&scene, "", "");
        let mut places = places(&scene);
        // Half of the Super-Gaussians of the only base unit.
        let half = Mask::from_fn(600, |i| places.labels()[i] % 2 == 0);
        let mask = Some(sg_edit::wire::encode_mask(&half));
        let select = sg_proto::scene::CommitSelection { mask, ..sg_proto::scene::CommitSelection::default() };
        opened = opened.after(&scene, Action::CommitSelection(select)).unwrap();
        let target = Some(Target { selection: true, ..Target::default() });
        let shift = Some(Vector { x: 9.0 * scene.bounds.longest_edge(), y: 0.0, z: 0.0 });
        let action = TransformGaussians { target, shift, ..TransformGaussians::default() };
        let moved = opened.after(&scene, Action::TransformGaussians(action)).unwrap();
        let index = places.index_of(&moved);
        let still = (0..600).find(|i| !half.get(*i)).unwrap();
        let at = scene.bounds.normalize(scene.position(still).unwrap()).to_array();
        let walk = |index: &Arc<SelectionIndex>| {
            let mut session = SelectionSession::new(Arc::clone(index));
            session.add_stroke(stroke(Mode::Walk, at)).unwrap();
            let p = session.walk().unwrap().solution.p.clone();
            (0..index.clusters()).map(|c| (index.members(c).first().copied(), p[c])).collect::<Vec<_>>()
        };
        let reaches = |index: &Arc<SelectionIndex>| {
            walk(index).iter().any(|(g, p)| g.is_some_and(|g| half.get(g as usize)) && *p > 0.0)
        };
        let of_file = places.index_of(&opened);
        assert!(reaches(&of_file) && !reaches(&index));
    }
}
