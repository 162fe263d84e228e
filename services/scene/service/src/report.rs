//! What the subcommands print, and their exit status.

use std::process::ExitCode;

use serde::Serialize;
use sg_formats::Warning;
use sg_input::print;

/// Exit status where the arguments or the input are wrong.
pub(crate) const WRONG_INPUT: u8 = 2;

pub(crate) fn warn(warnings: &[Warning]) {
    for warning in warnings {
        print::status(&format!("warning: {warning}"));
    }
}

pub(crate) fn print_json(report: &impl Serialize) -> ExitCode {
    let text = serde_json::to_string_pretty(report).map_err(std::io::Error::from);
    match text.and_then(|text| print::result(&text)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => fail(&error, 1),
    }
}

pub(crate) fn fail(error: &dyn std::error::Error, status: u8) -> ExitCode {
    print::status(&format!("supergaussian-scene: {error}"));
    ExitCode::from(status)
}
