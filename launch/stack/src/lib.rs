//! Stacks of services: launch files, and the supervisor that runs them.
//!
//! A launch file names the services of a stack, their roles, parameters and start order. The supervisor starts the
//! services, watches their health, restarts failed ones and swaps executables while the stack runs.
//!
//! | module | content |
//! | --- | --- |
//! | [`mod@file`] | the launch-file language: parsing, checks, search for executables |
//! | [`document`], [`snippet`] | TOML with places, and reports of mistakes with their lines |
//! | [`reconcile`] | the reconciler, a pure state machine: events in, actions out |
//! | [`supervisor`] | processes and bus around the reconciler, and requests to it |
//! | [`revocation`] | machines whose certificates are refused |
//! | [`node`] | a machine that runs services for a stack of another machine |
//! | [`spawn`], [`pid_registry`] | processes that die with their supervisor, and leftovers of earlier runs |
//! | `service_rights` | what the kernel leaves to a service |
//! | `service_manager` | readiness and signs of life for systemd |
//! | [`control_group`], [`descendants`] | children of services' children, which end with the service |
//! | [`log_file`], [`log_line`] | bounded logs of services, and their lines for people |
//! | [`console`], [`terminal`] | output of a supervisor |
//!
//! The supervisor knows no command line. A [`supervisor::SessionOpener`] prepares commands that open further sessions.
//! The program's `main` must call [`spawn::become_child`] if its first argument is [`spawn::BECOME_CHILD`], and
//! [`spawn::close_inherited`] if it is [`spawn::DETACHED`], and both that and [`descendants::reap_after`] if it is
//! [`descendants::REAP_AFTER`].
//!
//! # Example
//!
//! Parse a launch file and ask the reconciler for the first actions:
//!
//! ```
//! use std::path::Path;
//! use std::time::Duration;
//!
//! use sg_stack::file::{ExecutableSearch, Source, read};
//! use sg_stack::reconcile::{Action, Event, Reconciler};
//!
//! let text = "schema = 1\n[service.scene]\nexec = \"sh\"\n";
//! let source = Source { path: Path::new("demo.toml"), text, overrides: &[] };
//! let file = read(source, &ExecutableSearch::here_then_path())?;
//!
//! let mut reconciler = Reconciler::new(file.services, 1, 0);
//! let actions = reconciler.step(Event::Tick, Duration::ZERO);
//! assert!(matches!(&actions[0], Action::Spawn(spawn) if spawn.instance == "scene.1" && spawn.epoch == 1));
//! # Ok::<(), sg_stack::document::Problems>(())
//! ```

mod boot_time;
pub mod console;
pub mod control_group;
pub mod descendants;
pub mod document;
mod error;
pub mod file;
pub mod log_file;
pub mod log_line;
pub mod node;
mod params_file;
pub mod pid_registry;
mod probe;
pub mod reconcile;
pub mod revocation;
mod run_folder;
mod serve_arguments;
mod service_manager;
mod service_rights;
pub mod snippet;
pub mod spawn;
pub mod suggestion;
pub mod supervisor;
pub mod terminal;

pub use error::StackError;
