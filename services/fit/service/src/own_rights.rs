//! The rights of the fit's process. It reads files of others, so it keeps nothing but its inputs and its outputs.

use std::fs::DirBuilder;
use std::io;
use std::os::unix::fs::DirBuilderExt as _;
use std::path::{Path, PathBuf};

use sg_confinement::{Rights, confine};

/// What tells the number of cores.
const STATE: [&str; 3] = ["/proc", "/sys/devices/system/cpu", "/sys/fs/cgroup"];

/// Files of a run.
#[derive(Debug, Default)]
pub(crate) struct Files<'a> {
    /// Volumes. Data of a header without data lies in the header's folder.
    pub(crate) volumes: Vec<&'a Path>,
    /// Other files to read.
    pub(crate) inputs: Vec<&'a Path>,
    /// A scene to read, with the files beside it that it names.
    pub(crate) scene: Option<&'a Path>,
    /// Folder of the new scene; made here, because the process may not make it later.
    pub(crate) folder: Option<&'a Path>,
    /// Whether a folder that is made is for this user alone.
    pub(crate) private: bool,
    /// Files to write. Each is written beside its place first, so its folder can be written.
    pub(crate) outputs: Vec<&'a Path>,
}

/// Folders that were made for the outputs, outermost first. Removed again when dropped, as far as they are empty.
#[derive(Debug, Default)]
#[must_use]
pub(crate) struct MadeFolders(Vec<PathBuf>);

impl Drop for MadeFolders {
    fn drop(&mut self) {
        for folder in self.0.iter().rev() {
            // A folder with outputs stays.
            let _ = std::fs::remove_dir(folder);
        }
    }
}

/// Gives up all rights but those on these files, for this process and its threads to come. A kernel without Landlock leaves them
/// as they are.
///
/// # Errors
/// The folder of the scene cannot be made, or the kernel refuses.
pub(crate) fn keep_only(files: &Files<'_>) -> io::Result<MadeFolders> {
    let mut rights = Rights::none();
    rights.read.extend(STATE.map(PathBuf::from));
    rights.read.extend(files.inputs.iter().chain(&files.volumes).map(|path| path.to_path_buf()));
    let headers = files.volumes.iter().filter(|volume| sg_volume::reads_beside(volume));
    rights.read.extend(headers.map(|header| folder_of(header)));
    rights.read.extend(files.scene.map(folder_of));
    rights.write.extend(files.outputs.iter().map(|output| folder_of(output)));
    let mut made = MadeFolders::default();
    if let Some(folder) = files.folder {
        let missing = folder.ancestors().take_while(|f| !f.as_os_str().is_empty() && !f.exists());
        made.0 = missing.map(Path::to_owned).collect();
        made.0.reverse();
        DirBuilder::new().recursive(true).mode(if files.private { 0o700 } else { 0o777 }).create(folder)?;
        rights.remove_folders.extend(made.0.first().map(|outermost| folder_of(outermost)));
        rights.write.insert(folder.to_owned());
    }
    confine(&rights).map_err(io::Error::other)?;
    Ok(made)
}

/// The folder of a file.
fn folder_of(path: &Path) -> PathBuf {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder.to_owned(),
        _ => PathBuf::from("."),
    }
}
