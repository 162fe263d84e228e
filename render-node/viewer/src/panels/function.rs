//! The transfer function of a scene of a volume, under the hand.

use egui::{
    Button, Color32, DragValue, Painter, Pos2, Rect, RichText, Role, Sense, Stroke, TextStyle, Ui, WidgetInfo, pos2,
    vec2,
};
use glam::Vec3;
use sg_edit::wire::encode_transfer_function;
use sg_proto::scene::SetTransferFunction;
use sg_proto::scene::command::Action;
use sg_volume::TransferFunction;
use sg_volume::transfer::ControlPoint;

use super::control::{Number, scale};
use super::output::Output;
use super::pick_color::{Picked, color_button};
use super::state::Panels;
use super::transfer::{Curve, place_in, to_color32};
use super::volume_values::{BARS, Bars, VolumeValues};
use crate::display::ViewState;
use crate::display::number_format::{number, percent};

/// Height of the plot, radius of a control point and the reach of a press around it, in points.
const HEIGHT: f32 = 132.0;
const RADIUS: f32 = 5.0;
const REACH: f32 = 14.0;

fn set(function: Option<&TransferFunction>) -> Action {
    Action::SetTransferFunction(SetTransferFunction { function: function.map(encode_transfer_function) })
}

/// The function with one point at another place. It stays between its neighbours.
fn with_point(function: &TransferFunction, at: usize, value: f64, opacity: f64) -> TransferFunction {
    let mut moved = function.clone();
    let least = at.checked_sub(1).and_then(|i| function.points.get(i)).map_or(function.domain[0], |p| p.value);
    let most = function.points.get(at + 1).map_or(function.domain[1], |p| p.value);
    if let Some(point) = moved.points.get_mut(at) {
        point.value = value.max(least.min(most)).min(most.max(least));
        point.opacity = opacity.clamp(0.0, 1.0) as f32;
    }
    moved
}

impl Panels {
    /// Whether the scene keeps the values of a volume, so that its transfer function can change.
    pub(super) fn has_volume(&self) -> bool {
        self.volume.is_some()
    }

    pub(super) fn transfer_function(&mut self, ui: &mut Ui, state: &ViewState, output: &mut Output) {
        let Some(volume) = self.volume.clone() else { return };
        let shown = state.scene.transfer_function().map(|function| &**function);
        let function = shown.unwrap_or(&volume.file);
        // No base unit is without a name, so the curve is that of all values.
        let Some(curve) = Curve::shown(&volume.file, shown, "") else { return };
        // A point is always chosen: controls that come and go would move the plot under the hand.
        self.function.chosen = self.function.chosen.min(function.points.len().saturating_sub(1));
        let mut changed = self.function_plot(ui, &volume, function, &curve, output);
        ui.label(RichText::new("Drag a point, double-click for a new one.").weak());
        let [low, high] = function.domain;
        let (mut level, mut window) = function.level_and_window();
        let slider = |name, range| Number { name, range, logarithmic: false, text: number };
        let moved = slider("level", low..=high).show(ui, &mut level);
        // A window of 0 would put all points in one place for good.
        if moved | slider("window", 1e-3 * (high - low)..=high - low).show(ui, &mut window) {
            // On a logarithmic scale a window that reaches 0 is refused: the sliders stay.
            changed = function.windowed(level, window).ok();
        }
        changed = self.control_point(ui, function, self.function.chosen, output).or(changed);
        ui.horizontal_wrapped(|ui| {
            let own = ui.add_enabled(shown.is_some(), Button::new("as in the file"));
            if own.on_hover_text("the transfer function that the scene was made with").clicked() {
                output.change(set(None));
            }
        });
        if let Some(function) = changed {
            self.hold(set(Some(&function)));
        }
    }

    /// The plot with its points; a point under the pointer moves. Returns the function that a drag makes.
    fn function_plot(
        &mut self,
        ui: &mut Ui,
        volume: &VolumeValues,
        function: &TransferFunction,
        curve: &Curve,
        output: &mut Output,
    ) -> Option<TransferFunction> {
        let small = TextStyle::Small.resolve(ui.style());
        let line = ui.fonts_mut(|f| f.row_height(&small));
        let size = vec2(ui.available_width(), HEIGHT * scale(ui) + line);
        let (whole, response) = ui.allocate_exact_size(size, Sense::click_and_drag());
        response.widget_info(|| {
            let [low, high] = function.domain;
            let what =
                format!("transfer function, {} points, {} to {}", function.points.len(), number(low), number(high));
            WidgetInfo::labeled(Role::Image, true, what)
        });
        let plot = Rect::from_min_size(whole.min, vec2(whole.width(), HEIGHT * scale(ui)));
        let inner = plot.shrink(RADIUS * scale(ui));
        let places: Vec<Pos2> =
            function.points.iter().map(|p| place_in(inner, curve.place(p.value), p.opacity)).collect();
        let nearest = |pointer: Pos2| {
            let distances = places.iter().enumerate().map(|(i, place)| (i, place.distance(pointer)));
            distances.min_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, d)| *d < REACH * scale(ui)).map(|(i, _)| i)
        };
        let value_and_opacity = |pointer: Pos2| {
            let x = ((pointer.x - inner.left()) / inner.width().max(1.0)).clamp(0.0, 1.0);
            (curve.value(f64::from(x)), f64::from((inner.bottom() - pointer.y) / inner.height().max(1.0)))
        };
        let mut changed = None;
        if response.drag_started()
            && let Some(pressed) = ui.input(|i| i.pointer.press_origin())
        {
            self.function.chosen = nearest(pressed).unwrap_or(self.function.chosen);
            self.function.is_dragged = nearest(pressed).is_some();
        }
        if let Some(pointer) = response.interact_pointer_pos() {
            let (value, opacity) = value_and_opacity(pointer);
            if response.dragged() && self.function.is_dragged {
                changed = Some(with_point(function, self.function.chosen, value, opacity));
            } else if response.double_clicked() && nearest(pointer).is_none() {
                output.change(set(Some(&self.with_new_point(function, curve, value, opacity))));
            } else if response.clicked() {
                self.function.chosen = nearest(pointer).unwrap_or(self.function.chosen);
            }
        }
        if response.drag_stopped() {
            self.function.is_dragged = false;
        }
        let bars = self.function.bars(volume, curve, function);
        self.paint_function(ui, (whole, plot, inner), &bars, (function, curve, &places));
        changed
    }

    /// The function with one point more, which is chosen.
    fn with_new_point(
        &mut self,
        function: &TransferFunction,
        curve: &Curve,
        value: f64,
        opacity: f64,
    ) -> TransferFunction {
        let color = curve.color(value).clamp(Vec3::ZERO, Vec3::ONE).to_array();
        let at = function.points.partition_point(|point| point.value <= value);
        let mut more = function.clone();
        more.points.insert(at, ControlPoint { value, color, opacity: opacity.clamp(0.0, 1.0) as f32 });
        self.function.chosen = at;
        more
    }

    fn paint_function(
        &self,
        ui: &Ui,
        (whole, plot, inner): (Rect, Rect, Rect),
        bars: &Bars,
        (function, curve, places): (&TransferFunction, &Curve, &[Pos2]),
    ) {
        let painter: Painter = ui.painter_at(whole);
        let visuals = ui.visuals();
        painter.rect_filled(plot, 4.0, visuals.extreme_bg_color);
        for (k, height) in bars.iter().enumerate() {
            let x = |k: usize| inner.left() + inner.width() * k as f32 / BARS as f32;
            let top = inner.bottom() - inner.height() * height;
            painter.rect_filled(
                Rect::from_min_max(pos2(x(k), top), pos2(x(k + 1), inner.bottom())),
                0.0,
                visuals.weak_text_color().gamma_multiply(0.35),
            );
        }
        curve.paint(&painter, inner, visuals.text_color());
        for (i, (point, place)) in function.points.iter().zip(places).enumerate() {
            let is_chosen = self.function.chosen == i;
            let edge = if is_chosen { visuals.hyperlink_color } else { visuals.text_color() };
            let width = if is_chosen { 2.5 } else { 1.2 };
            let fill: Color32 = to_color32(point.color.into());
            painter.circle(*place, RADIUS * scale(ui), fill, Stroke::new(width * scale(ui), edge));
        }
        curve.paint_ends(ui, &painter, plot);
    }

    /// The controls of the chosen point. Returns the function that they make.
    fn control_point(
        &mut self,
        ui: &mut Ui,
        function: &TransferFunction,
        at: usize,
        output: &mut Output,
    ) -> Option<TransferFunction> {
        let point = *function.points.get(at)?;
        let [low, high] = function.domain;
        let (mut value, mut opacity) = (point.value, f64::from(point.opacity));
        let mut changed = None;
        ui.horizontal_wrapped(|ui| {
            ui.label("point");
            let choice = color_button(ui, "colour of the point", Some(point.color.into()), None);
            output.is_choosing_color |= choice.is_open;
            if let Some(Picked::Color(rgb)) = choice.picked {
                let mut colored = function.clone();
                colored.points[at].color = rgb.to_array();
                changed = Some(colored);
            }
            let field = DragValue::new(&mut value).range(low..=high).speed((high - low) / 500.0).max_decimals(4);
            let field = ui.add(field).on_hover_text("value of the point");
            if field.changed() {
                changed = Some(with_point(function, at, value, opacity));
            }
            let is_only = function.points.len() == 1;
            let remove = ui.add_enabled(!is_only, Button::new("remove point"));
            if remove.on_disabled_hover_text("the last point stays").clicked() {
                let mut fewer = function.clone();
                fewer.points.remove(at);
                self.function.chosen = at.saturating_sub(1);
                output.change(set(Some(&fewer)));
            }
        });
        let slider = Number { name: "opacity of point", range: 0.0..=1.0, logarithmic: false, text: percent };
        if slider.show(ui, &mut opacity) {
            changed = Some(with_point(function, at, value, opacity));
        }
        changed
    }
}

#[cfg(test)]
mod tests {
    use sg_volume::transfer::{Scale, Units};

    use super::*;

    fn ramp() -> TransferFunction {
        let point = |value, opacity| ControlPoint { value, color: [0.5; 3], opacity };
        let points = vec![point(20.0, 0.0), point(40.0, 0.5), point(60.0, 1.0)];
        TransferFunction {
            domain: [0.0, 100.0],
            units: Units::Raw,
            scale: Scale::Linear,
            variable: None,
            points,
            base_units: Vec::new(),
        }
    }

    fn values(function: &TransferFunction) -> Vec<f64> {
        function.points.iter().map(|point| point.value).collect()
    }

    #[test]
    fn a_point_stays_between_its_neighbours() {
        assert_eq!(values(&with_point(&ramp(), 1, 90.0, 0.5)), [20.0, 60.0, 60.0]);
        assert_eq!(values(&with_point(&ramp(), 0, -5.0, 2.0)), [0.0, 40.0, 60.0]);
        assert_eq!(with_point(&ramp(), 0, 5.0, 2.0).points[0].opacity, 1.0);
        assert_eq!(with_point(&ramp(), 9, 5.0, 0.0), ramp());
        assert!(with_point(&ramp(), 1, 90.0, 0.5).check().is_ok());
    }
}
