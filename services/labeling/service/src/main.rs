//! `supergaussian-labeling`: finds the units of a scene that a text or a picture means, offline and as a process of a session.

mod actor;
mod cli;
mod embedder;
mod label_encoder;
mod measured_units;
mod offline_scene;
mod params;
mod picture_encoder;
mod picture_query;
mod region_proposals;
mod region_views;
mod retrieval;
mod unit_embeddings;
mod viewer;
mod wire;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use sg_runtime::process::{self, ServeArgs};

#[derive(Debug, Parser)]
#[command(name = "supergaussian-labeling", version, about = "Which units a text means, and how they look")]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    #[command(flatten)]
    Offline(cli::Command),
    /// Serve a session (a supervisor starts this)
    Serve(Box<ServeArgs>),
}

fn main() -> ExitCode {
    match process::parse_command_line::<Arguments>().command {
        Command::Offline(command) => cli::run(&command),
        Command::Serve(args) => process::run(*args, env!("CARGO_PKG_VERSION"), actor::start),
    }
}
