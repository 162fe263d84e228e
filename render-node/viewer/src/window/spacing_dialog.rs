//! The question for the spacing of a raw volume, which no such file holds.

use std::path::PathBuf;

use egui::{Align2, Context, DragValue, Key};

/// Least and most millimetres between voxels: from molecules to galaxies nobody measures in millimetres.
const RANGE: std::ops::RangeInclusive<f64> = 1e-6..=1e6;

/// What a person has answered.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct SpacingAnswer {
    /// The volume.
    pub(super) path: PathBuf,
    /// Millimetres between its voxels along x, y and z; `None` if they are not known.
    pub(super) spacing: Option<[f64; 3]>,
}

/// The dialog, closed or open. It keeps the numbers from one file to the next.
#[derive(Debug)]
pub(super) struct SpacingDialog {
    path: Option<PathBuf>,
    spacing: [f64; 3],
    /// Whether the first number has had the focus.
    focused: bool,
}

impl Default for SpacingDialog {
    fn default() -> Self {
        Self { path: None, spacing: [1.0; 3], focused: false }
    }
}

impl SpacingDialog {
    /// Asks for the spacing of a volume.
    pub(super) fn ask(&mut self, path: PathBuf) {
        (self.path, self.focused) = (Some(path), false);
    }

    /// Closes the dialog without an answer.
    pub(super) fn close(&mut self) {
        self.path = None;
    }

    /// Shows the dialog where it is open. Returns the answer, once.
    pub(super) fn show(&mut self, ctx: &Context) -> Option<SpacingAnswer> {
        let path = self.path.clone()?;
        let (mut stays, mut answer) = (true, None);
        let window = egui::Window::new("Spacing of the voxels").id(egui::Id::unique("spacing dialog"));
        let window = window.anchor(Align2::CENTER_CENTER, [0.0, 0.0]).collapsible(false).resizable(false);
        window.open(&mut stays).show(ctx, |ui| {
            ui.set_max_width(0.9 * ctx.content_rect().width());
            let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
            ui.label(format!("{name} is raw: it does not tell the lengths of its voxels."));
            ui.horizontal_wrapped(|ui| {
                for (k, (name, length)) in ["x", "y", "z"].into_iter().zip(&mut self.spacing).enumerate() {
                    let number = DragValue::new(length).range(RANGE).speed(0.01).max_decimals(6);
                    let field = ui.add(number.prefix(format!("{name} ")).suffix(" mm"));
                    if k == 0 && !self.focused {
                        field.request_focus();
                        self.focused = true;
                    }
                }
            });
            let enter = ui.input(|i| i.key_pressed(Key::Enter));
            ui.horizontal_wrapped(|ui| {
                let known = ui.button("Open").on_hover_text("with a scale bar and sizes in millimetres");
                if known.clicked() || enter {
                    answer = Some(SpacingAnswer { path: path.clone(), spacing: Some(self.spacing) });
                }
                let unknown = ui.button("The spacing is not known");
                if unknown.on_hover_text("Cubic voxels, and no millimetres").clicked() {
                    answer = Some(SpacingAnswer { path: path.clone(), spacing: None });
                }
                if ui.button("Cancel").clicked() {
                    self.path = None;
                }
            });
            if ui.input(|i| i.key_pressed(Key::Escape)) {
                self.path = None;
            }
        });
        if !stays || answer.is_some() {
            self.path = None;
        }
        answer
    }
}
