//! Search for executables.

use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use crate::suggestion::suggestion;

/// Folders that are searched for executables, in order.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ExecutableSearch {
    folders: Vec<PathBuf>,
}

/// An executable that was not found.
#[derive(Debug, thiserror::Error)]
pub enum ExecutableError {
    /// The path cannot be read.
    #[error("executable `{exec}`: {}: {source}", .path.display())]
    Unreadable {
        /// The executable, as named.
        exec: String,
        /// The path.
        path: PathBuf,
        /// The reason.
        source: std::io::Error,
    },
    /// The path is not an executable file.
    #[error("executable `{exec}`: {} is not an executable file", .path.display())]
    NotExecutable {
        /// The executable, as named.
        exec: String,
        /// The path.
        path: PathBuf,
    },
    /// No searched folder has an executable of this name.
    #[error(
        "executable `{exec}` is neither beside the launcher nor on PATH; build it with `cargo build --release`{hint}"
    )]
    NotFound {
        /// The executable, as named.
        exec: String,
        /// A suggestion, as [`suggestion`] writes it; may be empty.
        hint: String,
    },
}

impl ExecutableSearch {
    /// The folder of this program, then those of `PATH`.
    #[must_use]
    pub fn here_then_path() -> Self {
        let here = std::env::current_exe().ok().and_then(|p| p.parent().map(Path::to_owned));
        let path = std::env::var_os("PATH").unwrap_or_default();
        Self { folders: here.into_iter().chain(std::env::split_paths(&path)).collect() }
    }

    /// Only these folders.
    #[must_use]
    pub fn in_folders(folders: Vec<PathBuf>) -> Self {
        Self { folders }
    }

    /// The absolute path of an executable. A name with a slash is a path relative to the folder of `file`.
    ///
    /// # Errors
    /// [`ExecutableError`] if there is no such executable.
    pub fn find(&self, exec: &str, file: &Path) -> Result<PathBuf, ExecutableError> {
        if exec.contains('/') {
            let path = file.parent().unwrap_or(Path::new("")).join(exec);
            let unreadable = |path: &Path, source| ExecutableError::Unreadable {
                exec: exec.to_owned(),
                path: path.to_owned(),
                source,
            };
            let path = std::path::absolute(&path).map_err(|e| unreadable(&path, e))?;
            return match std::fs::metadata(&path) {
                Err(error) => Err(unreadable(&path, error)),
                Ok(_) if is_executable(&path) => Ok(path),
                Ok(_) => Err(ExecutableError::NotExecutable { exec: exec.to_owned(), path }),
            };
        }
        match self.folders.iter().map(|folder| folder.join(exec)).find(|p| is_executable(p)) {
            Some(found) => Ok(found),
            None => Err(ExecutableError::NotFound { exec: exec.to_owned(), hint: self.near(exec) }),
        }
    }

    /// A suggestion among the project's executables.
    fn near(&self, exec: &str) -> String {
        let Some(Ok(entries)) = self.folders.first().map(std::fs::read_dir) else { return String::new() };
        let mut ours: Vec<_> = entries
            .flatten()
            .filter(|e| is_executable(&e.path()))
            .filter_map(|e| e.file_name().into_string().ok())
            .filter(|name| name.starts_with("supergaussian-") && !name.contains('.'))
            .collect();
        ours.sort();
        let hint = suggestion(exec, ours.iter().map(String::as_str));
        if hint.contains("did you mean") { hint } else { String::new() }
    }
}

fn is_executable(path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|m| m.is_file() && m.permissions().mode() & 0o111 != 0)
}
