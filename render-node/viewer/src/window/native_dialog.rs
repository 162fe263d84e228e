//! File dialogs of the desktop, through its portal. Each has a thread of its own, so that the window goes on drawing.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, sync_channel};

use sg_input::file;
use sg_input::limits::SMALL_TEXT_BYTES;
use winit::window::Window;

use super::file_purpose::FilePurpose;

/// Environment variable with the address of the session's bus.
const SESSION_BUS: &str = "DBUS_SESSION_BUS_ADDRESS";

/// Description of the portal's service, below a folder of shared data.
const PORTAL: &str = "dbus-1/services/org.freedesktop.portal.Desktop.service";

/// Descriptions of the portal's back ends, below a folder of shared data.
const BACK_ENDS: &str = "xdg-desktop-portal/portals";

/// Interface of back ends that have file dialogs.
const FILE_CHOOSER: &str = "org.freedesktop.impl.portal.FileChooser";

/// The desktop's dialogs, over a window.
pub(super) struct NativeDialogs {
    window: Arc<Window>,
    wake: Arc<dyn Fn() + Send + Sync>,
}

impl NativeDialogs {
    /// Dialogs over `window`, if the desktop has some: a bus of the session, a portal on it, and a back end with file dialogs.
    /// `wake` is called when a dialog closes.
    pub(super) fn new(window: Arc<Window>, wake: Arc<dyn Fn() + Send + Sync>) -> Option<Self> {
        let has_bus = std::env::var_os(SESSION_BUS).is_some_and(|address| !address.is_empty());
        (has_bus && has_portal(&data_folders())).then_some(Self { window, wake })
    }

    /// Opens a dialog that suggests a path. The receiver gets the chosen path, or `None` without one.
    ///
    /// # Errors
    /// The system's error if it cannot start a thread.
    pub(super) fn ask(&self, purpose: &FilePurpose, suggested: &Path) -> io::Result<Receiver<Option<PathBuf>>> {
        let mut dialog = rfd::FileDialog::new().set_parent(&*self.window).set_title(purpose.title());
        if let Some(folder) = suggested.parent() {
            dialog = dialog.set_directory(folder);
        }
        if let Some(name) = suggested.file_name().filter(|_| purpose.saves()) {
            dialog = dialog.set_file_name(name.to_string_lossy());
        }
        for (name, endings) in purpose.filters() {
            let endings: Vec<_> = endings.iter().map(|ending| ending.trim_start_matches('.')).collect();
            dialog = dialog.add_filter(name, &endings);
        }
        let (sender, receiver) = sync_channel(1);
        let (saves, wake) = (purpose.saves(), Arc::clone(&self.wake));
        let body = move || {
            let chosen = if saves { dialog.save_file() } else { dialog.pick_file() };
            // A window that has closed needs no answer.
            let _ = sender.try_send(chosen);
            wake();
        };
        std::thread::Builder::new().name("file dialog".to_owned()).spawn(body)?;
        Ok(receiver)
    }
}

/// Folders of shared data, by the rules of XDG.
fn data_folders() -> Vec<PathBuf> {
    let folders = std::env::var_os("XDG_DATA_DIRS").filter(|folders| !folders.is_empty());
    let folders = folders.unwrap_or_else(|| "/usr/local/share:/usr/share".into());
    std::env::split_paths(&folders).filter(|folder| folder.is_absolute()).collect()
}

/// Whether the portal is installed, with a back end that has file dialogs.
fn has_portal(folders: &[PathBuf]) -> bool {
    let offers_files = |description: &Path| {
        let text = file::read_text(description, SMALL_TEXT_BYTES).unwrap_or_default();
        text.lines().filter_map(|line| line.trim().strip_prefix("Interfaces=")).any(|line| line.contains(FILE_CHOOSER))
    };
    let back_ends = |folder: &PathBuf| std::fs::read_dir(folder.join(BACK_ENDS)).into_iter().flatten().flatten();
    folders.iter().any(|folder| folder.join(PORTAL).is_file())
        && folders.iter().flat_map(back_ends).any(|entry| offers_files(&entry.path()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_portal_without_file_dialogs_is_none() {
        let folder = tempfile::tempdir().unwrap();
        let folders = [folder.path().join("missing"), folder.path().to_owned()];
        let write = |name: &str, text: &str| {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        };
        assert!(!has_portal(&folders));
        write(PORTAL, "[D-BUS Service]\n");
        write("xdg-desktop-portal/portals/a.portal", "[portal]\nInterfaces=org.freedesktop.impl.portal.Settings\n");
        assert!(!has_portal(&folders));
        write("xdg-desktop-portal/portals/b.portal", &format!("[portal]\nInterfaces=a;{FILE_CHOOSER};\n"));
        assert!(has_portal(&folders));
    }
}
