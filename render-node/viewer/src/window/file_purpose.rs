//! What a chosen file is for: the title of its dialog, and its endings.

use std::path::{Path, PathBuf};

use sg_formats::Format;
use sg_proto::launch::{GaussianChoice, GaussianPart};
use sg_volume::ENDINGS;

use super::file_drop::PROJECT;

/// What a file is for.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum FilePurpose {
    /// To open a scene, a volume or a camera.
    Open,
    /// To save the project, or everything in it as a scene.
    Copy,
    /// To save some Gaussians.
    Export(GaussianChoice),
    /// To save a picture.
    Picture,
}

impl FilePurpose {
    /// The title of its dialog.
    pub(super) fn title(&self) -> String {
        match self {
            Self::Open => "Open".to_owned(),
            Self::Copy => "Save a copy".to_owned(),
            Self::Export(choice) => match choice.part() {
                GaussianPart::Selection => "Export the selection".to_owned(),
                GaussianPart::Unit => format!("Export {}", choice.unit),
                _ => "Export what is visible".to_owned(),
            },
            Self::Picture => "Save picture".to_owned(),
        }
    }

    /// Whether the file is written.
    pub(super) fn saves(&self) -> bool {
        *self != Self::Open
    }

    /// Names of its kinds of files, with their endings in lower case with the dot. The first kind is the usual one.
    pub(super) fn filters(&self) -> Vec<(String, Vec<&'static str>)> {
        let single = |ending: &'static str| (format!("*{ending}"), vec![ending]);
        match self {
            Self::Open => {
                let scenes = Format::all_extensions();
                let all = scenes.iter().chain(&ENDINGS).copied().chain([PROJECT, ".json"]).collect();
                vec![
                    ("Scenes, projects, volumes, cameras".to_owned(), all),
                    ("Scenes".to_owned(), scenes),
                    ("Projects".to_owned(), vec![PROJECT]),
                    ("Volumes".to_owned(), ENDINGS.to_vec()),
                    ("All files".to_owned(), vec!["*"]),
                ]
            }
            Self::Copy => [PROJECT].into_iter().chain(written()).map(single).collect(),
            Self::Export(_) => written().into_iter().map(single).collect(),
            Self::Picture => vec![single(".png")],
        }
    }

    /// The path with an ending of its kinds: the usual one for a name without any.
    ///
    /// # Errors
    /// The endings, for a name with another one.
    pub(super) fn with_ending(&self, path: &Path) -> Result<PathBuf, String> {
        let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
        let endings: Vec<_> = self.filters().into_iter().flat_map(|(_, endings)| endings).collect();
        let Some(usual) = endings.first().filter(|_| self.saves()) else { return Ok(path.to_owned()) };
        if endings.iter().any(|ending| name.ends_with(ending)) {
            return Ok(path.to_owned());
        }
        if name.contains('.') {
            return Err(format!("end the name with {}", endings.join(", ")));
        }
        let mut longer = path.as_os_str().to_owned();
        longer.push(usual);
        Ok(longer.into())
    }
}

/// Endings of scene files that can be written, PLY first.
fn written() -> Vec<&'static str> {
    let mut endings: Vec<_> = Format::all_extensions();
    endings.retain(|ending| Format::all().any(|f| f.is_writable() && f.extensions().contains(ending)));
    endings.sort_by_key(|ending| *ending != ".ply");
    endings
}

#[cfg(test)]
mod tests {
    use super::*;

    fn export() -> FilePurpose {
        FilePurpose::Export(GaussianChoice { part: GaussianPart::Visible.into(), unit: String::new() })
    }

    #[test]
    fn a_name_without_an_ending_gets_the_usual_one() {
        let ended = |purpose: &FilePurpose, name: &str| purpose.with_ending(Path::new(name));
        for (purpose, name, whole) in [
            (export(), "/a/heart", "/a/heart.ply"),
            (export(), "/a/heart.Compressed.PLY", "/a/heart.Compressed.PLY"),
            (export(), "/a/heart.splat", "/a/heart.splat"),
            (FilePurpose::Copy, "/a/heart", "/a/heart.sgproj"),
            (FilePurpose::Copy, "/a/heart.toml", "/a/heart.toml"),
            (FilePurpose::Picture, "/a/heart", "/a/heart.png"),
            (FilePurpose::Open, "/a/heart", "/a/heart"),
        ] {
            assert_eq!(ended(&purpose, name), Ok(PathBuf::from(whole)));
        }
        assert!(ended(&FilePurpose::Picture, "/a/heart.jpg").unwrap_err().contains(".png"));
        assert!(ended(&export(), "/a/heart.sgproj").unwrap_err().contains(".ply, "));
        assert_eq!(written().first(), Some(&".ply"));
    }
}
