//! `cluster`: clusters a scene and writes the labels.

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use serde::Serialize;
use sg_clusters::clustering::{ClusteringOptions, ClusteringReport, FixedSeeds, Method, cluster};
use sg_clusters::geometry::Geometry;
use sg_formats::npy::{read_indices, write_labels};
use sg_input::number_format::grouped;
use sg_input::print::status;

use super::{Bar, Clustering, Failure, check_outputs, named, read_scene, write_report};

#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// A Gaussian file, a scene.toml, or an iVR-GS output folder.
    scene: PathBuf,
    /// The labels to write, int32 (n,).
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    #[command(flatten)]
    clustering: Clustering,
    /// Distance of the clustering.
    #[arg(long, default_value = "geodesic", value_parser = named::<Method>(&["geodesic", "euclidean-feature", "euclidean"]))]
    method: Method,
    /// Indices of the seed Gaussians, integers (c,), in place of a voxel grid.
    #[arg(long, value_name = "FILE", requires = "cell")]
    seeds: Option<PathBuf>,
    /// Spacing S of the seeds, in the scene's length unit.
    #[arg(long, allow_negative_numbers = true, value_name = "S", requires = "seeds")]
    cell: Option<f64>,
    /// Exact number of rounds of assignment. The default is up to ten.
    #[arg(long, value_name = "R")]
    rounds: Option<usize>,
    /// Keep small and unconnected pieces. Labels are then positions in the list of seeds.
    #[arg(long)]
    no_merge: bool,
    /// Smaller clusters on curved surfaces and at edges, larger ones elsewhere.
    #[arg(long, conflicts_with = "seeds")]
    adaptive: bool,
    /// JSON file for the report.
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Print the report to standard output.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Report<'a> {
    scene: &'a PathBuf,
    #[serde(flatten)]
    clustering: &'a ClusteringReport,
    read_seconds: f64,
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let geometry_options = arguments.clustering.geometry()?;
    let inputs = [Some(&arguments.scene), arguments.seeds.as_ref()];
    check_outputs(&[Some(&arguments.out), arguments.report.as_ref()], &inputs)?;
    let start = Instant::now();
    let scene = read_scene(&arguments.scene)?.scene;
    let read_seconds = start.elapsed().as_secs_f64();
    let seeds = match (&arguments.seeds, arguments.cell) {
        (Some(file), Some(cell)) => {
            let gaussians = read_indices(file, scene.len())?;
            Some(FixedSeeds { gaussians: gaussians.into_iter().map(|g| g as u32).collect(), cell })
        }
        _ => None,
    };
    let options = ClusteringOptions {
        seeds,
        rounds: arguments.rounds,
        merge: !arguments.no_merge,
        adaptive: arguments.adaptive,
        method: arguments.method,
        ..arguments.clustering.options()
    };
    let bar = Bar::new();
    let geometry = Geometry::of_scene(&scene, geometry_options, &bar).map_err(Failure::input)?;
    let made = cluster(&geometry, &options, &bar);
    bar.finish();
    let (clustering, report) = made?;
    write_labels(&arguments.out, &clustering.labels)?;
    status(&format!(
        "{} Gaussians in {} clusters of {:.0} on average ({} dropped), {:.2} s: {}",
        grouped(report.gaussians as u64),
        grouped(report.clusters as u64),
        report.mean_size,
        grouped(report.dropped as u64),
        report.seconds.get("total").copied().unwrap_or(0.0),
        arguments.out.display()
    ));
    let report = Report { scene: &arguments.scene, clustering: &report, read_seconds };
    write_report(&report, arguments.report.as_ref(), arguments.json)
}
