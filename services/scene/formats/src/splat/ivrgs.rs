//! iVR-GS's float PLY (the intermediate file of a training), and its folder of one PLY for each transfer function.

use std::path::PathBuf;

use crate::splat::editable_columns;
use crate::splat::editable_ply::{self, Storage};
use crate::splat::format::{Format, PlyLayout, SplatWriter, WriteJob, WriteProblem};
use crate::splat::ivrgs_folder;
use crate::splat::ply::PlyFile;
use crate::splat::ply_format::PlyFormat;
use crate::splat::problem::{Problem, Warning};
use crate::splat::three_dgs::warn_of_narrowing;
use sg_scene::model::Gaussians;

impl Format {
    /// iVR-GS's float PLY, or its folder of them.
    pub const IVRGS: Self = Self(&PlyFormat {
        layout: Some(PlyLayout {
            as_used: Some(Self::OURS),
            ..PlyLayout::new(&["gaussians"], |file| file.has("gaussians") && !file.has("codebook_centers"), read)
        }),
        find_units: Some(ivrgs_folder::find),
        is_ivrgs: true,
        writer: Some(SplatWriter { writes_folders: true, holds_one_unit: true, ..SplatWriter::new(write) }),
        ..PlyFormat::new("ivrgs", "iVR-GS's float PLY, or a folder with one for each unit")
    });
}

fn read(file: &PlyFile, warnings: &mut Vec<Warning>) -> Result<Gaussians, Problem> {
    let table = file.required_table("gaussians")?;
    warn_of_narrowing(&table, warnings);
    editable_columns::read(&table)
}

fn write(job: &WriteJob<'_>, warnings: &mut Vec<Warning>) -> Result<Vec<PathBuf>, WriteProblem> {
    editable_ply::write(job, Storage::IvrGsFloat, warnings)
}
