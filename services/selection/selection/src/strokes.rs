//! Brush strokes.

use glam::DVec3;
use serde::{Deserialize, Serialize};
use sg_scene::mask::Mask;
use sg_scene::model::SceneBox;

use sg_clusters::polyline::Behind;

/// What a stroke selects with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Mode {
    /// A random walk from what the stroke hits.
    Walk,
    /// The clusters the stroke hits.
    Cluster,
    /// The Gaussians the stroke hits.
    Point,
}

/// What a stroke does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// Adds.
    Foreground,
    /// Removes.
    Background,
    /// Removes a cluster that is wholly selected, adds it otherwise. Cluster mode only.
    Toggle,
}

impl Kind {
    /// Whether a cluster of these Gaussians is selected once a stroke has hit it.
    pub(crate) fn selects(self, members: &[u32], mask: &Mask) -> bool {
        match self {
            Self::Foreground => true,
            Self::Background => false,
            Self::Toggle => !members.iter().all(|&g| mask.get(g as usize)),
        }
    }
}

/// One stroke of the brush: the tube of all points closer than a radius to a polyline, where it is pressed by as much
/// thicker or thinner (see [`crate::brush::Brush::hits_pressed`]).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stroke {
    /// What it selects with.
    pub mode: Mode,
    /// What it does.
    pub kind: Kind,
    /// Radius as a fraction of the scene box's longest edge.
    pub radius: f64,
    /// Samples in normalized coordinates of the scene's box, 0 to 1 on each axis; they may lie outside.
    pub points: Vec<[f64; 3]>,
    /// Factor on the radius at each sample, such as from the pressure on a trigger: finite, at least 0; one a sample, or
    /// none where it is 1 everywhere.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub pressure: Vec<f64>,
    /// How far behind its samples it reaches; `None` as far as its radius.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth: Option<Depth>,
}

/// How far a stroke that was drawn over a surface reaches behind it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Depth {
    /// Where the surface is seen from, in normalized coordinates of the scene's box.
    pub eye: [f64; 3],
    /// What is farther from the eye than the nearest place of the stroke by more than this is not hit: a fraction of the scene
    /// box's longest edge, at least 0.
    pub behind: f64,
}

/// The most samples of one stroke: at 90 a second, three hours without lifting the brush.
pub const MOST_POINTS: usize = 1_000_000;

/// The most strokes of one selection.
pub const MOST_STROKES: usize = 100_000;

/// A stroke that cannot be played.
#[derive(Debug, thiserror::Error)]
pub enum StrokeError {
    /// The file could not be read.
    #[error("{path}: {source}; give the path of a strokes JSON file")]
    Read {
        /// The file.
        path: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file is not a list of strokes.
    #[error("{path}: {source}")]
    Parse {
        /// The file.
        path: String,
        /// Where and why.
        source: serde_json::Error,
    },
    /// A stroke makes no sense.
    #[error("{path}: stroke {number} (counted from 0): {reason}")]
    Stroke {
        /// The file.
        path: String,
        /// Position in the list.
        number: usize,
        /// Why.
        reason: String,
    },
    /// There are too many.
    #[error("{path}: {found} strokes are too many; at most {MOST_STROKES} can be played")]
    TooMany {
        /// The file.
        path: String,
        /// How many.
        found: usize,
    },
}

impl Stroke {
    /// Checks that the stroke can be played.
    ///
    /// # Errors
    /// What is wrong and what would be right, in words.
    pub fn check(&self) -> Result<(), String> {
        if self.kind == Kind::Toggle && self.mode != Mode::Cluster {
            return Err("`toggle` works in cluster mode only; use foreground or background".to_owned());
        }
        if !(self.radius >= 0.0 && self.radius.is_finite()) {
            return Err(format!("the radius is {}; it must be finite and at least 0", self.radius));
        }
        if self.points.is_empty() || self.points.len() > MOST_POINTS {
            return Err(format!("it has {} points; 1 to {MOST_POINTS} are needed", self.points.len()));
        }
        if let Some(at) = self.points.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
            return Err(format!("point {at} is not finite"));
        }
        if !(self.pressure.is_empty() || self.pressure.len() == self.points.len()) {
            let (found, points) = (self.pressure.len(), self.points.len());
            return Err(format!(
                "it has {found} entries of `pressure` for {points} points; one a point is needed, or none"
            ));
        }
        if let Some(Depth { eye, behind }) = self.depth
            && !(eye.iter().all(|x| x.is_finite()) && behind >= 0.0 && behind.is_finite())
        {
            return Err(format!(
                "it reaches {behind} behind what {eye:?} sees; numbers that are finite, and at least 0 behind"
            ));
        }
        match self.pressure.iter().position(|f| !(*f >= 0.0 && f.is_finite())) {
            Some(at) => {
                Err(format!("the pressure at point {at} is {}; it must be finite and at least 0", self.pressure[at]))
            }
            None => Ok(()),
        }
    }

    /// The samples in the scene frame, and the radius in the scene's length unit.
    #[must_use]
    pub fn in_scene(&self, bounds: &SceneBox) -> (Vec<DVec3>, f64) {
        let samples = self.points.iter().map(|p| bounds.denormalize(DVec3::from_array(*p))).collect();
        (samples, self.radius * bounds.longest_edge())
    }

    /// How far behind its samples it reaches, in the scene frame.
    #[must_use]
    pub fn behind(&self, bounds: &SceneBox) -> Option<Behind> {
        let Depth { eye, behind } = self.depth?;
        Some(Behind { eye: bounds.denormalize(DVec3::from_array(eye)), most: behind * bounds.longest_edge() })
    }
}
