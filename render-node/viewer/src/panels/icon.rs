//! Small pictures on buttons and beside headings, drawn as lines so that they are sharp at every size.

use egui::epaint::CubicBezierShape;
use egui::{Painter, Rect, Shape, Stroke, pos2, vec2};

/// Icon of a button or of a panel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Icon {
    /// An eye; crossed out when off.
    Eye,
    /// A lock; open when off.
    Lock,
    /// Sheets above each other.
    Layers,
    /// A loop with a loose end.
    Lasso,
    /// A speech bubble.
    Speech,
}

/// Draws an icon into a square.
pub(super) fn draw(painter: &Painter, icon: Icon, on: bool, square: Rect, stroke: Stroke) {
    let at = |x: f32, y: f32| square.center() + 0.5 * square.size() * vec2(x, y);
    match icon {
        Icon::Layers => {
            let sheet = |y: f32, points: &[(f32, f32)]| points.iter().map(|(px, py)| at(*px, y + py)).collect();
            painter.add(Shape::closed_line(sheet(-0.3, &[(0.0, -0.5), (0.9, 0.0), (0.0, 0.5), (-0.9, 0.0)]), stroke));
            for y in [0.1, 0.5] {
                painter.add(Shape::line(sheet(y, &[(-0.9, 0.0), (0.0, 0.5), (0.9, 0.0)]), stroke));
            }
        }
        Icon::Lasso => {
            let loop_of = |k: u32| {
                let turn = std::f32::consts::TAU * k as f32 / 24.0;
                at(0.9 * turn.cos(), 0.55 * turn.sin() - 0.35)
            };
            painter.add(Shape::closed_line((0..24).map(loop_of).collect(), stroke));
            let end = [at(-0.45, 0.1), at(-0.6, 0.6), at(-0.2, 0.5), at(-0.3, 0.95)];
            painter.add(CubicBezierShape::from_points_stroke(end, false, egui::Color32::TRANSPARENT, stroke));
        }
        Icon::Speech => {
            let bubble =
                [(-0.9, -0.75), (0.9, -0.75), (0.9, 0.35), (-0.1, 0.35), (-0.5, 0.85), (-0.5, 0.35), (-0.9, 0.35)];
            painter.add(Shape::closed_line(bubble.into_iter().map(|(x, y)| at(x, y)).collect(), stroke));
            for y in [-0.4, 0.0] {
                painter.line_segment([at(-0.5, y), at(0.5, y)], stroke);
            }
        }
        Icon::Eye => {
            for side in [-1.0, 1.0] {
                let lid = [at(-0.9, 0.0), at(-0.4, 0.75 * side), at(0.4, 0.75 * side), at(0.9, 0.0)];
                let curve = CubicBezierShape::from_points_stroke(lid, false, egui::Color32::TRANSPARENT, stroke);
                painter.add(Shape::CubicBezier(curve));
            }
            if on {
                painter.circle_filled(square.center(), 0.14 * square.width(), stroke.color);
            } else {
                painter.line_segment([at(-0.7, 0.75), at(0.7, -0.75)], stroke);
            }
        }
        Icon::Lock => {
            let body = Rect::from_min_max(at(-0.6, -0.05), at(0.6, 0.8));
            painter.rect(
                body,
                2.0,
                if on { stroke.color } else { egui::Color32::TRANSPARENT },
                stroke,
                egui::StrokeKind::Middle,
            );
            // The shackle of an open lock is beside its body.
            let (left, right) = if on { (-0.38, 0.38) } else { (-0.38, 0.45) };
            let top = if on { -0.75 } else { -0.95 };
            let mut shackle = vec![at(left, -0.05)];
            for k in 0..=8 {
                let turn = std::f32::consts::PI * (1.0 - k as f32 / 8.0);
                let (middle, radius) = (0.5 * (left + right), 0.5 * (right - left));
                shackle.push(at(middle + radius * turn.cos(), top + 0.35 - 0.35 * turn.sin()));
            }
            shackle.push(if on { at(right, -0.05) } else { at(right, -0.4) });
            painter.add(Shape::line(shackle, stroke));
            if on {
                painter.circle_filled(pos2(body.center().x, body.center().y), 0.0, stroke.color);
            }
        }
    }
}
