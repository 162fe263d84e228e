//! `supergaussian-speech`: recognises commands and speaks replies, on files and as a process of a session.

mod actor;
mod backends;
mod cli;
mod commands;
mod devices;
mod loudspeaker;
mod microphone;
mod params;
mod recognition_thread;
mod remote;
#[cfg(feature = "devices")]
mod sound_devices;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use sg_runtime::process::{self, ServeArgs};

#[derive(Debug, Parser)]
#[command(name = "supergaussian-speech", version, about = "Commands by voice, and spoken replies")]
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
