//! `supergaussian-fit`: a volume becomes editable Gaussians.

mod cli;

use std::process::ExitCode;

fn main() -> ExitCode {
    cli::run()
}
