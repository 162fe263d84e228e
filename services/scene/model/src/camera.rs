//! Pinhole cameras and lights, and their JSON file.

use std::path::Path;

use glam::{DMat4, DVec3, Vec3};
use serde::{Deserialize, Serialize};
use sg_input::{file, limits};

/// Most pixels of a picture: 8192 x 8192.
pub const MAX_PIXELS: u64 = 1 << 26;

/// A pinhole camera as in COLMAP and 3DGS: axes x right, y down, z forward; the first pixel's centre at (0.5, 0.5).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// Picture width in pixels.
    pub width: u32,
    /// Picture height in pixels.
    pub height: u32,
    /// Focal length along x in pixels.
    pub fx: f64,
    /// Focal length along y in pixels.
    pub fy: f64,
    /// Principal point, x, in pixels.
    pub cx: f64,
    /// Principal point, y, in pixels.
    pub cy: f64,
    /// Scene to camera, rigid, 16 numbers, row major.
    pub world_to_camera: [f64; 16],
    /// Background colour, RGB 0 to 1.
    #[serde(default)]
    pub background: [f32; 3],
    /// Light.
    #[serde(default)]
    pub light: Light,
    /// Distance from the eye, in the scene's unit, within which Gaussians fade out. With 0 only what lies behind the eye does.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub near: f64,
    /// Edge of this picture over that of the picture it previews, above 0 and at most 1. Below 1 each Gaussian keeps the area
    /// times opacity that it has there, although it is dilated by a larger pixel.
    #[serde(default = "whole", skip_serializing_if = "is_whole")]
    pub preview_scale: f64,
}

fn whole() -> f64 {
    1.0
}

fn is_whole(number: &f64) -> bool {
    *number == 1.0
}

fn is_zero(number: &f64) -> bool {
    *number == 0.0
}

/// One light and the multipliers on the shading factors.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Light {
    /// The light mode.
    pub mode: LightMode,
    /// For `direction`: from the surface to the light, in the scene frame, of any length.
    pub direction: [f32; 3],
    /// Multiplier on the ambient factor.
    pub ka: f32,
    /// Multiplier on the diffuse factor.
    pub kd: f32,
    /// Multiplier on the specular factor.
    pub ks: f32,
    /// Multiplier on the specular exponent.
    pub shininess: f32,
}

impl Default for Light {
    fn default() -> Self {
        Self { mode: LightMode::Headlight, direction: [0.0, 0.0, 1.0], ka: 1.0, kd: 1.0, ks: 1.0, shininess: 1.0 }
    }
}

/// The light mode.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LightMode {
    /// From the eye: l = v for each Gaussian.
    #[default]
    Headlight,
    /// From one direction.
    Direction,
}

/// A camera file that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum CameraError {
    /// The file could not be read.
    #[error("{path}: {source}; give the path of a camera JSON file")]
    Read {
        /// The file.
        path: String,
        /// The system's error.
        source: std::io::Error,
    },
    /// The file is not a camera.
    #[error("{path}: {source}")]
    Parse {
        /// The file.
        path: String,
        /// The parser's place and cause.
        source: serde_json::Error,
    },
    /// A number makes no picture.
    #[error("{path}: `{field}` is {found}; it must be {want}")]
    Value {
        /// The file.
        path: String,
        /// The key.
        field: &'static str,
        /// The finding.
        found: String,
        /// The remedy.
        want: &'static str,
    },
}

impl Camera {
    /// A camera at `eye` that looks at `target`, with a vertical field of view in degrees.
    ///
    /// `up` is the scene direction that points up in the picture. If it is parallel to the view, another is taken.
    #[must_use]
    pub fn look_at(eye: DVec3, target: DVec3, up: DVec3, fov_y_degrees: f64, width: u32, height: u32) -> Self {
        let z = (target - eye).try_normalize().unwrap_or(DVec3::Z);
        let x = z.cross(up).try_normalize().unwrap_or_else(|| z.any_orthonormal_vector());
        let y = z.cross(x);
        let t = DVec3::new(-x.dot(eye), -y.dot(eye), -z.dot(eye));
        let f = 0.5 * f64::from(height) / (0.5 * fov_y_degrees.to_radians()).tan();
        Self {
            width,
            height,
            fx: f,
            fy: f,
            cx: 0.5 * f64::from(width),
            cy: 0.5 * f64::from(height),
            world_to_camera: [x.x, x.y, x.z, t.x, y.x, y.y, y.z, t.y, z.x, z.y, z.z, t.z, 0.0, 0.0, 0.0, 1.0],
            background: [0.0; 3],
            light: Light::default(),
            near: 0.0,
            preview_scale: 1.0,
        }
    }

    /// Scene to camera.
    #[must_use]
    pub fn view(&self) -> DMat4 {
        DMat4::from_cols_array(&self.world_to_camera).transpose()
    }

    /// Position of the eye in the scene frame.
    #[must_use]
    pub fn eye(&self) -> DVec3 {
        self.view().inverse().transform_point3(DVec3::ZERO)
    }

    /// Background as a vector.
    #[must_use]
    pub fn background(&self) -> Vec3 {
        Vec3::from_array(self.background)
    }

    /// Reads and checks a camera file.
    ///
    /// # Errors
    /// [`CameraError`] if it cannot be read, is not JSON of this form, or holds numbers that make no picture.
    pub fn read(path: &Path) -> Result<Self, CameraError> {
        let name = path.display().to_string();
        let text = file::read_text(path, limits::SMALL_TEXT_BYTES)
            .map_err(|source| CameraError::Read { path: name.clone(), source })?;
        let camera: Self =
            serde_json::from_str(&text).map_err(|source| CameraError::Parse { path: name.clone(), source })?;
        camera.check(&name)?;
        Ok(camera)
    }

    /// Checks that the numbers make a picture; `path` names the source in the error.
    ///
    /// # Errors
    /// [`CameraError::Value`].
    pub fn check(&self, path: &str) -> Result<(), CameraError> {
        let wrong = |field, found: String, want| Err(CameraError::Value { path: path.to_owned(), field, found, want });
        if self.width == 0 || self.height == 0 || self.width > 16_384 || self.height > 16_384 {
            return wrong("width, height", format!("{} x {}", self.width, self.height), "1 to 16384 pixels each");
        }
        if u64::from(self.width) * u64::from(self.height) > MAX_PIXELS {
            return wrong(
                "width, height",
                format!("{} x {}", self.width, self.height),
                "at most 67108864 pixels in all",
            );
        }
        if !(self.fx > 0.0 && self.fy > 0.0 && self.fx.is_finite() && self.fy.is_finite()) {
            return wrong("fx, fy", format!("{}, {}", self.fx, self.fy), "finite and above 0");
        }
        if !(self.cx.is_finite() && self.cy.is_finite()) {
            return wrong("cx, cy", format!("{}, {}", self.cx, self.cy), "finite");
        }
        if !(self.near >= 0.0 && self.near.is_finite()) {
            return wrong("near", self.near.to_string(), "finite and not below 0");
        }
        if !(self.preview_scale > 0.0 && self.preview_scale <= 1.0) {
            return wrong("preview_scale", self.preview_scale.to_string(), "above 0 and at most 1");
        }
        let view = self.view();
        let finite = self.world_to_camera.iter().all(|x| x.is_finite());
        let determinant = glam::DMat3::from_mat4(view).determinant();
        if !finite || determinant.abs() < 1e-12 || self.world_to_camera[12..] != [0.0, 0.0, 0.0, 1.0] {
            return wrong(
                "world_to_camera",
                format!("{:?}", self.world_to_camera),
                "16 finite numbers, row major, with last row 0 0 0 1",
            );
        }
        let light = [self.light.ka, self.light.kd, self.light.ks, self.light.shininess];
        if !light.iter().chain(&self.background).chain(&self.light.direction).all(|x| x.is_finite()) {
            return wrong("background, light", "not finite".to_owned(), "finite numbers");
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn look_at_puts_the_target_in_the_middle_with_up_up() {
        let camera = Camera::look_at(DVec3::new(0.0, -3.0, 0.0), DVec3::ZERO, DVec3::Z, 40.0, 64, 48);
        let middle = camera.view().transform_point3(DVec3::ZERO);
        assert!((middle - DVec3::new(0.0, 0.0, 3.0)).length() < 1e-12);
        assert!(camera.view().transform_vector3(DVec3::Z).y < 0.0, "y points down in the camera");
        assert!((camera.eye() - DVec3::new(0.0, -3.0, 0.0)).length() < 1e-12);
        assert!((glam::DMat3::from_mat4(camera.view()).determinant() - 1.0).abs() < 1e-12);
        assert!(camera.check("test").is_ok());
    }
}
