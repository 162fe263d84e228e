//! `supergaussian-agent-intent`: interprets utterances, in a session or offline.

mod actor;
mod cli;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// The agent that interprets utterances
///
/// Example: supergaussian-agent-intent parse "make the sac red" --units sac,vessel --json
#[derive(Debug, Parser)]
#[command(name = "supergaussian-agent-intent", version, verbatim_doc_comment)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Serve the role in a session (started by the supervisor)
    Serve(sg_runtime::process::ServeArgs),
    #[command(flatten)]
    Offline(cli::Command),
}

fn main() -> ExitCode {
    match sg_runtime::process::parse_command_line::<Arguments>().command {
        Command::Serve(args) => sg_runtime::process::run(args, env!("CARGO_PKG_VERSION"), actor::start),
        Command::Offline(command) => cli::run(&command),
    }
}
