//! A bounding-volume hierarchy over points. It answers two queries that nearest-neighbour crates lack: the points near a
//! polyline, and the nearest point *of another component*.

use crate::bounds::Bounds;
use crate::polyline::{Polyline, visit};
use crate::vertices::distance_squared;

/// Most points of a leaf.
const LEAF: usize = 16;

/// Subtrees of at most this many points are built by one thread.
const SEQUENTIAL_LIMIT: usize = 4096;

/// A node: its position in the node list, its height, and its points.
///
/// The tree is perfectly balanced, so children need no pointers. The left child follows its parent. The right child is
/// `2^height` positions further. Each child has half of the points.
#[derive(Debug, Clone, Copy)]
struct Node {
    node: usize,
    height: u32,
    start: usize,
    end: usize,
}

impl Node {
    fn children(self) -> Option<[Self; 2]> {
        let height = self.height.checked_sub(1)?;
        let middle = self.start + (self.end - self.start) / 2;
        Some([
            Self { node: self.node + 1, height, start: self.start, end: middle },
            Self { node: self.node + (1 << self.height), height, start: middle, end: self.end },
        ])
    }
}

/// A balanced bounding-volume hierarchy over points.
#[derive(Debug, Clone)]
pub struct PointTree {
    height: u32,
    boxes: Vec<Bounds>,
    /// Points in tree order, each with its index in the input slice.
    points: Vec<([f64; 3], u32)>,
}

/// Component of each node, if all of its points belong to one component.
#[derive(Debug)]
pub struct NodeComponents(Vec<Option<u32>>);

impl PointTree {
    /// Builds the tree of finite points. Queries return indices of this slice.
    #[must_use]
    pub fn new(points: &[[f64; 3]]) -> Self {
        let mut height = 0;
        while points.len() >> height > LEAF {
            height += 1;
        }
        let mut entries: Vec<([f64; 3], u32)> = points.iter().copied().zip(0..).collect();
        let mut boxes = vec![Bounds::EMPTY; (2 << height) - 1];
        build(&mut entries, &mut boxes, height);
        Self { height, boxes, points: entries }
    }

    /// Number of points.
    #[must_use]
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether there is no point.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    fn root(&self) -> Node {
        Node { node: 0, height: self.height, start: 0, end: self.points.len() }
    }

    /// Points in the tube of a radius around a polyline (see [`Polyline::is_closer_than`]), ascending.
    #[must_use]
    pub fn closer_than(&self, polyline: &Polyline, radius: f64) -> Vec<u32> {
        let mut hits = Vec::new();
        if self.is_empty()
            || polyline.is_empty()
            || (radius * radius).partial_cmp(&0.0) != Some(std::cmp::Ordering::Greater)
        {
            return hits;
        }
        // Each node comes with the parts of the polyline within reach.
        let mut stack = vec![(self.root(), vec![polyline.whole()])];
        while let Some((place, parts)) = stack.pop() {
            let own = &self.boxes[place.node];
            visit();
            let near = polyline.parts_near(&parts, own, radius);
            if near.is_empty() {
                continue;
            }
            if let Some([left, right]) = place.children() {
                stack.push((right, near.clone()));
                stack.push((left, near));
            } else {
                hits.extend(
                    self.points[place.start..place.end]
                        .iter()
                        .filter(|(p, _)| polyline.is_closer_than(&near, p, radius))
                        .map(|(_, i)| *i),
                );
            }
        }
        hits.sort_unstable();
        hits
    }

    /// The point nearest to a polyline, as (squared distance, index). Ties go to the smaller index.
    #[must_use]
    pub fn nearest(&self, polyline: &Polyline) -> Option<(f64, u32)> {
        let mut best: Option<(f64, u32)> = None;
        if self.is_empty() || polyline.is_empty() {
            return best;
        }
        let mut stack = vec![(0.0, self.root())];
        while let Some((bound, place)) = stack.pop() {
            if best.is_some_and(|b| bound > b.0) {
                continue;
            }
            if let Some(children) = place.children() {
                let mut near = children.map(|c| (polyline.box_distance_squared(&self.boxes[c.node]), c));
                // The nearer child is searched first.
                if near[0].0 < near[1].0 {
                    near.swap(0, 1);
                }
                stack.extend(near);
            } else {
                for (p, i) in &self.points[place.start..place.end] {
                    let candidate = (polyline.distance_squared(p), *i);
                    if best.is_none_or(|b| candidate < b) {
                        best = Some(candidate);
                    }
                }
            }
        }
        best
    }

    /// Squared distance from a position to the nearest point; infinite for an empty tree.
    #[must_use]
    pub fn nearest_distance_squared(&self, p: &[f64; 3]) -> f64 {
        let mut best = f64::INFINITY;
        if self.is_empty() {
            return best;
        }
        let mut stack = vec![(0.0, self.root())];
        while let Some((bound, place)) = stack.pop() {
            if bound >= best {
                continue;
            }
            if let Some(children) = place.children() {
                let mut near = children.map(|c| (self.boxes[c.node].point_distance_squared(p), c));
                // The nearer child is searched first.
                if near[0].0 < near[1].0 {
                    near.swap(0, 1);
                }
                stack.extend(near);
            } else {
                for (q, _) in &self.points[place.start..place.end] {
                    best = best.min(distance_squared(p, q));
                }
            }
        }
        best
    }

    /// Finds the nodes whose points all belong to one component.
    #[must_use]
    pub fn node_components(&self, component: &[u32]) -> NodeComponents {
        let mut nodes = vec![None; self.boxes.len()];
        if !self.is_empty() {
            self.mark(self.root(), component, &mut nodes);
        }
        NodeComponents(nodes)
    }

    fn mark(&self, place: Node, component: &[u32], nodes: &mut [Option<u32>]) -> Option<u32> {
        let only = if let Some([left, right]) = place.children() {
            let left = self.mark(left, component, nodes);
            let right = self.mark(right, component, nodes);
            if left == right { left } else { None }
        } else {
            let mut all = self.points[place.start..place.end].iter().map(|(_, i)| component[*i as usize]);
            let first = all.next();
            if all.all(|c| Some(c) == first) { first } else { None }
        };
        nodes[place.node] = only;
        only
    }

    /// The nearest point to `query` outside the component `own`, as (squared distance, index). Ties go to the smaller index.
    ///
    /// `limit` is the largest squared distance.
    #[must_use]
    pub fn nearest_foreign(
        &self,
        query: &[f64; 3],
        own: u32,
        component: &[u32],
        nodes: &NodeComponents,
        limit: f64,
    ) -> Option<(f64, u32)> {
        let mut best: Option<(f64, u32)> = None;
        if self.is_empty() {
            return best;
        }
        let mut stack = vec![(0.0, self.root())];
        while let Some((bound, place)) = stack.pop() {
            if bound > best.map_or(limit, |b| b.0) || nodes.0[place.node] == Some(own) {
                continue;
            }
            if let Some(children) = place.children() {
                let mut near = children.map(|c| (self.boxes[c.node].point_distance_squared(query), c));
                if near[0].0 < near[1].0 {
                    near.swap(0, 1);
                }
                stack.extend(near);
            } else {
                for (p, i) in &self.points[place.start..place.end] {
                    let candidate = (distance_squared(query, p), *i);
                    if component[*i as usize] != own && candidate.0 <= limit && best.is_none_or(|b| candidate < b) {
                        best = Some(candidate);
                    }
                }
            }
        }
        best
    }
}

fn build(points: &mut [([f64; 3], u32)], boxes: &mut [Bounds], height: u32) {
    let mut bounds = Bounds::EMPTY;
    for (p, _) in &*points {
        bounds.add(p);
    }
    let Some((own, below)) = boxes.split_first_mut() else { return };
    *own = bounds;
    if height == 0 {
        return;
    }
    let axis = (0..3)
        .max_by(|&a, &b| (bounds.max[a] - bounds.min[a]).total_cmp(&(bounds.max[b] - bounds.min[b])))
        .unwrap_or(0);
    let half = points.len() / 2;
    points.select_nth_unstable_by(half, |a, b| a.0[axis].total_cmp(&b.0[axis]).then(a.1.cmp(&b.1)));
    let (left, right) = points.split_at_mut(half);
    let (left_boxes, right_boxes) = below.split_at_mut((1 << height) - 1);
    if left.len() > SEQUENTIAL_LIMIT {
        rayon::join(|| build(left, left_boxes, height - 1), || build(right, right_boxes, height - 1));
    } else {
        build(left, left_boxes, height - 1);
        build(right, right_boxes, height - 1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::polyline::VISITS;
    use glam::DVec3;
    use proptest::prelude::*;
    use sg_scene::synthetic::{in_tube, random_points_f64, segment_distance};

    fn brute(points: &[[f64; 3]], line: &[DVec3]) -> Vec<f64> {
        points
            .iter()
            .map(|p| {
                let p = DVec3::from_array(*p);
                let single = line.first().map_or(f64::INFINITY, |a| (p - *a).length());
                line.windows(2).map(|w| segment_distance(p, w[0], w[1])).fold(single, f64::min)
            })
            .collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(100))]
        #[test]
        fn a_tube_is_all_points_closer_than_its_radius(
            n in 0..400_usize, seed in 0..100_u64, radius in 0.0..0.6_f64,
            line in proptest::collection::vec([-0.2..1.2_f64, -0.2..1.2, -0.2..1.2], 1..40)
        ) {
            let points = random_points_f64(n, seed);
            let line: Vec<DVec3> = line.into_iter().map(DVec3::from_array).collect();
            let tree = PointTree::new(&points);
            let polyline = Polyline::new(&line);
            let distance = brute(&points, &line);
            let want: Vec<u32> = (0..).zip(&distance).filter(|(_, d)| **d < radius).map(|(i, _)| i).collect();
            prop_assert_eq!(tree.closer_than(&polyline, radius), want);
            let nearest = tree.nearest(&polyline).map(|b| b.0.sqrt());
            let want = distance.iter().copied().min_by(f64::total_cmp);
            prop_assert_eq!(nearest.is_some(), want.is_some());
            prop_assert!((nearest.unwrap_or(0.0) - want.unwrap_or(0.0)).abs() < 1e-12);
        }

        #[test]
        fn the_nearest_foreign_point_is_that_of_a_full_scan(n in 2..300_usize, seed in 0..50_u64, parts in 1..6_u32) {
            let points = random_points_f64(n, seed);
            let component: Vec<u32> = (0..n as u32).map(|i| (i * 7 + i * i) % parts).collect();
            let tree = PointTree::new(&points);
            let nodes = tree.node_components(&component);
            for (i, p) in points.iter().enumerate().step_by(7) {
                let want = (0..n)
                    .filter(|&j| component[j] != component[i])
                    .map(|j| (distance_squared(p, &points[j]), j as u32))
                    .min_by(|a, b| a.partial_cmp(b).unwrap());
                prop_assert_eq!(tree.nearest_foreign(p, component[i], &component, &nodes, f64::INFINITY), want);
            }
        }
    }

    #[test]
    fn coincident_points_and_a_point_on_the_line() {
        let tree = PointTree::new(&vec![[1.0; 3]; 1000]);
        let line = Polyline::new(&[DVec3::ONE, DVec3::ONE, DVec3::ONE]);
        assert_eq!(tree.closer_than(&line, 1e-9).len(), 1000);
        assert!(
            tree.closer_than(&line, 0.0).is_empty(),
            "a tube without radius holds nothing, not even what it passes"
        );
        assert!(tree.closer_than(&line, f64::NAN).is_empty());
        assert_eq!(tree.nearest(&line), Some((0.0, 0)));
    }

    #[test]
    fn a_hundred_thousand_samples_cost_little_more_than_their_hits() {
        let points = random_points_f64(50_000, 1);
        let tree = PointTree::new(&points);
        let line: Vec<DVec3> = (0..100_000)
            .map(|i| {
                DVec3::splat(0.5) + 0.1 * DVec3::new((f64::from(i) * 0.01).sin(), (f64::from(i) * 0.013).cos(), 0.0)
            })
            .collect();
        let polyline = Polyline::new(&line);
        let hits = tree.closer_than(&polyline, 0.03);
        // The same without the tree, on a sample of the points.
        for i in (0..points.len()).step_by(997) {
            let want = brute(&points[i..=i], &line)[0] < 0.03;
            assert_eq!(hits.binary_search(&(i as u32)).is_ok(), want);
        }
    }

    #[test]
    fn a_hundred_thousand_samples_look_at_few_boxes() {
        let points = random_points_f64(20_000, 6);
        let tree = PointTree::new(&points);
        let counted = |many: usize, pressed: bool| {
            // The same way through the scene, sampled ever more densely, trembling by a thousandth.
            let samples: Vec<DVec3> = (0..many)
                .map(|i| {
                    let t = i as f64 / many as f64;
                    let tremble = 1e-3 * (0.37 * i as f64).sin();
                    DVec3::splat(0.5) + 0.3 * DVec3::new((9.0 * t).sin(), (7.0 * t).cos(), t + tremble)
                })
                .collect();
            let factors: Vec<f64> = (0..many).map(|i| 1.0 + 0.5 * (20.0 * i as f64 / many as f64).sin()).collect();
            VISITS.set(0);
            let hits = tree.closer_than(&Polyline::with_pressure(&samples, if pressed { &factors } else { &[] }), 0.05);
            if pressed {
                for g in (0..20_000).step_by(997) {
                    let want = in_tube(DVec3::from_array(points[g as usize]), &samples, 0.05, &factors);
                    assert_eq!(hits.binary_search(&g).is_ok(), want);
                }
            }
            (hits.len() as u64, VISITS.get())
        };
        for pressed in [false, true] {
            let (few, many) = (counted(100, pressed), counted(100_000, pressed));
            println!(
                "pressed {pressed}: 100 samples {} hits, {} boxes; 100,000 samples {} hits, {} boxes",
                few.0, few.1, many.0, many.1
            );
            // Segment by segment it would be 100,000 descents of some 40 boxes each, and as many looks at the same hits.
            assert!(many.1 < 200_000 + 100 * many.0, "{many:?}");
        }
    }
}
