//! The offline subcommands: arguments and output.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

use clap::{Args, Subcommand};
use sg_edit::{EditState, PlacedScene};
use sg_formats::{LoadOptions, load};
use sg_input::print;
use sg_labeling::attributes::words::describing;
use sg_labeling::meaning::LabelCosines;
use sg_labeling::query::{Outcome, QueryContext, Ranked};

use crate::label_encoder::{EncoderChoice, LabelEncoder};
use crate::measured_units::{MeasuredUnits, Units};

/// Subcommands that work on files alone.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Finds the base units of a scene that a text means.
    ///
    /// Each line has the unit, its score and the reason. Exit status 1: nothing matches, or several units match equally well.
    ///
    /// Example: supergaussian labeling find head/scene.toml "the largest bone"
    Find(Find),
    /// Describes how the base units of a scene look.
    ///
    /// Example: supergaussian labeling describe head/scene.toml
    Describe(Describe),
}

#[derive(Debug, Args)]
pub(crate) struct Find {
    /// Scene: scene.toml or a Gaussian file
    scene: PathBuf,
    /// Text, such as "the largest bone" or "everything but the skin"
    text: String,
    /// Sentence encoder beside the words: a model's folder, `auto` for the one of ops/models.sh if it is there, or `none`
    #[arg(long, value_name = "auto|none|FOLDER", default_value = "auto")]
    text_encoder: EncoderChoice,
}

#[derive(Debug, Args)]
pub(crate) struct Describe {
    /// Scene: scene.toml or a Gaussian file
    scene: PathBuf,
}

/// Runs a subcommand. Exit status: 0 for success, 1 for no clear match, 2 for wrong input.
pub(crate) fn run(command: &Command) -> ExitCode {
    let outcome = match command {
        Command::Find(Find { scene, text, text_encoder }) => {
            units(scene).and_then(|units| find(&units, text, text_encoder))
        }
        Command::Describe(Describe { scene }) => units(scene).and_then(|units| {
            let looks = units.queryable.looks();
            let line = |(at, name): (usize, &String)| format!("{name}: {}", describing(looks, at).join(", "));
            write(&units.names.iter().enumerate().map(line).collect::<Vec<_>>())?;
            Ok(ExitCode::SUCCESS)
        }),
    };
    outcome.unwrap_or_else(|message| {
        print::status(&format!("error: {message}"));
        ExitCode::from(2)
    })
}

/// The base units of a scene file.
fn units(path: &std::path::Path) -> Result<Arc<Units>, String> {
    let loaded = load(path, &LoadOptions::default()).map_err(|e| e.to_string())?;
    for warning in &loaded.warnings {
        print::status(&format!("warning: {}: {warning}", path.display()));
    }
    let scene = Arc::new(loaded.scene);
    let state = EditState::of_scene(&scene, "", "");
    MeasuredUnits::new(PlacedScene::new(scene)).of(&state).map_err(|e| e.to_string())
}

/// Writes lines to standard output.
fn write(lines: &[String]) -> Result<(), String> {
    print::result(&lines.join("\n")).map_err(|e| format!("standard output: {e}"))
}

fn find(units: &Units, text: &str, encoder: &EncoderChoice) -> Result<ExitCode, String> {
    let encoder = LabelEncoder::of(encoder).map_err(|e| e.to_string())?;
    if let Some(encoder) = &encoder {
        while encoder.encode_next(&units.names).map_err(|e| e.to_string())? {}
    }
    let meaning = encoder.as_ref().map(|encoder| encoder.labelled(&units.names));
    let line = |r: &Ranked| {
        let name = units.names.get(r.item).map_or("", String::as_str);
        format!("{name}\t{:.2}\t{}", r.score, r.explanation())
    };
    let lines = |ranked: &[Ranked]| write(&ranked.iter().map(line).collect::<Vec<_>>());
    let context = QueryContext { meaning: meaning.as_ref().map(|m| m as &dyn LabelCosines), ..QueryContext::default() };
    match units.queryable.find_by(text, context) {
        Outcome::Match { items } => {
            lines(&items)?;
            return Ok(ExitCode::SUCCESS);
        }
        Outcome::Ambiguous { candidates } => {
            lines(&candidates)?;
            print::status(if candidates.len() == 1 {
                "not sure: the text may mean this unit; say its name if it does"
            } else {
                "ambiguous: the text may mean any of these units; add a word that tells them apart"
            });
        }
        Outcome::NothingMatches { why, .. } => print::status(&format!("nothing matches: {why}")),
    }
    Ok(ExitCode::from(1))
}
