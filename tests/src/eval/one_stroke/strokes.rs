//! Green strokes over one part of a scene: a share of the part's extent, along the surface, with a tremor.

use glam::DVec3;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use sg_clusters::neighbours::Graph;
use sg_scene::model::Scene;
use sg_selection::strokes::{Kind, Mode, Stroke};

use super::super::hand::{RADIUS, ways};
use super::super::solid::normal;

/// Most samples of a stroke.
const SAMPLES: usize = 32;
/// Radius over the part's extent, where the ordinary brush would be wider.
const SMALL: f64 = 0.08;

/// A part of a scene as the target of strokes.
pub struct Target<'a> {
    scene: &'a Scene,
    graph: &'a Graph,
    inside: Vec<bool>,
    members: Vec<u32>,
    /// Diagonal of the part's box, without the outermost hundredth on each side.
    extent: f64,
}

impl<'a> Target<'a> {
    /// The target of the given members. None if it has no member.
    #[must_use]
    pub fn new(scene: &'a Scene, graph: &'a Graph, inside: Vec<bool>) -> Option<Self> {
        let members: Vec<u32> = (0..).zip(&inside).filter(|(_, t)| **t).map(|(g, _)| g).collect();
        let mut extent = DVec3::ZERO;
        for axis in 0..3 {
            let mut values: Vec<f64> =
                members.iter().filter_map(|g| scene.position(*g as usize)).map(|p| p[axis]).collect();
            values.sort_by(f64::total_cmp);
            let cut = values.len() / 100;
            extent[axis] = values.get(values.len().checked_sub(1 + cut)?)? - values.get(cut)?;
        }
        Some(Self { scene, graph, inside, members, extent: extent.length() })
    }

    /// Whether each Gaussian belongs to the target.
    #[must_use]
    pub fn inside(&self) -> &[bool] {
        &self.inside
    }

    /// A green stroke that spans a share of the extent, the same for a seed.
    #[must_use]
    pub fn stroke(&self, share: f64, seed: u64, stream: u64) -> Option<Stroke> {
        let mut r = ChaCha8Rng::seed_from_u64(seed);
        r.set_stream(stream);
        let at = |g: u32| self.scene.position(g as usize).unwrap_or(DVec3::ZERO);
        let mut any = || self.members[r.random_range(0..self.members.len())];
        let start = any();
        let (distance, back) = ways(self.graph, &[start], |v| self.inside[v as usize]);
        let wanted = share * self.extent;
        // Of some reachable places the first that is far enough; else the farthest.
        let mut end = start;
        for _ in 0..24 {
            let place = any();
            if !distance[place as usize].is_finite() {
                continue;
            }
            if at(place).distance(at(start)) > at(end).distance(at(start)) {
                end = place;
            }
            if at(end).distance(at(start)) >= wanted {
                break;
            }
        }
        let mut way = vec![end];
        while let Some(&next) = way.last().and_then(|v| back.get(*v as usize)).filter(|v| **v != u32::MAX) {
            way.push(next);
        }
        way.reverse();
        let enough = way.iter().position(|v| at(*v).distance(at(start)) >= wanted).unwrap_or(way.len() - 1);
        let way = &way[..=enough];
        let edge = self.scene.bounds.longest_edge();
        let radius = RADIUS.min(SMALL * self.extent / edge);
        let points = way
            .iter()
            .step_by(way.len().div_ceil(SAMPLES))
            .map(|v| {
                let tremor = 0.3 * radius * edge * DVec3::new(normal(&mut r), normal(&mut r), normal(&mut r));
                self.scene.bounds.normalize(at(*v) + tremor).to_array()
            })
            .collect();
        Some(Stroke { mode: Mode::Walk, kind: Kind::Foreground, radius, points, pressure: Vec::new(), depth: None })
    }
}
