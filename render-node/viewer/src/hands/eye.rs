//! An eye as a camera of the scene.

use glam::{DMat3, DVec2, DVec3};
use sg_scene::camera::{Camera, Light};

use super::placement::{Placement, Pose};
use super::pointing::Rectangle;

/// An eye's field of view, as angles from its forward axis in radians. Right and up count positive, so `left` and `down`
/// usually are negative. It need not be symmetric.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fov {
    /// Leftmost.
    pub left: f64,
    /// Rightmost.
    pub right: f64,
    /// Topmost.
    pub up: f64,
    /// Lowest.
    pub down: f64,
}

impl Fov {
    /// Projects a point of the plane one unit ahead (right and up) into the picture. Returns shares of its width and height
    /// from the upper left.
    #[must_use]
    pub fn in_picture(&self, at: DVec2) -> DVec2 {
        let [left, right, up, down] = [self.left, self.right, self.up, self.down].map(f64::tan);
        DVec2::new((at.x - left) / (right - left), (up - at.y) / (up - down))
    }
}

/// One eye at the time its picture is shown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Eye {
    /// In the room; it looks along its −z.
    pub pose: Pose,
    /// Field of view.
    pub fov: Fov,
}

impl Eye {
    /// Whether the eye may see part of a rectangle. `false` is certain: the eye sees none of it.
    #[must_use]
    pub fn may_see(&self, rectangle: &Rectangle) -> bool {
        let [left, right, up, down] =
            [self.fov.left, self.fov.right, self.fov.up, self.fov.down].map(|angle| angle.clamp(-1.57, 1.57).tan());
        let back = self.pose.orientation.inverse();
        // Each corner's distance to the five planes of the view frustum, positive inside.
        let corners = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)].map(|(x, y)| {
            let at = back * (rectangle.point(DVec2::new(x, y)) - self.pose.position);
            let ahead = -at.z;
            [ahead, at.x - left * ahead, right * ahead - at.x, at.y - down * ahead, up * ahead - at.y]
        });
        (0..5).all(|plane| corners.iter().any(|corner| corner[plane] >= 0.0))
    }

    /// The eye as a pinhole camera of a placed scene, in the scene's own unit. The room is transformed into the scene, not
    /// the scene into the room. So centres and cut-offs stay the scene's. Gaussians fade within `near` metres of the room.
    ///
    /// `size` is the picture's in pixels. An empty field of view makes an invalid camera, and [`Camera::check`] reports it.
    #[must_use]
    pub fn camera(
        &self,
        [width, height]: [u32; 2],
        placement: &Placement,
        near: f64,
        background: [f32; 3],
        light: Light,
    ) -> Camera {
        let Fov { left, right, up, down } = self.fov;
        let fx = f64::from(width) / (right.tan() - left.tan());
        let fy = f64::from(height) / (up.tan() - down.tan());
        // Camera axes are x right, y down, z forward.
        let flip = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
        let from_room = flip * DMat3::from_quat(self.pose.orientation.inverse());
        let turn = from_room * DMat3::from_quat(placement.rotation);
        let shift = from_room * (placement.translation - self.pose.position) / placement.scale;
        let row = |k: usize| [turn.row(k).x, turn.row(k).y, turn.row(k).z, shift.to_array()[k]];
        let [a, b, c] = [row(0), row(1), row(2)];
        let rows = [a, b, c, [0.0, 0.0, 0.0, 1.0]];
        let mut world_to_camera = [0.0; 16];
        for (to, from) in world_to_camera.iter_mut().zip(rows.as_flattened()) {
            *to = *from;
        }
        Camera {
            width,
            height,
            fx,
            fy,
            cx: -left.tan() * fx,
            cy: up.tan() * fy,
            world_to_camera,
            background,
            light,
            near: near / placement.scale,
            preview_scale: 1.0,
        }
    }
}
