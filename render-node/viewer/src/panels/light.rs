//! Light, the shown part of the shading, background, viewpoint.

use egui::{Checkbox, Ui};
use glam::{DVec3, Vec3};
use sg_edit::wire::{encode_color, encode_term, encode_vector};
use sg_proto::light_presets::{LightPreset, ViewerAxes};
use sg_proto::scene::command::Action;
use sg_proto::scene::{self as proto, NamedView, SetBackground, SetLight, SetTerm, SetView, set_view};
use sg_scene::appearance::ShadingTerm;
use sg_scene::camera::LightMode;
use sg_scene::orientation::Axis;
use sg_scene::view::View;

use super::commands::turn_up;
use super::control::{Number, choice};
use super::output::{DisplayAction, Output, PanelHost};
use super::pick_color::{Picked, color_button};
use super::state::Panels;
use crate::display::number_format::{degrees, factor};
use crate::display::{Tools, ViewState};

/// Backgrounds that are often wanted.
const BACKGROUNDS: [(&str, Vec3); 3] = [("black", Vec3::ZERO), ("grey", Vec3::splat(0.5)), ("white", Vec3::ONE)];

/// Shading term of a button.
const TERMS: [(&str, ShadingTerm); 5] = [
    ("full", ShadingTerm::Full),
    ("normal", ShadingTerm::Normal),
    ("ambient", ShadingTerm::Ambient),
    ("diffuse", ShadingTerm::Diffuse),
    ("specular", ShadingTerm::Specular),
];

/// Viewpoints by name.
const VIEWS: [(&str, NamedView); 7] = [
    ("front", NamedView::Front),
    ("back", NamedView::Back),
    ("left", NamedView::Left),
    ("right", NamedView::Right),
    ("top", NamedView::Top),
    ("bottom", NamedView::Bottom),
    ("as opened", NamedView::Initial),
];

impl Panels {
    pub(super) fn light(&mut self, ui: &mut Ui, state: &ViewState, tools: &mut Tools, output: &mut Output) {
        let light = state.scene.light();
        let from = |mode: proto::LightMode, direction: Option<DVec3>| {
            let direction = direction.map(encode_vector);
            Action::SetLight(SetLight { mode: mode.into(), direction, ..SetLight::default() })
        };
        ui.horizontal_wrapped(|ui| {
            ui.label("light from");
            if choice(ui, light.mode == LightMode::Headlight, "the eye") {
                output.change(from(proto::LightMode::Headlight, None));
            }
            if choice(ui, light.mode == LightMode::Direction, "one direction") {
                output.change(from(proto::LightMode::Direction, None));
            }
        });
        ui.horizontal_wrapped(|ui| {
            ui.label("presets");
            let axes = axes_of(&state.scene.view());
            for preset in LightPreset::ALL {
                let button = ui.button(preset.name()).on_hover_text(preset.hint());
                let hears = format!("light: {}", preset.name());
                ui.ctx().accesskit_node_builder(button.id, |node| node.set_label(hears.as_str()));
                if button.clicked() {
                    output.change(Action::SetLight(preset.set_light(&axes)));
                }
            }
        });
        if light.mode == LightMode::Direction {
            let [mut around, mut height] = angles(Vec3::from_array(light.direction).as_dvec3());
            let number = |name, range| Number { name, range, logarithmic: false, text: degrees };
            let moved = number("around", -180.0..=180.0).show(ui, &mut around);
            if moved | number("height", -90.0..=90.0).show(ui, &mut height) {
                self.hold(from(proto::LightMode::Unspecified, Some(direction(around, height))));
            }
            let view = state.scene.view();
            if ui.button("from the present viewpoint").clicked() {
                output
                    .change(from(proto::LightMode::Unspecified, Some((view.eye - view.target).normalize_or(DVec3::Z))));
            }
        }
        for (name, present, command) in [
            ("ambient", light.ka, (|x| SetLight { ambient: Some(x), ..SetLight::default() }) as fn(f32) -> SetLight),
            ("diffuse", light.kd, |x| SetLight { diffuse: Some(x), ..SetLight::default() }),
            ("specular", light.ks, |x| SetLight { specular: Some(x), ..SetLight::default() }),
            ("shininess", light.shininess, |x| SetLight { shininess: Some(x), ..SetLight::default() }),
        ] {
            let mut value = f64::from(present);
            if (Number { name, range: 0.0..=3.0, logarithmic: false, text: factor }).show(ui, &mut value) {
                self.hold(Action::SetLight(command(value as f32)));
            }
        }
        ui.add(Checkbox::new(&mut tools.occlusion, "ambient occlusion"));
        ui.label("part of the shading");
        ui.horizontal_wrapped(|ui| {
            for (name, term) in TERMS {
                let button = egui::Button::new(name).selected(state.scene.term() == term);
                let response = ui.add(button);
                let hears = format!("shading: {name}");
                ui.ctx().accesskit_node_builder(response.id, |node| node.set_label(hears.as_str()));
                if response.clicked() {
                    output.change(Action::SetTerm(SetTerm { term: encode_term(term).into() }));
                }
            }
        });
        self.background(ui, state, tools, output);
    }

    fn background(&mut self, ui: &mut Ui, state: &ViewState, tools: &mut Tools, output: &mut Output) {
        let present = state.scene.background();
        let set = |rgb: Vec3| Action::SetBackground(SetBackground { color: Some(encode_color(rgb)) });
        ui.horizontal_wrapped(|ui| {
            ui.label("background");
            if let Some(Picked::Color(rgb)) = color_button(ui, "background colour", Some(present), None).picked {
                self.hold(set(rgb));
            }
            for (name, rgb) in BACKGROUNDS {
                if choice(ui, present == rgb, name) {
                    output.change(set(rgb));
                }
            }
            if self.host == PanelHost::Window {
                ui.add(Checkbox::new(&mut tools.gradient, "gradient"));
            }
        });
    }

    pub(super) fn viewpoint(&mut self, ui: &mut Ui, state: &ViewState, output: &mut Output) {
        if state.services.scene {
            ui.horizontal_wrapped(|ui| {
                for (name, view) in VIEWS {
                    if ui.button(name).clicked() {
                        let change = Some(set_view::Change::Named(view.into()));
                        output.change(Action::SetView(SetView { change }));
                    }
                }
            });
            if self.host == PanelHost::Window {
                directions_up(ui, state, output);
            }
            self.kept_views(ui, state, output);
        }
        ui.horizontal_wrapped(|ui| {
            for action in &self.supported_actions {
                let text = match action {
                    DisplayAction::Fit => "fit all".to_owned(),
                    DisplayAction::Bookmark => "keep this place".to_owned(),
                    DisplayAction::Place(n) => format!("place {n}"),
                    DisplayAction::Screenshot => "screenshot".to_owned(),
                    // Stand with the walk that it is about, and at the wrist.
                    DisplayAction::Proposal(_) | DisplayAction::Panels => continue,
                };
                if ui.button(text).clicked() {
                    output.actions.push(*action);
                }
            }
        });
    }
}

/// The choice of the direction that is up.
fn directions_up(ui: &mut Ui, state: &ViewState, output: &mut Output) {
    ui.horizontal_wrapped(|ui| {
        ui.label("up").on_hover_text("the direction of the scene that is up; kept with the scene");
        let choices = std::iter::once(None).chain(Axis::ALL.map(Some));
        for up in choices {
            let name = up.map_or("as in the file", Axis::name);
            let button = egui::Button::new(name).selected(state.scene.up() == up);
            if ui.add(button).clicked() {
                output.change(turn_up(up));
            }
        }
    });
}

/// The viewer's axes of a view; those of the front for a view along its up direction.
fn axes_of(view: &View) -> ViewerAxes {
    let backward = (view.eye - view.target).normalize_or(DVec3::NEG_Y);
    let right = view.up.cross(backward).normalize_or(DVec3::X);
    let up = backward.cross(right);
    ViewerAxes { right: right.to_array(), up: up.to_array(), backward: backward.to_array() }
}

/// Degrees around the upright axis (0 from the front, that is -y, positive towards +x) and above the horizon.
fn angles(direction: DVec3) -> [f64; 2] {
    let d = direction.normalize_or(DVec3::Z);
    // Straight up there is no way around.
    let around = if d.x.hypot(d.y) > 1e-6 { d.x.atan2(-d.y).to_degrees() } else { 0.0 };
    [around, d.z.clamp(-1.0, 1.0).asin().to_degrees()]
}

fn direction(around: f64, height: f64) -> DVec3 {
    let (around, height) = (around.to_radians(), height.to_radians());
    DVec3::new(height.cos() * around.sin(), -height.cos() * around.cos(), height.sin())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_direction_comes_back_from_its_angles() {
        for around in [-179.0, -90.0, 0.0, 45.0, 180.0] {
            for height in [-80.0, 0.0, 33.0] {
                let back = angles(direction(around, height));
                assert!(
                    (back[0] - around).abs() < 1e-9 && (back[1] - height).abs() < 1e-9,
                    "{around} {height} {back:?}"
                );
            }
        }
        assert!((direction(0.0, 0.0) - DVec3::NEG_Y).length() < 1e-12, "the front view's eye is at -y");
    }
}
