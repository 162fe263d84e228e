//! Choosing a colour: universally distinct swatches, and hue, saturation and brightness.

use egui::style::StyleModifier;
use egui::{
    Button, Color32, Id, Popup, PopupCloseBehavior, Response, Role, Sense, Stroke, StrokeKind, Ui, WidgetInfo, vec2,
};
use glam::Vec3;

use super::control::{Number, scale};
use super::theme::COLORS;
use super::transfer::to_color32;
use crate::display::number_format::{degrees, percent};

/// The picked colour.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Picked {
    /// A colour, RGB 0 to 1, perhaps still under the hand.
    Color(Vec3),
    /// No colour: the original ones.
    Own,
}

/// State of a [`color_button`] in one frame.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct ColorChoice {
    /// The colour picked in this frame.
    pub(super) picked: Option<Picked>,
    /// Whether the choice is open.
    pub(super) is_open: bool,
}

/// A swatch that opens the choice of a colour. `own` labels the option without a colour, if there is one.
pub(super) fn color_button(ui: &mut Ui, name: &str, color: Option<Vec3>, own: Option<&str>) -> ColorChoice {
    let button = swatch(ui, name, color);
    let mut choice = ColorChoice::default();
    let popup = Popup::menu(&button).style(StyleModifier::default());
    popup.close_behavior(PopupCloseBehavior::CloseOnClickOutside).show(|ui| {
        let room = ui.ctx().content_rect().width() - 3.0 * ui.spacing().interact_size.x;
        ui.set_width((300.0 * scale(ui)).min(room));
        choice = ColorChoice { picked: choose(ui, button.id, color, own), is_open: true };
    });
    choice
}

fn swatch(ui: &mut Ui, name: &str, color: Option<Vec3>) -> Response {
    let side = ui.spacing().interact_size.y;
    let (rect, response) = ui.allocate_exact_size(vec2(side, side), Sense::click());
    let enabled = ui.is_enabled();
    response.widget_info(|| WidgetInfo::labeled(Role::Button, enabled, name));
    let look = ui.style().interact(&response);
    let square = rect.shrink(3.0 * scale(ui));
    match color {
        Some(color) => {
            ui.painter().rect(
                square,
                4.0,
                to_color32(color),
                Stroke::new(1.0, look.fg_stroke.color),
                StrokeKind::Inside,
            );
        }
        // Its Gaussians' own colours: an empty square.
        None => {
            ui.painter().rect(
                square,
                4.0,
                Color32::TRANSPARENT,
                Stroke::new(1.0, look.fg_stroke.color),
                StrokeKind::Inside,
            );
            let inner = square.shrink(3.0);
            ui.painter().line_segment([inner.left_bottom(), inner.right_top()], Stroke::new(1.0, look.fg_stroke.color));
        }
    }
    if response.hovered() || response.has_focus() {
        ui.painter().rect_stroke(rect, look.corner_radius, look.bg_stroke, StrokeKind::Inside);
    }
    response.on_hover_text(name)
}

fn choose(ui: &mut Ui, of: Id, color: Option<Vec3>, own: Option<&str>) -> Option<Picked> {
    let mut picked = None;
    ui.horizontal_wrapped(|ui| {
        for (name, rgb) in COLORS {
            let button = Button::new("").fill(to_color32(rgb)).min_size(vec2(1.0, 1.0) * ui.spacing().interact_size.y);
            let response = ui.add(button);
            response.widget_info(|| WidgetInfo::labeled(Role::Button, true, name));
            if response.on_hover_text(name).clicked() {
                picked = Some(Picked::Color(rgb));
            }
        }
    });
    // A grey has no hue and black no saturation: the sliders' last values are kept while they fit.
    let known = of.with("hue, saturation, brightness");
    let present = color.unwrap_or(Vec3::splat(0.5));
    let mut hsb = ui
        .data(|d| d.get_temp::<[f64; 3]>(known))
        .filter(|hsb| (rgb_of(*hsb) - present).abs().max_element() < 1e-3)
        .unwrap_or_else(|| hsb_of(present));
    let number = |name, range, text| Number { name, range, logarithmic: false, text };
    let mut moved = number("hue", 0.0..=360.0, degrees).show(ui, &mut hsb[0]);
    moved |= number("saturation", 0.0..=1.0, percent).show(ui, &mut hsb[1]);
    moved |= number("brightness", 0.0..=1.0, percent).show(ui, &mut hsb[2]);
    if moved {
        ui.data_mut(|d| d.insert_temp(known, hsb));
        picked = Some(Picked::Color(rgb_of(hsb)));
    }
    if let Some(own) = own
        && ui.button(own).clicked()
    {
        picked = Some(Picked::Own);
    }
    picked
}

/// Hue in degrees, saturation and brightness 0 to 1, of a stored colour.
fn hsb_of(rgb: Vec3) -> [f64; 3] {
    let [r, g, b] = rgb.as_dvec3().to_array();
    let (most, least) = (r.max(g).max(b), r.min(g).min(b));
    let spread = most - least;
    if spread <= 0.0 {
        return [0.0, 0.0, most];
    }
    let hue = if most == r {
        (g - b) / spread
    } else if most == g {
        2.0 + (b - r) / spread
    } else {
        4.0 + (r - g) / spread
    };
    [60.0 * hue.rem_euclid(6.0), spread / most, most]
}

fn rgb_of([hue, saturation, brightness]: [f64; 3]) -> Vec3 {
    let part = |n: f64| {
        let k = (n + hue / 60.0).rem_euclid(6.0);
        (brightness * (1.0 - saturation * k.min(4.0 - k).clamp(0.0, 1.0))) as f32
    };
    Vec3::new(part(5.0), part(3.0), part(1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_colour_comes_back_from_its_hue_saturation_and_brightness() {
        for k in 0..6_u32.pow(3) {
            let rgb = Vec3::new((k % 6) as f32, (k / 6 % 6) as f32, (k / 36) as f32) / 5.0;
            assert!((rgb_of(hsb_of(rgb)) - rgb).abs().max_element() < 1e-6, "{rgb}");
        }
    }
}
