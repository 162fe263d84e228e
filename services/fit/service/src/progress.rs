//! The progress of a fit on standard error: a bar on a terminal, or lines.

use std::time::Instant;

use indicatif::{ProgressBar, ProgressStyle};
use sg_fit::Progress;
use sg_fit::training::{Measurement, TrainingOptions};
use sg_input::print::status as print_line;

/// A bar, or lines `progress DONE OF STEP`.
pub(crate) struct Display {
    bar: ProgressBar,
    lines: bool,
    clock: Instant,
    /// What stands before each message, such as the step of a series.
    prefix: String,
}

impl Display {
    pub(crate) fn new(lines: bool) -> Self {
        Self::of_part(lines, String::new())
    }

    /// A display of one part of the work, which this text names.
    pub(crate) fn of_part(lines: bool, prefix: String) -> Self {
        let bar = ProgressBar::new(0);
        if let Ok(style) = ProgressStyle::with_template("{bar:30} {msg}") {
            bar.set_style(style);
        }
        Self { bar, lines, clock: Instant::now(), prefix }
    }

    /// A stage of a direct start.
    pub(crate) fn stage(&self, p: Progress) {
        self.show(p.done as u64, p.of as u64, p.stage);
    }

    pub(crate) fn views(&self, done: usize, of: usize) {
        self.show(done as u64, of as u64, "rendering the volume");
    }

    pub(crate) fn step(&self, found: &Measurement, options: &TrainingOptions) {
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

    pub(crate) fn show(&self, done: u64, of: u64, step: &str) {
        let prefix = &self.prefix;
        if self.lines {
            print_line(&format!("progress {done} {of} {prefix}{step}"));
        } else {
            self.bar.set_length(of);
            self.bar.set_position(done);
            self.bar.set_message(format!("{prefix}{step} ({:.0} s)", self.clock.elapsed().as_secs_f64()));
        }
    }

    /// Takes the bar away.
    pub(crate) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}
