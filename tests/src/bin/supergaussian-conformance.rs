//! `supergaussian-conformance`: tries whether an executable can fill a role.

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a command writes to the terminal")]

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use clap::Parser;
use sg_tests::conformance::{Candidate, Check, conform};

/// Try over the bus whether an executable can fill a role
///
/// Starts the program in a session of its own, with a small scene and the other roles it needs. Then it checks the contract of
/// the role: ready in time, answers, refusals, cancellation, deadlines, kill -9, standing by, promotion. One line for each check.
/// Exit status: 0 all held, 1 some did not, 2 wrong arguments.
///
/// Example: supergaussian conformance agent-intent services/agents/examples/python-intent/intent
#[derive(Debug, Parser)]
#[command(name = "supergaussian-conformance", version, verbatim_doc_comment)]
struct Arguments {
    /// The role, such as `agent-intent`
    role: String,
    /// The executable; it is called with `serve` and the arguments of the service mode
    executable: PathBuf,
    /// Its parameters as in a launch file, as JSON
    #[arg(long, default_value = "{}")]
    params: String,
    /// How long it may take until it is ready
    #[arg(long, default_value_t = 30.0, value_name = "SECONDS")]
    ready: f64,
    /// Print one JSON object a line
    #[arg(long)]
    json: bool,
}

const WRONG: u8 = 2;

fn wrong(why: &str) -> ExitCode {
    eprintln!("error: {why}");
    ExitCode::from(WRONG)
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    sg_runtime::telemetry::init_command();
    let params = match serde_json::from_str(&arguments.params) {
        Ok(params) => params,
        Err(error) => return wrong(&format!("--params: {error}; a JSON object is expected")),
    };
    let executable = match std::path::absolute(&arguments.executable) {
        Ok(path) if path.is_file() => path,
        _ => return wrong(&format!("{}: no such file", arguments.executable.display())),
    };
    let Ok(ready) = Duration::try_from_secs_f64(arguments.ready) else {
        return wrong("--ready: a number of seconds is expected");
    };
    let candidate = Candidate { role: arguments.role, executable, params, ready };
    let json = arguments.json;
    let mut tell = move |check: &Check| println!("{}", line(check, json));
    match sg_runtime::process::block_on(conform(&candidate, &mut tell)) {
        Ok(Ok(true)) => ExitCode::SUCCESS,
        Ok(Ok(false)) => ExitCode::FAILURE,
        Ok(Err(why)) => wrong(&why),
        Err(error) => wrong(&format!("the async runtime could not be started: {error}")),
    }
}

fn line(check: &Check, json: bool) -> String {
    let why = check.outcome.as_ref().err();
    if json {
        return serde_json::json!({"check": check.what, "ok": why.is_none(), "why": why}).to_string();
    }
    match why {
        None => format!("ok      {}", check.what),
        Some(why) => format!("FAILED  {}: {why}", check.what),
    }
}
