//! The `supergaussian` command: starts and supervises stacks, talks to them, and dispatches to other executables.

mod capture;
mod certificate_expiry;
mod certificates;
mod chaos;
mod cli;
mod contract;
mod decode;
mod demo;
mod densest;
mod densest_strokes;
mod display;
mod doctor;
mod input;
mod join;
mod mcp;
mod metrics;
mod open;
mod opener;
mod opening_window;
mod playback;
mod projects;
mod reload;
mod say;
mod session_name;
mod shipped;
mod strokes;
mod subcommands;
mod supervisor_client;
mod swap;
mod terminal;
mod text_file;
mod transcript;
mod up;
mod watch;

fn main() -> std::process::ExitCode {
    cli::main()
}
