//! Super-Gaussians of copied Gaussians.
//!
//! A base unit of copies has the clusters and the contacts of its originals: nothing is clustered anew. So its first stroke is as
//! quick as any other, and a structure means the same in the copy.

use sg_scene::mask::Mask;
use sg_scene::model::Scene;

use crate::cluster_graph::{ClusterGraph, links};
use crate::clustering::{Cluster, Clustering};
use crate::neighbours::symmetric;
use crate::vertices::distance_squared;

/// The clusters and the graph of a scene with copies of some Gaussians of one base unit behind all others, as its last base unit.
///
/// `originals` is over the Gaussians that `clustering` has, and `scene` has the copies where they lie. Copies of one cluster form a
/// cluster. It keeps the mean feature of the whole original, also where only a part of it was copied. Edges connect those copies
/// whose originals touch. No edge connects copies with originals.
#[must_use]
pub fn with_copies(
    clustering: &Clustering,
    graph: &ClusterGraph,
    scene: &Scene,
    originals: &Mask,
) -> (Clustering, ClusterGraph) {
    let first = clustering.labels.len();
    let label = |i: usize| usize::try_from(clustering.labels.get(i).copied().unwrap_or(-1)).ok();
    let mut members: Vec<Vec<u32>> = vec![Vec::new(); clustering.clusters.len()];
    for (copy, original) in (first..).zip(originals.ones()) {
        if let Some(members) = label(original).and_then(|l| members.get_mut(l)) {
            members.push(copy as u32);
        }
    }
    let unit = clustering.kinds.len() as u32;
    let mut clusters = clustering.clusters.clone();
    let mut copy_of: Vec<Option<u32>> = vec![None; clustering.clusters.len()];
    let mut components: Vec<(u32, u32)> = Vec::new();
    let mut component = graph.component.clone();
    let mut next = graph.component.iter().filter(|c| **c != u32::MAX).max().map_or(0, |c| c + 1);
    for ((source, members), copy) in clustering.clusters.iter().zip(&members).zip(&mut copy_of) {
        if members.is_empty() {
            continue;
        }
        *copy = Some(clusters.len() as u32);
        clusters.push(of_members(source, unit, members, scene));
    }
    for (source, _) in copy_of.iter().enumerate().filter(|(_, copy)| copy.is_some()) {
        let original = graph.component.get(source).copied().unwrap_or(u32::MAX);
        component.push(match components.iter().find(|(known, _)| *known == original) {
            _ if original == u32::MAX => u32::MAX,
            Some((_, copied)) => *copied,
            None => {
                components.push((original, next));
                next += 1;
                next - 1
            }
        });
    }
    let mut labels = clustering.labels.clone();
    labels.extend(originals.ones().map(|i| {
        let copy = label(i).and_then(|l| copy_of.get(l).copied().flatten());
        copy.and_then(|l| i32::try_from(l).ok()).unwrap_or(-1)
    }));
    let mut kinds = clustering.kinds.clone();
    let source = originals.ones().find_map(label).and_then(|l| clustering.clusters.get(l)).map(|c| c.unit as usize);
    kinds.extend(source.and_then(|u| clustering.kinds.get(u)).or(clustering.kinds.last()).copied());

    let count = clusters.len();
    let copied = |l: u32| copy_of.get(l as usize).copied().flatten();
    let grown = |unit| symmetric(count, &links(unit).map(|l| (l.u, l.v, l.distances)).collect::<Vec<_>>());
    let mut units: Vec<_> = graph.units.iter().map(grown).collect();
    let edges = source.and_then(|u| graph.units.get(u)).map(|unit| {
        // Copies are in the order of their originals, so the edges stay ascending.
        let edges = links(unit).filter_map(|l| Some((copied(l.u)?, copied(l.v)?, l.distances)));
        edges.collect::<Vec<_>>()
    });
    units.push(symmetric(count, &edges.unwrap_or_default()));
    (Clustering { labels, clusters, kinds }, ClusterGraph { clusters: count, units, component })
}

/// A cluster of these copies.
fn of_members(source: &Cluster, unit: u32, members: &[u32], scene: &Scene) -> Cluster {
    let places: Vec<(u32, [f64; 3])> =
        members.iter().filter_map(|&g| Some((g, scene.position(g as usize)?.to_array()))).collect();
    let share = 1.0 / places.len().max(1) as f64;
    let mut position = [0.0; 3];
    for (_, place) in &places {
        position.iter_mut().zip(place).for_each(|(sum, x)| *sum += share * x);
    }
    let distance = |place: &[f64; 3]| distance_squared(place, &position);
    let nearest = places.iter().min_by(|a, b| distance(&a.1).total_cmp(&distance(&b.1)));
    Cluster {
        unit,
        size: members.len() as u32,
        centre: nearest.map_or(u32::MAX, |(g, _)| *g),
        position,
        feature: source.feature,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sg_scene::model::BaseUnit;
    use sg_scene::synthetic::test_scene;

    use crate::clustering::{ClusteringOptions, cluster};
    use crate::geometry::{Geometry, GeometryOptions};
    use crate::progress::Silent;

    fn clustered(scene: &Scene) -> (Clustering, ClusterGraph) {
        let geometry = Geometry::of_scene(scene, GeometryOptions::default(), &Silent).unwrap();
        let options = ClusteringOptions { max_clusters: 30, ..ClusteringOptions::default() };
        let (clustering, _) = cluster(&geometry, &options, &Silent).unwrap();
        let graph = ClusterGraph::new(&geometry, &clustering, crate::cluster_graph::GraphForm::default()).unwrap();
        (clustering, graph)
    }

    /// The scene with copies of some rows of its second base unit as a third one.
    fn copied(scene: &Scene, originals: &Mask) -> Scene {
        let source = &scene.units[1];
        let rows: Vec<usize> = originals.ones().map(|i| i - source.first).collect();
        let gaussians = source.gaussians.rows(&rows);
        let mut copied = scene.clone();
        copied.units.push(BaseUnit { name: "copy".into(), gaussians, first: scene.len(), ..source.clone() });
        copied
    }

    #[test]
    fn a_whole_copy_has_the_clusters_contacts_and_walks_of_its_original() {
        let scene = test_scene(&[("other", 200), ("source", 400)]);
        let (clustering, graph) = clustered(&scene);
        let originals = Mask::from_fn(600, |i| i >= 200);
        let with = copied(&scene, &originals);
        let (grown, network) = with_copies(&clustering, &graph, &with, &originals);
        assert_eq!((grown.labels.len(), grown.kinds.len(), network.units.len()), (1000, 3, 3));
        assert_eq!(grown.labels[..600], clustering.labels[..]);
        let of_source: Vec<_> = clustering.clusters.iter().filter(|c| c.unit == 1).collect();
        let of_copy: Vec<_> = grown.clusters.iter().filter(|c| c.unit == 2).collect();
        assert_eq!(of_copy.len(), of_source.len());
        for (copy, source) in of_copy.iter().zip(&of_source) {
            assert_eq!((copy.size, copy.centre, copy.feature), (source.size, source.centre + 400, source.feature));
            let off: f64 = copy.position.iter().zip(&source.position).map(|(a, b)| (a - b).abs()).sum();
            assert!(off < 1e-9, "{off}");
        }
        let plain = |links: Vec<crate::cluster_graph::Link>, first: u32| -> Vec<_> {
            links.into_iter().map(|l| (l.u - first, l.v - first, l.distances)).collect()
        };
        let (first, copy) =
            (clustering.clusters.iter().position(|c| c.unit == 1).unwrap() as u32, graph.clusters as u32);
        let (of_source, of_copy) = (links(&graph.units[1]).collect(), links(&network.units[2]).collect());
        assert_eq!(plain(of_copy, copy), plain(of_source, first));
        assert_eq!(links(&network.units[0]).collect::<Vec<_>>(), links(&graph.units[0]).collect::<Vec<_>>());
        let fresh = network.component[graph.clusters..].iter().all(|c| !graph.component.contains(c));
        assert!(fresh && network.component.len() == network.clusters);
    }

    #[test]
    fn a_part_of_a_cluster_is_a_cluster_and_a_copy_can_be_copied() {
        let scene = test_scene(&[("other", 200), ("source", 400)]);
        let (clustering, graph) = clustered(&scene);
        // One Gaussian of three, of every cluster.
        let originals = Mask::from_fn(600, |i| i >= 200 && i % 3 == 0);
        let with = copied(&scene, &originals);
        let (grown, network) = with_copies(&clustering, &graph, &with, &originals);
        for (copy, original) in (600..).zip(originals.ones()) {
            let (copy, original) = (grown.labels[copy] as usize, clustering.labels[original] as usize);
            assert_eq!(grown.clusters[copy].feature, clustering.clusters[original].feature);
            assert!(grown.clusters[copy].size <= clustering.clusters[original].size);
        }
        let sizes: u32 = grown.clusters.iter().filter(|c| c.unit == 2).map(|c| c.size).sum();
        assert_eq!(sizes as usize, originals.count());
        let again = Mask::from_fn(with.len(), |i| i >= 600);
        let mut twice = with.clone();
        let source = with.units[2].clone();
        twice.units.push(BaseUnit { first: with.len(), ..source });
        let (last, of_last) = with_copies(&grown, &network, &twice, &again);
        assert_eq!((last.labels.len(), last.clusters.last().map(|c| c.unit)), (with.len() + again.count(), Some(3)));
        assert_eq!(links(&of_last.units[3]).count(), links(&network.units[2]).count());
    }
}
