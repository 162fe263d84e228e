//! `supergaussian-render-node`: pictures of a scene (`supergaussian render`).

mod cli;

fn main() -> std::process::ExitCode {
    cli::run()
}
