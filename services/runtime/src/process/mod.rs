//! One lifecycle for every process: connect, load, ready, serve, drain, stop.

mod arguments;
mod command_line;
mod host;
mod lifecycle;
mod memory;
mod panics;
mod process_stat;
mod standard_requests;
mod start_error;
mod supervision;

pub use arguments::ServeArgs;
pub use command_line::{parse_command_line, parse_words};
pub use host::Host;
pub use lifecycle::{block_on, run};
pub use memory::resident_bytes;
pub use panics::report_panics;
pub use process_stat::{ProcessStat, start_time};
pub use start_error::{EXIT_FAILED, EXIT_INPUT, StartError};
