//! Regions of Super-Gaussians at every scale: a hierarchy that merges the pair that holds together best.
//!
//! Two regions A and B hold together by s = W(A, B) / min(vol A, vol B). W is the weight of the edges between them, vol the weight
//! of all edges at their clusters, each counted at both ends. So s is the share of the lesser one's weight that leads to the
//! other. The pair with the greatest s becomes one region, until no two touch. Merging by similarity is the way of selective
//! search (Uijlings et al. 2013); the score is that of a normalized cut (Shi and Malik 2000).
//!
//! A region stands out where its halves hold together better than it does with its next partner. Its prominence is
//! 1 − s(next) / s(own). Most regions are small. So that large ones are not crowded out, each octave of sizes gives as many.
//!
//! A second hierarchy merges by colour alone. A painted part of a smooth surface is a region of it.

use std::cmp::{Ordering, Reverse};
use std::collections::{BTreeMap, BinaryHeap};

use sprs::CsMatI;

use crate::cluster_graph::{ClusterGraph, Distances, Link, links, term, typical};
use crate::creases::CREASE;
use crate::vertices::distance_squared;

/// Least difference of colours between neighbours for a hierarchy by colour.
const LEAST_COLOR_STEP: f64 = 0.05;

/// Difference of mean colours in Oklab at which a weight falls to 1/e. Eyes tell such colours apart at once.
pub const COLOR_SCALE: f64 = 0.1;

/// Parameters of the hierarchy.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HierarchyOptions {
    /// Factor on σ_s, as in [`ClusterGraph::network`].
    pub sigma_s: f64,
    /// Factor on σ_f.
    pub sigma_f: f64,
    /// κ of creases; `None` leaves them out.
    pub crease: Option<f64>,
    /// Least share of a region in the Gaussians of its base unit.
    pub least: f64,
    /// Greatest share. A region above it is the unit itself.
    pub most: f64,
}

impl Default for HierarchyOptions {
    fn default() -> Self {
        Self { sigma_s: 1.0, sigma_f: 1.0, crease: Some(CREASE), least: 0.002, most: 0.9 }
    }
}

impl HierarchyOptions {
    /// The options of a hierarchy by colour alone.
    #[must_use]
    pub fn by_color() -> Self {
        Self { sigma_s: f64::INFINITY, sigma_f: f64::INFINITY, crease: None, ..Self::default() }
    }
}

/// What the hierarchy knows of a cluster beside its edges.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClusterLook {
    /// Its base unit, counted from 0.
    pub unit: u32,
    /// Number of its Gaussians. A cluster without any belongs to no region.
    pub gaussians: u64,
    /// Their mean colour in Oklab.
    pub color: [f64; 3],
}

/// A connected region of whole clusters of one base unit.
#[derive(Debug, Clone, PartialEq)]
pub struct ClusterRegion {
    /// Its clusters, ascending. A single one touches no other.
    pub clusters: Vec<u32>,
    /// Number of its Gaussians.
    pub gaussians: u64,
    /// How much it stands out, 0 to 1. A region that touches nothing else has 1.
    pub prominence: f64,
}

/// A node of the tree.
struct Node {
    volume: f64,
    gaussians: u64,
    neighbours: BTreeMap<u32, f64>,
    halves: Option<(u32, u32)>,
    /// s of its halves.
    own: f64,
    /// s with its next partner; 0 without one.
    next: f64,
    is_merged: bool,
}

/// The regions that stand out most at every size, at most `count`, the most prominent first. Any two are nested or apart. `looks` are
/// those of the clusters of the graph, in their order.
#[must_use]
pub fn regions(
    graph: &ClusterGraph,
    looks: &[ClusterLook],
    options: HierarchyOptions,
    count: usize,
) -> Vec<ClusterRegion> {
    regions_of(graph, looks, options, count, |_| true)
}

/// As [`regions`], of the base units alone that `takes` is true of, by their edges.
fn regions_of(
    graph: &ClusterGraph,
    looks: &[ClusterLook],
    options: HierarchyOptions,
    count: usize,
    takes: impl Fn(&CsMatI<Distances, u32>) -> bool,
) -> Vec<ClusterRegion> {
    let mut of_units: Vec<Vec<u32>> = vec![Vec::new(); graph.units.len()];
    for (id, look) in (0..).zip(looks) {
        if let Some(ids) = of_units.get_mut(look.unit as usize) {
            ids.push(id);
        }
    }
    let units = graph.units.iter().zip(&of_units).filter(|(edges, _)| takes(edges));
    let found: Vec<SizedRegion> = units.flat_map(|(edges, ids)| of_unit(edges, ids, looks, options)).collect();
    let mut found = at_every_size(found, count);
    found.sort_by(by_prominence);
    found
}

/// The regions of both hierarchies, at most `count`, the most prominent first. Two regions of the same one are nested or apart. A unit
/// of one colour has no hierarchy by colour.
#[must_use]
pub fn diverse_regions(graph: &ClusterGraph, looks: &[ClusterLook], count: usize) -> Vec<ClusterRegion> {
    let color = |id: u32| looks.get(id as usize).map_or([0.0; 3], |look| look.color);
    let is_step = |l: Link| distance_squared(&color(l.u), &color(l.v)) >= LEAST_COLOR_STEP.powi(2);
    let is_colored = |unit: &CsMatI<Distances, u32>| links(unit).any(is_step);
    if !graph.units.iter().any(is_colored) {
        return regions(graph, looks, HierarchyOptions::default(), count);
    }
    let mut found = regions(graph, looks, HierarchyOptions::default(), count.div_ceil(2));
    let by_color = regions_of(graph, looks, HierarchyOptions::by_color(), count / 2, is_colored);
    let more: Vec<ClusterRegion> =
        by_color.into_iter().filter(|region| found.iter().all(|f| f.clusters != region.clusters)).collect();
    found.extend(more);
    found.sort_by(by_prominence);
    found
}

/// A region with its share in the Gaussians of its base unit.
struct SizedRegion {
    region: ClusterRegion,
    share: f64,
}

/// The more prominent one first. The order of the clusters settles ties.
fn by_prominence(a: &ClusterRegion, b: &ClusterRegion) -> Ordering {
    b.prominence.total_cmp(&a.prominence).then_with(|| a.clusters.cmp(&b.clusters))
}

/// As many regions of each octave of sizes as there are, up to `count` together, the most prominent ones of each.
fn at_every_size(found: Vec<SizedRegion>, count: usize) -> Vec<ClusterRegion> {
    let mut octaves: BTreeMap<i32, Vec<ClusterRegion>> = BTreeMap::new();
    for SizedRegion { region, share } in found {
        octaves.entry(share.log2().floor() as i32).or_default().push(region);
    }
    let mut ranked: Vec<(usize, ClusterRegion)> = Vec::new();
    for mut octave in octaves.into_values() {
        octave.sort_by(by_prominence);
        ranked.extend(octave.into_iter().enumerate());
    }
    ranked.sort_by(|a, b| a.0.cmp(&b.0).then_with(|| by_prominence(&a.1, &b.1)));
    ranked.into_iter().take(count).map(|(_, region)| region).collect()
}

/// The regions of a base unit with the clusters `ids`, ascending.
fn of_unit(
    edges: &CsMatI<Distances, u32>,
    ids: &[u32],
    looks: &[ClusterLook],
    options: HierarchyOptions,
) -> Vec<SizedRegion> {
    let tree = merged(edges, ids, looks, options);
    let all: u64 = tree.iter().take(ids.len()).map(|node| node.gaussians).sum();
    let share = |node: &Node| node.gaussians as f64 / all.max(1) as f64;
    let is_apart = |node: &Node| node.volume == 0.0 && node.gaussians > 0;
    let is_region = |(_, node): &(usize, &Node)| {
        (node.halves.is_some() || is_apart(node)) && (options.least..=options.most).contains(&share(node))
    };
    let region = |(at, node): (usize, &Node)| {
        let held = if node.own > 0.0 { node.next / node.own } else { node.next };
        let region = ClusterRegion {
            clusters: leaves(&tree, at).into_iter().filter_map(|leaf| ids.get(leaf).copied()).collect(),
            gaussians: node.gaussians,
            prominence: (1.0 - held).clamp(0.0, 1.0),
        };
        SizedRegion { region, share: share(node) }
    };
    tree.iter().enumerate().filter(is_region).map(region).collect()
}

/// The tree of a base unit: its clusters first, then each merge.
fn merged(edges: &CsMatI<Distances, u32>, ids: &[u32], looks: &[ClusterLook], options: HierarchyOptions) -> Vec<Node> {
    let leaf = |id: &u32| Node {
        volume: 0.0,
        gaussians: looks.get(*id as usize).map_or(0, |look| look.gaussians),
        neighbours: BTreeMap::new(),
        halves: None,
        own: 0.0,
        next: 0.0,
        is_merged: false,
    };
    let mut nodes: Vec<Node> = ids.iter().map(leaf).collect();
    let local = |id: u32| ids.binary_search(&id).ok().map(|at| at as u32);
    for (u, v, weight) in weights(edges, looks, options) {
        let (Some(u), Some(v)) = (local(u), local(v)) else { continue };
        for (a, b) in [(u, v), (v, u)] {
            let node = &mut nodes[a as usize];
            node.volume += weight;
            node.neighbours.insert(b, weight);
        }
    }
    let score =
        |nodes: &[Node], a: u32, b: u32, weight: f64| weight / nodes[a as usize].volume.min(nodes[b as usize].volume);
    // Numbers that are not negative are ordered as their bits are.
    let entry = |s: f64, a: u32, b: u32| (s.to_bits(), Reverse((a.min(b), a.max(b))));
    let pairs = (0..).zip(&nodes).flat_map(|(a, node)| node.neighbours.range(a..).map(move |(b, w)| (a, *b, *w)));
    let mut queue: BinaryHeap<_> = pairs.map(|(a, b, w)| entry(score(&nodes, a, b, w), a, b)).collect();
    while let Some((bits, Reverse((a, b)))) = queue.pop() {
        if nodes[a as usize].is_merged || nodes[b as usize].is_merged {
            continue;
        }
        let (id, own) = (nodes.len() as u32, f64::from_bits(bits));
        let joined = join(&mut nodes, (a, b), own);
        for (neighbour, weight) in &joined.neighbours {
            let other = &mut nodes[*neighbour as usize].neighbours;
            other.remove(&a);
            other.remove(&b);
            other.insert(id, *weight);
        }
        nodes.push(joined);
        let neighbours = nodes[id as usize].neighbours.iter();
        queue.extend(neighbours.map(|(n, w)| entry(score(&nodes, id, *n, *w), *n, id)).collect::<Vec<_>>());
    }
    nodes
}

/// The node of two others, which end.
fn join(nodes: &mut [Node], (a, b): (u32, u32), own: f64) -> Node {
    let mut halves = [a, b].map(|half| {
        let node = &mut nodes[half as usize];
        (node.is_merged, node.next) = (true, own);
        (node.volume, node.gaussians, std::mem::take(&mut node.neighbours))
    });
    // The lesser list goes into the greater one.
    halves.sort_by_key(|half| half.2.len());
    let [(volume, gaussians, few), (other_volume, other_gaussians, mut neighbours)] = halves;
    for (neighbour, weight) in few {
        *neighbours.entry(neighbour).or_default() += weight;
    }
    neighbours.remove(&a);
    neighbours.remove(&b);
    Node {
        volume: volume + other_volume,
        gaussians: gaussians + other_gaussians,
        neighbours,
        halves: Some((a, b)),
        own,
        next: 0.0,
        is_merged: false,
    }
}

/// The edges of a unit with a weight above 0.
fn weights(edges: &CsMatI<Distances, u32>, looks: &[ClusterLook], options: HierarchyOptions) -> Vec<(u32, u32, f64)> {
    let s = options.sigma_s * typical(links(edges).map(|l| l.distances.length));
    let f = options.sigma_f * typical(links(edges).map(|l| l.distances.feature));
    let existing = |id: u32| looks.get(id as usize).filter(|look| look.gaussians > 0);
    let existing = links(edges).filter_map(|l| Some((l, existing(l.u)?, existing(l.v)?)));
    let edges = existing.map(|(l, a, b)| {
        let Distances { length, feature, crease } = l.distances;
        let difference = distance_squared(&a.color, &b.color);
        let bent = options.crease.map_or(0.0, |kappa| term(crease, kappa));
        let exponent = term(length, s) + term(feature, f) + bent + difference / COLOR_SCALE.powi(2);
        (l.u, l.v, (-exponent).exp())
    });
    edges.filter(|(_, _, weight)| *weight > 0.0).collect()
}

/// The places of the clusters below a node, ascending.
fn leaves(tree: &[Node], at: usize) -> Vec<usize> {
    let (mut open, mut places) = (vec![at], Vec::new());
    while let Some(place) = open.pop() {
        match tree.get(place).and_then(|node| node.halves) {
            Some((a, b)) => open.extend([a as usize, b as usize]),
            None => places.push(place),
        }
    }
    places.sort_unstable();
    places
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::neighbours::symmetric;

    fn graph(clusters: usize, edges: &[(u32, u32, f64)]) -> ClusterGraph {
        let entry = |(u, v, length): &(u32, u32, f64)| (*u, *v, Distances { length: *length, ..Distances::default() });
        let mut entries: Vec<_> = edges.iter().map(entry).collect();
        entries.sort_by_key(|(u, v, _)| (*u, *v));
        ClusterGraph { clusters, units: vec![symmetric(clusters, &entries)], component: vec![0; clusters] }
    }

    fn looks(colors: &[[f64; 3]]) -> Vec<ClusterLook> {
        colors.iter().map(|color| ClusterLook { unit: 0, gaussians: 10, color: *color }).collect()
    }

    fn found(graph: &ClusterGraph, colors: &[[f64; 3]]) -> Vec<ClusterRegion> {
        regions(graph, &looks(colors), HierarchyOptions::default(), 64)
    }

    /// Two triangles that one long edge joins.
    fn dumbbell() -> ClusterGraph {
        let short = [(0, 1), (0, 2), (1, 2), (3, 4), (3, 5), (4, 5)].map(|(u, v)| (u, v, 1.0));
        graph(6, &[&short[..], &[(2, 3, 3.0)]].concat())
    }

    #[test]
    fn two_groups_that_hardly_touch_are_regions() {
        let found = found(&dumbbell(), &[[0.0; 3]; 6]);
        let mut best: Vec<_> = found.iter().take(2).map(|region| region.clusters.clone()).collect();
        best.sort();
        assert_eq!(best, [vec![0, 1, 2], vec![3, 4, 5]], "{found:?}");
        assert!(found[0].prominence > 0.9 && (found[0].gaussians, found[1].gaussians) == (30, 30), "{found:?}");
        assert!(found.iter().all(|region| region.clusters.len() < 6), "the whole is the unit: {found:?}");
    }

    #[test]
    fn scores_are_those_of_the_definition() {
        // Weights e^-1 for both edges of a chain: the median length is 1.
        let chain = graph(3, &[(0, 1, 1.0), (1, 2, 1.0)]);
        let tree = merged(&chain.units[0], &[0, 1, 2], &looks(&[[0.0; 3]; 3]), HierarchyOptions::default());
        let ends: Vec<_> = tree.iter().map(|node| (node.own, node.next)).collect();
        // Both ends lead to the middle with all their weight, and so does the last one to the pair.
        assert_eq!(ends[..3], [(0.0, 1.0), (0.0, 1.0), (0.0, 1.0)]);
        assert_eq!((tree.len(), tree[3].halves, tree[4].halves), (5, Some((0, 1)), Some((2, 3))));
        assert!((tree[3].own - 1.0).abs() < 1e-15 && (tree[4].own - 1.0).abs() < 1e-15);
        assert_eq!((tree[3].volume, tree[4].gaussians), (tree[0].volume + tree[1].volume, 30));
    }

    #[test]
    fn a_color_of_its_own_makes_a_region() {
        let chain: Vec<(u32, u32, f64)> = (0..9).map(|i| (i, i + 1, 1.0)).collect();
        let graph = graph(10, &chain);
        let mut colors = vec![[0.6, 0.0, 0.0]; 10];
        for color in &mut colors[3..6] {
            *color = [0.6, 0.2, 0.1];
        }
        let best = found(&graph, &colors);
        let colored = best.iter().find(|region| region.clusters == [3, 4, 5]).unwrap();
        assert!(colored.prominence > 0.9, "{best:?}");
    }

    #[test]
    fn colors_alone_make_regions_across_creases() {
        // A ring whose every edge is long but one. Its red half crosses long edges.
        let lengths = [1.0, 4.0, 4.0, 4.0, 4.0, 4.0, 4.0, 4.0];
        let edges: Vec<_> = lengths.iter().zip(0..).map(|(l, i)| (i, (i + 1) % 8, *l)).collect();
        let edges: Vec<_> = edges.into_iter().map(|(u, v, l): (u32, u32, f64)| (u.min(v), u.max(v), l)).collect();
        let graph = graph(8, &edges);
        let mut colors = [[0.6, 0.0, 0.0]; 8];
        let plain = diverse_regions(&graph, &looks(&colors), 64);
        assert_eq!(plain, regions(&graph, &looks(&colors), HierarchyOptions::default(), 64));
        colors[1..5].fill([0.6, 0.2, 0.1]);
        let found = diverse_regions(&graph, &looks(&colors), 64);
        let red = found.iter().find(|region| region.clusters == [1, 2, 3, 4]).unwrap();
        assert!(red.prominence > 0.9 && found.len() <= 64, "{found:?}");
        let distinct: std::collections::BTreeSet<_> = found.iter().map(|region| &region.clusters).collect();
        assert_eq!(distinct.len(), found.len());
    }

    #[test]
    fn a_unit_of_one_color_has_no_hierarchy_by_color() {
        let colored = graph(4, &[(0, 1, 1.0)]).units.remove(0);
        let plain = graph(4, &[(2, 3, 1.0)]).units.remove(0);
        let graph = ClusterGraph { clusters: 4, units: vec![colored, plain], component: vec![0; 4] };
        let mut looks = looks(&[[0.0; 3], [0.9; 3], [0.5; 3], [0.5; 3]]);
        (looks[2].unit, looks[3].unit) = (1, 1);
        let found = diverse_regions(&graph, &looks, 64);
        // Both of the plain unit touch, so neither stands alone.
        assert!(found.iter().all(|region| region.clusters != [2] && region.clusters != [3]), "{found:?}");
    }

    #[test]
    fn regions_without_contact_stand_out_most_and_empty_clusters_have_none() {
        let graph = graph(7, &[(0, 1, 1.0), (2, 3, 1.0), (4, 5, 1.0)]);
        let mut looks = looks(&[[0.0; 3]; 7]);
        looks[5].gaussians = 0;
        let found = regions(&graph, &looks, HierarchyOptions::default(), 64);
        let clusters: Vec<_> = found.iter().map(|region| (region.clusters.clone(), region.prominence)).collect();
        assert_eq!(clusters, [vec![0, 1], vec![2, 3], vec![4], vec![6]].map(|clusters| (clusters, 1.0)));
        assert_eq!(regions(&graph, &looks, HierarchyOptions::default(), 1).len(), 1);
        assert!(regions(&graph, &[], HierarchyOptions::default(), 9).is_empty());
    }

    #[test]
    fn every_size_has_its_regions() {
        let sized = |clusters: &[u32], share, prominence| {
            let region = ClusterRegion { clusters: clusters.to_vec(), gaussians: 1, prominence };
            SizedRegion { region, share }
        };
        let all = || {
            vec![
                sized(&[0], 0.01, 0.9),
                sized(&[1], 0.011, 0.8),
                sized(&[2], 0.012, 0.95),
                sized(&[3, 4], 0.4, 0.1),
                sized(&[5, 6], 0.3, 0.2),
            ]
        };
        let kept = |count| {
            let kept = at_every_size(all(), count);
            kept.iter().map(|region| region.clusters[0]).collect::<Vec<_>>()
        };
        assert_eq!((kept(2), kept(3), kept(9)), (vec![2, 5], vec![2, 5, 0], vec![2, 5, 0, 3, 1]));
    }

    proptest! {
        #[test]
        fn regions_are_nested_or_apart_connected_and_the_same_again(
            edges in prop::collection::btree_map((0u32..20, 0u32..20), 0.0..5.0f64, 0..60),
            sizes in prop::collection::vec(0u64..9, 20),
            tones in prop::collection::vec(0.0..1.0f64, 20),
        ) {
            let edges: Vec<_> = edges.into_iter().filter(|((u, v), _)| u < v).map(|((u, v), l)| (u, v, l)).collect();
            let graph = graph(20, &edges);
            let look = |(gaussians, tone): (&u64, &f64)| ClusterLook { unit: 0, gaussians: *gaussians, color: [*tone, 0.0, 0.0] };
            let looks: Vec<ClusterLook> = sizes.iter().zip(&tones).map(look).collect();
            let options = HierarchyOptions { least: 0.0, most: 1.0, ..HierarchyOptions::default() };
            let found = regions(&graph, &looks, options, 64);
            prop_assert_eq!(&found, &regions(&graph, &looks, options, 64));
            for region in &found {
                prop_assert!((0.0..=1.0).contains(&region.prominence));
                let sum: u64 = region.clusters.iter().map(|c| sizes[*c as usize]).sum();
                prop_assert_eq!(region.gaussians, sum);
                // Connected: a search from its first cluster reaches all.
                let mut reached = vec![region.clusters[0]];
                let mut at = 0;
                while at < reached.len() {
                    for (u, v, _) in &edges {
                        for (a, b) in [(u, v), (v, u)] {
                            if *a == reached[at] && region.clusters.contains(b) && !reached.contains(b) {
                                reached.push(*b);
                            }
                        }
                    }
                    at += 1;
                }
                prop_assert_eq!(reached.len(), region.clusters.len());
                for other in &found {
                    let shared = region.clusters.iter().filter(|c| other.clusters.contains(c)).count();
                    prop_assert!(shared == 0 || shared == region.clusters.len().min(other.clusters.len()));
                }
            }
        }
    }
}
