//! The folder of a film. A film replaces only files that an earlier film listed there.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use sg_formats::staged_file;
use sg_input::file;
use sg_input::limits::TEXT_BYTES;
use sg_scene::camera::Camera;

use crate::cli::failure::Failure;

/// Lists the pictures of a film with their cameras.
const LIST: &str = "film.json";

/// The video of a film.
const VIDEO: &str = "film.mp4";

/// Name of a picture by its number, from 0.
pub(super) fn picture_name(number: u32) -> String {
    format!("{number:04}.png")
}

/// A picture of a film.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Frame {
    /// Its name in the folder.
    pub(super) file: String,
    /// The camera, in the form of a camera file.
    pub(super) camera: Camera,
}

/// The list of a film.
#[derive(Debug, Serialize, Deserialize)]
struct Film {
    pictures_per_second: u32,
    pictures: Vec<Frame>,
}

/// A folder that a film may fill.
#[derive(Debug)]
pub(super) struct FilmFolder<'a> {
    path: &'a Path,
    /// Files of the earlier film.
    earlier: Vec<String>,
}

impl<'a> FilmFolder<'a> {
    /// Reads the list of an earlier film. Changes nothing.
    ///
    /// Fails for a folder with files and without such a list.
    pub(super) fn check(path: &'a Path) -> Result<Self, Failure> {
        let refuse = |why: &dyn std::fmt::Display| {
            Failure::input(format!("{}: {why}; give a new folder with --out", path.display()))
        };
        let mut entries = match std::fs::read_dir(path) {
            Ok(entries) => entries,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Self { path, earlier: Vec::new() }),
            Err(error) => return Err(refuse(&error)),
        };
        let list = path.join(LIST);
        let text = match file::read_text(&list, TEXT_BYTES) {
            Ok(text) => text,
            Err(error) if error.kind() == ErrorKind::NotFound && entries.next().is_none() => {
                return Ok(Self { path, earlier: Vec::new() });
            }
            Err(error) if error.kind() == ErrorKind::NotFound => {
                return Err(refuse(&"it holds files that no film wrote"));
            }
            Err(error) => return Err(refuse(&format!("{LIST}: {error}"))),
        };
        let film: Film = serde_json::from_str(&text).map_err(|e| refuse(&format!("{LIST}: {e}")))?;
        let names = film.pictures.into_iter().map(|frame| frame.file).filter(|name| is_picture(name));
        Ok(Self { path, earlier: names.chain([VIDEO.to_owned()]).collect() })
    }

    /// Creates the folder, removes the files of the earlier film, and lists the new ones.
    pub(super) fn prepare(&self, pictures_per_second: u32, pictures: Vec<Frame>) -> Result<(), Failure> {
        let fail = |e: std::io::Error| {
            Failure::work(format!("{}: {e}; give a folder that can be written", self.path.display()))
        };
        std::fs::create_dir_all(self.path).map_err(fail)?;
        for name in &self.earlier {
            match std::fs::remove_file(self.path.join(name)) {
                Err(error) if error.kind() != ErrorKind::NotFound => return Err(fail(error)),
                _ => {}
            }
        }
        let list = serde_json::to_vec(&Film { pictures_per_second, pictures }).map_err(Failure::work)?;
        staged_file::replace(&self.path.join(LIST), &list).map_err(fail)
    }

    /// Path of the video.
    pub(super) fn video(&self) -> PathBuf {
        self.path.join(VIDEO)
    }
}

/// Whether a name is one of [`picture_name`].
fn is_picture(name: &str) -> bool {
    name.strip_suffix(".png").is_some_and(|number| number.len() == 4 && number.bytes().all(|b| b.is_ascii_digit()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_files_of_an_earlier_film_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("film");
        let frame = |k: u32| Frame {
            file: picture_name(k),
            camera: Camera::look_at(glam::DVec3::Y, glam::DVec3::ZERO, glam::DVec3::Z, 40.0, 4, 4),
        };
        let film = FilmFolder::check(&path).unwrap();
        assert!(!path.exists(), "a check changes nothing");
        film.prepare(24, (0..3).map(frame).collect()).unwrap();
        for name in ["0000.png", "0002.png", "0007.png", "film.mp4", "notes.txt"] {
            std::fs::write(path.join(name), name).unwrap();
        }
        FilmFolder::check(&path).unwrap().prepare(24, vec![frame(0)]).unwrap();
        let there = |name: &str| path.join(name).exists();
        assert!(there("0007.png") && there("notes.txt") && there(LIST));
        assert!(!there("0000.png") && !there("0002.png") && !there("film.mp4"));

        // A list that names files outside the folder removes none of them.
        let bad =
            [Frame { file: "../keep.png".to_owned(), ..frame(0) }, Frame { file: "notes.txt".to_owned(), ..frame(0) }];
        std::fs::write(folder.path().join("keep.png"), "keep").unwrap();
        let list = serde_json::to_vec(&Film { pictures_per_second: 1, pictures: bad.into() }).unwrap();
        std::fs::write(path.join(LIST), list).unwrap();
        FilmFolder::check(&path).unwrap().prepare(24, Vec::new()).unwrap();
        assert!(folder.path().join("keep.png").exists() && there("notes.txt"));

        let foreign = folder.path().join("foreign");
        std::fs::create_dir(&foreign).unwrap();
        assert!(FilmFolder::check(&foreign).is_ok(), "an empty folder");
        std::fs::write(foreign.join("photo.png"), "photo").unwrap();
        let refused = FilmFolder::check(&foreign).unwrap_err();
        assert!(refused.status == 2 && refused.line.contains("no film wrote"), "{}", refused.line);
        std::fs::write(foreign.join(LIST), "{\"name\": \"somebody's film\"}").unwrap();
        assert!(FilmFolder::check(&foreign).is_err());
        assert!(FilmFolder::check(&foreign.join("photo.png")).is_err(), "a file");
    }
}
