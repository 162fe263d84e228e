//! How long the session is, and what happens in it.

use std::path::PathBuf;
use std::time::Duration;

/// A session to play.
#[derive(Debug, Clone, clap::Args)]
pub struct Options {
    /// Commands of the users, among them strokes and utterances
    #[arg(long, default_value_t = 200_000)]
    pub commands: u64,
    /// Pictures that the users ask for
    #[arg(long, default_value_t = 20_000)]
    pub captures: u64,
    /// Restarts of services: kills, requests, swaps and reloads in turn
    #[arg(long, default_value_t = 2000)]
    pub restarts: u64,
    /// Minutes over which all of it is spread
    #[arg(long, default_value_t = 60.0)]
    pub minutes: f64,
    /// Minutes after which the session ends at the latest; without it, twice as many as it is spread over
    #[arg(long)]
    pub at_most: Option<f64>,
    /// Gaussians of the scene; 0 for the small scene of 800
    #[arg(long, default_value_t = 8000)]
    pub gaussians: u32,
    /// Width and height of the pictures
    #[arg(long, default_value_t = 64)]
    pub pixels: u32,
    /// Users that work at the same time
    #[arg(long, default_value_t = 3)]
    pub users: u32,
    /// Services to restart, one after another for an equal share of the session each; without it, all of them
    #[arg(long, value_delimiter = ',')]
    pub services: Vec<String>,
    /// Milliseconds between two samples
    #[arg(long, default_value_t = 1000)]
    pub sample_ms: u64,
    /// Seed of everything that the users do
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Folder of the samples, the plot and the table
    #[arg(long, default_value = "soak")]
    pub out: PathBuf,
}

impl Options {
    /// Time over which the session is spread.
    #[must_use]
    pub fn length(&self) -> Duration {
        Duration::from_secs_f64(self.minutes.max(0.01) * 60.0)
    }

    /// Time after which the session ends at the latest.
    #[must_use]
    pub fn limit(&self) -> Duration {
        let minutes = self.at_most.unwrap_or(2.0 * self.minutes);
        Duration::from_secs_f64(minutes.max(0.01) * 60.0)
    }
}
