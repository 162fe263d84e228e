//! Launch files, scripts, strokes and transfer functions inside the program.
//!
//! Scripts are written into the demo's folder before use. There they can be read, changed, and played again.

use std::path::{Path, PathBuf};

use sg_stack::file::{ExecutableSearch, LaunchFile, Source, read};

use crate::terminal::Failure;

/// Name and text of the launch file without a window.
pub(crate) const HEADLESS: (&str, &str) = ("headless.toml", include_str!("../../headless.toml"));

/// Name and text of the launch file with a window.
pub(crate) const DESKTOP: (&str, &str) = ("desktop.toml", include_str!("../../desktop.toml"));

/// Parses a shipped launch file.
pub(crate) fn launch_file(
    (name, text): (&str, &str),
    overrides: &[String],
    search: &ExecutableSearch,
) -> Result<LaunchFile, Failure> {
    let source = Source { path: Path::new(name), text, overrides };
    read(source, search).map_err(|problems| Failure::Faults(problems.lines().collect()))
}

/// Name of the generated strokes for the generic script.
pub(crate) const DENSEST: &str = "densest.json";

macro_rules! shipped {
    ($($name:literal),* $(,)?) => {
        &[$(($name, include_str!(concat!("../../demo/", $name)))),*]
    };
}

/// File name and text.
const FILES: &[(&str, &str)] = shipped![
    "generic.toml",
    "vessel.toml",
    "vessel.sac.json",
    "vessel.parent.json",
    "vessel.correction.json",
    "aneurism.toml",
    "aneurism.tf.json",
    "aneurism.sac.json",
    "aneurism.parent.json",
    "bonsai.toml",
    "bonsai.tf.json",
    "bonsai.trunk.json",
    "bonsai.soil.json",
    "tooth.toml",
    "tooth.tf.json",
    "tooth.root.json",
    "tooth.rest.json",
];

/// Paths of the unpacked files.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Shipped {
    /// The script for the input, or the generic one.
    pub(crate) script: PathBuf,
    /// The script that works on any scene.
    pub(crate) generic: PathBuf,
    /// The strokes of the generic script.
    pub(crate) densest: PathBuf,
    /// The transfer function for the input, if one is shipped.
    pub(crate) transfer_function: Option<PathBuf>,
}

/// Whether [`unpack`] into this folder may replace the file.
pub(crate) fn replaces(out: &Path, file: &Path) -> bool {
    let (Ok(folder), Ok(file)) = (out.join("script").canonicalize(), file.canonicalize()) else { return false };
    let is_shipped = |name: &std::ffi::OsStr| FILES.iter().any(|(shipped, _)| *shipped == name);
    file.parent() == Some(&folder) && file.file_name().is_some_and(is_shipped)
}

/// Writes the files for a known input, and the generic script.
pub(crate) fn unpack(out: &Path, known: Option<&str>) -> Result<Shipped, Failure> {
    let folder = out.join("script");
    let fail = |path: &Path, e: std::io::Error| Failure::Work(format!("{}: {e}", path.display()));
    std::fs::create_dir_all(&folder).map_err(|e| fail(&folder, e))?;
    let prefix = known.map(|k| format!("{k}."));
    let wanted = |name: &str| name == "generic.toml" || prefix.as_ref().is_some_and(|p| name.starts_with(p));
    for (name, text) in FILES.iter().filter(|(name, _)| wanted(name)) {
        let path = folder.join(name);
        std::fs::write(&path, text).map_err(|e| fail(&path, e))?;
    }
    let generic = folder.join("generic.toml");
    let own = |ending: &str| {
        let name = format!("{}.{ending}", known?);
        FILES.iter().any(|(file, _)| *file == name).then(|| folder.join(name))
    };
    Ok(Shipped {
        script: own("toml").unwrap_or_else(|| generic.clone()),
        densest: folder.join(DENSEST),
        transfer_function: own("tf.json"),
        generic,
    })
}
