//! Copies of Gaussians as messages.

use std::sync::Arc;

use sg_proto::scene as proto;

use super::{WireError, decode_any_mask, encode_mask};
use crate::duplicates::Duplicate;
use crate::state::BaseUnitState;

const FIELD: &str = "duplicates.originals";

pub(super) fn encode_duplicates(parts: &[Duplicate]) -> proto::Duplicates {
    let part = |part: &Duplicate| proto::Duplicate { originals: Some(encode_mask(part.originals())) };
    proto::Duplicates { parts: parts.iter().map(part).collect() }
}

pub(super) fn decode_duplicates(message: &proto::Duplicates) -> Result<Arc<[Duplicate]>, WireError> {
    let part = |part: &proto::Duplicate| {
        let originals = part.originals.as_ref().ok_or(WireError::Missing(FIELD))?;
        Ok(Duplicate::of(Arc::new(decode_any_mask(originals, FIELD)?)))
    };
    message.parts.iter().map(part).collect()
}

/// Refuses copies in a snapshot that are not its last base units, or that are not each of one base unit before them.
pub(super) fn check_duplicates(
    duplicates: &[Duplicate],
    base: &[BaseUnitState],
    gaussians: usize,
) -> Result<(), WireError> {
    let wrong = Err(WireError::Duplicates(FIELD));
    let Some(of_file) = base.len().checked_sub(duplicates.len()) else { return wrong };
    if base.iter().take(of_file).any(|unit| unit.duplicated) {
        return wrong;
    }
    let mut end = duplicates.first().map_or(gaussians, |first| first.originals().len());
    for (k, duplicate) in (of_file..).zip(duplicates) {
        let is_own = base.get(k).is_some_and(|unit| unit.duplicated && unit.range() == duplicate.range());
        let first = duplicate.originals().ones().next();
        let holds = |unit: &&BaseUnitState| first.is_some_and(|first| unit.range().contains(&first));
        let source = base.iter().take(k).find(holds);
        let is_of_one = source.is_some_and(|unit| duplicate.originals().ones().all(|i| unit.range().contains(&i)));
        if !is_own || !is_of_one || duplicate.originals().len() != end {
            return wrong;
        }
        end = duplicate.range().end;
    }
    if end == gaussians { Ok(()) } else { wrong }
}
