//! State of a process, as the kernel tells it.

use std::path::Path;

use sg_input::{file, limits};

/// State of a process, from `/proc/PID/stat`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ProcessStat {
    /// Process id of the parent.
    pub parent: i32,
    /// Id of the process group.
    pub group: i32,
    /// In clock ticks since boot.
    pub start_time: u64,
    /// It has ended, but its parent has not waited for it.
    pub zombie: bool,
    /// A signal has stopped it.
    pub stopped: bool,
}

impl ProcessStat {
    /// `None` for a missing process.
    #[must_use]
    pub fn of(pid: u32) -> Option<Self> {
        let stat = file::read_text(Path::new(&format!("/proc/{pid}/stat")), limits::SMALL_TEXT_BYTES).ok()?;
        // The second field is the name in brackets, with any characters. Count fields from its end.
        let fields: Vec<_> = stat.get(stat.rfind(')')? + 1..)?.split_whitespace().collect();
        let state = *fields.first()?;
        Some(Self {
            parent: fields.get(1)?.parse().ok()?,
            group: fields.get(2)?.parse().ok()?,
            start_time: fields.get(19)?.parse().ok()?,
            zombie: matches!(state, "Z" | "X"),
            stopped: state == "T",
        })
    }
}

/// Start time of a living process, in clock ticks since boot. Process ids are reused, so id and start time together
/// identify a process. `None` for a missing process or a zombie.
#[must_use]
pub fn start_time(pid: u32) -> Option<u64> {
    ProcessStat::of(pid).filter(|stat| !stat.zombie).map(|stat| stat.start_time)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn this_process_has_a_parent_and_a_start_time() {
        let stat = ProcessStat::of(std::process::id()).unwrap();
        assert_eq!(u32::try_from(stat.parent), Ok(std::os::unix::process::parent_id()));
        assert!(start_time(std::process::id()).is_some_and(|b| b > 0) && !stat.zombie);
        assert_eq!(start_time(u32::MAX), None);
    }
}
