//! The bars of a window: tools above the picture, the status line below it, and the list of shortcuts.

use egui::{Align2, Label, RichText, Ui};

use super::mouse_tool::MouseTool;
use super::navigation::NavigationMode;
use super::shortcuts::{Action, Group, MOUSE, SHORTCUTS, rows};
use super::window_ui::WindowUi;
use crate::display::number_format::{count, milliseconds, percent};
use crate::display::{BrushMode, BrushSign, Request, ViewState};
use crate::panels::{Icon, capital, labelled_button, mode_icon, theme};
use sg_raster::render::Quality;

/// Least width of the window in points for two columns of shortcuts, at the usual text size.
const TWO_COLUMNS: f32 = 1100.0;

/// Least width of a toolbar whose icons have labels, points at the usual size of text.
const LABELLED: f32 = 900.0;

/// Points of the window's height that the list of shortcuts leaves to its title and margins.
const AROUND_HELP: f32 = 110.0;

impl WindowUi {
    /// Tools and other actions without a panel.
    pub(super) fn toolbar(&mut self, ui: &mut Ui, state: &ViewState, requests: &mut Vec<Request>) {
        let short = ui.available_width() < LABELLED * self.tools.scale;
        ui.horizontal_wrapped(|ui| {
            self.file_menu(ui, state, requests);
            ui.separator();
            // With panels, the tools head the column of the task.
            if !self.panels_shown {
                self.tool_choice(ui, state, short);
                if state.services.selection {
                    ui.separator();
                    for mode in BrushMode::ALL {
                        if labelled_button(
                            ui,
                            (Some(mode_icon(mode)), mode.name(), short),
                            self.tools.mode == mode,
                            mode.hint(),
                        )
                        .clicked()
                        {
                            self.tools.mode = mode;
                        }
                    }
                }
                ui.separator();
            }
            for mode in NavigationMode::ALL {
                let navigator = &mut self.scene_view.navigator;
                let is_chosen = navigator.navigation_mode == mode;
                if labelled_button(ui, (Some(navigation_icon(mode)), mode.name(), short), is_chosen, mode.hint())
                    .clicked()
                {
                    navigator.navigation_mode = mode;
                }
            }
            ui.separator();
            let buttons = [
                // The scene knows its steps, also before their names are known here.
                (Action::Undo, "undo", state.services.scene, !state.undo.is_empty() || !state.knows_steps()),
                (Action::Redo, "redo", state.services.scene, !state.redo.is_empty()),
                (Action::Fit, "fit", true, true),
                (Action::Stereo, "stereo", true, true),
                (Action::Picture, "picture", true, true),
                (Action::Turntable, "turntable", true, true),
                (Action::Panels, "panels", true, true),
                (Action::Help, "?", true, true),
            ];
            for (action, name, services, enabled) in buttons {
                let does = match action {
                    Action::Undo => explained(action, state.undo_step()),
                    Action::Redo => explained(action, state.redo_step()),
                    _ => explained(action, None),
                };
                let button = |ui: &mut Ui| labelled_button(ui, (icon_of(action), name, short), false, &does);
                if services && ui.add_enabled(enabled, button).clicked() {
                    self.act(action, state, requests);
                }
            }
        });
    }

    /// The tool of the left button, as icons alone where that is `short`, and whether it reaches behind what is in front.
    pub(super) fn tool_choice(&mut self, ui: &mut Ui, state: &ViewState, short: bool) {
        for mouse_tool in MouseTool::ALL {
            let is_there = match mouse_tool {
                MouseTool::Navigate => true,
                MouseTool::Move => state.services.scene,
                _ => state.services.selection,
            };
            if is_there {
                let is_chosen = self.scene_view.mouse_tool == mouse_tool;
                let button = labelled_button(
                    ui,
                    (Some(mouse_tool.icon()), mouse_tool.name(), short),
                    is_chosen,
                    mouse_tool.hint(),
                );
                if mouse_tool == MouseTool::Brush {
                    self.hint_places.brush = Some(button.rect);
                }
                if button.clicked() {
                    self.scene_view.mouse_tool = mouse_tool;
                }
            }
        }
        if state.services.selection {
            let does = "Brush, lasso, rectangle and polygon leave out what lies behind the surface in front. (Z)";
            if labelled_button(ui, (Some(Icon::InFront), "in front", short), self.tools.front_only, does).clicked() {
                self.tools.front_only = !self.tools.front_only;
            }
        }
    }

    /// The status line: renderer, selection, messages.
    pub(super) fn status(&mut self, ui: &mut Ui, state: &ViewState) {
        ui.horizontal(|ui| {
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
                // The picture of a change is still being drawn.
                Some(_) if !self.scene_view.is_current() => "Preview",
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
                ui.add(Label::new(RichText::new(trouble).color(theme::color_of(BrushSign::Remove))).truncate());
            }
            if let Some((share, what)) = self.exporter.progress() {
                ui.separator();
                let text = format!("{what} {}, Esc cancels", percent(share.into()));
                ui.add(egui::ProgressBar::new(share).desired_width(220.0 * self.tools.scale).text(text));
                ui.ctx().request_repaint_after(std::time::Duration::from_millis(200));
            }
            if !self.line.is_empty() {
                ui.separator();
                // In a narrow window it ends in an ellipsis, and its tooltip has the whole line.
                ui.add(Label::new(&self.line).truncate());
            }
        });
    }

    /// The list of shortcuts, as wide as the room allows; a long list scrolls.
    pub(super) fn show_help(&mut self, ui: &Ui) {
        let room = ui.ctx().content_rect().size();
        let scale = self.tools.scale;
        let is_wide = room.x >= TWO_COLUMNS * scale;
        let help = egui::Window::new("Keys and mouse").id(egui::Id::unique("help"));
        let help = help.anchor(Align2::CENTER_CENTER, [0.0, 0.0]);
        help.open(&mut self.help).collapsible(false).resizable(false).show(ui.ctx(), |ui| {
            let height = (room.y - AROUND_HELP * scale).max(AROUND_HELP * scale);
            egui::ScrollArea::vertical().max_height(height).min_scrolled_height(height).show(ui, |ui| {
                // Lines as close as text is, not as buttons are.
                ui.spacing_mut().interact_size.y = 0.0;
                let grid = |name: &str| egui::Grid::new(name.to_owned()).spacing([14.0 * scale, 0.0]);
                let list = |ui: &mut Ui, group: Group| {
                    ui.colored_label(ui.visuals().hyperlink_color, group.title());
                    grid(group.title()).show(ui, |ui| {
                        for (written, does) in rows(group) {
                            ui.strong(written);
                            ui.label(does);
                            ui.end_row();
                        }
                    });
                };
                if is_wide {
                    ui.horizontal_top(|ui| {
                        for side in [&[Group::Tools, Group::Files][..], &[Group::Selection, Group::View, Group::Other]]
                        {
                            ui.vertical(|ui| side.iter().for_each(|group| list(ui, *group)));
                        }
                    });
                } else {
                    Group::ALL.into_iter().for_each(|group| list(ui, group));
                }
                ui.colored_label(ui.visuals().hyperlink_color, "Mouse");
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

/// Icon of an action of the toolbar.
fn icon_of(action: Action) -> Option<Icon> {
    match action {
        Action::Undo => Some(Icon::Undo),
        Action::Redo => Some(Icon::Redo),
        Action::Fit => Some(Icon::Fit),
        Action::Stereo => Some(Icon::Stereo),
        Action::Picture => Some(Icon::Camera),
        Action::Turntable => Some(Icon::Turntable),
        Action::Panels => Some(Icon::Panels),
        _ => None,
    }
}

fn navigation_icon(mode: NavigationMode) -> Icon {
    match mode {
        NavigationMode::Orbit => Icon::Orbit,
        NavigationMode::Trackball => Icon::Ball,
        NavigationMode::Fly => Icon::Plane,
    }
}

/// What an action does, with its key, and what it is about.
fn explained(action: Action, about: Option<&String>) -> String {
    let Some(shortcut) = SHORTCUTS.iter().find(|s| s.action == action) else { return String::new() };
    match about {
        Some(about) => format!("{}: {about} ({})", capital(shortcut.does), shortcut.written),
        None => format!("{} ({})", capital(shortcut.does), shortcut.written),
    }
}
