//! Which Gaussians a brush stroke hits.

use glam::DVec3;
use sg_scene::model::Scene;

use crate::geometry::Geometry;
use crate::polyline::Polyline;
use crate::tree::PointTree;
use crate::vertices::Vertices;

/// The centres of a scene's Gaussians, ready to be brushed over.
#[derive(Debug, Clone)]
pub struct Brush {
    units: Vec<(Vec<u32>, PointTree)>,
}

impl Brush {
    /// The brush over the finite centres of a scene, in the scene frame.
    #[must_use]
    pub fn of_scene(scene: &Scene) -> Self {
        Self::of_vertices(scene.units.iter().map(|u| Vertices::of_unit(u).0))
    }

    /// The brush over the vertices of a geometry.
    #[must_use]
    pub fn of_geometry(geometry: &Geometry) -> Self {
        Self::of_vertices(geometry.units.iter().map(|u| u.vertices.clone()))
    }

    fn of_vertices(units: impl Iterator<Item = Vertices>) -> Self {
        Self { units: units.map(|v| (v.gaussian, PointTree::new(&v.position))).collect() }
    }

    /// Scene-wide indices of the Gaussians whose centre is closer than `radius` to the polyline through the samples
    /// (scene frame, scene length unit), ascending. Time grows with the hits, not with the scene.
    #[must_use]
    pub fn hits(&self, samples: &[DVec3], radius: f64) -> Vec<u32> {
        let polyline = Polyline::new(samples);
        let mut hits: Vec<u32> = self
            .units
            .iter()
            .flat_map(|(index, tree)| tree.closer_than(&polyline, radius).into_iter().map(|v| index[v as usize]))
            .collect();
        hits.sort_unstable();
        hits
    }

    /// Scene-wide index of the Gaussian whose centre is nearest to the polyline, ties to the smaller index; none in a
    /// scene without a finite centre.
    #[must_use]
    pub fn nearest(&self, samples: &[DVec3]) -> Option<u32> {
        let polyline = Polyline::new(samples);
        self.units
            .iter()
            .filter_map(|(index, tree)| tree.nearest(&polyline).map(|(d, v)| (d, index[v as usize])))
            .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))
            .map(|(_, g)| g)
    }
}

/// A stroke while it is being drawn: each new sample adds the hits of its own segment, so the preview costs what the
/// sample hits and not what the stroke has become.
#[derive(Debug, Clone)]
pub struct OpenStroke {
    radius: f64,
    last: Option<DVec3>,
    hits: Vec<u32>,
    seen: sg_scene::mask::Mask,
}

impl OpenStroke {
    /// A stroke of the given radius (scene length unit) over a scene of `gaussians`, without a sample yet.
    #[must_use]
    pub fn new(gaussians: usize, radius: f64) -> Self {
        Self { radius, last: None, hits: Vec::new(), seen: sg_scene::mask::Mask::empty(gaussians) }
    }

    /// Adds a sample (scene frame); returns the Gaussians it hits that no earlier one did, ascending.
    pub fn extend(&mut self, brush: &Brush, sample: DVec3) -> &[u32] {
        let from = self.last.unwrap_or(sample);
        let before = self.hits.len();
        for g in brush.hits(&[from, sample], self.radius) {
            if !self.seen.get(g as usize) {
                self.seen.set(g as usize, true);
                self.hits.push(g);
            }
        }
        self.last = Some(sample);
        &self.hits[before..]
    }

    /// All hits so far, in the order they were made.
    #[must_use]
    pub fn hits(&self) -> &[u32] {
        &self.hits
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_scenes::{generator, point_scene, random_points, random_unit, segment_distance};
    use glam::DMat4;
    use rand::RngExt;

    #[test]
    fn a_growing_stroke_hits_what_the_whole_one_hits() {
        let scene = point_scene(&random_points(5000, 1));
        let brush = Brush::of_scene(&scene);
        let mut r = generator(2);
        let samples: Vec<DVec3> =
            (0..40).map(|_| DVec3::from_array(std::array::from_fn(|_| r.random_range(0.0..1.0)))).collect();
        let mut open = OpenStroke::new(scene.len(), 0.05);
        let mut added = 0;
        for s in &samples {
            added += open.extend(&brush, *s).len();
        }
        let mut grown = open.hits().to_vec();
        grown.sort_unstable();
        assert_eq!(grown.len(), added);
        assert_eq!(grown, brush.hits(&samples, 0.05));
    }

    #[test]
    fn transforms_of_units_apply_to_what_is_hit() {
        let mut a = random_unit(300, 3);
        a.transform = DMat4::from_scale(DVec3::splat(0.5)) * DMat4::from_translation(DVec3::new(4.0, 0.0, 0.0));
        let mut b = random_unit(300, 4);
        b.name = "b".into();
        let scene = Scene::compose(vec![a, b], None);
        let brush = Brush::of_scene(&scene);
        let (from, to, radius) = (DVec3::new(-1.0, 0.0, 0.0), DVec3::new(3.0, 0.2, 0.0), 0.3);
        let want: Vec<u32> = (0..scene.len())
            .filter(|&i| segment_distance(scene.position(i).unwrap(), from, to) < radius)
            .map(|i| i as u32)
            .collect();
        assert!(want.iter().any(|i| *i < 300) && want.iter().any(|i| *i >= 300));
        assert_eq!(brush.hits(&[from, to], radius), want);
    }

    #[test]
    fn a_miss_names_the_nearest_and_an_empty_scene_nobody() {
        let brush = Brush::of_scene(&point_scene(&[[0.0; 3], [1.0; 3], [f32::NAN; 3]]));
        assert!(brush.hits(&[DVec3::splat(50.0)], 0.1).is_empty());
        assert_eq!(brush.nearest(&[DVec3::splat(50.0)]), Some(1));
        assert_eq!(Brush::of_scene(&point_scene(&[])).nearest(&[DVec3::ZERO]), None);
    }
}
