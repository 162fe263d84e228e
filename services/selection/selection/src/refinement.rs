//! Refinement of a selection of clusters: the walk on single Gaussians in a band around the boundary.
//!
//! A cluster is selected as a whole, so the boundary of a selection follows cluster boundaries. The band holds the
//! Gaussians within some hops of that boundary. In the band the walk is solved on the graph of Gaussians. At the rim of the
//! band, p comes from the walk on clusters. Gaussians under the brush have p = 1 or p = 0.
//!
//! A cluster leaks ε per step of length H, the typical length of a cluster link. A random walk needs (H/h)² steps of length h
//! to go as far. So each Gaussian leaks ε·(h/H)².

use std::sync::Arc;

use sg_scene::mask::Mask;

use crate::selection_index::Background;
use crate::session::{SelectionError, SelectionSession};
use sg_clusters::cluster_graph::{ClusterGraph, gaussian_network, typical};
use sg_clusters::geometry::Geometry;
use sg_walk::multilevel::{Boundary, Multilevel, Quality};
use sg_walk::{Network, Precision};

/// The graph of a scene's Gaussians, prepared for refinement.
#[derive(Debug, Clone)]
pub struct Refiner {
    network: Arc<Network>,
    multilevel: Multilevel,
    /// (h/H)².
    leak_factor: f64,
}

/// A refined selection.
#[derive(Debug, Clone, PartialEq)]
pub struct Refined {
    /// The selected Gaussians after all steps.
    pub mask: Mask,
    /// Probability of foreground of each Gaussian. Outside the band it is the probability of the cluster.
    pub p: Vec<f64>,
    /// Gaussians in the band.
    pub band: Vec<bool>,
    /// Quality of the solution in the band.
    pub quality: Quality,
}

impl Refiner {
    /// Prepares a scene. `sigma_s` and `sigma_f` are factors as in [`crate::selection_index::WalkOptions`].
    #[must_use]
    pub fn new(geometry: &Geometry, graph: &ClusterGraph, sigma_s: f64, sigma_f: f64) -> Self {
        let network = Arc::new(gaussian_network(geometry, sigma_s, sigma_f));
        let multilevel = Multilevel::new(Arc::clone(&network), Precision::F32);
        let own = typical(geometry.units.iter().flat_map(|u| u.joined().edges().map(|e| e.length)));
        let clusters = typical(graph.links().map(|l| l.distances.length));
        let ratio = if clusters > 0.0 { (own / clusters).min(1.0) } else { 1.0 };
        Self { network, multilevel, leak_factor: ratio * ratio }
    }

    /// Leak ε·(h/H)² of a Gaussian for the leak ε of a cluster. With it, walks of
    /// [`crate::selection_index::SelectionIndex::of_gaussians`] reach as far as walks on clusters.
    #[must_use]
    pub fn leak(&self, leak: f64) -> f64 {
        leak * self.leak_factor
    }

    /// Refines a selection of clusters in a band of `hops` on each side of the walk's boundary.
    ///
    /// `tolerance` is the estimated error in p. `None` without a walk.
    ///
    /// # Errors
    /// [`SelectionError`] if the walk in the band or a later step fails.
    pub fn refine(
        &self,
        session: &SelectionSession,
        hops: usize,
        tolerance: f64,
    ) -> Result<Option<Refined>, SelectionError> {
        let Some(walk) = session.walk() else { return Ok(None) };
        let index = session.index();
        let n = index.gaussians();
        let node = |g: usize| index.node_of(g as u32).filter(|&c| walk.units[index.unit_of_node(c)]);
        let selected: Vec<bool> =
            (0..n).map(|g| node(g).is_some_and(|c| walk.solution.leads(c, session.tuning().threshold))).collect();
        let band = self.band(&selected, hops);
        let mut known: Vec<Option<f64>> =
            (0..n).map(|g| (!band[g]).then(|| node(g).map_or(0.0, |c| walk.solution.p[c]))).collect();
        for (mask, value) in [(session.foreground(), 1.0), (session.background(), 0.0)] {
            mask.ones().for_each(|g| known[g] = Some(value));
        }
        // A Gaussian under both brushes is no seed.
        session.foreground().ones().filter(|&g| session.background().get(g) && band[g]).for_each(|g| known[g] = None);
        let leak = match index.options().background {
            Background::Leak => self.leak(session.tuning().leak),
            Background::Farthest => 0.0,
        };
        let answer = self.multilevel.solve(&Boundary { known: &known, leak, leaking: None }, tolerance)?;
        let least = 0.5 * (1.0 + session.tuning().threshold);
        let layer = Mask::from_fn(n, |g| if band[g] { answer.reached[g] && answer.p[g] > least } else { selected[g] });
        Ok(Some(Refined { mask: session.with_later_steps(layer)?, p: answer.p, band, quality: answer.quality }))
    }

    /// Gaussians within a number of hops of a Gaussian on the other side.
    fn band(&self, selected: &[bool], hops: usize) -> Vec<bool> {
        let n = selected.len();
        let mut band = vec![false; n];
        if hops == 0 {
            return band;
        }
        let beside = |u: usize| self.network.neighbours(u as u32).iter().any(|&v| selected[v as usize] != selected[u]);
        let mut front: Vec<usize> = (0..n).filter(|&u| beside(u)).collect();
        front.iter().for_each(|&u| band[u] = true);
        for _ in 1..hops {
            let mut next = Vec::new();
            for u in front {
                for &v in self.network.neighbours(u as u32) {
                    if !band[v as usize] {
                        band[v as usize] = true;
                        next.push(v as usize);
                    }
                }
            }
            front = next;
        }
        band
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mask_agreement::Agreement;
    use crate::selection_index::{SelectionIndex, WalkOptions};
    use crate::strokes::{Kind, Mode, Stroke};
    use glam::Vec3;
    use sg_clusters::cluster_graph::GraphForm;
    use sg_clusters::clustering::{ClusteringOptions, cluster};
    use sg_clusters::geometry::GeometryOptions;
    use sg_clusters::progress::Silent;
    use sg_scene::synthetic::{HALF_LENGTH, normalized, vessel_and_sac};

    #[test]
    fn a_band_comes_near_the_walk_on_all_gaussians() {
        let (scene, truth) = vessel_and_sac(20_000, 11);
        let geometry = Geometry::of_scene(&scene, GeometryOptions::default(), &Silent).unwrap();
        let clustering_options = ClusteringOptions { max_clusters: 150, ..ClusteringOptions::default() };
        let (clustering, _) = cluster(&geometry, &clustering_options, &Silent).unwrap();
        let graph = ClusterGraph::new(&geometry, &clustering, GraphForm::Contact).unwrap();
        let refiner = Refiner::new(&geometry, &graph, 1.0, 1.0);
        for leak in [0.0, 0.03] {
            let options = WalkOptions { leak, ..WalkOptions::default() };
            let space = Arc::new(SelectionIndex::of_clusters(&scene, &clustering, &graph, options));
            let mut session = SelectionSession::new(space);
            let sac: Vec<Vec3> = (0..20)
                .map(|i| {
                    Vec3::new(0.0, 0.0, 0.36) + 0.3 * Vec3::new((0.15 * i as f32).cos(), 0.0, (0.15 * i as f32).sin())
                })
                .collect();
            let vessel = [-0.9, -0.3, 0.3, 0.9].map(|x| Vec3::new(x * HALF_LENGTH, 0.0, -0.12));
            for (kind, points) in [(Kind::Foreground, &sac[..]), (Kind::Background, &vessel)] {
                let points = normalized(&scene, points);
                session
                    .add_stroke(Stroke {
                        mode: Mode::Walk,
                        kind,
                        radius: 0.02,
                        points,
                        pressure: Vec::new(),
                        depth: None,
                    })
                    .unwrap();
            }
            let iou = |mask: &Mask| Agreement::of((0..scene.len()).map(|g| (mask.get(g), truth[g]))).iou;
            assert_eq!(&refiner.refine(&session, 0, 1e-4).unwrap().unwrap().mask, session.mask());
            let mut last = f64::INFINITY;
            // The walk on all Gaussians: a band of the whole scene.
            let full = refiner.refine(&session, 10_000, 1e-4).unwrap().unwrap();
            assert!(full.band.iter().all(|b| *b));
            let clusters = session.walk().unwrap().solution.p.clone();
            let of_cluster = |g: usize| clusters[clustering.labels[g] as usize];
            for hops in [3, 6, 12, 24] {
                let refined = refiner.refine(&session, hops, 1e-4).unwrap().unwrap();
                let band: Vec<usize> = (0..scene.len()).filter(|&g| refined.band[g]).collect();
                let mean = |of: &dyn Fn(usize) -> f64| {
                    band.iter().map(|&g| (of(g) - full.p[g]).abs()).sum::<f64>() / band.len() as f64
                };
                let (error, before) = (mean(&|g| refined.p[g]), mean(&of_cluster));
                let wrong = (0..scene.len()).filter(|&g| refined.mask.get(g) != full.mask.get(g)).count();
                let wrong_before = (0..scene.len()).filter(|&g| session.mask().get(g) != full.mask.get(g)).count();
                println!(
                    "leak {leak}, {hops} hops, {} in the band: mean |p − p of all Gaussians| {error:.4}, of clusters {before:.4}; {wrong} of {} on the other side, of clusters {wrong_before}; IoU {:.4}, clusters {:.4}, all Gaussians {:.4}; estimate {:.1e}",
                    band.len(),
                    scene.len(),
                    iou(&refined.mask),
                    iou(session.mask()),
                    iou(&full.mask),
                    refined.quality.estimate
                );
                assert!(error <= before && refined.quality.estimate <= 1e-4);
                assert!(wrong <= wrong_before);
                last = error;
            }
            assert!(last < 0.1, "{last}");
        }
    }
}
