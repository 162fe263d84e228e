//! Training of a direct start on pictures of its volume, with its options and its progress.

use std::ops::ControlFlow;
use std::time::Instant;

use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use sg_fit::training::{Measurement, TrainingError, TrainingOptions, TrainingReport, ViewOptions, train, volume_views};
use sg_input::print::status as print_line;
use sg_scene::model::Scene;
use sg_volume::{Classifier, ScalarFieldRef};

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

impl TrainingArgs {
    /// Trains a direct start in place. Lines of progress replace the bar if `lines` is set.
    pub(crate) fn run(
        &self,
        scene: &mut Scene,
        (field, classifier): (ScalarFieldRef<'_>, &Classifier),
        seed: u64,
        lines: bool,
    ) -> Result<TrainingReport, TrainingError> {
        let views = self.views as usize;
        let of_views = ViewOptions { views, held_out: views.div_ceil(8), size: self.view_size, seed };
        let display = Display::new(lines);
        let (training, held_out) = volume_views(field, classifier, &of_views, |done, of| display.views(done, of));
        let Steps(all, shading) = self.iterations.unwrap_or(Steps(MOST.1, 0));
        let defaults = TrainingOptions::default();
        let options = TrainingOptions {
            iterations: all + shading,
            shading_share: shading as f64 / (all + shading) as f64,
            seconds: self.iterations.is_none().then_some(self.seconds),
            target_psnr_db: self.target_psnr,
            ..defaults
        };
        let report = train(scene, &training, &held_out, &options, |found, _| {
            display.step(found, &options);
            ControlFlow::Continue(())
        });
        display.bar.finish_and_clear();
        report
    }
}

/// The progress on standard error: a bar on a terminal, or lines.
struct Display {
    bar: ProgressBar,
    lines: bool,
    clock: Instant,
}

impl Display {
    fn new(lines: bool) -> Self {
        let bar = ProgressBar::new(0);
        if let Ok(style) = ProgressStyle::with_template("{bar:30} {msg}") {
            bar.set_style(style);
        }
        Self { bar, lines, clock: Instant::now() }
    }

    fn views(&self, done: usize, of: usize) {
        self.show(done as u64, of as u64, "rendering the volume");
    }

    fn step(&self, found: &Measurement, options: &TrainingOptions) {
        let (done, of) = match options.seconds {
            Some(seconds) => ((found.seconds.min(seconds) * 10.0) as u64, (seconds * 10.0) as u64),
            None => (found.iteration as u64, options.iterations as u64),
        };
        let left = if done > 0 { found.seconds * (of.saturating_sub(done)) as f64 / done as f64 } else { f64::NAN };
        let left = if left.is_finite() { format!(", {left:.0} s left") } else { String::new() };
        self.show(
            done,
            of,
            &format!("training: {:.2} dB after {} steps{left}", found.footprint_psnr_db, found.iteration),
        );
    }

    fn show(&self, done: u64, of: u64, step: &str) {
        if self.lines {
            print_line(&format!("progress {done} {of} {step}"));
        } else {
            self.bar.set_length(of);
            self.bar.set_position(done);
            self.bar.set_message(format!("{step} ({:.0} s)", self.clock.elapsed().as_secs_f64()));
        }
    }
}
