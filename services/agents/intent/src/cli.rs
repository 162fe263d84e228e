//! Offline subcommands: parse an utterance, list phrases.

use std::error::Error;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use clap::Subcommand;
use prost::{Message as _, Name as _};
use prost_reflect::{DescriptorPool, DynamicMessage, SerializeOptions};
use sg_input::print;
use sg_language::{commands, grammar};
use sg_llm::{Backend, ConfigError, Fallback, InterpretError, Interpreter, Parameters};
use sg_proto::language::{Intent, IntentRequest, Observation};
use sg_proto::scene::{BaseUnit, Selection, State};
use sg_runtime::process::{EXIT_FAILED, block_on};
use sg_runtime::telemetry;

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Print the intent of an utterance, for a scene with these units
    ///
    /// Exit status: 0 understood, 1 not fully understood, 2 invalid arguments.
    ///
    /// Example: supergaussian-agent-intent parse "make the sac red, then zoom in" --units sac,vessel
    ///
    /// Example: supergaussian-agent-intent parse "hide it" --units sac --backend grpc --endpoint http://127.0.0.1:50051
    #[command(verbatim_doc_comment)]
    Parse {
        /// The utterance
        text: String,
        /// Names of the scene's units
        #[arg(long, value_delimiter = ',')]
        units: Vec<String>,
        /// Something is selected in the scene
        #[arg(long)]
        selected: bool,
        #[command(flatten)]
        model: ModelArgs,
        /// Write the intent as JSON to standard output
        #[arg(long)]
        json: bool,
    },
    /// List phrases that the grammar understands
    ///
    /// Example: supergaussian-agent-intent phrases --units sac,vessel
    #[command(verbatim_doc_comment)]
    Phrases {
        /// Names of the scene's units, for the examples
        #[arg(long, value_delimiter = ',')]
        units: Vec<String>,
    },
}

/// The backend. The options have the names of the parameters in a launch file.
#[derive(Debug, clap::Args)]
pub(crate) struct ModelArgs {
    /// `grammar`, `openai` or `grpc`
    #[arg(long, default_value = grammar::NAME)]
    backend: Backend,
    /// Name of the model
    #[arg(long)]
    model: Option<String>,
    /// Address of the model
    #[arg(long)]
    endpoint: Option<String>,
    /// Environment variable that holds the API key
    #[arg(long)]
    key_env: Option<String>,
    /// Timeout with all retries, seconds
    #[arg(long)]
    timeout_s: Option<f64>,
    /// Sampling temperature
    #[arg(long)]
    temperature: Option<f64>,
    /// Sampling seed
    #[arg(long)]
    seed: Option<u64>,
    /// Retries after transient errors
    #[arg(long)]
    retries: Option<u32>,
    /// Fallback when the model fails: `grammar` or `none`
    #[arg(long)]
    fallback: Option<String>,
    /// Let prompts leave this machine unencrypted
    #[arg(long)]
    insecure: bool,
}

impl ModelArgs {
    fn parameters(&self) -> Result<Parameters, ParseError> {
        let fallback = match self.fallback.as_deref() {
            None => None,
            Some("grammar") => Some(Fallback::Grammar),
            Some("none") => Some(Fallback::None),
            Some(other) => return Err(ParseError::Fallback(other.to_owned())),
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

/// Exit status of invalid arguments.
const EXIT_INVALID: u8 = 2;
/// Time limit of one request.
const TIME_LIMIT: Duration = Duration::from_secs(600);

pub(crate) fn run(command: &Command) -> ExitCode {
    match command {
        Command::Parse { text, units, selected, model, json } => parse(text, units, *selected, model, *json),
        Command::Phrases { units } => {
            let names: Vec<&str> = units.iter().map(String::as_str).collect();
            written(print::result(&commands::help(&names)))
        }
    }
}

/// The exit status after a result was written.
fn written(result: std::io::Result<()>) -> ExitCode {
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            print::status(&format!("standard output: {error}"));
            ExitCode::FAILURE
        }
    }
}

fn parse(text: &str, units: &[String], selected: bool, model: &ModelArgs, json: bool) -> ExitCode {
    telemetry::init_command();
    let unit = |name: &String| BaseUnit { name: name.clone(), visible: true, opacity: 1.0, ..BaseUnit::default() };
    let scene = State {
        base_units: units.iter().map(unit).collect(),
        selection: Some(Selection { count: u64::from(selected), ..Selection::default() }),
        ..State::default()
    };
    let observation = Observation { moment: "before".to_owned(), scene: Some(scene), ..Observation::default() };
    let request = IntentRequest { text: text.to_owned(), observation: Some(observation), ..IntentRequest::default() };
    let outcome = model.parameters().and_then(|parameters| interpret(&parameters, &request));
    let intent = match outcome {
        Ok(intent) => intent,
        Err(error) => {
            print::status(&error.to_string());
            return ExitCode::from(error.exit_status());
        }
    };
    if !intent.fallback.is_empty() {
        print::status(&format!("the grammar served: {}", intent.fallback));
    }
    if json {
        match as_json(&intent) {
            Ok(text) => {
                if written(print::result(&text)) != ExitCode::SUCCESS {
                    return ExitCode::FAILURE;
                }
            }
            Err(reason) => {
                print::status(&format!("the intent cannot be written as JSON: {reason}"));
                return ExitCode::FAILURE;
            }
        }
    } else {
        for clause in &intent.clauses {
            print::status(&format!(
                "{}: “{}”",
                clause.act().as_str_name().trim_start_matches("ACT_").to_lowercase(),
                clause.words
            ));
        }
        if !intent.read_as.is_empty() {
            print::status(&format!("read as: “{}”", intent.read_as));
        }
        if !intent.answer.is_empty() {
            print::status(&format!("answer: {}", intent.answer));
        }
        for part in &intent.not_understood {
            print::status(&format!("not understood: “{part}”"));
        }
        for suggestion in &intent.suggestions {
            print::status(&format!("try: “{suggestion}”"));
        }
    }
    let is_read = intent.not_understood.is_empty() && !(intent.clauses.is_empty() && intent.answer.is_empty());
    if is_read { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// The offline command `parse` failed.
#[derive(Debug, thiserror::Error)]
enum ParseError {
    #[error("`fallback` is `grammar` or `none`, not `{0}`")]
    Fallback(String),
    #[error(transparent)]
    Config(#[from] ConfigError),
    #[error(transparent)]
    Interpret(#[from] InterpretError),
    #[error("the async runtime could not be started: {0}")]
    Runtime(std::io::Error),
}

impl ParseError {
    fn exit_status(&self) -> u8 {
        match self {
            Self::Fallback(_) | Self::Config(_) | Self::Interpret(InterpretError::Utterance(_)) => EXIT_INVALID,
            Self::Interpret(InterpretError::Llm(_)) | Self::Runtime(_) => EXIT_FAILED,
        }
    }
}

fn interpret(parameters: &Parameters, request: &IntentRequest) -> Result<Intent, ParseError> {
    let outcome = block_on(async {
        let mut interpreter = Interpreter::new(parameters)?;
        let mut state = interpreter.initial_state();
        Ok(interpreter.interpret(request, "parse", Instant::now() + TIME_LIMIT, &mut state).await?)
    });
    outcome.map_err(ParseError::Runtime)?
}

/// The intent as JSON, with the field and enum names of the contract.
fn as_json(intent: &Intent) -> Result<String, Box<dyn Error>> {
    let pool = DescriptorPool::decode(sg_proto::DESCRIPTORS)?;
    let name = Intent::full_name();
    let descriptor = pool.get_message_by_name(&name).ok_or_else(|| format!("{name} is not in the schema"))?;
    let message = DynamicMessage::decode(descriptor, intent.encode_to_vec().as_slice())?;
    let options = SerializeOptions::new().use_proto_field_name(true).stringify_64_bit_integers(false);
    let value = message.serialize_with_options(serde_json::value::Serializer, &options)?;
    Ok(serde_json::to_string_pretty(&value)?)
}
