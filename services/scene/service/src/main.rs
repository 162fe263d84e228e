//! The scene's executable: the process that owns a session's scene, and offline subcommands on scene files.

mod actor;
mod cli;
mod convert;
mod edited_scene;
mod kept_scenes;
mod project_commands;
mod project_folder;
mod reading;
mod report;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use sg_runtime::process::{ServeArgs, parse_command_line};

#[derive(Debug, Parser)]
#[command(name = "supergaussian-scene", version, about = "Scenes of editable Gaussians: serve, look into, convert")]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    #[command(flatten)]
    Offline(cli::Command),
    #[command(flatten)]
    Projects(project_commands::Command),
    /// Owns the scene of a running session: applies commands, stores them and publishes events
    #[command(after_help = EXAMPLE)]
    Serve(ServeArgs),
}

const EXAMPLE: &str = "Example (a supervisor does this):
  supergaussian-scene serve --session demo --role scene --instance scene-1 \\
    --connect unixsock-stream/$RUN/bus.sock --run-dir $RUN --params '{\"scene\": \"tooth.ply\"}'";

fn main() -> ExitCode {
    match parse_command_line::<Arguments>().command {
        Command::Serve(args) => actor::serve(args),
        Command::Offline(command) => cli::run(&command),
        Command::Projects(command) => project_commands::run(&command),
    }
}
