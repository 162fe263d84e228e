//! Camera paths: poses of an eye in a text file, the smooth way through them, and turns around a scene. Scene coordinates, f64.
//!
//! The eye follows a centripetal Catmull-Rom curve (Yuksel, Schaefer & Keyser 2011, "Parameterization and applications of
//! Catmull-Rom curves"). Barry and Goldman's pyramid of interpolations (1988) evaluates it. The same pyramid of spherical
//! interpolations gives the orientation (Schlag 1991, "Using geometric constructions to interpolate orientation with
//! quaternions", Graphics Gems II). Both have continuous first derivatives and pass through every pose.
//!
//! Pictures are spaced evenly along the way. A turn on the spot has a length too: the way of the point looked at.

use std::path::Path;

use glam::{DMat3, DQuat, DVec3};
use sg_input::{file, limits};

use crate::appearance::Appearance;
use crate::camera::Camera;
use crate::framing;
use crate::model::Scene;
use crate::subject::Subject;
use crate::view::{FIELD_OF_VIEW, View};

/// Most poses of a file.
pub const MAX_POSES: usize = 1000;

/// Samples between two poses from which lengths are computed. The step from picture to picture is even within 1 %.
const SAMPLES: usize = 64;

/// Directions from which a turn is framed.
const DIRECTIONS: u32 = 8;

/// Poses on a way through a scene, in the scene's unit.
///
/// A text file has one line for each: `up X Y Z`, `near LENGTH`, `fov DEGREES` and `pose X Y Z X Y Z`. Lines that begin with #
/// are comments.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraPath {
    /// The scene direction that points up in the pictures, of any length; +z where the file has none.
    pub up: DVec3,
    /// Distance from the eye within which Gaussians fade out, where the file has one.
    pub near: Option<f64>,
    /// Vertical field of view in degrees, [`FIELD_OF_VIEW`] where the file has none.
    pub fov_y_degrees: f64,
    /// Eyes, and the points that they look at.
    pub poses: Vec<[DVec3; 2]>,
}

/// A camera path that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum CameraPathError {
    /// The file could not be read.
    #[error("{path}: {source}; give the path of a camera path")]
    Read {
        /// The file.
        path: String,
        /// The system's error.
        source: std::io::Error,
    },
    /// A line is wrong.
    #[error("{path}, line {line}: {reason}")]
    Line {
        /// The file.
        path: String,
        /// The line, from 1.
        line: usize,
        /// The cause and the remedy.
        reason: String,
    },
    /// The file has no pose.
    #[error("{path}: no line `pose X Y Z X Y Z`: the eye, then a point that it looks at")]
    NoPose {
        /// The file.
        path: String,
    },
}

impl CameraPath {
    /// Reads and checks a file.
    ///
    /// # Errors
    /// [`CameraPathError`].
    pub fn read(path: &Path) -> Result<Self, CameraPathError> {
        let name = path.display().to_string();
        let text = file::read_text(path, limits::SMALL_TEXT_BYTES)
            .map_err(|source| CameraPathError::Read { path: name.clone(), source })?;
        Self::parse(&text, &name)
    }

    /// Parses and checks the text of a file; `path` names it in the error.
    ///
    /// # Errors
    /// [`CameraPathError::Line`] for the first wrong line, [`CameraPathError::NoPose`].
    pub fn parse(text: &str, path: &str) -> Result<Self, CameraPathError> {
        let mut parsed = Self { up: DVec3::Z, near: None, fov_y_degrees: FIELD_OF_VIEW, poses: Vec::new() };
        let mut lines_of_poses = Vec::new();
        for (line, content) in (1..).zip(text.lines()) {
            let content = content.trim();
            if content.is_empty() || content.starts_with('#') {
                continue;
            }
            let wrong = |reason: String| CameraPathError::Line { path: path.to_owned(), line, reason };
            let (key, rest) = content.split_once(char::is_whitespace).unwrap_or((content, ""));
            let numbers: Option<Vec<f64>> =
                rest.split_whitespace().map(|n| n.parse().ok().filter(|n: &f64| n.is_finite())).collect();
            match (key, numbers.as_deref()) {
                ("up", Some(&[x, y, z])) => parsed.up = DVec3::new(x, y, z),
                ("near", Some(&[near])) if near >= 0.0 => parsed.near = Some(near),
                ("fov", Some(&[degrees])) => parsed.fov_y_degrees = degrees,
                ("pose", Some(&[x, y, z, to_x, to_y, to_z])) if parsed.poses.len() < MAX_POSES => {
                    parsed.poses.push([DVec3::new(x, y, z), DVec3::new(to_x, to_y, to_z)]);
                    lines_of_poses.push(line);
                }
                ("pose", Some([_, _, _, _, _, _])) => return Err(wrong(format!("more than {MAX_POSES} poses"))),
                _ => {
                    let forms = "`up X Y Z`, `near LENGTH`, `fov DEGREES` or `pose X Y Z X Y Z`";
                    return Err(wrong(format!("it is no {forms} of finite numbers")));
                }
            }
        }
        // Lines may stand in any order, so poses are checked at the end.
        for (view, line) in parsed.views().zip(lines_of_poses) {
            view.check().map_err(|e| CameraPathError::Line { path: path.to_owned(), line, reason: e.to_string() })?;
        }
        match parsed.poses.is_empty() {
            true => Err(CameraPathError::NoPose { path: path.to_owned() }),
            false => Ok(parsed),
        }
    }

    /// The poses as views.
    pub fn views(&self) -> impl Iterator<Item = View> {
        let Self { up, fov_y_degrees, .. } = *self;
        self.poses.iter().map(move |&[eye, target]| View { eye, target, up, fov_y_degrees })
    }

    /// The cameras of the poses, with the near distance of the file, else 0.
    pub fn cameras(&self, [width, height]: [u32; 2]) -> impl Iterator<Item = Camera> {
        let near = self.near.unwrap_or(0.0);
        self.views().map(move |view| Camera { near, ..view.camera(width, height) })
    }

    /// `count` cameras along the smooth way from the first pose to the last, evenly spaced. Poses that repeat the one before
    /// count once.
    #[must_use]
    pub fn frames(&self, size: [u32; 2], count: u32) -> Vec<Camera> {
        let Some(first) = self.cameras(size).next() else { return Vec::new() };
        let way = Way::through(self);
        let share = |k: u32| f64::from(k) / f64::from(count.saturating_sub(1).max(1));
        (0..count).map(|k| way.at(share(k)).camera(&first)).collect()
    }
}

/// Place and orientation of an eye.
#[derive(Debug, Clone, Copy)]
struct Pose {
    eye: DVec3,
    /// From the camera's axes to the scene's.
    axes: DQuat,
}

impl Pose {
    fn of(view: &View) -> Self {
        let rows = DMat3::from_mat4(view.camera(1, 1).view());
        Self { eye: view.eye, axes: DQuat::from_mat3(&rows.transpose()).normalize() }
    }

    /// The pose at a share of the way from `self` to `other`; shares beyond 0 and 1 go on in the same way.
    fn toward(&self, other: &Self, share: f64) -> Self {
        // The shorter of both turns.
        let to = if self.axes.dot(other.axes) < 0.0 { -other.axes } else { other.axes };
        let turn = (self.axes.inverse() * to).to_scaled_axis();
        let axes = (self.axes * DQuat::from_scaled_axis(share * turn)).normalize();
        Self { eye: self.eye + share * (other.eye - self.eye), axes }
    }

    /// Length of the way to another pose: that of the eye, and that of a point at the distance `reach` before it.
    fn length_to(&self, other: &Self, reach: f64) -> f64 {
        self.eye.distance(other.eye) + reach * (self.axes * DVec3::Z).distance(other.axes * DVec3::Z)
    }

    fn camera(&self, template: &Camera) -> Camera {
        let rows = DMat3::from_quat(self.axes).transpose();
        let shift = -(rows * self.eye);
        let row = |k: usize| [rows.col(0)[k], rows.col(1)[k], rows.col(2)[k], shift[k]];
        let mut world_to_camera = [0.0; 16];
        let rows = [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]];
        world_to_camera.iter_mut().zip(rows.as_flattened()).for_each(|(to, from)| *to = *from);
        Camera { world_to_camera, ..template.clone() }
    }
}

/// The smooth way through poses.
#[derive(Debug)]
struct Way {
    /// At least two; a pose before the first and one behind the last, which straighten the ends, come on top.
    poses: Vec<Pose>,
    /// Parameter of each pose: roots of lengths, as the centripetal curve takes them.
    knots: Vec<f64>,
    /// Length from the first pose to each sample; [`SAMPLES`] for each piece.
    lengths: Vec<f64>,
}

impl Way {
    fn through(path: &CameraPath) -> Self {
        let views: Vec<View> = path.views().collect();
        let reach = views.iter().map(|v| v.eye.distance(v.target)).sum::<f64>() / views.len().max(1) as f64;
        let mut poses: Vec<Pose> = views.iter().map(Pose::of).collect();
        poses.dedup_by(|b, a| a.length_to(b, reach) <= 1e-12 * reach);
        if let (Some(&first), Some(&second)) = (poses.first(), poses.get(1)) {
            poses.insert(0, second.toward(&first, 2.0));
        }
        if let [.., before, last] = poses.as_slice() {
            poses.push(before.toward(last, 2.0));
        }
        let mut knots = vec![0.0];
        for pair in poses.windows(2) {
            let step = pair.first().zip(pair.get(1)).map_or(0.0, |(a, b)| a.length_to(b, reach).sqrt());
            knots.push(knots.last().copied().unwrap_or_default() + step);
        }
        let mut way = Self { poses, knots, lengths: vec![0.0] };
        let samples = way.pieces() * SAMPLES;
        let mut before = way.sample(0.0);
        let mut length = 0.0;
        for k in 1..=samples {
            let next = way.sample(k as f64);
            length += before.length_to(&next, reach);
            way.lengths.push(length);
            before = next;
        }
        way
    }

    /// Pieces between two poses.
    fn pieces(&self) -> usize {
        self.poses.len().saturating_sub(3)
    }

    /// The pose at a share of the length, 0 to 1.
    fn at(&self, share: f64) -> Pose {
        let wanted = share.clamp(0.0, 1.0) * self.lengths.last().copied().unwrap_or_default();
        let next = self.lengths.partition_point(|length| *length < wanted).max(1);
        let (Some(low), Some(high)) = (self.lengths.get(next - 1), self.lengths.get(next)) else {
            return self.sample(0.0);
        };
        let within = if high > low { (wanted - low) / (high - low) } else { 0.0 };
        self.sample((next - 1) as f64 + within)
    }

    /// The pose at a number of samples from the first pose, by Barry and Goldman's pyramid.
    fn sample(&self, number: f64) -> Pose {
        let number = number / SAMPLES as f64;
        let piece = (number.floor().max(0.0) as usize).min(self.pieces().saturating_sub(1));
        let (Some(&[a, b, c, d]), Some(&[t0, t1, t2, t3])) = (
            self.poses.get(piece..).and_then(|p| p.first_chunk()),
            self.knots.get(piece..).and_then(|t| t.first_chunk()),
        ) else {
            return self.poses.first().copied().unwrap_or(Pose { eye: DVec3::ZERO, axes: DQuat::IDENTITY });
        };
        let t = t1 + (number - piece as f64) * (t2 - t1);
        let mix = |a: Pose, b: Pose, from: f64, to: f64| a.toward(&b, (t - from) / (to - from));
        let (ab, bc, cd) = (mix(a, b, t0, t1), mix(b, c, t1, t2), mix(c, d, t2, t3));
        mix(mix(ab, bc, t0, t2), mix(bc, cd, t1, t3), t1, t2)
    }
}

/// The nearest view along `direction` (from the eye to the scene) whose turn about `up` shows all that `appearance` draws from
/// every side, in a picture of this aspect, width over height. The field of view is in degrees.
#[must_use]
pub fn framed_turn(
    scene: &Scene,
    appearance: &Appearance,
    (direction, up): (DVec3, DVec3),
    fov_y_degrees: f64,
    aspect: f64,
) -> View {
    let first = framing::framed(scene, appearance, (direction, up), fov_y_degrees, aspect);
    let subject = Subject::of(scene, appearance);
    let turned = |k: u32| {
        let view = first.orbited(360.0 * f64::from(k) / f64::from(DIRECTIONS), 0.0);
        subject.view(view.target - view.eye, up, fov_y_degrees, aspect)
    };
    let views: Vec<View> = (0..DIRECTIONS).filter_map(turned).collect();
    if views.is_empty() {
        return first;
    }
    let middle = views.iter().map(|view| view.target).sum::<DVec3>() / views.len() as f64;
    let slope = (0.5 * first.fov_y_degrees.to_radians()).tan();
    // Seen from the axis through the middle, the frustum of each view has to lie within the turn's.
    let distance = |view: &View| {
        let camera = view.camera(1, 1).view();
        let off = camera.transform_point3(middle);
        off.z + (off.x.abs() / (slope * aspect)).max(off.y.abs() / slope)
    };
    let distance = views.iter().map(distance).fold(0.0, f64::max);
    let back = (first.eye - first.target).normalize_or(DVec3::NEG_Y);
    View { eye: middle + distance * back, target: middle, ..first }
}

#[cfg(test)]
mod tests;
