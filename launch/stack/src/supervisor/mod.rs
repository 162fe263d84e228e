//! The supervisor: starts the services of a launch file, watches them and restarts them.

mod actions;
mod answers;
mod attempt;
mod awake_clock;
mod event_loop;
mod file_places;
mod nodes;
mod open_session;
mod opener;
mod process_messages;
mod requests;
mod save_file;
mod session_lock;
mod status;
mod work;

pub use event_loop::{Stack, Supervisor};
pub use opener::{OpenCommand, SessionOpener};
pub use requests::Handle;
