//! Everything about a scene that selections share: made once, read by any number of sessions.

use std::sync::Arc;

use glam::DVec3;
use serde::{Deserialize, Serialize};
use sg_scene::model::{Scene, SceneBox};

use crate::brush::Brush;
use crate::strokes::Stroke;
use crate::surroundings::Surroundings;
use sg_clusters::cluster_graph::{ClusterGraph, GraphForm, gaussian_network};
use sg_clusters::clustering::Clustering;
use sg_clusters::geometry::Geometry;
use sg_clusters::neighbours::{Edge, Graph};
use sg_clusters::shortest::nearest_source;
use sg_walk::elimination::Elimination;
use sg_walk::multilevel::{Boundary, Multilevel, Quality};
use sg_walk::ordering::minimum_degree;
use sg_walk::uncertainty::Question;
use sg_walk::{Network, Precision, Problem, Seed, Solution, Solver, SystemSolver, WalkError, gth, solve};

/// Where a walk finds its background when the user has drawn none.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Background {
    /// Every unseeded node leaks to the background.
    #[default]
    Leak,
    /// The nodes farthest from the foreground along the graph, a twentieth of each component, are background.
    Farthest,
}

/// How walks are set up and solved.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WalkOptions {
    /// Graph of clusters.
    pub form: GraphForm,
    /// Factor on σ_s, the median length of the edges.
    pub sigma_s: f64,
    /// Factor on σ_f, the median feature distance of the edges.
    pub sigma_f: f64,
    /// ε of the leak.
    pub leak: f64,
    /// Automatic background.
    pub background: Background,
    /// Algorithm, for walks on clusters.
    pub solver: Solver,
    /// Its arithmetic.
    pub precision: Precision,
}

impl Default for WalkOptions {
    fn default() -> Self {
        Self {
            form: GraphForm::Contact,
            sigma_s: 1.0,
            sigma_f: 1.0,
            leak: 0.03,
            background: Background::Leak,
            solver: Solver::Gth,
            precision: Precision::F64,
        }
    }
}

impl WalkOptions {
    /// Checks the numbers.
    ///
    /// # Errors
    /// Which one is wrong and what would be right, in words.
    pub fn check(&self) -> Result<(), String> {
        for (name, x) in [("sigma-s", self.sigma_s), ("sigma-f", self.sigma_f)] {
            if !(x > 0.0 && x.is_finite()) {
                return Err(format!("{name} is {x}; it must be finite and above 0"));
            }
        }
        if !(self.leak >= 0.0 && self.leak.is_finite()) {
            return Err(format!("the leak is {}; it must be finite and at least 0", self.leak));
        }
        Ok(())
    }
}

/// The share of each component that the farthest rule makes background.
const FARTHEST_SHARE: f64 = 0.05;

/// Unknowns up to which a walk on Gaussians is eliminated; above it is iterated.
const MOST_ELIMINATED: usize = 2000;

/// Nodes up to which a walk that cannot be iterated is eliminated instead.
const MOST_ELIMINATED_INSTEAD: usize = 20_000;

/// Estimated error in p of a walk on Gaussians that is iterated.
pub const TOLERANCE: f64 = 1e-3;

/// Members of groups, as one list with offsets.
#[derive(Debug, Clone)]
struct Groups {
    offsets: Vec<usize>,
    members: Vec<u32>,
}

impl Groups {
    fn of(labels: &[i32], count: usize) -> Self {
        let mut offsets = vec![0; count + 1];
        for l in labels.iter().filter_map(|l| usize::try_from(*l).ok()) {
            offsets[l + 1] += 1;
        }
        for l in 0..count {
            offsets[l + 1] += offsets[l];
        }
        let mut next = offsets.clone();
        let mut members = vec![0; offsets[count]];
        for (g, l) in (0..).zip(labels) {
            if let Ok(l) = usize::try_from(*l) {
                members[next[l]] = g;
                next[l] += 1;
            }
        }
        Self { offsets, members }
    }

    fn get(&self, l: usize) -> &[u32] {
        &self.members[self.offsets[l]..self.offsets[l + 1]]
    }
}

/// Numbers about one walk.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct WalkSummary {
    /// Nodes seeded as foreground.
    pub seeds_foreground: usize,
    /// Nodes seeded as background by strokes.
    pub seeds_background: usize,
    /// Nodes hit by both brushes.
    pub conflicts: usize,
    /// Nodes that got background of their own accord: those that leak, or those chosen by the farthest rule.
    pub auto_background: usize,
    /// Nodes of the hit base units that no terminal reaches.
    pub unreached: usize,
    /// Whether the iteration on single Gaussians did not come to the tolerance, so that they were eliminated instead:
    /// exact, but slower. A line of the log says why.
    pub eliminated_instead: bool,
}

/// A walk over the nodes of a space.
#[derive(Debug, Clone)]
pub struct Walk {
    /// Probabilities.
    pub solution: Solution,
    /// What each node was.
    pub seeds: Vec<Seed>,
    /// Base units the walk took place in.
    pub units: Vec<bool>,
    /// Numbers about it.
    pub summary: WalkSummary,
    /// How good the solution is, where it was iterated; none where it was eliminated, also instead of iterated
    /// ([`WalkSummary::eliminated_instead`]).
    pub quality: Option<Quality>,
}

/// A scene made ready for selecting.
pub struct SelectionSpace {
    gaussians: usize,
    bounds: SceneBox,
    brush: Brush,
    /// Cluster of each Gaussian, or −1.
    labels: Vec<i32>,
    clusters: Groups,
    /// Node of each Gaussian in `network`, or −1: its cluster, or itself.
    nodes: Vec<i32>,
    node_unit: Vec<u32>,
    units: usize,
    network: Arc<Network>,
    /// Gaussians of each cluster, where walks run on clusters.
    mass: Vec<f64>,
    /// Normalized position of each cluster's most central Gaussian, where walks run on clusters.
    points: Vec<Option<[f64; 3]>>,
    order: Option<Vec<u32>>,
    /// Where walks are eliminated in f64: the elimination, ready for its first walk.
    elimination: Option<Elimination>,
    /// Where walks run on many single Gaussians.
    multilevel: Option<Multilevel>,
    solver: Box<dyn SystemSolver + Send + Sync>,
    options: WalkOptions,
    /// Path lengths and components for the farthest rule, where it is used.
    paths: Option<(Graph, Vec<u32>)>,
    surroundings: Option<Surroundings>,
}

impl std::fmt::Debug for SelectionSpace {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SelectionSpace")
            .field("gaussians", &self.gaussians)
            .field("nodes", &self.network.len())
            .field("options", &self.options)
            .finish_non_exhaustive()
    }
}

impl SelectionSpace {
    /// A space whose walks run on clusters.
    #[must_use]
    pub fn of_clusters(scene: &Scene, clustering: &Clustering, graph: &ClusterGraph, options: WalkOptions) -> Self {
        let network = graph.network(options.sigma_s, options.sigma_f);
        let solver = options.solver.with(options.precision);
        let order = solver
            .eliminates(network.len())
            .then(|| minimum_degree(network.len(), |u| network.links(u).iter().map(|l| l.0)));
        let paths = (options.background == Background::Farthest).then(|| {
            let edges = graph.units.iter().flatten().map(|l| Edge { a: l.u, b: l.v, length: l.length });
            (Graph::from_edges(graph.clusters, edges), graph.component.clone())
        });
        Self {
            surroundings: None,
            gaussians: scene.len(),
            bounds: scene.bounds,
            brush: Brush::of_scene(scene),
            clusters: Groups::of(&clustering.labels, clustering.clusters.len()),
            nodes: clustering.labels.clone(),
            labels: clustering.labels.clone(),
            node_unit: clustering.clusters.iter().map(|c| c.unit).collect(),
            units: scene.units.len(),
            mass: clustering.clusters.iter().map(|c| f64::from(c.size)).collect(),
            points: clustering
                .clusters
                .iter()
                .map(|c| scene.position(c.centre as usize).map(|p| scene.bounds.normalize(p).to_array()))
                .collect(),
            elimination: (options.solver == Solver::Gth && options.precision == Precision::F64)
                .then(|| Elimination::new(&network, order.clone())),
            network: Arc::new(network),
            order,
            multilevel: None,
            solver,
            options,
            paths,
        }
    }

    /// A space whose walks run on single Gaussians: exact elimination up to 2,000 of them, above it the multilevel
    /// iteration of [`sg_walk::multilevel`] to [`TOLERANCE`]. Cluster strokes still use the clusters.
    ///
    /// ε of `options` is then what each *Gaussian* leaks, taken as it is: there need be no clusters here, so there is no
    /// length H of a cluster's step to relate a Gaussian's h to, and the definition of the walk knows nothing but its own
    /// nodes. A walk with the reach of one on clusters has ε·(h/H)², which [`crate::refinement::Refiner::leak`] gives.
    #[must_use]
    pub fn of_gaussians(scene: &Scene, geometry: &Geometry, clustering: &Clustering, options: WalkOptions) -> Self {
        let network = Arc::new(gaussian_network(geometry, options.sigma_s, options.sigma_f));
        let multilevel =
            (network.len() > MOST_ELIMINATED).then(|| Multilevel::new(Arc::clone(&network), Precision::F32));
        let n = scene.len();
        let mut nodes = vec![-1; n];
        let mut node_unit = vec![0; n];
        let mut component = vec![u32::MAX; n];
        let mut first = 0;
        for (u, unit) in (0..).zip(&geometry.units) {
            for (&g, &c) in unit.vertices.gaussian.iter().zip(&unit.component) {
                nodes[g as usize] = g as i32;
                node_unit[g as usize] = u;
                component[g as usize] = first + c;
            }
            first += unit.components as u32;
        }
        let paths = (options.background == Background::Farthest).then(|| {
            let edges = geometry.units.iter().flat_map(|unit| {
                let index = &unit.vertices.gaussian;
                unit.joined().edges().map(|e| Edge { a: index[e.a as usize], b: index[e.b as usize], length: e.length })
            });
            (Graph::from_edges(n, edges), component)
        });
        Self {
            surroundings: None,
            gaussians: n,
            bounds: scene.bounds,
            brush: Brush::of_geometry(geometry),
            clusters: Groups::of(&clustering.labels, clustering.clusters.len()),
            labels: clustering.labels.clone(),
            nodes,
            node_unit,
            units: scene.units.len(),
            mass: Vec::new(),
            points: Vec::new(),
            elimination: None,
            network,
            order: None,
            multilevel,
            solver: Box::new(gth::Gth64),
            options,
            paths,
        }
    }

    /// The same, with the scene around it, which operations need.
    #[must_use]
    pub fn with_surroundings(self, surroundings: Surroundings) -> Self {
        Self { surroundings: Some(surroundings), ..self }
    }

    /// The scene, as operations look at it.
    #[must_use]
    pub fn surroundings(&self) -> Option<&Surroundings> {
        self.surroundings.as_ref()
    }

    /// Number of Gaussians.
    #[must_use]
    pub fn gaussians(&self) -> usize {
        self.gaussians
    }

    /// Number of clusters.
    #[must_use]
    pub fn clusters(&self) -> usize {
        self.clusters.offsets.len() - 1
    }

    /// Number of nodes walks run on.
    #[must_use]
    pub fn nodes(&self) -> usize {
        self.network.len()
    }

    /// The brush.
    #[must_use]
    pub fn brush(&self) -> &Brush {
        &self.brush
    }

    /// The box strokes are normalized by.
    #[must_use]
    pub fn bounds(&self) -> &SceneBox {
        &self.bounds
    }

    /// Cluster of a Gaussian, if it belongs to one.
    #[must_use]
    pub fn cluster_of(&self, gaussian: u32) -> Option<usize> {
        usize::try_from(*self.labels.get(gaussian as usize)?).ok()
    }

    /// Members of a cluster, ascending.
    #[must_use]
    pub fn members(&self, cluster: usize) -> &[u32] {
        self.clusters.get(cluster)
    }

    /// Node of a Gaussian, if it has a finite position.
    #[must_use]
    pub fn node_of(&self, gaussian: u32) -> Option<usize> {
        usize::try_from(*self.nodes.get(gaussian as usize)?).ok()
    }

    /// Base unit of a node.
    #[must_use]
    pub fn unit_of_node(&self, node: usize) -> usize {
        self.node_unit[node] as usize
    }

    /// What a stroke hits, ascending. A walk stroke that hits nothing hits the nearest Gaussian.
    #[must_use]
    pub fn hits(&self, stroke: &Stroke) -> Vec<u32> {
        let (samples, radius) = stroke.in_scene(&self.bounds);
        let behind = stroke.behind(&self.bounds);
        let hits = self.brush.hits_seen(&samples, radius, &stroke.pressure, behind);
        if hits.is_empty() { self.instead_of_nothing(stroke, &samples) } else { hits }
    }

    pub(crate) fn instead_of_nothing(&self, stroke: &Stroke, samples: &[DVec3]) -> Vec<u32> {
        match stroke.mode {
            crate::strokes::Mode::Walk => self.brush.nearest(samples).into_iter().collect(),
            _ => Vec::new(),
        }
    }

    /// The elimination that walks on clusters start from; none where they are not eliminated in f64.
    #[must_use]
    pub fn elimination(&self) -> Option<&Elimination> {
        self.elimination.as_ref()
    }

    /// How walks are set up and solved.
    #[must_use]
    pub fn options(&self) -> &WalkOptions {
        &self.options
    }

    /// The position of a cluster's most central Gaussian in normalized coordinates of the box: a walk stroke of radius 0
    /// there seeds the cluster. None where it has no Gaussian, and where walks run on single Gaussians.
    #[must_use]
    pub fn point(&self, node: usize) -> Option<[f64; 3]> {
        self.points.get(node).copied().flatten()
    }

    /// Nodes that take part in walks in these base units: those that have a Gaussian with a finite position.
    #[must_use]
    pub fn active(&self, units: &[bool]) -> Vec<bool> {
        // Nodes without a Gaussian (labels may skip an id) and Gaussians without a finite position take no part.
        let mut active = vec![false; self.network.len()];
        for node in self.nodes.iter().filter_map(|&node| usize::try_from(node).ok()) {
            active[node] = units[self.unit_of_node(node)];
        }
        active
    }

    pub(crate) fn question<'a>(&'a self, active: &'a [bool], threshold: f64) -> Question<'a> {
        Question { mass: &self.mass, active, threshold }
    }

    /// Walks from the Gaussians hit by the foreground and the background brush.
    ///
    /// A node hit by both goes with the majority of its hit Gaussians; at a tie it is unseeded. The walk takes place in
    /// the base units that were hit; elsewhere p = q = 0.
    ///
    /// # Errors
    /// [`WalkError`] if the solver breaks down.
    pub fn walk(
        &self,
        foreground: impl Iterator<Item = u32>,
        background: impl Iterator<Item = u32>,
    ) -> Result<Walk, WalkError> {
        self.walk_again(&mut self.elimination.clone(), self.options.leak, foreground, background)
    }

    /// The same with another leak than the space's own, on an elimination ([`SelectionSpace::elimination`]) that is kept
    /// between walks: only what has changed since its last walk is done again. Without one the space's solver is used.
    ///
    /// # Errors
    /// [`WalkError`] if the leak is none or the solver breaks down.
    pub fn walk_again(
        &self,
        elimination: &mut Option<Elimination>,
        leak: f64,
        foreground: impl Iterator<Item = u32>,
        background: impl Iterator<Item = u32>,
    ) -> Result<Walk, WalkError> {
        let n = self.network.len();
        let mut count = vec![[0_u32; 2]; n];
        for node in foreground.filter_map(|g| self.node_of(g)) {
            count[node][0] += 1;
        }
        for node in background.filter_map(|g| self.node_of(g)) {
            count[node][1] += 1;
        }
        let mut units = vec![false; self.units];
        let mut summary = WalkSummary::default();
        let mut seeds = vec![Seed::None; n];
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
        let active = self.active(&units);
        let mut leak = leak;
        match &self.paths {
            Some((graph, component)) => {
                leak = 0.0;
                summary.auto_background = farthest(graph, component, &active, &mut seeds);
            }
            None if leak > 0.0 => {
                let leaks = |(node, s): (usize, &Seed)| {
                    *s == Seed::None && active[node] && !self.network.links(node as u32).is_empty()
                };
                summary.auto_background = seeds.iter().enumerate().filter(|&x| leaks(x)).count();
            }
            None => {}
        }
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
                    // Too ill-conditioned to iterate: exact where that is within reach.
                    Err(e @ WalkError::Breakdown { .. }) if n <= MOST_ELIMINATED_INSTEAD => {
                        tracing::warn!(nodes = n, reason = %e, "a walk could not be iterated and is eliminated instead");
                        summary.eliminated_instead = true;
                        let problem = Problem { network: &self.network, seeds: &seeds, leak, leaking: Some(&active) };
                        solve(&problem, self.solver.as_ref(), None)?
                    }
                    Err(e) => return Err(e),
                }
            }
            (None, None) => {
                let problem = Problem { network: &self.network, seeds: &seeds, leak, leaking: Some(&active) };
                solve(&problem, self.solver.as_ref(), self.order.as_deref())?
            }
        };
        summary.unreached = (0..n).filter(|&node| active[node] && !solution.reached[node]).count();
        Ok(Walk { solution, seeds, units, summary, quality })
    }
}

/// Makes the farthest nodes background: of each component that is walked in, a twentieth (rounded up) of its nodes, by
/// the path length from the foreground, ties to the smaller id. Without foreground there is no farthest. Returns how many.
fn farthest(graph: &Graph, component: &[u32], active: &[bool], seeds: &mut [Seed]) -> usize {
    let sources: Vec<u32> = (0..).zip(&*seeds).filter(|(_, s)| **s == Seed::Foreground).map(|(u, _)| u).collect();
    if sources.is_empty() {
        return 0;
    }
    let (distance, _) = nearest_source(graph, &sources);
    let components = component.iter().filter(|c| **c != u32::MAX).max().map_or(0, |c| *c as usize + 1);
    let mut nodes: Vec<Vec<u32>> = vec![Vec::new(); components];
    for (u, &c) in (0..).zip(component) {
        if active[u as usize] && c != u32::MAX {
            nodes[c as usize].push(u);
        }
    }
    let mut chosen = 0;
    for mut nodes in nodes {
        let quota = (FARTHEST_SHARE * nodes.len() as f64).ceil() as usize;
        nodes.retain(|&u| seeds[u as usize] == Seed::None && distance[u as usize].is_finite());
        nodes.sort_by(|&a, &b| distance[b as usize].total_cmp(&distance[a as usize]).then(a.cmp(&b)));
        for &u in nodes.iter().take(quota) {
            seeds[u as usize] = Seed::Background;
            chosen += 1;
        }
    }
    chosen
}

#[cfg(test)]
mod tests;
