//! What a long computation tells its caller, and how the caller stops it.

use serde::{Deserialize, Serialize};

/// A stage of clustering.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stage {
    /// Feature vectors.
    Features,
    /// The neighbour graph, its components and the bridges between them.
    Graph,
    /// The search for the voxel edge and the seeds.
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

/// Follows a computation. Called from the thread that computes, between steps.
pub trait Progress {
    /// A stage is done to this fraction, 0 to 1.
    fn at(&self, stage: Stage, fraction: f64);

    /// Whether the computation is to stop; asked between steps.
    fn cancelled(&self) -> bool {
        false
    }
}

/// Tells nobody and never stops.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Progress for Silent {
    fn at(&self, _: Stage, _: f64) {}
}
