//! Maps of attributes: a property of each Gaussian as its colour.

use std::sync::Arc;

use glam::{DMat3, DVec3, Vec3};
use rayon::prelude::*;
use sg_scene::affine::NormalTransform;
use sg_scene::model::{BaseUnit, Scene};

use crate::color_map::ColorMap;

/// The attribute to show.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Attribute {
    /// Geometric mean of its three standard deviations, in the scene's length unit, on a logarithmic legend.
    Scale,
    /// Its longest standard deviation over its shortest, on a logarithmic legend.
    Anisotropy,
    /// Its own peak opacity, 0 to 1, without factors of units.
    Opacity,
    /// Δc itself, clamped to 0 to 1.
    OffsetColor,
    /// ½(n + 1) of its normal in the scene frame.
    Normal,
    /// Size of the components of its longest axis in the scene frame: red for x, green for y, blue for z.
    PrincipalAxis,
}

impl Attribute {
    /// Its name in a legend.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Scale => "mean standard deviation",
            Self::Anisotropy => "elongation",
            Self::Opacity => "opacity",
            Self::OffsetColor => "offset colour",
            Self::Normal => "normal",
            Self::PrincipalAxis => "longest axis",
        }
    }
}

/// The numbers at the ends of the colour map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Legend {
    /// The number at the dark end.
    pub low: f64,
    /// The number at the bright end.
    pub high: f64,
    /// Whether equal steps of colour are equal factors rather than equal differences.
    pub logarithmic: bool,
    /// The colours between.
    pub map: ColorMap,
}

/// Colours of an attribute.
#[derive(Debug, Clone, PartialEq)]
pub struct AttributeColors {
    /// One a Gaussian by scene-wide index, for [`sg_scene::appearance::Appearance::colors`]; [`ColorMap::MISSING`] where a
    /// Gaussian has no such attribute.
    pub colors: Arc<[Vec3]>,
    /// The meaning of the colours, if they stand for a number.
    pub legend: Option<Legend>,
}

/// An attribute that cannot be shown.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum AttributeError {
    /// No Gaussian has it.
    #[error("no Gaussian of the scene has the attribute `{0}`; its files hold no editable shading")]
    Missing(&'static str),
    /// A range that nothing fits in.
    #[error("the range from {low} to {high} does not rise, or not above 0 as a logarithmic legend needs")]
    Range {
        /// Low end.
        low: f64,
        /// High end.
        high: f64,
    },
    /// A range for an attribute that is a colour already.
    #[error("`{0}` is shown as a colour and has no range")]
    NoRange(&'static str),
}

/// The colours of an attribute.
///
/// `range` gives the ends of the legend. Without one they are 0 and 1 for the opacity. For other numbers they are the values that
/// 2 % of the Gaussians lie below and above.
///
/// # Errors
/// [`AttributeError`].
pub fn attribute_colors(
    scene: &Scene,
    attribute: Attribute,
    map: ColorMap,
    range: Option<(f64, f64)>,
) -> Result<AttributeColors, AttributeError> {
    let color: fn(&BaseUnit, usize) -> Option<DVec3> = match attribute {
        Attribute::Scale => return numbers(scene, geometric_mean, true, map, range),
        Attribute::Anisotropy => return numbers(scene, anisotropy, true, map, range),
        Attribute::Opacity => return numbers(scene, opacity, false, map, range.or(Some((0.0, 1.0)))),
        Attribute::OffsetColor => |unit, i| {
            let offset = unit.gaussians.shading.as_ref()?.offset_color.get(i)?;
            Some(offset.as_dvec3().clamp(DVec3::ZERO, DVec3::ONE))
        },
        Attribute::Normal => |unit, i| {
            let normal = unit.gaussians.shading.as_ref()?.normal.get(i)?.as_dvec3();
            let turned = NormalTransform::of(DMat3::from_mat4(unit.transform)).apply(normal);
            turned.try_normalize().map(|n| 0.5 * (n + 1.0))
        },
        Attribute::PrincipalAxis => |unit, i| {
            let axes = axes(unit, i)?.map(|a| (a.length_squared(), a));
            let longest = axes.into_iter().fold((0.0, DVec3::ZERO), |m, a| if a.0 > m.0 { a } else { m }).1;
            longest.try_normalize().map(DVec3::abs)
        },
    };
    if range.is_some() {
        return Err(AttributeError::NoRange(attribute.name()));
    }
    let found = each(scene, color);
    if !found.is_empty() && found.par_iter().all(Option::is_none) {
        return Err(AttributeError::Missing(attribute.name()));
    }
    let shown = |c: Option<DVec3>| c.map_or(ColorMap::MISSING, DVec3::as_vec3);
    Ok(AttributeColors { colors: found.into_par_iter().map(shown).collect(), legend: None })
}

/// A finite something of every Gaussian in index order.
fn each<T: Send + Copy>(scene: &Scene, of: fn(&BaseUnit, usize) -> Option<T>) -> Vec<Option<T>> {
    scene
        .units
        .par_iter()
        .flat_map(|unit| (0..unit.gaussians.len()).into_par_iter().map(move |i| of(unit, i)))
        .collect()
}

fn numbers(
    scene: &Scene,
    number: fn(&BaseUnit, usize) -> Option<f64>,
    logarithmic: bool,
    map: ColorMap,
    range: Option<(f64, f64)>,
) -> Result<AttributeColors, AttributeError> {
    let found = each(scene, number);
    let (low, high) = range.unwrap_or_else(|| inner_range(&found, logarithmic));
    let lowest = if logarithmic { f64::MIN_POSITIVE } else { f64::NEG_INFINITY };
    if !(low >= lowest && low < high && high.is_finite()) {
        return Err(AttributeError::Range { low, high });
    }
    let place = |x: f64| {
        if logarithmic { (x / low).ln() / (high / low).ln() } else { (x - low) / (high - low) }
    };
    let colors = found.into_par_iter().map(|x| x.map_or(ColorMap::MISSING, |x| map.at(place(x)))).collect();
    Ok(AttributeColors { colors, legend: Some(Legend { low, high, logarithmic, map }) })
}

/// The range without the outermost 2 % on each side, widened if it is a single number.
fn inner_range(found: &[Option<f64>], logarithmic: bool) -> (f64, f64) {
    let usable = |x: &f64| x.is_finite() && (!logarithmic || *x > 0.0);
    let mut sorted: Vec<f64> = found.iter().copied().flatten().filter(usable).collect();
    sorted.sort_unstable_by(f64::total_cmp);
    let outer = sorted.len() / 50;
    let low = sorted.get(outer).copied().unwrap_or(1.0);
    let high = sorted.iter().rev().nth(outer).copied().unwrap_or(1.0);
    match (low < high, logarithmic) {
        (true, _) => (low, high),
        (false, true) => (low / 2.0, low * 2.0),
        (false, false) => (low - 0.5, low + 0.5),
    }
}

/// The half axes of the Gaussian's ellipsoid, in the scene frame. If the unit's transform shears, they are the images of the
/// axes.
fn axes(unit: &BaseUnit, i: usize) -> Option<[DVec3; 3]> {
    let scale = unit.gaussians.log_scale.get(i)?.as_dvec3().exp();
    unit.gaussians.rotation.get(i)?;
    let turn = DMat3::from_mat4(unit.transform) * DMat3::from_quat(unit.gaussians.unit_rotation(i));
    let axes = [turn.x_axis * scale.x, turn.y_axis * scale.y, turn.z_axis * scale.z];
    axes.iter().all(|a| a.is_finite()).then_some(axes)
}

fn geometric_mean(unit: &BaseUnit, i: usize) -> Option<f64> {
    axes(unit, i).map(|axes| axes.map(DVec3::length).iter().product::<f64>().cbrt())
}

fn anisotropy(unit: &BaseUnit, i: usize) -> Option<f64> {
    let lengths = axes(unit, i)?.map(DVec3::length);
    let (low, high) = lengths.iter().fold((f64::INFINITY, 0.0_f64), |(l, h), x| (l.min(*x), h.max(*x)));
    (high > 0.0).then_some(high / low)
}

fn opacity(unit: &BaseUnit, i: usize) -> Option<f64> {
    let logit = f64::from(*unit.gaussians.opacity_logit.get(i)?);
    (!logit.is_nan()).then(|| 1.0 / (1.0 + (-logit).exp()))
}
