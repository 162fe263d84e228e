//! The offline subcommands: arguments and output.

mod cluster;
mod select;
mod solve;

use std::cell::Cell;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use serde::de::DeserializeOwned;
use sg_clusters::clustering::{ClusterError, ClusteringOptions, Level};
use sg_clusters::features::FeatureKind;
use sg_clusters::geometry::GeometryOptions;
use sg_clusters::progress::{Progress, Stage};
use sg_formats::npy::NpyError;
use sg_formats::{LoadOptions, Loaded, load, staged_file};
use sg_input::print;

/// Subcommands that work on files alone.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Divides a scene into Super-Gaussians.
    ///
    /// Writes the cluster of each Gaussian as int32 (n,): 0 to c−1, at most --max-clusters in each base unit. Gaussians without a
    /// finite position get −1.
    ///
    /// Example: supergaussian selection cluster bonsai/scene.toml --out labels.npy --report clusters.json
    Cluster(cluster::Arguments),
    /// Plays brush strokes on a scene and writes the selection.
    ///
    /// The mask is uint8 (n,), 1 for selected Gaussians. With --truth the report holds the agreement with a true mask.
    ///
    /// Example: supergaussian selection select bonsai/scene.toml --strokes strokes.json --out mask.npy --report select.json
    Select(select::Arguments),
    /// Solves one random walk on a given graph.
    ///
    /// The graph is `{"nodes":n,"edges":[[u,v,w],…],"foreground":[…],"background":[…],"leak":0}`. Duplicate edges add
    /// up. Self-loops and zero weights are ignored. A node in both lists is unseeded. The output has p, q, reached and
    /// selected, one entry per node. Numbers round-trip exactly.
    ///
    /// Example: supergaussian selection solve graph.json --out solution.json --solver gth
    Solve(solve::Arguments),
}

/// Runs a subcommand. Exit status: 0 for success, 1 for failed work, 2 for wrong arguments or input.
pub(crate) fn run(command: &Command) -> ExitCode {
    let outcome = match command {
        Command::Cluster(arguments) => cluster::run(arguments),
        Command::Select(arguments) => select::run(arguments),
        Command::Solve(arguments) => solve::run(arguments),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            print::status(&format!("error: {}", failure.message));
            ExitCode::from(failure.status)
        }
    }
}

/// A failed subcommand: exit status and message.
#[derive(Debug)]
struct Failure {
    status: u8,
    message: String,
}

#[allow(clippy::needless_pass_by_value, reason = "map_err hands its error over")]
impl Failure {
    /// The arguments or the input are wrong.
    fn input(message: impl ToString) -> Self {
        Self { status: 2, message: message.to_string() }
    }

    /// The work failed.
    fn work(message: impl ToString) -> Self {
        Self { status: 1, message: message.to_string() }
    }
}

impl From<NpyError> for Failure {
    fn from(error: NpyError) -> Self {
        match error {
            NpyError::Write { .. } => Self::work(error),
            _ => Self::input(error),
        }
    }
}

impl From<ClusterError> for Failure {
    fn from(error: ClusterError) -> Self {
        match error {
            ClusterError::Graph(_) => Self::work(error),
            _ => Self::input(error),
        }
    }
}

/// Parameters of the clustering.
#[derive(Debug, Args)]
struct Clustering {
    /// Most clusters of each base unit.
    #[arg(long, value_name = "N", default_value_t = 999)]
    max_clusters: usize,
    /// Nearest neighbours of each Gaussian in the graph.
    #[arg(long, value_name = "K", default_value_t = 10)]
    neighbours: usize,
    /// Weight m of features against distance in D = (d/S)² + m²·‖Δf‖².
    #[arg(long, allow_negative_numbers = true, value_name = "M", default_value_t = 0.5)]
    compactness: f64,
    /// Feature vector. The default is oriented for base units with oriented normals, else invariant.
    #[arg(long, value_parser = named::<FeatureKind>(&["oriented", "invariant", "printed"]))]
    features: Option<FeatureKind>,
    /// Accuracy of the assignment.
    #[arg(long, default_value = "exact", value_parser = named::<Level>(&["exact", "windowed", "fast"]))]
    level: Level,
}

impl Clustering {
    fn geometry(&self) -> Result<GeometryOptions, Failure> {
        if self.neighbours == 0 || self.neighbours > 1000 {
            return Err(Failure::input(format!("--neighbours is {}; it must be between 1 and 1000", self.neighbours)));
        }
        Ok(GeometryOptions { neighbours: self.neighbours, features: self.features })
    }

    fn options(&self) -> ClusteringOptions {
        ClusteringOptions {
            max_clusters: self.max_clusters,
            compactness: self.compactness,
            level: self.level,
            ..ClusteringOptions::default()
        }
    }
}

/// A parser for values by their names in files.
fn named<T: DeserializeOwned + Clone + Send + Sync + 'static>(
    names: &'static [&'static str],
) -> impl TypedValueParser<Value = T> {
    PossibleValuesParser::new(names.iter().copied())
        .try_map(|name| serde_json::from_value(serde_json::Value::String(name)))
}

fn read_scene(path: &Path) -> Result<Loaded, Failure> {
    let loaded = load(path, &LoadOptions::default()).map_err(Failure::input)?;
    for warning in &loaded.warnings {
        print::status(&format!("warning: {}: {warning}", path.display()));
    }
    Ok(loaded)
}

/// Writes a report to a file, to standard output, or to both.
fn write_report(report: &impl Serialize, file: Option<&PathBuf>, to_stdout: bool) -> Result<(), Failure> {
    let text = serde_json::to_string_pretty(report).map_err(Failure::work)? + "\n";
    if let Some(path) = file {
        write(path, text.as_bytes())?;
    }
    if to_stdout {
        print::result(&text).map_err(|e| Failure::work(format!("standard output: {e}")))?;
    }
    Ok(())
}

/// Refuses outputs that would replace foreign files or inputs, before the work starts.
fn check_outputs(outputs: &[Option<&PathBuf>], inputs: &[Option<&PathBuf>]) -> Result<(), Failure> {
    let outputs = outputs.iter().flatten().map(|p| p.as_path());
    staged_file::check_outputs(outputs, inputs.iter().flatten().map(|p| p.as_path())).map_err(Failure::input)
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    staged_file::replace(path, bytes)
        .map_err(|e| Failure::work(format!("{}: {e}; nothing was changed", path.display())))
}

/// A progress bar on standard error, hidden without a terminal.
struct Bar {
    bar: ProgressBar,
    stage: Cell<Option<Stage>>,
}

impl Bar {
    fn new() -> Self {
        let bar = ProgressBar::new(1000);
        if let Ok(style) = ProgressStyle::with_template("{msg:14} {bar:40} {percent:>3} %  {elapsed}") {
            bar.set_style(style);
        }
        Self { bar, stage: Cell::new(None) }
    }

    fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

impl Progress for Bar {
    fn at(&self, stage: Stage, fraction: f64) {
        if self.stage.replace(Some(stage)) != Some(stage) {
            self.bar.set_message(stage.name());
        }
        self.bar.set_position((1000.0 * fraction) as u64);
    }
}
