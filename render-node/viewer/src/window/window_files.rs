//! The files around a window, and the state of its file menu.

use std::path::{Path, PathBuf};

use sg_formats::files::short_name;

use super::file_dialog::FileDialogs;
use super::recent_files::RecentFile;
use super::spacing_dialog::SpacingDialog;

/// Most numbered names that are tried for a suggestion.
const NUMBERS: u32 = 1000;

/// The files around a window.
#[derive(Debug, Clone, Default)]
pub struct WindowFiles {
    /// The file that the person has opened, if the window knows it.
    pub opened: Option<PathBuf>,
    /// Folder of the session for pictures on their way to a chosen name; without one no picture gets a name.
    pub scratch: Option<PathBuf>,
    /// The settings, which keep the recent files.
    pub settings: Option<PathBuf>,
}

/// The state of the file menu.
#[derive(Default)]
pub(super) struct FileMenu {
    pub(super) files: WindowFiles,
    pub(super) dialogs: FileDialogs,
    pub(super) spacing: SpacingDialog,
    pub(super) recent: Vec<RecentFile>,
    /// Whether the menu is shown.
    pub(super) is_open: bool,
    pub(super) picture: PictureOptions,
    /// Folder of the file that was chosen last.
    pub(super) last_folder: Option<PathBuf>,
}

/// How a picture is saved.
#[derive(Debug, Clone, Copy)]
pub(super) struct PictureOptions {
    /// Factor on its size in the window.
    pub(super) scale: u32,
    pub(super) transparent: bool,
}

impl Default for PictureOptions {
    fn default() -> Self {
        Self { scale: 1, transparent: false }
    }
}

impl FileMenu {
    /// A path to suggest: in the folder of the last file, under a free name. `scene` is the scene's path.
    pub(super) fn suggested(&self, scene: &str, pictures: &Path, suffix: &str, ending: &str) -> PathBuf {
        let opened = self.files.opened.as_deref();
        let folder = self.last_folder.as_deref().or_else(|| opened?.parent()).unwrap_or(pictures);
        let stem = short_name(opened.unwrap_or(Path::new(scene)));
        let stem = stem.trim_end_matches(['-', '_']);
        let name = |number: String| folder.join(format!("{stem}{suffix}{number}{ending}"));
        let numbered = (2..NUMBERS).map(|k| name(format!("-{k}")));
        let first = name(String::new());
        std::iter::once(first.clone()).chain(numbered).find(|path| !path.exists()).unwrap_or(first)
    }
}
