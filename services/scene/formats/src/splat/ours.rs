//! Our own PLY: the 21 float columns of an editable unit, as used, with the unit's other properties in comments.

use std::path::PathBuf;

use crate::splat::editable_ply::{self, Storage};
use crate::splat::format::{Format, SplatWriter, WriteJob, WriteProblem};
use crate::splat::ply_format::PlyFormat;
use crate::splat::problem::Warning;

impl Format {
    /// The 21 float columns of an editable unit, stored as used. [`Format::IVRGS`] reads the same columns; the convention
    /// distinguishes the two.
    pub const OURS: Self = Self(&PlyFormat {
        writer: Some(SplatWriter {
            is_default_for: |extension, has_shading| extension == ".ply" && has_shading,
            holds_one_unit: true,
            ..SplatWriter::new(write)
        }),
        ..PlyFormat::new("ours", "one editable unit, bit for bit")
    });
}

fn write(job: &WriteJob<'_>, warnings: &mut Vec<Warning>) -> Result<Vec<PathBuf>, WriteProblem> {
    editable_ply::write_file(job, Storage::AsUsed, warnings)
}
