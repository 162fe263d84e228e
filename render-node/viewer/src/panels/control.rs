//! Building blocks of the panels.

use std::ops::RangeInclusive;

use egui::{
    Align, Atom, Button, CollapsingHeader, Color32, IdSalt, Label, Layout, Response, RichText, Role, ScrollArea, Sense,
    Separator, Slider, SliderClamping, Stroke, TextStyle, Ui, Vec2, WidgetInfo, vec2,
};

use super::icon::{Icon, draw};
use super::theme;

/// The reason why an operation on the selection is disabled.
pub(super) const NOTHING_SELECTED: &str = "nothing is selected; brush something first";

/// Scale of the panels, 1 for the usual size.
pub(super) fn scale(ui: &Ui) -> f32 {
    ui.spacing().interact_size.y / 28.0
}

/// A collapsible part of a panel.
pub(super) fn section<R>(ui: &mut Ui, title: &str, open: bool, content: impl FnOnce(&mut Ui) -> R) -> Option<R> {
    section_that(ui, title, open, false, content)
}

/// As [`section`]; `opens` unfolds it.
pub(super) fn section_that<R>(
    ui: &mut Ui,
    title: &str,
    open: bool,
    opens: bool,
    content: impl FnOnce(&mut Ui) -> R,
) -> Option<R> {
    ui.add(Separator::default().spacing(1.0));
    let header = CollapsingHeader::new(RichText::new(title).strong()).id_salt(title).default_open(open);
    let header = header.open(opens.then_some(true));
    header.show_unindented(ui, content).body_returned
}

/// A button with a selected state.
pub(super) fn choice(ui: &mut Ui, chosen: bool, text: &str) -> bool {
    ui.add(Button::new(text).selected(chosen)).clicked()
}

/// A button with an icon and a label; the icon alone where that is `short`. `name` is its label for screen readers.
pub(crate) fn labelled_button(
    ui: &mut Ui,
    (icon, name, short): (Option<Icon>, &str, bool),
    selected: bool,
    does: &str,
) -> Response {
    let Some(icon) = icon else {
        return ui.add(Button::new(name).selected(selected)).on_hover_text(does).on_disabled_hover_text(does);
    };
    let place = IdSalt::new("icon");
    let picture = Atom::custom(place, Vec2::splat(16.0 * scale(ui)));
    let button = if short { Button::new(picture) } else { Button::new((picture, name)) };
    let shown = button.selected(selected).atom_ui(ui);
    let response = shown.response.clone();
    if let Some(rect) = shown.rect(place) {
        let look = ui.style().interact_selectable(&response, selected);
        draw(ui.painter(), icon, true, rect, Stroke::new(1.4 * scale(ui), look.text_color()));
    }
    ui.ctx().accesskit_node_builder(response.id, |node| node.set_label(name));
    response.on_hover_text(does).on_disabled_hover_text(does)
}

/// A button with a picture; `name` is its action, for screen readers and the tooltip.
pub(super) fn icon(ui: &mut Ui, icon: Icon, on: bool, name: &str) -> bool {
    let (rect, response) = ui.allocate_exact_size(Vec2::splat(ui.spacing().interact_size.y), Sense::click());
    let enabled = ui.is_enabled();
    response.widget_info(|| WidgetInfo::selected(Role::CheckBox, enabled, on, name));
    let look = *ui.style().interact(&response);
    if response.hovered() || response.has_focus() {
        ui.painter().rect(rect, look.corner_radius, look.weak_bg_fill, look.bg_stroke, egui::StrokeKind::Inside);
    }
    let mut stroke = look.fg_stroke;
    stroke.width = 1.6 * scale(ui);
    if !on && !response.hovered() {
        stroke.color = ui.visuals().weak_text_color();
    }
    draw(ui.painter(), icon, on, rect.shrink(6.0 * scale(ui)), stroke);
    response.on_hover_text(name).clicked()
}

/// Text in a cell of fixed width, cut where it does not fit.
pub(super) fn cell(ui: &mut Ui, width: f32, align: Align, text: RichText) -> Response {
    let size = vec2(width, ui.spacing().interact_size.y);
    let layout = match align {
        Align::Max => Layout::right_to_left(Align::Center),
        _ => Layout::left_to_right(Align::Center),
    };
    ui.allocate_ui_with_layout(size, layout, |ui| {
        ui.set_min_size(size);
        ui.add(Label::new(text).truncate())
    })
    .inner
}

/// A slider of a width without text; `name` is its accessible label.
pub(super) fn bare_slider(
    ui: &mut Ui,
    name: &str,
    value: &mut f64,
    range: RangeInclusive<f64>,
    width: f32,
) -> Response {
    slider_of(ui, name, value, range, width, false)
}

/// Buttons for operations on the selection with a number, and the field of that number; returns the pressed button.
/// They are enabled where something is selected.
pub(super) fn by_number(
    ui: &mut Ui,
    enabled: bool,
    buttons: &[(&str, &str)],
    number: Number<'_>,
    value: &mut f64,
) -> Option<usize> {
    ui.horizontal(|ui| {
        let mut pressed = None;
        for (i, (text, does)) in buttons.iter().enumerate() {
            let response = ui.add_enabled(enabled, Button::new(*text));
            if response.on_hover_text(*does).on_disabled_hover_text(NOTHING_SELECTED).clicked() {
                pressed = Some(i);
            }
        }
        // As wide as the number at either end, so that the slider keeps its width.
        let ends = [number.range.start(), number.range.end()];
        let text_width = ends.map(|end| text_width(ui, &(number.text)(*end))).into_iter().fold(0.0, f32::max);
        let width = ui.available_width() - text_width - ui.spacing().item_spacing.x;
        slider_of(ui, number.name, value, number.range, width.max(40.0), number.logarithmic);
        cell(ui, text_width, Align::Max, RichText::new((number.text)(*value)).weak());
        pressed
    })
    .inner
}

fn slider_of(
    ui: &mut Ui,
    name: &str,
    value: &mut f64,
    range: RangeInclusive<f64>,
    width: f32,
    logarithmic: bool,
) -> Response {
    let slider = Slider::new(value, range).show_value(false).clamping(SliderClamping::Never).logarithmic(logarithmic);
    let response = ui
        .scope(|ui| {
            ui.spacing_mut().slider_width = width;
            // The handle is as large as this says.
            ui.spacing_mut().interact_size.y *= 0.75;
            ui.add(slider)
        })
        .inner;
    // The name may not stand beside the slider, so screen readers get it here.
    ui.ctx().accesskit_node_builder(response.id, |node| node.set_label(name));
    response
}

/// A number with its name, a slider and the number in words.
pub(super) struct Number<'a> {
    /// Label on the panel.
    pub(super) name: &'a str,
    /// Least and greatest that the slider reaches.
    pub(super) range: RangeInclusive<f64>,
    /// Whether equal ways are equal factors.
    pub(super) logarithmic: bool,
    /// The number for a person.
    pub(super) text: fn(f64) -> String,
}

impl Number<'_> {
    /// Draws it over the whole width; returns whether it moved.
    pub(super) fn show(self, ui: &mut Ui, value: &mut f64) -> bool {
        let scale = scale(ui);
        ui.horizontal(|ui| {
            let label = cell(ui, 112.0 * scale, Align::Min, RichText::new(self.name));
            let text_width = 68.0 * scale;
            let width = ui.available_width() - text_width - ui.spacing().item_spacing.x;
            let slider = slider_of(ui, self.name, value, self.range, width.max(40.0), self.logarithmic);
            let moved = slider.labelled_by(label.id).changed();
            cell(ui, text_width, Align::Max, RichText::new((self.text)(*value)).weak());
            moved
        })
        .inner
    }
}

/// Width of a button with this text.
pub(super) fn button_width(ui: &Ui, text: &str) -> f32 {
    text_width(ui, text) + 2.0 * ui.spacing().button_padding.x
}

/// Width of this text on one line.
fn text_width(ui: &Ui, text: &str) -> f32 {
    let font = TextStyle::Button.resolve(ui.style());
    let galley = ui.painter().layout_no_wrap(text.to_owned(), font, Color32::PLACEHOLDER);
    // One point allows for rounding by the background.
    galley.size().x + 1.0
}

/// A frame with the panel's margins; content that is too high scrolls.
pub(super) fn scrolling<R>(ui: &mut Ui, name: &str, content: impl FnOnce(&mut Ui) -> R) -> R {
    framed(ui, |ui| scroll(ui, name, content))
}

/// A frame with the panel's margins.
pub(super) fn framed<R>(ui: &mut Ui, content: impl FnOnce(&mut Ui) -> R) -> R {
    let framed = theme::frame(ui).show(ui, |ui| {
        ui.set_min_size(ui.available_size());
        content(ui)
    });
    framed.inner
}

/// The rest of a panel; content that is too high scrolls.
pub(super) fn scroll<R>(ui: &mut Ui, name: &str, content: impl FnOnce(&mut Ui) -> R) -> R {
    let area = ScrollArea::vertical().id_salt(name).auto_shrink(false);
    let shown = area.show(ui, |ui| {
        ui.set_max_width(ui.available_width());
        content(ui)
    });
    shown.inner
}

/// The text with its first letter in upper case.
pub(crate) fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map(|first| first.to_uppercase().collect::<String>() + letters.as_str()).unwrap_or_default()
}
