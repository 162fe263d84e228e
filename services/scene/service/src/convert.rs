//! `convert`: a scene, or a project with its edits, in another format.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use serde::Serialize;
use sg_edit::Part;
use sg_formats::staged_file::{OutputError, check_outputs};
use sg_formats::{Format, Loaded, SaveError, SaveOptions, Warning, joined_format, load, save};
use sg_input::number_format::grouped;
use sg_input::print;
use sg_scene::model::Convention;

use crate::edited_scene::{EditedScene, load_edited, project_of};
use crate::reading::{Reading, conventions, input_help};
use crate::report::{WRONG_INPUT, fail, print_json, warn};

#[derive(Debug, Args)]
pub(crate) struct Convert {
    #[arg(help = format!("{}, or a project with its edits", input_help()))]
    input: PathBuf,
    /// The file to write, or a folder for iVR-GS.
    output: PathBuf,
    /// The format to write; by default the ending decides.
    #[arg(long, visible_alias = "to", value_parser = formats())]
    format: Option<Format>,
    /// Write this unit of a project alone, hidden or not.
    #[arg(long, value_name = "NAME")]
    unit: Option<String>,
    /// The Gaussians of a project to write.
    #[arg(long, value_enum, default_value_t = Choice::Visible, conflicts_with = "unit")]
    only: Choice,
    /// The present place of a project's scene, if it has moved.
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    #[command(flatten)]
    reading: Reading,
    /// Activation of the shading columns of an iVR-GS output.
    #[arg(long, value_parser = conventions())]
    to_convention: Option<Convention>,
    /// Write a compressed PLY in Morton order: smaller errors, but every Gaussian's index changes.
    #[arg(long)]
    reorder: bool,
    /// Print a report to standard output.
    #[arg(long)]
    json: bool,
}

/// Gaussians of a project.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Choice {
    /// Those that no hidden unit contains.
    Visible,
    /// The selected ones, hidden or not.
    Selection,
    /// All, hidden ones too.
    Everything,
}

fn formats() -> impl TypedValueParser<Value = Format> {
    let values = Format::all().filter(|f| f.is_writable());
    let values = values.map(|f| PossibleValue::new(f.name()).help(f.description()));
    PossibleValuesParser::new(values).try_map(|name| name.parse::<Format>())
}

#[derive(Serialize)]
struct ConvertReport<'a> {
    input: &'a Path,
    input_format: Format,
    output: &'a Path,
    output_format: Format,
    files: &'a [PathBuf],
    gaussians: usize,
    warnings: &'a [Warning],
    read_seconds: f64,
    write_seconds: f64,
}

/// Runs it: 0 done, 1 the work failed, 2 the arguments or the input are wrong.
pub(crate) fn run(arguments: &Convert) -> ExitCode {
    let start = Instant::now();
    let project = project_of(&arguments.input);
    let EditedScene { mut loaded, scene_file, unit_files } = match arguments.read(project.as_deref()) {
        Ok(read) => read,
        Err(status) => return status,
    };
    let read_seconds = start.elapsed().as_secs_f64();
    if let Err(error) = check_output(arguments, &scene_file, &unit_files) {
        return fail(&error, WRONG_INPUT);
    }
    keep_transfer_functions(&mut loaded, &scene_file, &arguments.output);
    // Edits make base units of one file; a scene file's own are not joined unasked.
    let joined = || project.as_ref().and_then(|_| joined_format(&arguments.output, &loaded.scene));
    let format = arguments.format.or_else(joined);
    let options = SaveOptions { format, convention: arguments.to_convention, reorder: arguments.reorder };
    let start = Instant::now();
    let saved = match save(&arguments.output, &loaded.scene, &options) {
        Ok(saved) => saved,
        Err(error @ SaveError::Unsuitable { .. }) => return fail(&error, WRONG_INPUT),
        Err(error @ SaveError::Write { .. }) => return fail(&error, 1),
    };
    let warnings = [loaded.warnings, saved.warnings].concat();
    let report = ConvertReport {
        input: &arguments.input,
        input_format: loaded.format,
        output: &arguments.output,
        output_format: saved.format,
        files: &saved.files,
        gaussians: loaded.scene.len(),
        warnings: &warnings,
        read_seconds,
        write_seconds: start.elapsed().as_secs_f64(),
    };
    if arguments.json {
        return print_json(&report);
    }
    print::status(&format!(
        "{} ({}) -> {} ({}): {} Gaussians, read in {:.3} s, written in {:.3} s",
        report.input.display(),
        report.input_format,
        report.output.display(),
        report.output_format,
        grouped(report.gaussians as u64),
        report.read_seconds,
        report.write_seconds
    ));
    warn(&warnings);
    ExitCode::SUCCESS
}

/// Options that belong to the other kind of input.
#[derive(Debug, thiserror::Error)]
enum Misplaced {
    #[error("{0}: --convention, --shading and --palette change how files are read; a project has its own looks")]
    Reading(PathBuf),
    #[error("{0}: --unit, --only and --scene choose from a project; name one that ends with .sgproj")]
    Choice(PathBuf),
}

impl Convert {
    fn read(&self, project: Option<&Path>) -> Result<EditedScene, ExitCode> {
        let wrong = |error: &dyn std::error::Error| fail(error, WRONG_INPUT);
        let Some(project) = project else {
            if self.unit.is_some() || self.scene.is_some() || self.only != Choice::Visible {
                return Err(wrong(&Misplaced::Choice(self.input.clone())));
            }
            let loaded = load(&self.input, &self.reading.options()).map_err(|error| wrong(&error))?;
            let unit_files = loaded.scene.units.iter().filter_map(|unit| unit.file.clone()).collect();
            return Ok(EditedScene { loaded, scene_file: self.input.clone(), unit_files });
        };
        if self.reading.changes_files() {
            return Err(wrong(&Misplaced::Reading(self.input.clone())));
        }
        let part = match (&self.unit, self.only) {
            (Some(name), _) => Part::Unit(name),
            (None, Choice::Visible) => Part::Visible,
            (None, Choice::Selection) => Part::Selection,
            (None, Choice::Everything) => Part::Everything,
        };
        load_edited(project, self.scene.as_deref(), part)
            .map_err(|error| fail(&error, if error.is_input() { WRONG_INPUT } else { 1 }))
    }
}

/// Refuses an output that would replace a foreign file, the input, or a file of its units. Saving checks folders.
fn check_output(arguments: &Convert, scene_file: &Path, unit_files: &[PathBuf]) -> Result<(), OutputError> {
    if arguments.output.is_dir() {
        return Ok(());
    }
    let inside = scene_file.join("scene.toml");
    let units = unit_files.iter().map(PathBuf::as_path);
    let inputs = units.chain([arguments.input.as_path(), scene_file, inside.as_path()]);
    check_outputs([arguments.output.as_path()], inputs)
}

/// Scene files name transfer functions by relative paths; in another folder these become absolute.
fn keep_transfer_functions(loaded: &mut Loaded, input: &Path, output: &Path) {
    let folder = |path: &Path| {
        let parent = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        parent.canonicalize().ok()
    };
    let (from, to) = (folder(input), folder(output));
    let Some(from) = from.filter(|from| to.as_ref() != Some(from)) else { return };
    for unit in &mut loaded.scene.units {
        if let Some(file) = unit.transfer_function.as_mut().filter(|f| f.is_relative()) {
            *file = from.join(&*file);
        }
    }
}
