//! The present functions of a controller's controls, as labels beside it with lines to the controls.

use egui::{Align, Align2, Color32, CornerRadius, FontId, Pos2, Rect, Stroke, Ui, Vec2};
use glam::{DQuat, DVec2, DVec3};

use super::hand_meshes::Control;
use crate::display::Tools;
use crate::hands::{Pose, Rectangle, Side, facing};
use crate::panels::theme;
use crate::xr::{Frame, PanelLayer, XrError};

/// Points of the labels across and down.
const SIZE: Vec2 = Vec2::new(440.0, 560.0);

/// Pixels of a point.
const SHARPNESS: f32 = 1.5;

/// Distance that the labels are made to be read from, metres.
const READ_FROM: f64 = 0.4;

/// Metres from the middle of a controller to its labels.
const ASIDE: f64 = 0.06;

/// Points of a row and between two rows, at the usual size of text.
const ROW: (f32, f32) = (25.0, 3.0);

/// A control or gesture, and its present function.
type Line = (&'static str, String);

/// Labels of one hand.
pub(super) struct Callouts {
    side: Side,
    layer: PanelLayer,
    lines: Vec<Line>,
    /// What was drawn last: lines, whether it is light, its scale.
    drawn: Option<(Vec<Line>, bool, f32)>,
    /// Frame number of that layout.
    pub(super) since: u64,
    /// Grip of the hand, while the labels are shown.
    grip: Option<Pose>,
}

/// Where labels hang beside a hand: outwards, so that they do not cover what the hands work on.
fn beside(grip: DVec3, eyes: DVec3, side: Side) -> Rectangle {
    let metres = theme::metres_per_point(READ_FROM);
    let size = DVec2::new(f64::from(SIZE.x), f64::from(SIZE.y)) * metres;
    let right = (grip - eyes).with_y(0.0).cross(DVec3::Y).normalize_or(DVec3::X);
    let outwards = if side == Side::Right { right } else { -right };
    let position = grip + (ASIDE + 0.5 * size.x) * outwards;
    Rectangle { pose: Pose { position, orientation: facing(position, eyes) }, size }
}

/// Height of the middle of a row, as a share of the labels' height from the top. The rows stand around the middle.
fn row_at(row: usize, rows: usize, scale: f32) -> f64 {
    let pitch = scale * (ROW.0 + ROW.1);
    f64::from(0.5 + pitch * (row as f32 + 0.5 - 0.5 * rows as f32) / SIZE.y)
}

impl Callouts {
    pub(super) fn new(side: Side) -> Self {
        let pose = Pose { position: DVec3::ZERO, orientation: DQuat::IDENTITY };
        let layer = PanelLayer::new(SIZE, SHARPNESS, Rectangle { pose, size: DVec2::ONE });
        Self { side, layer, lines: Vec::new(), drawn: None, since: 0, grip: None }
    }

    /// Hangs the labels beside a hand, or takes them away. Returns a line from each label to its control.
    pub(super) fn hang(
        &mut self,
        grip: Option<Pose>,
        eyes: DVec3,
        lines: impl FnOnce() -> Vec<Line>,
        tools: &Tools,
    ) -> Vec<[DVec3; 2]> {
        self.grip = grip;
        let Some(grip) = grip else { return Vec::new() };
        self.lines = lines();
        self.layer.place = beside(grip.position, eyes, self.side);
        let inner = if self.side == Side::Right { 0.0 } else { 1.0 };
        let rows = self.lines.len();
        let leader = |(row, (name, _)): (usize, &Line)| {
            let control = Control::named(name)?.place(self.side);
            let label = self.layer.place.point(DVec2::new(inner, row_at(row, rows, tools.scale)));
            Some([label, grip.to_room(control)])
        };
        self.lines.iter().enumerate().filter_map(leader).collect()
    }

    /// Where the labels hang, while they are shown.
    pub(super) fn place(&self) -> Option<Rectangle> {
        self.grip.map(|_| self.layer.place)
    }

    /// Whether they are shown and have changed since their layout.
    pub(super) fn is_stale(&self, tools: &Tools) -> bool {
        let drawn = self.drawn.as_ref();
        let current = |(lines, light, scale): &(Vec<Line>, bool, f32)| {
            *lines == self.lines && *light == tools.light_panels && *scale == tools.scale
        };
        self.grip.is_some() && !drawn.is_some_and(current)
    }

    /// Shows them, with a new layout on request.
    pub(super) fn show(
        &mut self,
        frame: &mut Frame<'_>,
        tools: &Tools,
        anew: bool,
        number: u64,
    ) -> Result<(), XrError> {
        if self.grip.is_none() {
            return Ok(());
        }
        let Self { side, layer, lines, .. } = self;
        let before = layer.counts().laid_out;
        layer.show(frame, None, Vec::new(), anew, |ui| {
            theme::apply(ui.ctx(), tools);
            draw(ui, lines, *side, tools);
        })?;
        if layer.counts().laid_out > before {
            self.drawn = Some((self.lines.clone(), tools.light_panels, tools.scale));
            self.since = number;
        }
        Ok(())
    }
}

/// Draws each line as a card of its own at the side of the controller. What is too long for a line ends in an ellipsis.
fn draw(ui: &Ui, lines: &[Line], side: Side, tools: &Tools) {
    let (visuals, scale) = (ui.visuals(), tools.scale);
    let font = FontId::proportional(0.62 * ROW.0 * scale);
    for (row, (name, does)) in lines.iter().enumerate() {
        let middle = row_at(row, lines.len(), scale) as f32 * SIZE.y;
        let mut job = egui::text::LayoutJob::default();
        let mut add = |text: &str, color: Color32| {
            job.append(text, 0.0, egui::TextFormat { font_id: font.clone(), color, ..Default::default() });
        };
        add(name, visuals.hyperlink_color);
        add("  ", visuals.text_color());
        add(does, visuals.text_color());
        let margin = 8.0 * scale;
        job.wrap = egui::text::TextWrapping::truncate_at_width(SIZE.x - 2.0 * margin);
        job.halign = Align::LEFT;
        let text = ui.painter().layout_job(job);
        let size = Vec2::new(text.size().x + 2.0 * margin, ROW.0 * scale);
        let (anchor, x) = if side == Side::Right { (Align2::LEFT_CENTER, 0.0) } else { (Align2::RIGHT_CENTER, SIZE.x) };
        let card: Rect = anchor.anchor_size(Pos2::new(x, middle), size);
        let edge = Stroke::new(1.0, visuals.hyperlink_color);
        ui.painter().rect(card, CornerRadius::same(5), visuals.panel_fill, edge, egui::StrokeKind::Inside);
        ui.painter().galley(card.left_center() + Vec2::new(margin, -0.5 * text.size().y), text, visuals.text_color());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_hang_outwards_of_their_hand_and_face_the_eyes() {
        let eyes = DVec3::new(0.0, 1.6, 0.0);
        for (side, x) in [(Side::Left, -0.2), (Side::Right, 0.2)] {
            let grip = DVec3::new(x, 1.3, -0.4);
            let place = beside(grip, eyes, side);
            let inner =
                [0.0, 1.0].map(|x| place.point(DVec2::new(x, 0.5)).distance(grip)).into_iter().fold(9.0, f64::min);
            assert!((inner - ASIDE).abs() < 0.03, "{side:?}: {inner}");
            assert!(place.pose.position.x.abs() > x.abs() && (place.pose.position.x > 0.0) == (x > 0.0));
            assert!((place.pose.orientation * DVec3::Z).dot((eyes - place.pose.position).normalize()) > 0.999);
        }
    }

    #[test]
    fn rows_stand_in_order_around_the_middle_and_fit_at_every_size_of_text() {
        for scale in [1.0, 1.25, 1.5, 2.0] {
            let rows: Vec<f64> = (0..9).map(|row| row_at(row, 9, scale)).collect();
            assert!(rows.is_sorted() && (rows[4] - 0.5).abs() < 1e-6, "{rows:?}");
            let half = f64::from(0.5 * ROW.0 * scale / SIZE.y);
            assert!(rows[0] - half >= 0.0 && rows[8] + half <= 1.0, "{scale}: {rows:?}");
        }
    }

    #[test]
    fn leaders_go_from_labels_to_controls() {
        let grip = Pose { position: DVec3::new(0.2, 1.3, -0.4), orientation: DQuat::IDENTITY };
        let mut callouts = Callouts::new(Side::Right);
        let lines = || vec![("trigger", "adds".to_owned()), ("palm to the eyes", "a menu".to_owned())];
        let leaders = callouts.hang(Some(grip), DVec3::new(0.0, 1.6, 0.0), lines, &Tools::default());
        let [[label, control]] = leaders.try_into().unwrap();
        assert!(control.distance(grip.to_room(Control::Trigger.place(Side::Right))) < 1e-12);
        let place = callouts.place().unwrap();
        assert!(label.distance(place.point(DVec2::new(0.0, row_at(0, 2, 1.0)))) < 1e-12);
        assert!(callouts.is_stale(&Tools::default()));
        assert!(callouts.hang(None, DVec3::ZERO, Vec::new, &Tools::default()).is_empty());
        assert!(callouts.place().is_none() && !callouts.is_stale(&Tools::default()));
    }
}
