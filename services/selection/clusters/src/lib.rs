//! Super-Gaussians: features, neighbour graph, geodesic clustering and cluster graph of a scene of Gaussians.
//!
//! [`geometry`] (points, features, neighbour graph) → [`clustering`] (Super-Gaussians) → [`cluster_graph`]. [`bvh`] and
//! [`polyline`] find the points in the tube of a brush stroke. [`cache`] stores clusters on disk.
//!
//! # Example
//!
//! ```
//! use sg_clusters::cluster_graph::{ClusterGraph, GraphForm};
//! use sg_clusters::clustering::{ClusteringOptions, cluster};
//! use sg_clusters::geometry::{Geometry, GeometryOptions};
//! use sg_clusters::progress::Silent;
//! use sg_scene::synthetic::vessel_and_sac;
//!
//! let (scene, _) = vessel_and_sac(2000, 1);
//! let geometry = Geometry::of_scene(&scene, GeometryOptions::default(), &Silent)?;
//! let options = ClusteringOptions { max_clusters: 60, ..ClusteringOptions::default() };
//! let (clustering, report) = cluster(&geometry, &options, &Silent)?;
//! assert_eq!(clustering.labels.len(), scene.len());
//! assert!((1..=60).contains(&report.clusters));
//!
//! let graph = ClusterGraph::new(&geometry, &clustering, GraphForm::Contact)?;
//! let network = graph.network(1.0, 1.0, None);
//! assert_eq!(network.len(), report.clusters);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![cfg_attr(test, allow(clippy::print_stdout, reason = "tests print what they measure"))]

pub mod assignment;
pub mod bounds;
pub mod bridges;
pub mod bvh;
pub mod cache;
pub mod cluster_graph;
pub mod clustering;
pub mod creases;
pub mod duplicates;
pub mod euclidean;
pub mod features;
pub mod geometry;
pub mod hierarchy;
pub mod merge;
pub mod neighbours;
pub mod orientation;
pub mod polyline;
pub mod progress;
pub mod seeds;
pub mod shortest;
pub mod vertices;
