//! `supergaussian-agent-function`: carries out plans, clause by clause.

mod actor;
#[path = "../mind/mod.rs"]
mod mind;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// The agent that carries out what was understood
///
/// Example: supergaussian say "hide the soil and the pot"   (ends up here in a running stack)
#[derive(Debug, Parser)]
#[command(name = "supergaussian-agent-function", version, verbatim_doc_comment)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Serve the role in a session; a supervisor calls this
    Serve(sg_runtime::process::ServeArgs),
}

fn main() -> ExitCode {
    let Command::Serve(args) = Arguments::parse().command;
    sg_runtime::process::run(args, env!("CARGO_PKG_VERSION"), actor::start)
}
