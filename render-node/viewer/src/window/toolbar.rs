//! The bars of a window: tools above the picture, the status line below it, and the list of shortcuts.

use egui::{Align2, RichText, Ui};

use super::navigation::NavigationMode;
use super::scene_view::MouseTool;
use super::shortcuts::{Action, MOUSE, SHORTCUTS};
use super::window_ui::WindowUi;
use crate::display::number_format::{count, milliseconds, percent};
use crate::display::{BrushMode, BrushSign, Request, ViewState};
use crate::panels::theme;
use sg_raster::render::Quality;

/// Least width of the window in points for two columns of shortcuts, at the usual text size.
const TWO_COLUMNS: f32 = 1100.0;

/// Points of the window's height that the list of shortcuts leaves to its title and margins.
const AROUND_HELP: f32 = 110.0;

impl WindowUi {
    /// Tools and other actions without a panel.
    pub(super) fn toolbar(&mut self, ui: &mut Ui, state: &ViewState, requests: &mut Vec<Request>) {
        ui.horizontal_wrapped(|ui| {
            for mouse_tool in MouseTool::ALL {
                if mouse_tool == MouseTool::Navigate || state.services.selection {
                    ui.selectable_value(&mut self.scene_view.mouse_tool, mouse_tool, mouse_tool.name());
                }
            }
            if state.services.selection {
                ui.separator();
                for mode in BrushMode::ALL {
                    ui.selectable_value(&mut self.tools.mode, mode, mode.name()).on_hover_text(mode.hint());
                }
                let does = "limits the depth of brush, lasso, rectangle and polygon (Z)";
                if ui.selectable_label(self.tools.front_only, "in front").on_hover_text(does).clicked() {
                    self.tools.front_only = !self.tools.front_only;
                }
            }
            ui.separator();
            for navigation_mode in NavigationMode::ALL {
                ui.selectable_value(
                    &mut self.scene_view.navigator.navigation_mode,
                    navigation_mode,
                    navigation_mode.name(),
                );
            }
            ui.separator();
            let buttons = [
                (Action::Undo, "undo", state.services.scene, !state.undo.is_empty()),
                (Action::Redo, "redo", state.services.scene, !state.redo.is_empty()),
                (Action::Fit, "fit", true, true),
                (Action::Stereo, "stereo", true, true),
                (Action::Picture, "picture", true, true),
                (Action::Turntable, "turntable", true, true),
                (Action::Panels, "panels", true, true),
                (Action::Help, "?", true, true),
            ];
            for (action, name, services, enabled) in buttons {
                let written = SHORTCUTS.iter().find(|s| s.action == action).map_or("", |s| s.written);
                if services && ui.add_enabled(enabled, egui::Button::new(name)).on_hover_text(written).clicked() {
                    self.act(action, state, requests);
                }
            }
        });
    }

    /// The status line: renderer, selection, messages.
    pub(super) fn status(&mut self, ui: &mut Ui, state: &ViewState) {
        ui.horizontal_wrapped(|ui| {
            let newest = &self.scene_view.newest;
            let level = newest.level.map_or_else(String::new, |level| {
                let quality = match level.quality {
                    Quality::Exact => "exact",
                    Quality::Standard => "standard",
                    Quality::Fast => "fast",
                };
                let scale =
                    if level.scale < 1.0 { format!(", {} of the edge", percent(level.scale)) } else { String::new() };
                let late = count(self.scene_view.late() as usize);
                format!("{quality}{scale}, {}, {late} late", milliseconds(newest.seconds))
            });
            let short = match newest.level {
                None => "Drawing…",
                Some(level) if level.scale < 1.0 || level.quality == Quality::Fast => "Preview",
                Some(_) => "Full quality",
            };
            ui.label(short).on_hover_text(format!("{}: {level}", newest.engine));
            ui.separator();
            let uncommitted = if state.uncommitted { ", Updating…" } else { "" };
            ui.label(format!(
                "{} of {} Gaussians selected{uncommitted}",
                count(state.selected.count()),
                count(state.scene.existing_count())
            ));
            if self.view_port.dropped() > 0 {
                ui.separator();
                ui.label(format!("{} requests refused", count(self.view_port.dropped() as usize)));
            }
            if let Some(trouble) = &newest.trouble {
                ui.separator();
                ui.label(RichText::new(trouble).color(theme::color_of(BrushSign::Remove)));
            }
            if let Some((share, what)) = self.exporter.progress() {
                ui.separator();
                ui.add(egui::ProgressBar::new(share).desired_width(120.0).text(what));
                ui.ctx().request_repaint_after(std::time::Duration::from_millis(200));
            }
            if !self.line.is_empty() {
                ui.separator();
                ui.label(&self.line);
            }
        });
    }

    /// The list of shortcuts, as wide as the room allows; a long list scrolls.
    pub(super) fn show_help(&mut self, ui: &Ui) {
        let room = ui.ctx().content_rect().size();
        let scale = self.tools.scale;
        let columns = if room.x < TWO_COLUMNS * scale { 1 } else { 2 };
        let help = egui::Window::new("Keys and mouse").id(egui::Id::unique("help"));
        let help = help.anchor(Align2::CENTER_CENTER, [0.0, 0.0]);
        help.open(&mut self.help).collapsible(false).resizable(false).show(ui.ctx(), |ui| {
            let height = (room.y - AROUND_HELP * scale).max(AROUND_HELP * scale);
            egui::ScrollArea::vertical().max_height(height).min_scrolled_height(height).show(ui, |ui| {
                // Lines as close as text is, not as buttons are.
                ui.spacing_mut().interact_size.y = 0.0;
                let grid = |name: &str| egui::Grid::new(name.to_owned()).spacing([14.0 * scale, 3.0 * scale]);
                let rows = SHORTCUTS.len().div_ceil(columns);
                grid("shortcuts").show(ui, |ui| {
                    for row in 0..rows {
                        for shortcut in SHORTCUTS.iter().skip(row).step_by(rows) {
                            ui.strong(shortcut.written);
                            ui.label(shortcut.does);
                        }
                        ui.end_row();
                    }
                });
                ui.separator();
                grid("mouse").max_col_width(0.6 * room.x).show(ui, |ui| {
                    for (what, does) in MOUSE {
                        ui.strong(*what);
                        ui.label(*does);
                        ui.end_row();
                    }
                });
            });
        });
    }
}
