//! Ends a process together with its supervisor.

use std::time::Duration;

use nix::sys::signal::Signal;
use nix::unistd::{Pid, getppid};

use super::start_error::EXIT_FAILED;

/// Ends this process when its supervisor dies.
///
/// The kernel sends a signal at the parent's death. A thread also polls the parent: it covers the time before the signal is
/// armed, and code that ignores the signal.
pub(super) fn exit_with_supervisor(supervisor: i32) {
    if let Err(error) = nix::sys::prctl::set_pdeathsig(Signal::SIGTERM) {
        tracing::warn!(%error, "no signal at the supervisor's death; polling it instead");
    }
    let parent = Pid::from_raw(supervisor);
    let thread = std::thread::Builder::new().name("supervisor-watch".into()).spawn(move || {
        while getppid() == parent {
            std::thread::sleep(Duration::from_millis(100));
        }
        tracing::error!("the supervisor has died; stopping");
        let _ = nix::sys::signal::raise(Signal::SIGTERM);
        std::thread::sleep(Duration::from_millis(1000));
        std::process::exit(i32::from(EXIT_FAILED));
    });
    if let Err(error) = thread {
        tracing::warn!(%error, "the supervisor cannot be polled");
    }
}
