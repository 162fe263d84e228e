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
//! The same holds for a mesh, with samples of its tetrahedra in place of voxels.
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
use sg_reclassify::optical_depth::logit_of;
use sg_reclassify::sources;
use sg_scene::model::{BaseUnit, Gaussians, Scene, SceneBox, ShadingColumns};
use sg_volume::dvr::Material;
use sg_volume::{Bounds, ScalarFieldRef, TransferFunction};

use crate::label_units::LabelUnits;
use crate::labels::MAX_UNITS;
use crate::options::{DirectError, MAX_GAUSSIANS, Options};
use crate::placed::PlacedUnit;
use crate::report::{DirectStart, Report, Seconds, UnitReport};
use crate::shape::Splat;
use crate::{mesh, voxels};

/// Revision of the method. It changes whenever the same volume and options give another scene, so that scenes of an earlier
/// revision are not taken for the present one.
pub const REVISION: u32 = 5;
/// Distance from the world origin in volume diagonals. Beyond it the units' transform holds the centre of the volume, since
/// f32 positions would lose digits.
const DISTANT_DIAGONALS: f64 = 64.0;

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

/// Makes a scene from a volume or a mesh. Each stage calls `progress` at its start. Positions are in the world frame of the field.
///
/// # Errors
/// [`DirectError`]: nothing is visible, or the transfer function or an option is invalid.
pub fn direct_start<'a>(
    field: impl Into<ScalarFieldRef<'a>>,
    function: &TransferFunction,
    options: &Options,
    mut progress: impl FnMut(Progress),
) -> Result<DirectStart, DirectError> {
    start_of(field.into(), function, None, options, &mut progress)
}

/// A direct start with the base units of the transfer function, or with those of a label map of the same grid.
pub(crate) fn start_of(
    field: ScalarFieldRef<'_>,
    function: &TransferFunction,
    labels: Option<&LabelUnits>,
    options: &Options,
    progress: &mut dyn FnMut(Progress),
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
    let count = labels.map_or(classifier.unit_count(), |labels| labels.units().len());
    if count > MAX_UNITS {
        return Err(DirectError::TooManyUnits(count));
    }
    let of = 1 + 3 * count;
    let mut done = 0;
    let mut stage = |name: &'static str| {
        progress(Progress { stage: name, done, of });
        done += 1;
    };
    let placed = match field {
        ScalarFieldRef::Grid(field) => voxels::place_gaussians(field, &classifier, labels, options, &mut stage)?,
        ScalarFieldRef::Mesh(field) => mesh::place_gaussians(field, &classifier, options, &mut stage)?,
    };
    let importance: f64 = placed.units.iter().map(|unit| unit.importance).sum();
    let shift = distant_offset(field.bounds());
    let range = field.range();
    let mut units = Vec::with_capacity(count);
    let mut reports: Vec<UnitReport> = Vec::with_capacity(count);
    for (unit, PlacedUnit { splats, importance: own, visible }) in placed.units.iter().enumerate() {
        let label = labels.and_then(|labels| labels.units().get(unit));
        // A label of which nothing is visible needs no base unit.
        if label.is_some() && splats.is_empty() {
            continue;
        }
        let name = label.map_or_else(|| unit_name(function, unit), |label| label.name.clone());
        let palette = label.and_then(|label| label.color).unwrap_or_else(|| mean_color(splats));
        let report = UnitReport::new(&name, splats, placed.edge, own / importance, *visible, palette);
        reports.push(UnitReport { label: label.map(|label| label.label), ..report });
        units.push(BaseUnit { values: Some([range.low, range.high]), ..base_unit(name, splats, palette, shift) });
    }
    let bounds = field.bounds();
    let scene = Scene::compose(units, Some(SceneBox { min: bounds.min, max: bounds.max }));
    let report = Report {
        gaussians: scene.len(),
        budget: options.gaussians,
        seed: options.seed,
        voxels: field.elements(),
        visible_voxels: placed.visible,
        non_finite_voxels: range.non_finite,
        voxels_outside_base_units: placed.outside_ranges,
        importance_captured: reports.iter().map(|u| u.importance_captured * u.importance_share).sum(),
        units: reports,
        seconds: Seconds { total: total_clock.elapsed().as_secs_f64(), ..placed.seconds },
    };
    Ok(DirectStart { scene, report })
}

/// The offset for the units' transform: the centre of a distant volume, else 0.
fn distant_offset(bounds: Bounds) -> DVec3 {
    let middle = 0.5 * (bounds.min + bounds.max);
    if middle.length() > DISTANT_DIAGONALS * (bounds.max - bounds.min).length() { middle } else { DVec3::ZERO }
}

/// Name of a base unit of a transfer function.
pub(crate) fn unit_name(function: &TransferFunction, unit: usize) -> String {
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
