//! Formats whose units are PLY files. Each is one row: a value of [`PlyFormat`].

use std::path::{Path, PathBuf};

use crate::splat::format::{Listing, LoadError, PlyLayout, Source, SplatFormat, SplatWriter, UnitSource};
use crate::splat::problem::Problem;
use sg_scene::orientation::Orientation;

/// A format whose units are PLY files.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PlyFormat {
    /// The name on the command line and in reports.
    pub(crate) name: &'static str,
    /// One line for help texts, without a full stop.
    pub(crate) description: &'static str,
    /// Endings of file names, in lower case with the dot.
    pub(crate) extensions: &'static [&'static str],
    /// How files are read; `None` if the layout of another format reads them.
    pub(crate) layout: Option<PlyLayout>,
    /// For formats that also store scenes as folders.
    pub(crate) find_units: Option<FindUnits>,
    /// Whether iVR-GS trained the units.
    pub(crate) is_ivrgs: bool,
    /// How files are written, if they can be.
    pub(crate) writer: Option<SplatWriter>,
}

/// Names and files of the units in a folder.
pub(crate) type FindUnits = fn(&Path) -> Result<Vec<(String, PathBuf)>, Problem>;

impl PlyFormat {
    /// A format of `.ply` files that can be neither read nor written; a row replaces the other fields.
    pub(crate) const fn new(name: &'static str, description: &'static str) -> Self {
        Self { name, description, extensions: &[".ply"], layout: None, find_units: None, is_ivrgs: false, writer: None }
    }
}

impl SplatFormat for PlyFormat {
    fn name(&self) -> &'static str {
        self.name
    }

    fn description(&self) -> &'static str {
        self.description
    }

    fn extensions(&self) -> &'static [&'static str] {
        self.extensions
    }

    fn sniff(&self, source: &Source) -> bool {
        source.is_ply() || self.find_units.is_some() && source.folder.is_some_and(|f| !f.has_scene_file)
    }

    fn list(&self, path: &Path) -> Result<Listing, LoadError> {
        let Some(find_units) = self.find_units.filter(|_| path.is_dir()) else { return Ok(Listing::of_file(path)) };
        let found = find_units(path).map_err(|problem| LoadError::Content { path: path.to_path_buf(), problem })?;
        let unit = |(name, path)| UnitSource { path, entry: None, name: Some(name) };
        Ok(Listing { units: found.into_iter().map(unit).collect(), scene: None, orientation: Orientation::default() })
    }

    fn ply(&self) -> Option<PlyLayout> {
        self.layout
    }

    fn is_ivrgs(&self) -> bool {
        self.is_ivrgs
    }

    fn writer(&self) -> Option<SplatWriter> {
        self.writer
    }
}
