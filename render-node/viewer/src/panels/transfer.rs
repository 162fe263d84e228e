//! The transfer function behind a base unit, as a small plot.

use egui::epaint::{Mesh, Vertex, WHITE_UV};
use egui::{
    Align2, Color32, Painter, Pos2, Rect, Role, Sense, Shape, Stroke, TextStyle, Ui, Vec2, WidgetInfo, pos2, vec2,
};
use glam::Vec3;
use sg_volume::scalars::ValueRange;
use sg_volume::transfer::{Scale, TransferFunction};

use crate::display::number_format::number;

/// Steps of a curve.
const STEPS: usize = 160;

/// Height of a plot in points.
const HEIGHT: f32 = 64.0;

/// Colour and opacity over the value, as a plot shows them.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// Name of the quantity, where the file gives one.
    pub quantity: Option<String>,
    /// Least and greatest value, in the file's units.
    pub domain: [f64; 2],
    /// RGB and opacity, 0 to 1, at equal steps from end to end of the scaled domain.
    pub samples: Vec<(Vec3, f32)>,
    /// The values of the base unit, in the file's units, if the file has them.
    pub range: Option<[f64; 2]>,
    scale: Scale,
}

impl Curve {
    /// The curve of one base unit.
    #[must_use]
    pub fn of(function: &TransferFunction, unit: &str) -> Option<Self> {
        // Plotted in the file's own units: normalized values go from 0 to 1 for every volume.
        let classifier = function.classifier(ValueRange { low: 0.0, high: 1.0, non_finite: 0 }).ok()?;
        let [low, high] = function.domain.map(|x| function.scale.apply(x));
        let samples = (0..=STEPS).map(|k| {
            let scaled = low + (high - low) * k as f64 / STEPS as f64;
            classifier.evaluate(unscaled(function.scale, scaled))
        });
        Some(Self {
            quantity: function.variable.clone(),
            domain: function.domain,
            samples: samples.collect(),
            range: function.base_units.iter().find(|b| b.name == unit).map(|b| b.range),
            scale: function.scale,
        })
    }

    /// The curve of one base unit: that of its file's function, or of the one in its place.
    pub(super) fn shown(file: &TransferFunction, other: Option<&TransferFunction>, unit: &str) -> Option<Self> {
        let Some(other) = other else { return Self::of(file, unit) };
        // The ranges of base units are in the units of the file's function.
        let base_units = if other.units == file.units { file.base_units.clone() } else { Vec::new() };
        Self::of(&TransferFunction { variable: file.variable.clone(), base_units, ..other.clone() }, unit)
    }

    /// The value at a position on the axis, 0 to 1.
    pub(super) fn value(&self, place: f64) -> f64 {
        let [low, high] = self.domain.map(|x| self.scale.apply(x));
        unscaled(self.scale, low + (high - low) * place)
    }

    /// The colour of a value.
    pub(super) fn color(&self, value: f64) -> Vec3 {
        let at = (self.place(value) * STEPS as f32).round() as usize;
        self.samples.get(at).map_or(Vec3::ZERO, |(color, _)| *color)
    }

    /// Position of a value on the axis, 0 to 1.
    pub(super) fn place(&self, value: f64) -> f32 {
        let [low, high] = self.domain.map(|x| self.scale.apply(x));
        let at = self.scale.apply(value.clamp(self.domain[0], self.domain[1]));
        ((at - low) / (high - low)) as f32
    }

    /// Draws the plot over the whole width that is left.
    pub(super) fn show(&self, ui: &mut Ui, unit: &str) {
        let small = TextStyle::Small.resolve(ui.style());
        let line = ui.fonts_mut(|f| f.row_height(&small));
        let scale = ui.spacing().interact_size.y / 28.0;
        let size = vec2(ui.available_width(), HEIGHT * scale + line);
        let (whole, response) = ui.allocate_exact_size(size, Sense::hover());
        response.widget_info(|| {
            let [low, high] = self.range.unwrap_or(self.domain);
            let what = format!("transfer function of {unit}, {} to {}", number(low), number(high));
            WidgetInfo::labeled(Role::Image, true, what)
        });
        let plot = Rect::from_min_size(whole.min, Vec2::new(whole.width(), HEIGHT * scale));
        let painter = ui.painter_at(whole);
        let visuals = ui.visuals();
        painter.rect_filled(plot, 4.0, visuals.extreme_bg_color);
        let inner = plot.shrink(2.0);
        let at = |x: f32, y: f32| place_in(inner, x, y);
        self.paint(&painter, inner, visuals.text_color());
        if let Some(range) = self.range {
            for end in range {
                let x = self.place(end);
                painter.line_segment([at(x, 0.0), at(x, 1.0)], Stroke::new(1.0, visuals.hyperlink_color));
            }
        }
        self.paint_ends(ui, &painter, plot);
    }

    /// Draws the colours below the curve, and the curve.
    pub(super) fn paint(&self, painter: &Painter, inner: Rect, line: Color32) {
        let at = |x: f32, y: f32| place_in(inner, x, y);
        let mut mesh = Mesh::default();
        let mut edge = Vec::with_capacity(self.samples.len());
        for (k, (color, opacity)) in self.samples.iter().enumerate() {
            let x = k as f32 / (self.samples.len() - 1).max(1) as f32;
            let inside =
                self.range.is_none_or(|[low, high]| (self.place(low) - 1e-3..=self.place(high) + 1e-3).contains(&x));
            let strength = if inside { 1.0 } else { 0.25 };
            let color = to_color32(*color).gamma_multiply(strength);
            for y in [0.0, *opacity] {
                mesh.vertices.push(Vertex { pos: at(x, y), uv: WHITE_UV, color });
            }
            edge.push(at(x, *opacity));
            let i = 2 * k as u32;
            if k > 0 {
                mesh.add_triangle(i - 2, i - 1, i);
                mesh.add_triangle(i - 1, i, i + 1);
            }
        }
        painter.add(Shape::mesh(mesh));
        painter.add(Shape::line(edge, Stroke::new(1.5, line)));
    }

    /// Writes the ends of the domain and what lies between below a plot.
    pub(super) fn paint_ends(&self, ui: &Ui, painter: &Painter, plot: Rect) {
        let small = TextStyle::Small.resolve(ui.style());
        let weak = ui.visuals().weak_text_color();
        let below = |x: Align2, at: f32, text: String| {
            painter.text(pos2(at, plot.bottom() + 1.0), x, text, small.clone(), weak);
        };
        below(Align2::LEFT_TOP, plot.left(), number(self.domain[0]));
        below(Align2::RIGHT_TOP, plot.right(), number(self.domain[1]));
        let quantity = self.quantity.as_deref().unwrap_or("value");
        let middle = match self.range {
            Some([low, high]) => format!("Visible: {}–{}", number(low), number(high)),
            None => quantity.to_owned(),
        };
        below(Align2::CENTER_TOP, plot.center().x, middle);
    }
}

/// The place of a position on the axis and an opacity, 0 to 1, in a plot.
pub(super) fn place_in(inner: Rect, x: f32, opacity: f32) -> Pos2 {
    pos2(inner.left() + x * inner.width(), inner.bottom() - opacity * inner.height())
}

/// Inverts the scale: returns the value for a scaled one.
fn unscaled(scale: Scale, x: f64) -> f64 {
    match scale {
        Scale::Linear => x,
        Scale::Log10 => 10.0_f64.powf(x),
        Scale::Symlog => x.signum() * (10.0_f64.powf(x.abs()) - 1.0),
    }
}

/// An RGB colour, 0 to 1, as egui holds it; no transfer curve lies between.
pub(crate) fn to_color32(rgb: Vec3) -> Color32 {
    let [r, g, b] = (255.0 * rgb.clamp(Vec3::ZERO, Vec3::ONE)).round().to_array().map(|x| x as u8);
    Color32::from_rgb(r, g, b)
}
