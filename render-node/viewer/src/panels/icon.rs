//! Small pictures on buttons and beside headings, drawn as lines so that they are sharp at every size.

use egui::epaint::CubicBezierShape;
use egui::{Painter, Rect, Shape, Stroke, pos2, vec2};

/// Icon of a button or of a panel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Icon {
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
    /// Arrows to four sides.
    Arrows,
    /// A brush with its tip.
    Brush,
    /// A rectangle with marked corners.
    Rectangle,
    /// A polygon with marked corners.
    Polygon,
    /// A ball with its equator.
    Sphere,
    /// A cube seen obliquely.
    Cube,
    /// Three arrows from a square.
    Move,
    /// A whole outline with its filled middle.
    Region,
    /// One of four patches.
    Patch,
    /// One dot.
    Dot,
    /// A sheet before another.
    InFront,
    /// A circle with an arrow about it.
    Orbit,
    /// A ball with its meridians.
    Ball,
    /// A paper plane.
    Plane,
    /// An arrow back.
    Undo,
    /// An arrow forward.
    Redo,
    /// Four corners about a dot.
    Fit,
    /// Two pictures side by side.
    Stereo,
    /// A camera.
    Camera,
    /// A turntable: an ellipse with an arrow above it.
    Turntable,
    /// A window with its column.
    Panels,
}

/// Lines of an icon through points, and its circles: middle, radius, whether it is filled. From -1 to 1, y down.
type Lines = (&'static [&'static [(f32, f32)]], &'static [(f32, f32, f32, bool)]);

/// Lines and circles of an icon that consists of them alone.
fn lines(icon: Icon) -> Option<Lines> {
    Some(match icon {
        Icon::Arrows => (
            &[
                &[(-0.9, 0.0), (0.9, 0.0)],
                &[(0.0, -0.9), (0.0, 0.9)],
                &[(-0.6, -0.3), (-0.9, 0.0), (-0.6, 0.3)],
                &[(0.6, -0.3), (0.9, 0.0), (0.6, 0.3)],
                &[(-0.3, -0.6), (0.0, -0.9), (0.3, -0.6)],
                &[(-0.3, 0.6), (0.0, 0.9), (0.3, 0.6)],
            ],
            &[],
        ),
        Icon::Brush => (
            &[
                &[(0.9, -0.9), (-0.1, 0.1)],
                &[(-0.3, -0.1), (0.1, 0.3), (-0.3, 0.75), (-0.9, 0.9), (-0.7, 0.3), (-0.3, -0.1)],
            ],
            &[],
        ),
        Icon::Rectangle => (
            &[&[(-0.8, -0.6), (0.8, -0.6), (0.8, 0.6), (-0.8, 0.6), (-0.8, -0.6)]],
            &[(-0.8, -0.6, 0.18, true), (0.8, 0.6, 0.18, true)],
        ),
        Icon::Polygon => (
            &[&[(-0.85, 0.1), (-0.1, -0.8), (0.85, -0.3), (0.5, 0.75), (-0.5, 0.75), (-0.85, 0.1)]],
            &[(-0.85, 0.1, 0.18, true), (0.85, -0.3, 0.18, true), (-0.1, -0.8, 0.18, true)],
        ),
        Icon::Sphere => (
            &[&[(-0.85, 0.0), (-0.6, 0.2), (-0.2, 0.3), (0.2, 0.3), (0.6, 0.2), (0.85, 0.0)]],
            &[(0.0, 0.0, 0.85, false)],
        ),
        Icon::Cube => (
            &[
                &[(-0.8, -0.3), (0.3, -0.3), (0.3, 0.8), (-0.8, 0.8), (-0.8, -0.3)],
                &[(-0.8, -0.3), (-0.3, -0.8), (0.8, -0.8), (0.3, -0.3)],
                &[(0.8, -0.8), (0.8, 0.3), (0.3, 0.8)],
            ],
            &[],
        ),
        Icon::Move => (
            &[
                &[(-0.3, 0.3), (-0.3, -0.9)],
                &[(-0.6, -0.6), (-0.3, -0.9), (0.0, -0.6)],
                &[(-0.3, 0.3), (0.9, 0.3)],
                &[(0.6, 0.0), (0.9, 0.3), (0.6, 0.6)],
                &[(-0.3, 0.3), (-0.85, 0.85)],
                &[(-0.85, 0.45), (-0.85, 0.85), (-0.45, 0.85)],
            ],
            &[(-0.3, 0.3, 0.22, true)],
        ),
        Icon::Region => (&[], &[(0.0, 0.0, 0.9, false), (0.0, 0.0, 0.45, true)]),
        Icon::Patch => (
            &[
                &[(-0.85, -0.85), (0.85, -0.85), (0.85, 0.85), (-0.85, 0.85), (-0.85, -0.85)],
                &[(0.0, -0.85), (0.0, 0.85)],
                &[(-0.85, 0.0), (0.85, 0.0)],
            ],
            &[(0.42, -0.42, 0.28, true)],
        ),
        Icon::Dot => (&[], &[(0.0, 0.0, 0.35, true)]),
        Icon::InFront => (
            &[
                &[(-0.85, -0.3), (0.3, -0.3), (0.3, 0.85), (-0.85, 0.85), (-0.85, -0.3)],
                &[(-0.3, -0.5), (-0.3, -0.85), (0.85, -0.85), (0.85, 0.3), (0.5, 0.3)],
            ],
            &[(-0.28, 0.28, 0.2, true)],
        ),
        Icon::Orbit => (
            &[
                &[
                    (0.9, -0.1),
                    (0.6, -0.65),
                    (0.0, -0.88),
                    (-0.6, -0.65),
                    (-0.88, 0.0),
                    (-0.6, 0.65),
                    (0.0, 0.88),
                    (0.6, 0.65),
                ],
                &[(0.5, -0.2), (0.9, -0.1), (0.95, -0.55)],
            ],
            &[(0.0, 0.0, 0.16, true)],
        ),
        Icon::Ball => (
            &[
                &[(-0.9, 0.0), (-0.5, 0.2), (0.0, 0.27), (0.5, 0.2), (0.9, 0.0)],
                &[(0.0, -0.9), (0.2, -0.5), (0.27, 0.0), (0.2, 0.5), (0.0, 0.9)],
            ],
            &[(0.0, 0.0, 0.9, false)],
        ),
        Icon::Plane => {
            (&[&[(-0.9, 0.1), (0.9, -0.85), (0.3, 0.85), (-0.1, 0.3), (-0.9, 0.1)], &[(-0.1, 0.3), (0.9, -0.85)]], &[])
        }
        Icon::Undo => (
            &[
                &[(-0.9, -0.25), (0.3, -0.25), (0.75, 0.0), (0.85, 0.35), (0.7, 0.65), (0.3, 0.8), (-0.2, 0.8)],
                &[(-0.45, -0.7), (-0.9, -0.25), (-0.45, 0.2)],
            ],
            &[],
        ),
        Icon::Redo => (
            &[
                &[(0.9, -0.25), (-0.3, -0.25), (-0.75, 0.0), (-0.85, 0.35), (-0.7, 0.65), (-0.3, 0.8), (0.2, 0.8)],
                &[(0.45, -0.7), (0.9, -0.25), (0.45, 0.2)],
            ],
            &[],
        ),
        Icon::Fit => (
            &[
                &[(-0.9, -0.4), (-0.9, -0.9), (-0.4, -0.9)],
                &[(0.9, -0.4), (0.9, -0.9), (0.4, -0.9)],
                &[(-0.9, 0.4), (-0.9, 0.9), (-0.4, 0.9)],
                &[(0.9, 0.4), (0.9, 0.9), (0.4, 0.9)],
            ],
            &[(0.0, 0.0, 0.35, true)],
        ),
        Icon::Stereo => (
            &[
                &[(-0.95, -0.55), (-0.08, -0.55), (-0.08, 0.55), (-0.95, 0.55), (-0.95, -0.55)],
                &[(0.08, -0.55), (0.95, -0.55), (0.95, 0.55), (0.08, 0.55), (0.08, -0.55)],
            ],
            &[(-0.45, 0.0, 0.16, true), (0.58, 0.0, 0.16, true)],
        ),
        Icon::Camera => (
            &[&[
                (-0.9, -0.45),
                (-0.45, -0.45),
                (-0.25, -0.75),
                (0.25, -0.75),
                (0.45, -0.45),
                (0.9, -0.45),
                (0.9, 0.7),
                (-0.9, 0.7),
                (-0.9, -0.45),
            ]],
            &[(0.0, 0.1, 0.36, false)],
        ),
        Icon::Turntable => (
            &[
                &[
                    (-0.9, 0.3),
                    (-0.6, 0.05),
                    (0.0, -0.05),
                    (0.6, 0.05),
                    (0.9, 0.3),
                    (0.6, 0.55),
                    (0.0, 0.65),
                    (-0.5, 0.58),
                ],
                &[(-0.15, 0.3), (-0.5, 0.58), (-0.15, 0.95)],
                &[(-0.3, -0.1), (-0.3, -0.7), (0.3, -0.7), (0.3, -0.1)],
            ],
            &[],
        ),
        Icon::Panels => (
            &[
                &[(-0.9, -0.7), (0.9, -0.7), (0.9, 0.7), (-0.9, 0.7), (-0.9, -0.7)],
                &[(-0.25, -0.7), (-0.25, 0.7)],
                &[(-0.75, -0.3), (-0.42, -0.3)],
                &[(-0.75, 0.05), (-0.42, 0.05)],
            ],
            &[],
        ),
        Icon::Eye | Icon::Lock | Icon::Layers | Icon::Lasso | Icon::Speech => return None,
    })
}

/// Draws an icon into a square.
pub(crate) fn draw(painter: &Painter, icon: Icon, on: bool, square: Rect, stroke: Stroke) {
    let at = |x: f32, y: f32| square.center() + 0.5 * square.size() * vec2(x, y);
    if let Some((lines, circles)) = lines(icon) {
        for line in lines {
            painter.add(Shape::line(line.iter().map(|(x, y)| at(*x, *y)).collect(), stroke));
        }
        for (x, y, radius, is_filled) in circles {
            let (middle, radius) = (at(*x, *y), 0.5 * radius * square.width());
            if *is_filled {
                painter.circle_filled(middle, radius, stroke.color);
            } else {
                painter.circle_stroke(middle, radius, stroke);
            }
        }
        return;
    }
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
        _ => {}
    }
}
