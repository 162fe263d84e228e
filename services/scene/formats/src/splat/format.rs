//! The interface of a file format: how it is recognised, read and written.

use std::fmt;
use std::hash::{Hash, Hasher};
use std::io;
use std::path::{Path, PathBuf};

use serde::{Serialize, Serializer};
use sg_scene::model::{Convention, Gaussians, Scene, SceneBox};
use sg_scene::orientation::Orientation;

use crate::splat::ply::PlyFile;
use crate::splat::problem::{Problem, Warning};
use crate::splat::scene_file::{SceneFileError, UnitEntry};
use crate::splat::unit_comments::UnitComments;
use crate::staged_file::{self, StagedFile};

/// A format of Gaussian scenes: one file implements it, one row of the registry names it. Formats whose units are PLY files
/// are values of [`PlyFormat`](super::ply_format::PlyFormat) instead of types of their own.
pub(crate) trait SplatFormat: fmt::Debug + Sync {
    /// The name on the command line and in reports.
    fn name(&self) -> &'static str;

    /// One line for help texts, without a full stop.
    fn description(&self) -> &'static str;

    /// Endings of file names, in lower case with the dot.
    fn extensions(&self) -> &'static [&'static str];

    /// Whether the content or name shows that the source has this format or its container.
    fn sniff(&self, source: &Source) -> bool;

    /// The files of a scene's units. A format that stores one unit in one file keeps this default.
    ///
    /// # Errors
    /// The folder or the scene file cannot be read.
    fn list(&self, path: &Path) -> Result<Listing, LoadError> {
        Ok(Listing::of_file(path))
    }

    /// The layout within a PLY file, for formats that use this container.
    fn ply(&self) -> Option<PlyLayout> {
        None
    }

    /// Decodes one unit from the bytes of a file that is no PLY. `warnings` takes what is guessed or not kept.
    ///
    /// # Errors
    /// The content is damaged or the format does not store single units outside of PLY files.
    fn decode(&self, _bytes: &[u8], _warnings: &mut Vec<Warning>) -> Result<Gaussians, Problem> {
        Err(Problem::new("byte 0", format!("a {} file has no unit of its own", self.name()), "give a splat file"))
    }

    /// Whether iVR-GS trained the units: with two-sided shading, and with normals that point outwards.
    fn is_ivrgs(&self) -> bool {
        false
    }

    /// The writer, for formats that can be written.
    fn writer(&self) -> Option<SplatWriter> {
        None
    }
}

/// The layout of a format within a PLY file. The first layout in the order of the registry that matches a file reads it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PlyLayout {
    /// Whether a file has this layout.
    pub(crate) matches: fn(&PlyFile) -> bool,
    /// The elements that `read` uses.
    pub(crate) elements: &'static [&'static str],
    /// Reads the columns; shading columns keep the convention of the file. A missing, mistyped or damaged column is an error.
    pub(crate) read: fn(&PlyFile, &mut Vec<Warning>) -> Result<Gaussians, Problem>,
    /// The format of those files whose shading columns are stored as used, if it is another one.
    pub(crate) as_used: Option<Format>,
    /// Whether shading values come from codebooks. Codebooks store them activated.
    pub(crate) is_quantised: bool,
}

impl PlyLayout {
    /// A layout of one format, without codebooks.
    pub(crate) const fn new(
        elements: &'static [&'static str],
        matches: fn(&PlyFile) -> bool,
        read: fn(&PlyFile, &mut Vec<Warning>) -> Result<Gaussians, Problem>,
    ) -> Self {
        Self { matches, elements, read, as_used: None, is_quantised: false }
    }
}

/// The writer of a format.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SplatWriter {
    /// Whether a path with this ending gets this format if the caller names none. The second argument tells whether the
    /// scene has shading columns.
    pub(crate) is_default_for: fn(&str, bool) -> bool,
    /// Whether a folder can be written.
    pub(crate) writes_folders: bool,
    /// Whether a file holds exactly one base unit.
    pub(crate) holds_one_unit: bool,
    /// Whether [`SaveOptions::reorder`] has an effect.
    pub(crate) can_reorder: bool,
    /// Writes the scene and returns the written files, the main one first.
    pub(crate) write: WriteScene,
}

/// A function that writes a scene. It fails if the system refuses, or if the format cannot store the scene.
pub(crate) type WriteScene = fn(&WriteJob<'_>, &mut Vec<Warning>) -> Result<Vec<PathBuf>, WriteProblem>;

impl SplatWriter {
    /// A writer of files with any number of units, for callers that name the format.
    pub(crate) const fn new(write: WriteScene) -> Self {
        Self { is_default_for: |_, _| false, writes_folders: false, holds_one_unit: false, can_reorder: false, write }
    }
}

/// A row of the registry. Two formats are equal if their names are.
#[derive(Clone, Copy)]
pub struct Format(pub(crate) &'static dyn SplatFormat);

impl Format {
    /// The name on the command line and in reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.0.name()
    }

    /// One line that describes the format.
    #[must_use]
    pub fn description(self) -> &'static str {
        self.0.description()
    }

    /// Endings of file names, in lower case with the dot.
    #[must_use]
    pub fn extensions(self) -> &'static [&'static str] {
        self.0.extensions()
    }

    /// Whether the format can be written.
    #[must_use]
    pub fn is_writable(self) -> bool {
        self.0.writer().is_some()
    }
}

impl PartialEq for Format {
    fn eq(&self, other: &Self) -> bool {
        self.name() == other.name()
    }
}

impl Eq for Format {}

impl Hash for Format {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.name().hash(state);
    }
}

impl fmt::Debug for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Format({})", self.name())
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl Serialize for Format {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

/// The evidence by which formats recognise a file or folder.
#[derive(Debug)]
pub(crate) struct Source {
    /// File name in lower case.
    pub(crate) name: String,
    /// Whether it is a folder, and whether the folder has a `scene.toml`.
    pub(crate) folder: Option<FolderContent>,
    /// The first bytes of a file, at most [`START_LENGTH`].
    pub(crate) start: Vec<u8>,
}

/// The evidence in a folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct FolderContent {
    /// Whether it has a `scene.toml`.
    pub(crate) has_scene_file: bool,
}

/// Bytes of a file that formats may look at.
pub(crate) const START_LENGTH: u64 = 64;

impl Source {
    /// Whether the content starts as a PLY file does.
    pub(crate) fn is_ply(&self) -> bool {
        self.folder.is_none() && self.start.starts_with(b"ply")
    }

    /// Whether it is a file with one of these endings.
    pub(crate) fn has_extension(&self, extensions: &[&str]) -> bool {
        self.folder.is_none() && extensions.iter().any(|e| self.name.ends_with(e))
    }
}

/// The unit files of a scene.
#[derive(Debug)]
pub(crate) struct Listing {
    /// In scene order.
    pub(crate) units: Vec<UnitSource>,
    /// Present where a scene file lists the units: its format, and the box that it stores.
    pub(crate) scene: Option<(Format, Option<SceneBox>)>,
    /// As far as the files tell it.
    pub(crate) orientation: Orientation,
}

impl Listing {
    /// One file with one unit.
    pub(crate) fn of_file(path: &Path) -> Self {
        let unit = UnitSource { path: path.to_path_buf(), entry: None, name: None };
        Self { units: vec![unit], scene: None, orientation: Orientation::default() }
    }
}

/// The file of one unit.
#[derive(Debug)]
pub(crate) struct UnitSource {
    /// The file.
    pub(crate) path: PathBuf,
    /// The unit's entry in the scene file.
    pub(crate) entry: Option<UnitEntry>,
    /// The name of the unit's folder.
    pub(crate) name: Option<String>,
}

/// The Gaussians of one file, with activated shading columns.
#[derive(Debug, Clone)]
pub(crate) struct Decoded {
    pub(crate) gaussians: Gaussians,
    pub(crate) format: Format,
    pub(crate) convention: Convention,
    pub(crate) comments: UnitComments,
}

/// A scene that cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// A file could not be read.
    #[error("{path}: {source}; give the path of a Gaussian file, a scene.toml or an iVR-GS output folder")]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// A file's content cannot be used.
    #[error("{path}: {problem}")]
    Content {
        /// The file.
        path: PathBuf,
        /// Place and cause.
        problem: Problem,
    },
    /// A `scene.toml` cannot be used.
    #[error(transparent)]
    SceneFile(#[from] SceneFileError),
}

/// Options of a save.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct SaveOptions {
    /// The format. Without it, the path's ending and the scene's columns decide.
    pub format: Option<Format>,
    /// For iVR-GS: the activation of the shading columns. Without it the unit's own, or `head-raw` for float and
    /// `head-activated` for quantised files.
    pub convention: Option<Convention>,
    /// For the compressed PLY: Morton order. It packs better but changes every Gaussian's index.
    pub reorder: bool,
}

/// A scene on its way to a file or folder.
#[derive(Debug)]
pub(crate) struct WriteJob<'a> {
    pub(crate) path: &'a Path,
    pub(crate) scene: &'a Scene,
    pub(crate) options: &'a SaveOptions,
    /// Whether the path is to become a folder.
    pub(crate) is_folder: bool,
}

impl WriteJob<'_> {
    /// Writes the scene as the one file that `fill` fills: under a temporary name first, then in its place.
    ///
    /// # Errors
    /// The error of `fill` or of the system; the old file stays.
    pub(crate) fn write_file(
        &self,
        fill: impl FnOnce(&mut StagedFile) -> Result<(), WriteProblem>,
    ) -> Result<Vec<PathBuf>, WriteProblem> {
        let mut out = StagedFile::create(self.path)?;
        fill(&mut out)?;
        out.commit()?;
        staged_file::sync_folder(self.path)?;
        Ok(vec![self.path.to_path_buf()])
    }
}

/// The reason why a file could not be written.
#[derive(Debug)]
pub(crate) enum WriteProblem {
    Io(io::Error),
    Unsuitable(Problem),
}

impl From<io::Error> for WriteProblem {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

impl From<Problem> for WriteProblem {
    fn from(problem: Problem) -> Self {
        Self::Unsuitable(problem)
    }
}
