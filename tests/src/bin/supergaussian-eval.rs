//! `supergaussian-eval`: the evaluation tables.

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a command writes to the terminal")]

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use clap::{Args, Parser, Subcommand};
use sg_clusters::clustering::Level;
use sg_formats::staged_file;
use sg_input::print;
use sg_tests::eval::{EvalError, Options, ablation, language, one_stroke, peers, plots, report, spoken};

/// Evaluation tables: the worth of the choices behind a result, on scenes whose truth is known
#[derive(Debug, Parser)]
#[command(name = "supergaussian-eval", version)]
struct Arguments {
    #[command(subcommand)]
    table: Table,
}

#[derive(Debug, Subcommand)]
enum Table {
    /// Clusterings, graphs, walks and backgrounds compared on made shapes, and on measured label maps
    ///
    /// Writes ablation.json (every number, with units in the keys), ablation.md (the tables) and plots as SVG. The same
    /// seed gives the same numbers, apart from times.
    ///
    /// Example: supergaussian eval selection-ablation --out ablation --quick
    #[command(verbatim_doc_comment)]
    SelectionAblation(Ablation),
    /// What one green stroke means: every part of many scenes as its target, answered at every scale
    ///
    /// Writes one-stroke.md (the tables), one-stroke.json (the same numbers) and strokes.json (every stroke with its masks'
    /// sizes and IoU over the leaks). The same seed gives the same numbers.
    ///
    /// Example: supergaussian eval one-stroke --out one-stroke --quick
    #[command(verbatim_doc_comment)]
    OneStroke(OneStroke),
    /// Commands by voice: synthetic voices with noise, and what the recognizers make of them
    ///
    /// Writes speech.md (the table) and speech.json (the same numbers, and each sentence that was not right). Needs flite,
    /// espeak-ng, and what recognises: pocketsphinx or the model of ops/models.sh.
    ///
    /// Example: supergaussian eval speech --out speech --quick
    #[command(verbatim_doc_comment)]
    Speech(Speech),
    /// Commands by words: what people say, and the state in which the scene ends
    ///
    /// Plays two sets of 240 utterances each through a stack of the headless launch file. Their authors had not seen how the program reads
    /// language. Writes language.md (the table) and language.json (each utterance with its replies and what does not hold).
    ///
    /// Example: supergaussian eval language --out language --quick
    #[command(verbatim_doc_comment)]
    Language(Language),
    /// Our side of tests/peers/compare.py: clusters a made scene, hands it over as arrays, prints our times as JSON
    ///
    /// Example: supergaussian eval peer clusters --gaussians 400000 --threads 2 --out there
    #[command(verbatim_doc_comment)]
    Peer(Peer),
}

#[derive(Debug, Args)]
struct Peer {
    /// What is timed
    what: Timed,
    /// The folder to write to; it is made
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Gaussians of the scene
    #[arg(long, default_value_t = 100_000, value_name = "N")]
    gaussians: usize,
    /// The made shape
    #[arg(long, default_value = "chameleon", value_name = "NAME")]
    shape: String,
    /// Threads to work on
    #[arg(long, default_value_t = 1, value_name = "T")]
    threads: usize,
    /// The fast level of clustering
    #[arg(long)]
    fast: bool,
    /// Cluster and walk in so many scenes one after another and print the resident memory after each
    #[arg(long, value_name = "SCENES")]
    again: Option<usize>,
    /// Write no arrays but the labels
    #[arg(long)]
    no_arrays: bool,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum Timed {
    /// Features, neighbour graph and clusters
    Clusters,
    /// Walks on clusters and on Gaussians
    Walks,
}

#[derive(Debug, Args)]
struct Language {
    /// The folder to write to; it is made
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Every eighth utterance
    #[arg(long)]
    quick: bool,
    /// A set of yours in place of those that come with the program; may be given several times
    #[arg(long = "utterances", value_name = "FILE")]
    sets: Vec<PathBuf>,
    /// A setting of the stack, such as a backend of an agent; may be given several times
    #[arg(long = "set", value_name = "KEY=VALUE")]
    settings: Vec<String>,
}

#[derive(Debug, Args)]
struct Speech {
    /// The folder to write to; it is made
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Every eighth sentence, without noise and at 10 dB
    #[arg(long)]
    quick: bool,
    /// Only these recognizers
    #[arg(long, value_name = "NAME,…", value_delimiter = ',', default_value = "whisper,sphinx")]
    recognizers: Vec<String>,
    /// Only these voices
    #[arg(long, value_name = "NAME,…", value_delimiter = ',', default_value = "slt,rms,en-us")]
    voices: Vec<String>,
    /// Signal-to-noise ratios of white noise, dB, or `clean`
    #[arg(long, value_name = "DB,…", value_delimiter = ',', default_value = "clean,20,10,5")]
    noise: Vec<String>,
    /// Every so manyth sentence
    #[arg(long, default_value_t = 1, value_name = "N")]
    every: usize,
    /// Seed of the noise
    #[arg(long, default_value_t = 1, value_name = "K")]
    seed: u64,
    /// Folder of another Whisper model than the one of ops/models.sh
    #[arg(long, value_name = "FOLDER")]
    model: Option<PathBuf>,
}

#[derive(Debug, Args)]
struct OneStroke {
    /// The folder to write to; it is made
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Small scenes and few strokes: some seconds
    #[arg(long)]
    quick: bool,
    /// The scenes on which the rule's numbers were chosen, and not those that are reported
    #[arg(long)]
    tuning: bool,
    /// Gaussians of a made scene; measured scenes have twice as many
    #[arg(long, default_value_t = 30_000, value_name = "N")]
    gaussians: usize,
    /// Strokes of each length on each part
    #[arg(long, default_value_t = 8, value_name = "N")]
    strokes: usize,
    /// Seed of shapes and strokes
    #[arg(long, default_value_t = 1, value_name = "K")]
    seed: u64,
    /// The folder of measured data; without it made shapes alone are evaluated
    #[arg(long, env = "SUPERGAUSSIAN_DATA", value_name = "DIR")]
    data: Option<PathBuf>,
}

#[derive(Debug, Args)]
struct Ablation {
    /// The folder to write to; it is made
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Two small shapes and few strokes: some seconds
    #[arg(long)]
    quick: bool,
    /// Seed of shapes and strokes
    #[arg(long, default_value_t = 1, value_name = "K")]
    seed: u64,
    /// The folder of measured data; without it made shapes alone are evaluated
    #[arg(long, env = "SUPERGAUSSIAN_DATA", value_name = "DIR")]
    data: Option<PathBuf>,
    /// Only these shapes: the five that are reported, or knot and coral, on which numbers are chosen
    #[arg(long, value_name = "NAME,…", value_delimiter = ',')]
    shapes: Option<Vec<String>>,
    /// Print the numbers to standard output as JSON, too
    #[arg(long)]
    json: bool,
}

fn main() -> ExitCode {
    let done = match Arguments::parse().table {
        Table::SelectionAblation(arguments) => selection_ablation(&arguments),
        Table::OneStroke(arguments) => one_stroke(&arguments),
        Table::Speech(arguments) => speech(&arguments),
        Table::Language(arguments) => language(&arguments),
        Table::Peer(arguments) => peer(&arguments),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            print::status(&format!("error: {error}"));
            let wrong = matches!(error, EvalError::Data { .. } | EvalError::Shape(_));
            ExitCode::from(if wrong { 2 } else { 1 })
        }
    }
}

/// The folder of a command's files. It is made before the work, so that the work is not done in vain. If the work fails before
/// anything is written, the folders that were made go again.
struct Output<'a> {
    folder: &'a Path,
    /// The folders that were made, the innermost first.
    made: Vec<&'a Path>,
}

impl<'a> Output<'a> {
    /// Refuses a folder in which something else has one of these names, and makes the folder.
    fn open(folder: &'a Path, names: &[&str]) -> Result<Self, EvalError> {
        let files: Vec<PathBuf> = names.iter().map(|name| folder.join(name)).collect();
        let refused =
            |e: staged_file::OutputError| EvalError::Data { path: e.path.display().to_string(), why: e.reason };
        staged_file::check_outputs(files.iter().map(PathBuf::as_path), []).map_err(refused)?;
        let is_absent = |folder: &&Path| !folder.as_os_str().is_empty() && !folder.exists();
        let output = Self { folder, made: folder.ancestors().take_while(is_absent).collect() };
        std::fs::create_dir_all(folder).map_err(written(folder))?;
        Ok(output)
    }

    /// Writes a file, whole or not at all.
    fn write(&self, name: &str, text: &str) -> Result<(), EvalError> {
        let path = self.folder.join(name);
        staged_file::replace(&path, text.as_bytes()).map_err(written(&path))
    }
}

impl Drop for Output<'_> {
    fn drop(&mut self) {
        // The system removes no folder that holds something.
        for folder in &self.made {
            if std::fs::remove_dir(folder).is_err() {
                break;
            }
        }
    }
}

/// The error of writing to a path.
fn written(path: &Path) -> impl Fn(std::io::Error) -> EvalError {
    let path = path.display().to_string();
    move |source| EvalError::Write { path: path.clone(), source }
}

/// Refuses measured data that are not there, before the work.
fn must_be_folder(data: Option<&Path>) -> Result<(), EvalError> {
    match data.filter(|folder| !folder.is_dir()) {
        Some(folder) => Err(EvalError::Data { path: folder.display().to_string(), why: "no such folder".to_owned() }),
        None => Ok(()),
    }
}

fn peer(arguments: &Peer) -> Result<(), EvalError> {
    let wrong = |why: String| EvalError::Data { path: arguments.out.display().to_string(), why };
    let output =
        Output::open(&arguments.out, &["labels.npy", "position.npy", "features.npy", "seeds.npy", "cell.npy"])?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(arguments.threads).build();
    let pool = pool.map_err(|e| wrong(e.to_string()))?;
    let print = |report: serde_json::Result<String>| println!("{}", report.unwrap_or_default());
    let subject = pool.install(|| peers::scene(&arguments.shape, arguments.gaussians, 1))?;
    let folder = output.folder;
    let level = if arguments.fast { Level::Fast } else { Level::Exact };
    match (arguments.what, arguments.again) {
        (Timed::Walks, _) => {
            print(serde_json::to_string(&pool.install(|| peers::walk_times(&subject, folder, 51))?));
        }
        (Timed::Clusters, None) => {
            let export = !arguments.no_arrays;
            let times = pool.install(|| peers::cluster_times(&subject, level, folder, export))?;
            print(serde_json::to_string(&times));
        }
        (Timed::Clusters, Some(scenes)) => {
            drop(subject);
            for number in 0..scenes {
                pool.install(|| {
                    let subject = peers::scene(&arguments.shape, arguments.gaussians, number as u64)?;
                    peers::cluster_times(&subject, level, folder, false)?;
                    peers::walk_times(&subject, folder, 1)
                })?;
                println!("{}", serde_json::json!({"scene": number, "resident_bytes": peers::memory("VmRSS:")}));
            }
        }
    }
    Ok(())
}

fn language(arguments: &Language) -> Result<(), EvalError> {
    let output = Output::open(&arguments.out, &["language.json", "language.md"])?;
    let tell = |line: &str| eprintln!("eval language: {line}");
    let options = language::Options {
        sets: arguments.sets.clone(),
        settings: arguments.settings.clone(),
        every: if arguments.quick { 8 } else { 1 },
    };
    let measured = language::run(&options, &tell)?;
    let table = language::markdown(&measured);
    let json = serde_json::to_string_pretty(&measured).unwrap_or_default() + "\n";
    output.write("language.json", &json)?;
    output.write("language.md", &table)?;
    print!("{table}");
    tell(&format!("written to {}", arguments.out.display()));
    Ok(())
}

fn speech(arguments: &Speech) -> Result<(), EvalError> {
    let decibels = |text: &String| match text.as_str() {
        "clean" => Ok(None),
        number => number.parse::<f64>().ok().filter(|db| db.is_finite()).map(Some).ok_or_else(|| EvalError::Data {
            path: "--noise".to_owned(),
            why: format!("`{number}` is neither a number of decibels nor `clean`"),
        }),
    };
    let noise = arguments.noise.iter().map(decibels).collect::<Result<Vec<_>, _>>()?;
    let executable = std::env::current_exe().map_err(written(Path::new("supergaussian-eval")))?;
    let options = spoken::Options {
        recognizers: arguments.recognizers.clone(),
        voices: arguments.voices.clone(),
        noise: if arguments.quick { vec![None, Some(10.0)] } else { noise },
        every: if arguments.quick { 8 } else { arguments.every },
        seed: arguments.seed,
        model: arguments.model.clone(),
        executable: executable.with_file_name("supergaussian-speech"),
    };
    let output = Output::open(&arguments.out, &["speech.json", "speech.md"])?;
    let start = Instant::now();
    let tell = |what: &str| eprintln!("{:7.1} s  {what}", start.elapsed().as_secs_f64());
    let rows = spoken::run(&options, &tell)?;
    let table = spoken::markdown(&rows);
    let json = serde_json::to_string_pretty(&rows).unwrap_or_default() + "\n";
    output.write("speech.json", &json)?;
    output.write("speech.md", &table)?;
    print!("{table}");
    tell(&format!("written to {}", arguments.out.display()));
    Ok(())
}

fn one_stroke(arguments: &OneStroke) -> Result<(), EvalError> {
    let options = one_stroke::Options {
        tuning: arguments.tuning,
        gaussians: if arguments.quick { 4000 } else { arguments.gaussians },
        strokes: if arguments.quick { 2 } else { arguments.strokes },
        clicks: true,
        seed: arguments.seed,
        data: arguments.data.clone().filter(|_| !arguments.quick),
    };
    must_be_folder(options.data.as_deref())?;
    let output = Output::open(&arguments.out, &["strokes.json", "one-stroke.json", "one-stroke.md"])?;
    let start = Instant::now();
    let tell = |what: &str| eprintln!("{:7.1} s  {what}", start.elapsed().as_secs_f64());
    let played = one_stroke::run(&options, &tell)?;
    let tables = one_stroke::tables(&played, options.seed);
    let json = |text: serde_json::Result<String>| text.unwrap_or_default() + "\n";
    for (name, text) in [
        ("strokes.json", json(serde_json::to_string(&played))),
        ("one-stroke.json", json(serde_json::to_string_pretty(&tables))),
        ("one-stroke.md", one_stroke::markdown(&tables)),
    ] {
        output.write(name, &text)?;
    }
    tell(&format!("written to {}", arguments.out.display()));
    Ok(())
}

fn selection_ablation(arguments: &Ablation) -> Result<(), EvalError> {
    let mut options = if arguments.quick { Options::quick(arguments.seed) } else { Options::full(arguments.seed) };
    // The short form is about relations that hold on any scene.
    options.data = arguments.data.clone().filter(|_| !arguments.quick);
    must_be_folder(options.data.as_deref())?;
    if let Some(shapes) = &arguments.shapes {
        options.shapes.clone_from(shapes);
    }
    let output = Output::open(&arguments.out, &["ablation.json", "ablation.md"])?;
    let start = Instant::now();
    let tell = |what: &str| eprintln!("{:7.1} s  {what}", start.elapsed().as_secs_f64());
    let measured = ablation::run(&options, &tell)?;
    let json = serde_json::to_string_pretty(&measured).unwrap_or_default() + "\n";
    output.write("ablation.json", &json)?;
    output.write("ablation.md", &report::markdown(&measured, false))?;
    plots::draw(&measured, output.folder)?;
    tell(&format!("written to {}", arguments.out.display()));
    if arguments.json {
        print!("{json}");
    }
    Ok(())
}
