//! `supergaussian-agent-core`: hears utterances, looks, has them understood and carried out, looks again, answers.

mod actor;
#[path = "../mind/mod.rs"]
mod mind;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// The agent that hears utterances and answers them
///
/// Example: supergaussian say "make the sac red"   (speaks to it in a running stack)
#[derive(Debug, Parser)]
#[command(name = "supergaussian-agent-core", version, verbatim_doc_comment)]
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
