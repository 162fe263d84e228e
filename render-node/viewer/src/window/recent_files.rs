//! The files that were opened last, newest first. The window's settings keep them for all windows of a person.

use std::path::{Path, PathBuf};

use super::settings::{RECENT_FILES, Settings, SettingsError};

/// A file of the list.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct RecentFile {
    pub(super) path: PathBuf,
    /// Whether it is still there.
    pub(super) exists: bool,
}

/// Puts an opened file first. A path that is no text has no form in the settings, so it is left out.
fn with_newest(recent: Vec<PathBuf>, file: &Path) -> Vec<PathBuf> {
    let newest = file.to_str().map(PathBuf::from);
    let others = recent.into_iter().filter(|path| path != file);
    newest.into_iter().chain(others).take(RECENT_FILES).collect()
}

/// Records an opened file at once, so that windows that open later know it.
///
/// # Errors
/// [`SettingsError`] if the settings cannot be read or written.
pub(super) fn remember(settings: &Path, file: &Path) -> Result<(), SettingsError> {
    let known = Settings::load(settings)?.unwrap_or_default();
    let recent = with_newest(known.recent.clone(), file);
    if recent == known.recent {
        return Ok(());
    }
    Settings { recent, ..known }.save(settings)
}

/// The list as the settings have it now, without the window's own file. Unreadable settings have none.
pub(super) fn load(settings: &Path, own: Option<&Path>) -> Vec<RecentFile> {
    let recent = stored(settings).into_iter().filter(|path| Some(path.as_path()) != own);
    recent.map(|path| RecentFile { exists: path.exists(), path }).collect()
}

/// The paths as the settings have them now.
pub(super) fn stored(settings: &Path) -> Vec<PathBuf> {
    Settings::load(settings).ok().flatten().map_or_else(Vec::new, |known| known.recent)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_file_comes_first_and_ten_are_kept() {
        let folder = tempfile::tempdir().unwrap();
        let settings = folder.path().join("window.toml");
        Settings { radius: 0.1, ..Settings::default() }.save(&settings).unwrap();
        let there = folder.path().join("heart.ply");
        std::fs::write(&there, "ply").unwrap();
        for k in 0..12 {
            remember(&settings, Path::new(&format!("/data/{k}.ply"))).unwrap();
        }
        remember(&settings, &there).unwrap();
        remember(&settings, Path::new("/data/7.ply")).unwrap();
        let names = |files: &[RecentFile]| -> Vec<String> {
            files.iter().map(|f| f.path.file_name().unwrap().to_string_lossy().into_owned()).collect()
        };
        let files = load(&settings, None);
        assert_eq!(
            names(&files),
            ["7.ply", "heart.ply", "11.ply", "10.ply", "9.ply", "8.ply", "6.ply", "5.ply", "4.ply", "3.ply"]
        );
        assert_eq!(files.iter().filter(|f| f.exists).count(), 1);
        assert_eq!(load(&settings, Some(&there)).len(), 9);
        assert_eq!(Settings::load(&settings).unwrap().unwrap().radius, 0.1);
    }
}
