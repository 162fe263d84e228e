//! The scale bar in the corner of a window's picture: a round length at the depth of the target.

use egui::{Align2, Color32, FontId, Painter, Pos2, Rect, Stroke, Ui, Vec2};
use sg_scene::orientation::LengthUnit;

use super::round_length::{LABELS, round_length};
use super::scene_view::SceneView;
use crate::display::number_format::count;

/// Greatest length of the bar in points, at the usual text size.
const LONGEST: f32 = 160.0;

/// Greatest share of the picture's width.
const SHARE: f32 = 0.3;

/// Points from the picture's left and lower edges.
const INSET: Vec2 = Vec2::new(18.0, 20.0);

/// A length and its label.
#[derive(Debug, Clone, PartialEq)]
struct Bar {
    /// Length in points.
    points: f64,
    /// The same length in words, such as `50 mm`.
    label: String,
}

/// The longest bar of 1, 2 or 5 times a power of ten that is at most `longest` points, where a length unit of the scene takes
/// `points_per_unit`. `None` for lengths that no number can hold.
fn bar(points_per_unit: f64, unit: LengthUnit, longest: f64) -> Option<Bar> {
    let points_per_mm = points_per_unit / unit.millimetres();
    let most = longest / points_per_mm;
    if !(points_per_mm > 0.0 && (1e-9..1e9).contains(&most)) {
        return None;
    }
    let length = round_length(most)?;
    let (_, of, symbol) = LABELS.into_iter().find(|(least, ..)| length >= least * (1.0 - 1e-9))?;
    Some(Bar { points: length * points_per_mm, label: format!("{} {symbol}", number(length / of)) })
}

/// Text with a dark rim: legible on every picture.
pub(super) fn outlined_text(painter: &Painter, at: Pos2, anchor: Align2, text: &str, font: &FontId) {
    for offset in [Vec2::new(1.0, 1.0), Vec2::new(-1.0, 1.0), Vec2::new(1.0, -1.0), Vec2::new(-1.0, -1.0)] {
        painter.text(at + offset, anchor, text, font.clone(), Color32::from_black_alpha(170));
    }
    painter.text(at, anchor, text, font.clone(), Color32::WHITE);
}

/// A number of 1, 2 or 5 times a power of ten, without rounding errors.
fn number(x: f64) -> String {
    if x >= 0.999 { count(x.round() as usize) } else { format!("{x:.3}").trim_end_matches('0').to_owned() }
}

impl SceneView {
    /// Shows the bar at the picture's lower left corner, where the scene has a length unit.
    pub(super) fn scale_bar(&self, ui: &Ui, rect: Rect, scale: f32) {
        let Some(unit) = self.scene.orientation.unit.filter(|_| !self.stereo) else { return };
        let view = self.navigator.view;
        let points_per_unit = self.camera(rect).fy / view.eye.distance(view.target);
        let longest = (LONGEST * scale).min(SHARE * rect.width());
        let Some(Bar { points, label }) = bar(points_per_unit, unit, f64::from(longest)) else { return };
        let start = rect.left_bottom() + scale * Vec2::new(INSET.x, -INSET.y);
        let end = start + Vec2::new(points as f32, 0.0);
        let tick = Vec2::new(0.0, 5.0 * scale);
        let painter = ui.painter_at(rect);
        // A dark edge below a light line: visible on every picture.
        for (width, color) in [(4.5, Color32::from_black_alpha(170)), (2.0, Color32::WHITE)] {
            let stroke = Stroke::new(width, color);
            painter.line_segment([start, end], stroke);
            painter.line_segment([start - tick, start + tick], stroke);
            painter.line_segment([end - tick, end + tick], stroke);
        }
        let above = Pos2::new(start.x + 0.5 * points as f32, start.y - 1.5 * tick.y);
        outlined_text(&painter, above, Align2::CENTER_BOTTOM, &label, &FontId::proportional(14.0 * scale));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn bars_are_the_longest_round_lengths_that_fit() {
        let mm = LengthUnit::Millimetre;
        for (points_per_unit, unit, label, points) in [
            (1.0, mm, "100 mm", 100.0),
            (0.8, mm, "200 mm", 160.0),
            (0.81, mm, "100 mm", 81.0),
            (3.0, mm, "50 mm", 150.0),
            (0.1, mm, "1 m", 100.0),
            (0.01, mm, "10 m", 100.0),
            (100.0, mm, "1 mm", 100.0),
            (200.0, mm, "500 µm", 100.0),
            (0.5, LengthUnit::Micrometre, "200 µm", 100.0),
            (1e5, LengthUnit::Metre, "1 mm", 100.0),
            (2e5, mm, "500 nm", 100.0),
            (1e-5, mm, "10,000 m", 100.0),
        ] {
            let found = bar(points_per_unit, unit, 160.0).unwrap();
            assert_eq!(found.label, label, "{points_per_unit} {unit:?}");
            assert!((found.points - points).abs() < 1e-6, "{found:?}");
        }
        for nothing in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-30, 1e30] {
            assert_eq!(bar(nothing, mm, 160.0), None, "{nothing}");
        }
    }

    proptest! {
        #[test]
        fn a_bar_fills_at_least_two_fifths_of_its_room(exponent in -6.0..7.0_f64, longest in 40.0..300.0_f64) {
            let found = bar(10_f64.powf(exponent), LengthUnit::Millimetre, longest).unwrap();
            prop_assert!(found.points <= longest * 1.000_001 && found.points > 0.399 * longest, "{:?}", found);
        }
    }
}
