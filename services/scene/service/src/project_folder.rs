//! The folder of the projects that no launch file names, in the user's data folder.

use std::fs::DirBuilder;
use std::io::{Error, ErrorKind};
use std::os::unix::fs::DirBuilderExt as _;
use std::path::{Component, Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use directories::ProjectDirs;
use serde::Serialize;
use sg_formats::files::short_name;
use sg_scene::model::Scene;
use supergaussian_scene::journal::{self, JournalError, ProjectLock};

use crate::kept_scenes::{KeptScene, KeptScenes};

/// Ending of a project file.
const ENDING: &str = "sgproj";
/// Letters of the scene's key in a project's name.
const KEY: usize = 12;
/// Endings of the files that SQLite keeps beside a project.
const BESIDE: [&str; 3] = ["-wal", "-shm", "-journal"];

/// A project cannot be found, made, listed or deleted.
#[derive(Debug, thiserror::Error)]
pub(crate) enum FolderError {
    /// The user has no home folder.
    #[error("no folder for projects: set HOME or XDG_DATA_HOME, or name a project file")]
    NoHome,
    /// A name is no name of a project.
    #[error("there is no project `{0}`; `supergaussian projects` lists them")]
    Unknown(String),
    /// The folder or a file in it cannot be used.
    #[error("{path}: {source}")]
    Storage {
        /// The file or folder.
        path: PathBuf,
        /// The system's error.
        source: Error,
    },
    /// The project itself.
    #[error(transparent)]
    Journal(#[from] JournalError),
}

impl FolderError {
    /// Whether the arguments are wrong, so that trying again would not help.
    pub(crate) fn is_input(&self) -> bool {
        match self {
            Self::NoHome | Self::Unknown(_) => true,
            Self::Storage { .. } => false,
            Self::Journal(error) => error.is_input(),
        }
    }
}

/// One project of the folder, or a kept scene without a project.
#[derive(Debug, Serialize)]
pub(crate) struct Listed {
    name: String,
    /// The project's file; absent for a scene without a project.
    path: Option<PathBuf>,
    /// The scene's file when the project was last opened; absent for a file that cannot be read.
    scene: Option<PathBuf>,
    /// Number of accepted commands.
    revision: Option<u64>,
    /// Size on disk, with SQLite's log.
    bytes: u64,
    /// Size of its scene, if that was made from a volume and is kept with the projects; else 0.
    scene_bytes: u64,
    /// Last change, seconds since 1970.
    changed: u64,
    /// Whether a process has it.
    in_use: bool,
    /// Why the file cannot be read.
    error: Option<String>,
}

/// Where things are kept.
#[derive(Debug, Serialize)]
pub(crate) struct Places<'a> {
    projects: &'a Path,
    scenes: &'a Path,
}

/// The folder of projects, and that of the scenes that were made from volumes.
#[derive(Debug)]
pub(crate) struct ProjectFolder {
    projects: PathBuf,
    scenes: KeptScenes,
}

impl ProjectFolder {
    /// The folder of this user; it may not exist yet.
    pub(crate) fn of_user() -> Result<Self, FolderError> {
        let folders = ProjectDirs::from("", "", "supergaussian").ok_or(FolderError::NoHome)?;
        Ok(Self::below(folders.data_dir()))
    }

    fn below(data: &Path) -> Self {
        Self { projects: data.join("projects"), scenes: KeptScenes::new(data.join("scenes")) }
    }

    pub(crate) fn places(&self) -> Places<'_> {
        Places { projects: &self.projects, scenes: self.scenes.folder() }
    }

    /// The project of a scene: the one that was made for this content, or the path of a new one. Makes the folder.
    ///
    /// The scene's path gives a new project its readable name only, so a scene that was moved keeps its project.
    pub(crate) fn project_of(&self, scene: &Scene, scene_path: &Path) -> Result<PathBuf, FolderError> {
        self.make()?;
        let end = format!("-{}", key(scene));
        let name = self.names()?.into_iter().find(|name| name.ends_with(&end));
        Ok(self.path(&name.unwrap_or_else(|| format!("{}{end}", short_name(scene_path)))))
    }

    /// All projects and the kept scenes without one, the newest change first.
    pub(crate) fn list(&self) -> Result<Vec<Listed>, FolderError> {
        let mut all: Vec<_> = self.names()?.into_iter().map(|name| self.listed(name)).collect();
        let used: Vec<_> = all.iter().filter_map(|l| self.scenes.at(l.scene.as_deref()?)).collect();
        all.extend(self.kept_scenes()?.into_iter().filter(|scene| !used.contains(scene)).map(|scene| Listed {
            path: None,
            bytes: 0,
            scene_bytes: scene.bytes(),
            changed: seconds(scene.made()),
            in_use: false,
            revision: None,
            error: None,
            name: scene.name,
            scene: Some(scene.path),
        }));
        all.sort_by(|a, b| b.changed.cmp(&a.changed).then_with(|| a.name.cmp(&b.name)));
        Ok(all)
    }

    fn listed(&self, name: String) -> Listed {
        let path = self.path(&name);
        let files: Vec<_> =
            [path.clone(), beside(&path, "-wal")].iter().filter_map(|file| std::fs::metadata(file).ok()).collect();
        let changed = files.iter().filter_map(|file| file.modified().ok()).max().unwrap_or(UNIX_EPOCH);
        let described = journal::describe(&path);
        Listed {
            bytes: files.iter().map(std::fs::Metadata::len).sum(),
            changed: seconds(changed),
            in_use: journal::is_in_use(&path),
            scene_bytes: described.as_ref().ok().and_then(|d| self.scenes.at(&d.scene)).map_or(0, |s| s.bytes()),
            revision: described.as_ref().ok().map(|d| d.revision),
            error: described.as_ref().err().map(ToString::to_string),
            scene: described.ok().map(|d| d.scene),
            name,
            path: Some(path),
        }
    }

    fn kept_scenes(&self) -> Result<Vec<KeptScene>, FolderError> {
        self.scenes.list().map_err(|source| FolderError::Storage { path: self.scenes.folder().into(), source })
    }

    /// Whether a project has this scene. One that cannot be read might.
    fn has_project(&self, scene: &KeptScene) -> Result<bool, FolderError> {
        let described = self.names()?.into_iter().map(|name| journal::describe(&self.path(&name)));
        let mut projects = described.filter(|d| !matches!(d, Err(JournalError::NotAProject { .. })));
        Ok(projects.any(|d| d.map_or(true, |d| self.scenes.at(&d.scene).as_ref() == Some(scene))))
    }

    /// The file that an argument means: a path, or the name of a project in this folder.
    pub(crate) fn meant(&self, argument: &Path) -> PathBuf {
        let is_path = argument.components().count() != 1 || argument.extension().is_some_and(|e| e == ENDING);
        if is_path { argument.to_owned() } else { self.path(&argument.to_string_lossy()) }
    }

    /// As [`ProjectFolder::meant`], for a file that is to be made. Makes the folder if the file goes there.
    pub(crate) fn for_new(&self, argument: &Path) -> Result<PathBuf, FolderError> {
        let path = self.meant(argument);
        if path.parent() == Some(&self.projects) {
            self.make()?;
        }
        Ok(path)
    }

    fn make(&self) -> Result<(), FolderError> {
        let fail = |source| FolderError::Storage { path: self.projects.clone(), source };
        DirBuilder::new().recursive(true).mode(0o700).create(&self.projects).map_err(fail)
    }

    /// Deletes a project with the files that SQLite keeps beside it. Its scene goes too if it was made from a volume and no
    /// other project has it. A kept scene without a project is deleted by its own name. Returns the deleted paths.
    pub(crate) fn delete(&self, name: &str) -> Result<Vec<PathBuf>, FolderError> {
        let mut parts = Path::new(name).components();
        let path = self.path(name);
        let is_name = matches!((parts.next(), parts.next()), (Some(Component::Normal(_)), None));
        if !is_name || !path.is_file() {
            return self.delete_scene(name);
        }
        // A file that is no project is somebody else's.
        let _lock = ProjectLock::existing(&path)?;
        let scene = match journal::describe(&path) {
            Ok(described) => self.scenes.at(&described.scene),
            Err(error @ JournalError::NotAProject { .. }) => return Err(error.into()),
            Err(_) => None,
        };
        for file in BESIDE.iter().map(|end| beside(&path, end)).chain([path.clone()]) {
            match std::fs::remove_file(&file) {
                Err(source) if source.kind() != ErrorKind::NotFound => {
                    return Err(FolderError::Storage { path: file, source });
                }
                _ => {}
            }
        }
        let mut deleted = vec![path];
        if let Some(scene) = scene
            && !self.has_project(&scene)?
        {
            scene.delete().map_err(|source| FolderError::Storage { path: scene.folder.clone(), source })?;
            deleted.push(scene.folder);
        }
        Ok(deleted)
    }

    fn delete_scene(&self, name: &str) -> Result<Vec<PathBuf>, FolderError> {
        let scene = self.kept_scenes()?.into_iter().find(|scene| scene.name == name);
        let scene = scene.ok_or_else(|| FolderError::Unknown(name.to_owned()))?;
        if self.has_project(&scene)? {
            return Err(FolderError::Unknown(name.to_owned()));
        }
        scene.delete().map_err(|source| FolderError::Storage { path: scene.folder.clone(), source })?;
        Ok(vec![scene.folder])
    }

    /// Names of the projects, sorted.
    fn names(&self) -> Result<Vec<String>, FolderError> {
        let fail = |source| FolderError::Storage { path: self.projects.clone(), source };
        let entries = match std::fs::read_dir(&self.projects) {
            Ok(entries) => entries,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
            Err(error) => return Err(fail(error)),
        };
        let mut names = Vec::new();
        for entry in entries {
            let path = entry.map_err(fail)?.path();
            let is_project = path.extension().is_some_and(|e| e == ENDING) && path.is_file();
            names.extend(path.file_stem().filter(|_| is_project).and_then(|name| name.to_str()).map(str::to_owned));
        }
        names.sort_unstable();
        Ok(names)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.projects.join(format!("{name}.{ENDING}"))
    }
}

/// The part of a project's name that tells scenes apart. It covers what a project and its scene must have in common: the
/// geometry, the names of the base units, and the box for strokes.
fn key(scene: &Scene) -> String {
    let mut hasher = blake3::Hasher::new_derive_key("supergaussian project of scene 1");
    hasher.update(scene.content_hash().as_bytes());
    for unit in &scene.units {
        hasher.update(&(unit.name.len() as u64).to_le_bytes()).update(unit.name.as_bytes());
    }
    for number in [scene.bounds.min, scene.bounds.max].iter().flat_map(glam::DVec3::to_array) {
        hasher.update(&number.to_le_bytes());
    }
    hasher.finalize().to_hex().chars().take(KEY).collect()
}

fn beside(path: &Path, end: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(end);
    name.into()
}

fn seconds(time: SystemTime) -> u64 {
    time.duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs())
}

#[cfg(test)]
mod tests {
    use super::*;
    use sg_edit::EditState;
    use sg_scene::synthetic::test_scene;
    use std::sync::Arc;
    use supergaussian_scene::project::Project;

    fn folder() -> (tempfile::TempDir, ProjectFolder) {
        let home = tempfile::tempdir().unwrap();
        let folder = ProjectFolder::below(home.path());
        (home, folder)
    }

    fn open(path: &Path, scene: Scene, scene_path: &str) -> Project {
        Project::open(path, Arc::new(scene), scene_path).unwrap()
    }

    #[test]
    fn each_scene_has_its_own_project_and_keeps_it_when_it_moves() {
        let (_home, folder) = folder();
        let of = |scene: &Scene, path: &str| folder.project_of(scene, Path::new(path)).unwrap();
        let bone = test_scene(&[("bone", 5)]);
        let first = of(&bone, "/data/skull/scene.toml");
        let name = first.file_stem().unwrap().to_str().unwrap();
        assert!(name.starts_with("skull-") && name.len() == "skull-".len() + KEY, "{name}");
        drop(open(&first, bone.clone(), "/data/skull/scene.toml"));
        assert_eq!(of(&bone, "/elsewhere/moved.ply"), first);
        // What would make the journal refuse a scene makes another project.
        let mut boxed = bone.clone();
        boxed.bounds.max.x += 1.0;
        for other in [test_scene(&[("bone", 6)]), test_scene(&[("skin", 5)]), boxed] {
            let state = EditState::of_scene(&other, "", "");
            assert_ne!(of(&other, "/data/skull/scene.toml"), first, "{:?}", state.base_units());
        }
    }

    #[test]
    fn projects_are_listed_and_deleted_with_their_own_files_only() {
        let (home, folder) = folder();
        assert_eq!(folder.list().unwrap().len(), 0);
        let scene = test_scene(&[("bone", 5)]);
        let path = folder.project_of(&scene, Path::new("/data/tooth.ply")).unwrap();
        let project = open(&path, scene, "/data/tooth.ply");
        let notes = home.path().join("projects/notes.sgproj");
        std::fs::write(&notes, "mine").unwrap();
        let listed = folder.list().unwrap();
        let of = |name: &str| listed.iter().find(|l| l.name.starts_with(name)).unwrap();
        let tooth = of("tooth-");
        assert!(tooth.in_use && tooth.bytes > 0 && tooth.error.is_none() && tooth.revision == Some(0), "{tooth:?}");
        assert_eq!(tooth.scene.as_deref(), Some(Path::new("/data/tooth.ply")));
        assert!(of("notes").error.is_some(), "{listed:?}");

        let used = folder.delete(&tooth.name).unwrap_err();
        assert!(matches!(used, FolderError::Journal(JournalError::InUse { .. })), "{used}");
        assert!(path.exists());
        drop(project);
        for other in ["notes", "none", "", "..", "../projects/notes", "/etc/passwd"] {
            assert!(folder.delete(other).unwrap_err().is_input(), "{other}");
        }
        assert_eq!(std::fs::read_to_string(&notes).unwrap(), "mine");
        assert_eq!(folder.delete(&tooth.name).unwrap(), [path]);
        let left: Vec<_> =
            std::fs::read_dir(home.path().join("projects")).unwrap().map(|e| e.unwrap().path()).collect();
        assert_eq!(left, [notes]);
    }

    #[test]
    fn a_kept_scene_goes_with_its_last_project() {
        let (home, folder) = folder();
        let made = |key: &str| {
            let path = home.path().join("scenes").join(key).join("tooth/scene.toml");
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(&path, "four").unwrap();
            path
        };
        let (scene, spare) = (made("aa"), made("bb"));
        made(".staged-x");
        let bone = test_scene(&[("bone", 5)]);
        let path = folder.project_of(&bone, &scene).unwrap();
        let second = folder.for_new(Path::new("second")).unwrap();
        for project in [&path, &second] {
            drop(open(project, bone.clone(), scene.to_str().unwrap()));
        }
        let elsewhere = folder.project_of(&test_scene(&[("bone", 6)]), Path::new("/data/skull.ply")).unwrap();
        drop(open(&elsewhere, test_scene(&[("bone", 6)]), "/data/skull.ply"));
        let listed = folder.list().unwrap();
        let of = |name: &str| listed.iter().find(|l| l.name.starts_with(name)).unwrap();
        assert_eq!((listed.len(), of("skull-").scene_bytes, of("second").scene_bytes), (4, 0, 4), "{listed:?}");
        let lonely = of("tooth-bb");
        assert!(lonely.path.is_none() && lonely.scene_bytes == 4 && lonely.error.is_none(), "{lonely:?}");
        // The name of a scene that a project has means nothing.
        assert!(matches!(folder.delete("tooth-aa"), Err(FolderError::Unknown(_))));
        assert_eq!(folder.delete("second").unwrap(), [second]);
        assert!(scene.exists(), "the other project has it");
        let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
        assert!(name.starts_with("tooth-"), "{name}");
        let folder_of = |scene: &Path| scene.ancestors().nth(2).unwrap().canonicalize().unwrap();
        let (key, other) = (folder_of(&scene), folder_of(&spare));
        assert_eq!(folder.delete(&name).unwrap(), [path, key]);
        assert!(!scene.exists() && spare.exists() && elsewhere.exists());
        assert_eq!(folder.delete("tooth-bb").unwrap(), [other]);
        assert_eq!(folder.list().unwrap().len(), 1);
    }

    #[test]
    fn a_name_means_a_project_of_the_folder_and_a_path_itself() {
        let folder = ProjectFolder::below(Path::new("/data"));
        let meant = |argument: &str| folder.meant(Path::new(argument));
        assert_eq!(meant("tooth"), Path::new("/data/projects/tooth.sgproj"));
        assert_eq!(meant("tooth.sgproj"), Path::new("tooth.sgproj"));
        assert_eq!(meant("./tooth"), Path::new("./tooth"));
        assert_eq!(meant("a/b.db"), Path::new("a/b.db"));
    }
}
