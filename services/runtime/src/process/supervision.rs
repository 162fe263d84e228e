//! Ends a process together with its supervisor.

use std::time::Duration;

use nix::sys::signal::Signal;
use nix::unistd::{Pid, getppid};

use super::process_stat::ProcessStat;
use super::start_error::EXIT_FAILED;

/// Pause between two looks at the supervisor.
const POLL_PERIOD: Duration = Duration::from_millis(100);
/// Most processes between this one and its supervisor, such as shells.
const MAX_GENERATIONS: usize = 16;

/// Ends this process when its supervisor dies.
///
/// The kernel sends a signal at the parent's death. A thread also polls the supervisor: it covers the time before the signal
/// is armed, code that ignores the signal, and a shell script between the two.
pub(super) fn exit_with_supervisor(supervisor: i32) {
    if let Err(error) = nix::sys::prctl::set_pdeathsig(Signal::SIGTERM) {
        tracing::warn!(%error, "no signal at the supervisor's death; polling it instead");
    }
    let ancestor = Ancestor::find(supervisor);
    let thread = std::thread::Builder::new().name("supervisor-watch".into()).spawn(move || {
        while ancestor.as_ref().is_some_and(Ancestor::lives) {
            std::thread::sleep(POLL_PERIOD);
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

/// A process above this one.
struct Ancestor {
    pid: i32,
    /// Ids are reused. Id and start time together identify a process.
    start_time: u64,
}

impl Ancestor {
    /// Looks for the process among those above this one.
    fn find(pid: i32) -> Option<Self> {
        let mut above = getppid().as_raw();
        for _ in 0..MAX_GENERATIONS {
            let stat = living(above)?;
            if above == pid {
                return Some(Self { pid, start_time: stat.start_time });
            }
            above = stat.parent;
        }
        None
    }

    fn lives(&self) -> bool {
        // Cheap, and the usual case.
        getppid() == Pid::from_raw(self.pid) || living(self.pid).is_some_and(|stat| stat.start_time == self.start_time)
    }
}

/// State of a living process; `None` for a missing one or a zombie.
fn living(pid: i32) -> Option<ProcessStat> {
    ProcessStat::of(u32::try_from(pid).ok()?).filter(|stat| !stat.zombie)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_process_above_is_an_ancestor() {
        let parent = getppid().as_raw();
        assert!(Ancestor::find(parent).is_some_and(|a| a.lives()));
        if let Some(stat) = living(parent).filter(|stat| stat.parent > 0) {
            assert!(Ancestor::find(stat.parent).is_some_and(|a| a.lives()));
        }
        assert!(Ancestor::find(i32::MAX).is_none());
        assert!(Ancestor::find(std::process::id().cast_signed()).is_none());
    }
}
