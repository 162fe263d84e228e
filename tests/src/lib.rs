//! Shared parts of the tests that cross process boundaries: the built command, real data, and pictures. Conformance tries any
//! program that is to fill a role. The evaluation tables are here too.

pub mod bench;
pub mod commands;
pub mod conformance;
pub mod dropping;
pub mod eval;
pub mod hosts;
pub mod made_scene;
mod minimizing;
mod placement;
pub mod plot;
pub mod proxy;
pub mod screen;
pub mod shells;
pub mod small_scene;
pub mod soak;
pub mod stack;
pub mod until;
pub mod voice;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use directories::ProjectDirs;

/// Something a test needs is not there.
#[derive(Debug, thiserror::Error)]
pub enum Missing {
    /// The command was not built.
    #[error("{0} is not there; build it with `cargo build --release --workspace`")]
    Command(PathBuf),
    /// A picture cannot be read.
    #[error("{path}: {reason}")]
    Picture {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// The process could not be run.
    #[error(transparent)]
    Io(#[from] std::io::Error),
}

/// The `supergaussian` command of the build that this test belongs to, with a run folder of its own. Projects of its stacks lie
/// there too, and not among the user's.
///
/// # Errors
/// [`Missing::Command`] if it was not built.
pub fn command(run_root: &Path) -> Result<Command, Missing> {
    let mut command = Command::new(executable("supergaussian")?);
    command
        .env("SUPERGAUSSIAN_RUN_ROOT", run_root)
        .env("XDG_DATA_HOME", run_root.join(".data"))
        .env_remove("DISPLAY")
        .env_remove("WAYLAND_DISPLAY");
    Ok(command)
}

/// An executable of the build that this program belongs to, else one on `PATH`.
///
/// # Errors
/// [`Missing::Command`] if it was not built.
pub fn executable(name: &str) -> Result<PathBuf, Missing> {
    let here = std::env::current_exe()?;
    // A test lies one folder below its package.
    let beside = here.ancestors().skip(1).take(2).map(Path::to_owned);
    let path = std::env::var_os("PATH").unwrap_or_default();
    let mut found = beside.chain(std::env::split_paths(&path)).map(|folder| folder.join(name));
    found.find(|p| p.is_file()).ok_or_else(|| Missing::Command(PathBuf::from(name)))
}

/// The example of a service in Python, if there is a Python with the packages it needs. `SUPERGAUSSIAN_PYTHON` names that Python;
/// else it is the environment that `ops/python.sh` makes. Without one the caller skips, after a message. With
/// `SUPERGAUSSIAN_REQUIRE_TOOLS=1`, a missing Python is a failure.
///
/// # Errors
/// A line that names the missing requirement.
pub fn python_intent() -> Result<Option<PathBuf>, String> {
    if python()?.is_none() {
        return Ok(None);
    }
    let room = Path::new(env!("CARGO_MANIFEST_DIR")).join("../services/agents/examples/python-intent");
    Ok(Some(room.canonicalize().map_err(|e| format!("{}: {e}", room.display()))?.join("intent")))
}

/// The Python interpreter of the tests: the one `SUPERGAUSSIAN_PYTHON` names, else that of the environment that `ops/python.sh`
/// makes. Without one that has its packages the caller skips, after a message. With `SUPERGAUSSIAN_REQUIRE_TOOLS=1`, a missing
/// interpreter is a failure.
///
/// # Errors
/// A line that names the missing requirement.
pub fn python() -> Result<Option<PathBuf>, String> {
    let named = std::env::var_os("SUPERGAUSSIAN_PYTHON").map(PathBuf::from);
    let cached = || Some(ProjectDirs::from("", "", "supergaussian")?.cache_dir().join("python/bin/python"));
    let python = named.or_else(cached);
    let works = |python: &PathBuf| {
        let packages = ["-c", "import zenoh, google.protobuf, grpc, grpc_tools, xllamacpp, gguf"];
        Command::new(python).args(packages).output().is_ok_and(|output| output.status.success())
    };
    if let Some(python) = python.filter(works) {
        return Ok(Some(python));
    }
    if std::env::var("SUPERGAUSSIAN_REQUIRE_TOOLS").is_ok_and(|v| v == "1") {
        return Err("no Python with the packages of ops/python.sh, and SUPERGAUSSIAN_REQUIRE_TOOLS=1".to_owned());
    }
    Ok(None)
}

/// Two hosts that reach each other through this one alone, if this user may make network namespaces (`ip netns`, as root).
/// Otherwise the caller skips, after a message. With `SUPERGAUSSIAN_REQUIRE_TOOLS=1`, that is a failure.
///
/// # Errors
/// A line that names the missing requirement.
pub fn two_hosts() -> Result<Option<[hosts::Host; 2]>, String> {
    match hosts::Host::two() {
        Ok(hosts) => Ok(Some(hosts)),
        Err(reason) if std::env::var("SUPERGAUSSIAN_REQUIRE_TOOLS").is_ok_and(|v| v == "1") => {
            Err(format!("{reason}, and SUPERGAUSSIAN_REQUIRE_TOOLS=1"))
        }
        Err(_) => Ok(None),
    }
}

/// Output of a process as text, for a failing test's message.
#[must_use]
pub fn said(output: &Output) -> String {
    format!("{}\n{}{}", output.status, String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
}

/// The folder of real data that `SUPERGAUSSIAN_DATA` names. Without one the caller skips, after a message. With
/// `SUPERGAUSSIAN_REQUIRE_DATA=1`, that is a failure.
///
/// # Errors
/// A line that names the missing requirement.
pub fn real_data() -> Result<Option<PathBuf>, String> {
    match std::env::var_os("SUPERGAUSSIAN_DATA").map(PathBuf::from).filter(|p| p.is_dir()) {
        Some(folder) => Ok(Some(folder)),
        None if std::env::var("SUPERGAUSSIAN_REQUIRE_DATA").is_ok_and(|v| v == "1") => {
            Err("SUPERGAUSSIAN_DATA names no folder, and SUPERGAUSSIAN_REQUIRE_DATA=1 asks for one".to_owned())
        }
        None => Ok(None),
    }
}

/// A float picture: `(height, width, 4)`, RGB over the background and coverage.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Values of one pixel after another.
    pub values: Vec<f32>,
}

impl Picture {
    /// Reads a `.npy` picture.
    ///
    /// # Errors
    /// [`Missing::Picture`].
    pub fn read(path: &Path) -> Result<Self, Missing> {
        let fail = |reason: String| Missing::Picture { path: path.to_owned(), reason };
        let bytes = std::fs::read(path).map_err(|e| fail(e.to_string()))?;
        let npy = npyz::NpyFile::new(&bytes[..]).map_err(|e| fail(e.to_string()))?;
        if npy.shape().len() != 3 || npy.shape()[2] != 4 {
            return Err(fail(format!("shape {:?} is not (height, width, 4)", npy.shape())));
        }
        Ok(Self { values: npy.into_vec::<f32>().map_err(|e| fail(e.to_string()))? })
    }

    /// Pixels as RGB and coverage.
    pub fn pixels(&self) -> impl Iterator<Item = &[f32; 4]> {
        self.values.as_chunks::<4>().0.iter()
    }
}

/// The effect of a recolour, judged by the coverage of the unit drawn alone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Recolour {
    /// Greatest change of any channel where the unit's coverage is below 1/1024.
    pub outside_max: f32,
    /// Median over pixels of the greatest change of any channel where the unit's coverage is above ½.
    pub inside_median: f32,
}

impl Recolour {
    /// Compares the pictures before and after.
    #[must_use]
    pub fn between(before: &Picture, after: &Picture, unit: &Picture) -> Self {
        let mut inside = Vec::new();
        let mut outside_max = 0.0_f32;
        for ((b, a), u) in before.pixels().zip(after.pixels()).zip(unit.pixels()) {
            let change = (0..3).map(|k| (a[k] - b[k]).abs()).fold(0.0, f32::max);
            if u[3] < 1.0 / 1024.0 {
                outside_max = outside_max.max(change);
            } else if u[3] > 0.5 {
                inside.push(change);
            }
        }
        inside.sort_unstable_by(f32::total_cmp);
        Self { outside_max, inside_median: inside.get(inside.len() / 2).copied().unwrap_or(0.0) }
    }
}
