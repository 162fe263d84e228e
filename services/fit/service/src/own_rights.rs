//! The rights of the fit's process. It reads files of others, so it keeps nothing but its inputs and its outputs.

use std::fs::DirBuilder;
use std::io;
use std::os::unix::fs::DirBuilderExt as _;
use std::path::{Path, PathBuf};

use sg_confinement::{Rights, confine};

use crate::arguments::FitArgs;
use crate::failure::{Failure, work};

/// What tells the number of cores.
const STATE: [&str; 3] = ["/proc", "/sys/devices/system/cpu", "/sys/fs/cgroup"];

/// Files of a run.
#[derive(Debug, Default)]
struct Files<'a> {
    /// Volumes. Data of a header without data lies in the header's folder, and steps of a series in that of the series.
    volumes: Vec<&'a Path>,
    /// Other files to read.
    inputs: Vec<&'a Path>,
    /// A scene to read, with the files beside it that it names.
    scene: Option<&'a Path>,
    /// Folder of the new scene; made here, because the process may not make it later.
    folder: Option<&'a Path>,
    /// Whether a folder that is made is for this user alone.
    private: bool,
    /// Files to write. Each is written beside its place first, so its folder can be written.
    outputs: Vec<&'a Path>,
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

/// Gives up all rights but those on the files of a run, unless the user keeps them. `place` is the folder of the new scene.
pub(crate) fn confined(args: &FitArgs, place: &Path) -> Result<MadeFolders, Failure> {
    if args.unconfined {
        return Ok(MadeFolders::default());
    }
    let files = Files {
        volumes: args.volumes.iter().map(PathBuf::as_path).chain(args.labels.as_deref()).collect(),
        inputs: args.transfer_function.as_deref().into_iter().chain(args.label_names.as_deref()).collect(),
        scene: args.start.as_deref(),
        folder: Some(place),
        private: args.keep_in.is_some(),
        outputs: args.out_truth.as_deref().into_iter().chain(args.report.as_deref()).collect(),
    };
    keep_only(&files).map_err(|e| work(format!("{}: {e}; give a writable folder", place.display())))
}

/// Gives up all rights but those on these files, for this process and its threads to come. A kernel without Landlock leaves them
/// as they are.
///
/// # Errors
/// The folder of the scene cannot be made, or the kernel refuses.
fn keep_only(files: &Files<'_>) -> io::Result<MadeFolders> {
    let mut rights = Rights::none();
    rights.read.extend(STATE.map(PathBuf::from));
    rights.read.extend(files.inputs.iter().chain(&files.volumes).map(|path| path.to_path_buf()));
    let headers =
        files.volumes.iter().filter(|volume| sg_volume::reads_beside(volume) || sg_volume::is_series_path(volume));
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
