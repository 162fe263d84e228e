//! The direct start: Gaussians from the volume itself, without training.
//!
//! The steps for each base unit of the transfer function:
//!
//! 1. Each voxel gets an importance: its visible opacity within its own unit, with more weight at boundaries. Units are
//!    also edited and shown alone, so other units do not hide it. What its own unit hides keeps a tenth: it is seen
//!    through a faded unit, and where a cut opens it.
//! 2. Systematic sampling spreads the centres over the importance. Relaxation moves them to centroids of Voronoi cells.
//! 3. Each cell becomes one Gaussian along the cell's principal axes. Boundary cells are flattened along the gradient.
//!
//! With an importance of what the transfer function hides, Gaussians also stand there, transparent. Every Gaussian keeps the values of
//! its cell ([`sg_reclassify::sources`]), so another function gives it another look.
//!
//! The optical depth of a Gaussian's footprint equals that of its cell under the transfer function. At a clear boundary it is
//! a fifth more, since a single layer is uneven. The colour is the mean of the cell. The normal points towards falling
//! values. The units are drawn with the compensating pixel filter ([`Gaussians::antialiased`]): by the plain one, Gaussians
//! near the size of a pixel would be too dense.

use std::time::Instant;

use glam::{DMat4, DVec3, Vec3};
use rayon::prelude::*;
use serde::Serialize;
use sg_reclassify::optical_depth::logit_of;
use sg_reclassify::sources;
use sg_scene::model::{BaseUnit, Gaussians, Scene, SceneBox, ShadingColumns};
use sg_volume::dvr::Material;
use sg_volume::transfer::Problem;
use sg_volume::{Field, Surfaceness, TransferFunction, background_values};

use crate::classification::{Classification, MAX_UNITS};
use crate::importance::candidates;
use crate::placement::{PlacementError, Points, place};
use crate::shape::{GaussianBuilder, Splat};

/// Revision of the method. It changes whenever the same volume and options give another scene, so that scenes of an earlier
/// revision are not taken for the present one.
pub const REVISION: u32 = 5;
/// Largest allowed number of Gaussians.
pub const MAX_GAUSSIANS: usize = 1 << 26;

/// Options of a direct start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Most Gaussians in all base units together.
    pub gaussians: usize,
    /// Seed of the placement. A seed gives the same scene on any number of threads.
    pub seed: u64,
    /// Thickness of Gaussians along the gradient at clear boundaries, relative to the thickness of their cell, above 0. The
    /// value 1 does not flatten.
    pub flattening: f64,
    /// Importance of what its own unit hides, relative to what is seen, 0 to 1. With 0 nothing is placed there.
    pub interior: f64,
    /// Importance of values that the transfer function hides, relative to what it shows, 0 to 1. With 0 nothing is placed there.
    /// Otherwise other functions can show them ([`sg_reclassify`]).
    pub hidden: f64,
    /// Rounds of relaxation after the sampling of the centres.
    pub relaxation_rounds: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self { gaussians: 100_000, seed: 0, flattening: 0.6, interior: 0.1, hidden: 0.0, relaxation_rounds: 1 }
    }
}

/// Standard deviation in voxels of the smoothing before gradients. Without it normals follow the noise of single voxels.
const GRADIENT_SMOOTHING: f32 = 1.0;
/// Importance of homogeneous values that another transfer function shows, relative to that of a clear boundary.
const HOMOGENEOUS: f32 = 0.3;
/// Distance from the world origin in volume diagonals. Beyond it the units' transform holds the centre of the volume, since
/// f32 positions would lose digits.
const DISTANT_DIAGONALS: f64 = 64.0;

/// A scene and the report of its creation.
#[derive(Debug, Clone, PartialEq)]
pub struct DirectStart {
    /// The scene; its box is the volume's.
    pub scene: Scene,
    /// Counts and times.
    pub report: Report,
}

/// Counts, quality measures and times of a direct start.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// Gaussians made.
    pub gaussians: usize,
    /// Largest requested number of Gaussians.
    pub budget: usize,
    /// Seed of the placement.
    pub seed: u64,
    /// Voxels of the volume.
    pub voxels: usize,
    /// Voxels with an opacity above 0.
    pub visible_voxels: usize,
    /// Voxels that are NaN or infinite (NaN counts as transparent).
    pub non_finite_voxels: usize,
    /// Visible voxels outside the ranges of all base units; they belong to the nearest unit.
    pub voxels_outside_base_units: usize,
    /// Share of the importance within two standard deviations of its Gaussian.
    pub importance_captured: f64,
    /// The base units, in order.
    pub units: Vec<UnitReport>,
    /// Wall time by stage.
    pub seconds: Seconds,
}

/// One base unit of a direct start.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct UnitReport {
    /// Its name.
    pub name: String,
    /// Gaussians made.
    pub gaussians: usize,
    /// Those that the transfer function hides.
    pub hidden: usize,
    /// Voxels with an opacity above 0.
    pub visible_voxels: usize,
    /// Its share of the importance of all units.
    pub importance_share: f64,
    /// Share of its importance within two standard deviations of its Gaussian.
    pub importance_captured: f64,
    /// Mean of shortest axis / middle axis.
    pub mean_flattening: f64,
    /// Mean surfaceness of the Gaussians: 0 homogeneous or noise, 1 a clear boundary.
    pub mean_surfaceness: f64,
    /// Median opacity.
    pub median_opacity: f64,
    /// Median standard deviation of the middle axis, in units of the smallest voxel spacing.
    pub median_scale_voxels: f64,
    /// Palette colour, RGB.
    pub palette: [f32; 3],
}

/// Wall time by stage, all units together.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Seconds {
    /// Transfer function on every voxel, and smoothing.
    pub classify: f64,
    /// Visibility and importance of the voxels.
    pub importance: f64,
    /// Sampling and relaxation of the centres.
    pub placement: f64,
    /// Axes, opacities, colours and normals.
    pub shape: f64,
    /// The whole direct start.
    pub total: f64,
}

/// Progress of a direct start.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// Name of the current stage.
    pub stage: &'static str,
    /// Finished stages.
    pub done: usize,
    /// Number of stages.
    pub of: usize,
}

/// A direct start is not possible.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DirectError {
    /// The transfer function is invalid.
    #[error("the transfer function's {0}")]
    TransferFunction(#[from] Problem),
    /// The transfer function has too many base units.
    #[error("the transfer function has {0} base units; at most {MAX_UNITS} are possible; join some")]
    TooManyUnits(usize),
    /// No voxel is visible.
    #[error(
        "nothing is visible: all {voxels} voxels (values {low} to {high}, {non_finite} not finite) have opacity 0 under the \
         transfer function; raise opacities within that range or check its `units`"
    )]
    NothingVisible {
        /// Voxels of the volume.
        voxels: usize,
        /// Least finite value.
        low: f64,
        /// Greatest finite value.
        high: f64,
        /// Voxels that are NaN or infinite.
        non_finite: usize,
    },
    /// The number of Gaussians is 0 or too large.
    #[error("{0} Gaussians; give a number from 1 to {MAX_GAUSSIANS}")]
    Budget(usize),
    /// The flattening is outside its range.
    #[error("flattening {0}; give a number above 0 and at most 1")]
    Flattening(f64),
    /// The importance of the interior is outside its range.
    #[error("an interior of {0}; give a number from 0 to 1")]
    Interior(f64),
    /// The importance of hidden values is outside its range.
    #[error("an importance of {0} for hidden values; give a number from 0 to 1")]
    Hidden(f64),
    /// The nearest-neighbour search could not be set up.
    #[error("the placement failed: {0}")]
    Placement(#[from] PlacementError),
}

/// Makes a scene from a volume. Each stage calls `progress` at its start. Positions are in the world frame of the field.
///
/// # Errors
/// [`DirectError`]: nothing is visible, or the transfer function or an option is invalid.
pub fn direct_start(
    field: &Field,
    function: &TransferFunction,
    options: &Options,
    mut progress: impl FnMut(Progress),
) -> Result<DirectStart, DirectError> {
    let total_clock = Instant::now();
    if options.gaussians == 0 || options.gaussians > MAX_GAUSSIANS {
        return Err(DirectError::Budget(options.gaussians));
    }
    if !(options.flattening > 0.0 && options.flattening <= 1.0) {
        return Err(DirectError::Flattening(options.flattening));
    }
    if !(0.0..=1.0).contains(&options.interior) {
        return Err(DirectError::Interior(options.interior));
    }
    if !(0.0..=1.0).contains(&options.hidden) {
        return Err(DirectError::Hidden(options.hidden));
    }
    let classifier = function.classifier(field.range())?;
    let count = classifier.unit_count();
    if count > MAX_UNITS {
        return Err(DirectError::TooManyUnits(count));
    }
    let of = 1 + 3 * count;
    let mut done = 0;
    let mut stage = |name: &'static str| {
        progress(Progress { stage: name, done, of });
        done += 1;
    };
    let mut seconds = Seconds::default();

    stage("classifying voxels");
    let clock = Instant::now();
    let smooth = field.smoothed(GRADIENT_SMOOTHING);
    let surfaceness = Surfaceness::new(field, &classifier);
    let emphasis = (options.hidden > 0.0).then(|| emphasis_of_values(field, &smooth, &surfaceness));
    let classification = Classification::new(field, &classifier, emphasis);
    let visible_voxels = classification.statistics.iter().map(|c| c.visible).sum();
    let range = field.range();
    if visible_voxels == 0 {
        return Err(DirectError::NothingVisible {
            voxels: field.values().len(),
            low: range.low,
            high: range.high,
            non_finite: range.non_finite,
        });
    }
    seconds.classify = clock.elapsed().as_secs_f64();

    let clock = Instant::now();
    let mut found = Vec::with_capacity(count);
    for unit in 0..count {
        stage("computing importance");
        found.push(
            classification
                .crop(unit)
                .map(|crop| candidates(&crop, field.grid(), options.interior as f32, options.hidden as f32)),
        );
    }
    seconds.importance = clock.elapsed().as_secs_f64();
    let totals: Vec<f64> = found.iter().map(|c| c.as_ref().map_or(0.0, |c| c.total)).collect();
    let importance: f64 = totals.iter().sum();
    let budgets = apportion(&totals, options.gaussians);

    let shift = distant_offset(field);
    let mut units = Vec::with_capacity(count);
    let mut reports = Vec::with_capacity(count);
    for (unit, (candidates, budget)) in found.into_iter().zip(budgets).enumerate() {
        stage("placing Gaussians");
        let clock = Instant::now();
        let mut splats: Vec<Splat> = Vec::new();
        if let Some(candidates) = candidates.filter(|_| budget > 0) {
            let points = Points::new(&candidates, &classification, budget);
            // A seed for each unit keeps the samples of two units apart.
            let seed = options.seed.wrapping_add((unit as u64) << 32);
            let cells = place(&candidates, &points, field, budget, options.relaxation_rounds, seed)?;
            seconds.placement += clock.elapsed().as_secs_f64();
            stage("shaping Gaussians");
            let clock = Instant::now();
            let builder = GaussianBuilder {
                classification: &classification,
                smooth: &smooth,
                surfaceness: &surfaceness,
                flattening: options.flattening,
                keeps_hidden: options.hidden > 0.0,
            };
            splats = (0..cells.len())
                .into_par_iter()
                .with_min_len(64)
                .filter_map(|i| builder.splat(cells.points(i), &points, &candidates.list))
                .collect();
            seconds.shape += clock.elapsed().as_secs_f64();
        } else {
            stage("shaping Gaussians");
        }
        let name = unit_name(function, unit);
        let palette = mean_color(&splats);
        reports.push(UnitReport::new(
            &name,
            &splats,
            field,
            totals[unit] / importance,
            classification.statistics[unit].visible,
            palette,
        ));
        units.push(BaseUnit { values: Some([range.low, range.high]), ..base_unit(name, &splats, palette, shift) });
    }
    let bounds = field.grid().bounds();
    let scene = Scene::compose(units, Some(SceneBox { min: bounds.min, max: bounds.max }));
    seconds.total = total_clock.elapsed().as_secs_f64();
    let report = Report {
        gaussians: scene.len(),
        budget: options.gaussians,
        seed: options.seed,
        voxels: field.values().len(),
        visible_voxels,
        non_finite_voxels: range.non_finite,
        voxels_outside_base_units: classification.statistics.iter().map(|c| c.outside_ranges).sum(),
        importance_captured: reports.iter().map(|u: &UnitReport| u.importance_captured * u.importance_share).sum(),
        units: reports,
        seconds,
    };
    Ok(DirectStart { scene, report })
}

/// Divides `n` in proportion to the totals (largest remainders). Each total above 0 gets at least one if `n` is large enough.
fn apportion(totals: &[f64], n: usize) -> Vec<usize> {
    let sum: f64 = totals.iter().sum();
    let wanted = totals.iter().filter(|&&t| t > 0.0).count();
    let least = usize::from(n >= wanted);
    let spare = n - least * wanted.min(n);
    let exact: Vec<f64> = totals.iter().map(|t| t / sum * spare as f64).collect();
    let mut shares: Vec<usize> =
        exact.iter().zip(totals).map(|(e, &t)| *e as usize + if t > 0.0 { least } else { 0 }).collect();
    let mut rest: Vec<usize> = (0..totals.len()).filter(|&i| totals[i] > 0.0).collect();
    rest.sort_by(|&i, &j| exact[j].fract().total_cmp(&exact[i].fract()).then(i.cmp(&j)));
    let missing = n.saturating_sub(shares.iter().sum());
    for &i in rest.iter().cycle().take(missing) {
        shares[i] += 1;
    }
    shares
}

/// Importance of each voxel where another transfer function shows its value, 0 to 1: boundaries count most, and the values of the
/// empty space around the subject do not count.
fn emphasis_of_values(field: &Field, smooth: &Field, surfaceness: &Surfaceness) -> Vec<f32> {
    let [low, high] = background_values(field).unwrap_or([f64::NAN; 2]);
    let emphasis = |i: usize| {
        let raw = field.raw(i);
        if !raw.is_finite() {
            return 0.0;
        }
        let at = field.grid().voxel(i);
        let boundary = surfaceness.at(raw, smooth.gradient_at(at.x, at.y, at.z).length());
        let inside = if low <= raw && raw <= high { 0.0 } else { HOMOGENEOUS };
        inside + (1.0 - HOMOGENEOUS) * boundary
    };
    (0..field.grid().len()).into_par_iter().with_min_len(1024).map(emphasis).collect()
}

/// The offset for the units' transform: the centre of a distant volume, else 0.
fn distant_offset(field: &Field) -> DVec3 {
    let bounds = field.grid().bounds();
    let middle = 0.5 * (bounds.min + bounds.max);
    if middle.length() > DISTANT_DIAGONALS * field.grid().diagonal() { middle } else { DVec3::ZERO }
}

fn unit_name(function: &TransferFunction, unit: usize) -> String {
    match function.base_units.get(unit) {
        Some(u) => u.name.clone(),
        None => function.variable.clone().filter(|v| !v.trim().is_empty()).unwrap_or_else(|| "volume".to_owned()),
    }
}

/// Mean colour of what is visible, weighted by importance; mid grey where nothing is.
fn mean_color(splats: &[Splat]) -> Vec3 {
    let visible = || splats.iter().filter(|s| s.opacity > 0.0);
    let weight: f64 = visible().map(|s| s.weight).sum();
    let sum: DVec3 = visible().map(|s| s.color.as_dvec3() * s.weight).sum();
    if weight > 0.0 { (sum / weight).as_vec3() } else { Vec3::splat(0.5) }
}

fn base_unit(name: String, splats: &[Splat], palette: Vec3, shift: DVec3) -> BaseUnit {
    let column = |f: fn(&Material) -> f32| -> Vec<f32> {
        splats.iter().map(|s| f(&Material::STANDARD.with_surfaceness(s.surfaceness))).collect()
    };
    let mut gaussians = Gaussians {
        position: splats.iter().map(|s| (s.position - shift).as_vec3()).collect(),
        rotation: splats
            .iter()
            .map(|s| [s.rotation.w, s.rotation.x, s.rotation.y, s.rotation.z].map(|x| x as f32))
            .collect(),
        log_scale: splats
            .iter()
            .map(|s| s.scale.to_array().map(f64::ln))
            .map(|s| DVec3::from_array(s).as_vec3())
            .collect(),
        opacity_logit: splats.iter().map(|s| logit_of(s.opacity)).collect(),
        shading: Some(ShadingColumns {
            offset_color: splats.iter().map(|s| s.color - palette).collect(),
            normal: splats.iter().map(|s| s.normal).collect(),
            ambient: column(|own| own.ambient),
            diffuse: column(|own| own.diffuse),
            specular: column(|own| own.specular),
            shininess: column(|own| own.shininess),
        }),
        harmonics: None,
        extra: Vec::new(),
        antialiased: true,
    };
    sources::store(&splats.iter().map(|s| s.source).collect::<Vec<_>>(), &mut gaussians);
    let transform = DMat4::from_translation(shift);
    BaseUnit { palette, transform, oriented_normals: true, ..BaseUnit::new(name, gaussians) }
}

impl UnitReport {
    fn new(name: &str, splats: &[Splat], field: &Field, share: f64, visible_voxels: usize, palette: Vec3) -> Self {
        let visible: Vec<&Splat> = splats.iter().filter(|s| s.opacity > 0.0).collect();
        let n = visible.len().max(1) as f64;
        let mean = |f: &dyn Fn(&Splat) -> f64| visible.iter().map(|s| f(s)).sum::<f64>() / n;
        let median = |f: &dyn Fn(&Splat) -> f64| {
            let mut values: Vec<f64> = visible.iter().map(|s| f(s)).collect();
            values.sort_by(f64::total_cmp);
            values.get(values.len() / 2).copied().unwrap_or(0.0)
        };
        let weight: f64 = splats.iter().map(|s| s.weight).sum();
        let captured: f64 = splats.iter().map(|s| s.captured * s.weight).sum();
        Self {
            name: name.to_owned(),
            gaussians: splats.len(),
            hidden: splats.len() - visible.len(),
            visible_voxels,
            importance_share: share,
            importance_captured: if weight > 0.0 { captured / weight } else { 0.0 },
            mean_flattening: mean(&|s| s.scale.z / s.scale.y),
            mean_surfaceness: mean(&|s| f64::from(s.surfaceness)),
            median_opacity: median(&|s| s.opacity),
            median_scale_voxels: median(&|s| s.scale.y) / field.grid().spacing().min_element(),
            palette: palette.to_array(),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn shares_sum_to_the_budget(totals in prop::collection::vec(prop_oneof![Just(0.0), 1e-6..1e6_f64], 1..6), n in 1..500_usize) {
            prop_assume!(totals.iter().any(|&t| t > 0.0));
            let shares = apportion(&totals, n);
            prop_assert_eq!(shares.iter().sum::<usize>(), n);
            let wanted = totals.iter().filter(|&&t| t > 0.0).count();
            for (s, t) in shares.iter().zip(&totals) {
                prop_assert!(*t > 0.0 || *s == 0);
                prop_assert!(*t == 0.0 || n < wanted || *s > 0);
            }
        }
    }
}
