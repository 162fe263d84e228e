//! `supergaussian-selection`: offline subcommands on scene files, strokes and graphs, and the selection process.

mod actor;
mod cli;
mod wire;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use sg_runtime::process::{self, ServeArgs};

#[derive(Debug, Parser)]
#[command(name = "supergaussian-selection", version, about = "Super-Gaussians, random walks, brushes")]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    #[command(flatten)]
    Offline(cli::Command),
    /// Serve a session (a supervisor starts this)
    Serve(ServeArgs),
}

fn main() -> ExitCode {
    match process::parse_command_line::<Arguments>().command {
        Command::Offline(command) => cli::run(&command),
        Command::Serve(args) => process::run(args, env!("CARGO_PKG_VERSION"), actor::start),
    }
}
