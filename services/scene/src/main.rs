//! The scene's executable: offline subcommands on scene files.

mod cli;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

#[derive(Debug, Parser)]
#[command(name = "supergaussian-scene", version, about = "Scenes of editable Gaussians: look into them, convert them")]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    #[command(flatten)]
    Offline(cli::Command),
}

fn main() -> ExitCode {
    match Arguments::parse().command {
        Command::Offline(command) => cli::run(&command),
    }
}
