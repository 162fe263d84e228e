//! Training of editable Gaussians on pictures.
//!
//! The recipe is that of 3DGS (Kerbl et al. 2023) and iVR-GS (Tang et al. 2025) with three changes. It begins at the
//! [direct start](crate::direct) instead of random points, so geometry and shading are trained together. Colours, normals and
//! shading factors are those of the shading model itself, under several lights. Views of single base units keep what others hide.
//!
//! Each step draws one view with [`sg_raster::gradient`], takes the [`loss()`] and its derivatives, and moves all attributes by
//! Adam. Rates fall over the run. The scene with the best held-out pictures is the result, so no step makes it
//! worse than its start.

pub mod loss;
mod optimizer;
mod views;

use std::ops::ControlFlow;
use std::time::Instant;

use serde::Serialize;
use sg_raster::Limits;
use sg_raster::gradient::{GradientError, record};
use sg_raster::image_error::Difference;
use sg_raster::render::{Quality, RenderError, render};
use sg_scene::model::Scene;

use loss::{Channels, Loss, loss, similarity};
use optimizer::Optimizer;
pub use optimizer::Rates;
pub use views::{TrainingView, ViewOptions, volume_views};

/// Share of the first rates that is left at the end.
const FINAL_RATE: f64 = 0.02;

/// Options of a training.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrainingOptions {
    /// Most steps.
    pub iterations: usize,
    /// Most seconds, if limited. A run that ends by its time depends on the machine; one that ends by its steps does not.
    pub seconds: Option<f64>,
    /// Mean PSNR of the held-out pictures' footprints at which training ends, in dB.
    pub target_psnr_db: Option<f64>,
    /// Steps between two measurements of the held-out pictures.
    pub measure_every: usize,
    /// The loss.
    pub loss: Loss,
    /// Learning rates at the start.
    pub rates: Rates,
    /// Share of the run at its end, 0 to 1, in which places, shapes and opacities stay: the second stage of iVR-GS, which trains
    /// the shading alone.
    pub shading_share: f64,
}

impl Default for TrainingOptions {
    fn default() -> Self {
        Self {
            iterations: 2000,
            seconds: None,
            target_psnr_db: None,
            measure_every: 100,
            loss: Loss::default(),
            rates: Rates::default(),
            shading_share: 0.0,
        }
    }
}

/// Held-out pictures against their references.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Measurement {
    /// Steps so far.
    pub iteration: usize,
    /// Seconds so far.
    pub seconds: f64,
    /// Mean PSNR of the frames, dB.
    pub psnr_db: f64,
    /// Mean PSNR over the footprints, dB.
    pub footprint_psnr_db: f64,
    /// Least PSNR over the footprints, dB.
    pub least_footprint_psnr_db: f64,
    /// Mean SSIM of the frames.
    pub ssim: f64,
    /// Mean share of the pixels in footprints.
    pub coverage: f64,
}

/// The course of a training.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TrainingReport {
    /// Pictures trained on.
    pub views: usize,
    /// Pictures measured with.
    pub held_out: usize,
    /// Steps made.
    pub iterations: usize,
    /// Wall time of the steps and measurements.
    pub seconds: f64,
    /// The result's measurement.
    pub result: Measurement,
    /// All measurements, the start's first.
    pub measurements: Vec<Measurement>,
}

/// Pictures that cannot be trained on.
#[derive(Debug, thiserror::Error)]
pub enum TrainingError {
    /// A view is missing.
    #[error("there is no view to train on, or none to measure with; give at least one of each")]
    NoView,
    /// A reference of another size than its camera.
    #[error("view {index} has a camera of {camera:?} pixels and a picture of {picture:?}")]
    Size {
        /// Which view, from 0; those to measure with come after those to train on.
        index: usize,
        /// Pixels of the camera.
        camera: [u32; 2],
        /// Pixels of the picture.
        picture: [u32; 2],
    },
    /// A reference that is not finite.
    #[error("the picture of view {0} has a value that is not finite")]
    NotFinite(usize),
    /// The scene cannot be trained.
    #[error(transparent)]
    Gradient(#[from] GradientError),
    /// The scene cannot be drawn.
    #[error(transparent)]
    Render(#[from] RenderError),
}

/// Trains a scene in place. `progress` gets each measurement; [`ControlFlow::Break`] ends the run with the best scene so far.
///
/// # Errors
/// [`TrainingError`]. The scene is then as before.
pub fn train(
    scene: &mut Scene,
    views: &[TrainingView],
    held_out: &[TrainingView],
    options: &TrainingOptions,
    mut progress: impl FnMut(&Measurement, usize) -> ControlFlow<()>,
) -> Result<TrainingReport, TrainingError> {
    check_views(views, held_out)?;
    let clock = Instant::now();
    let measure = |scene: &Scene, iteration: usize| measure(scene, held_out, iteration, clock.elapsed().as_secs_f64());
    let mut optimizer = Optimizer::new(scene);
    let first = measure(scene, 0)?;
    let mut measurements = vec![first];
    let (mut best, mut best_scene) = (first, scene.clone());
    let mut trained = scene.clone();
    let mut iteration = 0;
    let mut goes_on = progress(&first, options.iterations).is_continue();
    while goes_on && iteration < options.iterations {
        let elapsed = clock.elapsed().as_secs_f64();
        if options.seconds.is_some_and(|most| elapsed >= most) {
            break;
        }
        // By the budget that ends first.
        let spent =
            options.seconds.map_or(0.0, |most| elapsed / most).max(iteration as f64 / options.iterations as f64);
        let at = iteration % views.len();
        let rates = options.rates.times(FINAL_RATE.powf(spent) as f32);
        let rates = if spent < 1.0 - options.shading_share { rates } else { rates.of_shading() };
        // Each view has all channels in turn.
        let channel = Channels::One((iteration + iteration / views.len()) % 3);
        step(&mut trained, &views[at], &mut optimizer, (options.loss, channel), &rates)?;
        iteration += 1;
        if iteration % options.measure_every.max(1) == 0 || iteration == options.iterations {
            let found = measure(&trained, iteration)?;
            measurements.push(found);
            if found.footprint_psnr_db > best.footprint_psnr_db {
                best = found;
                best_scene.clone_from(&trained);
            }
            goes_on = progress(&found, options.iterations).is_continue()
                && options.target_psnr_db.is_none_or(|target| best.footprint_psnr_db < target);
        }
    }
    let last = measurements.last().map_or(0, |last| last.iteration);
    if iteration > last {
        let found = measure(&trained, iteration)?;
        measurements.push(found);
        if found.footprint_psnr_db > best.footprint_psnr_db {
            best = found;
            best_scene.clone_from(&trained);
        }
    }
    *scene = best_scene;
    Ok(TrainingReport {
        views: views.len(),
        held_out: held_out.len(),
        iterations: iteration,
        seconds: clock.elapsed().as_secs_f64(),
        result: best,
        measurements,
    })
}

/// One step on one view.
fn step(
    scene: &mut Scene,
    view: &TrainingView,
    optimizer: &mut Optimizer,
    (weights, channels): (Loss, Channels),
    rates: &Rates,
) -> Result<(), TrainingError> {
    let appearance = view.appearance(scene);
    let recording = record(scene, &appearance, &view.camera, Limits::FAST)?;
    let width = view.reference.width as usize;
    let (_, slopes) = loss(recording.image.as_pixels(), view.reference.as_pixels(), width, weights, channels);
    let gradients = recording.gradients(&slopes)?;
    drop(recording);
    optimizer.step(scene, &gradients, rates);
    Ok(())
}

/// Measures a scene on views without a training.
///
/// # Errors
/// [`TrainingError`]: there is no view, one does not fit, or the scene cannot be drawn.
pub fn measured(scene: &Scene, views: &[TrainingView]) -> Result<Measurement, TrainingError> {
    check_views(views, views)?;
    measure(scene, views, 0, 0.0)
}

/// Draws the held-out views as a display does.
fn measure(
    scene: &Scene,
    views: &[TrainingView],
    iteration: usize,
    seconds: f64,
) -> Result<Measurement, TrainingError> {
    let mut sum = Measurement { iteration, seconds, least_footprint_psnr_db: f64::INFINITY, ..Measurement::default() };
    let share = 1.0 / views.len() as f64;
    for view in views {
        let picture = render(scene, &view.appearance(scene), &view.camera, Quality::Standard)?.image;
        // The sizes were checked.
        let Ok(difference) = Difference::between(&picture, &view.reference) else { continue };
        // Equal pictures have an infinite ratio; a mean needs a finite one.
        let finite = |decibels: f64| decibels.min(100.0);
        sum.psnr_db += share * finite(difference.psnr_db);
        sum.footprint_psnr_db += share * finite(difference.footprint_psnr_db);
        sum.least_footprint_psnr_db = sum.least_footprint_psnr_db.min(finite(difference.footprint_psnr_db));
        sum.ssim += share * similarity(picture.as_pixels(), view.reference.as_pixels(), picture.width as usize);
        let covered = view.reference.pixels().filter(|pixel| pixel[3] > 1.0 / 1024.0).count();
        sum.coverage += share * covered as f64 / (view.reference.rgba.len() / 4).max(1) as f64;
    }
    Ok(sum)
}

fn check_views(views: &[TrainingView], held_out: &[TrainingView]) -> Result<(), TrainingError> {
    if views.is_empty() || held_out.is_empty() {
        return Err(TrainingError::NoView);
    }
    for (index, view) in views.iter().chain(held_out).enumerate() {
        let (camera, picture) =
            ([view.camera.width, view.camera.height], [view.reference.width, view.reference.height]);
        if camera != picture {
            return Err(TrainingError::Size { index, camera, picture });
        }
        if !view.reference.rgba.iter().all(|value| value.is_finite()) {
            return Err(TrainingError::NotFinite(index));
        }
    }
    Ok(())
}
