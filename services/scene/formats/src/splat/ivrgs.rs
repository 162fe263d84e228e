//! iVR-GS's float PLY (the intermediate file of a training), and its folder of one PLY for each transfer function.

use std::path::{Path, PathBuf};

use crate::splat::editable_columns;
use crate::splat::editable_ply::{Storage, write_file, write_folder};
use crate::splat::format::{
    Format, Listing, LoadError, PlyLayout, Source, SplatFormat, SplatWriter, UnitSource, WriteJob, WriteProblem,
};
use crate::splat::ivrgs_folder;
use crate::splat::ply::PlyFile;
use crate::splat::problem::{Problem, Warning};
use crate::splat::three_dgs::warn_of_narrowing;
use sg_scene::model::{Convention, Gaussians};

/// The format `ivrgs`.
#[derive(Debug)]
pub(crate) struct IvrGs;

impl Format {
    /// iVR-GS's float PLY, or its folder of them.
    pub const IVRGS: Self = Self(&IvrGs);
}

impl SplatFormat for IvrGs {
    fn name(&self) -> &'static str {
        "ivrgs"
    }

    fn description(&self) -> &'static str {
        "iVR-GS's float PLY, or a folder with one for each unit"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &[".ply"]
    }

    fn sniff(&self, source: &Source) -> bool {
        source.is_ply() || source.folder.is_some_and(|f| !f.has_scene_file)
    }

    fn list(&self, path: &Path) -> Result<Listing, LoadError> {
        let found =
            ivrgs_folder::find(path).map_err(|problem| LoadError::Content { path: path.to_path_buf(), problem })?;
        let unit = |(name, path)| UnitSource { path, entry: None, name: Some(name) };
        Ok(Listing { units: found.into_iter().map(unit).collect(), scene: None })
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

impl PlyLayout for IvrGs {
    fn matches(&self, file: &PlyFile) -> bool {
        file.has("gaussians") && !file.has("codebook_centers")
    }

    fn elements(&self) -> &'static [&'static str] {
        &["gaussians"]
    }

    fn read(&self, file: &PlyFile, warnings: &mut Vec<Warning>) -> Result<Gaussians, Problem> {
        let table = file.required_table("gaussians")?;
        warn_of_narrowing(&table, warnings);
        editable_columns::read(&table)
    }

    fn format(&self, convention: Convention) -> Format {
        if convention == Convention::Ours { Format::OURS } else { Format::IVRGS }
    }
}

impl SplatWriter for IvrGs {
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
        write(job, Storage::IvrGsFloat, warnings)
    }
}
