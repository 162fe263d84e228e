//! The offline subcommands.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use clap::{Args, Subcommand};
use serde::Serialize;
use sg_formats::summary::Summary;
use sg_formats::{Format, Loaded, Warning, load};
use sg_input::number_format::grouped;
use sg_input::print;
use sg_scene::model::SceneBox;

use crate::convert::{self, Convert};
use crate::reading::{Reading, input_help};
use crate::report::{WRONG_INPUT, fail, print_json, warn};

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
    /// A project (.sgproj, or a name from `supergaussian projects`) is written with its edits. Each part that looks
    /// different becomes a base unit, under the name of its unit; `.ply` becomes 3DGS where there are several.
    ///
    /// Example: supergaussian scene convert bonsai/scene.toml bonsai.compressed.ply
    ///
    /// Example: supergaussian scene convert tooth.sgproj root.ply --unit root
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

/// Runs a subcommand: 0 done, 1 the work failed, 2 the arguments or the input are wrong.
pub(crate) fn run(command: &Command) -> ExitCode {
    match command {
        Command::Info(arguments) => info(arguments),
        Command::Convert(arguments) => convert::run(arguments),
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
        "{}: {}, {} Gaussians, {} base units",
        report.file.display(),
        report.format,
        grouped(*gaussians as u64),
        units.len()
    ));
    print::status(&format!("  box           {}", format_box(bounds)));
    print::status(&format!("  content hash  {content_hash}"));
    for (unit, format) in units.iter().zip(report.unit_formats) {
        print::status(&format!(
            "  unit `{}`: {format}, {} Gaussians from index {}",
            unit.name,
            grouped(unit.gaussians as u64),
            grouped(unit.first as u64)
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
