//! Super-Gaussians: geometric features, the neighbour graph, geodesic SLIC, the cluster graph.
//!
//! [`geometry`] (points, features, neighbour graph) → [`clustering`] (Super-Gaussians) → [`cluster_graph`]. [`tree`] and
//! [`polyline`] answer which points a brushed tube holds; [`cache`] keeps clusters on the disk.

#![cfg_attr(test, allow(clippy::print_stdout, reason = "tests print what they measure"))]

pub mod assignment;
pub mod bounds;
pub mod bridges;
pub mod bvh;
pub mod cache;
pub mod cluster_graph;
pub mod clustering;
pub mod euclidean;
pub mod features;
pub mod geometry;
pub mod merge;
pub mod neighbours;
pub mod polyline;
pub mod progress;
pub mod seeds;
pub mod shortest;
pub mod vertices;
