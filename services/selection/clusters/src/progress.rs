//! Progress reports and cancellation of long computations.

use serde::{Deserialize, Serialize};

/// A stage of clustering.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stage {
    /// Feature vectors.
    Features,
    /// Neighbour graph, components and bridges.
    Graph,
    /// Search for the voxel edge and the seeds.
    Seeds,
    /// Rounds of assignment and update.
    Assignment,
    /// Merging of small pieces.
    Merge,
    /// The graph of clusters.
    ClusterGraph,
}

impl Stage {
    /// Name in reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Features => "features",
            Self::Graph => "graph",
            Self::Seeds => "seeds",
            Self::Assignment => "assignment",
            Self::Merge => "merge",
            Self::ClusterGraph => "cluster_graph",
        }
    }
}

/// An observer of a computation, called between steps from the computing thread.
pub trait Progress {
    /// Reports the completed fraction of a stage, 0 to 1.
    fn at(&self, stage: Stage, fraction: f64);

    /// Whether to cancel the computation.
    fn cancelled(&self) -> bool {
        false
    }
}

/// Ignores reports and never cancels.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Progress for Silent {
    fn at(&self, _: Stage, _: f64) {}
}
