//! `supergaussian-render-node`: pictures of a scene (`supergaussian render`), and the render process.

mod actor;
mod cli;
mod progress;

use std::process::ExitCode;

use clap::{CommandFactory as _, Parser, Subcommand};
use sg_runtime::process::{self, ServeArgs};

/// Draws one picture of a scene. In a session, serves pictures, a window or a headset.
#[derive(Debug, Parser)]
#[command(name = "supergaussian-render-node", version, args_conflicts_with_subcommands = true)]
#[command(subcommand_negates_reqs = true, after_help = cli::EXAMPLES)]
struct Arguments {
    #[command(subcommand)]
    mode: Option<Mode>,
    #[command(flatten)]
    picture: Option<cli::Picture>,
}

#[derive(Debug, Subcommand)]
enum Mode {
    /// Serves pictures, a window or a headset of a running session; a supervisor starts this
    #[command(after_help = cli::SERVE_EXAMPLE)]
    Serve(Box<ServeArgs>),
    /// Shows the progress of a file that opens, from lines `SHARE STEP` on standard input; `supergaussian open` starts this
    #[command(hide = true)]
    Progress(progress::ProgressArgs),
}

fn main() -> ExitCode {
    match process::parse_command_line::<Arguments>() {
        Arguments { mode: Some(Mode::Serve(args)), .. } => process::run(*args, env!("CARGO_PKG_VERSION"), actor::start),
        Arguments { mode: Some(Mode::Progress(args)), .. } => progress::run(&args),
        Arguments { picture: Some(picture), .. } => cli::run(&picture),
        _ => cli::refuse_without_scene(Arguments::command()),
    }
}
