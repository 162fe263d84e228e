//! The command: conversion of a volume to a scene folder, and the synthetic volume.

use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use clap::{Parser, Subcommand};
use sg_fit::label_units::LabelUnits;
use sg_fit::labels::{label_scores, labels_of};
use sg_fit::training::checkpoint::Origin;
use sg_fit::{DirectStart, Options, direct_start, orientation_of};
use sg_formats::load::{LoadOptions, load};
use sg_formats::{check_scene_target, staged_file};
use sg_input::number_format::grouped;
use sg_input::print;
use sg_input::print::status as print_line;
use sg_reclassify::sources;
use sg_scene::model::Scene;
use sg_scene::orientation::Orientation;
use sg_volume::suggestion::suggest_base_units;
use sg_volume::{
    Classifier, Limits, ScalarField, ScalarFieldRef, TransferFunction, is_series_path, lacks_spacing, read_dataset,
    read_spaced_volume,
};

use crate::arguments::FitArgs;
use crate::carry::{CarryArgs, carry};
use crate::checkpoint_file::{CheckpointFile, checkpoint_path};
use crate::failure::{Failure, input, work};
use crate::interruption::{End, Further, stopped_line};
use crate::kept_scenes::{self, KeptScene, KeptScenes, key_of_labels};
use crate::output::{function_file, write, write_scene, write_truth};
use crate::own_rights::confined;
use crate::progress::Display;
use crate::report::{FitReport, MeshReport, note_left_out, suggestion_line, training_line};
use crate::stop_signals::StopSignals;
use crate::training_run::{Plan, Surroundings, Trained};
use crate::{label_units, phantom, time_series};

const EXAMPLE: &str = "Examples:
  supergaussian fit bonsai_256x256x256_uint8.raw.zst --transfer-function bonsai.tf.json --gaussians 20000 --out bonsai
  supergaussian fit bonsai_256x256x256_uint8.raw.zst --transfer-function bonsai.tf.json --initial-only --out bonsai
  supergaussian fit bonsai_256x256x256_uint8.raw.zst --suggest-units --initial-only --out bonsai
  supergaussian fit brain.nrrd --labels labels.nrrd --label-units --initial-only --out brain
  supergaussian fit flow_0.vti flow_1.vti flow_2.vti --seconds 30 --out flow
  supergaussian fit flow.pvd --variable pressure --out flow
  supergaussian fit ct/slices --initial-only --out head

Ctrl-C ends a training in good order: the best scene so far is written, and a line says how it goes on.";

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
    /// Carry a mask from one step of a series to a later one.
    #[command(
        after_help = "Example:\n  supergaussian fit carry flow/series.toml --mask ring.npy --from 0 --to 3 --out ring-3.npy"
    )]
    Carry(CarryArgs),
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
        Some(Command::Phantom { out, size, seed }) => {
            phantom::make(&out, usize::from(size), seed, cli.json).map(|()| End::Whole)
        }
        Some(Command::Carry(args)) => carry(&args).map(|()| End::Whole),
        None => fit(&cli.fit, cli.json),
    };
    match result {
        Ok(End::Whole) => ExitCode::SUCCESS,
        Ok(End::Stopped) => ExitCode::FAILURE,
        Err(failure) => {
            print_line(&format!("error: {}", failure.message));
            ExitCode::from(failure.status)
        }
    }
}

fn fit(args: &FitArgs, json: bool) -> Result<End, Failure> {
    let (Some(path), Some(place)) = (args.volumes.first(), args.out.as_ref().or(args.keep_in.as_ref())) else {
        return Err(input("a volume and --out DIR are required; see --help"));
    };
    if args.volumes.len() > 1 || is_series_path(path) {
        return time_series::fit(args, json);
    }
    if args.keep_in.is_some() && !args.initial_only {
        return Err(input("--keep-in keeps direct starts; add --initial-only, or give --out for a training"));
    }
    label_units::check_options(args)?;
    let clock = Instant::now();
    let _made = confined(args, place)?;
    let signals = StopSignals::for_training(!args.initial_only && !args.label_units).map_err(work)?;
    let given = args.given_function()?;
    let volume = read_dataset(path, &args.read_options(given.as_ref())).map_err(input)?;
    let read_labels = |labels: &Path| {
        let spacing = args.spacing.filter(|_| lacks_spacing(labels));
        read_spaced_volume(labels, spacing, Limits::default()).map_err(input)
    };
    let labels = args.labels.as_deref().map(read_labels).transpose()?;
    let label_units = label_units::label_units(args, path, &volume, labels.as_ref())?;
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
    let even = label_units.as_ref().filter(|units| units.stands_alone()).map(LabelUnits::even_function);
    // That of labels alone is of no use for anything else.
    let keeps_function = even.is_none();
    let function = match (given.or(even), &suggested) {
        (_, Some(suggested)) => suggested.function.clone(),
        (Some(given), None) => given,
        (None, None) => field
            .automatic_transfer_function(volume.variable())
            .map_err(|e| input(format!("{}: {e}", path.display())))?,
    };
    for unit in suggested.iter().flat_map(|suggested| &suggested.units) {
        print_line(&suggestion_line(unit));
    }
    let options = args.options();
    let keeping = match &args.keep_in {
        Some(folder) => {
            let kept = KeptScenes::new(folder).map_err(|e| work(format!("{}: {e}", folder.display())))?;
            let key = kept_scenes::key(field, orientation, &function, &options).map_err(work)?;
            let key = label_units.as_ref().map_or_else(|| key.clone(), |units| key_of_labels(&key, units));
            if let Some(scene) = kept.find(&key) {
                return report_kept(path, &scene, json).map(|()| End::Whole);
            }
            Some((kept, key))
        }
        None => None,
    };
    check_outputs(args)?;
    let mut labels_left_out = None;
    let (mut scene, direct) = match &args.start {
        Some(start) => (earlier_scene(start, &function)?, None),
        None => {
            let start = match (&label_units, &own_field) {
                (Some(units), ScalarField::Grid(voxels)) => {
                    let start = label_units::start(args, path, voxels, &function, units, &options)?;
                    let (empty, hidden) = label_units::left_out(units, &start);
                    labels_left_out = Some(empty + hidden);
                    start
                }
                _ => start_directly(args, path, field, &function, &options)?,
            };
            (start.scene, Some(start.report))
        }
    };
    scene.orientation = orientation;
    let classifier = function.classifier(field.range()).map_err(|e| input(format!("{}: {e}", path.display())))?;
    let trained = if args.initial_only || label_units.is_some() {
        None
    } else {
        Some(train(args, (path, place), &mut scene, (field, orientation, &function, &classifier), &signals)?)
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
    let kept_function = keeps_function.then_some(&function);
    let (scene_file, mut files) = match &keeping {
        None => (place.join("scene.toml"), write_scene(place, &mut scene, given, kept_function)?),
        Some((kept, key)) => {
            let fail = |e: io::Error| work(format!("{}: {e}; give a writable folder", place.display()));
            let staged = kept.stage(path).map_err(fail)?;
            let written = write_scene(&staged.folder, &mut scene, given, kept_function)?;
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
        labels_left_out,
        direct: direct.as_ref(),
        training: trained.as_ref().map(|(trained, _)| &trained.report),
        stopped: trained.as_ref().is_some_and(|(trained, _)| trained.is_stopped),
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
        if let Some((trained, _)) = trained.as_ref().filter(|(trained, _)| !trained.is_stopped) {
            print_line(&training_line(&trained.report));
        }
    }
    Ok(trained.map_or(End::Whole, |(trained, file)| ended(args, &trained, &file, &scene_file)))
}

/// Trains a start, from a checkpoint if that is wanted.
fn train(
    args: &FitArgs,
    (path, folder): (&Path, &Path),
    scene: &mut Scene,
    (field, orientation, function, classifier): (ScalarFieldRef<'_>, Orientation, &TransferFunction, &Classifier),
    signals: &StopSignals,
) -> Result<(Trained, CheckpointFile), Failure> {
    let start = scene.clone();
    let sources = kept_scenes::digest(field, orientation, function).map_err(work)?;
    let origin = Origin::new(sources, args.training.digest(&args.options()), &start);
    let mut file = CheckpointFile::new(folder, origin, args.training.checkpoint_every);
    let checkpoint = if args.training.resume {
        let checkpoint = file.read()?;
        print_line(&format!("the training goes on after {} steps", grouped(checkpoint.iteration() as u64)));
        Some(checkpoint)
    } else {
        file.note_other();
        None
    };
    let display = Display::new(args.progress_lines);
    let views = args.training.views((field, classifier), args.seed, &display);
    let around = Surroundings { display: &display, signals, file: Some(&mut file), checkpoint };
    let trained = args.training.train(scene, &views, Plan::default(), around);
    let trained = trained.map_err(|e| work(format!("{}: {e}", path.display())))?;
    sources::follow_training(scene, &start, classifier);
    Ok((trained, file))
}

/// The end of a training whose scene is written: the checkpoint goes, unless a signal has ended the training.
fn ended(args: &FitArgs, trained: &Trained, file: &CheckpointFile, scene_file: &Path) -> End {
    if !trained.is_stopped {
        file.remove();
        return End::Whole;
    }
    let place = |path: &Path| path.canonicalize().ok();
    let replaces_start =
        args.start.as_deref().is_some_and(|start| place(start).is_some_and(|start| Some(start) == place(scene_file)));
    let further = if replaces_start {
        // The start of the checkpoint is no more.
        file.remove();
        Further::Same
    } else if trained.is_kept {
        Further::Resume
    } else {
        Further::FromScene
    };
    print_line(&stopped_line(trained, scene_file, &further));
    End::Stopped
}

/// The direct start, with its progress and its notes.
fn start_directly(
    args: &FitArgs,
    path: &Path,
    field: ScalarFieldRef<'_>,
    function: &TransferFunction,
    options: &Options,
) -> Result<DirectStart, Failure> {
    let display = Display::new(args.progress_lines);
    let result = direct_start(field, function, options, |p| display.stage(p));
    display.finish();
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
    let inputs = args.volumes.iter().map(PathBuf::as_path).chain(args.labels.as_deref()).chain(args.start.as_deref());
    let inputs = inputs.chain(args.label_names.as_deref());
    let function = args.out.as_deref().map(|out| function_file(out, args.transfer_function.as_deref()));
    let checkpoint = args.out.as_deref().filter(|_| !args.initial_only).map(checkpoint_path);
    let outputs = [function.as_deref(), args.out_truth.as_deref(), args.report.as_deref(), checkpoint.as_deref()];
    staged_file::check_outputs(outputs.into_iter().flatten(), inputs).map_err(input)
}
