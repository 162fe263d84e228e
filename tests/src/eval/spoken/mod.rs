//! Commands by voice: what synthetic voices say, with noise, and what `supergaussian speech listen` makes of it.
//!
//! `supergaussian eval speech`. A command is right if its intent is that of the words that were said, so that the scene ends as it
//! would have by typing. Sentences are of three kinds: those that the recognizer expects, others that the grammar of the agents
//! understands when typed, and talk that is no command. The latter two were written before anything was recognised.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use sg_language::grammar::{interpret, parse, sample_observation};
use sg_language::spoken::{COMMANDS, slots};
use sg_proto::language::{Clause, IntentRequest, Observation};
use sg_speech::accuracy::edit_distance;
use sg_speech::audio::resample::resample;
use sg_speech::audio::wav::write_wav;
use sg_speech::audio::{Recording, SPEECH_RATE};
use sg_speech::child_process::Limits;
use sg_speech::phrases::PhraseGrammar;
use sg_speech::recognizer::Synthesizer;
use sg_speech::spoken::words;
use sg_speech::synthesis::{Espeak, Flite};

use super::EvalError;

/// Units of the scene that is spoken of.
pub const UNITS: [&str; 5] = ["sac", "vessel", "bone", "skin", "parent vessel"];
/// Voices: two of flite, and espeak-ng.
pub const VOICES: [&str; 3] = ["slt", "rms", "en-us"];
/// Silence before and behind a sentence, samples of 16 kHz.
const SILENCE: usize = 14_400;
/// Longest synthesis of a sentence.
const PATIENCE: Duration = Duration::from_secs(30);

/// What is measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Recognizers, as `supergaussian speech listen --recognizer` names them.
    pub recognizers: Vec<String>,
    /// Voices of [`VOICES`].
    pub voices: Vec<String>,
    /// Signal-to-noise ratios in dB; `None` is without noise.
    pub noise: Vec<Option<f64>>,
    /// Every so manyth sentence is spoken.
    pub every: usize,
    /// Seed of the noise.
    pub seed: u64,
    /// Folder of another Whisper model than the usual one.
    pub model: Option<PathBuf>,
    /// The executable of the speech service.
    pub executable: PathBuf,
}

/// Kind of a sentence.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// The recognizer expects it.
    Expected,
    /// The agents understand it when typed; the recognizer does not expect it.
    Paraphrase,
    /// No command.
    OffTopic,
}

/// A sentence that was not right, and what was made of it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Failure {
    /// What was said.
    pub said: String,
    /// What was recognised; several utterances are joined.
    pub text: String,
    /// Whether anything was taken as a command.
    pub is_command: bool,
}

/// One row: a recognizer, a voice, a noise and a kind of sentences.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// Recognizer.
    pub recognizer: String,
    /// Voice.
    pub voice: String,
    /// Signal-to-noise ratio, dB; absent without noise.
    pub snr_db: Option<f64>,
    /// Kind of the sentences.
    pub kind: Kind,
    /// Sentences.
    pub sentences: usize,
    /// Edits for each word that was said.
    pub word_error_rate: f64,
    /// Share with the right intent.
    pub right: f64,
    /// Share with another intent: of commands the wrong ones, of other talk the false ones.
    pub wrong: f64,
    /// Median time of a recognition, milliseconds.
    pub median_ms: f64,
    /// Time of recognition for each second of sound.
    pub real_time_factor: f64,
    /// All sentences that were not right.
    pub failures: Vec<Failure>,
}

/// A line of `supergaussian speech listen --json`.
#[derive(Debug, Deserialize)]
struct Line {
    file: String,
    command: bool,
    text: String,
    recognition_ms: f64,
}

fn wrong(path: &Path, why: impl std::fmt::Display) -> EvalError {
    EvalError::Data { path: path.display().to_string(), why: why.to_string() }
}

/// The clauses of a text without the words that they came from; none if it is not understood.
fn clauses(text: &str, scene: &Observation) -> Option<Vec<Clause>> {
    let request = IntentRequest { text: text.to_owned(), observation: Some(scene.clone()), ..IntentRequest::default() };
    let intent = interpret(&request).ok()?;
    // A question about the state of the scene is answered at once. What was heard is then compared as it was said.
    let intent = if intent.answer.is_empty() { intent } else { parse(text, scene).ok()? };
    let is_whole = !intent.clauses.is_empty() && intent.not_understood.is_empty();
    let plain = |mut clause: Clause| {
        clause.words.clear();
        clause
    };
    is_whole.then(|| intent.clauses.into_iter().map(plain).collect())
}

/// All sentences: two of each template that is expected, and the lists.
///
/// # Errors
/// [`EvalError::Data`]: a template that the recognizers do not take.
pub fn sentences() -> Result<Vec<(Kind, String)>, EvalError> {
    let scene = sample_observation(&UNITS);
    let state = scene.scene.clone().unwrap_or_default();
    let refused = |e: sg_speech::error::SpeechError| wrong(Path::new("templates"), e);
    let mut all = Vec::new();
    for (row, template) in COMMANDS.iter().flat_map(|command| command.templates).enumerate() {
        let mut grammar = PhraseGrammar::new();
        for (name, values) in slots(&state) {
            // Other values in each template.
            let turned = values.iter().cycle().skip(row % values.len().max(1)).take(values.len());
            grammar.set_slot(name, turned).map_err(refused)?;
        }
        grammar.add(template).map_err(refused)?;
        let sentences = grammar.sentences(5_000);
        let chosen = [sentences.len() / 3, 2 * sentences.len() / 3];
        let said = chosen.iter().filter_map(|at| sentences.get(*at)).map(|sentence| sentence.written.clone());
        all.extend(said.map(|sentence| (Kind::Expected, sentence)));
    }
    all.dedup();
    let lines = |text: &'static str| text.lines().map(str::trim).filter(|line| !line.is_empty());
    // Only what is understood when typed can be right.
    let typed = lines(include_str!("paraphrases.txt")).filter(|line| clauses(line, &scene).is_some());
    all.extend(typed.map(|line| (Kind::Paraphrase, line.to_owned())));
    all.extend(lines(include_str!("off-topic.txt")).map(|line| (Kind::OffTopic, line.to_owned())));
    Ok(all)
}

fn synthesizer(voice: &str) -> Result<Box<dyn Synthesizer>, EvalError> {
    let path = std::env::var_os("PATH");
    let found: Result<Box<dyn Synthesizer>, _> = if voice.starts_with("en") {
        Espeak::find(path.as_deref(), voice, 165).map(|espeak| Box::new(espeak) as _)
    } else {
        Flite::find(path.as_deref(), voice).map(|flite| Box::new(flite) as _)
    };
    found.map_err(|e| wrong(Path::new(voice), e))
}

/// A sentence between silence, at 16 kHz, in white noise.
fn sound(voice: &dyn Synthesizer, sentence: &str, noise: Option<f64>, seed: u64) -> Result<Recording, EvalError> {
    let refused = |e: &dyn std::fmt::Display| wrong(Path::new(sentence), e);
    let spoken = voice.synthesize(sentence, &Limits::within(PATIENCE)).map_err(|e| refused(&e))?;
    let spoken = resample(&spoken, SPEECH_RATE).map_err(|e| refused(&e))?;
    let power = spoken.samples.iter().map(|s| f64::from(s * s)).sum::<f64>() / spoken.samples.len().max(1) as f64;
    let silence = vec![0.0; SILENCE];
    let mut samples = [&silence[..], &spoken.samples, &silence].concat();
    if let Some(decibels) = noise {
        // Uniform noise of deviation d lies within d √3.
        let half = (3.0 * power / 10_f64.powf(decibels / 10.0)).sqrt() as f32;
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        samples.iter_mut().for_each(|s| *s = (*s + random.random_range(-1.0..=1.0) * half).clamp(-1.0, 1.0));
    }
    Ok(Recording { rate: SPEECH_RATE, samples })
}

/// Measures everything. `progress` gets a line about each part.
///
/// # Errors
/// [`EvalError`]: a voice or recognizer is not installed, or a file was not written.
pub fn run(options: &Options, progress: &dyn Fn(&str)) -> Result<Vec<Row>, EvalError> {
    let said: Vec<(Kind, String)> = sentences()?.into_iter().step_by(options.every.max(1)).collect();
    let mut rows = Vec::new();
    for voice in &options.voices {
        let synthesizer = synthesizer(voice)?;
        for noise in &options.noise {
            let folder = tempfile::tempdir().map_err(|e| wrong(&std::env::temp_dir(), e))?;
            let name = |at: usize| folder.path().join(format!("{at:04}.wav"));
            let seconds: Vec<f64> = said
                .par_iter()
                .enumerate()
                .map(|(at, (_, sentence))| {
                    let sound = sound(&*synthesizer, sentence, *noise, options.seed + at as u64)?;
                    write_wav(&name(at), &sound).map_err(|e| wrong(&name(at), e))?;
                    Ok((sound.samples.len() - 2 * SILENCE) as f64 / f64::from(SPEECH_RATE))
                })
                .collect::<Result<_, EvalError>>()?;
            for recognizer in &options.recognizers {
                let files: Vec<PathBuf> = (0..said.len()).map(name).collect();
                let model = options.model.as_deref().filter(|_| recognizer == "whisper");
                let lines = listen(&options.executable, recognizer, model, &files)?;
                let name =
                    model.and_then(Path::file_name).map_or(recognizer.as_str().into(), |name| name.to_string_lossy());
                let recognizer = &*name;
                rows.extend(tally(&said, &seconds, &files, &lines, (recognizer, voice, *noise)));
                let noise = noise.map_or_else(|| "clean".to_owned(), |db| format!("{db} dB"));
                progress(&format!("{recognizer}, {voice}, {noise}: {} sentences", said.len()));
            }
        }
    }
    Ok(rows)
}

/// Runs the recognizer over files.
fn listen(
    executable: &Path,
    recognizer: &str,
    model: Option<&Path>,
    files: &[PathBuf],
) -> Result<Vec<Line>, EvalError> {
    let mut command = Command::new(executable);
    command.args(["listen", "--json", "--recognizer", recognizer]);
    if let Some(model) = model {
        command.arg("--model").arg(model);
    }
    command.args(UNITS.iter().flat_map(|unit| ["--unit", unit]));
    let output = command.args(files).stdin(Stdio::null()).output().map_err(|e| wrong(executable, e))?;
    if !matches!(output.status.code(), Some(0 | 1)) {
        return Err(wrong(executable, String::from_utf8_lossy(&output.stderr).trim()));
    }
    let lines = String::from_utf8_lossy(&output.stdout);
    lines
        .lines()
        .map(|line| serde_json::from_str(line).map_err(|e| wrong(executable, format!("{e}: {line}"))))
        .collect()
}

fn tally(
    said: &[(Kind, String)],
    seconds: &[f64],
    files: &[PathBuf],
    lines: &[Line],
    (recognizer, voice, noise): (&str, &str, Option<f64>),
) -> Vec<Row> {
    let scene = sample_observation(&UNITS);
    let mut of_file: BTreeMap<&str, Vec<&Line>> = BTreeMap::new();
    lines.iter().for_each(|line| of_file.entry(line.file.as_str()).or_default().push(line));
    let kinds = [Kind::Expected, Kind::Paraphrase, Kind::OffTopic];
    let row_of = |kind: Kind| {
        let mut row = Row {
            recognizer: recognizer.to_owned(),
            voice: voice.to_owned(),
            snr_db: noise,
            kind,
            sentences: 0,
            word_error_rate: 0.0,
            right: 0.0,
            wrong: 0.0,
            median_ms: 0.0,
            real_time_factor: 0.0,
            failures: Vec::new(),
        };
        let (mut errors, mut spoken_words, mut right, mut wrong) = (0, 0, 0, 0);
        let (mut times, mut length) = (Vec::new(), 0.0);
        for ((_, sentence), (seconds, file)) in
            said.iter().zip(seconds.iter().zip(files)).filter(|((k, _), _)| *k == kind)
        {
            let heard = of_file.get(file.display().to_string().as_str()).map_or(&[][..], |lines| lines);
            let text = heard.iter().map(|line| line.text.as_str()).collect::<Vec<_>>().join(" ");
            let commands: Vec<&str> = heard.iter().filter(|line| line.command).map(|line| line.text.as_str()).collect();
            let is_right = match (kind, &commands[..]) {
                (Kind::OffTopic, []) => true,
                (Kind::Expected | Kind::Paraphrase, [one]) => {
                    let same = clauses(one, &scene);
                    same.is_some() && same == clauses(sentence, &scene)
                }
                _ => false,
            };
            row.sentences += 1;
            errors += edit_distance(&words(sentence), &words(&text));
            spoken_words += words(sentence).len();
            right += usize::from(is_right);
            wrong += usize::from(!is_right && !commands.is_empty());
            times.push(heard.iter().map(|line| line.recognition_ms).sum::<f64>());
            length += seconds;
            if !is_right {
                let said = sentence.clone();
                row.failures.push(Failure { said, text, is_command: !commands.is_empty() });
            }
        }
        let share = |part: usize, whole: usize| if whole == 0 { 0.0 } else { part as f64 / whole as f64 };
        row.word_error_rate = share(errors, spoken_words);
        (row.right, row.wrong) = (share(right, row.sentences), share(wrong, row.sentences));
        row.real_time_factor = if length > 0.0 { times.iter().sum::<f64>() / 1e3 / length } else { 0.0 };
        times.sort_by(f64::total_cmp);
        row.median_ms = times.get(times.len() / 2).copied().unwrap_or_default();
        row
    };
    kinds.into_iter().map(row_of).filter(|row| row.sentences > 0).collect()
}

/// The table as Markdown.
#[must_use]
pub fn markdown(rows: &[Row]) -> String {
    let mut out = String::from(
        "| recognizer | voice | noise | sentences | number | word errors | right | wrong or false | ms, median | real-time factor |\n\
         | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    for row in rows {
        let noise = row.snr_db.map_or_else(|| "none".to_owned(), |db| format!("{db} dB"));
        let kind = match row.kind {
            Kind::Expected => "expected",
            Kind::Paraphrase => "in other words",
            Kind::OffTopic => "off topic",
        };
        let percent = |share: f64| format!("{:.1} %", 100.0 * share);
        let _ = writeln!(
            out,
            "| {} | {} | {noise} | {kind} | {} | {} | {} | {} | {:.0} | {:.2} |",
            row.recognizer,
            row.voice,
            row.sentences,
            percent(row.word_error_rate),
            percent(row.right),
            percent(row.wrong),
            row.median_ms,
            row.real_time_factor,
        );
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_are_enough_sentences_of_each_kind() {
        let all = sentences().unwrap();
        let count = |kind| all.iter().filter(|(k, _)| *k == kind).count();
        let counts = [Kind::Expected, Kind::Paraphrase, Kind::OffTopic].map(count);
        assert!(counts[0] >= 100 && counts[1] >= 60 && counts[2] >= 150, "{counts:?}");
        // No talk is a command for the agents, so that what becomes one was misheard.
        let scene = sample_observation(&UNITS);
        let commands: Vec<_> =
            all.iter().filter(|(kind, text)| *kind == Kind::OffTopic && clauses(text, &scene).is_some()).collect();
        assert_eq!(commands, Vec::<&(Kind, String)>::new());
    }

    #[test]
    fn rows_count_what_was_right_wrong_and_false() {
        let said: Vec<(Kind, String)> = [
            (Kind::Expected, "hide the sac"),
            (Kind::Expected, "hide the bone"),
            (Kind::Expected, "undo"),
            (Kind::OffTopic, "what a nice day"),
            (Kind::OffTopic, "good morning everybody"),
        ]
        .map(|(kind, text)| (kind, text.to_owned()))
        .to_vec();
        let files: Vec<PathBuf> = (0..5).map(|k| PathBuf::from(k.to_string())).collect();
        let line = |file: &str, command, text: &str| Line {
            file: file.to_owned(),
            command,
            text: text.to_owned(),
            recognition_ms: 500.0,
        };
        let lines = [
            line("0", true, "Hide the sac."),
            line("1", true, "hide the skin"),
            line("3", false, "What a nice day."),
            line("4", true, "undo"),
        ];
        let rows = tally(&said, &[1.0; 5], &files, &lines, ("whisper", "slt", None));
        let shares: Vec<_> = rows.iter().map(|row| (row.kind, row.sentences, row.right, row.wrong)).collect();
        let third = 1.0 / 3.0;
        assert_eq!(shares, [(Kind::Expected, 3, third, third), (Kind::OffTopic, 2, 0.5, 0.5)]);
        assert_eq!(rows[0].failures.len(), 2);
        // "bone" became "skin", and "undo" nothing: two edits of seven words.
        assert!((rows[0].word_error_rate - 2.0 / 7.0).abs() < 1e-9 && (rows[0].real_time_factor - third).abs() < 1e-9);
        assert_eq!(markdown(&rows).lines().count(), 4);
    }
}
