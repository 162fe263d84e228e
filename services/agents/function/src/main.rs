//! `supergaussian-agent-function`: executes plans, clause by clause.

mod action_result;
mod actor;
mod file_requests;
mod labels;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// The agent that executes plans
///
/// Example: supergaussian say "hide the soil and the pot"   (reaches it in a running stack)
#[derive(Debug, Parser)]
#[command(name = "supergaussian-agent-function", version, verbatim_doc_comment)]
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
