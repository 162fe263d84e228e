//! `supergaussian-fit`: conversion of a volume to editable Gaussians.

mod cli;
mod kept_scenes;
mod own_rights;

use std::process::ExitCode;

fn main() -> ExitCode {
    cli::run()
}
