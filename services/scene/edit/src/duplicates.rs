//! Gaussians that edits added: copies of others.
//!
//! Copies of Gaussians of one base unit form a base unit of their own, behind all others. So base units stay contiguous, and the
//! index of a Gaussian never changes while it exists.

use std::sync::Arc;

use sg_scene::mask::Mask;

/// Copies of Gaussians of one base unit.
#[derive(Debug, Clone, PartialEq)]
pub struct Duplicate {
    originals: Arc<Mask>,
    count: usize,
}

impl Duplicate {
    /// Copies of these Gaussians. The mask is over all Gaussians before the copies.
    #[must_use]
    pub fn of(originals: Arc<Mask>) -> Self {
        Self { count: originals.count(), originals }
    }

    /// The originals, in the order of the copies.
    #[must_use]
    pub fn originals(&self) -> &Arc<Mask> {
        &self.originals
    }

    /// Scene-wide indices of the copies.
    #[must_use]
    pub fn range(&self) -> std::ops::Range<usize> {
        self.originals.len()..self.originals.len() + self.count
    }
}

/// Whether two lists of copies are equal, without a look at masks that are the same allocation.
pub(super) fn same(a: &Arc<[Duplicate]>, b: &Arc<[Duplicate]>) -> bool {
    Arc::ptr_eq(a, b) || (a.len() == b.len() && a.iter().zip(b.iter()).all(|(a, b)| same_part(a, b)))
}

pub(super) fn same_part(a: &Duplicate, b: &Duplicate) -> bool {
    a.count == b.count && (Arc::ptr_eq(&a.originals, &b.originals) || a.originals == b.originals)
}
