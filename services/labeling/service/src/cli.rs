//! The offline subcommands: arguments and output.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

use clap::{Args, Subcommand};
use sg_input::{file, print};
use sg_labeling::attributes::words::describing;
use sg_labeling::meaning::LabelCosines;
use sg_labeling::pictures::UnitPictures;
use sg_labeling::query::{Outcome, QueryContext, Ranked};
use supergaussian_labeling::query_png;

use crate::label_encoder::{EncoderChoice, LabelEncoder};
use crate::measured_units::Units;
use crate::offline_scene::{OfflinePictures, OfflineScene};
use crate::params::Params;
use crate::picture_encoder::ImageEncoderChoice;
use crate::picture_query;
use crate::retrieval::{self, Retrieval};
use crate::unit_embeddings::UnitEmbeddings;

/// Subcommands that work on files alone.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Finds the base units of a scene that a text means, or that a picture is like.
    ///
    /// Each line has the unit, its score and the reason. Exit status 1: nothing matches, or several units match equally well.
    /// A picture is compared with pictures of the units, and never matches for sure. With an image encoder and a text, the
    /// pictures have a say where words find nothing.
    ///
    /// Example: supergaussian labeling find head/scene.toml "the largest bone"
    ///
    /// Example: supergaussian labeling find head/scene.toml --picture skull.png --image-encoder /models/clip-vit-base-patch32
    Find(Find),
    /// Describes how the base units of a scene look.
    ///
    /// Example: supergaussian labeling describe head/scene.toml
    Describe(Describe),
    /// Measures how well texts find the base units of scenes, by each method beside the others.
    ///
    /// Each unit is drawn and embedded. Then its name is asked for, or the texts of a file. The table has recall@1, recall@5 and
    /// the mean reciprocal rank for words, a sentence encoder, pictures, names and both fused, with and without an adapter, and
    /// for three orders of the views. Ties count against a method.
    ///
    /// Example: supergaussian labeling retrieval head/scene.toml --image-encoder /models/clip-vit-base-patch32 --queries texts.tsv
    Retrieval(Retrieval),
}

#[derive(Debug, Args)]
pub(crate) struct Find {
    /// Scene: scene.toml or a Gaussian file
    scene: PathBuf,
    #[command(flatten)]
    sought: Sought,
    /// Sentence encoder beside the words: a model's folder, `auto` for the one of ops/models.sh if it is there, or `none`
    #[arg(long, value_name = "auto|none|FOLDER", default_value = "auto")]
    text_encoder: EncoderChoice,
    /// Model of pictures and texts: its folder
    #[arg(long, value_name = "FOLDER")]
    image_encoder: Option<PathBuf>,
}

/// What is looked for: one of both.
#[derive(Debug, Args)]
#[group(required = true, multiple = false)]
struct Sought {
    /// Text, such as "the largest bone" or "everything but the skin"
    text: Option<String>,
    /// Picture of what is looked for: PNG of at most 3 MiB and 4096 pixels a side
    #[arg(long, value_name = "FILE.png", requires = "image_encoder")]
    picture: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub(crate) struct Describe {
    /// Scene: scene.toml or a Gaussian file
    scene: PathBuf,
}

/// Runs a subcommand. Exit status: 0 for success, 1 for no clear match, 2 for wrong input.
pub(crate) fn run(command: &Command) -> ExitCode {
    let outcome = match command {
        Command::Find(arguments) => find(arguments),
        Command::Describe(Describe { scene }) => OfflineScene::open(scene).and_then(|scene| describe(&scene.units)),
        Command::Retrieval(arguments) => retrieval::run(arguments).map(|()| ExitCode::SUCCESS),
    };
    outcome.unwrap_or_else(|message| {
        print::status(&format!("error: {message}"));
        ExitCode::from(2)
    })
}

/// Writes lines to standard output.
fn write(lines: &[String]) -> Result<(), String> {
    print::result(&lines.join("\n")).map_err(|e| format!("standard output: {e}"))
}

fn describe(units: &Units) -> Result<ExitCode, String> {
    let looks = units.queryable.looks();
    let line = |(at, name): (usize, &String)| format!("{name}: {}", describing(looks, at).join(", "));
    write(&units.names.iter().enumerate().map(line).collect::<Vec<_>>())?;
    Ok(ExitCode::SUCCESS)
}

fn find(arguments: &Find) -> Result<ExitCode, String> {
    let Find { scene, sought, text_encoder, image_encoder } = arguments;
    let scene = OfflineScene::open(scene)?;
    let embeddings = image_encoder.as_deref().map(embeddings_by).transpose()?.flatten();
    match (&sought.picture, &sought.text) {
        (Some(picture), _) => find_picture(&scene, picture, embeddings.as_deref()),
        (None, text) => find_text(&scene, text.as_deref().unwrap_or_default(), text_encoder, embeddings.as_deref()),
    }
}

/// Embeddings as a session makes them without other parameters, none yet.
fn embeddings_by(folder: &Path) -> Result<Option<Arc<UnitEmbeddings>>, String> {
    let image_encoder = ImageEncoderChoice::Folder(folder.to_path_buf());
    Params { image_encoder, ..Params::default() }.embeddings().map_err(|e| e.to_string())
}

fn find_text(
    scene: &OfflineScene,
    text: &str,
    encoder: &EncoderChoice,
    embeddings: Option<&UnitEmbeddings>,
) -> Result<ExitCode, String> {
    let names = &scene.units.names;
    let encoder = LabelEncoder::of(encoder).map_err(|e| e.to_string())?;
    if let Some(encoder) = &encoder {
        while encoder.encode_next(names).map_err(|e| e.to_string())? {}
    }
    let meaning = encoder.as_ref().map(|encoder| encoder.labelled(names));
    let pictures = embeddings.map(|embeddings| OfflinePictures::new(scene, embeddings));
    let context = QueryContext {
        meaning: meaning.as_ref().map(|meaning| meaning as &dyn LabelCosines),
        pictures: pictures.as_ref().map(|pictures| pictures as &dyn UnitPictures),
        ..QueryContext::default()
    };
    answer(&scene.units, scene.units.queryable.find_by(text, context), |candidates| {
        if candidates == 1 {
            "not sure: the text may mean this unit; say its name if it does"
        } else {
            "ambiguous: the text may mean any of these units; add a word that tells them apart"
        }
    })
}

fn find_picture(scene: &OfflineScene, path: &Path, embeddings: Option<&UnitEmbeddings>) -> Result<ExitCode, String> {
    let of_file = |problem: String| format!("{}: {problem}", path.display());
    let embeddings = embeddings.ok_or("a picture needs an image encoder; name its folder with --image-encoder")?;
    let bytes = file::read(path, query_png::MAX_BYTES as u64).map_err(|e| of_file(e.to_string()))?;
    let picture = query_png::decode(&bytes).map_err(|e| of_file(e.to_string()))?;
    scene.embed_into(embeddings);
    let found = picture_query::compare(&picture, &scene.units.names, embeddings).map_err(|e| of_file(e.to_string()))?;
    answer(&scene.units, found, |_| "pictures are compared, not understood: the first unit looks the most alike")
}

/// Writes an outcome. `question` says what a number of candidates means.
fn answer(units: &Units, outcome: Outcome, question: impl Fn(usize) -> &'static str) -> Result<ExitCode, String> {
    let line = |r: &Ranked| {
        let name = units.names.get(r.item).map_or("", String::as_str);
        format!("{name}\t{:.2}\t{}", r.score, r.explanation())
    };
    let lines = |ranked: &[Ranked]| write(&ranked.iter().map(line).collect::<Vec<_>>());
    match outcome {
        Outcome::Match { items } => {
            lines(&items)?;
            return Ok(ExitCode::SUCCESS);
        }
        Outcome::Ambiguous { candidates } => {
            lines(&candidates)?;
            print::status(question(candidates.len()));
        }
        Outcome::NothingMatches { why, .. } => print::status(&format!("nothing matches: {why}")),
    }
    Ok(ExitCode::from(1))
}

#[cfg(test)]
mod tests {
    use clap::{CommandFactory as _, Parser};
    use sg_encoders::Precision;

    use super::*;

    #[derive(Debug, Parser)]
    struct Line {
        #[command(subcommand)]
        command: Command,
    }

    fn parsed(words: &str) -> Result<Command, String> {
        let words = std::iter::once("labeling").chain(words.split(' '));
        Line::try_parse_from(words).map(|line| line.command).map_err(|e| e.to_string())
    }

    #[test]
    fn a_text_or_a_picture_is_looked_for() {
        Line::command().debug_assert();
        let Command::Find(find) = parsed("find scene.toml skull").unwrap() else { panic!("another command") };
        assert_eq!((find.sought.text.as_deref(), find.sought.picture), (Some("skull"), None));
        let words = "find scene.toml --picture a.png --image-encoder /m";
        let Command::Find(find) = parsed(words).unwrap() else { panic!("another command") };
        assert_eq!((find.sought.text, find.sought.picture), (None, Some("a.png".into())));
        assert!(parsed("find scene.toml skull --image-encoder /m").is_ok());
        for (words, problem) in [
            ("find scene.toml", "required"),
            ("find scene.toml --picture a.png", "--image-encoder"),
            ("find scene.toml skull --picture a.png --image-encoder /m", "cannot be used with"),
        ] {
            let error = parsed(words).unwrap_err();
            assert!(error.contains(problem), "{words}: {error}");
        }
    }

    #[test]
    fn a_measurement_names_scenes_and_a_model() {
        let Command::Retrieval(few) = parsed("retrieval a.toml b.toml --image-encoder /m").unwrap() else {
            panic!("another command")
        };
        assert_eq!((few.scenes.len(), few.views, few.image_precision, few.json), (2, 5, Precision::F32, false));
        for (words, problem) in [
            ("retrieval --image-encoder /m", "<SCENE>"),
            ("retrieval a.toml", "--image-encoder"),
            ("retrieval a.toml --image-encoder /m --views 13", "a number from 1 to 12"),
            ("retrieval a.toml --image-encoder /m --image-precision f64", "it must be f32, f16 or int8"),
        ] {
            let error = parsed(words).unwrap_err();
            assert!(error.contains(problem), "{words}: {error}");
        }
    }
}
