//! Display options: the visible parts of the scene, and their look.

use egui::{Checkbox, RichText, Ui};

use super::control::{Number, choice, labelled_button};
use super::icon::Icon;
use super::legend::color_numbers;
use super::output::PanelHost;
use super::state::Panels;
use crate::display::number_format::{centimetres, count, percent};
use crate::display::{BrushMode, DisplayMode, Locomotion, Tools, TurnStyle, ViewState};
use sg_raster::attributes::Attribute;
use sg_raster::render::Quality;

const ATTRIBUTES: [Attribute; 6] = [
    Attribute::Opacity,
    Attribute::Scale,
    Attribute::Anisotropy,
    Attribute::OffsetColor,
    Attribute::Normal,
    Attribute::PrincipalAxis,
];

impl Panels {
    pub(super) fn what_is_shown(&mut self, ui: &mut Ui, state: &ViewState, tools: &mut Tools) {
        let offer = |ui: &mut Ui, tools: &mut Tools, text: &str, display_mode: DisplayMode| {
            if choice(ui, tools.display_mode == display_mode, text) {
                tools.display_mode = display_mode;
            }
        };
        ui.horizontal_wrapped(|ui| {
            offer(ui, tools, "scene", DisplayMode::Scene);
            if state.clusters.is_some() {
                offer(ui, tools, "Super-Gaussians", DisplayMode::Clusters);
                // Lines are drawn only into pictures of the software renderer; a headset has none.
                if self.host == PanelHost::Window {
                    offer(ui, tools, "outlines of Super-Gaussians", DisplayMode::Outlines);
                }
                offer(ui, tools, "along the first component", DisplayMode::FirstComponent);
            }
        });
        if let Some(clusters) = &state.clusters {
            ui.label(RichText::new(format!("{} Super-Gaussians", count(clusters.count()))).weak());
        }
        ui.label("attributes of Gaussians");
        ui.horizontal_wrapped(|ui| {
            for attribute in ATTRIBUTES {
                offer(ui, tools, attribute.name(), DisplayMode::Attribute(attribute));
            }
        });
        if self.host == PanelHost::Window {
            let does = "a grid on the ground and the box of what is visible (Shift+G)";
            ui.add(Checkbox::new(&mut tools.grid, "grid and box")).on_hover_text(does);
        }
        if let (DisplayMode::Attribute(attribute), Some(numbers)) = (tools.display_mode, &self.numbers) {
            ui.label(attribute.name());
            color_numbers(ui, numbers);
        }
    }

    pub(super) fn this_display(&self, ui: &mut Ui, tools: &mut Tools) {
        ui.horizontal_wrapped(|ui| {
            ui.label("quality at best");
            for (text, quality) in [("standard", Quality::Standard), ("fast", Quality::Fast)] {
                if choice(ui, tools.quality == quality, text) {
                    tools.quality = quality;
                }
            }
        });
        ui.horizontal_wrapped(|ui| {
            ui.label("panels");
            for (text, light) in [("dark", false), ("light", true)] {
                if choice(ui, tools.light_panels == light, text) {
                    tools.light_panels = light;
                }
            }
        });
        ui.horizontal_wrapped(|ui| {
            ui.label("size of text");
            for scale in [1.0_f32, 1.25, 1.5, 2.0] {
                if choice(ui, tools.scale == scale, &percent(f64::from(scale))) {
                    tools.scale = scale;
                }
            }
        });
        if self.host == PanelHost::Window {
            let does = "the eye goes to another view within a moment; otherwise it jumps there";
            ui.add(Checkbox::new(&mut tools.smooth_views, "smooth view changes")).on_hover_text(does);
        }
        if self.host == PanelHost::Headset {
            ui.horizontal_wrapped(|ui| {
                ui.label("a stick turns");
                for turns in TurnStyle::ALL {
                    if choice(ui, tools.turn_style == turns, turns.name()) {
                        tools.turn_style = turns;
                    }
                }
            });
            ui.horizontal_wrapped(|ui| {
                ui.label("the other stick");
                for locomotion in Locomotion::ALL {
                    if choice(ui, tools.locomotion == locomotion, locomotion.name()) {
                        tools.locomotion = locomotion;
                    }
                }
            });
            ui.add(Checkbox::new(&mut tools.upright, "hands keep the scene upright"));
            ui.add(Checkbox::new(&mut tools.left_handed, "left-handed"));
            ui.add(Checkbox::new(&mut tools.seated, "seated"));
            ui.add(Checkbox::new(&mut tools.floor, "floor"));
            if self.switches_surroundings {
                ui.add(Checkbox::new(&mut tools.surroundings, "surroundings"));
            }
            ui.add(Checkbox::new(&mut tools.callouts, "labels at the controllers"));
            near_distance(ui, tools);
        }
    }

    /// The brush modes.
    pub(super) fn modes(&self, ui: &mut Ui, tools: &mut Tools) {
        ui.horizontal_wrapped(|ui| {
            for mode in BrushMode::ALL {
                let selected = tools.mode == mode;
                let icon = Some(mode_icon(mode)).filter(|_| self.host == PanelHost::Window);
                if labelled_button(ui, (icon, mode.name(), false), selected, mode.hint()).clicked() {
                    tools.mode = mode;
                }
            }
        });
    }

    pub(super) fn brush(&self, ui: &mut Ui, tools: &mut Tools) {
        self.modes(ui, tools);
        brush_width(ui, tools);
        self.brush_reach(ui, tools);
    }

    /// What a stroke may reach: hidden Gaussians, and those behind the surface.
    pub(super) fn brush_reach(&self, ui: &mut Ui, tools: &mut Tools) {
        ui.add(Checkbox::new(&mut tools.include_hidden, "hidden Gaussians too"));
        if self.host == PanelHost::Headset {
            ui.add(Checkbox::new(&mut tools.pressure, "pressure of the trigger narrows the brush"));
            return;
        }
        ui.add(Checkbox::new(&mut tools.front_only, "only what is in front"));
        if tools.front_only {
            let text = percent;
            Number { name: "brush depth", range: 0.0..=1.0, logarithmic: false, text }.show(ui, &mut tools.brush_depth);
            let (least, most) = Tools::LASSO_DEPTHS;
            Number { name: "lasso depth", range: least..=most, logarithmic: true, text }
                .show(ui, &mut tools.lasso_depth);
        }
    }
}

/// Icon of a brush mode.
pub(crate) fn mode_icon(mode: BrushMode) -> Icon {
    match mode {
        BrushMode::Walk => Icon::Region,
        BrushMode::Cluster => Icon::Patch,
        BrushMode::Point => Icon::Dot,
    }
}

/// Distance from the eyes within which Gaussians fade.
fn near_distance(ui: &mut Ui, tools: &mut Tools) {
    let (least, most) = Tools::ROOM_NEARS;
    let mut near = tools.room_near;
    let number = Number { name: "near distance", range: least..=most, logarithmic: true, text: centimetres };
    if number.show(ui, &mut near) {
        tools.room_near = near.clamp(least, most);
    }
}

/// The width of the brush.
pub(super) fn brush_width(ui: &mut Ui, tools: &mut Tools) {
    let (least, most) = Tools::RADII;
    // A person thinks of a brush's width, the stroke carries its radius.
    let mut width = 2.0 * tools.radius;
    let range = 2.0 * least..=2.0 * most;
    if (Number { name: "brush width", range, logarithmic: true, text: percent }).show(ui, &mut width) {
        tools.radius = (0.5 * width).clamp(least, most);
    }
}
