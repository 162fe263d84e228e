//! Exact distances to a polyline of any number of samples, through a tree of boxes over consecutive segments.

use glam::DVec3;

use crate::tree::Bounds;

/// Segments a leaf holds.
const LEAF: usize = 4;

/// A polyline in the scene frame. One sample is a point; repeated samples add nothing.
#[derive(Debug, Clone)]
pub struct Polyline {
    samples: Vec<DVec3>,
    /// Boxes of runs of `LEAF · 2^level` segments, level after level, the last holds the root alone.
    levels: Vec<Vec<Bounds>>,
}

/// A run of consecutive segments.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Part {
    level: usize,
    index: usize,
}

impl Polyline {
    /// The polyline through finite samples, in order.
    #[must_use]
    pub fn new(samples: &[DVec3]) -> Self {
        let mut samples = samples.to_vec();
        samples.dedup();
        let segments = samples.len().saturating_sub(1).max(usize::from(!samples.is_empty()));
        let mut levels: Vec<Vec<Bounds>> = Vec::new();
        let leaves: Vec<Bounds> = (0..segments.div_ceil(LEAF))
            .map(|i| {
                let mut b = Bounds::EMPTY;
                let end = (i * LEAF + LEAF + 1).min(samples.len());
                for s in &samples[i * LEAF..end] {
                    b.add(&s.to_array());
                }
                b
            })
            .collect();
        levels.push(leaves);
        while let Some(last) = levels.last().filter(|l| l.len() > 1) {
            let next = last.chunks(2).map(|c| c.iter().fold(Bounds::EMPTY, |b, o| b.union(o))).collect();
            levels.push(next);
        }
        Self { samples, levels }
    }

    /// Whether there is no sample.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.samples.is_empty()
    }

    /// All of it.
    #[must_use]
    pub fn whole(&self) -> Part {
        Part { level: self.levels.len() - 1, index: 0 }
    }

    fn bounds(&self, part: Part) -> &Bounds {
        &self.levels[part.level][part.index]
    }

    fn halves(&self, part: Part) -> impl Iterator<Item = Part> + use<> {
        let (level, end) = match part.level.checked_sub(1) {
            Some(level) => (level, self.levels[level].len()),
            None => (0, 0),
        };
        (2 * part.index..(2 * part.index + 2).min(end)).map(move |index| Part { level, index })
    }

    /// Those of the parts that are closer than the root of `limit` to a box, split until they are about as small as it.
    #[must_use]
    pub fn parts_near(&self, parts: &[Part], to: &Bounds, limit: f64) -> Vec<Part> {
        let size = |b: &Bounds| (0..3).map(|a| b.max[a] - b.min[a]).fold(0.0, f64::max);
        let enough = size(to);
        let mut near = Vec::with_capacity(parts.len());
        let mut stack: Vec<Part> = parts.to_vec();
        while let Some(part) = stack.pop() {
            let own = self.bounds(part);
            if own.distance_squared(to) >= limit {
                continue;
            }
            if part.level > 0 && size(own) > enough {
                stack.extend(self.halves(part));
            } else {
                near.push(part);
            }
        }
        near
    }

    /// Whether the point is closer than the root of `limit` to one of the parts.
    #[must_use]
    pub fn is_closer_than(&self, parts: &[Part], p: &[f64; 3], limit: f64) -> bool {
        let at = DVec3::from_array(*p);
        let mut stack: Vec<Part> = parts.to_vec();
        while let Some(part) = stack.pop() {
            if self.bounds(part).point_distance_squared(p) >= limit {
                continue;
            }
            if part.level > 0 {
                stack.extend(self.halves(part));
            } else if self.leaf_distance_squared(part.index, at) < limit {
                return true;
            }
        }
        false
    }

    /// Squared distance of a point.
    #[must_use]
    pub fn distance_squared(&self, p: &[f64; 3]) -> f64 {
        let at = DVec3::from_array(*p);
        self.best(|b| b.point_distance_squared(p), |leaf| self.leaf_distance_squared(leaf, at))
    }

    /// A lower bound of the squared distance of a box: that of the boxes of the polyline's leaves.
    #[must_use]
    pub fn box_distance_squared(&self, to: &Bounds) -> f64 {
        self.best(|b| b.distance_squared(to), |leaf| self.levels[0][leaf].distance_squared(to))
    }

    fn best(&self, bound: impl Fn(&Bounds) -> f64, leaf: impl Fn(usize) -> f64) -> f64 {
        let mut best = f64::INFINITY;
        let mut stack = vec![self.whole()];
        while let Some(part) = stack.pop() {
            if bound(self.bounds(part)) >= best {
                continue;
            }
            if part.level > 0 {
                stack.extend(self.halves(part));
            } else {
                best = best.min(leaf(part.index));
            }
        }
        best
    }

    fn leaf_distance_squared(&self, leaf: usize, p: DVec3) -> f64 {
        let end = (leaf * LEAF + LEAF + 1).min(self.samples.len());
        let run = &self.samples[leaf * LEAF..end];
        let first = run.first().map_or(f64::INFINITY, |a| (p - *a).length_squared());
        run.windows(2).fold(first, |best, w| best.min(segment_distance_squared(p, w[0], w[1])))
    }
}

fn segment_distance_squared(p: DVec3, a: DVec3, b: DVec3) -> f64 {
    let ab = b - a;
    let along = (p - a).dot(ab) / ab.length_squared();
    // Samples so close together that the square of their distance is zero make `along` no number: the start decides.
    if along > 0.0 { (p - (a + ab * along.min(1.0))).length_squared() } else { (p - a).length_squared() }
}
