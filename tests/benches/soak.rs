//! A day's work in an hour: many commands, captures and restarts, while memory, descriptors, threads and disk are sampled.
//!
//!     cargo bench --workspace --bench soak -- --check --out soak
//!     cargo bench --workspace --bench soak -- --commands 20000 --captures 2000 --restarts 200 --minutes 10 --out soak
//!
//! With `--check` the exit status is 1 if a bound is not kept, a request failed or an acknowledged command is lost.

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a bench prints what it measured")]

use std::process::ExitCode;

use clap::Parser;
use sg_tests::soak::{self, options::Options};

#[derive(Debug, Parser)]
#[command(about = "Plays a long session and samples what its processes use")]
struct Arguments {
    #[command(flatten)]
    options: Options,
    /// End with status 1 if a bound is not kept, a request failed or a command is lost
    #[arg(long)]
    check: bool,
    /// What cargo adds
    #[arg(long, hide = true)]
    bench: bool,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build();
    let played = runtime.map_err(|e| e.to_string()).and_then(|r| r.block_on(soak::play(&arguments.options)));
    match played {
        Ok(outcome) => {
            println!("{}", outcome.report);
            if arguments.check && !outcome.holds() { ExitCode::FAILURE } else { ExitCode::SUCCESS }
        }
        Err(reason) => {
            eprintln!("error: {reason}");
            ExitCode::from(2)
        }
    }
}
