//! `supergaussian-fit`: conversion of a volume to editable Gaussians.

mod arguments;
mod carry;
mod cli;
mod failure;
mod kept_scenes;
mod label_units;
mod output;
mod own_rights;
mod phantom;
mod progress;
mod report;
mod time_series;
mod training_run;

use std::process::ExitCode;

fn main() -> ExitCode {
    cli::run()
}
