//! How a scene looks at one moment: everything that edits change, nothing that they do not.

use std::sync::Arc;

use glam::Vec3;

use crate::camera::Light;
use crate::mask::Mask;
use crate::model::Scene;

/// All that a renderer needs beside the geometry and the camera.
#[derive(Debug, Clone, PartialEq)]
pub struct Appearance {
    /// One entry for each base unit, in scene order.
    pub base: Vec<BaseAppearance>,
    /// Editable units, oldest first: where units overlap the latest one's colour wins, opacities multiply.
    pub units: Vec<UnitAppearance>,
    /// The highlight of the current selection or a brush preview, drawn over the shaded colour.
    pub overlay: Option<Overlay>,
    /// Light of the scene; its multipliers act on top of those of each base unit.
    pub light: Light,
    /// Background colour, RGB 0 to 1.
    pub background: Vec3,
    /// Which part of the shading is shown.
    pub term: ShadingTerm,
}

/// Live settings of one base unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BaseAppearance {
    /// Palette colour c_p.
    pub palette: Vec3,
    /// Factor on the opacity, at least 0.
    pub opacity: f32,
    /// Hidden units draw nothing.
    pub visible: bool,
    /// Multipliers on ka, kd, ks and β of this unit.
    pub multipliers: [f32; 4],
}

/// Live settings of one editable unit.
#[derive(Debug, Clone, PartialEq)]
pub struct UnitAppearance {
    /// Its members.
    pub mask: Arc<Mask>,
    /// Replaces the diffuse colour c_d of its members.
    pub color: Option<Vec3>,
    /// Factor on the opacity of its members.
    pub opacity: f32,
    /// Hidden units draw nothing of their members.
    pub visible: bool,
}

/// A highlight after shading: c ← (1−mix)·c + mix·color; o ← clamp(o·opacity, 0, 1).
#[derive(Debug, Clone, PartialEq)]
pub struct Overlay {
    /// Highlighted Gaussians.
    pub mask: Arc<Mask>,
    /// Highlight colour.
    pub color: Vec3,
    /// Share of the highlight colour, 0 to 1.
    pub mix: f32,
    /// Factor on the opacity.
    pub opacity: f32,
}

/// Which part of the shading is shown.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum ShadingTerm {
    /// The whole model.
    #[default]
    Full,
    /// Normals as colours, ½(n + 1).
    Normal,
    /// Only the ambient term.
    Ambient,
    /// Only the diffuse term.
    Diffuse,
    /// Only the specular term.
    Specular,
}

impl Appearance {
    /// The look of a scene as its file says, before any edit.
    #[must_use]
    pub fn of(scene: &Scene) -> Self {
        let base = scene
            .units
            .iter()
            .map(|u| BaseAppearance { palette: u.palette, opacity: u.opacity, visible: true, multipliers: [1.0; 4] })
            .collect();
        Self {
            base,
            units: Vec::new(),
            overlay: None,
            light: Light::default(),
            background: Vec3::ZERO,
            term: ShadingTerm::Full,
        }
    }
}
