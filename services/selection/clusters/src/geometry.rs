//! Geometry of a scene: vertices, features and neighbour graph of each base unit.

use std::time::Instant;

use sg_scene::model::Scene;

use crate::bridges::{Joined, both_ways, bridges_between};
use crate::features::{FeatureKind, Features, features};
use crate::neighbours::{Edge, Graph, GraphError, neighbour_graph};
use crate::progress::{Progress, Stage};
use crate::vertices::Vertices;

/// Parameters of the geometry.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GeometryOptions {
    /// Nearest neighbours of each Gaussian, k.
    pub neighbours: usize,
    /// Feature form; `None` means the default of each unit.
    pub features: Option<FeatureKind>,
}

impl Default for GeometryOptions {
    fn default() -> Self {
        Self { neighbours: 10, features: None }
    }
}

/// A failed computation of the geometry.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum GeometryError {
    /// Indices are 32 bits wide.
    #[error("a scene of {0} Gaussians is too large: at most 2147483647 can be selected from")]
    TooLarge(usize),
    /// A column is shorter or longer than the others.
    #[error("base unit `{unit}`: {source}")]
    Columns {
        /// Name of the unit.
        unit: String,
        /// Which column.
        source: sg_scene::model::ColumnLength,
    },
    /// The neighbour graph failed.
    #[error("base unit `{unit}`: {source}")]
    Graph {
        /// Name of the unit.
        unit: String,
        /// Why.
        source: GraphError,
    },
    /// The caller cancelled the computation.
    #[error("the computation was cancelled")]
    Cancelled,
}

/// Geometry of one base unit.
#[derive(Debug, Clone)]
pub struct UnitGeometry {
    /// Gaussians with a finite position, in the scene frame.
    pub vertices: Vertices,
    /// Features of the vertices.
    pub features: Features,
    /// Neighbour graph of the vertices.
    pub graph: Graph,
    /// Connected component of each vertex in `graph`.
    pub component: Vec<u32>,
    /// Number of components.
    pub components: usize,
    /// The shortest edges that join the components, both directions of each, ascending.
    pub bridges: Vec<Edge>,
}

impl UnitGeometry {
    /// The connected graph: the neighbour graph with the bridges.
    #[must_use]
    pub fn joined(&self) -> Joined<'_> {
        Joined::new(&self.graph, &self.bridges)
    }
}

/// Geometry of a scene.
#[derive(Debug, Clone)]
pub struct Geometry {
    /// Number of Gaussians in the scene.
    pub gaussians: usize,
    /// Number of ignored Gaussians: those without a finite position.
    pub dropped: usize,
    /// k.
    pub neighbours: usize,
    /// Base units in the order of the scene.
    pub units: Vec<UnitGeometry>,
    /// Seconds spent on features.
    pub feature_seconds: f64,
    /// Seconds spent on neighbour graphs.
    pub graph_seconds: f64,
}

impl Geometry {
    /// Derives the geometry of a scene.
    ///
    /// # Errors
    /// [`GeometryError`] if the scene is too large, its columns differ in length, or the caller cancels.
    pub fn of_scene(scene: &Scene, options: GeometryOptions, progress: &dyn Progress) -> Result<Self, GeometryError> {
        let gaussians = scene.len();
        if gaussians > i32::MAX as usize {
            return Err(GeometryError::TooLarge(gaussians));
        }
        let mut out = Self {
            gaussians,
            dropped: 0,
            neighbours: options.neighbours,
            units: Vec::with_capacity(scene.units.len()),
            feature_seconds: 0.0,
            graph_seconds: 0.0,
        };
        for unit in &scene.units {
            unit.gaussians
                .check_lengths()
                .map_err(|source| GeometryError::Columns { unit: unit.name.clone(), source })?;
            let fraction = unit.first as f64 / gaussians.max(1) as f64;
            progress.at(Stage::Features, fraction);
            let start = Instant::now();
            let (vertices, dropped) = Vertices::of_unit(unit);
            out.dropped += dropped;
            let kind = options.features.unwrap_or_else(|| FeatureKind::for_unit(unit));
            let features = features(unit, &vertices, kind);
            out.feature_seconds += start.elapsed().as_secs_f64();
            if progress.cancelled() {
                return Err(GeometryError::Cancelled);
            }
            progress.at(Stage::Graph, fraction);
            let start = Instant::now();
            let graph = neighbour_graph(&vertices, options.neighbours)
                .map_err(|source| GeometryError::Graph { unit: unit.name.clone(), source })?;
            let (component, components) = graph.components();
            let between =
                if components > 1 { bridges_between(&vertices, component.clone(), components) } else { Vec::new() };
            let bridges = both_ways(&between);
            out.graph_seconds += start.elapsed().as_secs_f64();
            if progress.cancelled() {
                return Err(GeometryError::Cancelled);
            }
            out.units.push(UnitGeometry { vertices, features, graph, component, components, bridges });
        }
        progress.at(Stage::Features, 1.0);
        progress.at(Stage::Graph, 1.0);
        Ok(out)
    }
}
