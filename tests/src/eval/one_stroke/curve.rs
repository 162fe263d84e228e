//! One stroke on one graph of clusters: the mask of every leak, and what each mask shows.

use serde::Serialize;
use sg_clusters::cluster_graph::ClusterGraph;
use sg_selection::cluster_members::ClusterMembers;
use sg_walk::elimination::{Elimination, EliminationFamily};
use sg_walk::{Network, Seed, WalkError};

/// Leaks from 10^-4.6 to 1, a fifth of a decade apart.
pub const LEAKS: usize = 24;

/// Fixed leaks that the family is compared with; they follow the rising ones.
pub const FIXED: [f64; 2] = [0.03, 0.003];

/// Leak number `i`, rising; then the fixed ones.
#[must_use]
pub fn leak(i: usize) -> f64 {
    if i < LEAKS { 10.0_f64.powf(-4.6 + 0.2 * i as f64) } else { FIXED[i - LEAKS] }
}

/// The masks of one stroke over the leaks, smallest leak first.
#[derive(Debug, Clone, Serialize)]
pub struct Curve {
    /// Gaussians of each mask.
    pub gaussians: Vec<f64>,
    /// IoU of each mask with the target.
    pub iou: Vec<f64>,
    /// Conductance of each cut: weight across over the lesser weight inside.
    pub conductance: Vec<f64>,
    /// Mean concavity over the cut, by plain weight.
    pub crease: Vec<f64>,
}

/// A graph of clusters, ready for strokes.
pub struct Walker {
    network: Network,
    /// Edge, weight, plain weight, concavity.
    edges: Vec<(usize, usize, f64, f64, f64)>,
    family: EliminationFamily,
}

impl Walker {
    /// With or without creases.
    ///
    /// # Errors
    /// [`WalkError`] never: the leaks are right.
    pub fn new(graph: &ClusterGraph, crease: Option<f64>) -> Result<Self, WalkError> {
        let network = graph.network(1.0, 1.0, crease);
        let plain = graph.network(1.0, 1.0, None);
        let weight = |n: &Network, u: u32, v: u32| n.links(u).find(|l| l.0 == v).map_or(0.0, |l| l.1.scaled(0));
        let edges = graph
            .links()
            .map(|l| {
                let (w, p) = (weight(&network, l.u, l.v), weight(&plain, l.u, l.v));
                (l.u as usize, l.v as usize, w, p, l.distances.crease)
            })
            .collect();
        let leaks: Vec<f64> = (0..LEAKS + FIXED.len()).map(leak).collect();
        let family = Elimination::new(&network, None).family(&leaks)?;
        Ok(Self { network, edges, family })
    }

    /// Plays the hit clusters as foreground.
    ///
    /// # Errors
    /// [`WalkError`] if the walk breaks down.
    pub fn play(&self, hit: &[usize], members: &ClusterMembers, own: &[u32]) -> Result<Curve, WalkError> {
        let n = self.network.len();
        let mut seeds = vec![Seed::None; n];
        hit.iter().for_each(|c| seeds[*c] = Seed::Foreground);
        let wanted: f64 = own.iter().map(|o| f64::from(*o)).sum();
        let mut curve = Curve { gaussians: vec![], iou: vec![], conductance: vec![], crease: vec![] };
        for solution in self.family.clone().solve(&seeds, None)? {
            let mask: Vec<bool> = (0..n).map(|u| solution.is_selected(u)).collect();
            let (mut size, mut shared) = (0.0, 0.0);
            for u in (0..n).filter(|u| mask[*u]) {
                size += members.get(u).len() as f64;
                shared += f64::from(own[u]);
            }
            let (mut cut, mut inside, mut all, mut bent, mut plain) = (0.0, 0.0, 0.0, 0.0, 0.0);
            for &(u, v, w, p, c) in &self.edges {
                all += 2.0 * w;
                inside += w * (f64::from(u8::from(mask[u])) + f64::from(u8::from(mask[v])));
                if mask[u] != mask[v] {
                    cut += w;
                    bent += p * c;
                    plain += p;
                }
            }
            curve.gaussians.push(size);
            curve.iou.push(shared / (size + wanted - shared));
            curve.conductance.push(cut / inside.min(all - inside).max(1e-300));
            curve.crease.push(if plain > 0.0 { bent / plain } else { 0.0 });
        }
        Ok(curve)
    }
}
