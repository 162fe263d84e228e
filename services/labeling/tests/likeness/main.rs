//! How well likeness of looks finds the partner of a paired organ: the 16 nuclei that the CIT168 atlas has on both sides.
//!
//! Both sides of the atlas are nearly mirror images. So partners test that place and direction do not count, and the other
//! pairs how much a likeness tells.
//!
//!     SUPERGAUSSIAN_DATA=… cargo test --release -p sg-labeling --test likeness -- --nocapture

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a test fails by panicking and tells what it measured")]

use std::collections::BTreeMap;
use std::path::PathBuf;

use glam::DVec3;
use sg_labeling::attributes::likeness::Likeness;
use sg_labeling::attributes::{Attributes, Gaussian};
use sg_labeling::frame::Frame;
use sg_labeling::query::{Item, Outcome, QueryContext, Scene};

/// Voxels of the atlas along x, y, z.
const SIZE: [usize; 3] = [165, 198, 168];
/// Nuclei, each on two sides: label 2n+1 on the left, 2n+2 on the right.
const PAIRS: usize = 16;

/// The shared data, if it is there. With `SUPERGAUSSIAN_REQUIRE_DATA=1` it must be.
fn data() -> Option<PathBuf> {
    let folder = std::env::var_os("SUPERGAUSSIAN_DATA").map(PathBuf::from).filter(|folder| folder.is_dir());
    let required = std::env::var("SUPERGAUSSIAN_REQUIRE_DATA").is_ok_and(|v| v == "1");
    assert!(folder.is_some() || !required, "SUPERGAUSSIAN_REQUIRE_DATA=1; SUPERGAUSSIAN_DATA must name the data");
    if folder.is_none() {
        println!("SKIPPED: no data, set SUPERGAUSSIAN_DATA");
    }
    folder
}

/// The looks of the nuclei by label, all grey: a Gaussian for each voxel.
fn nuclei() -> Option<Vec<Attributes>> {
    let path = data()?.join("labels/cit168_labels_165x198x168_uint8.raw.zst");
    let voxels = zstd::decode_all(std::fs::read(path).unwrap().as_slice()).unwrap();
    assert_eq!(voxels.len(), SIZE.iter().product::<usize>());
    let mut parts: BTreeMap<u8, Vec<Gaussian>> = BTreeMap::new();
    for (at, label) in voxels.iter().enumerate().filter(|(_, label)| **label > 0) {
        let [x, y, z] = [at % SIZE[0], at / SIZE[0] % SIZE[1], at / SIZE[0] / SIZE[1]].map(|i| i as f64);
        let gaussian =
            Gaussian { position: DVec3::new(x, y, z), color: [0.5; 3], opacity: 0.8, deviation: 0.5, area: 1.0 };
        parts.entry(*label).or_default().push(gaussian);
    }
    assert_eq!(parts.len(), 2 * PAIRS);
    Some(parts.into_values().map(|part| Attributes::of(part).unwrap()).collect())
}

/// The partner of a nucleus by its index.
fn partner(at: usize) -> usize {
    at ^ 1
}

#[test]
fn the_other_side_is_most_alike() {
    let Some(looks) = nuclei() else { return };
    let mut first = 0;
    let mut ranks = Vec::new();
    let mut scores = [Vec::new(), Vec::new()];
    for (at, own) in looks.iter().enumerate() {
        let mut others: Vec<(f64, usize)> = looks
            .iter()
            .enumerate()
            .filter(|(other, _)| *other != at)
            .map(|(other, look)| (Likeness::of(own, look).score, other))
            .collect();
        others.sort_by(|a, b| b.0.total_cmp(&a.0));
        let rank = others.iter().position(|(_, other)| *other == partner(at)).unwrap();
        first += usize::from(rank == 0);
        ranks.push(rank + 1);
        for (score, other) in others {
            scores[usize::from(other != partner(at))].push(score);
        }
    }
    let mean_reciprocal = ranks.iter().map(|rank| 1.0 / *rank as f64).sum::<f64>() / ranks.len() as f64;
    let share = |scores: &[f64]| scores.iter().filter(|s| **s >= 0.5).count() as f64 / scores.len() as f64;
    println!("partner first: {first} of {}", looks.len());
    println!("ranks among 31: {ranks:?}, mean reciprocal rank {mean_reciprocal:.2}");
    println!(
        "scores of at least 0.5: {:.0} % of partners, {:.0} % of others",
        100.0 * share(&scores[0]),
        100.0 * share(&scores[1])
    );
    assert!(mean_reciprocal > 0.9, "{mean_reciprocal}");
    assert!(share(&scores[0]) > 2.0 * share(&scores[1]));
}

#[test]
fn things_like_one_side_are_the_other_side() {
    let Some(looks) = nuclei() else { return };
    let items = looks.iter().map(|look| Item { label: None, attributes: Some(*look) });
    let scene = Scene::new(items, Frame::XYZ).unwrap();
    let mut found = 0;
    let mut lengths = 0;
    for (at, look) in looks.iter().enumerate() {
        let context = QueryContext { selection: Some(&|| Some(*look)), ..QueryContext::default() };
        if let Outcome::Match { items } = scene.find_by("things like this", context) {
            assert!(items.iter().all(|item| item.item != at), "a thing is not like itself");
            found += usize::from(items.iter().any(|item| item.item == partner(at)));
            lengths += items.len();
        }
    }
    println!("the answer has the partner: {found} of {}", looks.len());
    println!("{:.1} units in an answer", lengths as f64 / looks.len() as f64);
    assert!(found > looks.len() * 9 / 10, "{found}");
}
