//! Asks a person for a file: by the desktop's dialog where there is one, else by a path in the window. One at a time.

use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, TryRecvError};
use std::time::{Duration, Instant};

use egui::{Align2, Context, Key, TextEdit};

use super::file_drop::PROJECT;
use super::file_purpose::FilePurpose;
use super::native_dialog::NativeDialogs;

/// Shortest time in which a person closes a dialog of the desktop. One that closes earlier has not opened.
const SHORTEST_DIALOG: Duration = Duration::from_millis(300);

/// Width of the path's field at the usual text size, points.
const FIELD: f32 = 460.0;

/// A chosen file.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ChosenFile {
    pub(super) purpose: FilePurpose,
    /// Absolute path.
    pub(super) path: PathBuf,
    /// Whether the person has agreed to replace the file at that path.
    pub(super) replace: bool,
}

impl ChosenFile {
    /// Whether the file is a project.
    pub(super) fn is_project(&self) -> bool {
        self.path.to_string_lossy().to_lowercase().ends_with(PROJECT)
    }
}

/// The dialogs of a window.
#[derive(Default)]
pub(super) struct FileDialogs {
    native: Option<NativeDialogs>,
    open: Option<OpenDialog>,
}

enum OpenDialog {
    /// The desktop's, since a time, and its suggestion.
    Native(FilePurpose, PathBuf, Instant, Receiver<Option<PathBuf>>),
    InWindow(PathDialog),
}

impl FileDialogs {
    /// Asks by the desktop's dialogs from now on.
    pub(super) fn use_native(&mut self, native: Option<NativeDialogs>) {
        self.native = native;
    }

    /// Opens a dialog that suggests a path; for a file to open, its folder counts. An open dialog stays.
    pub(super) fn ask(&mut self, purpose: FilePurpose, suggested: PathBuf) {
        if self.open.is_some() {
            return;
        }
        let native = self.native.as_ref().and_then(|native| native.ask(&purpose, &suggested).ok());
        self.open = Some(match native {
            Some(answer) => OpenDialog::Native(purpose, suggested, Instant::now(), answer),
            None => OpenDialog::InWindow(PathDialog::new(purpose, &suggested)),
        });
    }

    /// Closes the dialog in the window without a choice. The desktop's own closes itself.
    pub(super) fn close(&mut self) {
        if matches!(self.open, Some(OpenDialog::InWindow(_))) {
            self.open = None;
        }
    }

    /// Shows the open dialog; returns the chosen file once.
    pub(super) fn show(&mut self, ctx: &Context, scale: f32) -> Option<ChosenFile> {
        match self.open.take()? {
            OpenDialog::Native(purpose, suggested, since, answer) => match answer.try_recv() {
                Err(TryRecvError::Empty) => {
                    self.open = Some(OpenDialog::Native(purpose, suggested, since, answer));
                    None
                }
                Ok(Some(path)) => self.chosen(purpose, &path),
                Ok(None) | Err(TryRecvError::Disconnected) => {
                    if since.elapsed() < SHORTEST_DIALOG {
                        tracing::info!("the desktop shows no file dialogs; the window asks itself");
                        self.native = None;
                        self.ask(purpose, suggested);
                        ctx.request_repaint();
                    }
                    None
                }
            },
            OpenDialog::InWindow(mut dialog) => match dialog.show(ctx, scale) {
                Answer::Open => {
                    self.open = Some(OpenDialog::InWindow(dialog));
                    None
                }
                Answer::Closed => None,
                Answer::Chosen(chosen) => Some(chosen),
            },
        }
    }

    /// A path that the desktop's dialog gave: that has asked before it gives a file that is there. A name without an ending gets
    /// one afterwards, so the window's own dialog asks about that name.
    fn chosen(&mut self, purpose: FilePurpose, path: &Path) -> Option<ChosenFile> {
        match purpose.with_ending(path) {
            Ok(whole) if whole == path || !whole.exists() => {
                let replace = purpose.saves() && whole == path;
                Some(ChosenFile { purpose, path: whole, replace })
            }
            outcome => {
                let mut dialog = PathDialog::new(purpose, path);
                dialog.problem = outcome.err();
                self.open = Some(OpenDialog::InWindow(dialog));
                None
            }
        }
    }
}

/// What a dialog in the window has led to.
enum Answer {
    Open,
    Closed,
    Chosen(ChosenFile),
}

/// A dialog in the window: a field with the path.
struct PathDialog {
    purpose: FilePurpose,
    text: String,
    /// Folder of relative paths.
    folder: PathBuf,
    /// Why the path cannot be taken.
    problem: Option<String>,
    /// The path of an existing file that the person was told about.
    warned: Option<PathBuf>,
    /// Whether the field has had the focus.
    focused: bool,
}

impl PathDialog {
    fn new(purpose: FilePurpose, suggested: &Path) -> Self {
        let folder = suggested.parent().unwrap_or(Path::new("/")).to_owned();
        let text = if purpose.saves() {
            suggested.display().to_string()
        } else {
            format!("{}/", folder.display().to_string().trim_end_matches('/'))
        };
        Self { purpose, text, folder, problem: None, warned: None, focused: false }
    }

    fn show(&mut self, ctx: &Context, scale: f32) -> Answer {
        let mut answer = Answer::Open;
        let mut stays = true;
        let window = egui::Window::new(self.purpose.title()).id(egui::Id::unique("file dialog"));
        let window = window.anchor(Align2::CENTER_CENTER, [0.0, 0.0]).collapsible(false).resizable(false);
        window.open(&mut stays).show(ctx, |ui| {
            let width = (FIELD * scale).min(0.9 * ctx.content_rect().width());
            // A window of egui would narrow its content to its own usual width.
            ui.set_min_width(width);
            let field = ui.add(TextEdit::singleline(&mut self.text).desired_width(width).hint_text("path"));
            if !self.focused {
                field.request_focus();
                self.focused = field.has_focus();
            }
            if field.changed() {
                (self.problem, self.warned) = (None, None);
            }
            if let Some(problem) = &self.problem {
                ui.colored_label(ui.visuals().error_fg_color, problem);
            }
            let enter = field.lost_focus() && ui.input(|i| i.key_pressed(Key::Enter));
            ui.horizontal(|ui| {
                let accept = match (self.purpose.saves(), &self.warned) {
                    (false, _) => "Open",
                    (true, None) => "Save",
                    (true, Some(_)) => "Replace",
                };
                if ui.button(accept).clicked() || enter {
                    match self.checked() {
                        Ok(chosen) => answer = Answer::Chosen(chosen),
                        Err(problem) => {
                            self.problem = Some(problem);
                            // The next Enter belongs to the field again.
                            field.request_focus();
                        }
                    }
                }
                if ui.button("Cancel").clicked() {
                    answer = Answer::Closed;
                }
            });
            if ui.input(|i| i.key_pressed(Key::Escape)) {
                answer = Answer::Closed;
            }
        });
        if stays { answer } else { Answer::Closed }
    }

    /// The chosen file, or why the path cannot be taken.
    fn checked(&mut self) -> Result<ChosenFile, String> {
        let typed = absolute(&self.text, &self.folder).ok_or("type a path")?;
        let (purpose, path) = (self.purpose.clone(), self.purpose.with_ending(&typed)?);
        if !purpose.saves() {
            let exists = path.exists();
            return if exists {
                Ok(ChosenFile { purpose, path, replace: false })
            } else {
                Err("there is no such file".to_owned())
            };
        }
        if !path.parent().is_some_and(Path::is_dir) {
            return Err("there is no such folder".to_owned());
        }
        let chosen = ChosenFile { purpose, path, replace: self.warned.is_some() };
        match chosen.path.symlink_metadata() {
            Err(_) => Ok(ChosenFile { replace: false, ..chosen }),
            Ok(found) if found.is_dir() => Err("this is a folder; give a name in it".to_owned()),
            Ok(_) if chosen.is_project() => Err("a project is never replaced; give another name".to_owned()),
            Ok(_) if self.warned.as_ref() == Some(&chosen.path) => Ok(chosen),
            Ok(_) => {
                self.warned = Some(chosen.path);
                Err("a file has this name; press Enter again to replace it".to_owned())
            }
        }
    }
}

/// A typed path, absolute: `~` is the home folder, other relative paths are in `folder`. `None` for nothing.
fn absolute(text: &str, folder: &Path) -> Option<PathBuf> {
    let text = text.trim();
    if text.is_empty() {
        return None;
    }
    let home = || std::env::home_dir().filter(|home| home.is_absolute());
    if let (Some(rest), Some(home)) =
        (text.strip_prefix('~').filter(|rest| rest.is_empty() || rest.starts_with('/')), home())
    {
        return Some(home.join(rest.trim_start_matches('/')));
    }
    std::path::absolute(folder.join(text)).ok()
}

#[cfg(test)]
mod tests {
    use sg_proto::launch::{GaussianChoice, GaussianPart};

    use super::*;

    fn export() -> FilePurpose {
        FilePurpose::Export(GaussianChoice { part: GaussianPart::Visible.into(), unit: String::new() })
    }

    #[test]
    fn a_file_that_is_there_is_replaced_only_after_a_second_consent() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("old.ply"), "ply").unwrap();
        std::fs::write(at("old.sgproj"), "").unwrap();
        let mut dialog = PathDialog::new(export(), &at("new.ply"));
        assert_eq!(dialog.checked().map(|c| (c.path, c.replace)), Ok((at("new.ply"), false)));
        dialog.text = "old".to_owned();
        assert!(dialog.checked().unwrap_err().contains("press Enter again"));
        assert_eq!(dialog.checked().map(|c| (c.path, c.replace)), Ok((at("old.ply"), true)));
        dialog.text = "none/a.ply".to_owned();
        assert!(dialog.checked().unwrap_err().contains("no such folder"));
        dialog.text = folder.path().display().to_string();
        dialog.purpose = FilePurpose::Copy;
        for (text, said) in [("old.sgproj", "never replaced"), ("  ", "type a path")] {
            dialog.text = text.to_owned();
            assert!(dialog.checked().unwrap_err().contains(said), "{text}");
        }
        let mut dialog = PathDialog::new(FilePurpose::Open, &at("any"));
        assert_eq!(dialog.text, format!("{}/", folder.path().display()));
        assert!(dialog.checked().is_ok(), "a folder may be a scene");
        dialog.text.push_str("none.ply");
        assert!(dialog.checked().unwrap_err().contains("no such file"));
    }

    #[test]
    fn typed_paths_are_absolute() {
        let folder = Path::new("/data/hearts");
        assert_eq!(absolute(" a b.ply ", folder), Some("/data/hearts/a b.ply".into()));
        assert_eq!(absolute("/x/y.ply", folder), Some("/x/y.ply".into()));
        assert_eq!(absolute("~x.ply", folder), Some("/data/hearts/~x.ply".into()));
        if let Some(home) = std::env::home_dir().filter(|home| home.is_absolute()) {
            assert_eq!(absolute("~/x.ply", folder), Some(home.join("x.ply")));
        }
        assert_eq!(absolute("", folder), None);
    }
}
