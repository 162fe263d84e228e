//! Places of files that people name: absolute paths, and names beside the file that the person has opened.

use std::path::{Component, Path, PathBuf};

use serde_json::Value;
use sg_proto::keys::role;
use sg_proto::launch::save_request::Content;
use sg_proto::launch::{GaussianChoice, GaussianPart};
use sg_runtime::fault::Fault;

use crate::file::Service;

/// Most letters of one part of a file's name.
const PART: usize = 24;

/// Most numbered names that are tried.
const NUMBERS: u32 = 1000;

/// Where names without a folder are.
#[derive(Debug, Clone, Default)]
pub(super) struct FilePlaces {
    /// The file that the person has opened.
    pub(super) opened: Option<PathBuf>,
    /// The home folder.
    pub(super) home: Option<PathBuf>,
}

impl FilePlaces {
    /// The places of a stack with these services.
    pub(super) fn of(services: &[Service]) -> Self {
        let window = services.iter().find(|service| service.role == role::RENDER_VIEW);
        let opened = window.and_then(|window| window.start.params.get("file")).and_then(Value::as_str);
        Self {
            opened: opened.map(PathBuf::from).filter(|file| file.is_absolute()),
            home: std::env::var_os("HOME").map(PathBuf::from).filter(|home| home.is_absolute()),
        }
    }

    fn folder(&self) -> Result<&Path, Fault> {
        let folder = self.opened.as_deref().and_then(Path::parent).or(self.home.as_deref());
        folder.ok_or_else(|| Fault::precondition("HOME is not set; give the whole path of the file"))
    }

    /// The absolute path of a named file. `~/` begins a path in the home folder.
    ///
    /// # Errors
    /// `InvalidArgument` for a name with `..`, `FailedPrecondition` without a folder for it.
    pub(super) fn absolute(&self, named: &str) -> Result<PathBuf, Fault> {
        let in_home = named.strip_prefix("~/").zip(self.home.as_deref());
        let path = match in_home {
            Some((rest, home)) => home.join(rest),
            None if Path::new(named).is_absolute() => PathBuf::from(named),
            None => self.folder()?.join(named),
        };
        if path.components().any(|part| matches!(part, Component::ParentDir)) {
            return Err(Fault::invalid(format!("`{named}`: give a path without `..`")));
        }
        Ok(path)
    }

    /// A path that no file has yet, for a content without a name.
    ///
    /// # Errors
    /// As [`FilePlaces::absolute`]; `ResourceExhausted` if a thousand such files are there.
    pub(super) fn free(&self, content: &Content) -> Result<PathBuf, Fault> {
        let folder = self.folder()?;
        let (what, ending) = match content {
            Content::Project(_) => ("copy".to_owned(), "sgproj"),
            Content::Picture(_) => ("picture".to_owned(), "png"),
            Content::Gaussians(choice) => (of(choice), "ply"),
        };
        let stem = self.opened.as_deref().and_then(Path::file_name).map(|name| name.to_string_lossy().into_owned());
        let stem = stem.as_deref().and_then(|name| name.split('.').find(|part| !part.is_empty())).map(plain);
        let stem = stem.unwrap_or_else(|| "scene".to_owned());
        let numbers = std::iter::once(String::new()).chain((2..NUMBERS).map(|k| format!("-{k}")));
        let paths = numbers.map(|number| folder.join(format!("{stem}-{what}{number}.{ending}")));
        let full = || Fault::exhausted(format!("{}: too many such files; give a name", folder.display()));
        paths.into_iter().find(|path| path.symlink_metadata().is_err()).ok_or_else(full)
    }
}

/// A word for a part of the scene.
fn of(choice: &GaussianChoice) -> String {
    match choice.part() {
        GaussianPart::Unit => plain(&choice.unit),
        GaussianPart::Selection => "selection".to_owned(),
        GaussianPart::Everything => "copy".to_owned(),
        GaussianPart::Visible | GaussianPart::Unspecified => "visible".to_owned(),
    }
}

/// A part of a file's name, of letters and digits that every file system and shell takes.
fn plain(text: &str) -> String {
    let letters: String =
        text.chars().map(|c| if c.is_alphanumeric() || c == '_' { c } else { '-' }).take(PART).collect();
    letters.trim_end_matches(['-', '_']).to_owned()
}

#[cfg(test)]
mod tests {
    use sg_proto::launch::{DrawnPicture, ProjectCopy};

    use super::*;

    #[test]
    fn names_are_beside_the_opened_file() {
        let places = FilePlaces { opened: Some("/data/heart.nrrd".into()), home: Some("/users/ada".into()) };
        let path = |named: &str| places.absolute(named).unwrap();
        assert_eq!(path("sac.ply"), Path::new("/data/sac.ply"));
        assert_eq!(path("~/sac.ply"), Path::new("/users/ada/sac.ply"));
        assert_eq!(path("/tmp/sac.ply"), Path::new("/tmp/sac.ply"));
        assert!(places.absolute("../sac.ply").unwrap_err().message.contains("without `..`"));
        let homely = FilePlaces { opened: None, ..places };
        assert_eq!(homely.absolute("sac.ply").unwrap(), Path::new("/users/ada/sac.ply"));
        assert!(FilePlaces::default().absolute("sac.ply").unwrap_err().message.contains("HOME"));
    }

    #[test]
    fn a_free_name_says_what_the_file_holds() {
        let folder = tempfile::tempdir().unwrap();
        let places = FilePlaces { opened: Some(folder.path().join("heart.compressed.ply")), home: None };
        let name = |content: Content| {
            let path = places.free(&content).unwrap();
            std::fs::write(&path, "").unwrap();
            path.file_name().unwrap().to_str().unwrap().to_owned()
        };
        let unit = || GaussianChoice { part: GaussianPart::Unit.into(), unit: "left lobe/2".to_owned() };
        assert_eq!(name(Content::Gaussians(unit())), "heart-left-lobe-2.ply");
        assert_eq!(name(Content::Gaussians(unit())), "heart-left-lobe-2-2.ply");
        assert_eq!(name(Content::Picture(DrawnPicture::default())), "heart-picture.png");
        assert_eq!(plain("headsq_quarter_64x64x93_int16"), "headsq_quarter_64x64x93");
        assert_eq!(name(Content::Project(ProjectCopy {})), "heart-copy.sgproj");
    }
}
