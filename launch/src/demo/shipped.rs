//! Scripts, strokes and transfer functions that come with the program, so that the demo works from anywhere.
//!
//! They are written into the demo's folder before they are used: there they can be looked at, changed, and played again.

use std::path::{Path, PathBuf};

use crate::terminal::Failure;

/// Strokes that the generic script plays; made for each scene.
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

/// Where they are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Shipped {
    /// The script for the input: its own, or the generic one.
    pub(crate) script: PathBuf,
    /// The script that works on any scene.
    pub(crate) generic: PathBuf,
    /// Where the strokes of the generic script belong.
    pub(crate) densest: PathBuf,
    /// The transfer function for the input, where one is shipped.
    pub(crate) transfer_function: Option<PathBuf>,
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::demo::input::KNOWN;
    use sg_launch::script::{self, Step};
    use sg_launch::strokes;

    #[test]
    fn every_shipped_script_is_good_and_complete() {
        for known in KNOWN.into_iter().chain(["vessel", "generic"]) {
            let folder = tempfile::tempdir().unwrap();
            let shipped = unpack(folder.path(), Some(known)).unwrap();
            assert!(shipped.script.ends_with(format!("{known}.toml")), "no script for {known}");
            let text = std::fs::read_to_string(&shipped.script).unwrap();
            let steps = script::read(&shipped.script, &text).unwrap();
            let mut brushes = 0;
            for step in &steps {
                if let Step::Strokes { file, .. } = step {
                    brushes += 1;
                    if !file.ends_with(DENSEST) {
                        let text = std::fs::read_to_string(file).unwrap();
                        assert!(!strokes::parse(file, &text).unwrap().is_empty());
                    }
                }
            }
            assert!(brushes > 0, "{known} brushes nothing");
            let captures = steps.iter().filter(|s| matches!(s, Step::Capture { .. })).count();
            assert!(captures >= 4 && steps.contains(&Step::Chaos), "{known}");
        }
    }
}
