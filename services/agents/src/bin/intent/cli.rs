//! Offline subcommands: what an utterance would mean.

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a command writes to the terminal")]

use std::process::ExitCode;
use std::time::{Duration, Instant};

use clap::Subcommand;
use prost::{Message as _, Name as _};
use prost_reflect::{DescriptorPool, DynamicMessage, SerializeOptions};
use sg_agents::backend::{Backend, Fallback, Parameters};
use sg_agents::grammar;
use sg_proto::bus::Code;
use sg_proto::language::{Intent, IntentRequest, Observation};
use sg_proto::scene::{BaseUnit, Selection, State};
use sg_runtime::fault::Fault;
use sg_runtime::process::{EXIT_FAILED, block_on};
use sg_runtime::telemetry;

use crate::understander::Understander;

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Say what an utterance means in front of a scene with these units
    ///
    /// Exit status: 0 understood, 1 not (or not all of it), 2 wrong arguments.
    ///
    /// Example: supergaussian-agent-intent parse "make the sac red, then zoom in" --units sac,vessel
    ///
    /// Example: supergaussian-agent-intent parse "hide it" --units sac --backend grpc --endpoint http://127.0.0.1:50051
    #[command(verbatim_doc_comment)]
    Parse {
        /// The words
        text: String,
        /// Names of the scene's units
        #[arg(long, value_delimiter = ',')]
        units: Vec<String>,
        /// Something is selected in the scene
        #[arg(long)]
        selected: bool,
        #[command(flatten)]
        table: Table,
        /// Write the intent as JSON to standard output
        #[arg(long)]
        json: bool,
    },
    /// Say what can be said
    ///
    /// Example: supergaussian-agent-intent phrases --units sac,vessel
    #[command(verbatim_doc_comment)]
    Phrases {
        /// Names of the scene's units, for the examples
        #[arg(long, value_delimiter = ',')]
        units: Vec<String>,
    },
}

/// What understands; the names are those of an agent's parameters in a launch file.
#[derive(Debug, clap::Args)]
pub(crate) struct Table {
    /// `grammar`, `openai` or `grpc`
    #[arg(long, default_value = grammar::NAME)]
    backend: Backend,
    /// Model by name
    #[arg(long)]
    model: Option<String>,
    /// Where the model answers
    #[arg(long)]
    endpoint: Option<String>,
    /// Environment variable that holds the key
    #[arg(long)]
    key_env: Option<String>,
    /// Longest wait for an answer, seconds
    #[arg(long)]
    timeout_s: Option<f64>,
    /// Sampling temperature
    #[arg(long)]
    temperature: Option<f64>,
    /// Seed of the sampling
    #[arg(long)]
    seed: Option<u64>,
    /// Further tries
    #[arg(long)]
    retries: Option<u32>,
    /// What serves where the model does not: `grammar` or `none`
    #[arg(long)]
    fallback: Option<String>,
    /// Let prompts leave this machine unencrypted
    #[arg(long)]
    insecure: bool,
}

impl Table {
    fn parameters(&self) -> Result<Parameters, String> {
        let fallback = match self.fallback.as_deref() {
            None => None,
            Some("grammar") => Some(Fallback::Grammar),
            Some("none") => Some(Fallback::None),
            Some(other) => return Err(format!("`fallback` is `grammar` or `none`, not `{other}`")),
        };
        Ok(Parameters {
            backend: self.backend,
            model: self.model.clone(),
            endpoint: self.endpoint.clone(),
            key_env: self.key_env.clone(),
            insecure: self.insecure.then_some(true),
            timeout_s: self.timeout_s,
            temperature: self.temperature,
            seed: self.seed,
            retries: self.retries,
            fallback,
        })
    }
}

/// Wrong arguments.
const WRONG: u8 = 2;
/// Time there is for an answer.
const TIME: Duration = Duration::from_secs(600);

pub(crate) fn run(command: &Command) -> ExitCode {
    match command {
        Command::Parse { text, units, selected, table, json } => parse(text, units, *selected, table, *json),
        Command::Phrases { units } => {
            let names: Vec<&str> = units.iter().map(String::as_str).collect();
            println!("{}", grammar::help(&names));
            ExitCode::SUCCESS
        }
    }
}

fn parse(text: &str, units: &[String], selected: bool, table: &Table, json: bool) -> ExitCode {
    telemetry::init_command();
    let unit = |name: &String| BaseUnit { name: name.clone(), visible: true, opacity: 1.0, ..BaseUnit::default() };
    let scene = State {
        base_units: units.iter().map(unit).collect(),
        selection: Some(Selection { count: u64::from(selected), ..Selection::default() }),
        ..State::default()
    };
    let observation = Observation { moment: "before".to_owned(), scene: Some(scene), ..Observation::default() };
    let request = IntentRequest { text: text.to_owned(), observation: Some(observation), ..IntentRequest::default() };
    let parameters = match table.parameters() {
        Ok(parameters) => parameters,
        Err(reason) => {
            eprintln!("{reason}");
            return ExitCode::from(WRONG);
        }
    };
    let understood = block_on(async {
        let mut understander = Understander::new(&parameters).map_err(Fault::invalid)?;
        let mut told = understander.told();
        understander.understand(&request, "parse", Instant::now() + TIME, &mut told).await
    });
    let intent = match understood {
        Ok(Ok(intent)) => intent,
        Ok(Err(fault)) => {
            eprintln!("{fault}");
            return ExitCode::from(if fault.code == Code::InvalidArgument { WRONG } else { EXIT_FAILED });
        }
        Err(error) => {
            eprintln!("the async runtime could not be started: {error}");
            return ExitCode::from(EXIT_FAILED);
        }
    };
    if !intent.fallback.is_empty() {
        eprintln!("understood by the grammar: {}", intent.fallback);
    }
    if json {
        match as_json(&intent) {
            Ok(text) => println!("{text}"),
            Err(reason) => {
                eprintln!("the intent cannot be written as JSON: {reason}");
                return ExitCode::FAILURE;
            }
        }
    } else {
        for clause in &intent.clauses {
            eprintln!("{}: “{}”", clause.act().as_str_name().trim_start_matches("ACT_").to_lowercase(), clause.words);
        }
        for part in &intent.not_understood {
            eprintln!("not understood: “{part}”");
        }
        for suggestion in &intent.suggestions {
            eprintln!("could be said: “{suggestion}”");
        }
    }
    if intent.not_understood.is_empty() && !intent.clauses.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// The message by its schema, with the schema's names for fields and values.
fn as_json(intent: &Intent) -> Result<String, String> {
    let pool = DescriptorPool::decode(sg_proto::DESCRIPTORS).map_err(|e| e.to_string())?;
    let name = Intent::full_name();
    let descriptor = pool.get_message_by_name(&name).ok_or_else(|| format!("{name} is not in the schema"))?;
    let message = DynamicMessage::decode(descriptor, intent.encode_to_vec().as_slice()).map_err(|e| e.to_string())?;
    let options = SerializeOptions::new().use_proto_field_name(true).stringify_64_bit_integers(false);
    let value = message.serialize_with_options(serde_json::value::Serializer, &options).map_err(|e| e.to_string())?;
    serde_json::to_string_pretty(&value).map_err(|e| e.to_string())
}
