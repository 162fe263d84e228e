//! The comments of our PLY about its unit, as lines of TOML: `comment convention = "ours"`.
//!
//! A unit's file within a `scene.toml` has only the comments that its columns need. A file that stands alone has all of
//! the unit. Every PLY that stands alone has the directions of its scene.

use glam::{DMat4, Vec3};
use serde::Deserialize;

use crate::splat::problem::{Warning, WarningCode};
use crate::splat::toml_number::{exact_f32, row_major, transform};
use sg_scene::model::{BaseUnit, Convention, Scene, SceneBox, ShadingModel};
use sg_scene::orientation::{Axis, LengthUnit, Orientation, PatientFrame};

/// The comments that were found.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct UnitComments {
    pub(crate) name: Option<String>,
    pub(crate) convention: Option<Convention>,
    pub(crate) oriented_normals: Option<bool>,
    pub(crate) palette: Option<Vec3>,
    pub(crate) opacity: Option<f32>,
    pub(crate) shading: Option<ShadingModel>,
    pub(crate) transform: Option<DMat4>,
    pub(crate) bounds: Option<SceneBox>,
    pub(crate) orientation: Option<Orientation>,
}

/// One line of TOML, each key on its own line.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Line {
    name: Option<String>,
    convention: Option<Convention>,
    oriented_normals: Option<bool>,
    palette: Option<[f32; 3]>,
    opacity: Option<f32>,
    shading: Option<ShadingModel>,
    transform: Option<[f64; 16]>,
    #[serde(rename = "box")]
    bounds: Option<SceneBox>,
    orientation: Option<OrientationNames>,
}

/// Names of directions and of the length unit, as in `scene.toml`.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct OrientationNames {
    patient: Option<String>,
    unit: Option<String>,
    up: Option<String>,
}

impl OrientationNames {
    /// `None` for an unknown name.
    fn orientation(&self) -> Option<Orientation> {
        fn value<T>(name: Option<&str>, of_name: fn(&str) -> Option<T>) -> Option<Option<T>> {
            name.map_or(Some(None), |name| of_name(name).map(Some))
        }
        Some(Orientation {
            patient: value(self.patient.as_deref(), PatientFrame::of_name)?,
            unit: value(self.unit.as_deref(), LengthUnit::of_name)?,
            up: value(self.up.as_deref(), Axis::of_name)?,
        })
    }
}

const KEYS: [&str; 9] =
    ["name", "convention", "oriented_normals", "palette", "opacity", "shading", "transform", "box", "orientation"];

impl UnitComments {
    /// Parses our comments and ignores all others. An unreadable comment of ours gives a warning.
    pub(crate) fn parse(comments: &[String], warnings: &mut Vec<Warning>) -> Self {
        let mut out = Self::default();
        for comment in comments {
            let is_ours = comment.split_once('=').is_some_and(|(key, _)| KEYS.contains(&key.trim()));
            if !is_ours {
                continue;
            }
            if !toml::from_str::<Line>(comment).is_ok_and(|line| out.take(line)) {
                let message = format!("the comment `{}` cannot be read and is ignored", sg_input::printable(comment));
                warnings.push(Warning::new(WarningCode::Ignored, message));
            }
        }
        out
    }

    /// Whether the values make sense.
    fn take(&mut self, line: Line) -> bool {
        fn put<T>(to: &mut Option<T>, from: Option<T>) {
            if from.is_some() {
                *to = from;
            }
        }
        let palette = line.palette.map(Vec3::from_array);
        let matrix = line.transform.map(|rows| transform(&rows));
        let bounds_fine =
            line.bounds.is_none_or(|b| b.min.is_finite() && b.max.is_finite() && b.min.cmple(b.max).all());
        if palette.is_some_and(|p| !p.is_finite()) || line.opacity.is_some_and(|o| !(o >= 0.0 && o.is_finite())) {
            return false;
        }
        let orientation = line.orientation.map(|names| names.orientation());
        if matrix == Some(None) || orientation == Some(None) || !bounds_fine {
            return false;
        }
        put(&mut self.name, line.name);
        put(&mut self.convention, line.convention);
        put(&mut self.oriented_normals, line.oriented_normals);
        put(&mut self.palette, palette);
        put(&mut self.opacity, line.opacity);
        put(&mut self.shading, line.shading);
        put(&mut self.transform, matrix.flatten());
        put(&mut self.bounds, line.bounds);
        put(&mut self.orientation, orientation.flatten());
        true
    }

    /// The comments of a unit's file within a `scene.toml`.
    pub(crate) fn of_columns(unit: &BaseUnit, convention: Convention) -> Vec<String> {
        vec![
            format!("convention = \"{}\"", convention_name(convention)),
            format!("oriented_normals = {}", unit.oriented_normals),
        ]
    }

    /// The comments of a file that stands alone, in this scene.
    pub(crate) fn of_unit(unit: &BaseUnit, convention: Convention, scene: &Scene) -> Vec<String> {
        let mut out = Self::of_columns(unit, convention);
        out.push(format!("name = {}", toml::Value::String(unit.name.clone())));
        out.push(format!("palette = {}", list(unit.palette.to_array().map(exact_f32))));
        out.push(format!("opacity = {}", toml::Value::Float(exact_f32(unit.opacity))));
        out.push(format!("shading = \"{}\"", shading_name(unit.shading)));
        if unit.transform != DMat4::IDENTITY {
            out.push(format!("transform = {}", list(row_major(&unit.transform))));
        }
        let (min, max) = (list(scene.bounds.min.to_array()), list(scene.bounds.max.to_array()));
        out.push(format!("box = {{ min = {min}, max = {max} }}"));
        out.extend(orientation_line(scene.orientation));
        out.retain(|line| !line.contains(['\n', '\r']));
        out
    }
}

/// The comment of an unlit file about its scene, unless it is [`Orientation::OF_TRAINED`]. The direction that is up always stands in it if the
/// Gaussians come from a volume, since readers take unlit ones for trained splats otherwise.
pub(crate) fn orientation_of_unlit(scene: &Scene) -> Option<String> {
    let up = scene.orientation.up.or(scene.has_shading().then_some(scene.orientation.up()));
    let orientation = Orientation { up, ..scene.orientation };
    (orientation != Orientation::OF_TRAINED).then(|| orientation_line(orientation)).flatten()
}

fn orientation_line(orientation: Orientation) -> Option<String> {
    let known: Vec<String> = orientation.names().map(|(key, name)| format!("{key} = \"{name}\"")).collect();
    (!known.is_empty()).then(|| format!("orientation = {{ {} }}", known.join(", ")))
}

fn list<const N: usize>(numbers: [f64; N]) -> toml::Value {
    toml::Value::Array(numbers.into_iter().map(toml::Value::Float).collect())
}

/// The name of a convention in files.
pub(crate) fn convention_name(convention: Convention) -> &'static str {
    match convention {
        Convention::Ours => "ours",
        Convention::Legacy => "legacy",
        Convention::HeadRaw => "head-raw",
        Convention::HeadActivated => "head-activated",
    }
}

/// The name of a shading model in files.
pub(crate) fn shading_name(shading: ShadingModel) -> &'static str {
    match shading {
        ShadingModel::Paper => "paper",
        ShadingModel::IvrgsTrain => "ivrgs-train",
        ShadingModel::IvrgsViewer => "ivrgs-viewer",
    }
}
