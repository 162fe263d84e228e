//! Fields of the contract that a model may fill, with their bounds.

use prost_reflect::{FieldDescriptor, Kind};
use sg_proto::limits::{MAX_NAME_BYTES, MAX_UTTERANCE_BYTES};

use crate::commands::command::Field;

/// Fields of every clause.
pub(super) const ACT: Field = Field::required("act");

pub(super) const WORDS: Field = Field::required("words");

/// Bound of a field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Bound {
    /// Smallest and largest number.
    Number(f64, f64),
    /// Largest number of characters, of each item in a list.
    MaxChars(usize),
}

/// Largest number of clauses in an answer.
pub(super) const MAX_CLAUSES: usize = 16;

/// Largest number of items in another list.
pub(super) const MAX_ITEMS: usize = 16;

/// Largest number of characters of a file's path.
const MAX_FILE_CHARS: usize = 1024;

/// Bounds by full name without `supergaussian.`. They follow the documentation of the contract, or prevent a useless
/// picture. Numbers and texts without a bound are not part of the schema.
pub(super) const BOUNDS: &[(&str, Bound)] = &[
    ("language.v1.Intent.not_understood", Bound::MaxChars(MAX_UTTERANCE_BYTES)),
    ("language.v1.Clause.words", Bound::MaxChars(MAX_UTTERANCE_BYTES)),
    ("language.v1.Clause.color_name", Bound::MaxChars(40)),
    ("language.v1.Clause.name", Bound::MaxChars(MAX_NAME_BYTES)),
    ("language.v1.Clause.file", Bound::MaxChars(MAX_FILE_CHARS)),
    ("language.v1.Clause.amount", Bound::Number(0.0, 1000.0)),
    ("language.v1.Reference.names", Bound::MaxChars(MAX_NAME_BYTES)),
    ("scene.v1.Color.red", Bound::Number(0.0, 1.0)),
    ("scene.v1.Color.green", Bound::Number(0.0, 1.0)),
    ("scene.v1.Color.blue", Bound::Number(0.0, 1.0)),
    ("scene.v1.Vector.x", Bound::Number(-1e6, 1e6)),
    ("scene.v1.Vector.y", Bound::Number(-1e6, 1e6)),
    ("scene.v1.Vector.z", Bound::Number(-1e6, 1e6)),
    ("scene.v1.SetLight.ambient", Bound::Number(0.0, 100.0)),
    ("scene.v1.SetLight.diffuse", Bound::Number(0.0, 100.0)),
    ("scene.v1.SetLight.specular", Bound::Number(0.0, 100.0)),
    ("scene.v1.SetLight.shininess", Bound::Number(0.0, 1000.0)),
    ("scene.v1.Orbit.azimuth_degrees", Bound::Number(-3600.0, 3600.0)),
    ("scene.v1.Orbit.elevation_degrees", Bound::Number(-3600.0, 3600.0)),
    ("scene.v1.SetView.zoom", Bound::Number(0.01, 100.0)),
    ("scene.v1.SetView.kept", Bound::MaxChars(MAX_NAME_BYTES)),
    ("scene.v1.SetTone.saturation", Bound::Number(0.0, 4.0)),
    ("scene.v1.SetTone.brightness", Bound::Number(0.0, 4.0)),
    ("scene.v1.SetTone.temperature", Bound::Number(-1.0, 1.0)),
    ("scene.v1.ValueWindow.level", Bound::Number(-1e9, 1e9)),
    ("scene.v1.ValueWindow.window", Bound::Number(0.0, 1e9)),
    ("scene.v1.ValueWindow.level_change", Bound::Number(-1e9, 1e9)),
    ("scene.v1.ValueWindow.window_factor", Bound::Number(0.01, 100.0)),
    ("scene.v1.ValueRange.low", Bound::Number(-1e9, 1e9)),
    ("scene.v1.ValueRange.high", Bound::Number(-1e9, 1e9)),
    ("language.v1.Shift.distance", Bound::Number(0.0, 1e6)),
    ("language.v1.Rotation.degrees", Bound::Number(-3600.0, 3600.0)),
    ("language.v1.Scale.factor", Bound::Number(0.001, 1000.0)),
];

/// Fields that are not part of the schema: exact viewpoints, the target of a view, which is in the clause, and steps of a window that
/// other fields can say.
pub(super) const EXCLUDED: &[&str] = &[
    "language.v1.Intent.suggestions",
    "language.v1.Intent.backend",
    "language.v1.Intent.model",
    "language.v1.Intent.fallback",
    "language.v1.Intent.read_as",
    "language.v1.Intent.answer",
    "scene.v1.SetView.view",
    "scene.v1.SetView.up",
    "scene.v1.SetTone.target",
    "scene.v1.ValueWindow.level_shift",
    "scene.v1.ValueWindow.window_change",
    "scene.v1.Target.units",
    "scene.v1.Target.selection",
    "scene.v1.Target.everything",
    "scene.v1.Target.complement",
];

pub(super) fn short_name(name: &str) -> &str {
    name.strip_prefix("supergaussian.").unwrap_or(name)
}

pub(super) fn is_excluded(field: &FieldDescriptor) -> bool {
    EXCLUDED.contains(&short_name(field.full_name()))
}

pub(super) fn bound(field: &FieldDescriptor) -> Option<Bound> {
    BOUNDS.iter().find(|(name, _)| *name == short_name(field.full_name())).map(|(_, bound)| *bound)
}

/// Whether a field of a message within a clause may be null. The contract must tell null from the default.
pub(super) fn may_be_absent(field: &FieldDescriptor) -> bool {
    field.supports_presence() || (matches!(field.kind(), Kind::Enum(_)) && !field.is_list())
}
