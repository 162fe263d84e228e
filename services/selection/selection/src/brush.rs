//! Gaussians under a brush stroke.

use glam::DVec3;
use sg_scene::mask::Mask;
use sg_scene::model::Scene;

use sg_clusters::bvh::PointTree;
use sg_clusters::geometry::Geometry;
use sg_clusters::polyline::{DepthLimit, Polyline};
use sg_clusters::vertices::Vertices;

/// A search tree over the centres of a scene's Gaussians.
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

    /// Gaussians whose centre is closer than `radius` to the polyline through the samples. Scene-wide indices, ascending.
    ///
    /// Samples and radius are in the scene frame and the scene's length unit. The time depends on the number of hits.
    #[must_use]
    pub fn hits(&self, samples: &[DVec3], radius: f64) -> Vec<u32> {
        self.hits_of(&Polyline::new(samples), radius)
    }

    /// [`Brush::hits`] with a pressure factor on the radius at each sample, finite and at least 0.
    ///
    /// Along a segment the factor is interpolated linearly. Samples beyond the end of `factors` have the factor 1.
    #[must_use]
    pub fn hits_with_pressure(&self, samples: &[DVec3], radius: f64, factors: &[f64]) -> Vec<u32> {
        self.hits_of(&Polyline::with_pressure(samples, factors), radius)
    }

    /// [`Brush::hits_with_pressure`] with a limit on the depth behind the stroke, as seen from a viewpoint.
    #[must_use]
    pub fn hits_with_depth_limit(
        &self,
        samples: &[DVec3],
        radius: f64,
        factors: &[f64],
        limit: Option<DepthLimit>,
    ) -> Vec<u32> {
        self.hits_of(&Polyline::with_depth_limit(samples, factors, limit), radius)
    }

    fn hits_of(&self, polyline: &Polyline, radius: f64) -> Vec<u32> {
        let mut hits: Vec<u32> = self
            .units
            .iter()
            .flat_map(|(index, tree)| tree.closer_than(polyline, radius).into_iter().map(|v| index[v as usize]))
            .collect();
        hits.sort_unstable();
        hits
    }

    /// Scene-wide index of the Gaussian whose centre is nearest to the polyline. Ties go to the smaller index. `None` in a
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

/// An unfinished stroke. A new sample searches its own segment only, so its cost is independent of the stroke's length.
#[derive(Debug, Clone)]
pub struct OpenStroke {
    radius: f64,
    /// The last sample and its factor on the radius, if any.
    last: Option<(DVec3, Option<f64>)>,
    hits: Vec<u32>,
    hit: Mask,
    depth_limit: Option<DepthLimit>,
}

impl OpenStroke {
    /// A stroke without samples over a scene of `gaussians` Gaussians. The radius is in the scene's length unit.
    #[must_use]
    pub fn new(gaussians: usize, radius: f64) -> Self {
        Self { radius, last: None, hits: Vec::new(), hit: Mask::empty(gaussians), depth_limit: None }
    }

    /// The same stroke with a limit on the depth behind it.
    #[must_use]
    pub fn with_depth_limit(self, depth_limit: Option<DepthLimit>) -> Self {
        Self { depth_limit, ..self }
    }

    /// Adds a sample in the scene frame. Returns the new hits, ascending.
    pub fn extend(&mut self, brush: &Brush, sample: DVec3) -> &[u32] {
        self.add(brush, sample, None)
    }

    /// [`OpenStroke::extend`] with a pressure factor at the sample, as in [`Brush::hits_with_pressure`].
    pub fn extend_with_pressure(&mut self, brush: &Brush, sample: DVec3, factor: f64) -> &[u32] {
        self.add(brush, sample, Some(factor))
    }

    fn add(&mut self, brush: &Brush, sample: DVec3, factor: Option<f64>) -> &[u32] {
        let (from, old) = self.last.unwrap_or((sample, factor));
        let factors = match (old, factor) {
            (None, None) => Vec::new(),
            _ => vec![old.unwrap_or(1.0), factor.unwrap_or(1.0)],
        };
        let before = self.hits.len();
        for g in brush.hits_with_depth_limit(&[from, sample], self.radius, &factors, self.depth_limit) {
            if !self.hit.get(g as usize) {
                self.hit.set(g as usize, true);
                self.hits.push(g);
            }
        }
        self.last = Some((sample, factor));
        &self.hits[before..]
    }

    /// All hits so far, in the order of their samples.
    #[must_use]
    pub fn hits(&self) -> &[u32] {
        &self.hits
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat4;
    use proptest::prelude::*;
    use rand::RngExt;
    use sg_scene::synthetic::{generator, in_tube, point_scene, random_points, random_unit, segment_distance};

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
    fn a_stroke_over_a_surface_reaches_only_so_far_behind_it() {
        let scene = point_scene(&random_points(5000, 4));
        let brush = Brush::of_scene(&scene);
        let mut r = generator(5);
        let mut place = || DVec3::from_array(std::array::from_fn(|_| r.random_range(0.0..1.0)));
        let samples: Vec<DVec3> = (0..20).map(|_| place()).collect();
        let eye = DVec3::new(0.5, -3.0, 0.5);
        let whole = brush.hits(&samples, 0.08);
        let mut before = 0;
        for most in [0.0, 0.02, 0.05, 0.081] {
            let limit = Some(DepthLimit { eye, max_distance: most });
            let hits = brush.hits_with_depth_limit(&samples, 0.08, &[], limit);
            let position = |g: u32| scene.units[0].gaussians.position[g as usize].as_dvec3();
            let reached = |g: &u32| {
                let p = position(*g);
                let near = |middle: DVec3| p.distance(middle) < 0.08 && p.distance(eye) <= middle.distance(eye) + most;
                let on = |w: &[DVec3]| {
                    let along = (p - w[0]).dot(w[1] - w[0]) / (w[1] - w[0]).length_squared();
                    (0.0..1.0).contains(&along) && near(w[0].lerp(w[1], along))
                };
                samples.iter().any(|s| near(*s)) || samples.windows(2).any(on)
            };
            assert_eq!(hits, whole.iter().copied().filter(reached).collect::<Vec<_>>(), "{most}");
            let mut open = OpenStroke::new(scene.len(), 0.08).with_depth_limit(limit);
            for sample in &samples {
                open.extend(&brush, *sample);
            }
            let mut grown = open.hits().to_vec();
            grown.sort_unstable();
            assert_eq!(grown, hits, "{most}");
            assert!(hits.len() > before);
            before = hits.len();
        }
        assert_eq!(before, whole.len(), "deeper than the brush is thick is no limit");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(200))]

        #[test]
        fn a_pressed_stroke_hits_what_its_definition_says(
            n in 0..400_usize, seed in 0..100_u64, radius in 0.0..0.3_f64,
            drawn in proptest::collection::vec(([-0.2..1.2_f64, -0.2..1.2, -0.2..1.2], 0.0..2.5_f64, 0..4_u8), 1..40)
        ) {
            let scene = point_scene(&random_points(n, seed));
            let brush = Brush::of_scene(&scene);
            let (mut samples, mut factors): (Vec<DVec3>, Vec<f64>) = (Vec::new(), Vec::new());
            for (at, factor, odd) in drawn {
                // Some stay in place with another pressure, some have none at all.
                samples.push(samples.last().copied().filter(|_| odd == 0).unwrap_or_else(|| DVec3::from_array(at)));
                factors.push(if odd == 1 { 0.0 } else { factor });
            }
            let want: Vec<u32> = (0..n as u32)
                .filter(|&g| in_tube(scene.position(g as usize).unwrap(), &samples, radius, &factors))
                .collect();
            prop_assert_eq!(&brush.hits_with_pressure(&samples, radius, &factors), &want);
            let mut open = OpenStroke::new(n, radius);
            for (s, f) in samples.iter().zip(&factors) {
                open.extend_with_pressure(&brush, *s, *f);
            }
            let mut grown = open.hits().to_vec();
            grown.sort_unstable();
            prop_assert_eq!(&grown, &want);
            let backwards: Vec<DVec3> = samples.iter().rev().copied().collect();
            let pressure: Vec<f64> = factors.iter().rev().copied().collect();
            prop_assert_eq!(&brush.hits_with_pressure(&backwards, radius, &pressure), &want);
            // A factor of one is none.
            prop_assert_eq!(
                brush.hits_with_pressure(&samples, radius, &vec![1.0; samples.len()]),
                brush.hits(&samples, radius)
            );
        }
    }

    #[test]
    fn one_sample_repeated_samples_no_radius_and_outside_the_box() {
        let scene = point_scene(&random_points(3000, 5));
        let brush = Brush::of_scene(&scene);
        let closer = |at: DVec3, radius: f64| -> Vec<u32> {
            let near = |g: &u32| (scene.position(*g as usize).unwrap() - at).length() < radius;
            (0..3000).filter(near).collect()
        };
        let at = DVec3::splat(0.5);
        let ball = closer(at, 0.2);
        assert!(ball.len() > 50);
        assert_eq!(brush.hits(&[at], 0.2), ball);
        assert_eq!(brush.hits_with_pressure(&[at], 0.1, &[2.0]), ball);
        assert_eq!(brush.hits(&[at; 9], 0.2), ball);
        // The same place with growing and falling pressure: the largest counts.
        assert_eq!(brush.hits_with_pressure(&[at; 5], 0.1, &[0.0, 1.0, 2.0, 1.5, 0.0]), ball);
        for samples in [vec![at], vec![DVec3::ZERO, DVec3::ONE]] {
            assert!(brush.hits(&samples, 0.0).is_empty());
            assert!(brush.hits_with_pressure(&samples, 0.2, &vec![0.0; samples.len()]).is_empty());
            assert!(brush.hits_with_pressure(&samples, 0.0, &vec![9.0; samples.len()]).is_empty());
        }
        // Far outside: nothing, until a segment passes through or the pressure is enough to reach the box.
        let (left, right) = (DVec3::new(-1e6, 0.5, 0.5), DVec3::new(1e6, 0.5, 0.5));
        assert!(brush.hits(&[left], 0.1).is_empty() && brush.hits_with_pressure(&[left], 0.1, &[9e6]).is_empty());
        let through = brush.hits_with_pressure(&[left, right], 0.1, &[0.0, 2.0]);
        assert!(!through.is_empty());
        // Half way the factor is 1, to 1e-6.
        assert_eq!(through, brush.hits(&[left, right], 0.1));
        assert_eq!(brush.hits_with_pressure(&[left], 0.1, &[1.1e7]).len(), 3000);
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
