//! Time series: one scene for each step, each started from the one before.
//!
//! All steps have one transfer function, one range of values, the same base units and palette colours. A step can start in two ways.
//! The direct start knows nothing of the step before. The warm start takes its trained Gaussians:
//!
//! - They move with what is visible (optical flow).
//! - Their opacities, colours, normals and values change by what the volume changed around them.
//! - Those that show nothing go, and Gaussians of the direct start come where none of them is.
//!
//! The start with the better pictures is taken. A step with the values of the one before gets its scene.
//!
//! Each Gaussian knows the one of the step before that it continues, whichever start was taken. So [`carried`] brings masks from step
//! to step.

mod lineage;
mod motion;
mod samples;
mod warm;

use glam::{DVec3, Vec3};
use serde::Serialize;
use sg_reclassify::sources;
use sg_scene::model::{BaseUnit, Gaussians, Scene, SceneBox, ShadingColumns};
use sg_volume::averages::Averages;
use sg_volume::transfer::Units;
use sg_volume::{Classifier, ScalarField, ScalarFieldRef, TransferFunction, ValueRange};

use crate::direct::{Progress, direct_start, unit_name};
use crate::options::{DirectError, Options};
use crate::placement::PlacementError;
use crate::training::{TrainingError, TrainingView, measured};
use motion::Motion;
use samples::Voxels;
use warm::warm_start;

pub use lineage::carried;

/// Views by which the better start of a step is found, at most. They come in random order, so the first ones see all sides.
const COMPARED: usize = 8;

/// How a step started.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum StartKind {
    /// From its volume alone.
    Direct,
    /// From the trained scene of the step before.
    Warm,
    /// It has the values of the step before, and so its scene.
    Unchanged,
    /// Nothing of it is visible: a scene without Gaussians.
    Empty,
}

/// A step cannot start.
#[derive(Debug, thiserror::Error)]
pub enum SeriesError {
    /// The starts cannot be compared.
    #[error(transparent)]
    Training(#[from] TrainingError),
    /// The nearest-neighbour search could not be set up.
    #[error("the start from the step before failed: {0}")]
    Placement(#[from] PlacementError),
}

/// The start of a step.
#[derive(Debug, Clone, PartialEq)]
pub struct StepStart {
    /// The scene, to be trained.
    pub scene: Scene,
    /// How it came about.
    pub kind: StartKind,
    /// For each Gaussian the one of the step before that it continues, or −1.
    pub previous: Vec<i32>,
    /// Gaussians of the step before that stay, that went, and that came.
    pub kept: usize,
    /// See [`Self::kept`].
    pub removed: usize,
    /// See [`Self::kept`].
    pub placed: usize,
    /// Mean PSNR of the direct start and of the warm one over the footprints of the views, dB, if both were measured.
    pub decibels: Option<[f64; 2]>,
}

/// A series so far.
#[derive(Debug)]
pub struct Series {
    function: TransferFunction,
    classifier: Classifier,
    range: [f64; 2],
    options: Options,
    palettes: Vec<Vec3>,
    before: Option<Step>,
}

/// A finished step.
#[derive(Debug)]
struct Step {
    scene: Scene,
    field: ScalarField,
}

impl Series {
    /// A series under one transfer function, whose steps have values within `range` (raw). Fields of steps are those of
    /// [`ScalarField::with_range`] with the same range.
    ///
    /// # Errors
    /// [`DirectError`]: the transfer function is invalid.
    pub fn new(function: &TransferFunction, range: [f64; 2], options: Options) -> Result<Self, DirectError> {
        let [low, high] = range;
        let classifier = function.classifier(ValueRange { low, high, non_finite: 0 })?;
        let palettes = palettes(function, &classifier, range);
        Ok(Self { function: function.clone(), classifier, range, options, palettes, before: None })
    }

    /// The transfer function of all steps, for raw values.
    #[must_use]
    pub fn classifier(&self) -> &Classifier {
        &self.classifier
    }

    /// The direct start of a step, with the palette colours of the series; `None` if nothing is visible.
    ///
    /// # Errors
    /// [`DirectError`], except that nothing is visible.
    pub fn direct(
        &self,
        field: ScalarFieldRef<'_>,
        progress: impl FnMut(Progress),
    ) -> Result<Option<Scene>, DirectError> {
        match direct_start(field, &self.function, &self.options, progress) {
            Ok(start) => {
                let mut scene = start.scene;
                scene.units.iter_mut().zip(&self.palettes).for_each(|(unit, palette)| set_palette(unit, *palette));
                Ok(Some(scene))
            }
            Err(DirectError::NothingVisible { .. }) => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// The scene of the step before, if this one has the same values.
    #[must_use]
    pub fn unchanged(&self, field: ScalarFieldRef<'_>) -> Option<StepStart> {
        let before = self.before.as_ref().filter(|before| is_same(before.field.as_ref(), field))?;
        let count = before.scene.len();
        Some(StepStart {
            scene: before.scene.clone(),
            kind: if count > 0 { StartKind::Unchanged } else { StartKind::Empty },
            previous: (0..count as i32).collect(),
            kept: count,
            removed: 0,
            placed: 0,
            decibels: None,
        })
    }

    /// The start of a step in which nothing is visible: the base units of the series without Gaussians.
    #[must_use]
    pub fn empty(&self, field: ScalarFieldRef<'_>) -> StepStart {
        let units = self.palettes.iter().enumerate().map(|(k, palette)| {
            let mut gaussians =
                Gaussians { shading: Some(ShadingColumns::default()), antialiased: true, ..Gaussians::default() };
            sources::store(&[], &mut gaussians);
            BaseUnit {
                palette: *palette,
                oriented_normals: true,
                values: Some(self.range),
                ..BaseUnit::new(unit_name(&self.function, k), gaussians)
            }
        });
        let bounds = field.bounds();
        let scene = Scene::compose(units.collect(), Some(SceneBox { min: bounds.min, max: bounds.max }));
        StepStart {
            scene,
            kind: StartKind::Empty,
            previous: Vec::new(),
            kept: 0,
            removed: self.before.as_ref().map_or(0, |before| before.scene.len()),
            placed: 0,
            decibels: None,
        }
    }

    /// The better of the two starts of a step by these views of it. Without a step before, or without views, it is the direct one.
    ///
    /// # Errors
    /// [`SeriesError`]: the views do not fit.
    pub fn start(
        &self,
        direct: Scene,
        field: ScalarFieldRef<'_>,
        views: &[TrainingView],
    ) -> Result<StepStart, SeriesError> {
        let as_direct = |scene: Scene, previous: Vec<i32>, removed: usize| StepStart {
            kind: StartKind::Direct,
            kept: 0,
            removed,
            placed: scene.len(),
            previous,
            scene,
            decibels: None,
        };
        let fresh = |scene: Scene| {
            let previous = vec![-1; scene.len()];
            as_direct(scene, previous, 0)
        };
        let Some(before) = self.before.as_ref().filter(|before| !before.scene.is_empty()) else {
            return Ok(fresh(direct));
        };
        // A mesh without a finite size has no voxels, and its pictures no meaning.
        let (Ok(old), Ok(new)) = (Voxels::of(before.field.as_ref()), Voxels::of(field)) else {
            return Ok(fresh(direct));
        };
        let motion = Motion::between(old.field(), new.field(), &self.classifier);
        let moved = |place: DVec3| place + motion.at(place);
        if views.is_empty() {
            let previous = lineage::nearest_before(&direct, &before.scene, &moved)?;
            return Ok(as_direct(direct, previous, before.scene.len()));
        }
        let warm = warm_start(&before.scene, [&old, &new], &direct, &motion, &self.classifier, self.options.gaussians)?;
        let compared = views.get(..COMPARED).unwrap_or(views);
        let decibels = [decibels(&direct, compared)?, decibels(&warm.scene, compared)?];
        let mut start = if decibels[1] >= decibels[0] {
            let kept = warm.origins.iter().flatten().count();
            let nearest = lineage::nearest_before(&warm.scene, &before.scene, &moved)?;
            let own = |(own, nearest): (&Option<usize>, i32)| own.map_or(nearest, |own| own as i32);
            let previous = warm.origins.iter().zip(nearest).map(own).collect();
            let placed = warm.scene.len() - kept;
            StepStart {
                scene: warm.scene,
                kind: StartKind::Warm,
                previous,
                kept,
                removed: warm.removed,
                placed,
                decibels: None,
            }
        } else {
            let previous = lineage::nearest_before(&direct, &before.scene, &moved)?;
            as_direct(direct, previous, before.scene.len())
        };
        start.decibels = Some(decibels);
        Ok(start)
    }

    /// Makes a trained step the one before the next.
    pub fn finish(&mut self, scene: Scene, field: ScalarField) {
        self.before = Some(Step { scene, field });
    }
}

/// Mean PSNR of a scene over the footprints of views, dB.
fn decibels(scene: &Scene, views: &[TrainingView]) -> Result<f64, TrainingError> {
    if scene.is_empty() {
        return Ok(0.0);
    }
    Ok(measured(scene, views)?.footprint_psnr_db)
}

/// Whether two fields are the same values at the same places.
fn is_same(one: ScalarFieldRef<'_>, other: ScalarFieldRef<'_>) -> bool {
    let same =
        |a: &[f32], b: &[f32]| a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a == b || a.is_nan() && b.is_nan());
    match (one, other) {
        (ScalarFieldRef::Grid(a), ScalarFieldRef::Grid(b)) => {
            a.grid() == b.grid() && a.offset() == b.offset() && same(a.values(), b.values())
        }
        (ScalarFieldRef::Mesh(a), ScalarFieldRef::Mesh(b)) => {
            a.middle() == b.middle()
                && a.offset() == b.offset()
                && a.cells() == b.cells()
                && a.points() == b.points()
                && same(a.values(), b.values())
        }
        _ => false,
    }
}

/// The palette colour of each base unit: the mean of the function over its values, weighted by the opacity. It says nothing of single
/// steps, so all have the same.
fn palettes(function: &TransferFunction, classifier: &Classifier, [low, high]: [f64; 2]) -> Vec<Vec3> {
    let averages = Averages::new(classifier);
    let raw = |x: f64| match function.units {
        Units::Raw => x,
        Units::Normalized => low + x * (high - low),
    };
    let ranges: Vec<[f64; 2]> = match function.base_units.as_slice() {
        [] => vec![function.domain],
        units => units.iter().map(|unit| unit.range).collect(),
    };
    ranges.into_iter().map(|range| averages.over(raw(range[0]), raw(range[1])).color).collect()
}

/// Gives a base unit another palette colour, with the same colours.
fn set_palette(unit: &mut BaseUnit, palette: Vec3) {
    if let Some(shading) = &mut unit.gaussians.shading {
        shading.offset_color.iter_mut().for_each(|offset| *offset += unit.palette - palette);
    }
    unit.palette = palette;
}
