//! `supergaussian-fit`: conversion of a volume to editable Gaussians.

mod cli;

use std::process::ExitCode;

fn main() -> ExitCode {
    cli::run()
}
