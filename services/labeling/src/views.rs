//! Cameras on a sphere around a region, and the choice of the best among them.

use glam::DVec3;
use sg_scene::view::View;

use crate::frame::Frame;
use crate::region::Region;

/// Fewest cameras around a region.
pub const MIN_VIEWS: usize = 12;
/// Most cameras around a region.
pub const MAX_VIEWS: usize = 256;
/// Largest cosine between a line of sight and the up direction before another up is taken.
const POLE: f64 = 0.995;
/// Covering angle of n spiral points times √n, in radians, rounded up. A test measures it.
const COVERING: f64 = 2.9;
/// Fewest degrees between views before [`choose`] takes the best ones, whatever their angle.
const LEAST_ANGLE: f64 = 1.0;

/// The cameras around a region.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sphere {
    /// Vertical field of view, degrees.
    pub fov_y_degrees: f64,
    /// Width of the picture over its height.
    pub aspect: f64,
    /// Share of the picture's half edge that stays free around the region. 0.05 shows the region alone; 0.5 shows it in context.
    pub margin: f64,
    /// Number of cameras. `None` derives it from the field of view, see [`Sphere::count`].
    pub count: Option<usize>,
}

impl Default for Sphere {
    fn default() -> Self {
        Self { fov_y_degrees: sg_scene::view::FIELD_OF_VIEW, aspect: 1.0, margin: sg_scene::view::MARGIN, count: None }
    }
}

/// Settings that give no cameras, or scores that give no order.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ViewsError {
    /// The field of view is too small or too large.
    #[error("the vertical field of view is {0} degrees; it must be 1 to 170")]
    FieldOfView(f64),
    /// The aspect is not usable.
    #[error("the aspect of the picture is {0}; it must be 0.01 to 100")]
    Aspect(f64),
    /// The margin is not usable.
    #[error("the margin is {0}; it must be at least 0 and below 0.95")]
    Margin(f64),
    /// The number of cameras is out of range.
    #[error("{0} cameras are asked for; ask for 1 to {MAX_VIEWS}")]
    Count(usize),
    /// The region has no finite ball.
    #[error("the region's ball has centre {center} and radius {radius}; both must be finite, and the radius above 0")]
    Region {
        /// The middle of the ball.
        center: DVec3,
        /// Its radius.
        radius: f64,
    },
    /// Views and scores differ in number.
    #[error("{views} views come with {scores} scores; give one score for each view")]
    Lengths {
        /// Number of views.
        views: usize,
        /// Number of scores.
        scores: usize,
    },
    /// A score is not a number.
    #[error("the score of view {0} is not a number; refuse its picture first")]
    Score(usize),
    /// The angle is not usable.
    #[error("the least angle between views is {0} degrees; it must be 0 to 180")]
    Angle(f64),
}

impl Sphere {
    fn check(&self) -> Result<(), ViewsError> {
        if !(1.0..=170.0).contains(&self.fov_y_degrees) {
            return Err(ViewsError::FieldOfView(self.fov_y_degrees));
        }
        if !(0.01..=100.0).contains(&self.aspect) {
            return Err(ViewsError::Aspect(self.aspect));
        }
        if !(0.0..0.95).contains(&self.margin) {
            return Err(ViewsError::Margin(self.margin));
        }
        match self.count {
            Some(count) if !(1..=MAX_VIEWS).contains(&count) => Err(ViewsError::Count(count)),
            _ => Ok(()),
        }
    }

    /// Half the angle of the cone that the region's ball fills, radians: the smaller field of view without the margin.
    fn half_angle(&self) -> f64 {
        let tangent = (0.5 * self.fov_y_degrees.to_radians()).tan();
        ((1.0 - self.margin) * tangent * self.aspect.min(1.0)).atan()
    }

    /// Distance of each eye from the middle of a ball of radius `radius`: radius / sin(half angle). The whole ball is in the picture.
    #[must_use]
    pub fn distance(&self, radius: f64) -> f64 {
        radius / self.half_angle().sin()
    }

    /// The number of cameras around a region.
    ///
    /// An eye at distance d from a ball of radius r sees a cap of arccos(r/d) degrees around the nearest point. The number is the
    /// least for which every point of the ball lies within half of such a cap of some camera. So some camera
    /// sees each part of the surface at less than a grazing angle. Wide fields of view bring the eye near, so they need more
    /// cameras. A tiny region looks alike from everywhere and gets [`MIN_VIEWS`].
    #[must_use]
    pub fn count(&self, region: &Region) -> usize {
        if let Some(count) = self.count {
            return count;
        }
        if region.is_tiny {
            return MIN_VIEWS;
        }
        let cap = self.half_angle().sin().clamp(0.0, 1.0).acos();
        let needed = (COVERING / (0.5 * cap).max(1e-3)).powi(2).ceil();
        (needed as usize).clamp(MIN_VIEWS, MAX_VIEWS)
    }

    /// Cameras around a region, all at one distance, that look at its middle.
    ///
    /// The directions are the Fibonacci spiral about the frame's up (González 2010), so no two coincide and equal areas have
    /// equal numbers. They turn with the frame. Up in the pictures is the frame's up, near its poles the frame's front.
    ///
    /// # Errors
    /// [`ViewsError`] if a setting is out of range or the region is not finite.
    pub fn views(&self, region: &Region, frame: &Frame) -> Result<Vec<View>, ViewsError> {
        self.check()?;
        let distance = self.distance(region.radius);
        if !(region.center.is_finite() && distance.is_finite() && region.radius > 0.0) {
            return Err(ViewsError::Region { center: region.center, radius: region.radius });
        }
        let to_scene = frame.to_scene();
        let looking = |direction: DVec3| {
            let direction = to_scene * direction;
            let up = if direction.dot(frame.up()).abs() > POLE { frame.front() } else { frame.up() };
            let eye = region.center + distance * direction;
            View { eye, target: region.center, up, fov_y_degrees: self.fov_y_degrees }
        };
        Ok(spiral(self.count(region)).map(looking).collect())
    }
}

/// Unit vectors of the Fibonacci spiral about y.
fn spiral(count: usize) -> impl Iterator<Item = DVec3> {
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    (0..count).map(move |i| {
        let y = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
        let ring = (1.0 - y * y).sqrt();
        let (sin, cos) = (golden * i as f64).sin_cos();
        DVec3::new(ring * cos, y, ring * sin)
    })
}

/// The best `k` views: indices by falling score, the best view first. Equal scores go by index.
///
/// Two chosen views stand at least `min_angle_degrees` apart as seen from their targets, so near duplicates do not take all
/// places. Where fewer than `k` views stand so far apart, the angle is halved for the remaining places, and below a degree it no
/// longer counts. The result has the smaller of `k` and the number of views.
///
/// # Errors
/// [`ViewsError`] if the lengths differ, or if a score or the angle is not a number.
pub fn choose(views: &[View], scores: &[f64], k: usize, min_angle_degrees: f64) -> Result<Vec<usize>, ViewsError> {
    if views.len() != scores.len() {
        return Err(ViewsError::Lengths { views: views.len(), scores: scores.len() });
    }
    if let Some(at) = scores.iter().position(|s| s.is_nan()) {
        return Err(ViewsError::Score(at));
    }
    if !(0.0..=180.0).contains(&min_angle_degrees) {
        return Err(ViewsError::Angle(min_angle_degrees));
    }
    let directions: Vec<DVec3> = views.iter().map(|v| (v.eye - v.target).normalize_or_zero()).collect();
    let mut order: Vec<usize> = (0..views.len()).collect();
    order.sort_by(|a, b| scores[*b].total_cmp(&scores[*a]).then(a.cmp(b)));
    let mut chosen: Vec<usize> = Vec::new();
    let mut angle = min_angle_degrees;
    let places = k.min(views.len());
    while chosen.len() < places {
        let apart = if angle < LEAST_ANGLE { 0.0 } else { angle.to_radians() };
        for &at in &order {
            let is_new = !chosen.contains(&at);
            let is_apart = || chosen.iter().all(|c| directions[*c].angle_between(directions[at]) >= apart);
            if chosen.len() < places && is_new && (apart == 0.0 || is_apart()) {
                chosen.push(at);
            }
        }
        angle *= 0.5;
    }
    chosen.sort_by(|a, b| scores[*b].total_cmp(&scores[*a]).then(a.cmp(b)));
    Ok(chosen)
}

#[cfg(test)]
mod tests {
    use glam::DQuat;
    use proptest::prelude::*;

    use super::*;

    const BALL: Region = Region { center: DVec3::new(1.0, 2.0, 3.0), radius: 2.0, is_tiny: false };

    fn directions(views: &[View]) -> Vec<DVec3> {
        views.iter().map(|v| (v.eye - v.target).normalize()).collect()
    }

    #[test]
    fn every_part_of_the_ball_is_seen_well() {
        for fov in [20.0, 40.0, 60.0, 90.0] {
            let sphere = Sphere { fov_y_degrees: fov, ..Sphere::default() };
            let views = sphere.views(&BALL, &Frame::XYZ).unwrap();
            let eyes = directions(&views);
            let cap = (BALL.radius / sphere.distance(BALL.radius)).acos();
            let gap = spiral(4000)
                .map(|p| eyes.iter().map(|e| e.angle_between(p)).fold(f64::INFINITY, f64::min))
                .fold(0.0, f64::max);
            assert!(gap <= 0.5 * cap, "{fov}: {} views, {gap} {cap}", views.len());
        }
    }

    #[test]
    fn wide_fields_need_more_cameras_and_tiny_regions_few() {
        let count = |fov| Sphere { fov_y_degrees: fov, ..Sphere::default() }.count(&BALL);
        assert!(
            count(20.0) < count(60.0) && count(60.0) < count(120.0),
            "{} {} {}",
            count(20.0),
            count(60.0),
            count(120.0)
        );
        assert_eq!(Sphere::default().count(&Region { is_tiny: true, ..BALL }), MIN_VIEWS);
        assert_eq!(Sphere { count: Some(5), ..Sphere::default() }.views(&BALL, &Frame::XYZ).unwrap().len(), 5);
    }

    #[test]
    fn the_whole_ball_is_in_every_picture() {
        for (aspect, margin) in [(1.0, 0.05), (2.0, 0.05), (0.5, 0.5)] {
            let sphere = Sphere { aspect, margin, ..Sphere::default() };
            let views = sphere.views(&BALL, &Frame::XYZ).unwrap();
            for view in &views {
                assert_eq!(view.check(), Ok(()));
                let (width, height) = ((400.0 * aspect) as u32, 400);
                let camera = view.camera(width, height);
                let mut reach = 0.0_f64;
                for p in spiral(500) {
                    let p = camera.view().transform_point3(BALL.center + BALL.radius * p);
                    let x = (camera.fx * p.x / p.z).abs() / (0.5 * f64::from(width));
                    let y = (camera.fy * p.y / p.z).abs() / (0.5 * f64::from(height));
                    assert!(p.z > 0.0);
                    reach = reach.max(x.max(y));
                }
                assert!(reach <= 1.0 - margin + 1e-9 && reach > 0.97 * (1.0 - margin), "{aspect} {margin}: {reach}");
            }
        }
    }

    #[test]
    fn settings_out_of_range_are_refused() {
        let views = |sphere: Sphere| sphere.views(&BALL, &Frame::XYZ).map(|v| v.len());
        assert!(matches!(
            views(Sphere { fov_y_degrees: f64::NAN, ..Sphere::default() }),
            Err(ViewsError::FieldOfView(_))
        ));
        assert_eq!(views(Sphere { aspect: 0.0, ..Sphere::default() }), Err(ViewsError::Aspect(0.0)));
        assert_eq!(views(Sphere { margin: 1.0, ..Sphere::default() }), Err(ViewsError::Margin(1.0)));
        assert_eq!(views(Sphere { count: Some(0), ..Sphere::default() }), Err(ViewsError::Count(0)));
        let nowhere = Region { center: DVec3::NAN, ..BALL };
        assert!(matches!(Sphere::default().views(&nowhere, &Frame::XYZ), Err(ViewsError::Region { .. })));
    }

    #[test]
    fn near_duplicates_do_not_take_all_places() {
        let at = |degrees: f64| View {
            eye: DQuat::from_rotation_y(degrees.to_radians()) * DVec3::Z,
            target: DVec3::ZERO,
            up: DVec3::Y,
            fov_y_degrees: 40.0,
        };
        let views = [at(0.0), at(2.0), at(4.0), at(90.0), at(180.0)];
        let scores = [0.9, 0.9, 0.8, 0.5, 0.4];
        assert_eq!(choose(&views, &scores, 3, 30.0), Ok(vec![0, 3, 4]));
        assert_eq!(choose(&views, &scores, 3, 0.0), Ok(vec![0, 1, 2]), "without an angle the scores decide");
        assert_eq!(choose(&views, &scores, 5, 30.0), Ok(vec![0, 1, 2, 3, 4]), "the angle gives way");
        assert_eq!(choose(&views, &scores, 9, 30.0).map(|c| c.len()), Ok(5));
        assert_eq!(choose(&views, &scores, 0, 30.0), Ok(vec![]));
        assert_eq!(choose(&views, &[0.0; 5], 1, 30.0), Ok(vec![0]), "ties go by index");
        assert_eq!(choose(&views, &[0.0, f64::NAN, 0.0, 0.0, 0.0], 1, 1.0), Err(ViewsError::Score(1)));
        assert!(choose(&views, &[0.0], 1, 1.0).is_err() && choose(&views, &scores, 1, f64::NAN).is_err());
    }

    proptest! {
        #[test]
        fn views_turn_with_their_frame(
            axis in prop::array::uniform3(-1.0_f64..1.0),
            angle in 0.0_f64..6.0,
            radius in 1e-3_f64..1e3,
        ) {
            let turn = DQuat::from_axis_angle(DVec3::from_array(axis).normalize_or(DVec3::X), angle);
            let region = Region { radius, ..BALL };
            let turned = Region { center: turn * region.center, ..region };
            let frame = Frame::new(turn * DVec3::X, turn * DVec3::Y, turn * DVec3::Z).unwrap();
            let before = Sphere::default().views(&region, &Frame::XYZ).unwrap();
            let after = Sphere::default().views(&turned, &frame).unwrap();
            prop_assert_eq!(before.len(), after.len());
            for (a, b) in before.iter().zip(&after) {
                prop_assert!((turn * a.eye).distance(b.eye) < 1e-9 * (radius + 10.0));
                prop_assert!((turn * a.up).distance(b.up) < 1e-9);
            }
        }

        #[test]
        fn no_two_views_coincide(count in 2_usize..=MAX_VIEWS) {
            let eyes: Vec<DVec3> = spiral(count).collect();
            let least = 2.0 / (count as f64).sqrt();
            for (i, a) in eyes.iter().enumerate() {
                prop_assert!((a.length() - 1.0).abs() < 1e-12);
                prop_assert!(eyes[..i].iter().all(|b| a.distance(*b) > 0.5 * least));
            }
        }

        #[test]
        fn chosen_views_are_apart_or_all_that_there_are(
            scores in prop::collection::vec(0.0_f64..1.0, 30),
            k in 1_usize..8,
        ) {
            let sphere = Sphere { count: Some(30), ..Sphere::default() };
            let views = sphere.views(&BALL, &Frame::XYZ).unwrap();
            let chosen = choose(&views, &scores, k, 30.0).unwrap();
            prop_assert_eq!(chosen.len(), k);
            let best = scores.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            prop_assert_eq!(scores[chosen[0]], best);
            let eyes = directions(&views);
            for (i, a) in chosen.iter().enumerate() {
                prop_assert!(chosen[..i].iter().all(|b| a != b && eyes[*a].angle_between(eyes[*b]) > 15.0_f64.to_radians()));
            }
        }
    }
}
