//! The appearance of a scene: all values that edits change, and no others.

use std::sync::Arc;

use glam::{DVec3, Vec3};

use crate::camera::Light;
use crate::mask::Mask;
use crate::model::Scene;
use crate::tone::Tone;

/// All that a renderer needs beside the geometry and the camera.
#[derive(Debug, Clone, PartialEq)]
pub struct Appearance {
    /// One entry for each base unit, in scene order.
    pub base: Vec<BaseAppearance>,
    /// Editable units, oldest first. If units overlap, the latest one's colour wins; opacities multiply.
    pub units: Vec<UnitAppearance>,
    /// The highlight of the current selection or a brush preview, drawn over the shaded colour.
    pub overlay: Option<Overlay>,
    /// Light of the scene; its multipliers act on top of those of each base unit.
    pub light: Light,
    /// Background colour, RGB 0 to 1.
    pub background: Vec3,
    /// The part of the shading to show.
    pub term: ShadingTerm,
    /// A Gaussian is drawn only where every one of these keeps its centre.
    pub clips: Vec<Clip>,
    /// Colours that replace the shaded ones, one for each Gaussian by scene-wide index, at least 0. Views of structure
    /// and attributes use them. Opacities and hidden Gaussians stay, and the overlay is drawn over them.
    pub colors: Option<Arc<[Vec3]>>,
    /// Factors on the ambient factor ka, one for each Gaussian by scene-wide index, 0 to 1: ambient occlusion. They act on lit
    /// Gaussians only; the others have no ambient term.
    pub occlusion: Option<Arc<[f32]>>,
    /// The opacity of Gaussians that are widened to the size of a pixel.
    pub filter: PixelFilter,
}

/// The opacity of a Gaussian that is widened to the size of a pixel.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum PixelFilter {
    /// The filter that each base unit was trained for, by its file; plain by default.
    #[default]
    FromFile,
    /// It stays, as in 3DGS. Gaussians thinner than a pixel gain in sum.
    Plain,
    /// It falls by as much as the area grows, √(det S / det(S + 0.3 px²·I)), as in Mip-Splatting (Yu et al. 2024) and
    /// 3DGS' `antialiasing`. Gaussians thinner than a pixel fade.
    Compensated,
}

/// The half-space n·p ≥ offset of the scene frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HalfSpace {
    /// Its inward normal n, of any length but zero.
    pub normal: DVec3,
    /// The least n·p inside.
    pub offset: f64,
}

impl HalfSpace {
    /// The same half-space with a normal of unit length, for points relative to `origin`.
    #[must_use]
    pub fn relative_to(&self, origin: DVec3) -> Self {
        let length = self.normal.length();
        let normal = self.normal / length;
        Self { normal, offset: self.offset / length - normal.dot(origin) }
    }
}

/// A clip plane or box. Pictures cut Gaussians that cross it; elsewhere the centre of a Gaussian decides whether it is visible.
#[derive(Debug, Clone, PartialEq)]
pub struct Clip {
    /// The enclosed region is their intersection: one for a plane, six for a box.
    pub sides: Vec<HalfSpace>,
    /// Whether it keeps its inside, or all else.
    pub keep_inside: bool,
}

impl Clip {
    /// Keeps the side of the plane through `point` that `normal` points to.
    #[must_use]
    pub fn plane(point: DVec3, normal: DVec3) -> Self {
        Self { sides: vec![HalfSpace { normal, offset: normal.dot(point) }], keep_inside: true }
    }

    /// Keeps the box between two corners, along the scene's axes, or all else.
    #[must_use]
    pub fn between(min: DVec3, max: DVec3, keep_inside: bool) -> Self {
        let sides = [DVec3::X, DVec3::Y, DVec3::Z].into_iter().flat_map(|axis| {
            let low = HalfSpace { normal: axis, offset: axis.dot(min) };
            [low, HalfSpace { normal: -axis, offset: -axis.dot(max) }]
        });
        Self { sides: sides.collect(), keep_inside }
    }

    /// Whether it keeps `point` of the scene frame.
    #[must_use]
    pub fn keeps(&self, point: DVec3) -> bool {
        self.may_keep(point, 0.0)
    }

    /// Whether it may keep a part of the ball about `center` of the scene frame. The outside of a region may be kept where one of
    /// its sides is near.
    #[must_use]
    pub fn may_keep(&self, center: DVec3, radius: f64) -> bool {
        let moved = if self.keep_inside { -radius } else { radius };
        let is_inside = |s: &HalfSpace| s.normal.dot(center) >= s.offset + moved * s.normal.length();
        self.sides.iter().all(is_inside) == self.keep_inside
    }
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
    /// Replaces the diffuse colour c_d of its members. They stay as much brighter or darker than this colour as they were than
    /// their palette colour ([`crate::recolor::recolored`]).
    pub color: Option<Vec3>,
    /// Factor on the opacity of its members.
    pub opacity: f32,
    /// Hidden units draw nothing of their members.
    pub visible: bool,
    /// Change of the colours of its members, after any unit's colour. Of overlapping units it is that of all
    /// ([`Tone::and`]).
    pub tone: Tone,
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

/// The part of the shading to show.
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
    /// The look of a scene by its file, before any edit.
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
            clips: Vec::new(),
            colors: None,
            occlusion: None,
            filter: PixelFilter::FromFile,
        }
    }
}
