//! `supergaussian-agent-core`: answers utterances: observe, interpret, act, observe again, reply.

mod actor;
mod image_diff;
mod published_state;
mod publishing;
mod tour;
mod turn_changes;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// The agent that answers utterances
///
/// Example: supergaussian say "make the sac red"   (reaches it in a running stack)
#[derive(Debug, Parser)]
#[command(name = "supergaussian-agent-core", version, verbatim_doc_comment)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Serve the role in a session (started by the supervisor)
    Serve(sg_runtime::process::ServeArgs),
}

fn main() -> ExitCode {
    let Command::Serve(args) = sg_runtime::process::parse_command_line::<Arguments>().command;
    sg_runtime::process::run(args, env!("CARGO_PKG_VERSION"), actor::start)
}
