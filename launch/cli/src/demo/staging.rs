//! What a demo makes before it changes its output folder, so that a refused input leaves no trace there.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use sg_formats::staged_file::check_replaceable;
use tempfile::TempDir;

use super::outputs::OutputFolder;
use crate::densest_strokes;
use crate::input::{Input, Scene};
use crate::shipped::{self, DENSEST, Shipped};
use crate::subcommands::json_of;
use crate::terminal::Failure;
use supergaussian::script::Step;

/// Folders that a demo makes from its input.
const FOLDERS: [&str; 2] = ["volume", "scene"];

/// The demo's scene, and the files for it, in a temporary folder.
pub(super) struct Staging {
    folder: TempDir,
    scene: Scene,
}

impl Staging {
    /// An empty temporary folder with the shipped files.
    pub(super) fn begin(input: &Input) -> Result<(TempDir, Shipped), Failure> {
        let folder = tempfile::tempdir().map_err(|e| Failure::Work(format!("no temporary folder: {e}; set TMPDIR")))?;
        let shipped = shipped::unpack(folder.path(), input.shipped_name())?;
        Ok((folder, shipped))
    }

    /// Makes the scene of the input, and the strokes that these steps need for it.
    pub(super) fn make(
        (folder, shipped): (TempDir, Shipped),
        input: &Input,
        function: Option<&Path>,
        (gaussians, seed): (u32, u64),
        steps: &[Step],
    ) -> Result<Self, Failure> {
        let function = function.or(shipped.transfer_function.as_deref());
        let scene = input.scene(folder.path(), function, gaussians, seed)?;
        if steps.iter().any(|s| matches!(s, Step::Strokes { file, .. } if file.ends_with(DENSEST))) {
            densest_strokes::write(&scene.path, folder.path(), &shipped.densest)?;
        } else if matches!(input, Input::Scene(_)) {
            json_of("scene", &["info".as_ref(), scene.path.as_os_str(), "--json".as_ref()])?;
        }
        Ok(Self { folder, scene })
    }

    /// Prepares the output folder and moves everything to it. Returns the folder, its shipped files and the scene.
    ///
    /// Fails before it changes anything if a file of something else is in the way.
    pub(super) fn finish(self, out: OutputFolder<'_>, input: &Input) -> Result<(PathBuf, Shipped, Scene), Failure> {
        let from = self.folder.path();
        let mut files = vec![Path::new("script").join(DENSEST)];
        for folder in FOLDERS {
            let entries = std::fs::read_dir(from.join(folder)).into_iter().flatten().flatten();
            files.extend(entries.map(|entry| Path::new(folder).join(entry.file_name())));
        }
        files.retain(|file| from.join(file).is_file());
        for file in &files {
            let target = out.path().join(file);
            check_replaceable(&target).map_err(|e| {
                let line = format!("{}: {e}", target.display());
                if e.kind() == ErrorKind::AlreadyExists { Failure::Input(line) } else { Failure::Work(line) }
            })?;
        }
        let out = out.prepare()?;
        let shipped = shipped::unpack(&out, input.shipped_name())?;
        for file in &files {
            let (old, new) = (from.join(file), out.join(file));
            let moved = new.parent().map_or(Ok(()), std::fs::create_dir_all).and_then(|()| move_file(&old, &new));
            moved.map_err(|e| Failure::Work(format!("{}: {e}", new.display())))?;
        }
        let path = self.scene.path.strip_prefix(from).map_or(self.scene.path.clone(), |inside| out.join(inside));
        Ok((out, shipped, Scene { path, ..self.scene }))
    }
}

/// Moves a file, also to another file system.
fn move_file(old: &Path, new: &Path) -> std::io::Result<()> {
    std::fs::rename(old, new).or_else(|_| std::fs::copy(old, new).map(drop))
}
