//! Training of a start on pictures of its volume, with its options.

use clap::Args;
use sg_fit::Options;
use sg_fit::training::checkpoint::Checkpoint;
use sg_fit::training::{
    Training, TrainingError, TrainingOptions, TrainingReport, TrainingView, ViewOptions, volume_views,
};
use sg_scene::model::Scene;
use sg_volume::{Classifier, ScalarFieldRef};

use crate::checkpoint_file::CheckpointFile;
use crate::progress::Display;
use crate::stop_signals::StopSignals;

/// Most views, steps and pixels along an edge of a view.
const MOST: (usize, usize, u32) = (4096, 1_000_000, 2048);

/// How long to train, and on what.
#[derive(Args)]
pub(crate) struct TrainingArgs {
    /// Seconds of training.
    #[arg(long, value_name = "S", default_value_t = 60.0, value_parser = seconds, conflicts_with = "initial_only")]
    seconds: f64,
    /// Steps of training in place of --seconds; with a second number, steps after those that train the shading alone. A seed
    /// then gives the same scene on every run.
    #[arg(long, value_name = "A[,B]", value_parser = steps, conflicts_with_all = ["seconds", "initial_only"])]
    iterations: Option<Steps>,
    /// Mean PSNR of held-out pictures in dB, over what the volume covers, at which training ends early.
    #[arg(long, value_name = "DB", value_parser = decibels, conflicts_with = "initial_only")]
    target_psnr: Option<f64>,
    /// Pictures of the volume to train on. One in eight more is held out for the measurement.
    #[arg(long, value_name = "N", default_value_t = 96, value_parser = clap::value_parser!(u64).range(8..=MOST.0 as u64), conflicts_with = "initial_only")]
    views: u64,
    /// Pixels along each edge of those pictures.
    #[arg(long, value_name = "PIXELS", default_value_t = 512, value_parser = clap::value_parser!(u32).range(32..=i64::from(MOST.2)), conflicts_with = "initial_only")]
    view_size: u32,
    /// Seconds between two checkpoints of a training, DIR/training.checkpoint; 0 for none but that of an interrupt. A series has no
    /// checkpoints.
    #[arg(long, value_name = "S", default_value_t = 60, value_parser = clap::value_parser!(u32).range(0..=86_400), conflicts_with = "initial_only")]
    pub(crate) checkpoint_every: u32,
    /// Go on from DIR/training.checkpoint, which an interrupted training has left. All else is as in its command.
    #[arg(long, conflicts_with_all = ["initial_only", "keep_in"])]
    pub(crate) resume: bool,
}

/// Steps that train everything, and steps after them that train the shading alone.
#[derive(Clone, Copy)]
struct Steps(usize, usize);

fn steps(text: &str) -> Result<Steps, String> {
    let mut numbers = text.split(',').map(|word| word.trim().parse::<usize>().ok());
    let found = match (numbers.next().flatten(), numbers.next(), numbers.next()) {
        (Some(all), None, _) => Some(Steps(all, 0)),
        (Some(all), Some(Some(shading)), None) => Some(Steps(all, shading)),
        _ => None,
    };
    let is_possible = |steps: &Steps| (1..=MOST.1).contains(&steps.0.saturating_add(steps.1));
    found.filter(is_possible).ok_or_else(|| format!("give one or two whole numbers, in sum 1 to {}", MOST.1))
}

fn seconds(text: &str) -> Result<f64, String> {
    let most = 604_800.0;
    text.parse().ok().filter(|&s| s > 0.0 && s <= most).ok_or_else(|| format!("give seconds above 0, at most {most}"))
}

fn decibels(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|&db| db > 0.0 && db <= 100.0)
        .ok_or_else(|| "give a number above 0, at most 100".to_owned())
}

/// Pictures to train on, and to measure with.
pub(crate) struct Views {
    pub(crate) training: Vec<TrainingView>,
    held_out: Vec<TrainingView>,
}

/// How much of a whole training a start needs.
#[derive(Clone, Copy)]
pub(crate) struct Plan {
    /// Share of the seconds or steps.
    pub(crate) share: f64,
    /// Share of the first rates.
    pub(crate) rates: f32,
}

impl Default for Plan {
    fn default() -> Self {
        Self { share: 1.0, rates: 1.0 }
    }
}

/// What stands beside a training.
pub(crate) struct Surroundings<'a> {
    pub(crate) display: &'a Display,
    pub(crate) signals: &'a StopSignals,
    /// The file that keeps its state, if there is one.
    pub(crate) file: Option<&'a mut CheckpointFile>,
    /// The state to go on from.
    pub(crate) checkpoint: Option<Checkpoint>,
}

/// A training that has ended.
pub(crate) struct Trained {
    pub(crate) report: TrainingReport,
    /// Whether a signal has ended it.
    pub(crate) is_stopped: bool,
    /// Whether its state at a signal is in the file.
    pub(crate) is_kept: bool,
}

impl TrainingArgs {
    /// The digest of all options that a training and its start depend on.
    pub(crate) fn digest(&self, start: &Options) -> [u8; 32] {
        // The texts name every option, so none is left out.
        let text = format!("{start:?} {:?} {:?}", self.view_options(start.seed), self.options(Plan::default()));
        *blake3::hash(text.as_bytes()).as_bytes()
    }

    fn view_options(&self, seed: u64) -> ViewOptions {
        let views = self.views as usize;
        ViewOptions { views, held_out: views.div_ceil(8), size: self.view_size, seed }
    }

    fn options(&self, plan: Plan) -> TrainingOptions {
        let Steps(all, shading) = self.iterations.unwrap_or(Steps(MOST.1, 0));
        let part = |steps: usize| ((steps as f64 * plan.share).ceil() as usize).max(1);
        let defaults = TrainingOptions::default();
        TrainingOptions {
            iterations: if self.iterations.is_some() { part(all + shading) } else { MOST.1 },
            shading_share: shading as f64 / (all + shading) as f64,
            seconds: self.iterations.is_none().then_some(self.seconds * plan.share),
            target_psnr_db: self.target_psnr,
            rates: defaults.rates.times(plan.rates),
            ..defaults
        }
    }

    /// Renders the views of a volume.
    pub(crate) fn views(
        &self,
        (field, classifier): (ScalarFieldRef<'_>, &Classifier),
        seed: u64,
        display: &Display,
    ) -> Views {
        let of_views = self.view_options(seed);
        let (training, held_out) = volume_views(field, classifier, &of_views, |done, of| display.views(done, of));
        Views { training, held_out }
    }

    /// Trains a start in place, until its end or a signal.
    pub(crate) fn train(
        &self,
        scene: &mut Scene,
        views: &Views,
        plan: Plan,
        around: Surroundings<'_>,
    ) -> Result<Trained, TrainingError> {
        let display = around.display;
        let trained = run(scene, views, &self.options(plan), around);
        display.finish();
        trained
    }
}

fn run(
    scene: &mut Scene,
    views: &Views,
    options: &TrainingOptions,
    around: Surroundings<'_>,
) -> Result<Trained, TrainingError> {
    let Surroundings { display, signals, mut file, checkpoint } = around;
    signals.set_training(true);
    let mut training = match checkpoint {
        Some(checkpoint) => Training::resumed(scene, &views.training, &views.held_out, options, checkpoint)?,
        None => Training::new(scene, &views.training, &views.held_out, options)?,
    };
    display.step(training.measurement(), options);
    while !training.is_over() && !signals.is_stopped() {
        if let Some(found) = training.step()? {
            display.step(&found, options);
        }
        if let Some(file) = &mut file {
            file.keep_if_due(&training);
        }
    }
    let is_stopped = !training.is_over();
    // Before the last measurement, which an uninterrupted run does not make here.
    let is_kept = is_stopped && file.is_some_and(|file| file.keep(&training));
    let (best, report) = training.finish()?;
    *scene = best;
    Ok(Trained { report, is_stopped, is_kept })
}
