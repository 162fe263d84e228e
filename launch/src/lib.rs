//! The launch-file language, the supervisor's state machine, demo scripts: what the `supergaussian` command is made of,
//! without processes, bus and clock.

pub mod densest;
pub mod document;
pub mod file;
pub mod log_line;
pub mod reconcile;
pub mod script;
pub mod strokes;

/// The launch file that starts the whole stack without a window.
pub const HEADLESS: &str = include_str!("../headless.toml");

/// The launch file of the whole stack with a window.
pub const DESKTOP: &str = include_str!("../desktop.toml");
