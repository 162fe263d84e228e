//! Files that a person saves from a window or in words, under a name of their choice.
//!
//! The kernel confines the requesters' processes to few folders. So this process writes for them, with limits of its own:
//!
//! - A file that is there stays, unless the person has agreed.
//! - Hidden files of the home folder are out of reach.
//! - Gaussians and projects come from the scene's own command, and pictures from the session's folder.

use std::ffi::OsString;
use std::io;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use serde_json::Value;
use sg_input::file;
use sg_proto::keys;
use sg_proto::launch::save_request::Content;
use sg_proto::launch::{GaussianChoice, GaussianPart, SaveReply, SaveRequest};
use sg_runtime::actor::Reply;
use sg_runtime::bus::Bus;
use sg_runtime::context::Context;
use sg_runtime::fault::Fault;

use super::event_loop::Supervisor;
use super::file_places::FilePlaces;
use super::requests::MAX_SAVES;
use crate::spawn::{self, LineSink};

/// First bytes of every PNG file.
const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";

/// Longest report of a command, bytes.
const MAX_REPORT_BYTES: usize = 64 << 10;

/// The command of the scene, as it begins its error lines.
const SCENE_COMMAND: &str = "supergaussian-scene: ";

impl Supervisor {
    /// Writes a file, beside the event loop. The answer comes once the file is on the disk.
    pub(super) fn save_file(&self, request: SaveRequest, context: Context, reply: Reply<SaveReply>) {
        let place = Arc::clone(&self.save_slots).try_acquire_owned();
        let (bus, pictures) = (self.bus.clone(), self.stack.session.path().join("blobs"));
        let places = FilePlaces::of(&self.stack.file.services);
        tokio::spawn(async move {
            let saved = match place {
                Ok(_place) => save(&bus, &pictures, (request, &places), &context).await,
                Err(_) => Err(Fault::exhausted(format!("{MAX_SAVES} files are being written; wait for one of them"))),
            };
            // The requester may have given up.
            let _ = reply.send(saved);
        });
    }
}

async fn save(
    bus: &Bus,
    pictures: &Path,
    (request, places): (SaveRequest, &FilePlaces),
    context: &Context,
) -> Result<SaveReply, Fault> {
    let Some(content) = request.content else { return Err(Fault::invalid("a file without content")) };
    let named = if request.path.is_empty() { places.free(&content)? } else { places.absolute(&request.path)? };
    let to = target(&named, request.replace, &content, places.home.as_deref())?;
    let path = to.display().to_string();
    match content {
        Content::Picture(picture) => {
            let (pictures, replace) = (pictures.to_owned(), request.replace);
            let copied =
                tokio::task::spawn_blocking(move || copy_picture(&pictures, Path::new(&picture.path), &to, replace));
            copied.await.map_err(|e| Fault::internal(e.to_string()))??;
            Ok(SaveReply { gaussians: 0, path })
        }
        Content::Project(_) => {
            let project = project(bus, context).await?;
            run(["backup".into(), project.into(), to.into()].into(), context).await?;
            Ok(SaveReply { gaussians: 0, path })
        }
        Content::Gaussians(choice) => {
            let mut words: Vec<OsString> = ["scene", "convert", "--json"].map(OsString::from).into();
            words.push(option(&choice)?.into());
            words.push(project(bus, context).await?.into());
            words.push(to.into());
            let report = run(words, context).await?;
            let report: Value = serde_json::from_str(&report).unwrap_or_default();
            Ok(SaveReply { gaussians: report["gaussians"].as_u64().unwrap_or(0), path })
        }
    }
}

/// The option of `scene convert` for a choice.
fn option(choice: &GaussianChoice) -> Result<String, Fault> {
    match choice.part() {
        GaussianPart::Everything => Ok("--only=everything".to_owned()),
        GaussianPart::Visible => Ok("--only=visible".to_owned()),
        GaussianPart::Selection => Ok("--only=selection".to_owned()),
        GaussianPart::Unit => Ok(format!("--unit={}", choice.unit)),
        GaussianPart::Unspecified => Err(Fault::invalid("a choice of Gaussians without a part")),
    }
}

/// Path of the session's project, on this machine.
async fn project(bus: &Bus, context: &Context) -> Result<String, Fault> {
    let (state, sender) = bus.newest_identified(&keys::SCENE_STATE, &context.next()).await?;
    match sender {
        None if !state.project_path.is_empty() => Ok(state.project_path),
        None => Err(Fault::precondition("the scene's service does not tell its project")),
        Some(_) => Err(Fault::precondition(
            "the scene is on another machine; `supergaussian scene convert` writes files there",
        )),
    }
}

/// The real path of a named file, if a file with this content may be written there.
fn target(path: &Path, replace: bool, content: &Content, home: Option<&Path>) -> Result<PathBuf, Fault> {
    let refuse = |why: &str| Fault::precondition(format!("{}: {why}", path.display()));
    let (Some(folder), Some(name)) = (path.parent(), path.file_name()) else {
        return Err(Fault::invalid(format!("`{}` names no file", path.display())));
    };
    // Links on the way are followed here, so that none leads around the next check.
    let folder = folder.canonicalize().map_err(|e| refuse(&format!("its folder: {e}")))?;
    let real = folder.join(name);
    let home = home.and_then(|home| home.canonicalize().ok());
    let below = home.as_deref().and_then(|home| real.strip_prefix(home).ok()).and_then(|rest| rest.components().next());
    if below.is_some_and(|first| first.as_os_str().as_encoded_bytes().starts_with(b".")) {
        return Err(refuse("hidden files of the home folder are settings of programs; choose another place"));
    }
    let wanted = match content {
        Content::Project(_) => Some("sgproj"),
        Content::Picture(_) => Some("png"),
        Content::Gaussians(_) => None,
    };
    if let Some(ending) = wanted.filter(|ending| !real.extension().is_some_and(|e| e.eq_ignore_ascii_case(ending))) {
        return Err(refuse(&format!("its name must end with .{ending}")));
    }
    if real.symlink_metadata().is_ok() {
        if wanted == Some("sgproj") {
            return Err(refuse("a project is never replaced; choose another name"));
        }
        if !replace {
            return Err(refuse("a file has this name already; nothing was written"));
        }
    }
    Ok(real)
}

/// Copies a picture of the session. It appears whole or not at all.
fn copy_picture(pictures: &Path, from: &Path, to: &Path, replace: bool) -> Result<(), Fault> {
    let source = |e: io::Error| Fault::precondition(format!("{}: {e}", from.display()));
    let from = from.canonicalize().map_err(source)?;
    let inside = pictures.canonicalize().is_ok_and(|pictures| from.starts_with(pictures));
    if !inside || !file::read_start(&from, PNG.len() as u64).map_err(source)?.starts_with(PNG) {
        return Err(Fault::invalid(format!("{}: no picture of this session", from.display())));
    }
    let fail = |e: io::Error| Fault::precondition(format!("{}: {e}; nothing was written", to.display()));
    if to.exists() && !file::read_start(to, PNG.len() as u64).map_err(fail)?.starts_with(PNG) {
        return Err(fail(io::Error::other("the file there is no PNG file")));
    }
    let folder = to.parent().unwrap_or(Path::new("/"));
    let write = || {
        let mut builder = tempfile::Builder::new();
        // The process's umask still applies.
        builder.prefix(".staged-").permissions(std::fs::Permissions::from_mode(0o666));
        let mut staged = builder.tempfile_in(folder)?;
        io::copy(&mut file::open(&from)?.file, &mut staged)?;
        staged.as_file().sync_all()?;
        let named = if replace { staged.persist(to) } else { staged.persist_noclobber(to) };
        named.map(drop).map_err(|e| e.error)
    };
    write().map_err(fail)
}

/// The output of a command, up to a length.
#[derive(Debug, Clone, Default)]
struct Report(Arc<Mutex<String>>);

impl LineSink for Report {
    fn line(&self, line: &str) {
        let mut text = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if text.len() + line.len() < MAX_REPORT_BYTES {
            text.push_str(line);
            text.push('\n');
        }
    }
}

/// Runs this program with other words until the request's deadline. Returns its output, or its error as one line. It goes on when
/// this process ends: a file that has been begun is finished.
async fn run(words: Vec<OsString>, context: &Context) -> Result<String, Fault> {
    let mut command = spawn::detached();
    command.args(words);
    let report = Report::default();
    let fail = |e: &dyn std::fmt::Display| Fault::precondition(format!("nothing was written: {e}"));
    let (pid, ended) = spawn::run(command, report.clone()).map_err(|e| fail(&e))?;
    let Ok(ended) = tokio::time::timeout(context.remaining(), tokio::spawn(ended)).await else {
        // Its end is awaited by the task above.
        let _ = spawn::signal(pid, nix::sys::signal::Signal::SIGKILL);
        return Err(Fault::deadline("the file took too long; nothing was written"));
    };
    let exit = ended.map_err(|e| fail(&e))?;
    if exit.status == Some(0) {
        let text = report.0.lock().unwrap_or_else(PoisonError::into_inner);
        return Ok(text.clone());
    }
    let reason = exit.reason.split_once(SCENE_COMMAND).map_or(exit.reason.as_str(), |(_, said)| said);
    Err(Fault::precondition(reason))
}

#[cfg(test)]
mod tests {
    use sg_proto::launch::{DrawnPicture, ProjectCopy};

    use super::*;

    fn gaussians() -> Content {
        Content::Gaussians(GaussianChoice { part: GaussianPart::Visible.into(), unit: String::new() })
    }

    #[test]
    fn a_taken_or_hidden_name_is_refused() {
        let home = tempfile::tempdir().unwrap();
        let at = |name: &str| home.path().join(name);
        std::fs::create_dir(at(".config")).unwrap();
        std::os::unix::fs::symlink(at(".config"), at("link")).unwrap();
        std::fs::write(at("old.ply"), "ply").unwrap();
        std::fs::write(at("old.sgproj"), "").unwrap();
        let asked = |path: &str, content: Content, replace| {
            target(&at(path), replace, &content, Some(home.path())).map_err(|fault| fault.message)
        };
        assert_eq!(asked("new.ply", gaussians(), false).unwrap().file_name().unwrap(), "new.ply");
        assert!(asked("old.ply", gaussians(), true).is_ok());
        let picture = || Content::Picture(DrawnPicture::default());
        for (path, content, replace, said) in [
            ("old.ply", gaussians(), false, "a file has this name already"),
            ("old.sgproj", Content::Project(ProjectCopy {}), true, "never replaced"),
            ("copy.ply", Content::Project(ProjectCopy {}), false, "must end with .sgproj"),
            ("a.jpg", picture(), false, "must end with .png"),
            (".profile", gaussians(), true, "hidden files"),
            (".config/a.ply", gaussians(), false, "hidden files"),
            ("link/a.ply", gaussians(), false, "hidden files"),
            ("none/a.ply", gaussians(), false, "its folder: No such file"),
        ] {
            let refused = asked(path, content, replace).unwrap_err();
            assert!(refused.contains(said), "{path}: {refused}");
        }
    }

    #[test]
    fn only_pictures_of_the_session_are_copied_whole() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir(at("blobs")).unwrap();
        let (picture, text) = ([PNG, b"rest"].concat(), at("blobs/notes.png"));
        std::fs::write(at("blobs/view.png"), &picture).unwrap();
        std::fs::write(at("outside.png"), &picture).unwrap();
        std::fs::write(&text, "notes").unwrap();
        std::os::unix::fs::symlink(at("outside.png"), at("blobs/link.png")).unwrap();
        let copy = |from: &str, to: &str, replace| copy_picture(&at("blobs"), &at(from), &at(to), replace);
        copy("blobs/view.png", "out.png", false).unwrap();
        assert_eq!(std::fs::read(at("out.png")).unwrap(), picture);
        assert!(copy("blobs/view.png", "out.png", false).is_err(), "a taken name");
        copy("blobs/view.png", "out.png", true).unwrap();
        for from in ["outside.png", "blobs/link.png", "blobs/notes.png", "blobs/none.png"] {
            assert!(copy(from, "other.png", false).is_err(), "{from}");
        }
        assert!(copy("blobs/view.png", "blobs/notes.png", true).unwrap_err().message.contains("no PNG file"));
        assert!(!at("other.png").exists() && std::fs::read(&text).unwrap() == b"notes");
        let left = std::fs::read_dir(folder.path()).unwrap().flatten();
        assert!(left.into_iter().all(|entry| !entry.file_name().to_string_lossy().starts_with(".staged")));
    }
}
