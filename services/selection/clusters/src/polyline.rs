//! Exact distances to a polyline, with a hierarchy of boxes over consecutive segments.

use glam::DVec3;

use crate::bounds::Bounds;

/// Segments of a leaf.
const LEAF: usize = 4;

/// A polyline in the scene frame with a thickness at each sample. One sample is a point; repeated samples are dropped.
#[derive(Debug, Clone)]
pub struct Polyline {
    samples: Vec<DVec3>,
    /// Factor on the tube's radius at each sample; empty without pressure.
    factors: Vec<f64>,
    /// Boxes of runs of `LEAF · 2^level` segments for each level. The last level is the root.
    levels: Vec<Vec<Bounds>>,
    /// The largest factor of each run; empty without pressure.
    largest: Vec<Vec<f64>>,
    depth_limit: Option<DepthLimit>,
}

/// Limit of a tube in depth: excludes points too far behind the nearest point of the polyline, seen from a viewpoint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthLimit {
    /// Viewpoint in the frame of the samples.
    pub eye: DVec3,
    /// Largest allowed distance behind the polyline, in the unit of the samples, at least 0.
    pub max_distance: f64,
}

impl DepthLimit {
    /// Whether the limit admits a point `p` whose nearest point of the polyline is `middle`.
    fn admits(&self, p: DVec3, middle: DVec3) -> bool {
        p.distance(self.eye) <= middle.distance(self.eye) + self.max_distance
    }
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
        Self::with_pressure(samples, &[])
    }

    /// The polyline with a pressure factor on the tube's radius at each sample, finite and at least 0. Samples beyond the end
    /// of `factors` have the factor 1.
    #[must_use]
    pub fn with_pressure(samples: &[DVec3], factors: &[f64]) -> Self {
        let pressed = !factors.is_empty();
        let one = |i: usize| factors.get(i).copied().unwrap_or(1.0);
        let mut pairs: Vec<(DVec3, f64)> = samples.iter().enumerate().map(|(i, s)| (*s, one(i))).collect();
        pairs.dedup();
        let (samples, mut factors): (Vec<DVec3>, Vec<f64>) = pairs.into_iter().unzip();
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
        let mut largest: Vec<Vec<f64>> = Vec::new();
        if pressed {
            let most = |factors: &[f64]| factors.iter().copied().fold(0.0, f64::max);
            let leaf = |i: usize| most(&factors[i * LEAF..(i * LEAF + LEAF + 1).min(factors.len())]);
            largest.push((0..segments.div_ceil(LEAF)).map(leaf).collect());
            while let Some(last) = largest.last().filter(|l| l.len() > 1) {
                let next = last.chunks(2).map(most).collect();
                largest.push(next);
            }
        } else {
            factors.clear();
        }
        Self { samples, factors, levels, largest, depth_limit: None }
    }

    /// [`Polyline::with_pressure`] with a limit in depth.
    #[must_use]
    pub fn with_depth_limit(samples: &[DVec3], factors: &[f64], depth_limit: Option<DepthLimit>) -> Self {
        if depth_limit.is_none() || !factors.is_empty() {
            return Self { depth_limit, ..Self::with_pressure(samples, factors) };
        }
        // The limit is evaluated in the code path of the factors.
        Self { depth_limit, ..Self::with_pressure(samples, &vec![1.0; samples.len()]) }
    }

    /// Whether there is no sample.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.samples.is_empty()
    }

    /// The whole polyline as one part.
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

    /// Squared largest radius of the tube around a part.
    fn limit(&self, part: Part, radius: f64) -> f64 {
        let radius = self.largest.get(part.level).map_or(radius, |largest| radius * largest[part.index]);
        radius * radius
    }

    /// Parts whose tube reaches a box, split until they are about as small as the box.
    #[must_use]
    pub fn parts_near(&self, parts: &[Part], to: &Bounds, radius: f64) -> Vec<Part> {
        let size = |b: &Bounds| (0..3).map(|a| b.max[a] - b.min[a]).fold(0.0, f64::max);
        let enough = size(to);
        let mut near = Vec::with_capacity(parts.len());
        let mut stack: Vec<Part> = parts.to_vec();
        while let Some(part) = stack.pop() {
            visit();
            let own = self.bounds(part);
            if own.distance_squared(to) >= self.limit(part, radius) {
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

    /// Whether a point is in the tube around one of the parts.
    ///
    /// The point must be closer than the local radius to a sample, or to the nearest point of a segment. The local radius is
    /// the radius times the factor there; factors are linear between samples. Points beyond the depth limit (see
    /// [`Polyline::with_depth_limit`]) are excluded.
    #[must_use]
    pub fn is_closer_than(&self, parts: &[Part], p: &[f64; 3], radius: f64) -> bool {
        let at = DVec3::from_array(*p);
        let mut stack: Vec<Part> = parts.to_vec();
        while let Some(part) = stack.pop() {
            visit();
            if self.bounds(part).point_distance_squared(p) >= self.limit(part, radius) {
                continue;
            }
            if part.level > 0 {
                stack.extend(self.halves(part));
            } else if self.leaf_is_closer_than(part.index, at, radius) {
                return true;
            }
        }
        false
    }

    /// Squared distance from a point to the polyline.
    #[must_use]
    pub fn distance_squared(&self, p: &[f64; 3]) -> f64 {
        let at = DVec3::from_array(*p);
        self.best(|b| b.point_distance_squared(p), |leaf| self.leaf_distance_squared(leaf, at))
    }

    /// A lower bound of the squared distance from a box, from the boxes of the polyline's leaves.
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

    fn leaf_is_closer_than(&self, leaf: usize, p: DVec3, radius: f64) -> bool {
        if self.factors.is_empty() {
            return self.leaf_distance_squared(leaf, p) < radius * radius;
        }
        let run = leaf * LEAF..(leaf * LEAF + LEAF + 1).min(self.samples.len());
        let (samples, factors) = (&self.samples[run.clone()], &self.factors[run]);
        let within = |middle: DVec3, factor: f64| {
            (p - middle).length_squared() < (radius * factor) * (radius * factor)
                && self.depth_limit.is_none_or(|limit| limit.admits(p, middle))
        };
        let balls = || samples.iter().zip(factors).any(|(s, f)| within(*s, *f));
        let between = |(s, f): (&[DVec3], &[f64])| {
            let ab = s[1] - s[0];
            let along = (p - s[0]).dot(ab) / ab.length_squared();
            // The balls decide at the ends, and for samples too close together to divide by their distance.
            along > 0.0 && along < 1.0 && {
                let factor = (f[0] + along * (f[1] - f[0])).clamp(f[0].min(f[1]), f[0].max(f[1]));
                within(s[0] + ab * along, factor)
            }
        };
        balls() || samples.windows(2).zip(factors.windows(2)).any(between)
    }

    fn leaf_distance_squared(&self, leaf: usize, p: DVec3) -> f64 {
        let end = (leaf * LEAF + LEAF + 1).min(self.samples.len());
        let run = &self.samples[leaf * LEAF..end];
        let first = run.first().map_or(f64::INFINITY, |a| (p - *a).length_squared());
        run.windows(2).fold(first, |best, w| best.min(segment_distance_squared(p, w[0], w[1])))
    }
}

#[cfg(test)]
thread_local! {
    /// Boxes and leaves examined by this thread, for tests of the cost of a query.
    pub(crate) static VISITS: std::cell::Cell<u64> = const { std::cell::Cell::new(0) };
}

/// Counts one examined box or leaf; does nothing outside tests.
pub(crate) fn visit() {
    #[cfg(test)]
    VISITS.set(VISITS.get() + 1);
}

fn segment_distance_squared(p: DVec3, a: DVec3, b: DVec3) -> f64 {
    let ab = b - a;
    let along = (p - a).dot(ab) / ab.length_squared();
    // Samples so close together that the square of their distance is zero make `along` no number: the start decides.
    if along > 0.0 { (p - (a + ab * along.min(1.0))).length_squared() } else { (p - a).length_squared() }
}
