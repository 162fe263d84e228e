//! The Gaussians of one time step as the start of the next. They move with what is visible, and the new values correct them. Others
//! come where the new step shows what none of them covers.

use glam::{DQuat, DVec3, Vec3};
use rayon::prelude::*;
use sg_reclassify::add_surfaceness;
use sg_reclassify::optical_depth::{dilogarithm, logit_of, opacity_of};
use sg_reclassify::sources::{self, Source};
use sg_scene::model::{BaseUnit, Gaussians, Scene, ShadingColumns};
use sg_volume::{Classifier, Surfaceness};

use super::lineage::{Neighbours, places};
use super::motion::Motion;
use super::samples::{Place, Sampled, Voxels};
use crate::placement::PlacementError;

/// Share of the optical depth below which a Gaussian shows nothing any more.
const GONE: f64 = 0.05;
/// Greatest factor on the optical depth of a Gaussian. What was nearly transparent could get any.
const GREATEST_FACTOR: f64 = 4.0;
/// Consistency of the gradients from which their direction is that of a normal.
const HAS_DIRECTION: f64 = 0.5;
/// Gaussians of a direct start that one of the step before covers.
const COVERED: usize = 2;
/// Distance of what covers, in standard deviations of the middle axis of the covered one.
const COVERING: f64 = 1.5;

/// The start of a step from the one before.
pub(super) struct WarmStart {
    pub(super) scene: Scene,
    /// For each Gaussian the one that it was; `None` for those of the direct start.
    pub(super) origins: Vec<Option<usize>>,
    /// Gaussians of the step before that showed nothing any more.
    pub(super) removed: usize,
}

/// One corrected Gaussian.
struct Corrected {
    position: Vec3,
    rotation: DQuat,
    opacity_logit: f32,
    color: Vec3,
    normal: Vec3,
    /// Surfaceness now, less that before.
    surfaceness: f64,
    source: Source,
}

/// Moves and corrects the scene of the step before. `direct` is the direct start of the new step; `most` is the largest number
/// of Gaussians.
pub(super) fn warm_start(
    before: &Scene,
    [old, new]: [&Voxels<'_>; 2],
    direct: &Scene,
    motion: &Motion,
    classifier: &Classifier,
    most: usize,
) -> Result<WarmStart, PlacementError> {
    let range = new.field().range();
    // Gradients of samples are per voxel.
    let surfaceness = Surfaceness::of_range([range.low, range.high], 1.0, classifier);
    let origin = 0.5 * (direct.bounds.min + direct.bounds.max);
    let kept: Vec<Vec<(usize, Corrected)>> = before
        .units
        .iter()
        .enumerate()
        .map(|(k, unit)| {
            let own = sources::stored(&unit.gaussians).unwrap_or_default();
            let each = |i: usize| {
                let place = place_of(unit, i);
                let moved = Place { middle: place.middle + motion.at(place.middle), ..place };
                let then = old.around(&place, k, classifier, &surfaceness);
                let now = new.around(&moved, k, classifier, &surfaceness);
                let source = own.get(i).copied().unwrap_or_default();
                corrected(unit, i, moved.middle - place.middle, [then, now], source).map(|corrected| (i, corrected))
            };
            (0..unit.gaussians.len()).into_par_iter().with_min_len(256).filter_map(each).collect()
        })
        .collect();
    let count: usize = kept.iter().map(Vec::len).sum();
    let removed = before.len() - count;
    // Those of the direct start that nothing covers, the least covered first.
    let mut uncovered: Vec<(f64, usize, usize)> = Vec::new();
    for (k, (unit, kept)) in direct.units.iter().zip(&kept).enumerate() {
        let there: Vec<DVec3> = match before.units.get(k) {
            Some(earlier) => {
                kept.iter().map(|(_, of)| earlier.transform.transform_point3(of.position.as_dvec3())).collect()
            }
            None => Vec::new(),
        };
        uncovered.extend(not_covered(unit, &there, origin)?.into_iter().map(|(excess, i)| (excess, k, i)));
    }
    uncovered.sort_by(|a, b| b.0.total_cmp(&a.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    uncovered.truncate(most.saturating_sub(count));
    let mut units = Vec::with_capacity(before.units.len());
    let mut origins = Vec::with_capacity(count + uncovered.len());
    for (k, (earlier, kept)) in before.units.iter().zip(kept).enumerate() {
        let mut placed: Vec<usize> = uncovered.iter().filter(|(_, unit, _)| *unit == k).map(|(_, _, i)| *i).collect();
        placed.sort_unstable();
        origins.extend(kept.iter().map(|(i, _)| Some(earlier.first + i)));
        origins.extend(placed.iter().map(|_| None));
        units.push(joined(earlier, kept, &direct.units[k], &placed));
    }
    let mut scene = Scene::compose(units, Some(direct.bounds));
    scene.orientation = before.orientation;
    let start = scene.clone();
    sources::follow_training(&mut scene, &start, classifier);
    Ok(WarmStart { scene, origins, removed })
}

/// Place and axes of a Gaussian in the world.
fn place_of(unit: &BaseUnit, i: usize) -> Place {
    let gaussians = &unit.gaussians;
    let (rotation, scale) = (gaussians.unit_rotation(i), gaussians.scale(i).as_dvec3());
    let axis = |way: DVec3, length: f64| unit.transform.transform_vector3(rotation * way * length);
    Place {
        middle: unit.transform.transform_point3(gaussians.position[i].as_dvec3()),
        axes: [axis(DVec3::X, scale.x), axis(DVec3::Y, scale.y), axis(DVec3::Z, scale.z)],
    }
}

/// A Gaussian after the step; `None` where the new step shows nothing. Each number changes by what its samples changed, so training
/// stays, and a Gaussian whose samples are the same stays as it is.
fn corrected(unit: &BaseUnit, i: usize, way: DVec3, [then, now]: [Sampled; 2], source: Source) -> Option<Corrected> {
    let gaussians = &unit.gaussians;
    let none = ShadingColumns::default();
    let shading = gaussians.shading.as_ref().unwrap_or(&none);
    let (color, normal) =
        (shading.offset_color.get(i).copied().unwrap_or_default(), shading.normal.get(i).copied().unwrap_or_default());
    let mut of = Corrected {
        position: gaussians.position[i],
        rotation: gaussians.unit_rotation(i),
        opacity_logit: gaussians.opacity_logit[i],
        color,
        normal,
        surfaceness: 0.0,
        source,
    };
    if then == now && way == DVec3::ZERO {
        return Some(of);
    }
    of.position += way.as_vec3();
    if then.depth > 0.0 {
        let ratio = now.depth / then.depth;
        if ratio < GONE {
            return None;
        }
        let ratio = ratio.min(GREATEST_FACTOR);
        if ratio != 1.0 {
            of.opacity_logit = logit_of(opacity_of(dilogarithm(f64::from(gaussians.opacity(i))) * ratio));
        }
        of.color = (color + unit.palette + now.color - then.color).clamp(Vec3::ZERO, Vec3::ONE) - unit.palette;
    } else if now.depth > 0.0 {
        // Nothing was there: what stands there now is for the direct start.
        return None;
    }
    let turns = then.consistency >= HAS_DIRECTION && now.consistency >= HAS_DIRECTION;
    let [from, to] = [then, now].map(|of| of.gradient.as_dvec3().try_normalize());
    if let (true, Some(from), Some(to)) = (turns, from, to) {
        let turn = DQuat::from_rotation_arc(from, to);
        of.rotation = (turn * of.rotation).normalize();
        of.normal = (turn * normal.as_dvec3()).as_vec3();
    }
    of.surfaceness = now.surfaceness - then.surfaceness;
    let length = |of: Sampled| f64::from(of.gradient.length());
    of.source = Source {
        value: source.value + now.value - then.value,
        spread: (source.spread + now.spread - then.spread).max(0.0),
        gradient: (source.gradient + length(now) - length(then)).max(0.0),
        consistency: (source.consistency + now.consistency - then.consistency).clamp(0.0, 1.0),
        surfaceness: (source.surfaceness + of.surfaceness).clamp(0.0, 1.0),
        depth: source.depth,
    };
    Some(of)
}

/// The Gaussians of a direct start that those at `there` do not cover, with how far they are from them in their own size.
fn not_covered(direct: &BaseUnit, there: &[DVec3], origin: DVec3) -> Result<Vec<(f64, usize)>, PlacementError> {
    let neighbours = Neighbours::new(there, origin)?;
    let own = places(direct);
    let relative = |i: usize, distance: f64| {
        let mut lengths = direct.gaussians.scale(i).as_dvec3().to_array();
        lengths.sort_by(f64::total_cmp);
        distance / lengths[1].max(f64::MIN_POSITIVE)
    };
    let nearest: Vec<Option<(usize, f64)>> =
        own.par_iter().with_min_len(512).map(|place| neighbours.nearest(*place)).collect();
    let mut by_neighbour: Vec<Vec<(f64, usize)>> = vec![Vec::new(); there.len()];
    let mut found = Vec::new();
    for (i, nearest) in nearest.into_iter().enumerate() {
        match nearest {
            Some((neighbour, distance)) => by_neighbour[neighbour].push((relative(i, distance), i)),
            None => found.push((f64::INFINITY, i)),
        }
    }
    for mut covered in by_neighbour {
        covered.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        found.extend(covered.into_iter().enumerate().filter_map(|(rank, (distance, i))| {
            let is_far = distance > 2.0 * COVERING || rank >= COVERED && distance > COVERING;
            is_far.then_some((distance, i))
        }));
    }
    Ok(found)
}

/// The base unit of the corrected Gaussians, and those of the direct start behind them.
fn joined(earlier: &BaseUnit, kept: Vec<(usize, Corrected)>, direct: &BaseUnit, placed: &[usize]) -> BaseUnit {
    let order: Vec<usize> = kept.iter().map(|(i, _)| *i).collect();
    let mut gaussians = earlier.gaussians.rows(&order);
    let mut own = Vec::with_capacity(kept.len() + placed.len());
    for (row, (_, of)) in kept.into_iter().enumerate() {
        gaussians.position[row] = of.position;
        gaussians.rotation[row] = [of.rotation.w, of.rotation.x, of.rotation.y, of.rotation.z].map(|x| x as f32);
        gaussians.opacity_logit[row] = of.opacity_logit;
        if let Some(shading) = &mut gaussians.shading {
            shading.offset_color[row] = of.color;
            shading.normal[row] = of.normal;
            add_surfaceness(shading, row, of.surfaceness as f32);
        }
        own.push(of.source);
    }
    let mut more = direct.gaussians.rows(placed);
    own.extend(sources::stored(&more).unwrap_or_default());
    // Both have the same frame unless a distant box changed.
    let between = earlier.transform.inverse() * direct.transform;
    more.position.iter_mut().for_each(|p| *p = between.transform_point3(p.as_dvec3()).as_vec3());
    append(&mut gaussians, more, direct.palette - earlier.palette);
    sources::forget(&mut gaussians);
    sources::store(&own, &mut gaussians);
    BaseUnit { gaussians, file: None, values: direct.values, ..earlier.clone() }
}

/// Puts Gaussians behind others, with a change of their offset colours.
fn append(gaussians: &mut Gaussians, more: Gaussians, color: Vec3) {
    gaussians.position.extend(more.position);
    gaussians.rotation.extend(more.rotation);
    gaussians.log_scale.extend(more.log_scale);
    gaussians.opacity_logit.extend(more.opacity_logit);
    if let (Some(shading), Some(more)) = (&mut gaussians.shading, more.shading) {
        shading.offset_color.extend(more.offset_color.into_iter().map(|offset| offset + color));
        shading.normal.extend(more.normal);
        shading.ambient.extend(more.ambient);
        shading.diffuse.extend(more.diffuse);
        shading.specular.extend(more.specular);
        shading.shininess.extend(more.shininess);
    }
}
