//! `open`: a scene or volume in a window and a session of its own.

use std::ffi::OsStr;
use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};

use sg_launch::file::Search;
use sg_runtime::session::SessionDir;

use crate::console::Verbosity;
use crate::demo::input::Input;
use crate::demo::{DESKTOP_FILE, GAUSSIANS, has_display, plan, shipped};
use crate::supervisor::{Stack, Supervisor};
use crate::terminal::{self, Done, Failure};
use crate::up::outcome;

/// Letters of a file's name that its session's begins with, and of the hash of its path that it ends with.
const LETTERS: (usize, usize) = (24, 8);

#[derive(Debug, clap::Args)]
pub(crate) struct OpenArgs {
    /// Volume or scene
    #[arg(value_name = "VOLUME|SCENE")]
    path: PathBuf,
}

pub(crate) async fn open(arguments: &OpenArgs, told: Option<&str>) -> Done {
    let path = &arguments.path;
    let input = Input::of(Some(path))?;
    if !has_display() {
        return Err(Failure::Work("no window can be opened: DISPLAY is not set".to_owned()));
    }
    // What can be wrong is looked at before anything that takes time.
    let search = Search::here_then_path();
    plan(DESKTOP_FILE, &[], &search)?;
    let name = told.map_or_else(|| session_of(path), |told| Ok(told.to_owned()))?;
    let session = SessionDir::named(&name)?;
    session.create()?;
    let _held = hold(&session)?;
    let function = shipped::unpack(session.path(), input.known())?.transfer_function;
    // The same Gaussians each time, so that what was edited of them before fits.
    let scene = input.scene(session.path(), function.as_deref(), GAUSSIANS, 0)?;
    let scene = format!("service.scene.params.scene={}", toml::Value::String(scene.path.display().to_string()));
    let file = plan(DESKTOP_FILE, &[scene], &search)?;
    let stack = Stack { file, path: PathBuf::from(DESKTOP_FILE.0), session, verbosity: Verbosity::Quiet };
    terminal::tell(&format!("session {name}: a window shows the scene; close it to end"));
    outcome(Supervisor::open(stack).await?.run().await?)
}

/// Name of the session that a file is opened in: the same each time, so that what was edited is found again.
///
/// # Errors
/// There is no such file.
pub(crate) fn session_of(path: &Path) -> Result<String, Failure> {
    let path = std::fs::canonicalize(path).map_err(|e| Failure::Input(format!("{}: {e}", path.display())))?;
    let stem = |name: Option<&OsStr>| {
        let name = name.unwrap_or_default().to_string_lossy().into_owned();
        name.split('.').find(|part| !part.is_empty()).unwrap_or_default().to_owned()
    };
    let own = stem(path.file_name());
    // Every scene file is called so: its folder says which it is.
    let own = if own == "scene" { stem(path.parent().and_then(Path::file_name)) } else { own };
    let letters = own.chars().map(|c| if c.is_ascii_alphanumeric() || c == '_' { c } else { '-' });
    let hash = blake3::hash(path.as_os_str().as_encoded_bytes()).to_hex();
    let hash: String = hash.chars().take(LETTERS.1).collect();
    Ok(format!("{}-{hash}", letters.take(LETTERS.0).collect::<String>()))
}

/// Keeps anybody else from opening the same session while Gaussians are made, before there is a supervisor to lock it.
fn hold(session: &SessionDir) -> Result<File, Failure> {
    let path = session.path().join("open.lock");
    let fail = |e: std::io::Error| Failure::Work(format!("{}: {e}", path.display()));
    let file = File::options().write(true).create(true).truncate(false).open(&path).map_err(fail)?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => {
            Err(Failure::Work(format!("it is open already, in session `{}`", session.name())))
        }
        Err(TryLockError::Error(error)) => Err(fail(error)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_session_is_known_by_the_name_and_the_place_of_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let name = |path: &str| {
            let path = folder.path().join(path);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(&path, "").unwrap();
            session_of(&path).unwrap()
        };
        let begins = |path: &str, with: &str| {
            let name = name(path);
            assert_eq!(name.rsplit_once('-').map(|(stem, hash)| (stem, hash.len())), Some((with, 8)), "{name}");
            assert!(SessionDir::named(&name).is_ok(), "{name}");
        };
        begins("tooth.raw.zst", "tooth");
        begins("a skull/scene.toml", "a-skull");
        begins("Ünder the very long name of a file.ply", "-nder-the-very-long-name");
        begins(".hidden", "hidden");
        assert_eq!(name("tooth.raw.zst"), session_of(&folder.path().join("./tooth.raw.zst")).unwrap());
        assert_ne!(name("tooth.raw.zst"), name("other/tooth.raw.zst"));
        assert!(matches!(session_of(&folder.path().join("none")), Err(Failure::Input(_))));
    }
}
