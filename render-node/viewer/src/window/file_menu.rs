//! The file menu of a window: opening, recent files, copies, exports and pictures under a name of one's choice.

use std::path::{Path, PathBuf};

use egui::containers::menu::{MenuConfig, SubMenuButton};
use egui::{PopupCloseBehavior, Ui};
use sg_formats::files::short_name;
use sg_proto::launch::save_request::Content;
use sg_proto::launch::{DrawnPicture, GaussianChoice, GaussianPart, ProjectCopy, SaveRequest};
use sg_proto::limits::MAX_PICTURE_PIXELS;
use sg_raster::finish::{Backdrop, Finish};
use sg_volume::lacks_spacing;

use super::exporter::{ExportJob, ExportResult};
use super::file_dialog::ChosenFile;
use super::file_drop::{self, DroppedFile};
use super::file_purpose::FilePurpose;
use super::recent_files::{self, RecentFile};
use super::shortcuts::{Action, SHORTCUTS};
use super::spacing_dialog::SpacingAnswer;
use super::window_files::{PictureOptions, WindowFiles};
use super::window_ui::WindowUi;
use crate::display::number_format::count;
use crate::display::{Request, ViewState};

/// Factors on the size of a saved picture.
const SCALES: [u32; 3] = [1, 2, 4];

impl WindowUi {
    /// Tells the window its files.
    #[must_use]
    pub fn with_files(mut self, files: WindowFiles) -> Self {
        self.file_menu.files = files;
        self
    }

    /// The button of the menu, and the menu where it is open.
    pub(super) fn file_menu(&mut self, ui: &mut Ui, state: &ViewState, requests: &mut Vec<Request>) {
        let shown = ui.menu_button("File", |ui| {
            self.entry(ui, "Open…", Action::Open, state, requests);
            ui.menu_button("Recent", |ui| self.recent_files(ui, requests));
            ui.separator();
            self.entry(ui, "Save a copy…", Action::SaveCopy, state, requests);
            ui.menu_button("Export splats", |ui| self.exports(ui, state));
            // A choice of size is no reason to close.
            let stays = MenuConfig::new().close_behavior(PopupCloseBehavior::CloseOnClickOutside);
            SubMenuButton::new("Save picture").config(stays).ui(ui, |ui| self.pictures(ui, state, requests));
            ui.separator();
            self.entry(ui, "Close window", Action::Close, state, requests);
        });
        let is_open = shown.inner.is_some();
        if is_open && !self.file_menu.is_open {
            let WindowFiles { settings, opened, .. } = &self.file_menu.files;
            let recent = settings.as_deref().map(|path| recent_files::load(path, opened.as_deref()));
            self.file_menu.recent = recent.unwrap_or_default();
        }
        self.file_menu.is_open = is_open;
    }

    fn entry(&mut self, ui: &mut Ui, name: &str, action: Action, state: &ViewState, requests: &mut Vec<Request>) {
        let written = SHORTCUTS.iter().find(|s| s.action == action).map_or("", |s| s.written);
        if ui.add(egui::Button::new(name).shortcut_text(written)).clicked() {
            self.act(action, state, requests);
        }
    }

    fn recent_files(&mut self, ui: &mut Ui, requests: &mut Vec<Request>) {
        if self.file_menu.recent.is_empty() {
            ui.add_enabled(false, egui::Button::new("No other file yet"));
        }
        for RecentFile { path, exists } in self.file_menu.recent.clone() {
            let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
            let folder = path.parent().and_then(Path::file_name).unwrap_or_default().to_string_lossy();
            let entry = ui.add_enabled(exists, egui::Button::new(name).shortcut_text(folder));
            let said = path.display().to_string();
            let gone = format!("{said} is not there any more");
            if entry.on_hover_text(said).on_disabled_hover_text(gone).clicked() {
                self.open_file(path, requests);
            }
        }
    }

    fn exports(&mut self, ui: &mut Ui, state: &ViewState) {
        let selected = state.scene.selection().mask().count();
        let choice = |part: GaussianPart, unit: &str| GaussianChoice { part: part.into(), unit: unit.to_owned() };
        let selection = egui::Button::new(format!("Selection ({})…", count(selected)));
        if ui.add_enabled(selected > 0, selection).clicked() {
            self.ask_export(choice(GaussianPart::Selection, ""), state);
        }
        if ui.button("What is visible…").clicked() {
            self.ask_export(choice(GaussianPart::Visible, ""), state);
        }
        let base = state.scene.base_units().iter().map(|unit| unit.name.as_str());
        let saved = state.scene.units().filter(|unit| !unit.derived).map(|unit| unit.name.as_str());
        let names: Vec<&str> = base.chain(saved).collect();
        ui.separator();
        egui::ScrollArea::vertical().show(ui, |ui| {
            for name in names {
                if ui.button(format!("{name}…")).clicked() {
                    self.ask_export(choice(GaussianPart::Unit, name), state);
                }
            }
        });
    }

    fn pictures(&mut self, ui: &mut Ui, state: &ViewState, requests: &mut Vec<Request>) {
        let [width, height] = self.scene_view.size();
        for scale in SCALES {
            let size =
                format!("{scale}×: {} × {} pixels", count((width * scale) as usize), count((height * scale) as usize));
            let fits = width.max(height) * scale <= MAX_PICTURE_PIXELS;
            ui.add_enabled_ui(fits, |ui| ui.radio_value(&mut self.file_menu.picture.scale, scale, size));
        }
        ui.checkbox(&mut self.file_menu.picture.transparent, "Transparent background");
        ui.separator();
        if ui.button("Save picture…").clicked() {
            let suggested = self.file_menu.suggested(&state.scene.geometry().path, &self.pictures, "", ".png");
            self.file_menu.dialogs.ask(FilePurpose::Picture, suggested);
            ui.close_kind(egui::UiKind::Menu);
        }
        self.entry(ui, "Save at once", Action::Picture, state, requests);
    }

    /// Asks for a file to open.
    pub(super) fn ask_open(&mut self, state: &ViewState) {
        let suggested = self.file_menu.suggested(&state.scene.geometry().path, &self.pictures, "", "");
        self.file_menu.dialogs.ask(FilePurpose::Open, suggested);
    }

    /// Asks for the name of a copy.
    pub(super) fn ask_copy(&mut self, state: &ViewState) {
        let suggested = self.file_menu.suggested(&state.scene.geometry().path, &self.pictures, "-copy", ".sgproj");
        self.file_menu.dialogs.ask(FilePurpose::Copy, suggested);
    }

    /// Asks for the name of the selected Gaussians, or of the visible ones without a selection.
    pub(super) fn ask_usual_export(&mut self, state: &ViewState) {
        let is_none = state.scene.selection().mask().is_none() && !state.uncommitted;
        let part = if is_none { GaussianPart::Visible } else { GaussianPart::Selection };
        self.ask_export(GaussianChoice { part: part.into(), unit: String::new() }, state);
    }

    fn ask_export(&mut self, choice: GaussianChoice, state: &ViewState) {
        if choice.part() == GaussianPart::Selection && state.uncommitted {
            // The scene would write the selection that it has stored, not the one on screen.
            self.line = "the selection is not stored yet; press the key again".to_owned();
            return;
        }
        let suffix = match choice.part() {
            GaussianPart::Selection => "-selection".to_owned(),
            GaussianPart::Unit => format!("-{}", short_name(Path::new(&choice.unit))),
            _ => "-visible".to_owned(),
        };
        let suggested = self.file_menu.suggested(&state.scene.geometry().path, &self.pictures, &suffix, ".ply");
        self.file_menu.dialogs.ask(FilePurpose::Export(choice), suggested);
    }

    /// Shows the open dialogs, and does what the chosen file is for.
    pub(super) fn take_chosen_file(&mut self, ui: &Ui, state: &ViewState, requests: &mut Vec<Request>) {
        if let Some(SpacingAnswer { path, spacing }) = self.file_menu.spacing.show(ui.ctx()) {
            self.line = format!("opening {}", path.display());
            requests.push(Request::Open(path, spacing));
        }
        let Some(chosen) = self.file_menu.dialogs.show(ui.ctx(), self.tools.scale) else { return };
        self.file_menu.last_folder = chosen.path.parent().map(Path::to_owned);
        let is_project = chosen.is_project();
        let ChosenFile { purpose, path, replace } = chosen;
        let everything = GaussianChoice { part: GaussianPart::Everything.into(), unit: String::new() };
        let content = match purpose {
            FilePurpose::Open => return self.open_file(path, requests),
            FilePurpose::Picture => return self.export_named_picture(path, replace, state),
            FilePurpose::Copy if is_project => Content::Project(ProjectCopy {}),
            FilePurpose::Copy => Content::Gaussians(everything),
            FilePurpose::Export(choice) => Content::Gaussians(choice),
        };
        requests.extend(self.saved(&path, replace, content));
    }

    /// The request to save a file. A path that is no text has no message.
    fn saved(&mut self, path: &Path, replace: bool, content: Content) -> Option<Request> {
        let Some(text) = path.to_str() else {
            self.line = format!("{}: give a name of Unicode letters", path.display());
            return None;
        };
        Some(Request::Save(Box::new(SaveRequest { path: text.to_owned(), replace, content: Some(content) })))
    }

    fn export_named_picture(&mut self, path: PathBuf, replace: bool, state: &ViewState) {
        let Some(folder) = self.file_menu.files.scratch.clone() else {
            self.line = "no picture gets a name here; press P to save one".to_owned();
            return;
        };
        let PictureOptions { scale, transparent } = self.file_menu.picture;
        let appearance = self.export_appearance(state);
        let [width, height] = self.scene_view.size();
        let scale = scale.min(MAX_PICTURE_PIXELS / width.max(height).max(1)).max(1);
        let camera = self.scene_view.navigator.camera(width * scale, height * scale);
        let finish = Finish::to_look_at(appearance.background, self.tools.gradient);
        let backdrop = if transparent { Backdrop::Transparent } else { finish.backdrop };
        let finish = Finish { backdrop, ..finish };
        self.line = format!("drawing {}", path.display());
        self.exporter.export(
            &self.scene,
            ExportJob::NamedPicture { camera: Box::new(camera), appearance, finish, folder, path, replace },
        );
    }

    /// Takes the result of an export. A picture with a name goes on its way to it.
    pub(super) fn take_export(&mut self, requests: &mut Vec<Request>) {
        self.line = match self.exporter.take_result() {
            None => return,
            Some(Ok(ExportResult::Saved(line))) => line,
            Some(Err(error)) => format!("nothing was saved: {error}"),
            Some(Ok(ExportResult::Drawn { picture, path, replace })) => {
                self.line.clear();
                let drawn = DrawnPicture { path: picture.display().to_string() };
                requests.extend(self.saved(&path, replace, Content::Picture(drawn)));
                return;
            }
        };
    }

    /// Looks from a camera's file; opens another file in a window of its own. Asks for the spacing of a raw volume first.
    pub(super) fn open_file(&mut self, path: PathBuf, requests: &mut Vec<Request>) {
        let view = &mut self.scene_view.navigator.view;
        self.line = match file_drop::read(&path, view.target) {
            Ok(DroppedFile::View(seen)) => {
                *view = seen;
                format!("view from {}", path.display())
            }
            Ok(DroppedFile::Other) if lacks_spacing(&path) => {
                let line = format!("{} needs the lengths of its voxels", path.display());
                self.file_menu.spacing.ask(path);
                line
            }
            Ok(DroppedFile::Other) => {
                let line = format!("opening {}", path.display());
                requests.push(Request::Open(path, None));
                line
            }
            Err(why) => why,
        };
    }
}
