//! Edits of light, background, shading term and viewpoint, and the reset.

use sg_proto::scene::set_view::Change;
use sg_proto::scene::{SetBackground, SetLight, SetTerm, SetView};

use super::appearance::hex;
use super::command_number::{self, malformed};
use super::error::EditError;
use super::state::BaseUnitState;
use super::transaction::Transaction;
use super::wire::{decode_axis, decode_light_mode, decode_side, decode_term, decode_view};
use sg_input::number_format::decimals;
use sg_scene::appearance::ShadingTerm;
use sg_scene::camera::LightMode;
use sg_scene::framing::{framed, robust_bounds};
use sg_scene::orientation::Side;
use sg_scene::tone::Tone;

impl Transaction<'_> {
    pub(super) fn set_light(&mut self, command: &SetLight) -> Result<String, EditError> {
        let mut parts = Vec::new();
        let mut light = self.state.light;
        if let Some(mode) = decode_light_mode(command.mode).map_err(|e| malformed(&e))? {
            light.mode = mode;
            parts.push(match mode {
                LightMode::Headlight => "from the eye".to_owned(),
                LightMode::Direction => "from one direction".to_owned(),
            });
        }
        if let Some(vector) = &command.direction {
            light.direction = command_number::direction(vector, "set_light.direction")?.to_array();
            let [x, y, z] = light.direction;
            let [x, y, z] = [x, y, z].map(|x| decimals(x.into(), 2));
            parts.push(format!("direction ({x}, {y}, {z})"));
        }
        for (value, field, present, word) in [
            (command.ambient, "set_light.ambient", &mut light.ka, "ambient"),
            (command.diffuse, "set_light.diffuse", &mut light.kd, "diffuse"),
            (command.specular, "set_light.specular", &mut light.ks, "specular"),
            (command.shininess, "set_light.shininess", &mut light.shininess, "shininess"),
        ] {
            if let Some(value) = value {
                let value = command_number::factor(value, field)?;
                *present = if command.relative { command_number::factor(*present * value, field)? } else { value };
                parts.push(format!("{word} {}", decimals((*present).into(), 2)));
            }
        }
        if parts.is_empty() {
            let reason = "nothing is set; give a mode, a direction or a multiplier".to_owned();
            return Err(EditError::Malformed { field: "set_light", reason });
        }
        self.state.light = light;
        Ok(format!("light: {}", parts.join(", ")))
    }

    pub(super) fn set_background(&mut self, command: &SetBackground) -> Result<String, EditError> {
        const FIELD: &str = "set_background.color";
        let missing = || EditError::Malformed { field: FIELD, reason: "the colour is missing; send one".to_owned() };
        let color = command_number::color(command.color.as_ref().ok_or_else(missing)?, FIELD)?;
        self.state.background = color;
        Ok(format!("background to {}", hex(color)))
    }

    pub(super) fn set_term(&mut self, command: &SetTerm) -> Result<String, EditError> {
        let term = decode_term(command.term).map_err(|e| malformed(&e))?;
        self.state.term = term;
        Ok(match term {
            ShadingTerm::Full => "showed the full shading",
            ShadingTerm::Normal => "showed the normals",
            ShadingTerm::Ambient => "showed the ambient term",
            ShadingTerm::Diffuse => "showed the diffuse term",
            ShadingTerm::Specular => "showed the specular term",
        }
        .to_owned())
    }

    pub(super) fn set_view(&mut self, command: &SetView) -> Result<String, EditError> {
        let missing = || EditError::Malformed {
            field: "set_view.change",
            reason: "nothing is set; give a view, a name, an orbit, a zoom, a target or a kept view".to_owned(),
        };
        let present = self.state.view;
        let (view, summary) = match command.change.as_ref().ok_or_else(missing)? {
            Change::View(view) => (decode_view(view).map_err(|e| malformed(&e))?, "moved the view".to_owned()),
            Change::Named(named) => match decode_side(*named).map_err(|e| malformed(&e))? {
                None => {
                    self.state.up = self.initial.up;
                    (self.initial.view, "reset the view".to_owned())
                }
                Some(side) => {
                    let look = self.state.appearance();
                    let scene = self.scene.of(&self.state);
                    let orientation = scene.orientation.with_up(self.state.up);
                    let view = framed(&scene, &look, orientation.direction_and_up(side), present.fov_y_degrees, 1.0);
                    (view, format!("looked from the {}", side_name(side)))
                }
            },
            Change::Orbit(orbit) => {
                let (azimuth, elevation) = (orbit.azimuth_degrees, orbit.elevation_degrees);
                for (found, field) in [(azimuth, "orbit.azimuth_degrees"), (elevation, "orbit.elevation_degrees")] {
                    if !found.is_finite() {
                        return Err(EditError::NotFinite { field, found });
                    }
                }
                let [across, upwards] = [azimuth, elevation].map(|degrees| decimals(degrees, 1));
                (present.orbited(azimuth, elevation), format!("turned the view by {across}° and {upwards}° upwards"))
            }
            Change::Kept(name) => {
                let kept = self.state.kept_view(name)?;
                (kept.view, format!("went to the view “{}”", kept.name))
            }
            Change::Up(axis) => {
                self.state.up = decode_axis(*axis).map_err(|e| malformed(&e))?;
                let scene = self.scene.of(&self.state);
                let orientation = scene.orientation.with_up(self.state.up);
                let (look, sight) = (self.state.appearance(), orientation.direction_and_up(Side::Front));
                let view = framed(&scene, &look, sight, present.fov_y_degrees, 1.0);
                (view, format!("turned {} up", orientation.up().name()))
            }
            Change::Zoom(factor) => {
                let length = self.state.geometry().bounds.longest_edge();
                (present.zoomed(*factor, length)?, format!("zoomed by {}", decimals(*factor, 2)))
            }
            Change::Focus(target) => {
                let target = self.state.resolve(Some(target))?;
                let bounds = robust_bounds(&self.scene.of(&self.state), &target.members)
                    .ok_or_else(|| EditError::NothingToSee(target.phrase.clone()))?;
                if !target.names.is_empty() {
                    self.focus_on(target.names);
                }
                (present.focused(bounds), format!("looked at {}", target.phrase))
            }
        };
        view.check()?;
        self.state.view = view;
        Ok(summary)
    }

    /// Restores the appearance of the opened scene. Saved units stay, with a neutral appearance; the selection stays. Deleted
    /// Gaussians stay deleted, moved ones stay where they are, copies and kept views stay, and locked units keep their look. While one
    /// is locked, the transfer function stays too.
    pub(super) fn reset(&mut self) -> String {
        for i in 0..self.state.base.len() {
            let initial = self.initial.base.get(self.state.file_unit(i)).cloned();
            if let (Some(base), Some(initial)) = (self.state.base.get_mut(i).filter(|base| !base.locked), initial) {
                let BaseUnitState { name, first, count, deleted, duplicated, .. } = base.clone();
                *base = BaseUnitState { name, first, count, deleted, duplicated, ..initial };
            }
        }
        self.state.units.retain(|_, unit| !unit.derived || unit.locked);
        for unit in self.state.units.values_mut().filter(|unit| !unit.locked) {
            (unit.color, unit.opacity, unit.visible, unit.tone) = (None, 1.0, true, Tone::NEUTRAL);
        }
        if !self.state.names().any(|(_, unit)| self.state.is_locked(unit)) {
            self.state.transfer_function = None;
        }
        self.state.light = self.initial.light;
        self.state.background = self.initial.background;
        (self.state.view, self.state.up) = (self.initial.view, self.initial.up);
        self.state.term = self.initial.term;
        self.focus_on(Vec::new());
        "reset the appearance and the view".to_owned()
    }
}

fn side_name(side: Side) -> &'static str {
    match side {
        Side::Front => "front",
        Side::Back => "back",
        Side::Left => "left",
        Side::Right => "right",
        Side::Top => "top",
        Side::Bottom => "bottom",
    }
}
