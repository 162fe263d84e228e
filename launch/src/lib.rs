//! The launch-file language, the supervisor's state machine, demo scripts: what the `supergaussian` command is made of,
//! without processes, bus and clock.

pub mod document;
pub mod file;
pub mod log_line;
pub mod reconcile;

/// The launch file that starts the whole stack without a window.
pub const HEADLESS: &str = include_str!("../headless.toml");
