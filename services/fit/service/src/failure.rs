//! Failures of the command and their exit statuses.

/// A failure with its exit status: 1 for failed work, 2 for wrong input.
pub(crate) struct Failure {
    pub(crate) status: u8,
    pub(crate) message: String,
}

/// Wrong input.
#[allow(clippy::needless_pass_by_value, reason = "handed to map_err")]
pub(crate) fn input(e: impl ToString) -> Failure {
    Failure { status: 2, message: e.to_string() }
}

/// Failed work.
#[allow(clippy::needless_pass_by_value, reason = "handed to map_err")]
pub(crate) fn work(e: impl ToString) -> Failure {
    Failure { status: 1, message: e.to_string() }
}
