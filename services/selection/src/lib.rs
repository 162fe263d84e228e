//! Super-Gaussians, the cluster graph, random walks, brushes.
