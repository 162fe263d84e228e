//! Brush strokes.

use glam::DVec3;
use sg_clusters::polyline::DepthLimit;
use sg_scene::mask::Mask;
use sg_scene::model::SceneBox;

/// Unit of selection of a stroke.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// A random walk with the hit Gaussians as seeds.
    Walk,
    /// The hit clusters.
    Cluster,
    /// The hit Gaussians.
    Point,
}

/// Effect of a stroke.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Adds to the selection.
    Foreground,
    /// Removes from the selection.
    Background,
    /// Removes a cluster that is completely selected, and adds it otherwise. Cluster mode only.
    Toggle,
}

impl Kind {
    /// Whether a stroke of this kind selects a cluster with these members.
    pub(crate) fn selects(self, members: &[u32], mask: &Mask) -> bool {
        match self {
            Self::Foreground => true,
            Self::Background => false,
            Self::Toggle => !members.iter().all(|&g| mask.get(g as usize)),
        }
    }
}

/// One brush stroke: a tube of a given radius around a polyline. Pressure scales the radius at each sample (see
/// [`crate::brush::Brush::hits_with_pressure`]).
#[derive(Debug, Clone, PartialEq)]
pub struct Stroke {
    /// Unit of selection.
    pub mode: Mode,
    /// Effect.
    pub kind: Kind,
    /// Radius as a fraction of the scene box's longest edge.
    pub radius: f64,
    /// Samples in normalized coordinates of the scene's box: 0 to 1 on each axis inside the box.
    pub points: Vec<[f64; 3]>,
    /// Factor on the radius at each sample, finite and at least 0. An empty list means 1 everywhere.
    pub pressure: Vec<f64>,
    /// Reach behind the samples; `None` means the radius.
    pub depth: Option<Depth>,
}

/// Reach of a stroke behind the surface on which it was drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Depth {
    /// Viewpoint in normalized coordinates of the scene's box.
    pub eye: [f64; 3],
    /// Largest distance behind the nearest point of the stroke, seen from the viewpoint. A fraction of the scene box's
    /// longest edge, at least 0.
    pub reach: f64,
}

/// Most samples of one stroke: three hours at 90 samples a second.
pub const MAX_POINTS: usize = 1_000_000;

/// Most steps of one selection.
pub const MAX_STEPS: usize = 100_000;

/// An impossible value of a stroke. Points are counted from 0.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum StrokeError {
    /// A stroke other than a cluster stroke toggles.
    #[error("`toggle` works in cluster mode only; use foreground or background")]
    Toggle,
    /// The radius is negative or not finite.
    #[error("the radius is {0}; it must be finite and at least 0")]
    Radius(f64),
    /// The stroke has no points, or too many.
    #[error("the stroke has {0} points; it must have 1 to {MAX_POINTS}")]
    Points(usize),
    /// A coordinate is infinite or not a number.
    #[error("point {0} is not finite")]
    NotFinite(usize),
    /// The number of pressures differs from the number of points.
    #[error("the stroke has {found} entries of `pressure` for {points} points; give one per point, or none")]
    PressureCount {
        /// Number of pressures.
        found: usize,
        /// Number of points.
        points: usize,
    },
    /// A pressure is negative or not finite.
    #[error("the pressure at point {point} is {pressure}; it must be finite and at least 0")]
    Pressure {
        /// Position of the point.
        point: usize,
        /// The pressure.
        pressure: f64,
    },
    /// The viewpoint is not finite, or the reach is negative or not finite.
    #[error("the depth limit is {reach} seen from {eye:?}; it must be finite and at least 0")]
    Depth {
        /// Viewpoint.
        eye: [f64; 3],
        /// Reach behind the stroke.
        reach: f64,
    },
}

impl Stroke {
    /// Checks the values of the stroke.
    ///
    /// # Errors
    /// [`StrokeError`] with the first wrong value.
    pub fn check(&self) -> Result<(), StrokeError> {
        let at_least_0 = |x: f64| x >= 0.0 && x.is_finite();
        if self.kind == Kind::Toggle && self.mode != Mode::Cluster {
            return Err(StrokeError::Toggle);
        }
        if !at_least_0(self.radius) {
            return Err(StrokeError::Radius(self.radius));
        }
        let points = self.points.len();
        if points == 0 || points > MAX_POINTS {
            return Err(StrokeError::Points(points));
        }
        if let Some(at) = self.points.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
            return Err(StrokeError::NotFinite(at));
        }
        let found = self.pressure.len();
        if !(found == 0 || found == points) {
            return Err(StrokeError::PressureCount { found, points });
        }
        if let Some(Depth { eye, reach }) = self.depth
            && !(eye.iter().all(|x| x.is_finite()) && at_least_0(reach))
        {
            return Err(StrokeError::Depth { eye, reach });
        }
        match self.pressure.iter().position(|f| !at_least_0(*f)) {
            Some(point) => Err(StrokeError::Pressure { point, pressure: self.pressure[point] }),
            None => Ok(()),
        }
    }

    /// The samples in the scene frame, and the radius in the scene's length unit.
    #[must_use]
    pub fn in_scene(&self, bounds: &SceneBox) -> (Vec<DVec3>, f64) {
        let samples = self.points.iter().map(|p| bounds.denormalize(DVec3::from_array(*p))).collect();
        (samples, self.radius * bounds.longest_edge())
    }

    /// The depth limit in the scene frame and the scene's length unit.
    #[must_use]
    pub fn depth_limit(&self, bounds: &SceneBox) -> Option<DepthLimit> {
        let Depth { eye, reach } = self.depth?;
        let max_distance = reach * bounds.longest_edge();
        Some(DepthLimit { eye: bounds.denormalize(DVec3::from_array(eye)), max_distance })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrong_values_are_named() {
        let good = Stroke {
            mode: Mode::Cluster,
            kind: Kind::Toggle,
            radius: 0.1,
            points: vec![[0.0; 3]; 2],
            pressure: vec![0.0, 2.5],
            depth: Some(Depth { eye: [0.0; 3], reach: 0.1 }),
        };
        assert_eq!(good.check(), Ok(()));
        for (bad, expected) in [
            (Stroke { mode: Mode::Walk, ..good.clone() }, "`toggle` works in cluster mode only"),
            (Stroke { radius: -1.0, ..good.clone() }, "radius is -1;"),
            (Stroke { points: Vec::new(), ..good.clone() }, "0 points"),
            (Stroke { points: vec![[0.0; 3], [f64::NAN; 3]], ..good.clone() }, "point 1 is not finite"),
            (Stroke { pressure: vec![1.0], ..good.clone() }, "1 entries of `pressure` for 2 points"),
            (Stroke { pressure: vec![1.0, -1.0], ..good.clone() }, "pressure at point 1 is -1;"),
            (Stroke { depth: Some(Depth { eye: [0.0; 3], reach: -1.0 }), ..good.clone() }, "depth limit is -1 "),
        ] {
            let message = bad.check().unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        }
    }
}
