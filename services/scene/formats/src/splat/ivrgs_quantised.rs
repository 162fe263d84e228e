//! iVR-GS's final PLY: half-precision positions, and codebook indices for all else ([`crate::splat::codebook_columns`]).

use std::path::PathBuf;

use crate::splat::codebook_columns;
use crate::splat::editable_ply::{self, Storage};
use crate::splat::format::{Format, PlyLayout, SplatWriter, WriteJob, WriteProblem};
use crate::splat::ply::PlyFile;
use crate::splat::ply_format::PlyFormat;
use crate::splat::problem::{Problem, Warning};
use sg_scene::model::Gaussians;

impl Format {
    /// iVR-GS's quantised PLY, or its folder of them.
    pub const IVRGS_QUANTISED: Self = Self(&PlyFormat {
        layout: Some(PlyLayout {
            is_quantised: true,
            ..PlyLayout::new(
                &["gaussians", "codebook_centers"],
                |file| file.has("gaussians") && file.has("codebook_centers"),
                read,
            )
        }),
        is_ivrgs: true,
        writer: Some(SplatWriter { writes_folders: true, holds_one_unit: true, ..SplatWriter::new(write) }),
        ..PlyFormat::new("ivrgs-quantised", "iVR-GS's final PLY with codebooks, or a folder with one for each unit")
    });
}

fn read(file: &PlyFile, _warnings: &mut Vec<Warning>) -> Result<Gaussians, Problem> {
    codebook_columns::read(&file.required_table("gaussians")?, &file.required_table("codebook_centers")?)
}

fn write(job: &WriteJob<'_>, warnings: &mut Vec<Warning>) -> Result<Vec<PathBuf>, WriteProblem> {
    editable_ply::write(job, Storage::IvrGsQuantised, warnings)
}
