//! Training of editable Gaussians on pictures.
//!
//! The recipe is that of 3DGS (Kerbl et al. 2023) and iVR-GS (Tang et al. 2025) with three changes. It begins at the
//! [direct start](crate::direct) instead of random points, so geometry and shading are trained together. Colours, normals and
//! shading factors are those of the shading model itself, under several lights. Views of single base units keep what others hide.
//!
//! Each step draws one view with [`sg_raster::gradient`], takes the [`loss()`] and its derivatives, and moves all attributes by
//! Adam. Rates fall over the run. The scene with the best held-out pictures is the result, so no step makes it
//! worse than its start.
//!
//! [`train`] makes all steps. [`Training`] makes one at a time, and its state between two steps can be kept as a
//! [`checkpoint`]. Nothing is random in a step and no Gaussian comes or goes, so a run that goes on from a checkpoint
//! ends with the scene of one that was never interrupted, if it is limited by its steps.

pub mod checkpoint;
pub mod loss;
mod optimizer;
mod views;

use std::io::{self, Write};
use std::ops::ControlFlow;
use std::time::Instant;

use serde::Serialize;
use sg_raster::Limits;
use sg_raster::gradient::{GradientError, record};
use sg_raster::image_error::Difference;
use sg_raster::render::{Quality, RenderError, render};
use sg_scene::model::Scene;

use checkpoint::{Checkpoint, CheckpointError, Origin};
use loss::{Channels, Loss, loss, similarity};
pub use optimizer::Rates;
use optimizer::{Numbers, Optimizer, write_numbers};
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
    /// The checkpoint is not of this training.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
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
    let mut training = Training::new(scene, views, held_out, options)?;
    let mut goes_on = progress(&training.best, options.iterations).is_continue();
    while goes_on && !training.is_over() {
        if let Some(found) = training.step()? {
            goes_on = progress(&found, options.iterations).is_continue();
        }
    }
    let (best, report) = training.finish()?;
    *scene = best;
    Ok(report)
}

/// A training between two of its steps.
pub struct Training<'a> {
    start: &'a Scene,
    views: &'a [TrainingView],
    held_out: &'a [TrainingView],
    options: TrainingOptions,
    trained: Scene,
    optimizer: Optimizer,
    /// Steps so far.
    iteration: usize,
    measurements: Vec<Measurement>,
    best: Measurement,
    /// The numbers of the best scene; `None` for the start.
    best_numbers: Option<Vec<Numbers>>,
    /// Seconds before the clock, of an interrupted run.
    earlier_seconds: f64,
    clock: Instant,
}

impl<'a> Training<'a> {
    /// A training before its first step, with its start measured.
    ///
    /// # Errors
    /// [`TrainingError`].
    pub fn new(
        start: &'a Scene,
        views: &'a [TrainingView],
        held_out: &'a [TrainingView],
        options: &TrainingOptions,
    ) -> Result<Self, TrainingError> {
        check_views(views, held_out)?;
        let clock = Instant::now();
        let optimizer = Optimizer::new(start);
        let best = measure(start, held_out, 0, clock.elapsed().as_secs_f64())?;
        Ok(Self {
            start,
            views,
            held_out,
            options: *options,
            trained: start.clone(),
            optimizer,
            iteration: 0,
            measurements: vec![best],
            best,
            best_numbers: None,
            earlier_seconds: 0.0,
            clock,
        })
    }

    /// A training that goes on from a checkpoint, with the start, views and options of the interrupted one.
    ///
    /// # Errors
    /// [`TrainingError`]: also if the checkpoint has another number of Gaussians, or more steps than the options.
    pub fn resumed(
        start: &'a Scene,
        views: &'a [TrainingView],
        held_out: &'a [TrainingView],
        options: &TrainingOptions,
        checkpoint: Checkpoint,
    ) -> Result<Self, TrainingError> {
        check_views(views, held_out)?;
        let Checkpoint { iteration, seconds, measurements, best, best_numbers, state } = checkpoint;
        if state.iter().chain(&best_numbers).any(|numbers| numbers.len() != start.len()) {
            return Err(CheckpointError::Start.into());
        }
        let step = u32::try_from(iteration).ok().filter(|_| iteration <= options.iterations);
        let step = step.ok_or(CheckpointError::Damaged("it has more steps than the training"))?;
        let optimizer = Optimizer::restored(start, step, &state);
        let mut trained = start.clone();
        // The first step turns the start's numbers to their normal form.
        if iteration > 0 {
            optimizer.write_to(&mut trained);
        }
        Ok(Self {
            start,
            views,
            held_out,
            options: *options,
            trained,
            optimizer,
            iteration,
            measurements,
            best,
            best_numbers,
            earlier_seconds: seconds,
            clock: Instant::now(),
        })
    }

    /// Whether the steps or the seconds are spent, or the target is reached.
    #[must_use]
    pub fn is_over(&self) -> bool {
        let options = &self.options;
        let has_reached = !options.target_psnr_db.is_none_or(|target| self.best.footprint_psnr_db < target);
        self.iteration >= options.iterations
            || options.seconds.is_some_and(|most| self.seconds() >= most)
            // The start alone is no training.
            || has_reached && self.measurements.len() > 1
    }

    /// Makes one step. Gives the measurement of the held-out pictures, if it was due.
    ///
    /// # Errors
    /// [`TrainingError`].
    pub fn step(&mut self) -> Result<Option<Measurement>, TrainingError> {
        let (options, iteration, elapsed) = (self.options, self.iteration, self.seconds());
        // By the budget that ends first.
        let spent =
            options.seconds.map_or(0.0, |most| elapsed / most).max(iteration as f64 / options.iterations as f64);
        let at = iteration % self.views.len();
        let rates = options.rates.times(FINAL_RATE.powf(spent) as f32);
        let rates = if spent < 1.0 - options.shading_share { rates } else { rates.of_shading() };
        // Each view has all channels in turn.
        let channel = Channels::One((iteration + iteration / self.views.len()) % 3);
        step(&mut self.trained, &self.views[at], &mut self.optimizer, (options.loss, channel), &rates)?;
        self.iteration += 1;
        let is_due =
            self.iteration.is_multiple_of(options.measure_every.max(1)) || self.iteration == options.iterations;
        if is_due { self.measure().map(Some) } else { Ok(None) }
    }

    /// Ends the training with the best scene so far.
    ///
    /// # Errors
    /// [`TrainingError`].
    pub fn finish(mut self) -> Result<(Scene, TrainingReport), TrainingError> {
        let last = self.measurements.last().map_or(0, |last| last.iteration);
        if self.iteration > last {
            self.measure()?;
        }
        let seconds = self.seconds();
        let scene = match self.best_numbers {
            Some(numbers) => {
                write_numbers(&mut self.trained, numbers.iter());
                self.trained
            }
            None => self.start.clone(),
        };
        let report = TrainingReport {
            views: self.views.len(),
            held_out: self.held_out.len(),
            iterations: self.iteration,
            seconds,
            result: self.best,
            measurements: self.measurements,
        };
        Ok((scene, report))
    }

    /// The newest measurement.
    #[must_use]
    pub fn measurement(&self) -> &Measurement {
        self.measurements.last().unwrap_or(&self.best)
    }

    /// Writes all that a later run needs to go on.
    ///
    /// # Errors
    /// The system's error.
    pub fn write_checkpoint(&self, to: impl Write, origin: &Origin) -> io::Result<()> {
        let moment = checkpoint::Moment {
            iteration: self.iteration,
            seconds: self.seconds(),
            measurements: &self.measurements,
            best: &self.best,
            best_numbers: self.best_numbers.as_deref(),
            optimizer: &self.optimizer,
        };
        checkpoint::write(to, &moment, origin)
    }

    /// Seconds so far, with those of interrupted runs.
    fn seconds(&self) -> f64 {
        self.earlier_seconds + self.clock.elapsed().as_secs_f64()
    }

    /// Measures the held-out pictures, and keeps the scene if it is the best.
    fn measure(&mut self) -> Result<Measurement, TrainingError> {
        let found = measure(&self.trained, self.held_out, self.iteration, self.seconds())?;
        self.measurements.push(found);
        if found.footprint_psnr_db > self.best.footprint_psnr_db {
            self.best = found;
            self.best_numbers = Some(self.optimizer.numbers().copied().collect());
        }
        Ok(found)
    }
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
