//! `supergaussian-fit`: conversion of a volume to editable Gaussians.

mod arguments;
mod carry;
mod checkpoint_file;
mod cli;
mod failure;
mod interruption;
mod kept_scenes;
mod label_units;
mod output;
mod own_rights;
mod phantom;
mod progress;
mod report;
mod stop_signals;
mod time_series;
mod training_run;

use std::process::ExitCode;

fn main() -> ExitCode {
    cli::run()
}
