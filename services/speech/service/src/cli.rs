//! The offline subcommands: arguments and output.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use clap::{Args, Subcommand};
use sg_input::print;
use sg_language::grammar::sample_observation;
use sg_speech::audio::resample::resample;
use sg_speech::audio::sink::WavSink;
use sg_speech::audio::wav::{MAX_DURATION, read_wav};
use sg_speech::audio::{SPEECH_RATE, duration_of};
use sg_speech::child_process::Limits;
use sg_speech::endpoint::{Endpoint, EndpointSettings, Endpointer};
use sg_speech::recognizer::{Recognition, TimedText};
use sg_speech::sentences::sentences;
use sg_speech::speaker::speak;
use sg_speech::vad::GatedDetector;
use tokio::runtime::Runtime;

use crate::backends::{self, Chosen};
use crate::commands;
use crate::devices;
use crate::params::{BackendParams, RecognizerChoice, SynthesizerChoice};
use crate::remote::ServerParams;

/// Longest work of one command.
const LONGEST: Duration = Duration::from_secs(600);
/// Samples a second of a spoken text.
const RATE: u32 = 22_050;

/// Subcommands that work on files alone.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Recognises the commands in WAV files.
    ///
    /// Each line is an utterance: "command" or "no command", the confidence, and the text; of several files the file too. Exit
    /// status 1: no command was recognised.
    ///
    /// Example: supergaussian speech listen command.wav --unit sac --unit vessel
    Listen(Listen),
    /// Speaks a text into a WAV file.
    ///
    /// Example: supergaussian speech speak "The sac is hidden." --out reply.wav
    Speak(Speak),
    /// Lists the microphones and loudspeakers of this machine.
    ///
    /// Each line has "input" or "output", the name for the parameters `input` and `output` behind `device:`, and a description.
    ///
    /// Example: supergaussian speech devices
    Devices,
}

#[derive(Debug, Args)]
pub(crate) struct Listen {
    /// WAV files of at most 10 minutes each
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Name of a unit that commands may have; repeat it for more
    #[arg(long = "unit", value_name = "NAME")]
    units: Vec<String>,
    /// Recognizer
    #[arg(long, value_enum, default_value = "auto")]
    recognizer: RecognizerChoice,
    #[command(flatten)]
    server: ServerArgs,
    /// Folder of a Whisper model, in the layout of Hugging Face or CTranslate2
    #[arg(long, value_name = "FOLDER")]
    model: Option<PathBuf>,
    /// Code of the spoken language; with `auto` a model of many languages finds it out
    #[arg(long, default_value = "en")]
    language: String,
    /// Print each utterance as JSON, with its begin and the time of its recognition
    #[arg(long)]
    json: bool,
    /// Add the begin and end of each part of the text, in seconds
    #[arg(long)]
    times: bool,
}

#[derive(Debug, Args)]
pub(crate) struct Speak {
    /// Text of at most 4000 bytes
    text: String,
    /// WAV file to write
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Synthesizer
    #[arg(long, value_enum, default_value = "auto")]
    synthesizer: SynthesizerChoice,
    #[command(flatten)]
    server: ServerArgs,
    /// Folder of a Piper voice: NAME.onnx and NAME.onnx.json
    #[arg(long, value_name = "FOLDER")]
    voice_model: Option<PathBuf>,
    /// Voice, as the synthesizer names it, such as `en-us` or `slt`; of Piper the speaker
    #[arg(long, default_value = "")]
    voice: String,
}

/// A server of the backends `openai` and `grpc`.
#[derive(Debug, Args)]
struct ServerArgs {
    /// Address of the server of `openai` or `grpc`, such as `http://127.0.0.1:8000/v1`
    #[arg(long, value_name = "ADDRESS", default_value = "")]
    endpoint: String,
    /// Model of that server, such as `whisper-1`
    #[arg(long, value_name = "NAME", default_value = "")]
    server_model: String,
    /// Name of the environment variable with the key of that server
    #[arg(long, value_name = "VARIABLE")]
    key_env: Option<String>,
    /// Let data go to another machine unencrypted
    #[arg(long)]
    insecure: bool,
}

impl ServerArgs {
    /// The server of a backend. `is_server`: whether the backend is one. `backend`: the option that chooses the backend.
    fn params(&self, is_server: bool, backend: &str) -> Result<ServerParams, String> {
        let given = [
            ("--endpoint", !self.endpoint.is_empty()),
            ("--server-model", !self.server_model.is_empty()),
            ("--key-env", self.key_env.is_some()),
            ("--insecure", self.insecure),
        ];
        if let Some((option, _)) = given.iter().find(|(_, is_given)| *is_given && !is_server) {
            return Err(format!("{option} describes a server; add {backend} openai or {backend} grpc"));
        }
        Ok(ServerParams {
            endpoint: self.endpoint.clone(),
            model: self.server_model.clone(),
            key_env: self.key_env.clone(),
            insecure: self.insecure,
            timeout: None,
        })
    }
}

/// The message of a backend, with the options of the command line in place of the parameters of a launch file.
fn as_options(message: String) -> String {
    let of_server = message.split_once("_server`: ").map(|(_, of_server)| of_server.to_owned());
    let model = if of_server.is_some() { "--server-model" } else { "--model" };
    let options = [
        ("`endpoint`", "--endpoint"),
        ("`model`", model),
        ("`key_env`", "--key-env"),
        ("`insecure = true`", "--insecure"),
        ("`voice_model`", "--voice-model"),
        ("`voice`", "--voice"),
        ("`language`", "--language"),
    ];
    let message = of_server.unwrap_or(message);
    options.iter().fold(message, |text, (parameter, option)| text.replace(parameter, option))
}

/// The runtime of requests to servers.
fn runtime() -> Result<Runtime, String> {
    tokio::runtime::Builder::new_multi_thread()
        .worker_threads(1)
        .enable_all()
        .build()
        .map_err(|e| format!("no runtime for requests: {e}"))
}

/// Runs a subcommand. Exit status: 0 for success, 1 for no command, 2 for wrong input.
pub(crate) fn run(command: &Command) -> ExitCode {
    let outcome = match command {
        Command::Listen(arguments) => listen(arguments),
        Command::Speak(arguments) => say(arguments).map(|()| ExitCode::SUCCESS),
        Command::Devices => devices::names().and_then(|names| {
            print::result(&names.join("\n")).map_err(|e| format!("standard output: {e}"))?;
            Ok(ExitCode::SUCCESS)
        }),
    };
    outcome.unwrap_or_else(|message| {
        print::status(&format!("error: {message}"));
        ExitCode::from(2)
    })
}

fn listen(arguments: &Listen) -> Result<ExitCode, String> {
    let params = BackendParams {
        recognizer: arguments.recognizer,
        recognizer_server: arguments.server.params(arguments.recognizer.is_server(), "--recognizer")?,
        model: arguments.model.clone(),
        language: arguments.language.clone(),
        times: arguments.times,
        ..BackendParams::default()
    };
    let runtime = runtime()?;
    let Chosen { backend: recognizer, notice, .. } =
        backends::recognizer(&params, runtime.handle()).map_err(as_options)?;
    let Some(mut recognizer) = recognizer else {
        return Err(notice.unwrap_or_else(|| "no recognizer; choose one by --recognizer".to_owned()));
    };
    if let Some(notice) = notice {
        print::status(&notice);
    }
    let names: Vec<&str> = arguments.units.iter().map(String::as_str).collect();
    let scene = sample_observation(&names).scene.unwrap_or_default();
    let expected = commands::expected(&scene, false).map_err(|e| e.to_string())?;
    let limits = Limits::within(LONGEST);
    if let Some(notice) = recognizer.prepare(&expected, &limits).map_err(|e| e.to_string())? {
        print::status(&notice);
    }
    let mut is_command = false;
    for file in &arguments.files {
        for (start, samples) in utterances(file)? {
            let limits = Limits::within(LONGEST);
            let heard = recognizer.recognize(&samples, &expected, &limits).map_err(|e| e.to_string())?;
            let mut heard = commands::with_acceptance(heard, &scene, false);
            if arguments.times && heard.parts.is_empty() && !heard.text.is_empty() {
                // A recognizer without times heard it somewhere in the utterance.
                let end = duration_of(samples.len(), SPEECH_RATE);
                heard.parts.push(TimedText { text: heard.text.clone(), start: Duration::ZERO, end });
            }
            is_command |= heard.accepted;
            let line = line_of(file, start, &heard, arguments);
            print::result(&line).map_err(|e| format!("standard output: {e}"))?;
        }
    }
    if !is_command {
        print::status("no command was recognised");
    }
    Ok(if is_command { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

/// The utterances of a file with their begins in samples of 16 kHz.
fn utterances(file: &Path) -> Result<Vec<(u64, Vec<f32>)>, String> {
    let recording = read_wav(file, MAX_DURATION).map_err(|e| e.to_string())?;
    let recording = resample(&recording, SPEECH_RATE).map_err(|e| format!("{}: {e}", file.display()))?;
    let whole =
        EndpointSettings { pause: Duration::ZERO, partial_period: Duration::ZERO, ..EndpointSettings::default() };
    let mut endpointer = Endpointer::new(Box::new(GatedDetector::default()), whole);
    let mut events = endpointer.step(&recording.samples);
    events.extend(endpointer.finish());
    let utterances = events.into_iter().filter_map(|event| match event {
        Endpoint::SpeechEnded { start, samples, .. } => Some((start, samples)),
        _ => None,
    });
    Ok(utterances.collect())
}

fn line_of(file: &Path, start: u64, heard: &Recognition, arguments: &Listen) -> String {
    let start = start as f64 / f64::from(SPEECH_RATE);
    // Times count from the begin of the file.
    let parts = heard.parts.iter().map(|part| {
        let [from, to] = [part.start, part.end].map(|time| start + time.as_secs_f64());
        (from, to, part.text.as_str())
    });
    if arguments.json {
        let mut line = serde_json::json!({
            "file": file.display().to_string(),
            "start_s": start,
            "command": heard.accepted,
            "confidence": heard.confidence,
            "text": heard.text,
            "recognition_ms": heard.elapsed.as_secs_f64() * 1e3,
        });
        if arguments.times {
            line["parts"] =
                parts.map(|(from, to, text)| serde_json::json!({"start_s": from, "end_s": to, "text": text})).collect();
        }
        return line.to_string();
    }
    let kind = if heard.accepted { "command" } else { "no command" };
    let mut line = format!("{kind}\t{:.2}\t{}", heard.confidence, heard.text);
    if arguments.times {
        let parts: Vec<String> = parts.map(|(from, to, text)| format!("{from:.2}-{to:.2} {text}")).collect();
        line.push('\t');
        line.push_str(&parts.join(", "));
    }
    if arguments.files.len() == 1 { line } else { format!("{}\t{line}", file.display()) }
}

fn say(arguments: &Speak) -> Result<(), String> {
    if arguments.voice_model.is_some() && !arguments.synthesizer.takes_voice_model() {
        return Err("--voice-model is the folder of a Piper voice; add --synthesizer piper".to_owned());
    }
    let params = BackendParams {
        synthesizer: arguments.synthesizer,
        synthesizer_server: arguments.server.params(arguments.synthesizer.is_server(), "--synthesizer")?,
        voice_model: arguments.voice_model.clone(),
        voice: arguments.voice.clone(),
        ..BackendParams::default()
    };
    let runtime = runtime()?;
    let Chosen { backend: synthesizer, notice, .. } =
        backends::synthesizer(&params, runtime.handle()).map_err(as_options)?;
    let synthesizer = synthesizer
        .ok_or_else(|| notice.unwrap_or_else(|| "no synthesizer; choose one by --synthesizer".to_owned()))?;
    let all = sentences(&arguments.text);
    if all.is_empty() {
        return Err("the text has nothing to say".to_owned());
    }
    let mut sink = WavSink::create(&arguments.out, RATE).map_err(|e| e.to_string())?;
    speak(all.into_iter(), &*synthesizer, &mut sink, &Limits::within(LONGEST)).map_err(|e| e.to_string())?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_name_the_options_of_the_command_line() {
        for (message, shown) in [
            (
                "`recognizer_server`: `model` is missing, for example whisper-1",
                "--server-model is missing, for example whisper-1",
            ),
            (
                "no Whisper model; name its folder by `model`, or run ops/models.sh",
                "no Whisper model; name its folder by --model, or run ops/models.sh",
            ),
            ("`voice_model`: /v: name a folder", "--voice-model: /v: name a folder"),
            ("`voice`: the voice has no speaker “x”", "--voice: the voice has no speaker “x”"),
        ] {
            assert_eq!(as_options(message.to_owned()), shown);
        }
    }
}
