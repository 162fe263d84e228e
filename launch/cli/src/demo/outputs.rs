//! The output folder of a demo. A demo replaces only files that an earlier demo listed there.

use std::io::ErrorKind;
use std::path::{Component, Path, PathBuf};

use sg_input::file;
use sg_input::limits::SMALL_TEXT_BYTES;

use crate::playback::picture_base;
use crate::terminal::{self, Failure};
use crate::transcript;
use supergaussian::script::Step;

/// Lists the files that the demo wrote into its folder.
const MANIFEST: &str = "demo-files.json";
/// The project of the demo's scene.
pub(super) const PROJECT: &str = "scene.sgproj";
/// Most projects that are kept in one folder.
const MAX_PROJECTS: u32 = 1000;

/// A folder that a demo may fill.
pub(super) struct OutputFolder<'a> {
    path: &'a Path,
    /// Names of the files of the earlier demo.
    earlier: Vec<String>,
}

impl<'a> OutputFolder<'a> {
    /// Reads the list of the earlier demo. Changes nothing.
    ///
    /// Fails for a folder with files and without such a list.
    pub(super) fn check(path: &'a Path) -> Result<Self, Failure> {
        let fail = |e: std::io::Error| Failure::Work(format!("{}: {e}; give another folder", path.display()));
        let mut entries = match std::fs::read_dir(path) {
            Ok(entries) => entries,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Self { path, earlier: Vec::new() }),
            Err(error) => return Err(fail(error)),
        };
        let manifest = path.join(MANIFEST);
        match file::read_text(&manifest, SMALL_TEXT_BYTES) {
            Ok(text) => {
                let earlier: Vec<String> = serde_json::from_str(&text).map_err(|e| {
                    Failure::Input(format!("{}: {e}; give another folder with --out", manifest.display()))
                })?;
                Ok(Self { path, earlier: earlier.into_iter().filter(|name| is_plain(name)).collect() })
            }
            Err(error) if error.kind() == ErrorKind::NotFound && entries.next().is_none() => {
                Ok(Self { path, earlier: Vec::new() })
            }
            Err(error) if error.kind() == ErrorKind::NotFound => Err(Failure::Input(format!(
                "{}: holds files that no demo wrote; give a new folder with --out",
                path.display()
            ))),
            Err(error) => Err(fail(error)),
        }
    }

    pub(super) fn path(&self) -> &Path {
        self.path
    }

    /// Creates the folder, removes the files of the earlier demo, and moves the project of a window aside.
    pub(super) fn prepare(self) -> Result<PathBuf, Failure> {
        let fail = |e: std::io::Error| {
            Failure::Work(format!("{}: {e}; give a folder that can be written", self.path.display()))
        };
        std::fs::create_dir_all(self.path).map_err(fail)?;
        let out = std::fs::canonicalize(self.path).map_err(fail)?;
        for name in &self.earlier {
            match std::fs::remove_file(out.join(name)) {
                Err(error) if error.kind() != ErrorKind::NotFound => return Err(fail(error)),
                _ => {}
            }
        }
        set_project_aside(&out)?;
        write_manifest(&out, &[])?;
        Ok(out)
    }
}

/// Lists the files that a script writes into the folder, before it is played.
///
/// A window lists nothing. Its project holds a person's edits, and the next demo moves it aside.
pub(super) fn list(out: &Path, steps: &[Step]) -> Result<(), Failure> {
    write_manifest(out, &file_names(steps))
}

fn write_manifest(out: &Path, names: &[String]) -> Result<(), Failure> {
    let path = out.join(MANIFEST);
    let written =
        serde_json::to_vec_pretty(names).map_err(std::io::Error::from).and_then(|text| std::fs::write(&path, text));
    written.map_err(|e| Failure::Work(format!("{}: {e}", path.display())))
}

/// Whether a name is one file of the folder itself.
fn is_plain(name: &str) -> bool {
    let mut parts = Path::new(name).components();
    matches!((parts.next(), parts.next()), (Some(Component::Normal(_)), None))
}

/// Renames a project of an earlier window, with its journal files, to the first free name.
fn set_project_aside(out: &Path) -> Result<(), Failure> {
    let project = out.join(PROJECT);
    if !project.exists() {
        return Ok(());
    }
    let free = (1..=MAX_PROJECTS).map(|n| format!("scene-{n}.sgproj")).find(|name| !out.join(name).exists());
    let Some(free) = free else {
        return Err(Failure::Input(format!("{}: too many projects; give a new folder with --out", out.display())));
    };
    for end in ["", "-wal", "-shm"] {
        match std::fs::rename(out.join(format!("{PROJECT}{end}")), out.join(format!("{free}{end}"))) {
            Err(error) if error.kind() != ErrorKind::NotFound => {
                return Err(Failure::Work(format!("{}: {error}", project.display())));
            }
            _ => {}
        }
    }
    terminal::print_status(&format!("edits of an earlier window are kept in {}", out.join(free).display()));
    Ok(())
}

/// Names of the files that a script leaves: pictures, transcript and project.
fn file_names(steps: &[Step]) -> Vec<String> {
    let captures = steps.iter().filter_map(|step| match step {
        Step::Capture { name, .. } => Some(name),
        _ => None,
    });
    let pictures = (1..).zip(captures).flat_map(|(n, name)| {
        let base = picture_base(n, name);
        [format!("{base}.png"), format!("{base}.npy")]
    });
    let project = ["", "-wal", "-shm"].map(|end| format!("{PROJECT}{end}"));
    pictures.chain([transcript::FILE.to_owned()]).chain(project).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn capture(name: &str) -> Step {
        Step::Capture { name: name.to_owned(), highlight: false, only: Vec::new() }
    }

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> = std::fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn a_folder_with_other_files_is_refused_and_keeps_them() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path();
        for name in ["01-holiday.png", "scene.sgproj", "transcript.json"] {
            std::fs::write(out.join(name), "mine").unwrap();
        }
        let before = names(out);
        assert!(matches!(OutputFolder::check(out), Err(Failure::Input(text)) if text.contains("--out")));
        assert_eq!(names(out), before);
    }

    #[test]
    fn only_listed_files_are_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out");
        let out = OutputFolder::check(&path).unwrap().prepare().unwrap();
        list(&out, &[capture("before")]).unwrap();
        for name in ["01-before.png", "01-before.npy", "transcript.json", "scene.sgproj", "02-mine.png", "notes.txt"] {
            std::fs::write(out.join(name), "").unwrap();
        }
        OutputFolder::check(&path).unwrap().prepare().unwrap();
        assert_eq!(names(&out), ["02-mine.png", MANIFEST, "notes.txt"]);
    }

    #[test]
    fn the_project_of_a_window_is_kept() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path();
        for _ in 0..2 {
            OutputFolder::check(out).unwrap().prepare().unwrap();
            std::fs::write(out.join(PROJECT), "edits").unwrap();
        }
        OutputFolder::check(out).unwrap().prepare().unwrap();
        assert_eq!(names(out), [MANIFEST, "scene-1.sgproj", "scene-2.sgproj"]);
    }

    #[test]
    fn a_list_cannot_reach_outside_its_folder() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out");
        std::fs::create_dir(&out).unwrap();
        std::fs::write(folder.path().join("precious"), "").unwrap();
        std::fs::write(out.join(MANIFEST), r#"["../precious", "/etc/precious", "", "."]"#).unwrap();
        OutputFolder::check(&out).unwrap().prepare().unwrap();
        assert!(folder.path().join("precious").exists());
    }
}
