//! The offline subcommands.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args, Subcommand};
use glam::Vec3;
use serde::Serialize;
use sg_formats::staged_file::{OutputError, check_outputs};
use sg_formats::summary::Summary;
use sg_formats::{Format, LoadOptions, Loaded, SaveError, SaveOptions, Warning};
use sg_formats::{load, save};
use sg_input::print;
use sg_scene::model::{Convention, SceneBox, ShadingModel};

/// Subcommands that work on files alone.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Prints counts, bounds, attributes, conventions and warnings of a scene.
    ///
    /// Example: supergaussian scene info bonsai/scene.toml --json
    Info(Info),
    /// Writes a scene in another format, chosen by the output's extension.
    ///
    /// `--format` lists the formats. `.ply` becomes an editable unit or 3DGS. A folder needs `--format ivrgs`. An
    /// editable scene becomes 3DGS with baked colours, palette + offset. A 3DGS scene becomes an editable one that is
    /// unlit (ka 1, kd 0, ks 0), with the shortest axes as normals.
    ///
    /// Example: supergaussian scene convert bonsai/scene.toml bonsai.compressed.ply
    Convert(Convert),
}

#[derive(Debug, Args)]
pub(crate) struct Info {
    #[arg(help = input_help())]
    file: PathBuf,
    #[command(flatten)]
    reading: Reading,
    /// Print a report to standard output.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct Convert {
    #[arg(help = input_help())]
    input: PathBuf,
    /// The file to write, or a folder for iVR-GS.
    output: PathBuf,
    /// The format to write; by default the ending decides.
    #[arg(long, visible_alias = "to", value_parser = formats())]
    format: Option<Format>,
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

/// Properties that override those of the files.
#[derive(Debug, Args)]
struct Reading {
    /// Activation of the input's shading columns; by default the file names it, or it is guessed.
    #[arg(long, value_parser = conventions())]
    convention: Option<Convention>,
    /// Shading model of all units.
    #[arg(long, value_parser = shadings())]
    shading: Option<ShadingModel>,
    /// Palette colour of all units with shading columns, three numbers from 0 to 1.
    #[arg(long, value_name = "R,G,B", value_parser = palette)]
    palette: Option<Vec3>,
}

impl Reading {
    fn options(&self) -> LoadOptions {
        LoadOptions { convention: self.convention, shading: self.shading, palette: self.palette }
    }
}

fn input_help() -> String {
    format!("A scene ({}), or an output folder of iVR-GS", Format::all_extensions().join(", "))
}

fn formats() -> impl TypedValueParser<Value = Format> {
    let values = Format::all().filter(|f| f.is_writable());
    let values = values.map(|f| PossibleValue::new(f.name()).help(f.description()));
    PossibleValuesParser::new(values).try_map(|name| name.parse::<Format>())
}

fn conventions() -> impl TypedValueParser<Value = Convention> {
    let names = ["ours", "legacy", "head-raw", "head-activated"];
    PossibleValuesParser::new(names).try_map(|name| serde_json::from_value(serde_json::Value::String(name)))
}

fn shadings() -> impl TypedValueParser<Value = ShadingModel> {
    let names = ["paper", "ivrgs-train", "ivrgs-viewer"];
    PossibleValuesParser::new(names).try_map(|name| serde_json::from_value(serde_json::Value::String(name)))
}

fn palette(text: &str) -> Result<Vec3, String> {
    let numbers: Vec<f32> = text.split(',').filter_map(|n| n.trim().parse().ok()).collect();
    match numbers.as_slice() {
        [r, g, b] if numbers.iter().all(|x| (0.0..=1.0).contains(x)) => Ok(Vec3::new(*r, *g, *b)),
        _ => Err("give three numbers from 0 to 1, as 0.8,0.2,0.1".to_owned()),
    }
}

/// Exit status where the arguments or the input are wrong.
pub(crate) const WRONG_INPUT: u8 = 2;

/// Runs a subcommand: 0 done, 1 the work failed, 2 the arguments or the input are wrong.
pub(crate) fn run(command: &Command) -> ExitCode {
    match command {
        Command::Info(arguments) => info(arguments),
        Command::Convert(arguments) => convert(arguments),
    }
}

#[derive(Serialize)]
struct InfoReport<'a> {
    file: &'a Path,
    format: Format,
    unit_formats: &'a [Format],
    #[serde(flatten)]
    summary: Summary,
    warnings: &'a [Warning],
    read_seconds: f64,
}

fn info(arguments: &Info) -> ExitCode {
    let start = Instant::now();
    let loaded = match load(&arguments.file, &arguments.reading.options()) {
        Ok(loaded) => loaded,
        Err(error) => return fail(&error, WRONG_INPUT),
    };
    let report = InfoReport {
        file: &arguments.file,
        format: loaded.format,
        unit_formats: &loaded.unit_formats,
        read_seconds: start.elapsed().as_secs_f64(),
        summary: Summary::of(&loaded.scene),
        warnings: &loaded.warnings,
    };
    if arguments.json {
        return print_json(&report);
    }
    print_info(&report, &loaded);
    ExitCode::SUCCESS
}

fn print_info(report: &InfoReport<'_>, loaded: &Loaded) {
    let Summary { gaussians, bounds, content_hash, units } = &report.summary;
    print::status(&format!(
        "{}: {}, {gaussians} Gaussians, {} base units",
        report.file.display(),
        report.format,
        units.len()
    ));
    print::status(&format!("  box           {}", format_box(bounds)));
    print::status(&format!("  content hash  {content_hash}"));
    for (unit, format) in units.iter().zip(report.unit_formats) {
        print::status(&format!(
            "  unit `{}`: {format}, {} Gaussians from index {}",
            unit.name, unit.gaussians, unit.first
        ));
        print::status(&format!("    bounds      {}", format_box(&unit.bounds)));
        let harmonics = unit.harmonics_degree.map_or(String::new(), |d| format!(" (degree {d})"));
        print::status(&format!("    attributes  {}{harmonics}", unit.attributes.join(" ")));
        if !unit.extra.is_empty() {
            let extra: Vec<_> = unit.extra.iter().map(|e| format!("{} ({})", e.name, e.scalar)).collect();
            print::status(&format!("    extra       {}", extra.join(" ")));
        }
        let [r, g, b] = unit.palette;
        print::status(&format!("    palette     {r} {g} {b}, opacity factor {}", unit.opacity));
        let oriented = if unit.oriented_normals { "oriented normals" } else { "unoriented normals" };
        print::status(&format!("    drawn       {:?}, stored {:?}, {oriented}", unit.shading, unit.convention));
    }
    print::status(&format!("  read in {:.3} s", report.read_seconds));
    warn(&loaded.warnings);
}

fn format_box(b: &SceneBox) -> String {
    let corner = |p: glam::DVec3| format!("({:.6} {:.6} {:.6})", p.x, p.y, p.z);
    format!("{} to {}", corner(b.min), corner(b.max))
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

fn convert(arguments: &Convert) -> ExitCode {
    let start = Instant::now();
    let mut loaded = match load(&arguments.input, &arguments.reading.options()) {
        Ok(loaded) => loaded,
        Err(error) => return fail(&error, WRONG_INPUT),
    };
    let read_seconds = start.elapsed().as_secs_f64();
    if let Err(error) = check_output(arguments, &loaded) {
        return fail(&error, WRONG_INPUT);
    }
    keep_transfer_functions(&mut loaded, &arguments.input, &arguments.output);
    let options =
        SaveOptions { format: arguments.format, convention: arguments.to_convention, reorder: arguments.reorder };
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
        report.gaussians,
        report.read_seconds,
        report.write_seconds
    ));
    warn(&warnings);
    ExitCode::SUCCESS
}

/// Refuses an output that would replace a foreign file, the input, or a file of its units. Saving checks folders.
fn check_output(arguments: &Convert, loaded: &Loaded) -> Result<(), OutputError> {
    if arguments.output.is_dir() {
        return Ok(());
    }
    let scene_file = arguments.input.join("scene.toml");
    let units = loaded.scene.units.iter().filter_map(|unit| unit.file.as_deref());
    let inputs = units.chain([arguments.input.as_path(), scene_file.as_path()]);
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

fn warn(warnings: &[Warning]) {
    for warning in warnings {
        print::status(&format!("warning: {warning}"));
    }
}

pub(crate) fn print_json(report: &impl Serialize) -> ExitCode {
    let text = serde_json::to_string_pretty(report).map_err(std::io::Error::from);
    match text.and_then(|text| print::result(&text)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => fail(&error, 1),
    }
}

pub(crate) fn fail(error: &dyn std::error::Error, status: u8) -> ExitCode {
    print::status(&format!("supergaussian-scene: {error}"));
    ExitCode::from(status)
}
