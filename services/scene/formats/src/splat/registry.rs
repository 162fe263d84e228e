//! The table of formats. A new format is one file, and one row here.

use std::path::Path;
use std::str::FromStr;

use crate::splat::format::{Format, Source};
use crate::splat::problem::Problem;

/// All formats. Content decides before names do: a PLY is read as a PLY under any name. Where several layouts match a PLY,
/// the first one reads it, so a special layout stands before a general one.
static FORMATS: &[Format] = &[
    Format::OURS,
    Format::THREE_DGS,
    Format::COMPRESSED,
    Format::IVRGS,
    Format::IVRGS_QUANTISED,
    Format::SCENE,
    Format::SPLAT,
];

impl Format {
    /// All formats, in the order of the table in [`crate::splat`].
    pub fn all() -> impl Iterator<Item = Self> + Clone {
        FORMATS.iter().copied()
    }

    /// The endings of scene files, in lower case with the dot, each once.
    ///
    /// A folder can be a scene, too: one with a `scene.toml`, or an output folder of iVR-GS.
    #[must_use]
    pub fn all_extensions() -> Vec<&'static str> {
        let mut out = Vec::new();
        for extension in Self::all().flat_map(Self::extensions) {
            if !out.contains(extension) {
                out.push(*extension);
            }
        }
        out
    }

    /// Whether the name of a path is that of a scene: a folder, or a file with one of [`Format::all_extensions`].
    #[must_use]
    pub fn is_scene_path(path: &Path) -> bool {
        let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
        path.is_dir() || Self::all_extensions().iter().any(|e| name.ends_with(e))
    }

    /// The first format that recognises a source.
    ///
    /// # Errors
    /// No format does; the error lists the readable ones.
    pub(crate) fn detect(source: &Source) -> Result<Self, Problem> {
        Self::all().find(|f| f.0.sniff(source)).ok_or_else(|| {
            let kind = match source.name.rsplit_once('.') {
                Some((_, extension)) if !extension.is_empty() => format!(".{} files", sg_input::printable(extension)),
                _ => "files without a known ending".to_owned(),
            };
            Problem::new(
                "byte 0",
                format!("the content is of no known format, and {kind} cannot be read"),
                format!(
                    "readable are {}, and output folders of iVR-GS; give a PLY or another of these",
                    Self::all_extensions().join(", ")
                ),
            )
        })
    }
}

/// A name that no format has.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("unknown format `{0}`; the formats are {names}", names = names().join(", "))]
pub struct UnknownFormat(pub String);

fn names() -> Vec<&'static str> {
    Format::all().map(Format::name).collect()
}

impl FromStr for Format {
    type Err = UnknownFormat;

    fn from_str(name: &str) -> Result<Self, UnknownFormat> {
        Self::all().find(|f| f.name() == name).ok_or_else(|| UnknownFormat(name.to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_has_its_own_name_and_an_ending_with_a_dot() {
        for (k, format) in Format::all().enumerate() {
            assert_eq!(format.name().parse(), Ok(format));
            assert!(Format::all().skip(k + 1).all(|other| other != format), "{format}");
            assert!(!format.extensions().is_empty() && !format.description().ends_with('.'), "{format}");
            assert!(format.extensions().iter().all(|e| e.starts_with('.') && e.to_lowercase() == *e), "{format}");
            let refused = sg_input::unreadable::UNREADABLE.iter().flat_map(|f| f.endings);
            assert!(!refused.into_iter().any(|e| format.extensions().contains(e)), "{format} can be read");
        }
        let error = "gltf".parse::<Format>().unwrap_err().to_string();
        assert!(names().iter().all(|name| error.contains(name)), "{error}");
    }

    #[test]
    fn scenes_are_known_by_their_names() {
        for name in ["a.PLY", "a.compressed.ply", "b/scene.toml", "a.splat", "."] {
            assert!(Format::is_scene_path(Path::new(name)), "{name}");
        }
        for name in ["a.nrrd", "ply", "no-such-folder"] {
            assert!(!Format::is_scene_path(Path::new(name)), "{name}");
        }
    }
}
