//! Fit of a time series: `FOLDER/step-0000/scene.toml` and so on, and `FOLDER/series.toml` with all of them.

use std::io;
use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::Serialize;
use sg_fit::series::{Series, SeriesError, StartKind, StepStart};
use sg_fit::{DirectError, orientation_of};
use sg_formats::{check_scene_target, npy, staged_file};
use sg_input::number_format::grouped;
use sg_input::print;
use sg_input::print::status as print_line;
use sg_reclassify::sources;
use sg_scene::model::Scene;
use sg_volume::pooled::PooledValues;
use sg_volume::{
    Bounds, Dataset, ReadOptions, ScalarFieldRef, SeriesStep, TransferFunction, is_series_path, read_dataset,
    read_series,
};

use crate::arguments::FitArgs;
use crate::failure::{Failure, input, work};
use crate::interruption::{End, reached};
use crate::output::{function_file, make_folder, write, write_scene};
use crate::own_rights::confined;
use crate::progress::Display;
use crate::report::note_left_out;
use crate::stop_signals::StopSignals;
use crate::training_run::{Plan, Surroundings, Trained};

/// The file that names the steps.
const SERIES_FILE: &str = "series.toml";
/// The map to the step before, beside each scene.
const PREVIOUS_FILE: &str = "previous.npy";
/// Version of the format of the series file.
const SCHEMA: u32 = 1;
/// Training of a warm start: share of `--seconds` or `--iterations`, and of the first rates.
const WARM: Plan = Plan { share: 1.0 / 3.0, rates: 0.3 };

/// `series.toml`, and the report of the command.
#[derive(Serialize)]
struct SeriesFile {
    schema: u32,
    /// Steps of the source; fewer are listed while the command works, or after it was interrupted.
    steps: usize,
    /// Name of the quantity.
    #[serde(skip_serializing_if = "Option::is_none")]
    variable: Option<String>,
    /// Least and greatest value of all steps, raw.
    values: [f64; 2],
    /// The finished steps.
    step: Vec<StepEntry>,
}

#[derive(Serialize)]
struct StepEntry {
    /// From the folder of the series file.
    scene: PathBuf,
    /// For each Gaussian the index of the one of the step before that it continues, or -1.
    previous: PathBuf,
    source: PathBuf,
    #[serde(skip_serializing_if = "Option::is_none")]
    time: Option<f64>,
    gaussians: usize,
    start: StartKind,
    /// Gaussians that stay from the step before, that went, and that came.
    kept: usize,
    removed: usize,
    placed: usize,
    /// PSNR of both starts over the footprints of the pictures to train on.
    #[serde(skip_serializing_if = "Option::is_none")]
    direct_start_psnr_db: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    warm_start_psnr_db: Option<f64>,
    /// PSNR of the result over the footprints of held-out pictures.
    #[serde(skip_serializing_if = "Option::is_none")]
    psnr_db: Option<f64>,
    training_seconds: f64,
    /// All of the step, with reading and rendering.
    seconds: f64,
}

/// Fits all steps of a series.
pub(crate) fn fit(args: &FitArgs, json: bool) -> Result<End, Failure> {
    let out = out_folder(args)?;
    let _made = confined(args, out)?;
    let signals = StopSignals::for_training(!args.initial_only).map_err(work)?;
    let given = args.given_function()?;
    let steps = steps_of(&args.volumes)?;
    let options = args.read_options(given.as_ref());
    let found = examined(args, &steps, &options)?;
    let function = match given {
        Some(given) => given,
        None => found
            .pool
            .automatic_transfer_function(found.variable.as_deref())
            .map_err(|e| input(format!("all {} steps together: {e}", steps.len())))?,
    };
    let Some(range) = found.pool.range() else {
        return Err(input(format!("none of the {} steps has a finite value; give files with values", steps.len())));
    };
    let [low, high] = range;
    let mut series = Series::new(&function, range, args.options()).map_err(|e| of_function(args, &e))?;
    if !series.classifier().is_visible_between(low, high) {
        let what = format!(
            "nothing is visible in any of the {} steps (values {low} to {high}); raise opacities within that range",
            steps.len()
        );
        return Err(input(what));
    }
    check_outputs(args, out, &steps)?;
    let mut file =
        SeriesFile { schema: SCHEMA, steps: steps.len(), variable: found.variable, values: range, step: Vec::new() };
    let mut stopped = None;
    for (index, step) in steps.iter().enumerate() {
        let of = (index, steps.len());
        let Fitted { entry, trained } =
            fit_step(args, (out, &signals), of, step, &options, (&mut series, &function, range))?;
        if !json {
            print_line(&step_line(out, index, &entry));
        }
        file.step.push(entry);
        let text = toml::to_string(&file).map_err(work)?;
        write(&out.join(SERIES_FILE), text.as_bytes())?;
        let is_cut = trained.as_ref().is_some_and(|trained| trained.is_stopped);
        if is_cut || signals.is_stopped() && index + 1 < steps.len() {
            stopped = Some(trained.filter(|_| is_cut));
            break;
        }
        // Between two trainings a signal ends the command at once: all that is finished is written.
        signals.set_training(false);
    }
    if file.step.iter().all(|entry| entry.gaussians == 0) {
        print_line("note: nothing is visible in any step; the scenes contain no Gaussian");
    }
    let text = serde_json::to_string_pretty(&file).map_err(work)? + "\n";
    if let Some(report) = &args.report {
        write(report, text.as_bytes())?;
    }
    if json {
        print::result(&text).map_err(work)?;
    } else {
        print_line(&format!("{}: {} steps", out.join(SERIES_FILE).display(), file.step.len()));
    }
    let Some(cut) = stopped else { return Ok(End::Whole) };
    let after = cut.map_or_else(String::new, |trained| format!(", the last one trained for {}", reached(&trained)));
    let (made, of) = (file.step.len(), steps.len());
    print_line(&format!(
        "stopped: {made} of {of} steps of the series are written{after}; the same command begins it anew"
    ));
    Ok(End::Stopped)
}

/// The folder of the scenes. Options for one volume alone are refused.
fn out_folder(args: &FitArgs) -> Result<&Path, Failure> {
    let alone = [
        ("--start", args.start.is_some()),
        ("--keep-in", args.keep_in.is_some()),
        ("--labels", args.labels.is_some()),
        ("--label-units", args.label_units),
        ("--label-names", args.label_names.is_some()),
        ("--suggest-units", args.suggest_units.is_some()),
        ("--resume", args.training.resume),
    ];
    if let Some((option, _)) = alone.iter().find(|(_, is_given)| *is_given) {
        let remedy = match *option {
            "--suggest-units" => "give the automatic.tf.json of one step as --transfer-function",
            _ => "leave it out, or give one volume",
        };
        return Err(input(format!("{option} is for one volume, and this is a series; {remedy}")));
    }
    args.out.as_deref().ok_or_else(|| input("a series needs --out DIR; see --help"))
}

/// The steps: those of a series file, or the volumes as given.
fn steps_of(volumes: &[PathBuf]) -> Result<Vec<SeriesStep>, Failure> {
    match volumes {
        [series] if is_series_path(series) => read_series(series).map_err(input),
        _ => {
            if let Some(series) = volumes.iter().find(|path| is_series_path(path)) {
                let what = "names all steps of a series; give it alone, or the files of the steps";
                return Err(input(format!("{}: {what}", series.display())));
            }
            if let Some([later, earlier]) = volumes.array_windows().find(|[a, b]| is_after(a, b)) {
                print_line(&format!(
                    "note: {} stands before {}: steps keep the order of the command line",
                    later.display(),
                    earlier.display()
                ));
            }
            Ok(volumes.iter().map(|path| SeriesStep { path: path.clone(), time: None }).collect())
        }
    }
}

/// Whether two names differ in their numbers alone, and those of the first one are greater. A shell puts 10 before 2.
fn is_after(one: &Path, other: &Path) -> bool {
    let parts = |path: &Path| {
        let name = path.to_string_lossy().into_owned();
        let words: Vec<String> =
            name.split(|c: char| c.is_ascii_digit()).filter(|w| !w.is_empty()).map(str::to_owned).collect();
        let numbers = name.split(|c: char| !c.is_ascii_digit()).filter(|n| !n.is_empty());
        let numbers: Vec<u64> = numbers.map(|n| n.parse().unwrap_or(u64::MAX)).collect();
        (words, numbers)
    };
    let ((words, numbers), (others, other_numbers)) = (parts(one), parts(other));
    words == others && numbers.len() == other_numbers.len() && numbers > other_numbers
}

/// What a first look at all steps found.
struct Examined {
    pool: PooledValues,
    variable: Option<String>,
}

/// What all steps must have in common.
struct Common {
    is_mesh: bool,
    variable: Option<String>,
    bounds: Bounds,
    slack: f64,
}

/// Reads every step once, before anything is written: each can be read, and they fit together.
fn examined(args: &FitArgs, steps: &[SeriesStep], options: &ReadOptions) -> Result<Examined, Failure> {
    let display = Display::new(args.progress_lines);
    let mut pool = PooledValues::new(steps.len());
    let mut first: Option<Common> = None;
    for (index, step) in steps.iter().enumerate() {
        display.show(index as u64, steps.len() as u64, "reading the steps");
        let data = read_step(index, step, options)?;
        let own = data.to_field();
        let common = Common::of(&data, own.as_ref());
        match &first {
            None => first = Some(common),
            Some(first) => first.check(&common).map_err(|e| of_step(index, &step.path, &e))?,
        }
        pool.add(own.as_ref());
    }
    display.finish();
    Ok(Examined { pool, variable: first.and_then(|first| first.variable) })
}

impl Common {
    fn of(data: &Dataset, field: ScalarFieldRef<'_>) -> Self {
        Self {
            is_mesh: matches!(data, Dataset::Mesh(_)),
            variable: data.variable().map(str::to_owned),
            bounds: field.bounds(),
            slack: match field {
                ScalarFieldRef::Grid(field) => field.grid().spacing().max_element(),
                ScalarFieldRef::Mesh(field) => field.reference_length(),
            },
        }
    }

    /// The difference of a step from the first one.
    fn check(&self, step: &Self) -> Result<(), String> {
        let kind = |is_mesh: bool| if is_mesh { "a mesh" } else { "voxels" };
        if self.is_mesh != step.is_mesh {
            return Err(format!(
                "{}, but step 0 is {}; give steps of one kind",
                kind(step.is_mesh),
                kind(self.is_mesh)
            ));
        }
        if self.variable != step.variable {
            let name = |variable: &Option<String>| variable.clone().unwrap_or_else(|| "no name".to_owned());
            return Err(format!(
                "the quantity `{}`, but step 0 has `{}`; name one with --variable",
                name(&step.variable),
                name(&self.variable)
            ));
        }
        let slack = self.slack.max(step.slack);
        let apart = |a: glam::DVec3, b: glam::DVec3| (a - b).abs().max_element();
        let (one, other) = (self.bounds, step.bounds);
        if apart(one.min, other.min) > slack || apart(one.max, other.max) > slack {
            return Err(format!(
                "it fills the box {} to {}, but step 0 {} to {}; give steps of the same place",
                other.min, other.max, one.min, one.max
            ));
        }
        Ok(())
    }
}

fn read_step(index: usize, step: &SeriesStep, options: &ReadOptions) -> Result<Dataset, Failure> {
    read_dataset(&step.path, options).map_err(|e| input(format!("step {index}: {e}")))
}

fn of_step(index: usize, path: &Path, what: &str) -> Failure {
    input(format!("step {index}: {}: {what}", path.display()))
}

fn of_function(args: &FitArgs, error: &DirectError) -> Failure {
    match &args.transfer_function {
        Some(file) => input(format!("{}: {error}", file.display())),
        None => input(error),
    }
}

fn folder_name(index: usize) -> String {
    format!("step-{index:04}")
}

/// Refuses outputs that would replace foreign files, before the long work starts.
fn check_outputs(args: &FitArgs, out: &Path, steps: &[SeriesStep]) -> Result<(), Failure> {
    let mut outputs = vec![out.join(SERIES_FILE)];
    for index in 0..steps.len() {
        let folder = out.join(folder_name(index));
        let scene = folder.join("scene.toml");
        check_scene_target(&scene).map_err(|e| {
            let line = format!("{}: {e}", scene.display());
            if e.kind() == io::ErrorKind::AlreadyExists { input(line) } else { work(line) }
        })?;
        outputs.push(function_file(&folder, args.transfer_function.as_deref()));
        outputs.push(folder.join(PREVIOUS_FILE));
    }
    outputs.extend(args.report.clone());
    check_series_target(&out.join(SERIES_FILE))?;
    let inputs = args.volumes.iter().chain(steps.iter().map(|step| &step.path)).map(PathBuf::as_path);
    staged_file::check_outputs(outputs.iter().map(PathBuf::as_path), inputs).map_err(input)?;
    let more = out.join(folder_name(steps.len()));
    if more.exists() {
        print_line(&format!("note: {} is of an earlier series, and stays", more.display()));
    }
    Ok(())
}

/// A series file may replace one, and nothing else.
fn check_series_target(path: &Path) -> Result<(), Failure> {
    if !path.exists() {
        return Ok(());
    }
    let text = sg_input::file::read_text(path, sg_input::limits::TEXT_BYTES)
        .map_err(|e| work(format!("{}: {e}", path.display())))?;
    let is_series = text.is_empty()
        || sg_input::limits::check_toml_parts(&text).is_ok()
            && text.parse::<toml::Table>().is_ok_and(|table| table.contains_key("steps") && table.contains_key("step"));
    if is_series {
        return Ok(());
    }
    let what = "the file there is no series file; move it away or give another folder";
    Err(input(format!("{}: {what}", path.display())))
}

/// A step whose folder is written.
struct Fitted {
    entry: StepEntry,
    trained: Option<Trained>,
}

/// Fits one step and writes its folder.
fn fit_step(
    args: &FitArgs,
    (out, signals): (&Path, &StopSignals),
    (index, of): (usize, usize),
    step: &SeriesStep,
    options: &ReadOptions,
    (series, function, range): (&mut Series, &TransferFunction, [f64; 2]),
) -> Result<Fitted, Failure> {
    let clock = Instant::now();
    let display = Display::of_part(args.progress_lines, format!("step {} of {of}: ", index + 1));
    let data = read_step(index, step, options)?;
    note_left_out(&step.path, &data);
    let own = data.to_field().with_range(range);
    let orientation = orientation_of(data.frame());
    drop(data);
    let failed = |e: &dyn std::fmt::Display| work(format!("step {index}: {}: {e}", step.path.display()));
    let (mut start, trained) = started(args, series, own.as_ref(), (&display, signals)).map_err(|e| match e {
        StepError::Input(e) => of_step(index, &step.path, &e),
        StepError::Work(e) => failed(&e),
    })?;
    display.finish();
    start.scene.orientation = orientation;
    let folder = out.join(folder_name(index));
    make_folder(&folder)?;
    npy::write_array(&folder.join(PREVIOUS_FILE), &[start.previous.len()], &start.previous).map_err(work)?;
    write_scene(&folder, &mut start.scene, args.transfer_function.as_deref(), Some(function))?;
    let gaussians = start.scene.len();
    series.finish(start.scene, own);
    let name = PathBuf::from(folder_name(index));
    let report = trained.as_ref().map(|trained| &trained.report);
    let entry = StepEntry {
        scene: name.join("scene.toml"),
        previous: name.join(PREVIOUS_FILE),
        source: step.path.clone(),
        time: step.time,
        gaussians,
        start: start.kind,
        kept: start.kept,
        removed: start.removed,
        placed: start.placed,
        direct_start_psnr_db: start.decibels.map(|both| both[0]),
        warm_start_psnr_db: start.decibels.map(|both| both[1]),
        psnr_db: report.map(|report| report.result.footprint_psnr_db),
        training_seconds: report.map_or(0.0, |report| report.seconds),
        seconds: clock.elapsed().as_secs_f64(),
    };
    Ok(Fitted { entry, trained })
}

/// A step that could not be fitted.
enum StepError {
    /// Its values or the options are wrong.
    Input(String),
    /// The work failed.
    Work(String),
}

/// The start of a step, trained, if it needs it.
fn started(
    args: &FitArgs,
    series: &Series,
    field: ScalarFieldRef<'_>,
    (display, signals): (&Display, &StopSignals),
) -> Result<(StepStart, Option<Trained>), StepError> {
    if let Some(start) = series.unchanged(field) {
        return Ok((start, None));
    }
    let direct = series.direct(field, |p| display.stage(p)).map_err(|e| StepError::Input(e.to_string()))?;
    let Some(direct) = direct else { return Ok((series.empty(field), None)) };
    let failed = |e: SeriesError| StepError::Work(e.to_string());
    if args.initial_only {
        return Ok((series.start(direct, field, &[]).map_err(failed)?, None));
    }
    let views = args.training.views((field, series.classifier()), args.seed, display);
    let mut start = series.start(direct, field, &views.training).map_err(failed)?;
    let plan = if start.kind == StartKind::Warm { WARM } else { Plan::default() };
    let before: Scene = start.scene.clone();
    let around = Surroundings { display, signals, file: None, checkpoint: None };
    let trained = args.training.train(&mut start.scene, &views, plan, around).map_err(|e| failed(e.into()))?;
    sources::follow_training(&mut start.scene, &before, series.classifier());
    Ok((start, Some(trained)))
}

/// A finished step, for a person.
fn step_line(out: &Path, index: usize, entry: &StepEntry) -> String {
    let start = match entry.start {
        StartKind::Direct => "direct start".to_owned(),
        StartKind::Warm => {
            format!("warm start, {} went and {} came", grouped(entry.removed as u64), grouped(entry.placed as u64))
        }
        StartKind::Unchanged => "the values of the step before".to_owned(),
        StartKind::Empty => "nothing is visible".to_owned(),
    };
    let reached = entry.psnr_db.map_or_else(String::new, |db| format!(", {db:.1} dB"));
    format!(
        "step {index}: {}: {} Gaussians ({start}){reached} in {:.1} s",
        out.join(&entry.scene).display(),
        grouped(entry.gaussians as u64),
        entry.seconds
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_names_are_compared_as_numbers() {
        let after = |a: &str, b: &str| is_after(Path::new(a), Path::new(b));
        assert!(after("flow_10.vti", "flow_2.vti") && after("a/t2_5.vtu", "a/t2_4.vtu"));
        assert!(!after("flow_2.vti", "flow_10.vti") && !after("flow_2.vti", "flow_2.vti"));
        assert!(!after("flow_3.vti", "heat_2.vti") && !after("flow_03.vti", "flow_3.vti"));
    }
}
