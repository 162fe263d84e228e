//! Between the messages of the contract and the types of this library. Pure conversions; ranges are checked by edits.

mod duplicate_message;
mod placement_message;
mod tone_message;
mod transfer_function_message;
mod unit_message;

use std::sync::Arc;

use glam::{DVec3, Vec3};
use sg_proto::scene as proto;
use sg_proto::scene::selection_step::Step;

use self::duplicate_message::{check_duplicates, decode_duplicates, encode_duplicates};
use self::placement_message::{decode_placements, encode_placements};
pub(crate) use self::transfer_function_message::decode_scale;
pub use self::transfer_function_message::{decode_transfer_function, encode_transfer_function};
use self::transfer_function_message::{decode_volume, encode_volume};
use self::unit_message::{decode_base, decode_unit, encode_base, encode_unit};
use super::change::Change;
use super::state::{EditState, Geometry, KeptView, Selection};
use sg_scene::appearance::ShadingTerm;
use sg_scene::camera::{Light, LightMode};
use sg_scene::mask::Mask;
use sg_scene::model::SceneBox;
use sg_scene::orientation::{Axis, Side};
use sg_scene::view::View;

/// A message that holds no value of the type it stands for.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum WireError {
    /// A field that must be set is not.
    #[error("`{0}` is missing")]
    Missing(&'static str),
    /// The value of an enumeration is not known or not set.
    #[error("`{field}` has the unknown value {value}")]
    Kind {
        /// The field.
        field: &'static str,
        /// The finding.
        value: i32,
    },
    /// A mask's length is not the scene's.
    #[error("`{field}` has {found} Gaussians; the scene has {expected}")]
    Length {
        /// The field.
        field: &'static str,
        /// Its length.
        found: u64,
        /// Number of Gaussians.
        expected: usize,
    },
    /// A mask's bytes do not fit its length.
    #[error("`{field}`: {source}")]
    Bits {
        /// The field.
        field: &'static str,
        /// The mismatch.
        source: sg_scene::mask::MaskBytesError,
    },
    /// A map of Gaussians that is none.
    #[error(
        "`{0}` is no similarity: it has a rotation of four numbers and unit length, a finite scale above 0 and a finite translation"
    )]
    Similarity(&'static str),
    /// A tone out of its range.
    #[error("`{0}` is no tone: saturation and brightness are 0 to 4, the temperature is -1 to 1")]
    Tone(&'static str),
    /// Copies that do not follow the Gaussians before them, or that the base units do not have.
    #[error("`{0}`: copies form the last base units, each of Gaussians of one base unit before it")]
    Duplicates(&'static str),
    /// A transfer function that is none.
    #[error("`{field}`: {reason}")]
    TransferFunction {
        /// The field.
        field: &'static str,
        /// The cause and the remedy.
        reason: String,
    },
    /// A number of Gaussians that no machine can hold.
    #[error("`{field}` is {value}; this machine cannot count that far")]
    Count {
        /// The field.
        field: &'static str,
        /// The finding.
        value: u64,
    },
}

impl WireError {
    /// The field that is wrong.
    #[must_use]
    pub fn field(&self) -> &'static str {
        match self {
            Self::Missing(field)
            | Self::Similarity(field)
            | Self::Tone(field)
            | Self::Duplicates(field)
            | Self::Kind { field, .. }
            | Self::Length { field, .. }
            | Self::Bits { field, .. }
            | Self::TransferFunction { field, .. }
            | Self::Count { field, .. } => field,
        }
    }
}

/// A colour as a message.
#[must_use]
pub fn encode_color(c: Vec3) -> proto::Color {
    proto::Color { red: c.x, green: c.y, blue: c.z }
}

/// A colour from a message.
#[must_use]
pub fn decode_color(c: &proto::Color) -> Vec3 {
    Vec3::new(c.red, c.green, c.blue)
}

/// A point or direction as a message.
#[must_use]
pub fn encode_vector(v: DVec3) -> proto::Vector {
    proto::Vector { x: v.x, y: v.y, z: v.z }
}

/// A point or direction from a message.
#[must_use]
pub fn decode_vector(v: &proto::Vector) -> DVec3 {
    DVec3::new(v.x, v.y, v.z)
}

/// A mask as a message.
#[must_use]
pub fn encode_mask(mask: &Mask) -> proto::Mask {
    proto::Mask { length: mask.len() as u64, bits: mask.to_bytes() }
}

/// A mask over `expected` Gaussians from a message; `field` names it in errors.
///
/// # Errors
/// [`WireError::Length`], [`WireError::Bits`].
pub fn decode_mask(mask: &proto::Mask, expected: usize, field: &'static str) -> Result<Mask, WireError> {
    if mask.length != expected as u64 {
        return Err(WireError::Length { field, found: mask.length, expected });
    }
    Mask::from_bytes(expected, &mask.bits).map_err(|source| WireError::Bits { field, source })
}

/// A light as a message.
#[must_use]
pub fn encode_light(light: &Light) -> proto::Light {
    let mode = match light.mode {
        LightMode::Headlight => proto::LightMode::Headlight,
        LightMode::Direction => proto::LightMode::Direction,
    };
    proto::Light {
        mode: mode.into(),
        direction: Some(encode_vector(DVec3::from_array(light.direction.map(f64::from)))),
        ambient: light.ka,
        diffuse: light.kd,
        specular: light.ks,
        shininess: light.shininess,
    }
}

/// A light from a message.
///
/// # Errors
/// [`WireError`].
pub fn decode_light(light: &proto::Light) -> Result<Light, WireError> {
    let mode = decode_light_mode(light.mode)?.ok_or(WireError::Missing("light.mode"))?;
    let direction = decode_vector(light.direction.as_ref().ok_or(WireError::Missing("light.direction"))?);
    Ok(Light {
        mode,
        direction: direction.as_vec3().to_array(),
        ka: light.ambient,
        kd: light.diffuse,
        ks: light.specular,
        shininess: light.shininess,
    })
}

/// The light mode; `None` if the message keeps it.
///
/// # Errors
/// [`WireError::Kind`].
pub fn decode_light_mode(value: i32) -> Result<Option<LightMode>, WireError> {
    match proto::LightMode::try_from(value) {
        Ok(proto::LightMode::Unspecified) => Ok(None),
        Ok(proto::LightMode::Headlight) => Ok(Some(LightMode::Headlight)),
        Ok(proto::LightMode::Direction) => Ok(Some(LightMode::Direction)),
        Err(_) => Err(WireError::Kind { field: "light.mode", value }),
    }
}

/// A part of the shading as a message holds it.
#[must_use]
pub fn encode_term(term: ShadingTerm) -> proto::ShadingTerm {
    match term {
        ShadingTerm::Full => proto::ShadingTerm::Full,
        ShadingTerm::Normal => proto::ShadingTerm::Normal,
        ShadingTerm::Ambient => proto::ShadingTerm::Ambient,
        ShadingTerm::Diffuse => proto::ShadingTerm::Diffuse,
        ShadingTerm::Specular => proto::ShadingTerm::Specular,
    }
}

/// A part of the shading from a message.
///
/// # Errors
/// [`WireError::Kind`].
pub fn decode_term(value: i32) -> Result<ShadingTerm, WireError> {
    match proto::ShadingTerm::try_from(value) {
        Ok(proto::ShadingTerm::Full) => Ok(ShadingTerm::Full),
        Ok(proto::ShadingTerm::Normal) => Ok(ShadingTerm::Normal),
        Ok(proto::ShadingTerm::Ambient) => Ok(ShadingTerm::Ambient),
        Ok(proto::ShadingTerm::Diffuse) => Ok(ShadingTerm::Diffuse),
        Ok(proto::ShadingTerm::Specular) => Ok(ShadingTerm::Specular),
        Ok(proto::ShadingTerm::Unspecified) | Err(_) => Err(WireError::Kind { field: "term", value }),
    }
}

/// The direction that is up as a message holds it; `None` is the file's own.
#[must_use]
pub fn encode_axis(axis: Option<Axis>) -> proto::Axis {
    match axis {
        None => proto::Axis::Unspecified,
        Some(Axis::PlusX) => proto::Axis::PlusX,
        Some(Axis::MinusX) => proto::Axis::MinusX,
        Some(Axis::PlusY) => proto::Axis::PlusY,
        Some(Axis::MinusY) => proto::Axis::MinusY,
        Some(Axis::PlusZ) => proto::Axis::PlusZ,
        Some(Axis::MinusZ) => proto::Axis::MinusZ,
    }
}

/// The direction that is up from a message; `None` is the file's own.
///
/// # Errors
/// [`WireError::Kind`].
pub fn decode_axis(value: i32) -> Result<Option<Axis>, WireError> {
    match proto::Axis::try_from(value) {
        Ok(proto::Axis::Unspecified) => Ok(None),
        Ok(proto::Axis::PlusX) => Ok(Some(Axis::PlusX)),
        Ok(proto::Axis::MinusX) => Ok(Some(Axis::MinusX)),
        Ok(proto::Axis::PlusY) => Ok(Some(Axis::PlusY)),
        Ok(proto::Axis::MinusY) => Ok(Some(Axis::MinusY)),
        Ok(proto::Axis::PlusZ) => Ok(Some(Axis::PlusZ)),
        Ok(proto::Axis::MinusZ) => Ok(Some(Axis::MinusZ)),
        Err(_) => Err(WireError::Kind { field: "up", value }),
    }
}

/// A viewpoint as a message.
#[must_use]
pub fn encode_view(view: &View) -> proto::View {
    proto::View {
        eye: Some(encode_vector(view.eye)),
        target: Some(encode_vector(view.target)),
        up: Some(encode_vector(view.up)),
        fov_y_degrees: view.fov_y_degrees,
    }
}

/// A viewpoint from a message.
///
/// # Errors
/// [`WireError::Missing`].
pub fn decode_view(view: &proto::View) -> Result<View, WireError> {
    let part =
        |vector: &Option<proto::Vector>, field| vector.as_ref().map(decode_vector).ok_or(WireError::Missing(field));
    Ok(View {
        eye: part(&view.eye, "view.eye")?,
        target: part(&view.target, "view.target")?,
        up: part(&view.up, "view.up")?,
        fov_y_degrees: view.fov_y_degrees,
    })
}

fn encode_kept_views(views: &[KeptView]) -> Vec<proto::KeptView> {
    let encode = |kept: &KeptView| proto::KeptView { name: kept.name.clone(), view: Some(encode_view(&kept.view)) };
    views.iter().map(encode).collect()
}

fn decode_kept_views(views: &[proto::KeptView]) -> Result<Arc<[KeptView]>, WireError> {
    let decode = |kept: &proto::KeptView| {
        let view = decode_view(kept.view.as_ref().ok_or(WireError::Missing("kept_view.view"))?)?;
        Ok(KeptView { name: kept.name.clone(), view })
    };
    views.iter().map(decode).collect()
}

/// A side of the scene's box from a message; `None` for the first view.
///
/// # Errors
/// [`WireError::Kind`].
pub fn decode_side(value: i32) -> Result<Option<Side>, WireError> {
    match proto::NamedView::try_from(value) {
        Ok(proto::NamedView::Front) => Ok(Some(Side::Front)),
        Ok(proto::NamedView::Back) => Ok(Some(Side::Back)),
        Ok(proto::NamedView::Left) => Ok(Some(Side::Left)),
        Ok(proto::NamedView::Right) => Ok(Some(Side::Right)),
        Ok(proto::NamedView::Top) => Ok(Some(Side::Top)),
        Ok(proto::NamedView::Bottom) => Ok(Some(Side::Bottom)),
        Ok(proto::NamedView::Initial) => Ok(None),
        Ok(proto::NamedView::Unspecified) | Err(_) => Err(WireError::Kind { field: "view.named", value }),
    }
}

/// A mask over as many Gaussians as it says, from a message. Its reader compares its length with the scene.
fn decode_any_mask(mask: &proto::Mask, field: &'static str) -> Result<Mask, WireError> {
    decode_mask(mask, count(mask.length, field)?, field)
}

/// A mask that is absent where it would be empty.
fn decode_optional(mask: Option<&proto::Mask>, field: &'static str) -> Result<Option<Arc<Mask>>, WireError> {
    mask.map(|mask| decode_any_mask(mask, field).map(Arc::new)).transpose()
}

/// Refuses a mask of another length.
fn check_length(mask: &Mask, expected: usize, field: &'static str) -> Result<(), WireError> {
    let found = mask.len() as u64;
    if found == expected as u64 { Ok(()) } else { Err(WireError::Length { field, found, expected }) }
}

fn encode_selection(selection: &Selection, with_mask: bool) -> proto::Selection {
    proto::Selection {
        mask: with_mask.then(|| encode_mask(selection.mask())),
        count: selection.mask().count() as u64,
        hash: selection.hash().to_owned(),
        strokes: if with_mask { strokes_alone(selection.steps()).unwrap_or_default() } else { Vec::new() },
        steps: if with_mask && strokes_alone(selection.steps()).is_none() {
            selection.steps().to_vec()
        } else {
            Vec::new()
        },
    }
}

fn decode_selection(selection: &proto::Selection) -> Result<Selection, WireError> {
    let mask = selection.mask.as_ref().ok_or(WireError::Missing("selection.mask"))?;
    let mask = decode_any_mask(mask, "selection.mask")?;
    Ok(Selection::new(Arc::new(mask), steps_of(&selection.strokes, &selection.steps).into()))
}

/// The steps of a message, or its strokes if it has no steps, as old readers send them.
#[must_use]
pub fn steps_of(strokes: &[proto::Stroke], steps: &[proto::SelectionStep]) -> Vec<proto::SelectionStep> {
    let stroke = |s: &proto::Stroke| proto::SelectionStep { step: Some(Step::Stroke(s.clone())) };
    if steps.is_empty() { strokes.iter().map(stroke).collect() } else { steps.to_vec() }
}

/// The strokes of steps that are strokes alone.
#[must_use]
pub fn strokes_alone(steps: &[proto::SelectionStep]) -> Option<Vec<proto::Stroke>> {
    let stroke = |step: &proto::SelectionStep| match &step.step {
        Some(Step::Stroke(stroke)) => Some(stroke.clone()),
        _ => None,
    };
    steps.iter().map(stroke).collect()
}

/// A change as a message, with masks.
#[must_use]
pub fn encode_change(change: &Change) -> proto::Change {
    use proto::change::Item;
    let item = match change {
        Change::Base(base) => Item::BaseUnit(encode_base(base)),
        Change::Unit(unit) => Item::Unit(encode_unit(unit, true)),
        Change::Deleted(id) => Item::DeletedUnit(*id),
        Change::Selection(selection) => Item::Selection(encode_selection(selection, true)),
        Change::DeletedGaussians(mask) => Item::DeletedGaussians(encode_mask(mask)),
        Change::Duplicates(parts) => Item::Duplicates(encode_duplicates(parts)),
        Change::Placements(parts) => Item::Placements(encode_placements(parts)),
        Change::Light(light) => Item::Light(encode_light(light)),
        Change::Background(color) => Item::Background(encode_color(*color)),
        Change::View(view) => Item::View(encode_view(view)),
        Change::KeptViews(views) => Item::KeptViews(proto::KeptViews { views: encode_kept_views(views) }),
        Change::Up(up) => Item::Up(encode_axis(*up).into()),
        Change::TransferFunction(function) => {
            let function = function.as_deref().map(encode_transfer_function);
            Item::TransferFunction(proto::ShownTransferFunction { function })
        }
        Change::Term(term) => Item::Term(encode_term(*term).into()),
        Change::Focus(units) => Item::Focus(proto::Focus { units: units.clone() }),
    };
    proto::Change { item: Some(item) }
}

/// A change from a message. [`EditState`] compares the lengths of its masks with the scene when it applies the change.
///
/// # Errors
/// [`WireError`].
pub fn decode_change(change: &proto::Change) -> Result<Change, WireError> {
    use proto::change::Item;
    Ok(match change.item.as_ref().ok_or(WireError::Missing("change.item"))? {
        Item::BaseUnit(base) => Change::Base(decode_base(base)?),
        Item::Unit(unit) => Change::Unit(decode_unit(unit)?),
        Item::DeletedUnit(id) => Change::Deleted(*id),
        Item::Selection(selection) => Change::Selection(decode_selection(selection)?),
        Item::DeletedGaussians(mask) => {
            Change::DeletedGaussians(Arc::new(decode_any_mask(mask, "change.deleted_gaussians")?))
        }
        Item::Duplicates(parts) => Change::Duplicates(decode_duplicates(parts)?),
        Item::Placements(parts) => Change::Placements(decode_placements(parts)?),
        Item::Light(light) => Change::Light(decode_light(light)?),
        Item::Background(color) => Change::Background(decode_color(color)),
        Item::View(view) => Change::View(decode_view(view)?),
        Item::KeptViews(kept) => Change::KeptViews(decode_kept_views(&kept.views)?),
        Item::Up(axis) => Change::Up(decode_axis(*axis)?),
        Item::TransferFunction(shown) => {
            Change::TransferFunction(shown.function.as_ref().map(decode_transfer_function).transpose()?)
        }
        Item::Term(term) => Change::Term(decode_term(*term)?),
        Item::Focus(focus) => Change::Focus(focus.units.clone()),
    })
}

impl EditState {
    /// The state as a message: with masks and strokes as a snapshot, without them as an outline. Labels of undo and
    /// redo are left out; only the owner has them.
    #[must_use]
    pub fn state(&self, with_masks: bool) -> proto::State {
        let bounds = self.geometry.bounds;
        proto::State {
            revision: self.revision,
            scene_path: self.geometry.path.clone(),
            scene_hash: self.geometry.hash.clone(),
            count: self.count() as u64,
            r#box: Some(proto::Box { min: Some(encode_vector(bounds.min)), max: Some(encode_vector(bounds.max)) }),
            base_units: self.base.iter().map(encode_base).collect(),
            units: self.units.values().map(|u| encode_unit(u, with_masks)).collect(),
            selection: Some(encode_selection(&self.selection, with_masks)),
            light: Some(encode_light(&self.light)),
            background: Some(encode_color(self.background)),
            view: Some(encode_view(&self.view)),
            kept_views: encode_kept_views(&self.kept_views),
            term: encode_term(self.term).into(),
            up: encode_axis(self.up).into(),
            focus: self.focus.clone(),
            undo: Vec::new(),
            redo: Vec::new(),
            deleted: (with_masks && !self.deleted.is_none()).then(|| encode_mask(&self.deleted)),
            placements: (with_masks && !self.placements.is_empty()).then(|| encode_placements(&self.placements)),
            duplicates: (with_masks && !self.duplicates.is_empty()).then(|| encode_duplicates(&self.duplicates)),
            transfer_function: self.transfer_function.as_deref().map(encode_transfer_function),
            volume: self.geometry.volume.as_ref().map(encode_volume),
            // Only the owner has it.
            project_path: String::new(),
        }
    }

    /// The state from a snapshot.
    ///
    /// # Errors
    /// [`WireError`] if a field is missing (an outline has no masks) or does not fit the number of Gaussians.
    pub fn from_snapshot(state: &proto::State) -> Result<Self, WireError> {
        let expected = count(state.count, "state.count")?;
        let bounds = state.r#box.as_ref().ok_or(WireError::Missing("state.box"))?;
        let corner =
            |vector: &Option<proto::Vector>| vector.as_ref().map(decode_vector).ok_or(WireError::Missing("state.box"));
        let duplicates = decode_duplicates(&state.duplicates.clone().unwrap_or_default())?;
        let base: Vec<_> = state.base_units.iter().map(decode_base).collect::<Result<_, _>>()?;
        check_duplicates(&duplicates, &base, expected)?;
        let geometry = Geometry {
            path: state.scene_path.clone(),
            hash: state.scene_hash.clone(),
            count: duplicates.first().map_or(expected, |first| first.originals().len()),
            bounds: SceneBox { min: corner(&bounds.min)?, max: corner(&bounds.max)? },
            volume: state.volume.as_ref().map(decode_volume).transpose()?,
        };
        let units = state.units.iter().map(|u| Ok((u.id, decode_unit(u)?)));
        let selection = state.selection.as_ref().ok_or(WireError::Missing("state.selection"))?;
        let decoded = Self {
            revision: state.revision,
            geometry: Arc::new(geometry),
            base,
            units: units.collect::<Result<_, _>>()?,
            selection: decode_selection(selection)?,
            deleted: decode_optional(state.deleted.as_ref(), "state.deleted")?
                .unwrap_or_else(|| Arc::new(Mask::empty(expected))),
            duplicates,
            placements: decode_placements(&state.placements.clone().unwrap_or_default())?,
            transfer_function: state.transfer_function.as_ref().map(decode_transfer_function).transpose()?,
            light: decode_light(state.light.as_ref().ok_or(WireError::Missing("state.light"))?)?,
            background: decode_color(state.background.as_ref().ok_or(WireError::Missing("state.background"))?),
            view: decode_view(state.view.as_ref().ok_or(WireError::Missing("state.view"))?)?,
            kept_views: decode_kept_views(&state.kept_views)?,
            term: decode_term(state.term)?,
            up: decode_axis(state.up)?,
            focus: state.focus.clone(),
        };
        for unit in decoded.units() {
            check_length(&unit.mask, expected, "unit.mask")?;
            unit.deleted.as_deref().map_or(Ok(()), |deleted| check_length(deleted, expected, "unit.deleted"))?;
        }
        check_length(decoded.selection.mask(), expected, "selection.mask")?;
        check_length(&decoded.deleted, expected, "state.deleted")?;
        let mut placed = decoded.placements.iter().map(|part| &part.members);
        placed.try_for_each(|members| check_length(members, expected, "placements.mask"))?;
        Ok(decoded)
    }
}

fn count(value: u64, field: &'static str) -> Result<usize, WireError> {
    usize::try_from(value).map_err(|_| WireError::Count { field, value })
}

#[cfg(test)]
mod tests {
    use super::*;
    use sg_scene::synthetic::test_scene;

    #[test]
    fn a_snapshot_is_the_state_and_an_outline_is_not() {
        let state = EditState::of_scene(&test_scene(&[("bone", 9), ("skin", 0)]), "scene.toml", "hash");
        assert_eq!(EditState::from_snapshot(&state.state(true)), Ok(state.clone()));
        assert_eq!(EditState::from_snapshot(&state.state(false)), Err(WireError::Missing("selection.mask")));
    }

    #[test]
    fn masks_of_another_scene_and_torn_masks_are_refused() {
        let mask = encode_mask(&Mask::from_fn(20, |i| i % 3 == 0));
        assert!(decode_mask(&mask, 20, "mask").is_ok());
        assert_eq!(decode_mask(&mask, 21, "mask"), Err(WireError::Length { field: "mask", found: 20, expected: 21 }));
        let torn = proto::Mask { bits: mask.bits[..2].to_vec(), ..mask };
        assert!(matches!(decode_mask(&torn, 20, "mask"), Err(WireError::Bits { .. })));
    }

    #[test]
    fn values_outside_an_enumeration_are_refused() {
        assert_eq!(decode_term(0), Err(WireError::Kind { field: "term", value: 0 }));
        assert_eq!(decode_axis(7), Err(WireError::Kind { field: "up", value: 7 }));
        assert_eq!(decode_term(77), Err(WireError::Kind { field: "term", value: 77 }));
        assert_eq!(decode_light_mode(0), Ok(None));
        assert!(decode_light_mode(-4).is_err());
        assert!(decode_side(0).is_err());
        assert_eq!(decode_side(proto::NamedView::Initial.into()), Ok(None));
    }
}
