//! Evaluation tables: the worth of each choice in clustering and walking, on scenes whose truth is known.
//!
//! `supergaussian eval selection-ablation`. docs/ablation.md describes the measurements. Clusterings have an equal number of
//! clusters. Walks run over many jittered strokes. Numbers are chosen on shapes that are not reported.

pub mod ablation;
pub mod hand;
pub mod language;
pub mod measure;
pub mod measured;
pub mod one_stroke;
pub mod peers;
pub mod phantoms;
pub mod plots;
pub mod report;
pub mod shapes;
pub mod solid;
pub mod spoken;
pub mod subject;

use std::path::PathBuf;

use sg_clusters::clustering::ClusterError;
use sg_clusters::geometry::GeometryError;
use sg_clusters::neighbours::GraphError;

/// An evaluation could not be done.
#[derive(Debug, thiserror::Error)]
pub enum EvalError {
    /// Features or neighbour graph.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
    /// Clusters.
    #[error(transparent)]
    Cluster(#[from] ClusterError),
    /// The graph of clusters.
    #[error(transparent)]
    Graph(#[from] GraphError),
    /// Nothing to evaluate on.
    #[error("there is nothing to evaluate on")]
    Nothing,
    /// A name that no shape has.
    #[error("there is no shape `{0}`; there are: vortex, lobster, ionization, chameleon, aneurysm, knot, coral")]
    Shape(String),
    /// Measured data that cannot be used.
    #[error("{path}: {why}")]
    Data {
        /// The file.
        path: String,
        /// The problem with it.
        why: String,
    },
    /// A picture that could not be drawn.
    #[error("{path}: the plot could not be drawn: {why}")]
    Plot {
        /// The file.
        path: String,
        /// Why.
        why: String,
    },
    /// A file that could not be written.
    #[error("{path}: {source}")]
    Write {
        /// The file.
        path: String,
        /// The system's error.
        source: std::io::Error,
    },
}

/// What is evaluated.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Made shapes, by name.
    pub shapes: Vec<String>,
    /// Gaussians of each scene.
    pub gaussians: usize,
    /// Clusters that every clustering is made to have.
    pub clusters: usize,
    /// Jittered strokes each walk is played with.
    pub trials: usize,
    /// The trials that are also played with walks on single Gaussians. Those walks take longer.
    pub gaussian_trials: usize,
    /// Seed of shapes, scrambling and strokes.
    pub seed: u64,
    /// Folder of measured data.
    pub data: Option<PathBuf>,
    /// Whether the short form was asked for.
    pub quick: bool,
}

impl Options {
    /// All five shapes, a hundred trials.
    #[must_use]
    pub fn full(seed: u64) -> Self {
        Self {
            shapes: shapes::REPORTED.map(str::to_owned).to_vec(),
            gaussians: 30_000,
            clusters: 500,
            trials: 100,
            gaussian_trials: 20,
            seed,
            data: None,
            quick: false,
        }
    }

    /// Two shapes, a few trials: some seconds.
    #[must_use]
    pub fn quick(seed: u64) -> Self {
        Self {
            shapes: ["lobster", "aneurysm"].map(str::to_owned).to_vec(),
            gaussians: 6000,
            clusters: 200,
            trials: 8,
            gaussian_trials: 2,
            quick: true,
            ..Self::full(seed)
        }
    }
}
