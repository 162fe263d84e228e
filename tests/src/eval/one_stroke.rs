//! `supergaussian eval one-stroke`: what one green stroke means, over every part of many scenes.

pub mod curve;
pub mod robot;
pub mod strokes;
pub mod table;

use std::path::PathBuf;
use std::sync::Arc;

use rayon::prelude::*;
use serde::Serialize;
use sg_clusters::cluster_graph::{ClusterGraph, GraphForm};
use sg_clusters::clustering::{Cluster, ClusteringOptions, cluster};
use sg_clusters::geometry::{Geometry, GeometryOptions};
use sg_clusters::hierarchy::{ClusterLook, ClusterRegion, HierarchyOptions, regions};
use sg_clusters::progress::Silent;
use sg_selection::brush::Brush;
use sg_selection::cluster_members::ClusterMembers;
use sg_selection::mask_agreement::best_union_iou;
use sg_selection::selection_index::{SelectionIndex, WalkOptions};
use sg_selection::session::SelectionError;

use super::hand::scene_graph;
use super::subject::Subject;
use super::{EvalError, measured, phantoms, shapes};
use curve::Walker;
pub use curve::{Curve, LEAKS, leak};
use strokes::Target;
pub use table::{Tables, markdown, tables};

/// Share of the target's extent that a long and a short stroke span.
pub const SHARES: [(&str, f64); 2] = [("long", 0.45), ("short", 0.12)];

/// Least Gaussians of a part that is a target, and its largest share of the scene.
const LEAST: usize = 60;
const LARGEST: f64 = 0.95;

/// Regions of each scene: as many as the labeling service compares texts with.
const REGIONS: usize = 64;

/// What is evaluated.
#[derive(Debug, Clone)]
pub struct Options {
    /// The scenes that numbers are chosen on, and not those that are reported.
    pub tuning: bool,
    /// Gaussians of each made scene.
    pub gaussians: usize,
    /// Strokes of each length on each part.
    pub strokes: usize,
    /// Whether a robot also corrects the selections, which takes most of the time.
    pub clicks: bool,
    /// Seed of scenes and strokes.
    pub seed: u64,
    /// Folder of measured data.
    pub data: Option<PathBuf>,
}

/// Every stroke.
#[derive(Debug, Clone, Serialize)]
pub struct Played {
    /// Scene, and group of scenes.
    pub scene: String,
    /// A, B or labels.
    pub group: &'static str,
    /// The part that is wanted.
    pub part: i32,
    /// Gaussians of the part, of the scene, and under the stroke's clusters.
    pub wanted: usize,
    /// All.
    pub all: usize,
    /// n₀.
    pub hit: usize,
    /// Mean neighbours of the clusters under the stroke, and of all clusters.
    pub degree: [f64; 2],
    /// long or short.
    pub length: &'static str,
    /// IoU of the best union of clusters.
    pub union: f64,
    /// IoU of the best of the regions that are known before any stroke.
    pub region: f64,
    /// Without creases.
    pub plain: Curve,
    /// With creases.
    pub creased: Curve,
    /// IoU of the three answers: narrower, first, wider.
    pub three: [f64; 3],
    /// The same without creases.
    pub three_plain: [f64; 3],
    /// IoU after each click, in the ways of [`table::WAYS`]. One long stroke of each part has them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub clicks: Option<[Vec<f64>; 3]>,
}

/// The scenes with the name of their group: tuning or reported.
fn scenes(options: &Options, tell: &dyn Fn(&str)) -> Result<Vec<(&'static str, Subject)>, EvalError> {
    let mut out = Vec::new();
    let names: Vec<&str> =
        if options.tuning { [&shapes::TUNING[..], &shapes::STROKE_TUNING].concat() } else { shapes::REPORTED.to_vec() };
    for name in names {
        let made = shapes::shape(name, options.gaussians, options.seed).ok_or(EvalError::Nothing)?;
        let scrambled = Subject { name: format!("{name}, scrambled"), ..made.scrambled(options.seed) };
        out.extend([("A", made), ("B", scrambled)]);
    }
    if options.tuning {
        for name in phantoms::PHANTOMS {
            out.push(("labels", phantoms::phantom(name, 2 * options.gaussians, options.seed)?));
        }
    } else if let Some(data) = &options.data {
        let mut subjects = measured::measured(data, 2 * options.gaussians, options.seed, tell)?;
        // Two targets of one scene there; here every part is one.
        subjects.dedup_by(|b, a| a.scene == b.scene);
        out.extend(subjects.into_iter().map(|s| ("labels", s)));
    }
    Ok(out)
}

/// Plays all strokes.
///
/// # Errors
/// [`EvalError`].
pub fn run(options: &Options, tell: &dyn Fn(&str)) -> Result<Vec<Played>, EvalError> {
    let mut out = Vec::new();
    for (group, subject) in scenes(options, tell)? {
        tell(&subject.name);
        out.extend(on(group, &subject, options)?);
    }
    Ok(out)
}

fn on(group: &'static str, subject: &Subject, options: &Options) -> Result<Vec<Played>, EvalError> {
    let scene = &subject.scene;
    let geometry = Geometry::of_scene(scene, GeometryOptions::default(), &Silent)?;
    let (clustering, _) = cluster(&geometry, &ClusteringOptions::default(), &Silent)?;
    let graph = ClusterGraph::new(&geometry, &clustering, GraphForm::Contact)?;
    let points = scene_graph(&geometry);
    let brush = Brush::of_scene(scene);
    let label = |g: usize| usize::try_from(clustering.labels[g]).ok();
    let members =
        ClusterMembers::new(clustering.labels.iter().map(|l| u32::try_from(*l).ok()), clustering.clusters.len());
    let index = |options| Arc::new(SelectionIndex::of_clusters(scene, &clustering, &graph, options));
    let mut neighbours = vec![0.0; clustering.clusters.len()];
    graph.links().flat_map(|l| [l.u, l.v]).for_each(|c| neighbours[c as usize] += 1.0);
    let mean = |of: &mut dyn Iterator<Item = f64>| {
        let (sum, count) = of.fold((0.0, 0.0), |(s, n), x| (s + x, n + 1.0));
        sum / f64::max(count, 1.0)
    };
    let every_scale = index(WalkOptions::every_scale());
    let every_scale_plain = index(WalkOptions { crease: None, ..WalkOptions::every_scale() });
    let fixed = index(WalkOptions::default());
    let broken = |e: SelectionError| EvalError::Data { path: subject.name.clone(), why: e.to_string() };
    let plain = Walker::new(&graph, None).map_err(|e| broken(e.into()))?;
    let creased = Walker::new(&graph, Some(sg_clusters::creases::CREASE)).map_err(|e| broken(e.into()))?;
    // Colours would tell the parts of some scenes.
    let look = |(c, cluster): (usize, &Cluster)| ClusterLook {
        unit: cluster.unit,
        gaussians: members.get(c).len() as u64,
        color: [0.0; 3],
    };
    let looks: Vec<ClusterLook> = clustering.clusters.iter().enumerate().map(look).collect();
    let regions = regions(&graph, &looks, HierarchyOptions::default(), REGIONS);
    let mut parts: Vec<i32> = subject.part.clone();
    parts.sort_unstable();
    parts.dedup();
    let mut out = Vec::new();
    for part in parts {
        let inside: Vec<bool> = subject.part.iter().map(|p| *p == part).collect();
        let wanted = inside.iter().filter(|i| **i).count();
        // Label 0 of a label map is outside.
        if wanted < LEAST || wanted as f64 > LARGEST * scene.len() as f64 || (group == "labels" && part == 0) {
            continue;
        }
        let union = best_union_iou(&clustering.labels, &inside);
        let mut own = vec![0_u32; clustering.clusters.len()];
        (0..scene.len()).filter(|g| inside[*g]).filter_map(label).for_each(|c| own[c] += 1);
        let overlap = |region: &ClusterRegion| {
            let shared: u32 = region.clusters.iter().map(|c| own[*c as usize]).sum();
            f64::from(shared) / (region.gaussians as f64 + wanted as f64 - f64::from(shared))
        };
        let region = regions.iter().map(overlap).fold(0.0, f64::max);
        let Some(target) = Target::new(scene, &points, inside) else { continue };
        let trials: Vec<(usize, usize)> =
            (0..SHARES.len()).flat_map(|l| (0..options.strokes).map(move |k| (l, k))).collect();
        let played: Vec<Option<Played>> = trials
            .into_par_iter()
            .map(|(length, k)| {
                let stream = (1 << 20) * (part as u64 & 0xfff) + (1 << 10) * length as u64 + k as u64;
                let Some(stroke) = target.stroke(SHARES[length].1, options.seed, stream) else { return Ok(None) };
                let (samples, radius) = stroke.in_scene(&scene.bounds);
                let mut hits = brush.hits_with_depth_limit(&samples, radius, &stroke.pressure, None);
                if hits.is_empty() {
                    hits.extend(brush.nearest(&samples));
                }
                let mut hit: Vec<usize> = hits.iter().filter_map(|g| label(*g as usize)).collect();
                hit.sort_unstable();
                hit.dedup();
                Ok(Some(Played {
                    scene: subject.name.clone(),
                    group,
                    part,
                    wanted,
                    all: scene.len(),
                    hit: hit.iter().map(|c| members.get(*c).len()).sum(),
                    degree: [mean(&mut hit.iter().map(|c| neighbours[*c])), mean(&mut neighbours.iter().copied())],
                    length: SHARES[length].0,
                    union,
                    region,
                    plain: plain.play(&hit, &members, &own)?,
                    creased: creased.play(&hit, &members, &own)?,
                    three: robot::three(&every_scale, &stroke, target.inside())?,
                    three_plain: robot::three(&every_scale_plain, &stroke, target.inside())?,
                    clicks: if options.clicks && length == 0 && k == 0 {
                        let way =
                            |index, choose| robot::clicks(index, (scene, &points), &stroke, target.inside(), choose);
                        Some([way(&fixed, false)?, way(&every_scale, false)?, way(&every_scale, true)?])
                    } else {
                        None
                    },
                }))
            })
            .collect::<Result<_, SelectionError>>()
            .map_err(broken)?;
        out.extend(played.into_iter().flatten());
    }
    Ok(out)
}
