//! Failures of the command: an error line and an exit status.

/// Exit status for arguments or input that are wrong.
const WRONG_INPUT: u8 = 2;

/// An error line and the exit status that goes with it.
#[derive(Debug)]
pub(super) struct Failure {
    pub(super) status: u8,
    pub(super) line: String,
}

impl Failure {
    pub(super) fn input(error: impl std::fmt::Display) -> Self {
        Self { status: WRONG_INPUT, line: error.to_string() }
    }

    pub(super) fn work(error: impl std::fmt::Display) -> Self {
        Self { status: 1, line: error.to_string() }
    }
}
