//! Fields of the contract that a model may fill, with their bounds.

use prost_reflect::{FieldDescriptor, Kind};
use sg_proto::limits::{MAX_NAME_BYTES, MAX_UTTERANCE_BYTES};

use crate::commands::command::Field;

/// Fields of every clause.
pub(super) const ACT: Field = Field::required("act");

pub(super) const WORDS: Field = Field::required("words");

/// How far a field goes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Bound {
    /// A number from, to.
    Number(f64, f64),
    /// Letters of a text, of each one in a list.
    Letters(usize),
}

/// Most clauses of one answer.
pub(super) const MAX_CLAUSES: usize = 16;

/// Most entries of any other list.
pub(super) const MAX_ITEMS: usize = 16;

/// Fields by full name without `supergaussian.` and their bounds: those that the contract documents, or that keep a
/// slip of a model from wiping a picture out. A number or text without a line here does not go into the form.
pub(super) const BOUNDS: &[(&str, Bound)] = &[
    ("language.v1.Intent.not_understood", Bound::Letters(MAX_UTTERANCE_BYTES)),
    ("language.v1.Clause.words", Bound::Letters(MAX_UTTERANCE_BYTES)),
    ("language.v1.Clause.color_name", Bound::Letters(40)),
    ("language.v1.Clause.name", Bound::Letters(MAX_NAME_BYTES)),
    ("language.v1.Clause.amount", Bound::Number(0.0, 1000.0)),
    ("language.v1.Reference.names", Bound::Letters(MAX_NAME_BYTES)),
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
];

/// What no utterance says in this form: an exact viewpoint, and the target of a view, which stands in the clause.
pub(super) const LEFT_OUT: &[&str] = &[
    "language.v1.Intent.suggestions",
    "language.v1.Intent.backend",
    "language.v1.Intent.model",
    "language.v1.Intent.fallback",
    "scene.v1.SetView.view",
    "scene.v1.Target.units",
    "scene.v1.Target.selection",
    "scene.v1.Target.everything",
    "scene.v1.Target.complement",
];

pub(super) fn short(name: &str) -> &str {
    name.strip_prefix("supergaussian.").unwrap_or(name)
}

pub(super) fn is_left_out(field: &FieldDescriptor) -> bool {
    LEFT_OUT.contains(&short(field.full_name()))
}

pub(super) fn bound(field: &FieldDescriptor) -> Option<Bound> {
    BOUNDS.iter().find(|(name, _)| *name == short(field.full_name())).map(|(_, bound)| *bound)
}

/// Whether a field of a message within a clause may be null: what the contract can tell from its default, and an enum,
/// whose default says that nothing was said.
pub(super) fn may_be_absent(field: &FieldDescriptor) -> bool {
    field.supports_presence() || (matches!(field.kind(), Kind::Enum(_)) && !field.is_list())
}
