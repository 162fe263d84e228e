//! `scene.toml` with one PLY for each base unit ([`crate::splat::scene_file`]).

use std::collections::{HashMap, HashSet};
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
        Ok(Listing {
            units: file.units.into_iter().map(unit).collect(),
            scene: Some((Format::SCENE, file.bounds)),
            orientation: file.orientation,
        })
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

/// Files that a save must not replace.
struct TakenFiles<'a> {
    job: &'a WriteJob<'a>,
    /// Files of units in the scene file that is replaced.
    own: HashSet<PathBuf>,
    /// Files that the scene was read from.
    sources: HashSet<PathBuf>,
}

impl<'a> TakenFiles<'a> {
    fn of(job: &'a WriteJob<'a>, earlier: Option<SceneFile>) -> Self {
        let own = earlier.into_iter().flat_map(|scene| scene.units).map(|unit| unit.file).collect();
        let sources = job.scene.units.iter().filter_map(|unit| unit.file.as_deref()?.canonicalize().ok()).collect();
        Self { job, own, sources }
    }

    /// Whether the file beside the scene file is foreign, or one that the scene was read from.
    fn contains(&self, name: &str) -> bool {
        let file = self.job.path.with_file_name(name);
        let is_source = || file.canonicalize().is_ok_and(|place| self.sources.contains(&place));
        file.symlink_metadata().is_ok() && (!self.own.contains(Path::new(name)) || is_source())
    }
}

fn write(job: &WriteJob<'_>, warnings: &mut Vec<Warning>) -> Result<Vec<PathBuf>, WriteProblem> {
    let taken = TakenFiles::of(job, earlier_scene(job.path)?);
    let names = file_names(&job.scene.units, |name| taken.contains(name));
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
    let mut given = HashSet::new();
    // The next number of each stem, so that a thousand units of one name take a thousand steps.
    let mut next: HashMap<String, usize> = HashMap::new();
    for unit in units {
        let plain = |c: char| if c.is_ascii_alphanumeric() || c == '-' || c == '_' { c } else { '_' };
        let stem: String = unit.name.chars().take(64).map(plain).collect();
        let stem = if stem.is_empty() { "unit".to_owned() } else { stem };
        let number = next.entry(stem.to_ascii_lowercase()).or_insert(1);
        let name = loop {
            let name = if *number == 1 { format!("{stem}.ply") } else { format!("{stem}-{number}.ply") };
            *number += 1;
            if !is_taken(&name) && given.insert(name.to_ascii_lowercase()) {
                break name;
            }
        };
        names.push(name);
    }
    names
}
