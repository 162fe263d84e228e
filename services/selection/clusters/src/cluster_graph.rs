//! The weighted graph of clusters.
//!
//! An edge compares two clusters by g, a distance in the scene, and by δ, the distance of their mean features. The
//! conductance is w = exp(−(g/σ_s)² − (δ/σ_f)² − (c⁺/κ)²). The scales σ_s and σ_f are medians over the edges. c⁺ is the
//! concavity of the contact ([`crate::creases`]); without κ its term is absent, as in the paper.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use sprs::CsMatI;

use crate::bridges::bridges;
use crate::clustering::{Cluster, Clustering};
use crate::creases::{concavity, mean_concavity, outward_normals};
use crate::features::{FeatureKind, WIDTH, median};
use crate::geometry::{Geometry, UnitGeometry};
use crate::neighbours::{Edge, Graph, GraphError, neighbour_graph, symmetric};
use crate::shortest::{Search, SearchPool, nearest_source};
use crate::vertices::{Vertices, distance_squared};
use sg_walk::{Conductance, Network};

/// Edges of the cluster graph, and their distances g.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum GraphForm {
    /// Edges between touching clusters, with geodesic distance: g = min of d(c_u, a) + ‖ab‖ + d(b, c_v).
    ///
    /// The minimum runs over the neighbour pairs (a, b) across the border. d is the path length inside the cluster.
    #[default]
    Contact,
    /// The literal form of the paper: the k nearest clusters by mean position. g is the distance along this graph, so on an
    /// edge it is the straight-line distance.
    Printed,
    /// Edges between all pairs of clusters of a base unit. g is the shortest path over the contact graph.
    AllPairs,
    /// Edges between touching clusters, with straight-line distance.
    Euclidean,
}

/// The distances between two clusters of a base unit.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Distances {
    /// g, in the scene's length unit.
    pub length: f64,
    /// δ, the feature distance. Each feature block (scale, normal, shape) is in units of its spread over the clusters.
    pub feature: f64,
    /// c⁺, the concavity of the contact, 0 to 2. It is 0 where the clusters do not touch or have no normals with a sign.
    pub crease: f64,
}

/// An edge between two clusters of a base unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Link {
    /// The smaller id.
    pub u: u32,
    /// The larger id.
    pub v: u32,
    /// The distances between the two.
    pub distances: Distances,
}

/// The graph of a scene's clusters, one sparse matrix per base unit.
#[derive(Debug, Clone, PartialEq)]
pub struct ClusterGraph {
    /// Number of clusters.
    pub clusters: usize,
    /// The edges of each base unit: a symmetric matrix over all clusters. Entry (u, v) compares the clusters u and v.
    pub units: Vec<CsMatI<Distances, u32>>,
    /// Connected component of each cluster's centre in the neighbour graph without bridges. Numbers are unique over all base
    /// units.
    pub component: Vec<u32>,
}

impl ClusterGraph {
    /// Builds the graph in one of the forms.
    ///
    /// # Errors
    /// [`GraphError`] if the neighbour search of the printed form fails.
    pub fn new(geometry: &Geometry, clustering: &Clustering, form: GraphForm) -> Result<Self, GraphError> {
        let mut units = Vec::with_capacity(geometry.units.len());
        let mut component = vec![u32::MAX; clustering.clusters.len()];
        let mut first_component = 0;
        for (u, unit) in (0..).zip(&geometry.units) {
            let ids: Vec<u32> =
                (0..).zip(&clustering.clusters).filter(|(_, c)| c.unit == u && c.size > 0).map(|(i, _)| i).collect();
            let clusters = &clustering.clusters;
            let touching = contacts(unit, clustering, &ids);
            let creases: Vec<((u32, u32), f64)> = touching.iter().map(|t| ((t.u, t.v), t.crease)).collect();
            let crease = |a: u32, b: u32| match creases.binary_search_by_key(&(a, b), |c| c.0) {
                Ok(at) => creases[at].1,
                Err(_) => 0.0,
            };
            let lengths: Lengths = match form {
                GraphForm::Contact => touching.iter().map(|t| (t.u, t.v, t.length)).collect(),
                GraphForm::Printed => nearest_centres(clusters, &ids, geometry.neighbours)?,
                GraphForm::AllPairs => all_pairs(&touching, clusters.len(), &ids),
                GraphForm::Euclidean => touching.iter().map(|t| (t.u, t.v, straight(clusters, t.u, t.v))).collect(),
            };
            let features = ids.iter().map(|&i| clusters[i as usize].feature).collect();
            let features = block_scaled(features, unit.features.kind);
            let row = |i: u32| ids.binary_search(&i).ok().map(|at| &features[at]);
            let entries: Vec<(u32, u32, Distances)> = lengths
                .into_par_iter()
                .with_min_len(4096)
                .map(|(a, b, length)| {
                    (a, b, Distances { length, feature: distance(row(a), row(b)), crease: crease(a, b) })
                })
                .collect();
            units.push(symmetric(clusters.len(), &entries));
            let vertex_of = centre_vertices(unit, clusters, &ids);
            for (&i, v) in ids.iter().zip(vertex_of) {
                component[i as usize] = first_component + v.map_or(0, |v| unit.component[v as usize]);
            }
            first_component += unit.components as u32;
        }
        Ok(Self { clusters: clustering.clusters.len(), units, component })
    }

    /// The weighted graph. σ_s and σ_f are the medians over the edges of each base unit times the given factors. `crease` is κ,
    /// above 0; `None` leaves creases out.
    #[must_use]
    pub fn network(&self, sigma_s: f64, sigma_f: f64, crease: Option<f64>) -> Network {
        let mut edges = Vec::new();
        for unit in &self.units {
            let s = sigma_s * typical(links(unit).map(|l| l.distances.length));
            let f = sigma_f * typical(links(unit).map(|l| l.distances.feature));
            edges.extend(links(unit).map(|l| {
                let plain = weight(l.distances.length, s, l.distances.feature, f);
                let bent = crease.map_or(0.0, |kappa| (l.distances.crease / kappa).powi(2));
                (l.u, l.v, if bent > 0.0 { plain * Conductance::exp(-bent) } else { plain })
            }));
        }
        Network::new(self.clusters, edges.into_iter())
    }

    /// The graph with those edges alone that `keep` is true of, by the ids of both clusters. Clusters and components stay.
    #[must_use]
    pub fn keeping(&self, keep: impl Fn(u32, u32) -> bool) -> Self {
        let kept = |unit: &CsMatI<Distances, u32>| {
            let edges: Vec<_> = links(unit).filter(|l| keep(l.u, l.v)).map(|l| (l.u, l.v, l.distances)).collect();
            symmetric(self.clusters, &edges)
        };
        Self {
            clusters: self.clusters,
            units: self.units.iter().map(kept).collect(),
            component: self.component.clone(),
        }
    }

    /// Every edge of all base units once, unit after unit, ascending by (u, v).
    pub fn links(&self) -> impl Iterator<Item = Link> + '_ {
        self.units.iter().flat_map(links)
    }

    /// The graph of the distances g.
    #[must_use]
    pub fn lengths(&self) -> Graph {
        let edges = self.links().map(|l| Edge { a: l.u, b: l.v, length: l.distances.length });
        Graph::from_edges(self.clusters, edges)
    }
}

/// Every edge of a base unit once, ascending by (u, v): the upper triangle of its matrix.
pub fn links(unit: &CsMatI<Distances, u32>) -> impl Iterator<Item = Link> + '_ {
    (0..).zip(unit.outer_iterator()).flat_map(|(u, row)| {
        let (columns, entries) = row.into_raw_storage();
        let later = columns.partition_point(|&v| v < u);
        let pairs = columns[later..].iter().zip(&entries[later..]);
        pairs.map(move |(&v, &distances)| Link { u, v, distances })
    })
}

/// exp(−(length/s)² − (feature/f)²). A spread of zero means equal values, so its term is dropped.
pub fn weight(length: f64, s: f64, feature: f64, f: f64) -> Conductance {
    Conductance::exp(-term(length, s) - term(feature, f))
}

/// (x/σ)², or 0 for a spread of zero.
pub(crate) fn term(x: f64, sigma: f64) -> f64 {
    if sigma > 0.0 { (x / sigma).powi(2) } else { 0.0 }
}

/// The median, or the mean if the median is zero.
pub fn typical(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    match median(&mut values) {
        Some(m) if m > 0.0 => m,
        _ => values.iter().sum::<f64>() / values.len().max(1) as f64,
    }
}

fn straight(clusters: &[Cluster], a: u32, b: u32) -> f64 {
    distance_squared(&clusters[a as usize].position, &clusters[b as usize].position).sqrt()
}

fn distance(a: Option<&[f64; WIDTH]>, b: Option<&[f64; WIDTH]>) -> f64 {
    match (a, b) {
        (Some(a), Some(b)) => a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt(),
        _ => 0.0,
    }
}

/// Features with each block in units of its root mean square deviation over the rows.
///
/// A rotation mixes the columns of a block and keeps its length, so columns are not scaled alone. Constant blocks are
/// dropped.
fn block_scaled(mut rows: Vec<[f64; WIDTH]>, kind: FeatureKind) -> Vec<[f64; WIDTH]> {
    let n = rows.len().max(1) as f64;
    for block in kind.blocks() {
        let mut variance = 0.0;
        let mut size = 0.0_f64;
        for c in block.clone() {
            let mean = rows.iter().map(|r| r[c]).sum::<f64>() / n;
            variance += rows.iter().map(|r| (r[c] - mean).powi(2)).sum::<f64>() / n;
            size = rows.iter().fold(size, |m, r| m.max(r[c].abs()));
        }
        let spread = variance.sqrt();
        // Rows are means of f32 numbers: a spread below their rounding counts as zero.
        let factor = if spread > 1e-6 * size { 1.0 / spread } else { 0.0 };
        for row in &mut rows {
            for x in &mut row[block.clone()] {
                *x *= factor;
            }
        }
    }
    rows
}

/// The vertex of each cluster's centre.
fn centre_vertices(unit: &UnitGeometry, clusters: &[Cluster], ids: &[u32]) -> Vec<Option<u32>> {
    let mut vertex: Vec<(u32, u32)> = unit.vertices.gaussian.iter().copied().zip(0..).collect();
    vertex.par_sort_unstable();
    ids.iter()
        .map(|&i| {
            let centre = clusters[i as usize].centre;
            vertex.binary_search_by_key(&centre, |e| e.0).ok().map(|at| vertex[at].1)
        })
        .collect()
}

/// Edges (a, b, g) with a < b, ascending.
type Lengths = Vec<(u32, u32, f64)>;

/// Two clusters that touch, with `u` < `v`.
struct Contact {
    u: u32,
    v: u32,
    /// See [`GraphForm::Contact`].
    length: f64,
    crease: f64,
}

/// A neighbour pair across the border of the clusters u < v.
struct Crossing {
    between: (u32, u32),
    /// Length of the way from centre to centre over this pair.
    way: f64,
    /// Distance of the two Gaussians.
    apart: f64,
    concavity: f64,
}

/// The contacts of a unit's clusters, ascending.
fn contacts(unit: &UnitGeometry, clustering: &Clustering, ids: &[u32]) -> Vec<Contact> {
    let graph = unit.joined();
    let label: Vec<i32> = unit.vertices.gaussian.iter().map(|&g| clustering.labels[g as usize]).collect();
    let centres = centre_vertices(unit, &clustering.clusters, ids);
    // Clusters from outside may be disconnected. Their far parts count with the straight-line distance.
    let mut inside: Vec<f64> = unit
        .vertices
        .position
        .par_iter()
        .zip(&label)
        .map(|(p, &l)| match usize::try_from(l).ok().and_then(|l| clustering.clusters.get(l)) {
            Some(c) => distance_squared(p, &c.position).sqrt(),
            None => 0.0,
        })
        .collect();
    let pool = SearchPool::default();
    let found: Vec<Vec<(u32, f64)>> = ids
        .par_iter()
        .zip(&centres)
        .map(|(&i, centre)| match centre {
            Some(v) => pool.with(|search: &mut Search| {
                let own = i as i32;
                search.reach(&graph, *v, |w| if label[w as usize] == own { f64::INFINITY } else { -1.0 }).to_vec()
            }),
            None => Vec::new(),
        })
        .collect();
    for (v, d) in found.into_iter().flatten() {
        inside[v as usize] = d;
    }
    let normals = outward_normals(unit);
    let bent = |a: u32, b: u32| match (normals.get(a as usize), normals.get(b as usize)) {
        (Some(m), Some(n)) => concavity([*m, *n], [a, b].map(|v| unit.vertices.position[v as usize])),
        _ => 0.0,
    };
    let mut crossing: Vec<Crossing> = (0..graph.len() as u32)
        .into_par_iter()
        .with_min_len(256)
        .flat_map_iter(|a| {
            let (label, inside, bent) = (&label, &inside, &bent);
            graph.neighbours(a).filter_map(move |(b, apart)| {
                let (u, v) = (label[a as usize], label[b as usize]);
                (u >= 0 && v > u).then(|| Crossing {
                    between: (u as u32, v as u32),
                    way: inside[a as usize] + apart + inside[b as usize],
                    apart,
                    concavity: bent(a, b),
                })
            })
        })
        .collect();
    // Equal distances are ordered by concavity, so that the sum does not depend on the order of the vertices.
    crossing.par_sort_unstable_by(|x, y| {
        let near = x.apart.total_cmp(&y.apart).then(x.concavity.total_cmp(&y.concavity));
        x.between.cmp(&y.between).then(near)
    });
    let touching = crossing.chunk_by(|x, y| x.between == y.between);
    touching
        .map(|pairs| Contact {
            u: pairs[0].between.0,
            v: pairs[0].between.1,
            length: pairs.iter().map(|c| c.way).fold(f64::INFINITY, f64::min),
            crease: mean_concavity(pairs.iter().map(|c| (c.apart, c.concavity))),
        })
        .collect()
}

/// The k nearest clusters by mean position, symmetric, with bridges between components.
///
/// No path is shorter than the straight line, so the shortest path between the ends of an edge is the edge itself.
fn nearest_centres(clusters: &[Cluster], ids: &[u32], k: usize) -> Result<Lengths, GraphError> {
    let points = Vertices::ordered(ids.iter().map(|&i| (i, clusters[i as usize].position)).collect());
    let graph = neighbour_graph(&points, k)?;
    let joining = bridges(&points, &graph);
    let mut lengths: Lengths = graph
        .edges()
        .chain(joining)
        .map(|e| {
            let (a, b) = (points.gaussian[e.a as usize], points.gaussian[e.b as usize]);
            (a.min(b), a.max(b), e.length)
        })
        .collect();
    lengths.sort_unstable_by(|x, y| (x.0, x.1).cmp(&(y.0, y.1)).then(x.2.total_cmp(&y.2)));
    lengths.dedup_by(|later, first| (later.0, later.1) == (first.0, first.1));
    Ok(lengths)
}

fn all_pairs(contacts: &[Contact], clusters: usize, ids: &[u32]) -> Lengths {
    let graph = Graph::from_edges(clusters, contacts.iter().map(|c| Edge { a: c.u, b: c.v, length: c.length }));
    let pool = SearchPool::default();
    ids.par_iter()
        .flat_map_iter(|&u| {
            let mut found = pool.with(|s| s.reach(&graph, u, |_| f64::INFINITY).to_vec());
            found.sort_unstable_by_key(|f| f.0);
            found.into_iter().filter(move |f| f.0 > u).map(move |(v, d)| (u, v, d))
        })
        .collect()
}

/// Length of the shortest path from any source to each node; infinite for unreachable nodes.
#[must_use]
pub fn path_lengths(graph: &ClusterGraph, sources: &[u32]) -> Vec<f64> {
    nearest_source(&graph.lengths(), sources).0
}

/// The weighted graph of single Gaussians. Nodes are scene-wide indices; edges come from the neighbour graphs and bridges.
///
/// Weights are as for clusters, with medians over the edges of each base unit.
#[must_use]
pub fn gaussian_network(geometry: &Geometry, sigma_s: f64, sigma_f: f64) -> Network {
    let mut edges = Vec::new();
    for unit in &geometry.units {
        let rows = unit.features.rows.par_iter().map(|r| r.map(f64::from)).collect();
        let rows = block_scaled(rows, unit.features.kind);
        let found: Vec<(Edge, f64)> = unit
            .joined()
            .edges()
            .map(|e| (e, distance(Some(&rows[e.a as usize]), Some(&rows[e.b as usize]))))
            .collect();
        let s = sigma_s * typical(found.iter().map(|(e, _)| e.length));
        let f = sigma_f * typical(found.iter().map(|(_, feature)| *feature));
        let index = &unit.vertices.gaussian;
        edges.extend(
            found
                .iter()
                .map(|(e, feature)| (index[e.a as usize], index[e.b as usize], weight(e.length, s, *feature, f))),
        );
    }
    Network::new(geometry.gaussians, edges.into_iter())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clustering::{ClusteringOptions, cluster};
    use crate::geometry::GeometryOptions;
    use crate::progress::Silent;
    use sg_scene::model::Scene;
    use sg_scene::synthetic::{point_scene, random_points, vessel_and_sac};

    fn clustered(scene: &Scene, most: usize) -> (Geometry, Clustering) {
        let geometry = Geometry::of_scene(scene, GeometryOptions::default(), &Silent).unwrap();
        let options = ClusteringOptions { max_clusters: most, ..ClusteringOptions::default() };
        let (clustering, _) = cluster(&geometry, &options, &Silent).unwrap();
        (geometry, clustering)
    }

    #[test]
    fn every_form_joins_all_clusters_of_a_unit() {
        let mut points = random_points(1500, 1);
        points.extend(random_points(300, 2).iter().map(|p| p.map(|x| x + 5.0)));
        let (geometry, clustering) = clustered(&point_scene(&points), 60);
        assert_eq!(geometry.units[0].components, 2);
        for form in [GraphForm::Contact, GraphForm::Printed, GraphForm::AllPairs, GraphForm::Euclidean] {
            let graph = ClusterGraph::new(&geometry, &clustering, form).unwrap();
            assert_eq!(graph.lengths().components().1, 1, "{form:?}");
            assert!(sprs::is_symmetric(&graph.units[0]));
            let finite = |d: &Distances| d.length.is_finite() && d.feature.is_finite();
            assert!(graph.links().all(|l| l.u < l.v && finite(&l.distances)));
            let listed: Vec<_> = graph.links().map(|l| (l.u, l.v, l.distances)).collect();
            assert!(listed.is_sorted_by_key(|l| (l.0, l.1)) && 2 * listed.len() == graph.units[0].nnz());
            assert_eq!(symmetric(graph.clusters, &listed), graph.units[0]);
            let distinct: std::collections::BTreeSet<u32> = graph.component.iter().copied().collect();
            assert_eq!(distinct.len(), 2);
        }
    }

    #[test]
    fn contact_lengths_go_along_the_surface_and_the_printed_ones_do_not() {
        let (scene, _) = vessel_and_sac(6000, 3);
        let (geometry, clustering) = clustered(&scene, 150);
        let contact = ClusterGraph::new(&geometry, &clustering, GraphForm::Contact).unwrap();
        let euclidean = ClusterGraph::new(&geometry, &clustering, GraphForm::Euclidean).unwrap();
        for (a, b) in contact.links().zip(euclidean.links()) {
            assert_eq!((a.u, a.v), (b.u, b.v));
            // Between the centres' Gaussians no path is shorter than the straight line; mean positions lie off them.
            let ends = [a.u, a.v].map(|c| scene.position(clustering.clusters[c as usize].centre as usize).unwrap());
            assert!(a.distances.length >= (ends[0] - ends[1]).length() * (1.0 - 1e-9));
        }
        // The printed form: shortest paths along the centre graph between ends of an edge are the edges themselves.
        let printed = ClusterGraph::new(&geometry, &clustering, GraphForm::Printed).unwrap();
        let graph = printed.lengths();
        let mut search = Search::default();
        for l in printed.links() {
            let along = search.reach(&graph, l.u, |_| f64::INFINITY).iter().find(|r| r.0 == l.v).unwrap().1;
            let length = l.distances.length;
            assert!((along - length).abs() <= 1e-12 * length, "{along} against {length}");
        }
    }

    #[test]
    fn blocks_that_do_not_vary_are_left_out() {
        let rows = (0..5)
            .map(|i| {
                let mut r = [0.1; WIDTH];
                r[0] = f64::from(i);
                r[2] += 1e-17 * f64::from(i);
                r
            })
            .collect();
        let scaled = block_scaled(rows, FeatureKind::Invariant);
        assert!(scaled.iter().all(|r| r[1..13].iter().all(|x| *x == 0.0)));
        let square: f64 = scaled.iter().map(|r| (r[0] - scaled[2][0]).powi(2)).sum::<f64>() / 5.0;
        assert!((square - 1.0).abs() < 1e-12);
    }
}
