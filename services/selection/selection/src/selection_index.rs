//! A scene prepared for selections. Any number of sessions share one index.

use std::sync::Arc;

use glam::DVec3;
use sg_clusters::cluster_graph::ClusterGraph;
use sg_clusters::clustering::Clustering;
use sg_clusters::geometry::Geometry;
use sg_scene::mask::Mask;
use sg_scene::model::{Scene, SceneBox};
use sg_walk::WalkError;
use sg_walk::elimination::{Elimination, EliminationFamily};
use sg_walk::uncertainty::ProposalQuery;

use crate::answers::Answers;
use crate::brush::Brush;
use crate::cluster_members::ClusterMembers;
use crate::operation_context::OperationContext;
use crate::strokes::{Mode, Stroke};

mod farthest;
mod first_stroke;
mod walk_index;
mod walk_options;

pub(crate) use first_stroke::FirstStroke;
use walk_index::WalkIndex;
pub use walk_index::{TOLERANCE, Walk, WalkSummary};
pub use walk_options::{Background, WalkOptions, WalkOptionsError};

/// A scene prepared for selections: brush, clusters, walk graph and operations.
pub struct SelectionIndex {
    bounds: SceneBox,
    brush: Arc<Brush>,
    /// Gaussians that no stroke hits, no operation finds and no walk crosses.
    left_out: Arc<Mask>,
    /// Cluster of each Gaussian; `None` for those that are left out.
    labels: Arc<[Option<u32>]>,
    clusters: ClusterMembers,
    walks: WalkIndex,
    operation_context: Option<Arc<OperationContext>>,
}

impl std::fmt::Debug for SelectionIndex {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SelectionIndex")
            .field("gaussians", &self.gaussians())
            .field("nodes", &self.nodes())
            .field("options", self.options())
            .finish_non_exhaustive()
    }
}

/// The labels of a clustering, with `None` in place of −1.
fn optional(labels: &[i32]) -> Arc<[Option<u32>]> {
    labels.iter().map(|l| u32::try_from(*l).ok()).collect()
}

impl SelectionIndex {
    /// An index with walks on clusters.
    #[must_use]
    pub fn of_clusters(scene: &Scene, clustering: &Clustering, graph: &ClusterGraph, options: WalkOptions) -> Self {
        let labels = optional(&clustering.labels);
        Self {
            bounds: scene.bounds,
            brush: Arc::new(Brush::of_scene(scene)),
            left_out: Arc::new(Mask::empty(scene.len())),
            clusters: ClusterMembers::new(labels.iter().copied(), clustering.clusters.len()),
            walks: WalkIndex::of_clusters(scene, clustering, graph, Arc::clone(&labels), options),
            labels,
            operation_context: None,
        }
    }

    /// An index with walks on single Gaussians. Cluster strokes still use the clusters.
    ///
    /// Up to 2,000 Gaussians are eliminated exactly. Above, the iteration of [`sg_walk::multilevel`] solves to
    /// [`TOLERANCE`].
    ///
    /// `options.leak` is the leak ε of each *Gaussian*, unscaled. For the reach of a walk on clusters use ε·(h/H)² from
    /// [`crate::refinement::Refiner::leak`].
    #[must_use]
    pub fn of_gaussians(scene: &Scene, geometry: &Geometry, clustering: &Clustering, options: WalkOptions) -> Self {
        let labels = optional(&clustering.labels);
        Self {
            bounds: scene.bounds,
            brush: Arc::new(Brush::of_geometry(geometry)),
            left_out: Arc::new(Mask::empty(scene.len())),
            clusters: ClusterMembers::new(labels.iter().copied(), clustering.clusters.len()),
            walks: WalkIndex::of_gaussians(scene, geometry, options),
            labels,
            operation_context: None,
        }
    }

    /// The same index with the context that operations need.
    #[must_use]
    pub fn with_operation_context(self, operation_context: OperationContext) -> Self {
        Self { operation_context: Some(Arc::new(operation_context)), ..self }
    }

    /// The index of the same scene without some Gaussians, such as deleted ones. They have no cluster, no stroke hits them, and no operation finds
    /// them. A walk does not cross a cluster that is wholly left out. Clusters and indices stay.
    ///
    /// This index must be that of the whole scene: what an earlier call took is not known any more.
    #[must_use]
    pub fn without(&self, left_out: &Arc<Mask>) -> Self {
        let labels: Arc<[Option<u32>]> =
            self.labels.iter().enumerate().map(|(g, label)| label.filter(|_| !left_out.get(g))).collect();
        Self {
            bounds: self.bounds,
            brush: Arc::clone(&self.brush),
            left_out: Arc::clone(left_out),
            clusters: ClusterMembers::new(labels.iter().copied(), self.clusters.count()),
            walks: self.walks.without(left_out),
            labels,
            operation_context: self.operation_context.clone(),
        }
    }

    /// Gaussians that this index leaves out.
    #[must_use]
    pub fn left_out(&self) -> &Arc<Mask> {
        &self.left_out
    }

    /// Whether a Gaussian is not left out.
    pub(crate) fn has(&self, gaussian: u32) -> bool {
        !self.left_out.get(gaussian as usize)
    }

    /// The context of operations, if there is one.
    #[must_use]
    pub fn operation_context(&self) -> Option<&OperationContext> {
        self.operation_context.as_deref()
    }

    /// Number of Gaussians.
    #[must_use]
    pub fn gaussians(&self) -> usize {
        self.labels.len()
    }

    /// Number of clusters.
    #[must_use]
    pub fn clusters(&self) -> usize {
        self.clusters.count()
    }

    /// Number of nodes of the walk graph.
    #[must_use]
    pub fn nodes(&self) -> usize {
        self.walks.len()
    }

    /// The brush.
    #[must_use]
    pub fn brush(&self) -> &Brush {
        &self.brush
    }

    /// The box that normalizes strokes.
    #[must_use]
    pub fn bounds(&self) -> &SceneBox {
        &self.bounds
    }

    /// Cluster of a Gaussian, if it belongs to one.
    #[must_use]
    pub fn cluster_of(&self, gaussian: u32) -> Option<usize> {
        self.labels.get(gaussian as usize)?.map(|label| label as usize)
    }

    /// Members of a cluster, ascending.
    #[must_use]
    pub fn members(&self, cluster: usize) -> &[u32] {
        self.clusters.get(cluster)
    }

    /// Node of a Gaussian, if it has a finite position.
    #[must_use]
    pub fn node_of(&self, gaussian: u32) -> Option<usize> {
        self.walks.node_of(gaussian)
    }

    /// Base unit of a node.
    #[must_use]
    pub fn unit_of_node(&self, node: usize) -> usize {
        self.walks.unit_of_node(node)
    }

    /// Gaussians under a stroke, ascending. A walk stroke that hits no Gaussian returns the nearest one, unless that is left out.
    #[must_use]
    pub fn hits(&self, stroke: &Stroke) -> Vec<u32> {
        let (samples, radius) = stroke.in_scene(&self.bounds);
        let limit = stroke.depth_limit(&self.bounds);
        let mut hits = self.brush.hits_with_depth_limit(&samples, radius, &stroke.pressure, limit);
        hits.retain(|g| self.has(*g));
        if hits.is_empty() { self.hits_of_miss(stroke, &samples) } else { hits }
    }

    /// The hits of a stroke without a Gaussian in its tube: the nearest Gaussian for walks, none otherwise.
    pub(crate) fn hits_of_miss(&self, stroke: &Stroke, samples: &[DVec3]) -> Vec<u32> {
        match stroke.mode {
            Mode::Walk => self.brush.nearest(samples).filter(|g| self.has(*g)).into_iter().collect(),
            _ => Vec::new(),
        }
    }

    /// The initial elimination of walks on clusters. `None` for other solvers than elimination in f64.
    #[must_use]
    pub fn elimination(&self) -> Option<&Elimination> {
        self.walks.elimination()
    }

    /// Parameters of walks.
    #[must_use]
    pub fn options(&self) -> &WalkOptions {
        self.walks.options()
    }

    /// Normalized position of a cluster's central Gaussian. A walk stroke of radius 0 there seeds the cluster.
    ///
    /// `None` for a cluster without Gaussians, and for walks on single Gaussians.
    #[must_use]
    pub fn point(&self, node: usize) -> Option<[f64; 3]> {
        self.walks.centre(node)
    }

    /// Active nodes: those of the given base units with a Gaussian at a finite position. `units` has one entry per unit.
    #[must_use]
    pub fn active(&self, units: &[bool]) -> Vec<bool> {
        self.walks.active(units)
    }

    pub(crate) fn proposal_query<'a>(&'a self, active: &'a [bool], threshold: f64) -> ProposalQuery<'a> {
        self.walks.proposal_query(active, threshold)
    }

    /// Solves a walk from the Gaussians under the foreground brush and the background brush.
    ///
    /// A node under both brushes follows the majority of its hit Gaussians; at a tie it stays unseeded. The walk is
    /// restricted to the hit base units; elsewhere p = q = 0.
    ///
    /// # Errors
    /// [`WalkError`] if the solver breaks down.
    pub fn walk(
        &self,
        foreground: impl Iterator<Item = u32>,
        background: impl Iterator<Item = u32>,
    ) -> Result<Walk, WalkError> {
        self.walk_incremental(&mut self.elimination().cloned(), self.options().leak, foreground, background)
    }

    /// Solves a walk with another leak, on an elimination that the caller keeps between walks.
    ///
    /// Start with [`SelectionIndex::elimination`]. Only the columns that changed since the last walk are eliminated again.
    /// Without an elimination the solver of the index solves the walk.
    ///
    /// # Errors
    /// [`WalkError`] if the leak is invalid or the solver breaks down.
    pub fn walk_incremental(
        &self,
        elimination: &mut Option<Elimination>,
        leak: f64,
        foreground: impl Iterator<Item = u32>,
        background: impl Iterator<Item = u32>,
    ) -> Result<Walk, WalkError> {
        self.walks.walk(elimination, leak, foreground, background)
    }

    /// The initial elimination of walks at every scale. `None` if the options do not ask for it, for another solver than the
    /// elimination in f64, for the farthest rule, and on single Gaussians.
    #[must_use]
    pub fn family(&self) -> Option<&EliminationFamily> {
        self.walks.family()
    }

    /// Solves the walks of a family that the caller keeps between walks; start with [`SelectionIndex::family`].
    ///
    /// Returns the walk of the first answer, all answers, and the masks as those of a first stroke. `threshold` is the limit
    /// of p − q. With the masks of the first stroke, answers that disagree with the later strokes are left out.
    ///
    /// # Errors
    /// [`WalkError`] if the solver breaks down.
    pub(crate) fn walk_at_every_scale(
        &self,
        family: &mut EliminationFamily,
        threshold: f64,
        strokes: [impl Iterator<Item = u32>; 2],
        first: Option<&FirstStroke>,
    ) -> Result<Option<(Walk, Answers, FirstStroke)>, WalkError> {
        self.walks.walk_at_every_scale(family, threshold, strokes, first)
    }

    /// The masks of a first stroke at every scale, from the Gaussians under the foreground and the background brush.
    ///
    /// # Errors
    /// [`WalkError`] if the solver breaks down.
    pub(crate) fn first_stroke(
        &self,
        family: &mut EliminationFamily,
        threshold: f64,
        strokes: [impl Iterator<Item = u32>; 2],
    ) -> Result<FirstStroke, WalkError> {
        self.walks.first_stroke(family, threshold, strokes)
    }
}

#[cfg(test)]
mod tests;
