//! `scene.toml` with one PLY for each base unit ([`crate::splat::scene_file`]).

use std::io;
use std::path::{Path, PathBuf};

use crate::splat::editable_ply::{self, Alone, Storage};
use crate::splat::format::{
    Format, Listing, LoadError, Source, SplatFormat, SplatWriter, UnitSource, WriteJob, WriteProblem,
};
use crate::splat::problem::Warning;
use crate::splat::scene_file::SceneFile;
use crate::splat::three_dgs;
use crate::staged_file::{self, StagedFile};
use sg_scene::model::{BaseUnit, Convention};

/// The format `scene`.
#[derive(Debug)]
pub(crate) struct SceneToml;

impl Format {
    /// `scene.toml` with one PLY for each base unit.
    pub const SCENE: Self = Self(&SceneToml);
}

impl SplatFormat for SceneToml {
    fn name(&self) -> &'static str {
        "scene"
    }

    fn description(&self) -> &'static str {
        "scene.toml with one PLY for each base unit; keeps everything"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &[".toml"]
    }

    fn sniff(&self, source: &Source) -> bool {
        source.folder.is_some_and(|f| f.has_scene_file) || !source.is_ply() && source.has_extension(self.extensions())
    }

    fn list(&self, path: &Path) -> Result<Listing, LoadError> {
        let file_path = if path.is_dir() { path.join("scene.toml") } else { path.to_path_buf() };
        let file = SceneFile::read(&file_path)?;
        let folder = file_path.parent().unwrap_or(Path::new(""));
        let unit = |entry: crate::splat::scene_file::UnitEntry| UnitSource {
            path: folder.join(&entry.file),
            entry: Some(entry),
            name: None,
        };
        Ok(Listing { units: file.units.into_iter().map(unit).collect(), scene: Some((Format::SCENE, file.bounds)) })
    }

    fn writer(&self) -> Option<SplatWriter> {
        Some(SplatWriter { is_default_for: |extension, _| extension == ".toml", ..SplatWriter::new(write) })
    }
}

/// Checks that a scene file can be saved at a path: nothing is there, or an earlier scene file.
///
/// # Errors
/// [`io::ErrorKind::AlreadyExists`] for another file; the system's error if it cannot be read.
pub fn check_target(path: &Path) -> io::Result<()> {
    earlier_scene(path).map(|_| ())
}

/// The scene file that a save replaces.
fn earlier_scene(path: &Path) -> io::Result<Option<SceneFile>> {
    staged_file::check_replaceable(path)?;
    if !std::fs::metadata(path).is_ok_and(|found| found.len() > 0) {
        return Ok(None);
    }
    SceneFile::read(path).map(Some).map_err(|_| {
        let message = "the file there is no scene file; move it away or give another name";
        io::Error::new(io::ErrorKind::AlreadyExists, message)
    })
}

/// Whether a unit's file of this name would replace something else than the file of an earlier save: a foreign file, or one
/// that the scene was read from.
fn replaces_another(job: &WriteJob<'_>, earlier: Option<&SceneFile>, name: &str) -> bool {
    let file = job.path.with_file_name(name);
    let is_own = || earlier.is_some_and(|scene| scene.units.iter().any(|unit| unit.file == Path::new(name)));
    let is_source = || {
        let place = file.canonicalize().ok();
        let sources = job.scene.units.iter().filter_map(|unit| unit.file.as_deref()?.canonicalize().ok());
        sources.into_iter().any(|source| Some(source) == place)
    };
    file.symlink_metadata().is_ok() && (!is_own() || is_source())
}

fn write(job: &WriteJob<'_>, warnings: &mut Vec<Warning>) -> Result<Vec<PathBuf>, WriteProblem> {
    let earlier = earlier_scene(job.path)?;
    let names = file_names(&job.scene.units, |name| replaces_another(job, earlier.as_ref(), name));
    let mut staged = Vec::with_capacity(names.len());
    let paths: Vec<PathBuf> = names.iter().map(PathBuf::from).collect();
    let mut file = SceneFile::of_scene(job.scene, &paths);
    for ((unit, name), entry) in job.scene.units.iter().zip(&names).zip(&mut file.units) {
        let mut out = StagedFile::create(&job.path.with_file_name(name))?;
        if unit.gaussians.shading.is_none() && job.options.format != Some(Format::OURS) {
            three_dgs::write_columns(&mut out, &unit.gaussians)?;
        } else {
            // New shading columns change the unit's palette, so the scene file stores the new one.
            let prepared = editable_ply::prepare(unit, Convention::Ours, warnings);
            entry.palette = Some(prepared.palette);
            entry.shading = Some(prepared.shading);
            entry.oriented_normals = Some(prepared.oriented_normals);
            let convention = Convention::Ours;
            editable_ply::write_unit(&mut out, &prepared, Storage::AsUsed, convention, Alone::No, warnings)?;
        }
        staged.push(out);
    }
    let mut files = vec![job.path.to_path_buf()];
    for out in staged {
        files.push(out.commit()?);
    }
    staged_file::replace(job.path, file.to_text().as_bytes())?;
    staged_file::sync_folder(job.path)?;
    Ok(files)
}

/// A file name for each unit: its name in plain letters, distinct on file systems that ignore case, and not taken.
fn file_names(units: &[BaseUnit], is_taken: impl Fn(&str) -> bool) -> Vec<String> {
    let mut names: Vec<String> = Vec::with_capacity(units.len());
    for unit in units {
        let plain = |c: char| if c.is_ascii_alphanumeric() || c == '-' || c == '_' { c } else { '_' };
        let stem: String = unit.name.chars().take(64).map(plain).collect();
        let stem = if stem.is_empty() { "unit".to_owned() } else { stem };
        let is_free = |name: &str| !names.iter().any(|n| n.eq_ignore_ascii_case(name)) && !is_taken(name);
        let numbered = (2_usize..).map(|k| format!("{stem}-{k}.ply"));
        let name = std::iter::once(format!("{stem}.ply")).chain(numbered).find(|n| is_free(n));
        names.push(name.unwrap_or_default());
    }
    names
}
