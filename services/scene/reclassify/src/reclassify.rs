//! Colours, opacities and shading of a base unit under a transfer function.

use glam::Vec3;
use rayon::prelude::*;
use sg_scene::model::{BaseUnit, Gaussians, Scene, ShadingColumns};
use sg_volume::averages::Averages;
use sg_volume::dvr::Material;
use sg_volume::transfer::{Problem, Units};
use sg_volume::{Classifier, Surfaceness, TransferFunction, ValueRange};

use crate::optical_depth::{fast_opacity_of, logit_of};
use crate::sources::{self, Columns};

/// Gaussians of a thread's part, at least.
const LEAST_PART: usize = 1024;

/// A base unit cannot have another transfer function.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ReclassifyError {
    /// The file has no values of a volume.
    #[error(
        "`{0}` keeps no values of a volume, which a transfer function needs; make the scene of its volume anew with `fit`"
    )]
    NoValues(String),
    /// Normalized values refer to the range of the volume's.
    #[error(
        "the transfer function has normalized values, but the file of `{0}` does not tell the range of its volume; give raw values"
    )]
    NoRange(String),
    /// The function is invalid.
    #[error("the transfer function's {0}")]
    Function(#[from] Problem),
}

/// Look of one Gaussian.
struct Look {
    color: Vec3,
    opacity_logit: f32,
    /// Surfaceness before, and now.
    surfaceness: [f32; 2],
}

/// Whether a scene can have this transfer function. Units without values of a volume keep their look, as long as another has some.
///
/// # Errors
/// [`ReclassifyError`].
pub fn check_scene(scene: &Scene, function: &TransferFunction) -> Result<(), ReclassifyError> {
    let (mut refusal, mut has_values) = (None, false);
    for unit in &scene.units {
        match check(unit, function) {
            Ok(()) => has_values = true,
            Err(error @ ReclassifyError::NoValues(_)) => refusal = refusal.or(Some(error)),
            Err(error) => return Err(error),
        }
    }
    refusal.filter(|_| !has_values).map_or(Ok(()), Err)
}

/// Gives a scene a transfer function: [`reclassify`] of each base unit with values of a volume.
///
/// # Errors
/// [`ReclassifyError`]. The scene is then as before.
pub fn reclassify_scene(scene: &mut Scene, function: &TransferFunction) -> Result<(), ReclassifyError> {
    check_scene(scene, function)?;
    for unit in scene.units.iter_mut().filter(|unit| sources::keeps_values(&unit.gaussians)) {
        reclassify(unit, function)?;
    }
    Ok(())
}

/// Whether a base unit can have this transfer function.
fn check(unit: &BaseUnit, function: &TransferFunction) -> Result<(), ReclassifyError> {
    if Columns::of(&unit.gaussians.extra).is_none() {
        return Err(ReclassifyError::NoValues(unit.name.clone()));
    }
    bound(unit, function).map(drop)
}

/// Gives the Gaussians of a base unit the colours, opacities and shading of a transfer function, of which base units do not count. A
/// Gaussian has the averages of the function over its values, which spread evenly around their mean. What training changed stays. No
/// place, length, normal or palette changes.
///
/// # Errors
/// [`ReclassifyError`]. The unit is then as before.
pub fn reclassify(unit: &mut BaseUnit, function: &TransferFunction) -> Result<(), ReclassifyError> {
    let classifier = bound(unit, function)?;
    let averages = Averages::new(&classifier);
    let surfaceness = unit.values.map(|values| Surfaceness::of_range(values, 1.0, &classifier));
    let palette = unit.palette;
    let Gaussians { extra, opacity_logit, shading, .. } = &mut unit.gaussians;
    let columns = Columns::of(extra).ok_or_else(|| ReclassifyError::NoValues(unit.name.clone()))?;
    let look = |i: usize| {
        let average = columns.average(&averages, i);
        let opacity = fast_opacity_of(average.depth * f64::from(columns.depth[i]));
        let color = (average.color + columns.offset(i)).clamp(Vec3::ZERO, Vec3::ONE);
        let before = columns.surfaceness[i];
        let now = surfaceness.as_ref().map_or(before, |surfaceness| {
            let rise = f64::from(surfaceness.rise(columns.value(i), columns.gradient[i]));
            Surfaceness::of_part(f64::from(columns.consistency[i]), rise) as f32
        });
        Look { color: color - palette, opacity_logit: logit_of(opacity), surfaceness: [before, now] }
    };
    let looks: Vec<Look> = (0..opacity_logit.len()).into_par_iter().with_min_len(LEAST_PART).map(look).collect();
    for (i, look) in looks.iter().enumerate() {
        opacity_logit[i] = look.opacity_logit;
        let Some(shading) = shading.as_mut() else { continue };
        shading.offset_color[i] = look.color;
        let [before, now] = look.surfaceness;
        if before != now {
            add_surfaceness(shading, i, now - before);
        }
    }
    sources::set_surfaceness(&mut unit.gaussians, looks.iter().map(|look| look.surfaceness[1]).collect());
    Ok(())
}

/// Shades one Gaussian by this much more like a surface of its volume, or by as much less. Its factors stay at least 0.
pub fn add_surfaceness(shading: &mut ShadingColumns, i: usize, change: f32) {
    let (haze, surface) = (Material::STANDARD.with_surfaceness(0.0), Material::STANDARD);
    let slopes = [surface.ambient - haze.ambient, surface.diffuse, surface.specular];
    let factors = [&mut shading.ambient[i], &mut shading.diffuse[i], &mut shading.specular[i]];
    for (factor, slope) in factors.into_iter().zip(slopes) {
        *factor = (*factor + change * slope).max(0.0);
    }
}

/// The function for the values of the volume behind a unit.
fn bound(unit: &BaseUnit, function: &TransferFunction) -> Result<Classifier, ReclassifyError> {
    let values = match (unit.values, function.units) {
        (Some(values), _) => values,
        (None, Units::Raw) => function.domain,
        (None, Units::Normalized) => return Err(ReclassifyError::NoRange(unit.name.clone())),
    };
    let [low, high] = values;
    Ok(function.classifier(ValueRange { low, high, non_finite: 0 })?)
}

#[cfg(test)]
mod tests {
    use sg_volume::transfer::{ControlPoint, Scale};

    use super::*;
    use crate::sources::{Source, store, values};

    fn unit(sources: &[Source]) -> BaseUnit {
        let mut unit = sg_scene::synthetic::test_scene(&[("bone", sources.len())]).units.remove(0);
        store(sources, &mut unit.gaussians);
        BaseUnit { values: Some([0.0, 200.0]), ..unit }
    }

    fn ramp(units: Units, end: f64) -> TransferFunction {
        let point = |value, gray, opacity| ControlPoint { value, color: [gray; 3], opacity };
        let points = vec![point(0.0, 0.0, 0.0), point(end, 1.0, 0.8)];
        TransferFunction {
            domain: [0.0, end],
            units,
            scale: Scale::Linear,
            variable: None,
            points,
            base_units: Vec::new(),
        }
    }

    fn source(value: f64, spread: f64) -> Source {
        Source { value, spread, depth: 1.0, ..Source::default() }
    }

    #[test]
    fn values_get_the_look_of_the_function() {
        let mut unit = unit(&[source(0.0, 0.0), source(100.0, 0.0), source(200.0, 0.0), source(f64::NAN, 0.0)]);
        assert_eq!(values(&unit.gaussians).unwrap()[1], 100.0);
        reclassify(&mut unit, &ramp(Units::Raw, 200.0)).unwrap();
        let opacity: Vec<f32> = (0..4).map(|i| unit.gaussians.opacity(i)).collect();
        let expected = |a: f64| crate::optical_depth::opacity_of(-(-a).ln_1p()) as f32;
        assert!(opacity[0] < 1e-6 && (opacity[1] - expected(0.4)).abs() < 1e-4 && opacity[3] < 1e-6, "{opacity:?}");
        assert!((opacity[2] - expected(0.8)).abs() < 1e-4, "{opacity:?}");
        let colors = &unit.gaussians.shading.as_ref().unwrap().offset_color;
        assert!((colors[1] + unit.palette - 0.5).length() < 1e-6);
        let raw = unit.clone();
        reclassify(&mut unit, &ramp(Units::Normalized, 1.0)).unwrap();
        let difference = |i: usize| (raw.gaussians.opacity_logit[i] - unit.gaussians.opacity_logit[i]).abs();
        assert!((0..4).all(|i| difference(i) < 1e-4), "the same function");
    }

    #[test]
    fn values_that_f32_does_not_hold_keep_their_digits() {
        // Steps of f32 are 64 here.
        let offset = 1e9;
        let mut unit = unit(&[source(offset + 10.0, 0.0), source(offset + 30.0, 0.0)]);
        let found = values(&unit.gaussians).unwrap();
        assert_eq!(found, [offset + 10.0, offset + 30.0]);
        unit.values = Some([offset, offset + 40.0]);
        let mut shifted = ramp(Units::Raw, 40.0);
        shifted.domain = [offset, offset + 40.0];
        shifted.points.iter_mut().for_each(|point| point.value += offset);
        reclassify(&mut unit, &shifted).unwrap();
        let [low, high] = [0, 1].map(|i| unit.gaussians.opacity(i));
        assert!(low > 0.1 && high > low + 0.2, "{low} {high}");
        let plain = sg_scene::synthetic::test_scene(&[("bone", 1)]).units.remove(0);
        let mut exact = BaseUnit { values: None, ..plain };
        store(&[source(100.0, 0.0)], &mut exact.gaussians);
        assert!(exact.gaussians.extra.iter().all(|column| column.name != "source_value_rest"));
    }

    #[test]
    fn a_narrower_domain_makes_clearer_boundaries() {
        let edge = Source { gradient: 2.0, consistency: 1.0, ..source(100.0, 0.0) };
        let mut unit = unit(&[edge]);
        let before = unit.gaussians.shading.clone().unwrap();
        let mut narrow = ramp(Units::Raw, 200.0);
        narrow.domain = [80.0, 120.0];
        reclassify(&mut unit, &narrow).unwrap();
        let after = unit.gaussians.shading.as_ref().unwrap();
        assert!(after.diffuse[0] > before.diffuse[0] && after.ambient[0] < before.ambient[0]);
        let once = unit.clone();
        reclassify(&mut unit, &narrow).unwrap();
        assert_eq!(unit, once, "a second time changes nothing");
    }

    #[test]
    fn units_without_values_and_unknown_ranges_are_refused_and_stay() {
        let plain = sg_scene::synthetic::test_scene(&[("bone", 3)]).units.remove(0);
        let mut refused = plain.clone();
        let none = Err(ReclassifyError::NoValues("bone".to_owned()));
        assert_eq!(
            (check(&plain, &ramp(Units::Raw, 1.0)), reclassify(&mut refused, &ramp(Units::Raw, 1.0))),
            (none.clone(), none)
        );
        let unknown = BaseUnit { values: None, ..unit(&[source(1.0, 0.0)]) };
        assert_eq!(check(&unknown, &ramp(Units::Normalized, 1.0)), Err(ReclassifyError::NoRange("bone".to_owned())));
        assert_eq!(check(&unknown, &ramp(Units::Raw, 1.0)), Ok(()));
        let empty = TransferFunction { points: Vec::new(), ..ramp(Units::Raw, 1.0) };
        let message = check(&unknown, &empty).unwrap_err().to_string();
        assert!(message.contains("points"), "{message}");
        assert_eq!(refused, plain);
    }

    #[test]
    fn training_of_a_damaged_file_does_not_panic() {
        let depths = [1.0, -2.0, f64::NAN, 0.0, f64::INFINITY];
        let mut start = unit(&depths.map(|depth| Source { depth, ..source(100.0, 0.0) }));
        start.gaussians.log_scale[4] = Vec3::splat(f32::NEG_INFINITY);
        let start = Scene::compose(vec![start], None);
        let (mut trained, function) = (start.clone(), ramp(Units::Raw, 200.0));
        let classifier = bound(&start.units[0], &function).unwrap();
        sources::follow_training(&mut trained, &start, &classifier);
        reclassify(&mut trained.units[0], &function).unwrap();
        assert!(trained.units[0].gaussians.opacity_logit.iter().all(|logit| logit.is_finite()));
    }

    #[test]
    fn hidden_shifted_and_forgotten_values() {
        let mut unit = unit(&[source(0.0, 0.0), source(100.0, 0.0)]);
        let function = ramp(Units::Raw, 200.0);
        reclassify(&mut unit, &function).unwrap();
        let scene = Scene::compose(vec![unit.clone()], None);
        assert_eq!(sources::hidden(&scene).ones().collect::<Vec<_>>(), [0]);
        let shift = Vec3::new(0.1, 0.0, -0.2);
        sources::shift_colors(&mut unit.gaussians, shift);
        unit.palette += shift;
        reclassify(&mut unit, &function).unwrap();
        let color = unit.palette + unit.gaussians.shading.as_ref().unwrap().offset_color[1];
        assert!((color - Vec3::new(0.6, 0.5, 0.3)).length() < 1e-6, "{color}");
        sources::forget(&mut unit.gaussians);
        assert!(unit.gaussians.extra.is_empty() && check(&unit, &function).is_err());
        assert!(sources::hidden(&Scene::compose(vec![unit], None)).is_none(), "trained splats keep their faint ones");
    }
}
