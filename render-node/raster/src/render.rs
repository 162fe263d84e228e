//! Draws one picture of a scene.

use std::time::Instant;

use glam::DVec3;
use sg_scene::appearance::{Appearance, Clip, HalfSpace};
use sg_scene::camera::{Camera, CameraError};
use sg_scene::model::{ColumnLength, Scene};

use crate::cutoffs::Limits;
use crate::foveation::Foveation;
use crate::image::Image;
use crate::ray_consistent;
use crate::reference_f64;
use crate::report::Report;
use crate::splat_f32;

/// Error bound of a picture against [`Quality::Exact`].
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Quality {
    /// The reference: f64, no visible cut-off.
    Exact,
    /// At least 50 dB over the frame and over the footprint, coverage error at most 1 %.
    #[default]
    Standard,
    /// At least 40 dB over the frame and over the footprint, coverage error at most 3 %.
    Fast,
}

/// Projection and order of Gaussians.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Deserialize, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Projection {
    /// As 3DGS: each Gaussian becomes an ellipse by an affine projection at its center. The order is the view z of
    /// the centers. Turning the camera changes the color along one ray. Rays evaluate Gaussians that are near the eye or
    /// large for their depth. Near the eye the order is by distance and the dilation an angle, as for rays.
    #[default]
    Affine,
    /// Each pixel's ray evaluates each Gaussian, and orders them by their densest place on the ray. Turning the
    /// camera changes nothing. Gaussians beside and behind the eye count if they reach the ray.
    PerRay,
}

/// Quality and projection of a picture. A [`Quality`] converts to options with all other defaults.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Options {
    /// Error bound.
    pub quality: Quality,
    /// Projection and order of Gaussians. Each projection has its own reference.
    pub projection: Projection,
    /// Half resolution far from the optical axis. [`Quality::Exact`], [`Projection::PerRay`] and quadrilaterals of devices draw every
    /// pixel.
    pub foveation: Option<Foveation>,
}

impl Options {
    /// Whether graphics devices support these options. Only the CPU draws references.
    #[must_use]
    pub fn drawn_by_devices(self) -> bool {
        self.quality != Quality::Exact
    }
}

impl From<Quality> for Options {
    fn from(quality: Quality) -> Self {
        Self { quality, ..Self::default() }
    }
}

/// A picture and its report.
#[derive(Debug, Clone, PartialEq)]
pub struct Rendered {
    /// The picture.
    pub image: Image,
    /// Counts and seconds.
    pub report: Report,
}

/// Invalid input of a picture.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// Invalid camera.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// Columns of different lengths.
    #[error("base unit `{unit}`: {source}")]
    Columns {
        /// Name of the base unit.
        unit: String,
        /// Which column.
        source: ColumnLength,
    },
    /// An appearance of another scene.
    #[error("the appearance has settings for {found} base units, the scene has {expected}")]
    BaseUnits {
        /// Base units in the appearance.
        found: usize,
        /// Base units in the scene.
        expected: usize,
    },
    /// A mask of another scene.
    #[error("{what} has {found} Gaussians, the scene has {expected}; make it from this scene")]
    Mask {
        /// Which mask.
        what: String,
        /// Its length.
        found: usize,
        /// Gaussians in the scene.
        expected: usize,
    },
    /// Colours of another scene.
    #[error("there are colours for {found} Gaussians, the scene has {expected}; make them from this scene")]
    Colors {
        /// Colours given.
        found: usize,
        /// Gaussians in the scene.
        expected: usize,
    },
    /// Occlusion of another scene.
    #[error("there are occlusion factors for {found} Gaussians, the scene has {expected}; compute them for this scene")]
    Occlusion {
        /// Factors given.
        found: usize,
        /// Gaussians in the scene.
        expected: usize,
    },
    /// A clip without sides, or with an invalid side.
    #[error("clip {index} has no side, or one whose normal is zero or that is not finite")]
    Clip {
        /// Which clip, from 0.
        index: usize,
    },
    /// An invalid level of accumulated opacity.
    #[error("a front surface at an accumulated opacity of {level}; give a level above 0 and at most 1")]
    Level {
        /// The level.
        level: f64,
    },
    /// A ray without a direction.
    #[error("the ray has no direction")]
    Ray,
    /// A background that is not finite.
    #[error("the background colour is not finite")]
    Background,
    /// More Gaussians than 32-bit indices.
    #[error("{found} Gaussians are more than the 4294967295 that one picture can hold; draw the scene in parts")]
    TooMany {
        /// Gaussians in the scene.
        found: usize,
    },
}

/// Draws a scene with an appearance. Light and background come from the appearance, not from the camera.
///
/// Runs on the current rayon thread pool. The picture does not depend on the number of threads. Gaussians with a
/// NaN or infinite attribute are left out and counted, so that every pixel is finite.
///
/// # Errors
/// [`RenderError`] for an invalid camera, or parts that belong to different scenes.
pub fn render(
    scene: &Scene,
    appearance: &Appearance,
    camera: &Camera,
    options: impl Into<Options>,
) -> Result<Rendered, RenderError> {
    check(scene, appearance, camera)?;
    let began = Instant::now();
    let Options { quality, projection, foveation } = options.into();
    let (image, mut report) = match (projection, quality) {
        (Projection::Affine, Quality::Exact) => reference_f64::render(scene, appearance, camera),
        (Projection::Affine, Quality::Standard) => {
            splat_f32::render(scene, appearance, camera, (Limits::STANDARD, foveation))
        }
        (Projection::Affine, Quality::Fast) => splat_f32::render(scene, appearance, camera, (Limits::FAST, foveation)),
        (Projection::PerRay, Quality::Exact) => ray_consistent::reference_f64::render(scene, appearance, camera),
        (Projection::PerRay, Quality::Standard) => {
            ray_consistent::splat_f32::render::<1024>(scene, appearance, camera, Limits::STANDARD)
        }
        (Projection::PerRay, Quality::Fast) => {
            ray_consistent::splat_f32::render::<256>(scene, appearance, camera, Limits::FAST)
        }
    };
    report.seconds.total = began.elapsed().as_secs_f64();
    Ok(Rendered { image, report })
}

pub(crate) fn check(scene: &Scene, appearance: &Appearance, camera: &Camera) -> Result<(), RenderError> {
    check_scene(scene)?;
    check_look([scene.len(), scene.units.len()], appearance, camera)
}

/// Checks a scene, once for all its pictures.
pub fn check_scene(scene: &Scene) -> Result<(), RenderError> {
    if u32::try_from(scene.len()).is_err() {
        return Err(RenderError::TooMany { found: scene.len() });
    }
    for unit in &scene.units {
        unit.gaussians.check_lengths().map_err(|source| RenderError::Columns { unit: unit.name.clone(), source })?;
    }
    Ok(())
}

/// Checks the appearance and the camera for a scene with these numbers of Gaussians and base units.
pub fn check_look(
    [gaussians, base_units]: [usize; 2],
    appearance: &Appearance,
    camera: &Camera,
) -> Result<(), RenderError> {
    camera.check("camera")?;
    if !appearance.background.is_finite() {
        return Err(RenderError::Background);
    }
    if appearance.base.len() != base_units {
        return Err(RenderError::BaseUnits { found: appearance.base.len(), expected: base_units });
    }
    if let Some(colors) = appearance.colors.as_ref().filter(|c| c.len() != gaussians) {
        return Err(RenderError::Colors { found: colors.len(), expected: gaussians });
    }
    if let Some(factors) = appearance.occlusion.as_ref().filter(|f| f.len() != gaussians) {
        return Err(RenderError::Occlusion { found: factors.len(), expected: gaussians });
    }
    let usable = |s: &HalfSpace| s.normal.is_finite() && s.normal != DVec3::ZERO && s.offset.is_finite();
    let broken = |c: &Clip| c.sides.is_empty() || !c.sides.iter().all(usable);
    if let Some(index) = appearance.clips.iter().position(broken) {
        return Err(RenderError::Clip { index });
    }
    let masks = appearance.units.iter().enumerate().map(|(k, u)| (format!("editable unit {k}"), &u.mask));
    let overlay = appearance.overlay.iter().map(|o| ("the overlay".to_owned(), &o.mask));
    for (what, mask) in masks.chain(overlay) {
        if mask.len() != gaussians {
            return Err(RenderError::Mask { what, found: mask.len(), expected: gaussians });
        }
    }
    Ok(())
}
