//! A scene with its edits as a scene of its own, for files.
//!
//! Each part that looks different becomes a base unit: its colour is the palette colour, its factors are the unit's opacity, and
//! Gaussians of a saved unit take its name. The picture stays the same. Light, background and viewpoint are no part of it.

use std::collections::BTreeMap;

use glam::{DVec3, Vec3};
use sg_reclassify::sources;
use sg_scene::mask::Mask;
use sg_scene::model::{BaseUnit, Convention, Gaussians, Harmonics, Scene, SceneBox, ShadingColumns, ShadingModel};
use sg_scene::recolor::{BRIGHTNESS, KEPT, recolored};
use sg_scene::tone::Tone;

use crate::error::EditError;
use crate::placed_scene::placed;
use crate::state::{BaseUnitState, EditState, Unit};

/// Most base units that edits make: as many as a scene file may have.
const MAX_PARTS: usize = 4096;

/// A choice of Gaussians.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part<'a> {
    /// All that are not deleted, hidden ones too.
    Everything,
    /// Those that no hidden unit contains and no opacity of 0 erases.
    Visible,
    /// The selected ones, hidden or not.
    Selection,
    /// Those of a base unit or an editable unit, hidden or not.
    Unit(&'a str),
}

/// What the edits make of a Gaussian of one base unit. Gaussians of equal looks form a base unit of the new scene.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
struct Look {
    /// Id of the newest saved unit that contains it; 0 for none.
    name: u64,
    /// Id of the newest unit that gives it a colour; 0 for none.
    color: u64,
    /// Bits of the product of all factors on its opacity; factors are at least 0, so that bits are in order.
    opacity: u32,
    /// Bits of saturation, brightness and temperature of all its units together; 0 where nothing changes.
    tone: [u32; 3],
}

impl Look {
    fn tone(self) -> Tone {
        let [saturation, brightness, temperature] = self.tone.map(f32::from_bits);
        if self.tone == [0; 3] { Tone::NEUTRAL } else { Tone { saturation, brightness, temperature } }
    }
}

impl EditState {
    /// The Gaussians of a choice.
    ///
    /// # Errors
    /// [`EditError::UnknownUnit`], [`EditError::Ambiguous`]; [`EditError::NothingSelected`] and [`EditError::EmptyTarget`] for
    /// a choice of nothing.
    pub fn part(&self, part: Part<'_>) -> Result<Mask, EditError> {
        let (mask, phrase) = match part {
            Part::Everything => (self.existing(), "everything".to_owned()),
            Part::Visible => (self.visible(), "the visible part".to_owned()),
            Part::Selection if self.selection().mask().is_none() => return Err(EditError::NothingSelected),
            Part::Selection => ((**self.selection().mask()).clone(), "the selection".to_owned()),
            Part::Unit(name) => ((*self.members(self.find(name)?)).clone(), name.to_owned()),
        };
        if mask.is_none() { Err(EditError::EmptyTarget(phrase)) } else { Ok(mask) }
    }

    /// The Gaussians of `members` with their edited colours, opacities and places, as a scene of its own. `scene` is the opened
    /// one, as its file has it.
    /// Hidden Gaussians among them are visible there. A choice of all keeps the box of strokes; another choice gets the box of
    /// its centres.
    ///
    /// The colours of trained splats that see a unit's colour through their harmonics are exact between the bounds of
    /// [`recolored_unlit`](sg_scene::recolor::recolored_unlit). A changed tone of trained splats is exact where no channel of the
    /// seen colour is below 0.
    ///
    /// # Errors
    /// [`EditError::TooMany`] where more than 4,096 parts look different.
    pub fn edited(&self, scene: &Scene, members: &Mask) -> Result<Scene, EditError> {
        let moved = (!self.is_as_in_file()).then(|| placed(scene, self));
        self.edited_placed(moved.as_ref().unwrap_or(scene), members)
    }

    /// As [`EditState::edited`], of the scene that [`PlacedScene::of`](crate::PlacedScene::of) gives for this state.
    ///
    /// # Errors
    /// [`EditError::TooMany`] where more than 4,096 parts look different.
    pub fn edited_placed(&self, scene: &Scene, members: &Mask) -> Result<Scene, EditError> {
        let mut units: Vec<BaseUnit> = Vec::new();
        for (base, look) in scene.units.iter().zip(self.base_units()) {
            for (part, rows) in self.parts(base, look, members) {
                if units.len() == MAX_PARTS {
                    let remedy = "write fewer units at a time";
                    return Err(EditError::TooMany { what: "parts of different looks", limit: MAX_PARTS, remedy });
                }
                let given = self.units.get(&part.color).and_then(|unit| unit.color);
                let color = given.or_else(|| base.tint(look.palette));
                let named = self.units.get(&part.name).map_or(&look.name, |unit| &unit.name);
                let mut gaussians = base.gaussians.rows(&rows);
                // A later transfer function leaves colours of people as they are.
                if color.is_some() || !part.tone().is_neutral() {
                    sources::forget(&mut gaussians);
                } else {
                    sources::shift_colors(&mut gaussians, look.palette - base.palette);
                }
                let gaussians = painted(gaussians, base.shading, look.palette, color);
                let palette = color.unwrap_or(look.palette);
                let (gaussians, palette) = toned(gaussians, base.shading, palette, part.tone());
                units.push(BaseUnit {
                    name: free_name(named, &units),
                    file: None,
                    gaussians,
                    palette,
                    opacity: f32::from_bits(part.opacity),
                    convention: Convention::Ours,
                    ..base.without_gaussians()
                });
            }
        }
        let whole = members.count() == self.count();
        let bounds = if whole { scene.bounds } else { box_of(scene, members) };
        let orientation = scene.orientation.with_up(self.up());
        Ok(Scene { orientation, ..Scene::compose(units, Some(bounds)) })
    }

    /// The rows of a base unit by look: the unedited look first, rows in order.
    fn parts(&self, base: &BaseUnit, state: &BaseUnitState, members: &Mask) -> BTreeMap<Look, Vec<usize>> {
        let concerned: Vec<&Unit> = self.units().filter(|unit| !unit.is_neutral() || !unit.derived).collect();
        let mut parts: BTreeMap<Look, Vec<usize>> = BTreeMap::new();
        for global in base.range().filter(|i| members.get(*i)) {
            let (mut look, mut factor, mut tone) = (Look::default(), f64::from(state.opacity), state.tone);
            for unit in concerned.iter().filter(|unit| unit.mask.get(global)) {
                factor *= f64::from(unit.opacity);
                tone = tone.and(unit.tone);
                if unit.color.is_some() {
                    look.color = unit.id;
                }
                if !unit.derived {
                    look.name = unit.id;
                }
            }
            look.opacity = (factor as f32).to_bits();
            if !tone.is_neutral() {
                look.tone = [tone.saturation, tone.brightness, tone.temperature].map(f32::to_bits);
            }
            parts.entry(look).or_default().push(global - base.first);
        }
        parts
    }
}

/// `name`, or `name 2`, … where a unit has it already, in any capitals.
fn free_name(name: &str, units: &[BaseUnit]) -> String {
    let is_taken = |name: &str| units.iter().any(|unit| unit.name.to_lowercase() == name.to_lowercase());
    std::iter::once(name.to_owned())
        .chain((2_u32..).map(|n| format!("{name} {n}")))
        .find(|name| !is_taken(name))
        .unwrap_or_default()
}

/// The box of the finite centres of some Gaussians, in the scene frame.
fn box_of(scene: &Scene, members: &Mask) -> SceneBox {
    let centers = members.ones().filter_map(|i| scene.position(i)).filter(|p| p.is_finite());
    let all = centers.fold(None, |sides: Option<(DVec3, DVec3)>, p| {
        Some(sides.map_or((p, p), |(min, max)| (min.min(p), max.max(p))))
    });
    all.map_or(scene.bounds, |(min, max)| SceneBox { min, max })
}

/// Gaussians that a unit coloured: their columns say so relative to a palette of that colour.
fn painted(mut gaussians: Gaussians, shading: ShadingModel, palette: Vec3, color: Option<Vec3>) -> Gaussians {
    let Some(color) = color else { return gaussians };
    match (&mut gaussians.shading, &mut gaussians.harmonics) {
        (Some(columns), _) => paint_offsets(columns, shading, palette, color),
        (None, Some(harmonics)) => paint_harmonics(harmonics, color.as_dvec3()),
        (None, None) => {}
    }
    gaussians
}

fn paint_offsets(columns: &mut ShadingColumns, shading: ShadingModel, palette: Vec3, color: Vec3) {
    let palette = palette_in(shading, palette);
    let (given, palette) = (color.as_dvec3(), palette.as_dvec3());
    for offset in &mut columns.offset_color {
        let seen = recolored(given, palette + offset.as_dvec3(), palette);
        *offset = (seen - given).as_vec3();
    }
}

/// Gaussians of which a tone changes the colours, and the palette that their columns are relative to.
fn toned(mut gaussians: Gaussians, shading: ShadingModel, palette: Vec3, tone: Tone) -> (Gaussians, Vec3) {
    if tone.is_neutral() {
        return (gaussians, palette);
    }
    let old = palette_in(shading, palette).as_dvec3();
    let new = tone.of(old).as_vec3().clamp(Vec3::ZERO, Vec3::ONE);
    if let Some(columns) = &mut gaussians.shading {
        for offset in &mut columns.offset_color {
            *offset = (tone.of(old + offset.as_dvec3()) - new.as_dvec3()).as_vec3();
        }
    } else if let Some(harmonics) = &mut gaussians.harmonics {
        for constant in &mut harmonics.dc {
            let seen = tone.of(0.5 + Harmonics::C0 * DVec3::from_array(constant.map(f64::from)));
            *constant = ((seen - 0.5) / Harmonics::C0).as_vec3().to_array();
        }
        for term in &mut harmonics.rest {
            *term = tone.of(DVec3::from_array(term.map(f64::from))).as_vec3().to_array();
        }
    }
    (gaussians, new)
}

/// The palette as a shading model uses it.
fn palette_in(shading: ShadingModel, palette: Vec3) -> Vec3 {
    match shading {
        ShadingModel::Paper => palette,
        ShadingModel::IvrgsTrain | ShadingModel::IvrgsViewer => palette.clamp(Vec3::ZERO, Vec3::ONE),
    }
}

/// Without its bounds, `recolored_unlit` is linear in the seen colour, hence in its harmonics.
fn paint_harmonics(harmonics: &mut Harmonics, given: DVec3) {
    let brightness = |c: &[f32; 3]| DVec3::from_array(c.map(f64::from)).dot(BRIGHTNESS);
    for constant in &mut harmonics.dc {
        // The brightness of the seen colour is ½ + C₀·(brightness of dc) + …, since the weights sum to 1.
        let seen = given * (KEPT[0] + 0.5 + Harmonics::C0 * brightness(constant));
        *constant = ((seen - 0.5) / Harmonics::C0).as_vec3().to_array();
    }
    for term in &mut harmonics.rest {
        *term = (given * brightness(term)).as_vec3().to_array();
    }
}
