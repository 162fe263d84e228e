//! The strokes of a hand that knows its target but is not steady.
//!
//! A stroke follows the surface by the shortest way over the neighbour graph. It stays within the wanted parts, or outside them
//! for the background brush. Its two ends are drawn anew for each trial near two chosen places; then every sample is shifted.
//! Green begins where the target is deepest. Red begins near the target, at parts that do not belong to it.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::DVec3;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use sg_clusters::neighbours::{Edge, Graph};
use sg_scene::model::SceneBox;
use sg_selection::strokes::{Kind, Mode, Stroke};

use super::solid::normal;
use super::subject::Subject;

/// Radius of the brush, as a fraction of the box's longest edge.
pub const RADIUS: f64 = 0.02;
/// How far the ends of a stroke wander, likewise.
pub const WANDER: f64 = 0.06;
/// Standard deviation of the shift that a stroke's samples share, and of each sample's own, likewise.
pub const SHIFT: f64 = 0.008;
/// See [`SHIFT`].
pub const TREMOR: f64 = 0.004;
/// How much of the way between its two places a stroke covers.
pub const COVER: f64 = 0.8;
/// Most samples of a stroke.
const SAMPLES: usize = 24;

/// One trial: a green stroke and a red one.
#[derive(Debug, Clone)]
pub struct Trial {
    /// Foreground.
    pub green: Stroke,
    /// Background.
    pub red: Stroke,
    /// Two more green ones, between any two places of the target.
    pub more: [Stroke; 2],
}

/// The simulated person that draws on one subject.
#[derive(Debug)]
pub struct Hand<'a> {
    subject: &'a Subject,
    /// Over scene-wide indices.
    graph: &'a Graph,
    position: Vec<DVec3>,
    green: (u32, u32),
    red: (u32, u32),
}

impl<'a> Hand<'a> {
    /// A hand over a subject, with a graph over its Gaussians. None if the subject has nothing to select or nothing else.
    #[must_use]
    pub fn new(subject: &'a Subject, graph: &'a Graph) -> Option<Self> {
        let n = subject.scene.len();
        let position: Vec<DVec3> = (0..n).map(|i| subject.scene.position(i).unwrap_or(DVec3::ZERO)).collect();
        let inside = |v: u32| subject.target[v as usize];
        let outside = |v: u32| !subject.target[v as usize];
        let all = || 0..n as u32;
        let border = |side: bool| -> Vec<u32> {
            all()
                .filter(|&v| subject.target[v as usize] == side)
                .filter(|&v| graph.neighbours(v).any(|(w, _)| subject.target[w as usize] != side))
                .collect()
        };
        // Deepest inside.
        let depth = ways(graph, &border(true), inside).0;
        let deepest = |among: &dyn Fn(u32) -> bool| all().filter(|&v| among(v)).max_by(|&a, &b| by_depth(&depth, a, b));
        // Without a border nothing is deep: then from one end to the other.
        let start = deepest(&inside)?;
        let start = if depth[start as usize].is_finite() { start } else { farthest(graph, start, inside)? };
        let end = farthest(graph, start, inside)?;
        // Outside: near the target, but a tenth of all others are nearer.
        let targets: Vec<DVec3> =
            all().filter(|&v| inside(v)).map(|v| position[v as usize]).step_by(1 + n / 20_000).collect();
        let mut near: Vec<(f64, u32)> = (0..n as u32)
            .into_par_iter()
            .filter(|&v| outside(v))
            .map(|v| {
                let d = targets.iter().map(|t| t.distance_squared(position[v as usize])).fold(f64::INFINITY, f64::min);
                (d, v)
            })
            .collect();
        near.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let red_start = near.get(near.len() / 10)?.1;
        let red_end = farthest(graph, red_start, outside)?;
        Some(Self { subject, graph, position, green: (start, end), red: (red_start, red_end) })
    }

    /// Trials of a seed.
    #[must_use]
    pub fn trials(&self, count: usize, seed: u64) -> Vec<Trial> {
        (0..count as u64)
            .into_par_iter()
            .map(|k| {
                let mut r = ChaCha8Rng::seed_from_u64(seed);
                r.set_stream(1000 + k);
                let green = self.stroke(Kind::Foreground, self.green, true, &mut r);
                let red = self.stroke(Kind::Background, self.red, false, &mut r);
                let wanted: Vec<u32> =
                    (0..self.position.len() as u32).filter(|&v| self.subject.target[v as usize]).collect();
                let mut any = || wanted[r.random_range(0..wanted.len())];
                let ends = [(any(), any()), (any(), any())];
                let more = ends.map(|ends| self.stroke(Kind::Foreground, ends, true, &mut r));
                Trial { green, red, more }
            })
            .collect()
    }

    fn stroke(&self, kind: Kind, ends: (u32, u32), side: bool, r: &mut ChaCha8Rng) -> Stroke {
        let bounds: &SceneBox = &self.subject.scene.bounds;
        let edge = bounds.longest_edge();
        let on_side = |v: u32| self.subject.target[v as usize] == side;
        let (from, to) = (self.near(ends.0, side, edge, r), self.near(ends.1, side, edge, r));
        let (_, back) = ways(self.graph, &[from], on_side);
        let mut way = vec![to];
        while let Some(&next) = way.last().and_then(|v| back.get(*v as usize)).filter(|v| **v != u32::MAX) {
            way.push(next);
        }
        way.reverse();
        // In a part that falls into pieces the way may not lead to the first place.
        let covered = ((way.len() as f64 * COVER).ceil() as usize).max(1);
        let stride = covered.div_ceil(SAMPLES);
        let shift = SHIFT * edge * DVec3::new(normal(r), normal(r), normal(r));
        let points = way[..covered]
            .iter()
            .step_by(stride)
            .map(|&v| {
                let tremor = TREMOR * edge * DVec3::new(normal(r), normal(r), normal(r));
                bounds.normalize(self.position[v as usize] + shift + tremor).to_array()
            })
            .collect();
        Stroke { mode: Mode::Walk, kind, radius: RADIUS, points, pressure: Vec::new(), depth: None }
    }

    /// A random Gaussian of one side near a place.
    fn near(&self, place: u32, side: bool, edge: f64, r: &mut ChaCha8Rng) -> u32 {
        let at = self.position[place as usize];
        let reach = (WANDER * edge).powi(2);
        let close: Vec<u32> = (0..self.position.len() as u32)
            .filter(|&v| {
                self.subject.target[v as usize] == side && self.position[v as usize].distance_squared(at) < reach
            })
            .collect();
        if close.is_empty() { place } else { close[r.random_range(0..close.len())] }
    }
}

fn by_depth(depth: &[f64], a: u32, b: u32) -> std::cmp::Ordering {
    let of = |v: u32| if depth[v as usize].is_finite() { depth[v as usize] } else { 0.0 };
    of(a).total_cmp(&of(b)).then(b.cmp(&a))
}

/// The vertex farthest from another over allowed vertices.
fn farthest(graph: &Graph, from: u32, allowed: impl Fn(u32) -> bool) -> Option<u32> {
    let (distance, _) = ways(graph, &[from], &allowed);
    let reached = (0..distance.len() as u32).filter(|&v| distance[v as usize].is_finite());
    reached.max_by(|&a, &b| distance[a as usize].total_cmp(&distance[b as usize]).then(b.cmp(&a)))
}

/// Shortest ways from the sources over allowed vertices: lengths, and the vertex before each (`u32::MAX` at a source).
pub(super) fn ways(graph: &Graph, sources: &[u32], allowed: impl Fn(u32) -> bool) -> (Vec<f64>, Vec<u32>) {
    let mut distance = vec![f64::INFINITY; graph.len()];
    let mut before = vec![u32::MAX; graph.len()];
    let mut heap: BinaryHeap<Reverse<(u64, u32)>> = BinaryHeap::new();
    for &s in sources {
        distance[s as usize] = 0.0;
        heap.push(Reverse((0, s)));
    }
    while let Some(Reverse((bits, v))) = heap.pop() {
        let d = f64::from_bits(bits);
        if d > distance[v as usize] {
            continue;
        }
        for (w, length) in graph.neighbours(v).filter(|n| allowed(n.0)) {
            if d + length < distance[w as usize] {
                distance[w as usize] = d + length;
                before[w as usize] = v;
                heap.push(Reverse(((d + length).to_bits(), w)));
            }
        }
    }
    (distance, before)
}

/// The neighbour graph of a geometry with its bridges, over scene-wide indices.
#[must_use]
pub fn scene_graph(geometry: &sg_clusters::geometry::Geometry) -> Graph {
    let edges = geometry.units.iter().flat_map(|unit| {
        let index = &unit.vertices.gaussian;
        unit.joined().edges().map(|e| Edge { a: index[e.a as usize], b: index[e.b as usize], length: e.length })
    });
    Graph::from_edges(geometry.gaussians, edges)
}
