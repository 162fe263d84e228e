//! The ground grid on the window's picture.

use egui::{Align2, Color32, FontId, Rect, Ui, Vec2};
use sg_scene::appearance::Appearance;

use super::grid::{Ground, INSET, Seen, edges, ground, label};
use super::scale_bar::outlined_text;
use super::scene_lines::LineStyle;
use super::scene_view::SceneView;
use crate::display::{Tools, ViewState};

impl SceneView {
    /// Draws the grid and the box where the window shows them: what the surface in front hides is left out, or faint.
    pub(super) fn show_grid(&mut self, ui: &Ui, rect: Rect, appearance: &Appearance, state: &ViewState, tools: &Tools) {
        if !tools.grid || self.stereo {
            self.ground_grid.drawn = None;
            return;
        }
        let up = self.scene.orientation.with_up(state.scene.up()).up();
        let Some(bounds) = self.ground_grid.bounds(&self.scene, appearance) else { return };
        let ground = ground(bounds, up);
        let background = appearance.background;
        let ink = if background.element_sum() > 1.5 { Color32::BLACK } else { Color32::WHITE };
        let lines = self.scene_lines(rect);
        let (camera, is_known) = lines.seen_by();
        let front = is_known.then_some(self.front_number);
        let seen = Seen { camera: camera.clone(), rect, front, bounds, up, ink };
        let painter = ui.painter_at(rect);
        let shapes = match &self.ground_grid.drawn {
            Some((drawn, shapes)) if *drawn == seen => shapes.clone(),
            _ => {
                let mut shapes = Vec::new();
                let style = |opacity: u8, width, hidden| {
                    let color = Color32::from_rgba_unmultiplied(ink.r(), ink.g(), ink.b(), opacity);
                    LineStyle { color, width, hidden, unknown: 0.4 }
                };
                for ends in ground.iter().flat_map(|ground| &ground.lines) {
                    lines.add(*ends, style(90, 1.0, 0.0), &mut shapes);
                }
                for ends in edges(bounds) {
                    lines.add(ends, style(170, 1.5, 0.2), &mut shapes);
                }
                self.ground_grid.drawn = Some((seen, shapes.clone()));
                shapes
            }
        };
        painter.extend(shapes);
        if let Some(Ground { step, .. }) = ground {
            let at = rect.left_bottom() + tools.scale * Vec2::new(INSET.x, -INSET.y);
            let text = label(step, bounds, self.scene.orientation.unit);
            outlined_text(&painter, at, Align2::LEFT_BOTTOM, &text, &FontId::proportional(14.0 * tools.scale));
        }
    }
}
