//! Stacks of services: launch files, the reconciler, supervisors and nodes.

pub mod console;
pub mod document;
mod error;
pub mod file;
pub mod log_file;
pub mod log_line;
pub mod node;
pub mod pid_registry;
mod probe;
pub mod reconcile;
mod request_queue;
mod serve_arguments;
pub mod spawn;
pub mod suggestion;
pub mod supervisor;
pub mod terminal;

pub use error::StackError;
