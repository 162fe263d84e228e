//! iVR-GS's final PLY: half-precision positions, and codebook indices for all else ([`crate::splat::codebook_columns`]).

use std::path::PathBuf;

use crate::splat::codebook_columns;
use crate::splat::editable_ply::{Storage, write_file, write_folder};
use crate::splat::format::{Format, PlyLayout, Source, SplatFormat, SplatWriter, WriteJob, WriteProblem};
use crate::splat::ply::PlyFile;
use crate::splat::problem::{Problem, Warning};
use sg_scene::model::{Convention, Gaussians};

/// The format `ivrgs-quantised`.
#[derive(Debug)]
pub(crate) struct IvrGsQuantised;

impl Format {
    /// iVR-GS's quantised PLY, or its folder of them.
    pub const IVRGS_QUANTISED: Self = Self(&IvrGsQuantised);
}

impl SplatFormat for IvrGsQuantised {
    fn name(&self) -> &'static str {
        "ivrgs-quantised"
    }

    fn description(&self) -> &'static str {
        "iVR-GS's final PLY with codebooks, or a folder with one for each unit"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &[".ply"]
    }

    fn sniff(&self, source: &Source) -> bool {
        source.is_ply()
    }

    fn ply(&self) -> Option<&dyn PlyLayout> {
        Some(self)
    }

    fn is_ivrgs(&self) -> bool {
        true
    }

    fn writer(&self) -> Option<&dyn SplatWriter> {
        Some(self)
    }
}

impl PlyLayout for IvrGsQuantised {
    fn matches(&self, file: &PlyFile) -> bool {
        file.has("gaussians") && file.has("codebook_centers")
    }

    fn elements(&self) -> &'static [&'static str] {
        &["gaussians", "codebook_centers"]
    }

    fn read(&self, file: &PlyFile, _warnings: &mut Vec<Warning>) -> Result<Gaussians, Problem> {
        codebook_columns::read(&file.required_table("gaussians")?, &file.required_table("codebook_centers")?)
    }

    fn format(&self, _convention: Convention) -> Format {
        Format::IVRGS_QUANTISED
    }

    fn is_quantised(&self) -> bool {
        true
    }
}

impl SplatWriter for IvrGsQuantised {
    fn is_default_for(&self, _extension: &str, _has_shading: bool) -> bool {
        false
    }

    fn writes_folders(&self) -> bool {
        true
    }

    fn holds_one_unit(&self) -> bool {
        true
    }

    fn write(&self, job: &WriteJob<'_>, warnings: &mut Vec<Warning>) -> Result<Vec<PathBuf>, WriteProblem> {
        let write = if job.is_folder { write_folder } else { write_file };
        write(job, Storage::IvrGsQuantised, warnings)
    }
}
