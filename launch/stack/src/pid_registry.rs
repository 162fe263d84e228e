//! A session's file of process ids, with which a new supervisor ends the processes of the last one.
//!
//! Services die with their supervisor, but not at once. Two processes must never serve one role.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;

use crate::error::StackError;
use crate::spawn::signal;

/// How long old processes may take to end before they are killed.
const FOLLOW_TIME: Duration = Duration::from_millis(1500);
/// How long killed processes may take to disappear.
const REMOVAL_TIME: Duration = Duration::from_secs(3);

/// The process ids of a session.
#[derive(Debug)]
pub(crate) struct PidRegistry {
    path: PathBuf,
    running: BTreeMap<u32, u64>,
}

impl PidRegistry {
    /// Waits until every recorded process is gone, kills those that stay, and starts an empty list.
    ///
    /// # Errors
    /// [`StackError::Leftover`] names a process that stays.
    pub(crate) async fn open(session: &Path) -> Result<Self, StackError> {
        let registry = Self { path: session.join("processes"), running: BTreeMap::new() };
        let text = std::fs::read_to_string(&registry.path).unwrap_or_default();
        let old: Vec<(u32, u64)> = text.lines().filter_map(entry).collect();
        let left = || {
            old.iter().filter(|(pid, start)| start_time(*pid) == Some(*start)).map(|(pid, _)| *pid).collect::<Vec<_>>()
        };
        let began = Instant::now();
        let mut killed = false;
        loop {
            let left = left();
            let Some(first) = left.first() else { break };
            if began.elapsed() > FOLLOW_TIME && !killed {
                killed = true;
                for pid in &left {
                    // The process may be gone by now. If the signal is refused, the wait below ends with an error.
                    let _ = signal(*pid, Signal::SIGKILL);
                }
            }
            if began.elapsed() > FOLLOW_TIME + REMOVAL_TIME {
                return Err(StackError::Leftover(*first));
            }
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
        Ok(registry)
    }

    /// Adds a started process.
    pub(crate) fn add(&mut self, pid: u32) {
        if let Some(start) = start_time(pid) {
            self.running.insert(pid, start);
            self.write();
        }
    }

    /// Removes an ended process.
    pub(crate) fn remove(&mut self, pid: u32) {
        self.running.remove(&pid);
        self.write();
    }

    fn write(&self) {
        let text: String = self.running.iter().map(|(pid, start)| format!("{pid} {start}\n")).collect();
        let part = self.path.with_extension("tmp");
        // Only the next run after a crash reads this file. It works without it.
        let _ = std::fs::write(&part, text).and_then(|()| std::fs::rename(&part, &self.path));
    }
}

fn entry(line: &str) -> Option<(u32, u64)> {
    let (pid, start) = line.split_once(' ')?;
    Some((pid.parse().ok()?, start.parse().ok()?))
}

/// Start time of a living process, in clock ticks since boot. Process ids are reused, so id and start time together
/// identify a process. `None` for a missing process or a zombie.
pub fn start_time(pid: u32) -> Option<u64> {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The second field is the name in brackets, with any characters. Count fields from its end.
    let fields: Vec<_> = stat.get(stat.rfind(')')? + 1..)?.split_whitespace().collect();
    let state = *fields.first()?;
    if state == "Z" || state == "X" { None } else { fields.get(19)?.parse().ok() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::process::CommandExt;

    #[tokio::test]
    async fn leftover_processes_are_ended() {
        let folder = tempfile::tempdir().unwrap();
        let mut registry = PidRegistry::open(folder.path()).await.unwrap();
        let mut child = std::process::Command::new("sleep").arg("60").process_group(0).spawn().unwrap();
        registry.add(child.id());
        // The same id with another start time is another process. It stays.
        registry.running.insert(std::process::id(), 1);
        registry.write();
        // A zombie counts as gone.
        let began = Instant::now();
        PidRegistry::open(folder.path()).await.unwrap();
        assert!(began.elapsed() >= FOLLOW_TIME && began.elapsed() < FOLLOW_TIME + REMOVAL_TIME);
        assert_eq!(std::os::unix::process::ExitStatusExt::signal(&child.wait().unwrap()), Some(9));
    }

    #[test]
    fn this_process_has_a_start_time() {
        assert!(start_time(std::process::id()).is_some_and(|b| b > 0));
        assert_eq!(start_time(u32::MAX), None);
    }
}
