//! Offline subcommands: what an utterance would mean.

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a command writes to the terminal")]

use std::process::ExitCode;

use clap::Subcommand;
use prost::{Message as _, Name as _};
use prost_reflect::{DescriptorPool, DynamicMessage, SerializeOptions};
use sg_agents::backend::Backend;
use sg_agents::grammar;
use sg_proto::language::{Intent, Observation};
use sg_proto::scene::{BaseUnit, Selection, State};

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Say what an utterance means in front of a scene with these units
    ///
    /// Exit status: 0 understood, 1 not (or not all of it), 2 wrong arguments.
    ///
    /// Example: supergaussian-agent-intent parse "make the sac red, then zoom in" --units sac,vessel
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
        /// What understands
        #[arg(long, default_value = grammar::NAME)]
        backend: Backend,
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

/// Wrong arguments.
const WRONG: u8 = 2;

pub(crate) fn run(command: &Command) -> ExitCode {
    match command {
        Command::Parse { text, units, selected, backend, json } => parse(text, units, *selected, *backend, *json),
        Command::Phrases { units } => {
            let names: Vec<&str> = units.iter().map(String::as_str).collect();
            println!("{}", grammar::help(&names));
            ExitCode::SUCCESS
        }
    }
}

fn parse(text: &str, units: &[String], selected: bool, backend: Backend, json: bool) -> ExitCode {
    let unit = |name: &String| BaseUnit { name: name.clone(), visible: true, opacity: 1.0, ..BaseUnit::default() };
    let scene = State {
        base_units: units.iter().map(unit).collect(),
        selection: Some(Selection { count: u64::from(selected), ..Selection::default() }),
        ..State::default()
    };
    let observation = Observation { moment: "before".to_owned(), scene: Some(scene), ..Observation::default() };
    let intent = match backend.understand(text, &observation) {
        Ok(intent) => intent,
        Err(refused) => {
            eprintln!("{refused}");
            return ExitCode::from(WRONG);
        }
    };
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
