//! The graph, the solver and the seeding of walks.

use std::sync::Arc;

use serde::Serialize;
use sg_clusters::cluster_graph::{ClusterGraph, gaussian_network};
use sg_clusters::clustering::Clustering;
use sg_clusters::geometry::Geometry;
use sg_clusters::neighbours::{Edge, Graph};
use sg_scene::mask::Mask;
use sg_scene::model::Scene;
use sg_walk::elimination::{Elimination, EliminationFamily};
use sg_walk::multilevel::{Boundary, Multilevel, Quality};
use sg_walk::ordering::minimum_degree;
use sg_walk::sprs::PermOwnedI;
use sg_walk::uncertainty::ProposalQuery;
use sg_walk::{Network, Precision, Problem, Seed, Solution, Solver, SystemSolver, WalkError, gth, solve};

use super::farthest::FarthestRule;
use super::first_stroke::FirstStroke;
use super::walk_options::{Background, WalkOptions};
use crate::answers::{Answer, Answers, Shown, leaks};

/// Largest number of unknowns of a walk on Gaussians that is eliminated. Larger walks are iterated.
const MAX_ELIMINATED: usize = 2000;

/// Largest number of nodes of a walk that is eliminated after the iteration failed.
const MAX_ELIMINATED_FALLBACK: usize = 20_000;

/// Estimated error in p of an iterated walk on Gaussians.
pub const TOLERANCE: f64 = 1e-3;

/// Counts of one walk.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct WalkSummary {
    /// Nodes seeded as foreground.
    pub seeds_foreground: usize,
    /// Nodes seeded as background by strokes.
    pub seeds_background: usize,
    /// Nodes under both brushes.
    pub conflicts: usize,
    /// Nodes with automatic background: leaking nodes, or the nodes of the farthest rule.
    pub auto_background: usize,
    /// Nodes of the hit base units from which no terminal is reachable.
    pub unreached: usize,
    /// Whether the iteration failed and the slower elimination replaced it. The log holds the reason.
    pub eliminated_instead: bool,
}

/// A solved walk.
#[derive(Debug, Clone)]
pub struct Walk {
    /// Probabilities.
    pub solution: Solution,
    /// Seed of each node.
    pub seeds: Vec<Seed>,
    /// Base units of the walk.
    pub units: Vec<bool>,
    /// Counts.
    pub summary: WalkSummary,
    /// Quality of an iterated solution. `None` for an eliminated one; that is exact up to rounding.
    pub quality: Option<Quality>,
}

/// The graph of a scene, ready for walks. Its nodes are clusters or single Gaussians.
pub(super) struct WalkIndex {
    /// Node of each Gaussian. `None` for Gaussians without a finite position.
    nodes: Arc<[Option<u32>]>,
    /// Base unit of each node.
    node_unit: Vec<u32>,
    /// Number of base units.
    units: usize,
    pub(super) network: Arc<Network>,
    /// Every edge with its weight, for conductances. Empty if nodes are Gaussians.
    weights: Vec<(u32, u32, f64)>,
    /// The initial elimination of walks at every scale.
    family: Option<EliminationFamily>,
    /// Number of Gaussians of each cluster. Empty if nodes are Gaussians.
    mass: Vec<f64>,
    /// The central Gaussian of each cluster and its normalized position. Empty if nodes are Gaussians.
    centres: Vec<Option<(u32, [f64; 3])>>,
    order: Option<PermOwnedI<u32>>,
    /// Initial elimination, for walks that are eliminated in f64.
    elimination: Option<Elimination>,
    /// Iterative solver, for walks on many Gaussians.
    pub(super) multilevel: Option<Multilevel>,
    solver: Arc<dyn SystemSolver + Send + Sync>,
    options: WalkOptions,
    /// Present if the options ask for the farthest rule.
    farthest: Option<FarthestRule>,
}

impl WalkIndex {
    /// Walks on clusters. `labels` is the cluster of each Gaussian.
    pub(super) fn of_clusters(
        scene: &Scene,
        clustering: &Clustering,
        graph: &ClusterGraph,
        labels: Arc<[Option<u32>]>,
        options: WalkOptions,
    ) -> Self {
        let network = graph.network(options.sigma_s, options.sigma_f, options.crease);
        let solver = options.solver.with(options.precision);
        let order = solver.eliminates(network.len()).then(|| minimum_degree(network.adjacency()));
        let elimination = (options.solver == Solver::Gth && options.precision == Precision::F64)
            .then(|| Elimination::new(&network, order.as_ref()));
        let farthest = (options.background == Background::Farthest).then(|| {
            let component = graph.component.iter().map(|&c| (c != u32::MAX).then_some(c)).collect();
            FarthestRule { graph: graph.lengths(), component }
        });
        Self {
            nodes: labels,
            node_unit: clustering.clusters.iter().map(|c| c.unit).collect(),
            units: scene.units.len(),
            mass: clustering.clusters.iter().map(|c| f64::from(c.size)).collect(),
            centres: clustering
                .clusters
                .iter()
                .map(|c| scene.position(c.centre as usize).map(|p| (c.centre, scene.bounds.normalize(p).to_array())))
                .collect(),
            family: elimination.as_ref().and_then(|e| family(e, &options)),
            elimination,
            weights: weights(&network),
            network: Arc::new(network),
            order,
            multilevel: None,
            solver: solver.into(),
            options,
            farthest,
        }
    }

    /// Walks on single Gaussians.
    pub(super) fn of_gaussians(scene: &Scene, geometry: &Geometry, options: WalkOptions) -> Self {
        let network = Arc::new(gaussian_network(geometry, options.sigma_s, options.sigma_f));
        let multilevel =
            (network.len() > MAX_ELIMINATED).then(|| Multilevel::new(Arc::clone(&network), Precision::F32));
        let n = scene.len();
        let mut nodes = vec![None; n];
        let mut node_unit = vec![0; n];
        let mut component = vec![None; n];
        let mut first = 0;
        for (u, unit) in (0..).zip(&geometry.units) {
            for (&g, &c) in unit.vertices.gaussian.iter().zip(&unit.component) {
                nodes[g as usize] = Some(g);
                node_unit[g as usize] = u;
                component[g as usize] = Some(first + c);
            }
            first += unit.components as u32;
        }
        let farthest = (options.background == Background::Farthest).then(|| {
            let edges = geometry.units.iter().flat_map(|unit| {
                let index = &unit.vertices.gaussian;
                unit.joined().edges().map(|e| Edge { a: index[e.a as usize], b: index[e.b as usize], length: e.length })
            });
            FarthestRule { graph: Graph::from_edges(n, edges), component }
        });
        Self {
            nodes: nodes.into(),
            node_unit,
            units: scene.units.len(),
            mass: Vec::new(),
            centres: Vec::new(),
            elimination: None,
            family: None,
            weights: Vec::new(),
            network,
            order: None,
            multilevel,
            solver: Arc::new(gth::Gth64),
            options,
            farthest,
        }
    }

    /// The same graph without deleted Gaussians. A node without a Gaussian keeps its number and loses its edges, so that no walk
    /// crosses it.
    pub(super) fn without(&self, deleted: &Mask) -> Self {
        let nodes: Arc<[Option<u32>]> =
            self.nodes.iter().enumerate().map(|(g, node)| node.filter(|_| !deleted.get(g))).collect();
        let mut mass = vec![0.0_f64; self.len()];
        nodes.iter().flatten().for_each(|node| mass[*node as usize] += 1.0);
        let remains = |node: u32| mass[node as usize] > 0.0;
        let count = self.len() as u32;
        let links = (0..count).filter(|u| remains(*u)).flat_map(|u| {
            self.network.links(u).filter(move |(v, _)| u < *v && remains(*v)).map(move |(v, w)| (u, v, w))
        });
        let network = Arc::new(Network::new(self.len(), links));
        let order = self.order.as_ref().map(|_| minimum_degree(network.adjacency()));
        let farthest = self.farthest.as_ref().map(|rule| {
            let edges = rule.graph.edges().filter(|e| remains(e.a) && remains(e.b));
            FarthestRule { graph: Graph::from_edges(self.len(), edges), component: rule.component.clone() }
        });
        let centres = self.centres.iter().map(|c| c.filter(|(g, _)| !deleted.get(*g as usize))).collect();
        let elimination = self.elimination.as_ref().map(|_| Elimination::new(&network, order.as_ref()));
        Self {
            nodes,
            node_unit: self.node_unit.clone(),
            units: self.units,
            mass: if self.mass.is_empty() { Vec::new() } else { mass },
            centres,
            family: elimination.as_ref().and_then(|e| family(e, &self.options)),
            elimination,
            weights: if self.weights.is_empty() { Vec::new() } else { weights(&network) },
            multilevel: self.multilevel.as_ref().map(|_| Multilevel::new(Arc::clone(&network), Precision::F32)),
            network,
            order,
            solver: Arc::clone(&self.solver),
            options: self.options,
            farthest,
        }
    }

    pub(super) fn len(&self) -> usize {
        self.network.len()
    }

    pub(super) fn node_of(&self, gaussian: u32) -> Option<usize> {
        self.nodes.get(gaussian as usize)?.map(|node| node as usize)
    }

    pub(super) fn unit_of_node(&self, node: usize) -> usize {
        self.node_unit[node] as usize
    }

    pub(super) fn elimination(&self) -> Option<&Elimination> {
        self.elimination.as_ref()
    }

    pub(super) fn family(&self) -> Option<&EliminationFamily> {
        self.family.as_ref()
    }

    pub(super) fn options(&self) -> &WalkOptions {
        &self.options
    }

    pub(super) fn centre(&self, node: usize) -> Option<[f64; 3]> {
        self.centres.get(node).copied().flatten().map(|(_, position)| position)
    }

    pub(super) fn active(&self, units: &[bool]) -> Vec<bool> {
        // Labels may skip an id, so that a node may have no Gaussian. Such nodes are inactive.
        let mut active = vec![false; self.len()];
        for node in self.nodes.iter().flatten().map(|&node| node as usize) {
            active[node] = units[self.unit_of_node(node)];
        }
        active
    }

    pub(super) fn proposal_query<'a>(&'a self, active: &'a [bool], threshold: f64) -> ProposalQuery<'a> {
        ProposalQuery { mass: &self.mass, active, threshold }
    }

    pub(super) fn walk(
        &self,
        elimination: &mut Option<Elimination>,
        leak: f64,
        foreground: impl Iterator<Item = u32>,
        background: impl Iterator<Item = u32>,
    ) -> Result<Walk, WalkError> {
        let n = self.len();
        let (mut seeds, units, mut summary) = self.seeds(foreground, background);
        let active = self.active(&units);
        let mut leak = leak;
        match &self.farthest {
            Some(rule) => {
                leak = 0.0;
                summary.auto_background = rule.seed(&active, &mut seeds);
            }
            None => self.count_leaking(leak, &seeds, &active, &mut summary),
        }
        let problem = Problem { network: &self.network, seeds: &seeds, leak, leaking: Some(&active) };
        let mut quality = None;
        let solution = match (elimination, &self.multilevel) {
            (Some(elimination), _) => elimination.solve(&seeds, leak, Some(&active))?,
            (None, Some(multilevel)) => {
                let known = Multilevel::known(&seeds);
                match multilevel.solve(&Boundary { known: &known, leak, leaking: Some(&active) }, TOLERANCE) {
                    Ok(answer) => {
                        quality = Some(answer.quality);
                        // The error of the iteration is far above that of the subtraction.
                        let q = answer.p.iter().zip(&answer.reached).map(|(p, r)| if *r { 1.0 - p } else { 0.0 });
                        Solution { q: q.collect(), p: answer.p, reached: answer.reached }
                    }
                    // Too ill-conditioned for the iteration, but small enough for the elimination.
                    Err(e @ WalkError::Breakdown { .. }) if n <= MAX_ELIMINATED_FALLBACK => {
                        tracing::warn!(nodes = n, reason = %e, "the iteration of a walk failed; the elimination replaces it");
                        summary.eliminated_instead = true;
                        solve(&problem, self.solver.as_ref(), None)?
                    }
                    Err(e) => return Err(e),
                }
            }
            (None, None) => solve(&problem, self.solver.as_ref(), self.order.as_ref())?,
        };
        summary.unreached = (0..n).filter(|&node| active[node] && !solution.reached[node]).count();
        Ok(Walk { solution, seeds, units, summary, quality })
    }

    /// The masks of a first stroke at every scale.
    pub(super) fn first_stroke(
        &self,
        family: &mut EliminationFamily,
        threshold: f64,
        [foreground, background]: [impl Iterator<Item = u32>; 2],
    ) -> Result<FirstStroke, WalkError> {
        let (seeds, units, _) = self.seeds(foreground, background);
        let active = self.active(&units);
        let solutions = family.solve(&seeds, Some(&active))?;
        let selected = solutions.iter().map(|solution| self.selected(solution, threshold, &active)).collect();
        Ok(FirstStroke { seeds, threshold, selected })
    }

    /// Active nodes that a walk selects.
    fn selected(&self, solution: &Solution, threshold: f64, active: &[bool]) -> Vec<bool> {
        (0..self.len()).map(|node| active[node] && solution.leads(node, threshold)).collect()
    }

    /// The walks of a family: the answers, and the walk of the first one. See [`super::SelectionIndex::walk_at_every_scale`].
    pub(super) fn walk_at_every_scale(
        &self,
        family: &mut EliminationFamily,
        threshold: f64,
        [foreground, background]: [impl Iterator<Item = u32>; 2],
        first: Option<&FirstStroke>,
    ) -> Result<Option<(Walk, Answers, FirstStroke)>, WalkError> {
        let (seeds, units, mut summary) = self.seeds(foreground, background);
        let active = self.active(&units);
        let mut solutions = family.solve(&seeds, Some(&active))?;
        let hit = || (0..self.len()).filter(|node| seeds[*node] == Seed::Foreground);
        let degrees: usize = hit().map(|node| self.network.neighbours(node as u32).len()).sum();
        let shown = Shown {
            neighbours: degrees as f64 / hit().count().max(1) as f64,
            hit: self.mass_of(|node| seeds[node] == Seed::Foreground) as usize,
            all: self.mass_of(|node| active[node]) as usize,
        };
        let masks: Vec<Vec<bool>> = solutions.iter().map(|s| self.selected(s, threshold, &active)).collect();
        let answer = |(leak, selected): (&f64, &Vec<bool>)| Answer {
            leak: *leak,
            gaussians: self.mass_of(|node| selected[node]) as usize,
            conductance: self.conductance(selected, &active),
        };
        let answers = family.leaks().iter().zip(&masks).map(answer).collect();
        let consistent = first.map(|first| first.consistent(&seeds, &self.mass));
        let Some(answers) = Answers::among(answers, shown, |i| consistent.as_ref().is_none_or(|c| c[i])) else {
            return Ok(None);
        };
        let solution = solutions.swap_remove(answers.steps[answers.first]);
        self.count_leaking(answers.first().leak, &seeds, &active, &mut summary);
        summary.unreached = (0..self.len()).filter(|&node| active[node] && !solution.reached[node]).count();
        let masks = FirstStroke { seeds: seeds.clone(), threshold, selected: masks };
        Ok(Some((Walk { solution, seeds, units, summary, quality: None }, answers, masks)))
    }

    /// Number of Gaussians of some nodes.
    fn mass_of(&self, of: impl Fn(usize) -> bool) -> f64 {
        self.mass.iter().enumerate().filter(|(node, _)| of(*node)).map(|(_, mass)| mass).sum()
    }

    /// Weight across the boundary of the selected nodes over the lesser of the weights inside and outside.
    fn conductance(&self, selected: &[bool], active: &[bool]) -> f64 {
        let (mut across, mut inside, mut outside) = (0.0, 0.0, 0.0);
        for &(u, v, w) in self.weights.iter().filter(|(u, v, _)| active[*u as usize] && active[*v as usize]) {
            let ends = [u, v].map(|end| selected[end as usize]);
            across += if ends[0] == ends[1] { 0.0 } else { w };
            for end in ends {
                *(if end { &mut inside } else { &mut outside }) += w;
            }
        }
        let least = f64::min(inside, outside);
        if least > 0.0 { across / least } else { 0.0 }
    }

    /// Counts the nodes with automatic background of a leak.
    fn count_leaking(&self, leak: f64, seeds: &[Seed], active: &[bool], summary: &mut WalkSummary) {
        let leaks = |(node, s): (usize, &Seed)| {
            *s == Seed::None && active[node] && !self.network.neighbours(node as u32).is_empty()
        };
        if leak > 0.0 {
            summary.auto_background = seeds.iter().enumerate().filter(|&x| leaks(x)).count();
        }
    }

    /// Seeds the nodes by the majority of their hit Gaussians. Returns seeds, hit base units and counts.
    fn seeds(
        &self,
        foreground: impl Iterator<Item = u32>,
        background: impl Iterator<Item = u32>,
    ) -> (Vec<Seed>, Vec<bool>, WalkSummary) {
        let mut count = vec![[0_u32; 2]; self.len()];
        for node in foreground.filter_map(|g| self.node_of(g)) {
            count[node][0] += 1;
        }
        for node in background.filter_map(|g| self.node_of(g)) {
            count[node][1] += 1;
        }
        let mut units = vec![false; self.units];
        let mut summary = WalkSummary::default();
        let mut seeds = vec![Seed::None; self.len()];
        for (node, [f, b]) in count.iter().copied().enumerate() {
            if f + b == 0 {
                continue;
            }
            units[self.unit_of_node(node)] = true;
            summary.conflicts += usize::from(f > 0 && b > 0);
            seeds[node] = match f.cmp(&b) {
                std::cmp::Ordering::Greater => Seed::Foreground,
                std::cmp::Ordering::Less => Seed::Background,
                std::cmp::Ordering::Equal => Seed::None,
            };
        }
        summary.seeds_foreground = seeds.iter().filter(|s| **s == Seed::Foreground).count();
        summary.seeds_background = seeds.iter().filter(|s| **s == Seed::Background).count();
        (seeds, units, summary)
    }
}

/// The family of walks at every scale, if the options have one.
fn family(elimination: &Elimination, options: &WalkOptions) -> Option<EliminationFamily> {
    let wanted = options.every_scale && options.background == Background::Leak;
    elimination.family(&leaks()).ok().filter(|_| wanted)
}

/// Every edge with its weight. The largest weight is about 1; those far below it count as 0.
fn weights(network: &Network) -> Vec<(u32, u32, f64)> {
    let links = || (0..network.len() as u32).flat_map(|u| network.links(u).map(move |(v, w)| (u, v, w)));
    let unit = links().filter(|l| !l.2.is_zero()).map(|l| l.2.exponent()).max().unwrap_or(0);
    links().filter(|(u, v, _)| u < v).map(|(u, v, w)| (u, v, w.scaled(unit))).collect()
}
