//! The files of a scene, for readers on other machines, and short names of scenes.

use std::path::{Component, Path, PathBuf};

use crate::load::palette_file;
use sg_scene::model::Scene;

/// The files of a scene, below one folder.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SceneFiles {
    /// The folder.
    pub folder: PathBuf,
    /// The path to open, relative to the folder; empty for the folder itself.
    pub open: String,
    /// Every file, relative to the folder, `/` between parts, sorted.
    pub names: Vec<String>,
}

/// A file of a scene lies outside its folder, so a copy would miss it.
#[derive(Debug, thiserror::Error)]
#[error("{file}: lies outside {folder}; put it beside the scene's file, so that other machines can copy all of it")]
pub struct OutsideError {
    /// The file.
    pub file: PathBuf,
    /// The scene's folder.
    pub folder: PathBuf,
}

/// The files of `scene`, opened as `path`: its scene file, its units' files, and palettes beside them.
///
/// # Errors
/// [`OutsideError`] if a `scene.toml` names a unit's file outside of its folder.
pub fn files_of(scene: &Scene, path: &Path) -> Result<SceneFiles, OutsideError> {
    let is_folder = path.is_dir();
    let path = if is_folder { real(path) } else { real_place(path) };
    let folder = if is_folder { path.as_path() } else { path.parent().unwrap_or(Path::new("")) };
    let opened = if is_folder { path.join("scene.toml") } else { path.clone() };
    let units = scene.units.iter().filter_map(|u| u.file.as_deref().map(real_place));
    let files = units.flat_map(|file| palette_file(&file).into_iter().chain([file]));
    let all = files.chain(opened.is_file().then_some(opened));
    let mut names = all.map(|file| below(folder, &file)).collect::<Result<Vec<_>, _>>()?;
    names.sort_unstable();
    names.dedup();
    let open = if is_folder { String::new() } else { below(folder, &path)? };
    Ok(SceneFiles { folder: folder.to_owned(), open, names })
}

/// Most letters of [`short_name`].
const SHORT_NAME: usize = 24;

/// A short name for a scene or volume, from its path: ASCII letters, digits, `-` and `_`, at most 24 of them.
///
/// Scene files share one name, so the name of the folder stands for `scene.toml`.
#[must_use]
pub fn short_name(path: &Path) -> String {
    let stem = |name: Option<&std::ffi::OsStr>| {
        let name = name.unwrap_or_default().to_string_lossy().into_owned();
        name.split('.').find(|part| !part.is_empty()).unwrap_or_default().to_owned()
    };
    let own = stem(path.file_name());
    let own = if own == "scene" { stem(path.parent().and_then(Path::file_name)) } else { own };
    own.chars().map(|c| if c.is_ascii_alphanumeric() || c == '_' { c } else { '-' }).take(SHORT_NAME).collect()
}

/// The canonical name of a folder. Callers may name it relative to their working folder, or by links.
fn real(folder: &Path) -> PathBuf {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    std::fs::canonicalize(folder).unwrap_or_else(|_| folder.to_owned())
}

/// A file in its folder's own name; a file that is a link stays where the link is.
fn real_place(file: &Path) -> PathBuf {
    match (file.parent(), file.file_name()) {
        (Some(folder), Some(name)) => real(folder).join(name),
        _ => file.to_owned(),
    }
}

fn below(folder: &Path, file: &Path) -> Result<String, OutsideError> {
    let outside = || OutsideError { file: file.to_owned(), folder: folder.to_owned() };
    let parts = file.strip_prefix(folder).map_err(|_| outside())?.components();
    let part = |c: Component<'_>| match c {
        Component::Normal(name) => name.to_str().map(str::to_owned).map(Some).ok_or_else(outside),
        Component::CurDir => Ok(None),
        _ => Err(outside()),
    };
    let parts = parts.map(part).collect::<Result<Vec<_>, _>>()?;
    Ok(parts.into_iter().flatten().collect::<Vec<_>>().join("/"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::load::{LoadOptions, load};
    use crate::save::{SaveOptions, save};
    use sg_scene::synthetic::test_scene;

    #[test]
    fn a_copy_of_the_files_is_the_scene() {
        let folder = tempfile::tempdir().unwrap();
        let scene = test_scene(&[("bone", 30), ("skin", 50)]);
        let path = folder.path().join("home/scene.toml");
        std::fs::create_dir(folder.path().join("home")).unwrap();
        save(&path, &scene, &SaveOptions::default()).unwrap();
        for opened in [path.clone(), folder.path().join("home")] {
            let loaded = load(&opened, &LoadOptions::default()).unwrap().scene;
            let files = files_of(&loaded, &opened).unwrap();
            let copy = tempfile::tempdir().unwrap();
            for name in &files.names {
                let to = copy.path().join(name);
                std::fs::create_dir_all(to.parent().unwrap()).unwrap();
                std::fs::copy(files.folder.join(name), to).unwrap();
            }
            let copied = load(&copy.path().join(&files.open), &LoadOptions::default()).unwrap().scene;
            assert_eq!(copied.content_hash(), loaded.content_hash());
        }
    }

    #[test]
    fn a_file_is_found_under_any_name_of_its_folder() {
        let folder = tempfile::tempdir().unwrap();
        let home = folder.path().join("home");
        std::fs::create_dir(&home).unwrap();
        save(&home.join("scene.toml"), &test_scene(&[("bone", 5)]), &SaveOptions::default()).unwrap();
        let link = folder.path().join("link");
        std::os::unix::fs::symlink(&home, &link).unwrap();
        // Opened by one name, listed by another, as by a process that has another working folder.
        let loaded = load(&link.join("../link/scene.toml"), &LoadOptions::default()).unwrap().scene;
        let files = files_of(&loaded, &home.join("scene.toml")).unwrap();
        assert_eq!((files.open.as_str(), files.names.len()), ("scene.toml", 2));
        assert!(files.names.iter().all(|n| files.folder.join(n).is_file()));
    }

    #[test]
    fn files_outside_the_folder_are_refused() {
        assert_eq!(below(Path::new("/a"), Path::new("/a/./b/c.ply")).unwrap(), "b/c.ply");
        for out in ["/b/c.ply", "/a/../c.ply"] {
            assert!(below(Path::new("/a"), Path::new(out)).is_err(), "{out}");
        }
    }
}
