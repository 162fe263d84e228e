//! `supergaussian-fit`: conversion of a volume to editable Gaussians.

mod cli;
mod failure;
mod kept_scenes;
mod output;
mod own_rights;
mod phantom;
mod report;
mod training_run;

use std::process::ExitCode;

fn main() -> ExitCode {
    cli::run()
}
