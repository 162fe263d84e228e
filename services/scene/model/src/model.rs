//! The struct-of-arrays model of an editable-Gaussian scene.
//!
//! Columns hold the values of the files: logit of the opacity, logarithm of the scale, quaternion of any length. A
//! scene that is read and written keeps its bits. The `…` accessors return the activated values.

use std::ops::Range;
use std::path::PathBuf;

use glam::{DMat3, DMat4, DQuat, DVec3, Vec3};
use serde::{Deserialize, Serialize};

use crate::orientation::Orientation;

/// The columns of a set of 3D Gaussians, all of one length, in the unit's local frame.
///
/// An index into these columns is the Gaussian's identity: it never changes and is never reused.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Gaussians {
    /// Centres, in the volume's physical length unit.
    pub position: Vec<Vec3>,
    /// Rotations as quaternions `[w, x, y, z]` of any non-zero length, as stored.
    pub rotation: Vec<[f32; 4]>,
    /// Natural logarithm of the standard deviation along each rotated axis, in the position's length unit.
    pub log_scale: Vec<Vec3>,
    /// Logit of the peak opacity: the opacity is `1 / (1 + exp(-x))`.
    pub opacity_logit: Vec<f32>,
    /// Editable shading attributes, absent for plain 3DGS scenes (those are drawn unlit from their harmonics).
    pub shading: Option<ShadingColumns>,
    /// Spherical harmonics of the colour, absent where a scene has none.
    pub harmonics: Option<Harmonics>,
    /// Columns of the file that nothing here interprets; written back unchanged.
    pub extra: Vec<ExtraColumn>,
    /// Whether they were made for a pixel filter that compensates the opacity ([`crate::appearance::PixelFilter`]).
    pub antialiased: bool,
}

/// Editable Blinn-Phong attributes, *as used* (after any activation of the file's convention).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ShadingColumns {
    /// Colour added to the palette colour of the base unit (Δc), RGB without transfer function.
    pub offset_color: Vec<Vec3>,
    /// Surface normal in the local frame, of unit length, or zero if there is none.
    pub normal: Vec<Vec3>,
    /// Ambient factor ka.
    pub ambient: Vec<f32>,
    /// Diffuse factor kd.
    pub diffuse: Vec<f32>,
    /// Specular factor ks.
    pub specular: Vec<f32>,
    /// Specular exponent β.
    pub shininess: Vec<f32>,
}

/// Real spherical harmonics in the convention of 3DGS (colour = ½ + C₀·dc + Σ basis·rest).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Harmonics {
    /// Degree of the expansion, 0 to 3.
    pub degree: u8,
    /// Constant term, RGB, one row a Gaussian.
    pub dc: Vec<[f32; 3]>,
    /// Higher terms, RGB rows, `(degree + 1)² − 1` rows a Gaussian, coefficient-major (row `i·k + j` is term `j` of Gaussian `i`).
    pub rest: Vec<[f32; 3]>,
}

impl Harmonics {
    /// C₀, the constant basis function: ½·√(1/π).
    pub const C0: f64 = 0.282_094_791_773_878_14;

    /// Rows of `rest` per Gaussian.
    #[must_use]
    pub fn rest_per_gaussian(&self) -> usize {
        (usize::from(self.degree) + 1).pow(2) - 1
    }
}

/// A column that is kept but not interpreted.
#[derive(Debug, Clone, PartialEq)]
pub struct ExtraColumn {
    /// Property name in the file.
    pub name: String,
    /// Values in the file's own type.
    pub values: ExtraValues,
}

/// Names of the columns that tell what a Gaussian stands for in its volume begin with this. They mean nothing without shading
/// columns.
pub const SOURCE_PREFIX: &str = "source_";

/// Values of an uninterpreted column, in the type they had in the file.
#[derive(Debug, Clone, PartialEq)]
#[allow(missing_docs, reason = "each variant is named after the PLY scalar type it holds")]
pub enum ExtraValues {
    I8(Vec<i8>),
    U8(Vec<u8>),
    I16(Vec<i16>),
    U16(Vec<u16>),
    I32(Vec<i32>),
    U32(Vec<u32>),
    F32(Vec<f32>),
    F64(Vec<f64>),
}

impl Gaussians {
    /// Number of Gaussians.
    #[must_use]
    pub fn len(&self) -> usize {
        self.position.len()
    }

    /// Whether there is no Gaussian.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.position.is_empty()
    }

    /// Peak opacity of Gaussian `i`, 0 to 1 (NaN where the stored logit is NaN).
    #[must_use]
    pub fn opacity(&self, i: usize) -> f32 {
        1.0 / (1.0 + (-self.opacity_logit[i]).exp())
    }

    /// Standard deviations of Gaussian `i` along its own axes, in the position's length unit.
    #[must_use]
    pub fn scale(&self, i: usize) -> Vec3 {
        self.log_scale[i].exp()
    }

    /// Mean of the areas that Gaussian `i` covers as seen along its three axes: (s₁s₂ + s₂s₃ + s₃s₁)/3, in squared length units of
    /// the position. Together with the opacity it says how much of a picture shows it.
    #[must_use]
    pub fn mean_area(&self, i: usize) -> f64 {
        let s = self.scale(i).as_dvec3();
        (s.x * s.y + s.y * s.z + s.z * s.x) / 3.0
    }

    /// Unit rotation of Gaussian `i` (own axes to local frame) in f64. A zero or non-finite quaternion gives the
    /// identity. The length is taken out in f64, so that denormal and huge quaternions keep their direction.
    #[must_use]
    pub fn unit_rotation(&self, i: usize) -> DQuat {
        let [w, x, y, z] = self.rotation[i].map(f64::from);
        let length = (w * w + x * x + y * y + z * z).sqrt();
        if length > 0.0 && length.is_finite() {
            DQuat::from_xyzw(x / length, y / length, z / length, w / length)
        } else {
            DQuat::IDENTITY
        }
    }

    /// Covariance R·diag(s²)·Rᵀ of Gaussian `i` in the local frame, in f64 (Kerbl et al. 2023, equation 6).
    #[must_use]
    pub fn covariance(&self, i: usize) -> DMat3 {
        let rotation = DMat3::from_quat(self.unit_rotation(i));
        let scale = self.log_scale[i].as_dvec3().exp();
        let half = rotation * DMat3::from_diagonal(scale);
        half * half.transpose()
    }

    /// Whether the centre of Gaussian `i` is finite: others are drawn nowhere and belong to no cluster.
    #[must_use]
    pub fn has_finite_position(&self, i: usize) -> bool {
        self.position[i].is_finite()
    }

    /// Checks that all columns have the same length.
    ///
    /// # Errors
    /// [`ColumnLength`] names the first column that differs.
    pub fn check_lengths(&self) -> Result<(), ColumnLength> {
        let expected = self.len();
        let mut columns = vec![
            ("rotation", self.rotation.len()),
            ("log_scale", self.log_scale.len()),
            ("opacity_logit", self.opacity_logit.len()),
        ];
        if let Some(s) = &self.shading {
            columns.extend([
                ("offset_color", s.offset_color.len()),
                ("normal", s.normal.len()),
                ("ambient", s.ambient.len()),
                ("diffuse", s.diffuse.len()),
                ("specular", s.specular.len()),
                ("shininess", s.shininess.len()),
            ]);
        }
        if let Some(h) = &self.harmonics {
            columns.push(("dc", h.dc.len()));
            // A remainder shows as a length that is off by one, never as a silent truncation.
            let k = h.rest_per_gaussian();
            let rows = h.rest.len();
            let whole = if k == 0 { expected + rows } else { rows.div_ceil(k) };
            columns.push(("rest", whole));
        }
        for column in &self.extra {
            columns.push((&column.name, column.values.len()));
        }
        match columns.into_iter().find(|(_, n)| *n != expected) {
            Some((name, found)) => Err(ColumnLength { name: name.to_owned(), found, expected }),
            None => Ok(()),
        }
    }
}

impl ExtraValues {
    /// Number of values.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::I8(v) => v.len(),
            Self::U8(v) => v.len(),
            Self::I16(v) => v.len(),
            Self::U16(v) => v.len(),
            Self::I32(v) => v.len(),
            Self::U32(v) => v.len(),
            Self::F32(v) => v.len(),
            Self::F64(v) => v.len(),
        }
    }

    /// Whether there is no value.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// A column whose length is not the number of Gaussians.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("column `{name}` has {found} values for {expected} Gaussians")]
pub struct ColumnLength {
    /// Name of the column.
    pub name: String,
    /// Its length.
    pub found: usize,
    /// Number of Gaussians.
    pub expected: usize,
}

/// The shading model of Gaussians before blending.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ShadingModel {
    /// c = ka·c_d + kd·max(n·l,0)·c_d + ks·max(n·h,0)^β, clamped to `[0, 1]`.
    #[default]
    Paper,
    /// Two-sided, as iVR-GS trains: c = (ka + kd·|n·l|)·c_d + ks·|n·h|^β.
    IvrgsTrain,
    /// Two-sided, as iVR-GS's viewer draws: the specular term carries an extra factor kd.
    IvrgsViewer,
}

/// The activation of the stored shading columns of a unit's file.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Convention {
    /// Stored as used (our own files).
    #[default]
    Ours,
    /// iVR-GS checkpoints before January 2025: offset colour through a sigmoid, ks and β as stored.
    Legacy,
    /// iVR-GS since January 2025, float files: ks = 5·sigmoid, β = 50·sigmoid.
    HeadRaw,
    /// iVR-GS since January 2025, quantised files: ks and β are already activated in the codebook.
    HeadActivated,
}

/// One base unit of a scene: the Gaussians of one transfer-function range and how they are coloured.
#[derive(Debug, Clone, PartialEq)]
pub struct BaseUnit {
    /// Name, unique within the scene.
    pub name: String,
    /// The file its Gaussians came from, if any.
    pub file: Option<PathBuf>,
    /// Its Gaussians.
    pub gaussians: Gaussians,
    /// Scene-wide index of its first Gaussian.
    pub first: usize,
    /// Palette colour c_p, RGB 0 to 1.
    pub palette: Vec3,
    /// Factor on every opacity, at least 0; the product is clamped to `[0, 1]`.
    pub opacity: f32,
    /// Local frame to scene frame (affine).
    pub transform: DMat4,
    /// Activation of the stored shading columns.
    pub convention: Convention,
    /// Shading model.
    pub shading: ShadingModel,
    /// Whether normals point consistently to one side (from a gradient or from training). Features can then use their sign.
    pub oriented_normals: bool,
    /// The transfer function behind the unit, relative to the scene file.
    pub transfer_function: Option<PathBuf>,
    /// Least and greatest value of the volume behind the unit, raw.
    pub values: Option<[f64; 2]>,
}

impl BaseUnit {
    /// Gaussians of our own, of no file: where they are, without a palette, opaque as they are, without signs of their normals.
    #[must_use]
    pub fn new(name: impl Into<String>, gaussians: Gaussians) -> Self {
        Self {
            name: name.into(),
            file: None,
            gaussians,
            first: 0,
            palette: Vec3::ZERO,
            opacity: 1.0,
            transform: DMat4::IDENTITY,
            convention: Convention::Ours,
            shading: ShadingModel::Paper,
            oriented_normals: false,
            transfer_function: None,
            values: None,
        }
    }

    /// All of the unit but its Gaussians, for a unit of other ones. Nothing of a Gaussian's size is copied.
    #[must_use]
    pub fn without_gaussians(&self) -> Self {
        Self {
            name: self.name.clone(),
            file: self.file.clone(),
            gaussians: Gaussians::default(),
            transfer_function: self.transfer_function.clone(),
            ..*self
        }
    }

    /// Scene-wide indices of this unit's Gaussians.
    #[must_use]
    pub fn range(&self) -> Range<usize> {
        self.first..self.first + self.gaussians.len()
    }

    /// Whether its colours are harmonics alone, as plain 3DGS trains them.
    #[must_use]
    pub fn is_trained(&self) -> bool {
        self.gaussians.shading.is_none() && self.gaussians.harmonics.is_some()
    }

    /// The colour of one of its Gaussians in the file, RGB, without light: the palette with the offset, the constant term of its
    /// harmonics, or the palette. It may lie outside 0 to 1.
    #[must_use]
    pub fn unlit_color(&self, i: usize) -> DVec3 {
        match (&self.gaussians.shading, &self.gaussians.harmonics) {
            (Some(shading), _) => (self.palette + shading.offset_color[i]).as_dvec3(),
            (None, Some(harmonics)) => {
                DVec3::splat(0.5) + Harmonics::C0 * DVec3::from_array(harmonics.dc[i].map(f64::from))
            }
            (None, None) => self.palette.as_dvec3(),
        }
    }

    /// The colour that a palette gives to a unit of trained splats, whose colours are harmonics alone: that of the palette, unless
    /// it is the file's own. It replaces their hue as the colour of a saved unit does
    /// ([`recolored_unlit`](crate::recolor::recolored_unlit)). Other units add the palette to their colours.
    #[must_use]
    pub fn tint(&self, palette: Vec3) -> Option<Vec3> {
        (self.is_trained() && palette != self.palette).then_some(palette)
    }
}

/// A scene: base units in order. The scene-wide index of a Gaussian counts through the units.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// Base units in the order of `scene.toml`.
    pub units: Vec<BaseUnit>,
    /// The box that strokes are normalized by; stored, never recomputed.
    pub bounds: SceneBox,
    /// Its directions and length unit, as far as its file tells them.
    pub orientation: Orientation,
}

impl Scene {
    /// Puts units one after another and sets each unit's first index. Without a stored box, the box is that of all
    /// finite centres without unit transforms.
    #[must_use]
    pub fn compose(mut units: Vec<BaseUnit>, bounds: Option<SceneBox>) -> Self {
        let mut first = 0;
        for unit in &mut units {
            unit.first = first;
            first += unit.gaussians.len();
        }
        let bounds = bounds
            .unwrap_or_else(|| SceneBox::of_points(units.iter().flat_map(|u| u.gaussians.position.iter().copied())));
        Self { units, bounds, orientation: Orientation::default() }
    }

    /// Whether some unit has shading columns. Such scenes come from volumes.
    #[must_use]
    pub fn has_shading(&self) -> bool {
        self.units.iter().any(|unit| unit.gaussians.shading.is_some())
    }

    /// Number of Gaussians in all units.
    #[must_use]
    pub fn len(&self) -> usize {
        self.units.last().map_or(0, |u| u.range().end)
    }

    /// Whether there is no Gaussian.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The unit that holds the Gaussian of scene-wide index `i`, and its index within that unit.
    #[must_use]
    pub fn locate(&self, i: usize) -> Option<(&BaseUnit, usize)> {
        let at = self.units.partition_point(|u| u.range().end <= i);
        self.units.get(at).map(|u| (u, i - u.first))
    }

    /// Centre of Gaussian `i` in the scene frame, f64.
    #[must_use]
    pub fn position(&self, i: usize) -> Option<DVec3> {
        let (unit, local) = self.locate(i)?;
        Some(unit.transform.transform_point3(unit.gaussians.position[local].as_dvec3()))
    }
}

/// An axis-aligned box in scene coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SceneBox {
    /// Least corner.
    pub min: DVec3,
    /// Greatest corner.
    pub max: DVec3,
}

impl SceneBox {
    /// The box of the finite points; the unit cube at the origin if there is none.
    #[must_use]
    pub fn of_points(points: impl Iterator<Item = Vec3>) -> Self {
        let mut min = DVec3::INFINITY;
        let mut max = DVec3::NEG_INFINITY;
        for p in points.filter(|p| p.is_finite()) {
            min = min.min(p.as_dvec3());
            max = max.max(p.as_dvec3());
        }
        if min.x <= max.x { Self { min, max } } else { Self { min: DVec3::ZERO, max: DVec3::ONE } }
    }

    /// Length of each edge.
    #[must_use]
    pub fn size(&self) -> DVec3 {
        self.max - self.min
    }

    /// The longest edge: the unit of a stroke's radius.
    #[must_use]
    pub fn longest_edge(&self) -> f64 {
        self.size().max_element()
    }

    /// From normalized (0 to 1 on each axis) to scene coordinates.
    #[must_use]
    pub fn denormalize(&self, p: DVec3) -> DVec3 {
        self.min + p * self.size()
    }

    /// From scene to normalized coordinates; an axis of no extent gives 0.
    #[must_use]
    pub fn normalize(&self, p: DVec3) -> DVec3 {
        let size = self.size();
        let inverse = DVec3::select(size.cmpgt(DVec3::ZERO), size.recip(), DVec3::ZERO);
        (p - self.min) * inverse
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(rotation: [f32; 4]) -> Gaussians {
        Gaussians {
            position: vec![Vec3::ZERO],
            rotation: vec![rotation],
            log_scale: vec![Vec3::new(0.0, 1.0, -1.0)],
            opacity_logit: vec![0.0],
            ..Gaussians::default()
        }
    }

    #[test]
    fn a_quaternion_keeps_its_direction_at_any_length() {
        let want = one([0.5, 0.5, 0.5, 0.5]).covariance(0);
        for factor in [1e-38_f32, 1e-3, 3.0, 1e30] {
            let got = one([0.5 * factor; 4]).covariance(0);
            let error = (got - want).to_cols_array().iter().fold(0.0_f64, |m, x| m.max(x.abs()));
            assert!(error < 1e-5, "factor {factor}: {error}");
        }
    }

    #[test]
    fn zero_and_nan_quaternions_are_the_identity() {
        for q in [[0.0; 4], [f32::NAN; 4], [f32::INFINITY; 4]] {
            assert_eq!(one(q).unit_rotation(0), DQuat::IDENTITY);
        }
    }

    #[test]
    fn locate_skips_empty_units() {
        let unit = |name: &str, n: usize| {
            let gaussians = Gaussians {
                position: vec![Vec3::ZERO; n],
                rotation: vec![[1.0, 0.0, 0.0, 0.0]; n],
                log_scale: vec![Vec3::ZERO; n],
                opacity_logit: vec![0.0; n],
                ..Gaussians::default()
            };
            BaseUnit::new(name, gaussians)
        };
        let scene = Scene::compose(vec![unit("a", 2), unit("b", 0), unit("c", 3)], None);
        assert_eq!(scene.len(), 5);
        assert_eq!(scene.locate(2).map(|(u, i)| (u.name.as_str(), i)), Some(("c", 0)));
        assert!(scene.locate(5).is_none());
    }

    #[test]
    fn a_unit_without_its_gaussians_keeps_the_rest() {
        let mut unit = BaseUnit::new("a", one([1.0, 0.0, 0.0, 0.0]));
        (unit.opacity, unit.file, unit.transfer_function) = (0.5, Some("a.ply".into()), Some("a.tf.json".into()));
        let rest = unit.without_gaussians();
        assert!(rest.gaussians.is_empty());
        assert_eq!(BaseUnit { gaussians: unit.gaussians.clone(), ..rest }, unit);
    }
}
