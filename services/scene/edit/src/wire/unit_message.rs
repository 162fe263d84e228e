//! Base units and editable units as messages.

use std::sync::Arc;

use sg_proto::scene as proto;

use super::tone_message::{decode_tone, encode_tone};
use super::{WireError, count, decode_any_mask, decode_color, decode_optional, encode_color, encode_mask};
use crate::state::{BaseUnitState, Unit};

pub(super) fn encode_base(base: &BaseUnitState) -> proto::BaseUnit {
    proto::BaseUnit {
        name: base.name.clone(),
        first: base.first as u64,
        count: base.count as u64,
        palette: Some(encode_color(base.palette)),
        opacity: base.opacity,
        visible: base.visible,
        deleted: base.deleted as u64,
        locked: base.locked,
        tone: encode_tone(base.tone),
        duplicated: base.duplicated,
    }
}

pub(super) fn decode_base(base: &proto::BaseUnit) -> Result<BaseUnitState, WireError> {
    Ok(BaseUnitState {
        name: base.name.clone(),
        first: count(base.first, "base_unit.first")?,
        count: count(base.count, "base_unit.count")?,
        palette: decode_color(base.palette.as_ref().ok_or(WireError::Missing("base_unit.palette"))?),
        opacity: base.opacity,
        visible: base.visible,
        deleted: count(base.deleted, "base_unit.deleted")?,
        locked: base.locked,
        tone: decode_tone(base.tone.as_ref(), "base_unit.tone")?,
        duplicated: base.duplicated,
    })
}

pub(super) fn encode_unit(unit: &Unit, with_mask: bool) -> proto::Unit {
    proto::Unit {
        id: unit.id,
        name: unit.name.clone(),
        mask: with_mask.then(|| encode_mask(&unit.mask)),
        count: unit.mask.count() as u64,
        color: unit.color.map(encode_color),
        opacity: unit.opacity,
        visible: unit.visible,
        derived: unit.derived,
        deleted: unit.deleted.as_deref().filter(|_| with_mask).map(encode_mask),
        locked: unit.locked,
        tone: encode_tone(unit.tone),
    }
}

pub(super) fn decode_unit(unit: &proto::Unit) -> Result<Unit, WireError> {
    let mask = unit.mask.as_ref().ok_or(WireError::Missing("unit.mask"))?;
    Ok(Unit {
        id: unit.id,
        name: unit.name.clone(),
        mask: Arc::new(decode_any_mask(mask, "unit.mask")?),
        deleted: decode_optional(unit.deleted.as_ref(), "unit.deleted")?,
        locked: unit.locked,
        tone: decode_tone(unit.tone.as_ref(), "unit.tone")?,
        color: unit.color.as_ref().map(decode_color),
        opacity: unit.opacity,
        visible: unit.visible,
        derived: unit.derived,
    })
}
