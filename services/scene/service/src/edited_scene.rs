//! A project as a scene: the opened Gaussians with the edits that the project keeps.

use std::io::Error;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use sg_edit::{EditError, Part};
use sg_formats::{LoadError, LoadOptions, Loaded, load};
use supergaussian_scene::journal::{self, JournalError};
use supergaussian_scene::project::Project;

use crate::project_folder::ProjectFolder;

/// Ending of a project file.
const ENDING: &str = "sgproj";

/// A project that cannot be read as a scene.
#[derive(Debug, thiserror::Error)]
pub(crate) enum EditedError {
    /// The project itself.
    #[error(transparent)]
    Project(#[from] JournalError),
    /// Its scene is not where it was.
    #[error("{project}: its scene cannot be read: {source}; name the scene's present place with --scene")]
    Scene {
        /// The project.
        project: PathBuf,
        /// The reader's error.
        source: LoadError,
    },
    /// The choice of Gaussians fits nothing.
    #[error("{project}: {source}")]
    Part {
        /// The project.
        project: PathBuf,
        /// The reason.
        source: EditError,
    },
    /// No room for a copy.
    #[error("no temporary folder for a copy of the project: {0}; set TMPDIR to a folder with room")]
    Copy(Error),
}

impl EditedError {
    /// Whether the arguments are wrong, so that trying again would not help.
    pub(crate) fn is_input(&self) -> bool {
        match self {
            Self::Project(error) => error.is_input(),
            Self::Scene { .. } | Self::Part { .. } => true,
            Self::Copy(_) => false,
        }
    }
}

/// The project that an argument means: a file with the ending of projects, or a name in the user's folder of projects where no
/// file has that name.
pub(crate) fn project_of(argument: &Path) -> Option<PathBuf> {
    if argument.extension().is_some_and(|e| e == ENDING) {
        return Some(argument.to_owned());
    }
    let named = || ProjectFolder::of_user().ok().map(|folder| folder.meant(argument));
    if argument.exists() { None } else { named().filter(|path| path.is_file()) }
}

/// Gaussians of a project with their edits.
#[derive(Debug)]
pub(crate) struct EditedScene {
    /// The scene, with the warnings of its reader.
    pub(crate) loaded: Loaded,
    /// The file that the Gaussians come from.
    pub(crate) scene_file: PathBuf,
    /// The files of its base units.
    pub(crate) unit_files: Vec<PathBuf>,
}

/// Reads some Gaussians of a project with their edits, also while a session has it. `scene` is the present place of the
/// scene's file where the project names another.
///
/// # Errors
/// [`EditedError`]; the project stays as it is.
pub(crate) fn load_edited(project: &Path, scene: Option<&Path>, part: Part<'_>) -> Result<EditedScene, EditedError> {
    let place = match scene {
        Some(scene) => scene.to_owned(),
        None => journal::describe(project)?.scene,
    };
    let mut loaded = load(&place, &LoadOptions::default())
        .map_err(|source| EditedError::Scene { project: project.to_owned(), source })?;
    let unit_files = loaded.scene.units.iter().filter_map(|unit| unit.file.clone()).collect();
    // A copy of its own: the owner keeps the project, and an older schema is brought up to date in the copy alone.
    let folder = tempfile::tempdir().map_err(EditedError::Copy)?;
    let copy = folder.path().join("copy.sgproj");
    journal::copy(project, &copy)?;
    let opened = Arc::new(loaded.scene);
    let restored = Project::open(&copy, Arc::clone(&opened), &place.to_string_lossy());
    let restored = restored.map_err(|error| error.at(project))?;
    let state = restored.editor().state();
    let edited = state.part(part).and_then(|members| state.edited(&opened, &members));
    loaded.scene = edited.map_err(|source| EditedError::Part { project: project.to_owned(), source })?;
    Ok(EditedScene { loaded, scene_file: place, unit_files })
}
