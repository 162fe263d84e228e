//! Our own PLY: the 21 float columns of an editable unit, as used, with the unit's other properties in comments.

use std::path::PathBuf;

use crate::splat::editable_ply::{Storage, write_file};
use crate::splat::format::{Format, Source, SplatFormat, SplatWriter, WriteJob, WriteProblem};
use crate::splat::problem::Warning;

/// The format `ours`. [`IvrGs`](super::ivrgs::IvrGs) reads the same columns; the convention distinguishes the two.
#[derive(Debug)]
pub(crate) struct Ours;

impl Format {
    /// The 21 float columns of an editable unit, stored as used.
    pub const OURS: Self = Self(&Ours);
}

impl SplatFormat for Ours {
    fn name(&self) -> &'static str {
        "ours"
    }

    fn description(&self) -> &'static str {
        "one editable unit, bit for bit"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &[".ply"]
    }

    fn sniff(&self, source: &Source) -> bool {
        source.is_ply()
    }

    fn writer(&self) -> Option<&dyn SplatWriter> {
        Some(self)
    }
}

impl SplatWriter for Ours {
    fn is_default_for(&self, extension: &str, has_shading: bool) -> bool {
        extension == ".ply" && has_shading
    }

    fn holds_one_unit(&self) -> bool {
        true
    }

    fn write(&self, job: &WriteJob<'_>, warnings: &mut Vec<Warning>) -> Result<Vec<PathBuf>, WriteProblem> {
        write_file(job, Storage::AsUsed, warnings)
    }
}
