//! The shading model: the colour and opacity of each Gaussian before it is blended.
//!
//! Everything is evaluated in f64 from the stored f32 attributes, once a Gaussian, so that every rasterizer blends the same
//! numbers.

use glam::{DMat3, DVec3, Vec3};
use sg_scene::affine::NormalTransform;
use sg_scene::appearance::{Appearance, BaseAppearance, ShadingTerm};
use sg_scene::camera::LightMode;
use sg_scene::model::{BaseUnit, ShadingColumns, ShadingModel};
use sg_scene::recolor::{recolored, recolored_unlit};
use sg_scene::tone::Tone;

use crate::harmonics;
use crate::report::Culled;

/// The editable attributes of one Gaussian *as used*, with all multipliers applied, in the scene frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surface {
    /// Diffuse colour c_d, RGB.
    pub diffuse_color: DVec3,
    /// Normal n, of unit length or zero.
    pub normal: DVec3,
    /// Ambient factor ka.
    pub ambient: f64,
    /// Diffuse factor kd.
    pub diffuse: f64,
    /// Specular factor ks.
    pub specular: f64,
    /// Specular exponent β.
    pub shininess: f64,
}

/// Blinn-Phong colour of a surface, RGB clamped to `[0, 1]` after lighting; `None` where an attribute or the result is not
/// finite.
///
/// `to_eye` (v) and `to_light` (l) are unit vectors from the Gaussian, or zero if there is no direction. The half vector h is
/// normalize(l + v). With c_d, ka, kd, ks and β of `surface` and 0⁰ = 1:
///
/// - `Paper`: ka·c_d + kd·max(n·l,0)·c_d + ks·max(n·h,0)^β
/// - `IvrgsTrain`: (ka + kd·|n·l|)·c_d + ks·|n·h|^β, without the last term where n·l = 0
/// - `IvrgsViewer`: (ka + kd·|n·l|)·c_d + ks·kd·|n·h|^β, without the last term where n·l = 0
///
/// A `term` other than `Full` gives that summand alone; `Normal` gives ½(n + 1).
#[must_use]
pub fn shade(
    model: ShadingModel,
    term: ShadingTerm,
    surface: &Surface,
    to_eye: DVec3,
    to_light: DVec3,
) -> Option<DVec3> {
    let Surface { diffuse_color, normal, ambient, diffuse, specular, shininess } = *surface;
    let factors = [ambient, diffuse, specular, shininess];
    if !(diffuse_color.is_finite() && normal.is_finite() && factors.iter().all(|x| x.is_finite())) {
        return None;
    }
    let side = |cosine: f64| if model == ShadingModel::Paper { cosine.max(0.0) } else { cosine.abs() };
    let cosine = normal.dot(to_light);
    let highlight = || {
        // The power is the dearest operation here, and most scientific scenes have Gaussians without a highlight.
        if specular == 0.0 || (model != ShadingModel::Paper && cosine == 0.0) {
            return 0.0;
        }
        let half = (to_light + to_eye).normalize_or_zero();
        let strength = if model == ShadingModel::IvrgsViewer { specular * diffuse } else { specular };
        strength * side(normal.dot(half)).powf(shininess)
    };
    let color = match term {
        ShadingTerm::Full => (ambient + diffuse * side(cosine)) * diffuse_color + highlight(),
        ShadingTerm::Normal => 0.5 * (normal + 1.0),
        ShadingTerm::Ambient => ambient * diffuse_color,
        ShadingTerm::Diffuse => diffuse * side(cosine) * diffuse_color,
        ShadingTerm::Specular => DVec3::splat(highlight()),
    };
    color.is_finite().then(|| color.clamp(DVec3::ZERO, DVec3::ONE))
}

/// Colour and opacity of one Gaussian as it is blended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Look {
    /// RGB, at least 0.
    pub(crate) color: DVec3,
    /// Above 0, at most 1.
    pub(crate) opacity: f64,
}

/// What units make of the own colour of a Gaussian.
#[derive(Debug, Clone, Copy)]
struct Paint {
    /// The colour that replaces it.
    given: Option<DVec3>,
    /// The change after that.
    tone: Tone,
}

/// Shades the Gaussians of one base unit for one eye.
pub(crate) struct UnitShader<'a> {
    unit: &'a BaseUnit,
    base: BaseAppearance,
    appearance: &'a Appearance,
    multipliers: [f64; 4],
    directional: Option<DVec3>,
    eye: DVec3,
    normals: NormalTransform,
    to_local: Option<DMat3>,
}

impl<'a> UnitShader<'a> {
    pub(crate) fn new(unit: &'a BaseUnit, base: BaseAppearance, appearance: &'a Appearance, eye: DVec3) -> Self {
        let light = &appearance.light;
        let [ka, kd, ks, shininess] = base.multipliers.map(f64::from);
        let linear = DMat3::from_mat4(unit.transform);
        let determinant = linear.determinant();
        Self {
            unit,
            base,
            appearance,
            multipliers: [
                ka * f64::from(light.ka),
                kd * f64::from(light.kd),
                ks * f64::from(light.ks),
                shininess * f64::from(light.shininess),
            ],
            directional: match light.mode {
                LightMode::Headlight => None,
                LightMode::Direction => Some(DVec3::from_array(light.direction.map(f64::from)).normalize_or_zero()),
            },
            eye,
            normals: NormalTransform::of(linear),
            to_local: (determinant != 0.0 && determinant.is_finite()).then(|| linear.inverse()),
        }
    }

    /// The look of the unit's Gaussian `i`. Its centre lies at `position` in the scene frame.
    pub(crate) fn look(&self, i: usize, position: DVec3) -> Result<Look, Culled> {
        let global = self.unit.first + i;
        if !self.base.visible {
            return Err(Culled::Hidden);
        }
        let mut replaced = self.unit.tint(self.base.palette);
        let mut factor = f64::from(self.base.opacity);
        let mut tone = Tone::NEUTRAL;
        for edit in self.appearance.units.iter().filter(|u| u.mask.get(global)) {
            if !edit.visible {
                return Err(Culled::Hidden);
            }
            factor *= f64::from(edit.opacity);
            replaced = edit.color.or(replaced);
            tone = tone.and(edit.tone);
        }
        let paint = Paint { given: replaced.map(Vec3::as_dvec3), tone };
        let logit = self.unit.gaussians.opacity_logit.get(i).copied().unwrap_or(f32::NAN);
        let mut opacity = (factor / (1.0 + (-f64::from(logit)).exp())).clamp(0.0, 1.0);
        let shown = self.appearance.colors.as_ref().map(|colors| colors.get(global).map(|c| c.as_dvec3()));
        let mut color = match (shown, &self.unit.gaussians.shading) {
            (Some(color), _) => color.filter(|c| c.is_finite()).map(|c| c.max(DVec3::ZERO)),
            (None, Some(columns)) => self.lit(columns, i, position, paint),
            (None, None) => self.unlit(i, position, paint),
        }
        .ok_or(Culled::NotFinite)?;
        if let Some(overlay) = self.appearance.overlay.as_ref().filter(|o| o.mask.get(global)) {
            color = color.lerp(overlay.color.as_dvec3(), f64::from(overlay.mix)).max(DVec3::ZERO);
            opacity = (opacity * f64::from(overlay.opacity)).clamp(0.0, 1.0);
        }
        if !(color.is_finite() && opacity.is_finite()) {
            Err(Culled::NotFinite)
        } else if opacity == 0.0 {
            Err(Culled::Transparent)
        } else {
            Ok(Look { color, opacity })
        }
    }

    fn lit(&self, columns: &ShadingColumns, i: usize, position: DVec3, paint: Paint) -> Option<DVec3> {
        let palette = self.base.palette.as_dvec3();
        let palette = match self.unit.shading {
            ShadingModel::Paper => palette,
            ShadingModel::IvrgsTrain | ShadingModel::IvrgsViewer => palette.clamp(DVec3::ZERO, DVec3::ONE),
        };
        let [ka, kd, ks, shininess] = self.multipliers;
        let occlusion = match &self.appearance.occlusion {
            Some(factors) => f64::from(*factors.get(self.unit.first + i)?),
            None => 1.0,
        };
        let column = |values: &[f32]| values.get(i).copied().map(f64::from);
        let surface = Surface {
            diffuse_color: paint.tone.of(match paint.given {
                Some(color) => recolored(color, palette + columns.offset_color.get(i)?.as_dvec3(), palette),
                None => palette + columns.offset_color.get(i)?.as_dvec3(),
            }),
            normal: self.normals.apply(columns.normal.get(i)?.as_dvec3()),
            ambient: ka * occlusion * column(&columns.ambient)?,
            diffuse: kd * column(&columns.diffuse)?,
            specular: ks * column(&columns.specular)?,
            shininess: shininess * column(&columns.shininess)?,
        };
        let to_eye = (self.eye - position).normalize_or_zero();
        shade(self.unit.shading, self.appearance.term, &surface, to_eye, self.directional.unwrap_or(to_eye))
    }

    /// A Gaussian without shading attributes has nothing to light: it looks the same under every light and term.
    fn unlit(&self, i: usize, position: DVec3, paint: Paint) -> Option<DVec3> {
        let seen = |harmonics| {
            let away = position - self.eye;
            let direction = self.to_local.map_or(away, |m| m * away).normalize_or_zero();
            harmonics::color(harmonics, i, direction)
        };
        let color = match (paint.given, &self.unit.gaussians.harmonics) {
            (Some(color), Some(harmonics)) => recolored_unlit(color, seen(harmonics)?.max(DVec3::ZERO)),
            (None, Some(harmonics)) => seen(harmonics)?,
            (Some(color), None) => color,
            (None, None) => self.base.palette.as_dvec3(),
        };
        color.is_finite().then(|| paint.tone.of(color.max(DVec3::ZERO)).max(DVec3::ZERO))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SURFACE: Surface = Surface {
        diffuse_color: DVec3::new(0.5, 0.25, 0.125),
        normal: DVec3::Z,
        ambient: 0.2,
        diffuse: 0.5,
        specular: 0.4,
        shininess: 2.0,
    };

    fn close(got: Option<DVec3>, want: [f64; 3]) {
        let got = got.unwrap();
        assert!((got - DVec3::from_array(want)).length() < 1e-12, "{got} {want:?}");
    }

    // l at 60° from n, v at 60° on the other side of l's mirror: n·l = ½, h = n, n·h = 1.
    const L: DVec3 = DVec3::new(0.866_025_403_784_438_6, 0.0, 0.5);
    const V: DVec3 = DVec3::new(-0.866_025_403_784_438_6, 0.0, 0.5);

    #[test]
    fn paper_by_hand() {
        // (0.2 + 0.5·½)·c_d + 0.4·1²
        let want = [0.45 * 0.5 + 0.4, 0.45 * 0.25 + 0.4, 0.45 * 0.125 + 0.4];
        close(shade(ShadingModel::Paper, ShadingTerm::Full, &SURFACE, V, L), want);
        // Headlight at 60°: n·l = n·h = ½, so 0.4·¼.
        let want = [0.45 * 0.5 + 0.1, 0.45 * 0.25 + 0.1, 0.45 * 0.125 + 0.1];
        close(shade(ShadingModel::Paper, ShadingTerm::Full, &SURFACE, L, L), want);
        // From behind only the ambient term is left.
        close(shade(ShadingModel::Paper, ShadingTerm::Full, &SURFACE, -L, -L), [0.1, 0.05, 0.025]);
    }

    #[test]
    fn two_sided_models_by_hand() {
        let want = [0.45 * 0.5 + 0.1, 0.45 * 0.25 + 0.1, 0.45 * 0.125 + 0.1];
        for side in [L, -L] {
            close(shade(ShadingModel::IvrgsTrain, ShadingTerm::Full, &SURFACE, side, side), want);
        }
        // The viewer's extra kd: 0.4·0.5·¼.
        let want = [0.45 * 0.5 + 0.05, 0.45 * 0.25 + 0.05, 0.45 * 0.125 + 0.05];
        close(shade(ShadingModel::IvrgsViewer, ShadingTerm::Full, &SURFACE, -L, -L), want);
    }

    #[test]
    fn terms_add_up() {
        for model in [ShadingModel::Paper, ShadingModel::IvrgsTrain, ShadingModel::IvrgsViewer] {
            let term = |t| shade(model, t, &SURFACE, V, L).unwrap();
            let sum = term(ShadingTerm::Ambient) + term(ShadingTerm::Diffuse) + term(ShadingTerm::Specular);
            assert!((sum - term(ShadingTerm::Full)).length() < 1e-12);
        }
        close(shade(ShadingModel::Paper, ShadingTerm::Normal, &SURFACE, V, L), [0.5, 0.5, 1.0]);
    }

    #[test]
    fn zero_to_the_zero_is_one_and_lighting_is_clamped_afterwards() {
        let flat = Surface { shininess: 0.0, specular: 0.25, ambient: 0.0, diffuse: 0.0, ..SURFACE };
        close(shade(ShadingModel::Paper, ShadingTerm::Full, &flat, -L, -L), [0.25; 3]);
        // iVR-GS has no highlight where n·l = 0.
        close(shade(ShadingModel::IvrgsTrain, ShadingTerm::Full, &flat, DVec3::X, DVec3::X), [0.0; 3]);
        let bright = Surface { ambient: 3.0, ..SURFACE };
        close(shade(ShadingModel::Paper, ShadingTerm::Full, &bright, -L, -L), [1.0, 0.75, 0.375]);
    }

    #[test]
    fn what_is_not_finite_has_no_colour() {
        for broken in [
            Surface { ambient: f64::NAN, ..SURFACE },
            Surface { specular: 0.0, shininess: f64::NAN, ..SURFACE },
            Surface { diffuse_color: DVec3::new(0.0, f64::INFINITY, 0.0), ..SURFACE },
            Surface { shininess: -1.0, normal: DVec3::Y, ..SURFACE },
        ] {
            assert_eq!(shade(ShadingModel::Paper, ShadingTerm::Full, &broken, V, L), None, "{broken:?}");
        }
    }
}
