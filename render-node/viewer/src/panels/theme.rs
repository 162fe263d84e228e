//! Look of the panels: readable colours, and text sizes for the reading distance.

use egui::style::{HandleShape, ScrollStyle, Selection, WidgetVisuals, Widgets};
use egui::{
    Align2, Color32, Context, CornerRadius, FontFamily, FontId, Frame, Margin, Painter, Pos2, Shadow, Stroke, Style,
    TextStyle, Theme,
};
use egui::{Ui, Vec2, Visuals};
use glam::Vec3;

use crate::display::{BrushSign, Tools};

/// Least angle that a line of text takes before the eyes, degrees.
pub const LINE_DEGREES: f64 = 1.3;

/// Least height of a line of the smallest text in points, at a scale of 1.
pub const LINE: f64 = 16.0;

/// Least ratio of the luminances of text and its background (WCAG 2.2, success criterion 1.4.3).
pub const CONTRAST: f64 = 4.5;

/// Colours distinct with every kind of colour vision (Okabe and Ito 2008) and white, by name, RGB 0 to 1.
pub const COLORS: [(&str, Vec3); 8] = [
    ("orange", Vec3::new(0.902, 0.624, 0.0)),
    ("sky blue", Vec3::new(0.337, 0.706, 0.914)),
    ("bluish green", Vec3::new(0.0, 0.62, 0.451)),
    ("yellow", Vec3::new(0.941, 0.894, 0.259)),
    ("blue", Vec3::new(0.0, 0.447, 0.698)),
    ("vermilion", Vec3::new(0.835, 0.369, 0.0)),
    ("reddish purple", Vec3::new(0.8, 0.475, 0.655)),
    ("white", Vec3::ONE),
];

/// Metres per point for a viewing distance in metres, so that a line of a panel's smallest text takes [`LINE_DEGREES`]. A
/// line of height h at the distance d takes 2·atan(h / 2d).
#[must_use]
pub fn metres_per_point(distance: f64) -> f64 {
    2.0 * distance * (0.5 * LINE_DEGREES.to_radians()).tan() / LINE
}

/// Most points across a panel of this width at this viewing distance, both in metres, for readable text.
#[must_use]
pub fn points_across(width: f64, distance: f64) -> f64 {
    width / metres_per_point(distance)
}

/// The colour of a brush: Okabe and Ito's bluish green where it adds, their vermilion where it takes away.
#[must_use]
pub fn color_of(sign: BrushSign) -> Color32 {
    match sign {
        BrushSign::Add => Color32::from_rgb(0, 158, 115),
        BrushSign::Remove => Color32::from_rgb(213, 94, 0),
    }
}

/// Points from the middle of a mark to the outside of its edge.
pub const MARK: f32 = 12.0;

/// Okabe and Ito's yellow: the colour of neither adding nor removing.
const MARKED: Color32 = Color32::from_rgb(240, 228, 66);

/// Marks the proposal with this zero-based number, written from 1; a lit mark is filled.
pub fn mark(painter: &Painter, at: Pos2, number: usize, lit: bool) {
    let (fill, text) = if lit { (MARKED, Color32::BLACK) } else { (Color32::from_black_alpha(190), MARKED) };
    painter.circle(at, MARK - 1.0, fill, Stroke::new(2.0, MARKED));
    painter.text(at, Align2::CENTER_CENTER, (number + 1).to_string(), FontId::proportional(14.0), text);
}

/// Applies the tools' look to a context. Cheap without a change.
pub fn apply(ctx: &Context, tools: &Tools) {
    let theme = if tools.light_panels { Theme::Light } else { Theme::Dark };
    let looks = (tools.light_panels, tools.scale.to_bits());
    let known = egui::Id::unique("looks of the panels");
    if ctx.data(|d| d.get_temp(known)) == Some(looks) {
        return;
    }
    ctx.data_mut(|d| d.insert_temp(known, looks));
    ctx.set_theme(theme);
    ctx.set_style_of(theme, style(tools.light_panels, tools.scale));
}

/// The look of all panels; `scale` multiplies every size.
#[must_use]
pub fn style(light: bool, scale: f32) -> Style {
    let mut style = Style { visuals: visuals(light), ..Style::default() };
    let font = |size: f32| FontId::new(size * scale, FontFamily::Proportional);
    style.text_styles = [
        (TextStyle::Small, font(14.5)),
        (TextStyle::Body, font(16.0)),
        (TextStyle::Button, font(16.0)),
        (TextStyle::Heading, font(20.0)),
        (TextStyle::Monospace, FontId::new(14.5 * scale, FontFamily::Monospace)),
    ]
    .into();
    let margin = |points: f32| Margin::same((points * scale) as i8);
    let spacing = &mut style.spacing;
    spacing.item_spacing = Vec2::new(8.0, 7.0) * scale;
    spacing.button_padding = Vec2::new(10.0, 4.0) * scale;
    spacing.interact_size = Vec2::new(30.0, 28.0) * scale;
    spacing.slider_width = 150.0 * scale;
    spacing.slider_rail_height = 6.0 * scale;
    spacing.icon_width = 20.0 * scale;
    spacing.icon_width_inner = 12.0 * scale;
    spacing.icon_spacing = 6.0 * scale;
    spacing.indent = 20.0 * scale;
    spacing.window_margin = margin(10.0);
    spacing.menu_margin = margin(10.0);
    spacing.scroll = ScrollStyle { bar_width: 12.0 * scale, ..ScrollStyle::solid() };
    style.interaction.selectable_labels = false;
    // The tolerance allows presses with a trembling ray.
    style.interaction.interact_radius = 4.0 * scale;
    style.visuals.text_cursor.blink = false;
    style
}

/// The frame of a panel.
pub(super) fn frame(ui: &Ui) -> Frame {
    Frame::new().fill(ui.visuals().panel_fill).inner_margin(ui.spacing().window_margin)
}

/// A card on a panel: a group of controls.
pub(crate) fn card(ui: &Ui) -> Frame {
    Frame::new()
        .fill(ui.visuals().faint_bg_color)
        .stroke(ui.visuals().widgets.noninteractive.bg_stroke)
        .corner_radius(CornerRadius::same(8))
        .inner_margin(ui.spacing().window_margin)
}

struct Palette {
    panel: Color32,
    card: Color32,
    field: Color32,
    line: Color32,
    text: Color32,
    weak: Color32,
    strong: Color32,
    button: Color32,
    hovered: Color32,
    pressed: Color32,
    chosen: Color32,
    on_chosen: Color32,
    accent: Color32,
    warn: Color32,
    error: Color32,
}

const DARK: Palette = Palette {
    panel: Color32::from_rgb(20, 23, 28),
    card: Color32::from_rgb(29, 33, 40),
    field: Color32::from_rgb(11, 13, 16),
    line: Color32::from_rgb(62, 69, 80),
    text: Color32::from_rgb(228, 232, 238),
    weak: Color32::from_rgb(166, 175, 187),
    strong: Color32::WHITE,
    button: Color32::from_rgb(47, 54, 64),
    hovered: Color32::from_rgb(62, 71, 84),
    pressed: Color32::from_rgb(0, 96, 152),
    chosen: Color32::from_rgb(0, 96, 152),
    on_chosen: Color32::WHITE,
    accent: Color32::from_rgb(86, 180, 233),
    warn: Color32::from_rgb(230, 159, 0),
    error: Color32::from_rgb(245, 136, 66),
};

const LIGHT: Palette = Palette {
    panel: Color32::from_rgb(244, 245, 247),
    card: Color32::from_rgb(255, 255, 255),
    field: Color32::from_rgb(255, 255, 255),
    line: Color32::from_rgb(190, 197, 206),
    text: Color32::from_rgb(27, 31, 37),
    weak: Color32::from_rgb(83, 91, 102),
    strong: Color32::BLACK,
    button: Color32::from_rgb(222, 226, 232),
    hovered: Color32::from_rgb(204, 211, 220),
    pressed: Color32::from_rgb(160, 204, 236),
    chosen: Color32::from_rgb(150, 200, 236),
    on_chosen: Color32::from_rgb(0, 46, 77),
    accent: Color32::from_rgb(0, 96, 152),
    warn: Color32::from_rgb(128, 82, 0),
    error: Color32::from_rgb(163, 60, 0),
};

fn visuals(light: bool) -> Visuals {
    let of = if light { LIGHT } else { DARK };
    let widget = |fill: Color32, edge: Color32, text: Color32| WidgetVisuals {
        bg_fill: fill,
        weak_bg_fill: fill,
        bg_stroke: Stroke::new(1.0, edge),
        fg_stroke: Stroke::new(1.5, text),
        corner_radius: CornerRadius::same(6),
        expansion: 0.0,
    };
    let base = if light { Visuals::light() } else { Visuals::dark() };
    Visuals {
        widgets: Widgets {
            noninteractive: widget(of.card, of.line, of.text),
            inactive: widget(of.button, of.line, of.text),
            hovered: widget(of.hovered, of.accent, of.strong),
            active: widget(of.pressed, of.accent, of.strong),
            open: widget(of.hovered, of.line, of.strong),
        },
        selection: Selection { bg_fill: of.chosen, stroke: Stroke::new(1.5, of.on_chosen) },
        weak_text_color: Some(of.weak),
        hyperlink_color: of.accent,
        faint_bg_color: of.card,
        extreme_bg_color: of.field,
        text_edit_bg_color: Some(of.field),
        code_bg_color: of.card,
        warn_fg_color: of.warn,
        error_fg_color: of.error,
        window_fill: of.card,
        window_stroke: Stroke::new(1.0, of.line),
        window_shadow: Shadow::NONE,
        popup_shadow: Shadow::NONE,
        panel_fill: of.panel,
        slider_trailing_fill: true,
        handle_shape: HandleShape::Circle,
        indent_has_left_vline: false,
        disabled_alpha: 0.55,
        ..base
    }
}

/// Every text colour with its background, by name.
#[must_use]
pub fn text_colors(visuals: &Visuals) -> Vec<(&'static str, Color32, Color32)> {
    let (panel, card) = (visuals.panel_fill, visuals.faint_bg_color);
    let widgets = &visuals.widgets;
    let mut pairs = vec![
        ("text being typed", widgets.inactive.text_color(), visuals.text_edit_bg_color()),
        ("hint in a field", visuals.weak_text_color(), visuals.text_edit_bg_color()),
        ("button", widgets.inactive.text_color(), widgets.inactive.weak_bg_fill),
        ("button pointed at", widgets.hovered.text_color(), widgets.hovered.weak_bg_fill),
        ("button pressed", widgets.active.text_color(), widgets.active.weak_bg_fill),
        ("button of what is open", widgets.open.text_color(), widgets.open.weak_bg_fill),
        ("chosen", visuals.selection.stroke.color, visuals.selection.bg_fill),
    ];
    for on in [panel, card, visuals.window_fill] {
        pairs.extend([
            ("text", visuals.text_color(), on),
            ("strong text", visuals.strong_text_color(), on),
            ("weak text", visuals.weak_text_color(), on),
            ("accent", visuals.hyperlink_color, on),
            ("warning", visuals.warn_fg_color, on),
            ("error", visuals.error_fg_color, on),
        ]);
    }
    pairs
}

/// Ratio of the relative luminances of two opaque colours, 1 to 21 (WCAG 2.2).
#[must_use]
pub fn contrast(a: Color32, b: Color32) -> f64 {
    let linear = |byte: u8| {
        let x = f64::from(byte) / 255.0;
        if x <= 0.040_45 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
    };
    let luminance = |c: Color32| 0.2126 * linear(c.r()) + 0.7152 * linear(c.g()) + 0.0722 * linear(c.b());
    let (a, b) = (luminance(a) + 0.05, luminance(b) + 0.05);
    a.max(b) / a.min(b)
}
