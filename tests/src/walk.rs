//! Walk-throughs: cameras on a way into a scene, from a text file.

use glam::DVec3;
use sg_scene::camera::Camera;

/// Poses on a way into a scene, in the scene's unit.
#[derive(Debug, Clone, PartialEq)]
pub struct Walk {
    /// The direction that points up in the pictures.
    pub up: DVec3,
    /// The near distance.
    pub near: f64,
    /// Eyes and the points that they look at.
    pub poses: Vec<[DVec3; 2]>,
}

impl Walk {
    /// Parses lines `up X Y Z`, `near LENGTH` and `pose X Y Z X Y Z`; lines that begin with # are comments.
    ///
    /// # Errors
    /// The first line that is none of these.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut walk = Self { up: DVec3::Z, near: 0.0, poses: Vec::new() };
        for line in text.lines().filter(|line| !line.starts_with('#') && !line.trim().is_empty()) {
            let (key, rest) = line.split_once(' ').unwrap_or((line, ""));
            let numbers: Result<Vec<f64>, _> = rest.split_whitespace().map(str::parse).collect();
            match (key, numbers.as_deref()) {
                ("up", Ok([x, y, z])) => walk.up = DVec3::new(*x, *y, *z),
                ("near", Ok([near])) => walk.near = *near,
                ("pose", Ok([x, y, z, to_x, to_y, to_z])) => {
                    walk.poses.push([DVec3::new(*x, *y, *z), DVec3::new(*to_x, *to_y, *to_z)]);
                }
                _ => return Err(format!("`{line}` is no `up X Y Z`, `near LENGTH` or `pose X Y Z X Y Z`")),
            }
        }
        Ok(walk)
    }

    /// The cameras, with a vertical field of view in degrees.
    pub fn cameras(&self, fov_y_degrees: f64, [width, height]: [u32; 2]) -> impl Iterator<Item = Camera> {
        let of = move |[eye, target]: &[DVec3; 2]| Camera {
            near: self.near,
            background: [0.2; 3],
            ..Camera::look_at(*eye, *target, self.up, fov_y_degrees, width, height)
        };
        self.poses.iter().map(of)
    }
}
