//! Writing a scene in any of its formats.

use std::io;
use std::path::{Path, PathBuf};

use sg_scene::model::{BaseUnit, Scene};

pub use crate::splat::SaveOptions;
use crate::splat::format::{SplatWriter, WriteJob, WriteProblem};
use crate::splat::{Format, Problem, Warning};

/// The result of a save.
#[derive(Debug, Clone, PartialEq)]
pub struct Saved {
    /// The format that was taken.
    pub format: Format,
    /// The files, the one to open first.
    pub files: Vec<PathBuf>,
    /// Losses of the format.
    pub warnings: Vec<Warning>,
}

/// A scene that could not be written. The old content stays, except that units of a `scene.toml` may be new.
#[derive(Debug, thiserror::Error)]
pub enum SaveError {
    /// The system refused.
    #[error("{path}: {source}; nothing was written")]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The format, the path or the options do not suit the scene.
    #[error("{path}: {problem}")]
    Unsuitable {
        /// The file or folder.
        path: PathBuf,
        /// The mismatch and the remedy.
        problem: Problem,
    },
}

/// Writes a scene; files appear whole, under a temporary name first.
///
/// The path's ending decides unless [`SaveOptions::format`] is given: see the table in [`crate::splat`]. `.ply` becomes
/// `ours` for an editable unit and `3dgs` for a scene drawn from harmonics. A path without an ending is a folder, for
/// `ivrgs` and `ivrgs-quantised`. Files in `3dgs`, `compressed` and `splat` hold all units as one, unlit. Files in
/// `ours`, `ivrgs` and `ivrgs-quantised` hold one unit.
///
/// # Errors
/// [`SaveError`].
pub fn save(path: &Path, scene: &Scene, options: &SaveOptions) -> Result<Saved, SaveError> {
    let unsuitable = |problem| SaveError::Unsuitable { path: path.to_path_buf(), problem };
    let target = Target::of(path).map_err(unsuitable)?;
    let (format, writer) = choose(&target, scene, options).map_err(unsuitable)?;
    if options.reorder && !writer.can_reorder {
        return Err(unsuitable(Problem::new(
            "options",
            format!("{format} keeps the order"),
            "reorder only compressed files",
        )));
    }
    scene.units.iter().try_for_each(check).map_err(unsuitable)?;
    let mut warnings = Vec::new();
    let job = WriteJob { path, scene, options, is_folder: matches!(target, Target::Folder) };
    match (writer.write)(&job, &mut warnings) {
        Ok(files) => Ok(Saved { format, files, warnings }),
        Err(WriteProblem::Unsuitable(problem)) => Err(unsuitable(problem)),
        Err(WriteProblem::Io(source)) => Err(SaveError::Write { path: path.to_path_buf(), source }),
    }
}

/// The format of a `.ply` for a scene of several base units: 3DGS, which makes them one, unlit. An editable PLY holds one.
/// `None` for another path or a scene of one unit: their default holds them.
#[must_use]
pub fn joined_format(path: &Path, scene: &Scene) -> Option<Format> {
    let Ok(Target::File { extension, .. }) = Target::of(path) else { return None };
    (extension == ".ply" && scene.units.len() > 1).then_some(Format::THREE_DGS)
}

/// The kind of output that a path's name requests.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Target {
    /// A file: its name in lower case, and the longest ending of it that a format has.
    File {
        name: String,
        extension: &'static str,
    },
    Folder,
}

/// The formats that can be written.
fn writers() -> impl Iterator<Item = (Format, SplatWriter)> {
    Format::all().filter_map(|f| Some((f, f.0.writer()?)))
}

/// Names of the formats that become folders.
fn folder_formats() -> String {
    let names: Vec<_> = writers().filter(|(_, w)| w.writes_folders).map(|(f, _)| f.name()).collect();
    names.join(" or ")
}

impl Target {
    fn of(path: &Path) -> Result<Self, Problem> {
        let unknown = || {
            let mut extensions: Vec<_> = Format::all_extensions();
            extensions.retain(|e| writers().any(|(f, _)| f.extensions().contains(e)));
            let remedy =
                format!("end it with {}, or give a folder and --format {}", extensions.join(", "), folder_formats());
            Problem::new("path", "its ending belongs to no format", remedy)
        };
        let name = path.file_name().and_then(|n| n.to_str()).ok_or_else(unknown)?.to_ascii_lowercase();
        let endings = writers().flat_map(|(f, _)| f.extensions()).copied().filter(|e| name.ends_with(e));
        match endings.max_by_key(|e| e.len()) {
            Some(extension) => Ok(Self::File { name, extension }),
            None if path.is_dir() || !name.contains('.') => Ok(Self::Folder),
            None => Err(unknown()),
        }
    }
}

/// The format to write, and its writer.
fn choose(target: &Target, scene: &Scene, options: &SaveOptions) -> Result<(Format, SplatWriter), Problem> {
    let Target::File { name, extension } = target else {
        let folder = writers().find(|(f, w)| options.format == Some(*f) && w.writes_folders);
        return folder.ok_or_else(|| {
            let remedy = format!("give --format {}, or a .ply or .toml path", folder_formats());
            Problem::new("path", "it is a folder", remedy)
        });
    };
    let has_shading = scene.has_shading();
    // `ours` for a scene file means the format of its units.
    let requested = options.format.filter(|f| !(*f == Format::OURS && *extension == ".toml"));
    let fits = |format: Format| format.extensions().iter().any(|e| name.ends_with(e));
    let found = match requested {
        None => writers().find(|(_, w)| (w.is_default_for)(extension, has_shading)),
        Some(requested) => writers().find(|(f, _)| *f == requested && fits(*f)),
    };
    let (format, writer) = found.ok_or_else(|| {
        let format = options.format.map_or_else(|| "no format".to_owned(), |f| f.to_string());
        Problem::new("format", format!("{format} does not fit the path's extension"), "change one of them")
    })?;
    if writer.holds_one_unit && scene.units.len() != 1 {
        let what = format!("{format} holds one base unit in a file, the scene has {}", scene.units.len());
        let remedy = "write a scene.toml, an iVR-GS folder, or --format 3dgs, which makes them one";
        return Err(Problem::new("format", what, remedy));
    }
    Ok((format, writer))
}

/// Refuses columns of unequal length, and names that a header cannot hold.
fn check(unit: &BaseUnit) -> Result<(), Problem> {
    let place = || format!("unit `{}`", unit.name);
    unit.gaussians
        .check_lengths()
        .map_err(|e| Problem::new(place(), e.to_string(), "give every Gaussian all columns"))?;
    for (k, column) in unit.gaussians.extra.iter().enumerate() {
        let name = &column.name;
        let is_word =
            !name.is_empty() && name.len() <= 256 && name.chars().all(|c| !c.is_whitespace() && !c.is_control());
        if !is_word || unit.gaussians.extra.iter().take(k).any(|other| other.name == *name) {
            let what = format!(
                "the extra column `{}` has a name twice or one that no PLY can hold",
                sg_input::printable(name)
            );
            return Err(Problem::new(place(), what, "give it a name of its own without spaces"));
        }
    }
    Ok(())
}
