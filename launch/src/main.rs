//! The `supergaussian` command: starts and watches stacks, talks to them, and finds the executables of the other commands.

mod arguments;
mod capture;
mod certificates;
mod chaos;
mod children;
mod cli;
mod console;
mod contract;
mod decode;
mod demo;
mod join;
mod leftovers;
mod logs;
mod metrics;
mod open;
mod others;
mod proof;
mod reload;
mod remote;
mod say;
mod supervisor;
mod swap;
mod terminal;
mod up;
mod watch;

fn main() -> std::process::ExitCode {
    cli::main()
}
