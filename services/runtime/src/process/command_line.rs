//! The words of a command line, which may come from names of files, as `*` in a shell does.

use std::ffi::OsString;

use clap::Parser;
use sg_input::print;

use super::start_error::EXIT_INPUT;

/// The command line of this process. Ends it for a wrong one, with a printable report and [`EXIT_INPUT`], and after help.
#[must_use]
pub fn parse_command_line<T: Parser>() -> T {
    parse_words(std::env::args_os())
}

/// As [`parse_command_line`], of these words; the first one is the program.
#[must_use]
pub fn parse_words<T: Parser>(words: impl IntoIterator<Item = OsString>) -> T {
    T::try_parse_from(words).unwrap_or_else(|error| {
        if !error.use_stderr() {
            error.exit();
        }
        print::status_lines(&error.to_string());
        std::process::exit(EXIT_INPUT.into())
    })
}
