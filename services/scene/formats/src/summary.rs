//! Summaries of scenes, for people and for reports.

use std::path::PathBuf;

use serde::Serialize;

use crate::splat::toml_number::row_major;
use crate::validation::NonFiniteCounts;
use sg_scene::model::{BaseUnit, Convention, ExtraColumn, ExtraValues, Scene, SceneBox, ShadingModel};

/// A scene in numbers.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// Gaussians in all units.
    pub gaussians: usize,
    /// The box that strokes are normalized by, in scene coordinates.
    pub bounds: SceneBox,
    /// [`Scene::content_hash`], hexadecimal.
    pub content_hash: String,
    /// Base units in scene order.
    pub units: Vec<UnitSummary>,
}

/// A base unit in numbers.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct UnitSummary {
    /// Name.
    pub name: String,
    /// The file it came from.
    pub file: Option<PathBuf>,
    /// Number of Gaussians.
    pub gaussians: usize,
    /// Scene-wide index of the first.
    pub first: usize,
    /// Box of its finite centres in the local frame.
    pub bounds: SceneBox,
    /// Palette colour, RGB 0 to 1.
    pub palette: [f32; 3],
    /// Factor on every opacity.
    pub opacity: f32,
    /// Local frame to scene frame, 16 numbers, row major.
    pub transform: [f64; 16],
    /// Convention of the file's shading columns.
    pub convention: Convention,
    /// Shading model.
    pub shading: ShadingModel,
    /// Whether normals point consistently to one side.
    pub oriented_normals: bool,
    /// The transfer function behind it.
    pub transfer_function: Option<PathBuf>,
    /// Names of the attributes that are present.
    pub attributes: Vec<&'static str>,
    /// Degree of the spherical harmonics, if there are any.
    pub harmonics_degree: Option<u8>,
    /// Columns that are kept but not interpreted.
    pub extra: Vec<ExtraSummary>,
    /// Non-finite values.
    pub not_finite: NonFiniteCounts,
    /// Bytes of the columns in memory.
    pub bytes: usize,
}

/// A column that is kept but not interpreted.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ExtraSummary {
    /// Property name.
    pub name: String,
    /// PLY type.
    #[serde(rename = "type")]
    pub scalar: &'static str,
}

impl Summary {
    /// Of a scene.
    #[must_use]
    pub fn of(scene: &Scene) -> Self {
        Self {
            gaussians: scene.len(),
            bounds: scene.bounds,
            content_hash: scene.content_hash().to_hex().to_string(),
            units: scene.units.iter().map(UnitSummary::of).collect(),
        }
    }
}

impl UnitSummary {
    fn of(unit: &BaseUnit) -> Self {
        let g = &unit.gaussians;
        let mut attributes = vec!["position", "rotation", "scale", "opacity"];
        let mut floats = 11;
        if g.shading.is_some() {
            attributes.extend(["offset_color", "normal", "ambient", "diffuse", "specular", "shininess"]);
            floats += 10;
        }
        if let Some(h) = &g.harmonics {
            attributes.push("harmonics");
            floats += 3 * (1 + h.rest_per_gaussian());
        }
        let extra = |column: &ExtraColumn| {
            let (scalar, size) = match column.values {
                ExtraValues::I8(_) => ("char", 1),
                ExtraValues::U8(_) => ("uchar", 1),
                ExtraValues::I16(_) => ("short", 2),
                ExtraValues::U16(_) => ("ushort", 2),
                ExtraValues::I32(_) => ("int", 4),
                ExtraValues::U32(_) => ("uint", 4),
                ExtraValues::F32(_) => ("float", 4),
                ExtraValues::F64(_) => ("double", 8),
            };
            (ExtraSummary { name: column.name.clone(), scalar }, size * column.values.len())
        };
        let (extra, extra_bytes): (Vec<_>, Vec<usize>) = g.extra.iter().map(extra).unzip();
        Self {
            name: unit.name.clone(),
            file: unit.file.clone(),
            gaussians: g.len(),
            first: unit.first,
            bounds: SceneBox::of_points(g.position.iter().copied()),
            palette: unit.palette.to_array(),
            opacity: unit.opacity,
            transform: row_major(&unit.transform),
            convention: unit.convention,
            shading: unit.shading,
            oriented_normals: unit.oriented_normals,
            transfer_function: unit.transfer_function.clone(),
            attributes,
            harmonics_degree: g.harmonics.as_ref().map(|h| h.degree),
            extra,
            not_finite: NonFiniteCounts::of(g),
            bytes: 4 * floats * g.len() + extra_bytes.iter().sum::<usize>(),
        }
    }
}
