//! An on-disk cache of clusters. The name of an entry is a hash of its inputs, so stale entries are never found.
//!
//! An entry holds the clustering and its contact graph. It is written under a temporary name and renamed, and has a
//! checksum. A damaged entry is reported and computed again.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use sg_formats::stored_entries::keep_newest;
use sg_input::file;
use sg_scene::model::Scene;

use crate::cluster_graph::{ClusterGraph, Distances, Link, links};
use crate::clustering::{Cluster, Clustering, ClusteringOptions};
use crate::features::{FeatureKind, WIDTH};
use crate::geometry::GeometryOptions;
use crate::neighbours::symmetric;

/// First bytes of an entry: format and version.
const MAGIC: &[u8; 8] = b"SGCLUS02";

/// Version of the algorithm. It changes with the result for the same scene and options.
const METHOD_VERSION: &str = "1";

/// Ending of an entry's name.
const EXTENSION: &str = "clusters";

/// Most entries of a folder. The oldest entries are removed first.
const MAX_ENTRIES: usize = 64;

/// A folder of entries.
#[derive(Debug, Clone)]
pub struct ClusterCache {
    folder: PathBuf,
}

/// Result of a look-up.
#[derive(Debug)]
pub enum Found {
    /// Clusters and their contact graph.
    Entry(Box<(Clustering, ClusterGraph)>),
    /// No entry.
    Nothing,
    /// A damaged entry, with the reason.
    Damaged(String),
}

/// The key of a scene's clusters: BLAKE3 over the content of the scene and the options.
#[must_use]
pub fn key(scene: &Scene, geometry: GeometryOptions, options: &ClusteringOptions) -> blake3::Hash {
    let mut hasher = blake3::Hasher::new();
    hasher.update(MAGIC);
    hasher.update(METHOD_VERSION.as_bytes());
    hasher.update(scene.content_hash().as_bytes());
    // Debug text holds every field with round-trip numbers, so different options have different text.
    hasher.update(format!("{geometry:?} {options:?}").as_bytes());
    hasher.finalize()
}

impl ClusterCache {
    /// The cache in a folder. The first [`ClusterCache::store`] creates the folder.
    #[must_use]
    pub fn new(folder: &Path) -> Self {
        Self { folder: folder.to_path_buf() }
    }

    /// The file of an entry.
    #[must_use]
    pub fn path(&self, key: &blake3::Hash) -> PathBuf {
        self.folder.join(format!("{}.{EXTENSION}", key.to_hex()))
    }

    /// Looks up an entry of a scene with `gaussians` Gaussians.
    #[must_use]
    pub fn load(&self, key: &blake3::Hash, gaussians: usize) -> Found {
        let path = self.path(key);
        let bytes = match read_bounded(&path, gaussians) {
            Ok(bytes) => bytes,
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Found::Nothing,
            Err(e) => return Found::Damaged(format!("{}: {e}", path.display())),
        };
        match decode(&bytes, gaussians) {
            Some(entry) => Found::Entry(Box::new(entry)),
            None => Found::Damaged(format!("{}: the checksum or the content is wrong", path.display())),
        }
    }

    /// Stores an entry, and removes the oldest ones beyond the limit.
    ///
    /// # Errors
    /// The I/O error, for example a full disk. No partial entry remains.
    pub fn store(&self, key: &blake3::Hash, clustering: &Clustering, graph: &ClusterGraph) -> io::Result<()> {
        fs::create_dir_all(&self.folder)?;
        sg_formats::staged_file::replace(&self.path(key), &encode(clustering, graph))?;
        keep_newest(&self.folder, EXTENSION, MAX_ENTRIES)
    }
}

/// Reads a file up to the largest possible entry of a scene of this size.
fn read_bounded(path: &Path, gaussians: usize) -> io::Result<Vec<u8>> {
    file::read(path, 1_000_000 + 1000 * gaussians as u64)
}

fn encode(clustering: &Clustering, graph: &ClusterGraph) -> Vec<u8> {
    let mut out = Vec::with_capacity(64 + 4 * clustering.labels.len() + 200 * clustering.clusters.len());
    out.extend_from_slice(MAGIC);
    let number = |out: &mut Vec<u8>, n: usize| out.extend_from_slice(&(n as u64).to_le_bytes());
    number(&mut out, clustering.labels.len());
    clustering.labels.iter().for_each(|l| out.extend_from_slice(&l.to_le_bytes()));
    number(&mut out, clustering.clusters.len());
    for c in &clustering.clusters {
        [c.unit, c.size, c.centre].iter().for_each(|x| out.extend_from_slice(&x.to_le_bytes()));
        c.position.iter().chain(&c.feature).for_each(|x| out.extend_from_slice(&x.to_le_bytes()));
    }
    graph.component.iter().for_each(|c| out.extend_from_slice(&c.to_le_bytes()));
    number(&mut out, clustering.kinds.len());
    for (kind, unit) in clustering.kinds.iter().zip(&graph.units) {
        out.push(match kind {
            FeatureKind::Oriented => 0,
            FeatureKind::Invariant => 1,
            FeatureKind::Printed => 2,
        });
        // Both triangles of the matrix are stored, and one is written.
        number(&mut out, unit.nnz() / 2);
        for Link { u, v, distances } in links(unit) {
            [u, v].iter().for_each(|x| out.extend_from_slice(&x.to_le_bytes()));
            [distances.length, distances.feature, distances.crease]
                .iter()
                .for_each(|x| out.extend_from_slice(&x.to_le_bytes()));
        }
    }
    let checksum = blake3::hash(&out);
    out.extend_from_slice(checksum.as_bytes());
    out
}

/// Reads numbers from the front of a slice.
struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (head, tail) = self.0.split_first_chunk()?;
        self.0 = tail;
        Some(*head)
    }

    fn u32(&mut self) -> Option<u32> {
        self.take().map(u32::from_le_bytes)
    }

    fn i32(&mut self) -> Option<i32> {
        self.take().map(i32::from_le_bytes)
    }

    fn f64(&mut self) -> Option<f64> {
        self.take().map(f64::from_le_bytes)
    }

    /// Reads the number of items of at least `size` bytes each. The number is limited by the remaining bytes.
    fn count(&mut self, size: usize) -> Option<usize> {
        let n = usize::try_from(self.take().map(u64::from_le_bytes)?).ok()?;
        (n.checked_mul(size)? <= self.0.len()).then_some(n)
    }
}

fn decode(bytes: &[u8], gaussians: usize) -> Option<(Clustering, ClusterGraph)> {
    let (content, checksum) = bytes.split_last_chunk::<32>()?;
    if blake3::hash(content) != blake3::Hash::from_bytes(*checksum) {
        return None;
    }
    let mut r = Reader(content);
    if r.take::<8>()? != *MAGIC {
        return None;
    }
    let n = r.count(4)?;
    let labels: Vec<i32> = (0..n).map(|_| r.i32()).collect::<Option<_>>()?;
    let count = r.count(12 + 8 * (3 + WIDTH))?;
    let mut clusters = Vec::with_capacity(count);
    for _ in 0..count {
        clusters.push(Cluster {
            unit: r.u32()?,
            size: r.u32()?,
            centre: r.u32()?,
            position: [r.f64()?, r.f64()?, r.f64()?],
            feature: (0..WIDTH).map(|_| r.f64()).collect::<Option<Vec<_>>>()?.try_into().ok()?,
        });
    }
    let component = (0..count).map(|_| r.u32()).collect::<Option<_>>()?;
    let units = r.count(9)?;
    let mut kinds = Vec::with_capacity(units);
    let mut matrices = Vec::with_capacity(units);
    for _ in 0..units {
        kinds.push(match r.take::<1>()? {
            [0] => FeatureKind::Oriented,
            [1] => FeatureKind::Invariant,
            [2] => FeatureKind::Printed,
            _ => return None,
        });
        let links = r.count(32)?;
        let links: Vec<(u32, u32, Distances)> = (0..links)
            .map(|_| {
                let (u, v) = (r.u32()?, r.u32()?);
                Some((u, v, Distances { length: r.f64()?, feature: r.f64()?, crease: r.f64()? }))
            })
            .collect::<Option<_>>()?;
        let ascending = links.windows(2).all(|pair| (pair[0].0, pair[0].1) < (pair[1].0, pair[1].1));
        if !ascending || links.iter().any(|&(u, v, _)| u >= v || v as usize >= count) {
            return None;
        }
        matrices.push(symmetric(count, &links));
    }
    let fits = n == gaussians && r.0.is_empty() && labels.iter().all(|l| *l >= -1 && *l < count as i32);
    let graph = ClusterGraph { clusters: count, units: matrices, component };
    fits.then_some((Clustering { labels, clusters, kinds }, graph))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cluster_graph::GraphForm;
    use crate::clustering::cluster;
    use crate::geometry::Geometry;
    use crate::progress::Silent;
    use glam::Vec3;
    use sg_scene::synthetic::random_unit;

    fn made() -> (Scene, Clustering, ClusterGraph) {
        let mut a = random_unit(400, 1);
        a.gaussians.position[17] = Vec3::NAN;
        let mut b = random_unit(300, 2);
        b.name = "b".into();
        let scene = Scene::compose(vec![a, b], None);
        let geometry = Geometry::of_scene(&scene, GeometryOptions::default(), &Silent).unwrap();
        let options = ClusteringOptions { max_clusters: 20, ..ClusteringOptions::default() };
        let (clustering, _) = cluster(&geometry, &options, &Silent).unwrap();
        let graph = ClusterGraph::new(&geometry, &clustering, GraphForm::Contact).unwrap();
        (scene, clustering, graph)
    }

    #[test]
    fn what_is_stored_is_found_again_and_damage_is_noticed() {
        let (scene, clustering, graph) = made();
        let folder = tempfile::tempdir().unwrap();
        let cache = ClusterCache::new(&folder.path().join("clusters"));
        let key = key(&scene, GeometryOptions::default(), &ClusteringOptions::default());
        assert!(matches!(cache.load(&key, scene.len()), Found::Nothing));
        cache.store(&key, &clustering, &graph).unwrap();
        match cache.load(&key, scene.len()) {
            Found::Entry(entry) => assert_eq!(*entry, (clustering.clone(), graph.clone())),
            other => panic!("{other:?}"),
        }
        assert!(matches!(cache.load(&key, scene.len() + 1), Found::Damaged(_)));
        let whole = fs::read(cache.path(&key)).unwrap();
        for at in (0..whole.len()).step_by(whole.len() / 40) {
            let mut bytes = whole.clone();
            bytes[at] ^= 0x10;
            fs::write(cache.path(&key), &bytes).unwrap();
            assert!(matches!(cache.load(&key, scene.len()), Found::Damaged(_)), "byte {at}");
            fs::write(cache.path(&key), &whole[..at]).unwrap();
            assert!(matches!(cache.load(&key, scene.len()), Found::Damaged(_)), "cut at {at}");
        }
    }

    #[test]
    fn every_option_is_part_of_the_name() {
        let (scene, ..) = made();
        let geometry = GeometryOptions::default();
        let options = ClusteringOptions::default();
        let names = [
            key(&scene, geometry, &options),
            key(&scene, GeometryOptions { neighbours: 9, ..geometry }, &options),
            key(&scene, GeometryOptions { features: Some(FeatureKind::Invariant), ..geometry }, &options),
            key(&scene, geometry, &ClusteringOptions { compactness: 0.5 + 1e-17, ..options.clone() }),
            key(&scene, geometry, &ClusteringOptions { compactness: 0.5 + 2e-16, ..options.clone() }),
            key(&scene, geometry, &ClusteringOptions { max_clusters: 998, ..options }),
        ];
        assert_eq!(names[0], names[3], "the same number is the same name");
        let distinct: std::collections::HashSet<_> = names.iter().map(|n| *n.as_bytes()).collect();
        assert_eq!(distinct.len(), names.len() - 1);
    }

    #[test]
    fn a_folder_does_not_grow_without_end() {
        let (_, clustering, graph) = made();
        let folder = tempfile::tempdir().unwrap();
        let cache = ClusterCache::new(folder.path());
        for i in 0..MAX_ENTRIES + 5 {
            cache.store(&blake3::hash(&i.to_le_bytes()), &clustering, &graph).unwrap();
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), MAX_ENTRIES);
    }
}
