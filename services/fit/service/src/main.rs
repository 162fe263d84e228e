//! `supergaussian-fit`: conversion of a volume to editable Gaussians.

mod cli;
mod own_rights;
mod kept_scenes;

use std::process::ExitCode;

fn main() -> ExitCode {
    cli::run()
}
