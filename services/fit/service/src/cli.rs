//! The command: conversion of a volume to a scene folder, and the synthetic volume.

use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use clap::{Args, Parser, Subcommand};
use glam::DVec3;
use indicatif::{ProgressBar, ProgressStyle};
use sg_fit::labels::{label_scores, labels_of};
use sg_fit::{DirectStart, MAX_GAUSSIANS, Options, Progress, direct_start, orientation_of};
use sg_formats::load::{LoadOptions, load};
use sg_formats::{check_scene_target, staged_file};
use sg_input::number_format::grouped;
use sg_input::print::status as print_line;
use sg_input::{file, limits, print};
use sg_reclassify::sources;
use sg_scene::model::Scene;
use sg_volume::suggestion::{MOST_UNITS, suggest_base_units};
use sg_volume::{
    Limits, ReadOptions, ScalarField, ScalarFieldRef, TransferFunction, formats_help, lacks_spacing, read_dataset,
    read_spaced_volume,
};

use crate::failure::{Failure, input, work};
use crate::kept_scenes::{self, KeptScene, KeptScenes};
use crate::output::{make_folder, write, write_truth};
use crate::own_rights::{Files, MadeFolders, keep_only};
use crate::phantom;
use crate::report::{FitReport, MeshReport, note_left_out, suggestion_line, training_line};
use crate::training_run::TrainingArgs;

const EXAMPLE: &str = "Examples:
  supergaussian fit bonsai_256x256x256_uint8.raw.zst --transfer-function bonsai.tf.json --gaussians 20000 --out bonsai
  supergaussian fit bonsai_256x256x256_uint8.raw.zst --transfer-function bonsai.tf.json --initial-only --out bonsai
  supergaussian fit bonsai_256x256x256_uint8.raw.zst --suggest-units --initial-only --out bonsai";

/// Converts a volume to an editable scene of Gaussians: `DIR/scene.toml` and one PLY file per base unit.
#[derive(Parser)]
#[command(
    name = "supergaussian-fit",
    version,
    args_conflicts_with_subcommands = true,
    subcommand_negates_reqs = true,
    after_help = EXAMPLE
)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    fit: FitArgs,
    /// Machine-readable report on standard output.
    #[arg(long, global = true)]
    json: bool,
}

#[derive(Args)]
struct FitArgs {
    #[arg(required = true, help = volume_help())]
    volume: Option<PathBuf>,
    /// Transfer function. Default: an automatic one from the histogram.
    #[arg(long, value_name = "TF.json")]
    transfer_function: Option<PathBuf>,
    /// Suggest base units, at most N: clusters of the volume's values and gradients. The transfer function with them is beside the
    /// scene, to be edited.
    #[arg(
        long,
        value_name = "N",
        num_args = 0..=1,
        default_missing_value = "6",
        value_parser = clap::value_parser!(u8).range(1..=MOST_UNITS as i64),
        conflicts_with_all = ["transfer_function", "start"]
    )]
    suggest_units: Option<u8>,
    /// Folder for scene.toml, the PLY files and the transfer function. The command creates it.
    #[arg(long, value_name = "DIR", required_unless_present = "keep_in")]
    out: Option<PathBuf>,
    /// Folder of kept scenes, in place of --out. A volume with the same options is not fitted again; the report names the
    /// scene.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["out", "labels", "report"])]
    keep_in: Option<PathBuf>,
    /// Place Gaussians directly from the volume, without training.
    #[arg(long)]
    initial_only: bool,
    /// Scene of the same volume to train further, in place of a direct start: the `scene.toml` of an earlier run, or of the step
    /// before in a series.
    #[arg(long, value_name = "scene.toml", conflicts_with_all = ["initial_only", "gaussians", "flattening", "interior", "hidden"])]
    start: Option<PathBuf>,
    #[command(flatten)]
    training: TrainingArgs,
    /// Write each step as a line `progress DONE OF STEP` to standard error.
    #[arg(long, hide = true)]
    progress_lines: bool,
    /// Largest number of Gaussians in all base units.
    #[arg(long, value_name = "N", default_value_t = Options::default().gaussians, value_parser = gaussians)]
    gaussians: usize,
    /// Seed of the placement. A seed gives the same scene on any number of threads.
    #[arg(long, value_name = "K", default_value_t = 0)]
    seed: u64,
    /// Thickness of Gaussians along the gradient at clear boundaries, relative to their cell. 1 does not flatten.
    #[arg(long, value_name = "F", default_value_t = Options::default().flattening, value_parser = flattening)]
    flattening: f64,
    /// Importance of what its own base unit hides, relative to what is seen. Fading and cuts show it. With 0 nothing is placed
    /// there.
    #[arg(long, value_name = "S", default_value_t = Options::default().interior, value_parser = importance)]
    interior: f64,
    /// Importance of values that the transfer function hides, relative to what it shows. Other transfer functions can show them
    /// then. With 0 nothing is placed there.
    #[arg(long, value_name = "S", default_value_t = Options::default().hidden, value_parser = importance)]
    hidden: f64,
    /// Millimetres between voxels along x, y and z, for raw volumes: they store none. Label volumes get the same.
    #[arg(long, value_name = "X,Y,Z", value_parser = spacing)]
    spacing: Option<DVec3>,
    /// Quantity to take, of a file that holds several. NAME:K is component K of a vector; NAME alone is its length. Default: that of the
    /// transfer function, or the first one.
    #[arg(long, value_name = "NAME")]
    variable: Option<String>,
    /// JSON file for the report.
    #[arg(long, value_name = "R.json")]
    report: Option<PathBuf>,
    /// Label volume of the same place. --out-truth gets the label at each Gaussian's centre, and the report the scores of suggested
    /// base units against the labels.
    #[arg(long, value_name = "LABELVOLUME")]
    labels: Option<PathBuf>,
    /// File for the labels of the Gaussians in scene order: int32 (n,), or uint8 0/1 with --truth-value.
    #[arg(long, value_name = "labels.npy", requires = "labels")]
    out_truth: Option<PathBuf>,
    /// Write 1 for the label K and 0 for other labels.
    #[arg(long, value_name = "K", requires = "labels", allow_negative_numbers = true)]
    truth_value: Option<i32>,
    /// Keep all rights of this user. Without this, the command can read and write its own files only, where the kernel has
    /// Landlock; a NRRD header can name data in its own folder only.
    #[arg(long)]
    unconfined: bool,
}

#[derive(Subcommand)]
enum Command {
    /// Make a synthetic volume with exact ground truth: a vessel tree with an aneurysm.
    #[command(after_help = "Example:\n  supergaussian fit phantom --out phantom --size 128")]
    Phantom {
        /// Folder for the volume, its labels, its transfer function and truth.json. The command creates it.
        #[arg(long, value_name = "DIR")]
        out: PathBuf,
        /// Voxels along each edge.
        #[arg(long, value_name = "N", default_value_t = 128, value_parser = clap::value_parser!(u16).range(8..=1024))]
        size: u16,
        /// Seed of the noise.
        #[arg(long, value_name = "K", default_value_t = 0)]
        seed: u64,
    },
}

fn volume_help() -> String {
    format!("The volume. Formats: {}", formats_help())
}

fn gaussians(text: &str) -> Result<usize, String> {
    text.parse()
        .ok()
        .filter(|n| (1..=MAX_GAUSSIANS).contains(n))
        .ok_or_else(|| format!("give a whole number from 1 to {MAX_GAUSSIANS}"))
}

fn flattening(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|&f| f > 0.0 && f <= 1.0).ok_or_else(|| "give a number above 0 and at most 1".to_owned())
}

fn importance(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|s| (0.0..=1.0).contains(s)).ok_or_else(|| "give a number from 0 to 1".to_owned())
}

fn spacing(text: &str) -> Result<DVec3, String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|word| word.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x, y, z]) if [x, y, z].iter().all(|&s| s > 0.0 && s.is_finite()) => Ok(DVec3::new(x, y, z)),
        _ => Err("give three lengths above 0, such as 0.5,0.5,1.25".to_owned()),
    }
}

/// Runs the command with the arguments of this process.
pub(crate) fn run() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        // Words of the command line can be names of files.
        Err(error) if error.use_stderr() => {
            print::status_lines(&error.to_string());
            return ExitCode::from(2);
        }
        Err(help) => help.exit(),
    };
    let result = match cli.command {
        Some(Command::Phantom { out, size, seed }) => phantom::make(&out, usize::from(size), seed, cli.json),
        None => fit(&cli.fit, cli.json),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            print_line(&format!("error: {}", failure.message));
            ExitCode::from(failure.status)
        }
    }
}

fn fit(args: &FitArgs, json: bool) -> Result<(), Failure> {
    let (Some(path), Some(place)) = (&args.volume, args.out.as_ref().or(args.keep_in.as_ref())) else {
        return Err(input("a volume and --out DIR are required; see --help"));
    };
    if args.keep_in.is_some() && !args.initial_only {
        return Err(input("--keep-in keeps direct starts; add --initial-only, or give --out for a training"));
    }
    if args.labels.is_some() && args.out_truth.is_none() && args.suggest_units.is_none() {
        return Err(input("--labels is for --out-truth FILE, or for --suggest-units; add one"));
    }
    let clock = Instant::now();
    let _made = if args.unconfined { MadeFolders::default() } else { confine(args, path, place)? };
    let given = match &args.transfer_function {
        Some(file) => {
            let loaded = TransferFunction::load(file).map_err(input)?;
            loaded.notes(file).for_each(|note| print_line(&note));
            Some(loaded.function)
        }
        None => None,
    };
    let options = ReadOptions {
        spacing: args.spacing,
        variable: args.variable.clone(),
        preferred: given.as_ref().and_then(|function| function.variable.clone()),
        limits: Limits::default(),
    };
    let volume = read_dataset(path, &options).map_err(input)?;
    let read_labels = |labels: &Path| {
        let spacing = args.spacing.filter(|_| lacks_spacing(labels));
        read_spaced_volume(labels, spacing, Limits::default()).map_err(input)
    };
    let labels = args.labels.as_deref().map(read_labels).transpose()?;
    let orientation = orientation_of(volume.frame());
    let own_field = volume.to_field();
    let field = own_field.as_ref();
    let read_seconds = clock.elapsed().as_secs_f64();
    note_left_out(path, &volume);
    let suggested = match args.suggest_units {
        Some(most) => {
            let ScalarField::Grid(voxels) = &own_field else {
                return Err(input(format!(
                    "{}: --suggest-units is for voxels, and this is a mesh; give a transfer function with base_units",
                    path.display()
                )));
            };
            let suggested = suggest_base_units(voxels, usize::from(most), volume.variable());
            Some(suggested.map_err(|e| input(format!("{}: {e}", path.display())))?)
        }
        None => None,
    };
    let function = match (given, &suggested) {
        (_, Some(suggested)) => suggested.function.clone(),
        (Some(given), None) => given,
        (None, None) => field
            .automatic_transfer_function(volume.variable())
            .map_err(|e| input(format!("{}: {e}", path.display())))?,
    };
    for unit in suggested.iter().flat_map(|suggested| &suggested.units) {
        print_line(&suggestion_line(unit));
    }
    let options = Options {
        gaussians: args.gaussians,
        seed: args.seed,
        flattening: args.flattening,
        interior: args.interior,
        hidden: args.hidden,
        ..Options::default()
    };
    let keeping = match &args.keep_in {
        Some(folder) => {
            let kept = KeptScenes::new(folder).map_err(|e| work(format!("{}: {e}", folder.display())))?;
            let key = kept_scenes::key(field, orientation, &function, &options).map_err(work)?;
            if let Some(scene) = kept.find(&key) {
                return report_kept(path, &scene, json);
            }
            Some((kept, key))
        }
        None => None,
    };
    check_outputs(args)?;
    let (mut scene, direct) = match &args.start {
        Some(start) => (earlier_scene(start, &function)?, None),
        None => {
            let start = start_directly(args, path, field, &function, &options)?;
            (start.scene, Some(start.report))
        }
    };
    scene.orientation = orientation;
    let classifier = function.classifier(field.range()).map_err(|e| input(format!("{}: {e}", path.display())))?;
    let trained = if args.initial_only {
        None
    } else {
        let start = scene.clone();
        let report = args.training.run(&mut scene, (field, &classifier), args.seed, args.progress_lines);
        let report = report.map_err(|e| work(format!("{}: {e}", path.display())))?;
        sources::follow_training(&mut scene, &start, &classifier);
        Some(report)
    };
    let scores = match (&labels, &own_field) {
        (Some(labels), ScalarField::Grid(voxels)) if suggested.is_some() => label_scores(voxels, &classifier, labels),
        _ => None,
    };
    // Labels come before any output, so a wrong label volume leaves no partial result.
    let truth = labels
        .filter(|_| args.out_truth.is_some())
        .map(|l| labels_of(&scene, &l))
        .transpose()
        .map_err(|e| input(format!("{}: {e}", args.labels.as_deref().unwrap_or(path).display())))?;

    let clock = Instant::now();
    let given = args.transfer_function.as_deref();
    let (scene_file, mut files) = match &keeping {
        None => (place.join("scene.toml"), write_scene(place, &mut scene, given, &function)?),
        Some((kept, key)) => {
            let fail = |e: io::Error| work(format!("{}: {e}; give a writable folder", place.display()));
            let staged = kept.stage(path).map_err(fail)?;
            let written = write_scene(&staged.folder, &mut scene, given, &function)?;
            let scene_file = kept.keep(staged, key).map_err(fail)?;
            let beside = |file: &PathBuf| file.file_name().map(|name| scene_file.with_file_name(name));
            let files = written.iter().filter_map(beside).collect();
            (scene_file, files)
        }
    };
    if let (Some(truth), Some(file)) = (truth, &args.out_truth) {
        write_truth(file, &truth, args.truth_value)?;
        files.push(file.clone());
    }
    let report = FitReport {
        volume: path,
        scene: &scene_file,
        dims: match &own_field {
            ScalarField::Grid(voxels) => Some(voxels.grid().dims()),
            ScalarField::Mesh(_) => None,
        },
        mesh: MeshReport::of(&volume),
        variable: volume.variable(),
        scalar_type: volume.scalar_type().name(),
        transfer_function: args.transfer_function.as_deref(),
        files,
        read_seconds,
        write_seconds: clock.elapsed().as_secs_f64(),
        suggested: suggested.as_ref().map(|suggested| suggested.units.as_slice()),
        label_scores: scores.as_deref(),
        direct: direct.as_ref(),
        training: trained.as_ref(),
    };
    let text = serde_json::to_string_pretty(&report).map_err(work)? + "\n";
    if let Some(file) = &args.report {
        write(file, text.as_bytes())?;
    }
    if json {
        print::result(&text).map_err(work)?;
    } else {
        let units = scene.units.len();
        let made = direct.map_or_else(String::new, |direct| format!(" in {:.1} s", direct.seconds.total));
        print_line(&format!(
            "{}: {} Gaussians in {units} base unit{}{made}",
            scene_file.display(),
            grouped(scene.len() as u64),
            if units == 1 { "" } else { "s" },
        ));
        if let Some(trained) = &trained {
            print_line(&training_line(trained));
        }
    }
    Ok(())
}

/// The direct start, with its progress and its notes.
fn start_directly(
    args: &FitArgs,
    path: &Path,
    field: ScalarFieldRef<'_>,
    function: &TransferFunction,
    options: &Options,
) -> Result<DirectStart, Failure> {
    let bar = progress_bar();
    let result = direct_start(field, function, options, |p| {
        if args.progress_lines {
            print_line(&format!("progress {} {} {}", p.done, p.of, p.stage));
        } else {
            show(&bar, p);
        }
    });
    bar.finish_and_clear();
    let start = result.map_err(|e| input(format!("{}: {e}", path.display())))?;
    for unit in start.report.units.iter().filter(|u| u.gaussians == 0) {
        print_line(&format!("note: base unit `{}` has nothing visible; its file contains no Gaussian", unit.name));
    }
    let outside = start.report.voxels_outside_base_units;
    if outside > 0 {
        print_line(&format!(
            "note: {outside} visible {} are outside the ranges of all base units; they went to the nearest unit",
            field.elements_name()
        ));
    }
    Ok(start)
}

/// The scene of an earlier run, for further training under a transfer function.
fn earlier_scene(file: &Path, function: &TransferFunction) -> Result<Scene, Failure> {
    let scene = load(file, &LoadOptions::default()).map_err(input)?.scene;
    let (found, expected) = (scene.units.len(), function.base_units.len().max(1));
    let named = scene.units.iter().zip(&function.base_units).find(|(unit, range)| unit.name != range.name);
    let problem = match named {
        _ if found != expected => {
            let plural = if found == 1 { "" } else { "s" };
            format!("{found} base unit{plural}, but the transfer function has {expected}")
        }
        Some((unit, range)) => {
            format!("base unit `{}` in the place of `{}` of the transfer function", unit.name, range.name)
        }
        None => return Ok(scene),
    };
    Err(input(format!("{}: {problem}; give a scene of this transfer function", file.display())))
}

/// Gives up all rights but those on the files of this run.
fn confine(args: &FitArgs, volume: &Path, place: &Path) -> Result<MadeFolders, Failure> {
    let files = Files {
        volumes: std::iter::once(volume).chain(args.labels.as_deref()).collect(),
        inputs: args.transfer_function.as_deref().into_iter().collect(),
        scene: args.start.as_deref(),
        folder: Some(place),
        private: args.keep_in.is_some(),
        outputs: args.out_truth.as_deref().into_iter().chain(args.report.as_deref()).collect(),
    };
    keep_only(&files).map_err(|e| work(format!("{}: {e}; give a writable folder", place.display())))
}

/// Reports a scene that an earlier run has made.
fn report_kept(volume: &Path, kept: &KeptScene, json: bool) -> Result<(), Failure> {
    let KeptScene { path, gaussians } = kept;
    if json {
        let report = serde_json::json!({ "volume": volume, "scene": path, "gaussians": gaussians, "kept": true });
        return print::result(&format!("{report:#}\n")).map_err(work);
    }
    print_line(&format!("{}: {} Gaussians, kept from an earlier run", path.display(), grouped(*gaussians as u64)));
    Ok(())
}

/// Refuses outputs that would replace foreign files, before the long work starts.
fn check_outputs(args: &FitArgs) -> Result<(), Failure> {
    if let Some(out) = &args.out {
        let scene = out.join("scene.toml");
        check_scene_target(&scene).map_err(|e| {
            let line = format!("{}: {e}", scene.display());
            if e.kind() == io::ErrorKind::AlreadyExists { input(line) } else { work(line) }
        })?;
    }
    // The scene keeps the unchanged transfer function, so its own file may be the input.
    let inputs = [args.volume.as_deref(), args.labels.as_deref(), args.start.as_deref()];
    let function = args.out.as_deref().map(|out| function_file(out, args.transfer_function.as_deref()));
    let outputs = [function.as_deref(), args.out_truth.as_deref(), args.report.as_deref()];
    staged_file::check_outputs(outputs.into_iter().flatten(), inputs.into_iter().flatten()).map_err(input)
}

/// The place of the transfer function beside the scene.
fn function_file(out: &Path, given: Option<&Path>) -> PathBuf {
    out.join(given.and_then(Path::file_name).unwrap_or_else(|| "automatic.tf.json".as_ref()))
}

/// Writes the transfer function and then the scene with its name.
fn write_scene(
    out: &Path,
    scene: &mut Scene,
    given: Option<&Path>,
    function: &TransferFunction,
) -> Result<Vec<PathBuf>, Failure> {
    make_folder(out)?;
    let target = function_file(out, given);
    let name = target.file_name().map(PathBuf::from);
    match given {
        // The unchanged file, with unknown keys.
        Some(given) => write(
            &target,
            &file::read(given, limits::TEXT_BYTES).map_err(|e| input(format!("{}: {e}", given.display())))?,
        )?,
        None => write(&target, function.to_json().map_err(work)?.as_bytes())?,
    }
    for unit in &mut scene.units {
        unit.transfer_function.clone_from(&name);
    }
    let saved = sg_formats::save(&out.join("scene.toml"), scene, &sg_formats::SaveOptions::default()).map_err(work)?;
    for warning in &saved.warnings {
        print_line(&format!("note: {}", warning.message));
    }
    Ok(saved.files.into_iter().chain([target]).collect())
}

/// A progress bar on standard error; it draws only to a terminal.
fn progress_bar() -> ProgressBar {
    let bar = ProgressBar::new(0);
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} {msg}") {
        bar.set_style(style);
    }
    bar
}

fn show(bar: &ProgressBar, p: Progress) {
    bar.set_length(p.of as u64);
    bar.set_position(p.done as u64);
    bar.set_message(p.stage);
}
