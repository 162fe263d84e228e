//! A session's file of process ids, with which a new supervisor ends the processes of the last one.
//!
//! Services die with their supervisor, but not at once. Two processes must never serve one role. The file also holds the
//! mark of the supervisor, by which the children of its services are found, and the highest epoch that it has granted.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;
use sg_input::{file, limits};
use sg_runtime::process::start_time;

use crate::descendants;
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
    /// Highest epoch that was granted in this session.
    epoch: u64,
}

impl PidRegistry {
    /// Waits until every recorded process is gone, kills those that stay, and starts an empty list.
    ///
    /// # Errors
    /// [`StackError::Leftover`] names a process that stays.
    pub(crate) async fn open(session: &Path) -> Result<Self, StackError> {
        let mut registry = Self { path: session.join("processes"), running: BTreeMap::new(), epoch: 0 };
        let text = file::read_text(&registry.path, limits::SMALL_TEXT_BYTES).unwrap_or_default();
        registry.epoch = text.lines().find_map(|l| l.strip_prefix("epoch ")?.parse().ok()).unwrap_or(0);
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
        // Children of the old processes, which their deaths did not end.
        if let Some(mark) = text.lines().find_map(|l| l.strip_prefix("mark ")).filter(|m| m.ends_with('-')) {
            let mark = mark.to_owned();
            // The task cannot fail: it does not panic.
            let _ = tokio::task::spawn_blocking(move || descendants::end_marked(&mark)).await;
        }
        Ok(registry)
    }

    /// Highest epoch that was granted in this session, by this supervisor or an earlier one; 0 without one. A supervisor's
    /// own epochs are above it, also after the time of day was set back.
    pub(crate) fn epoch(&self) -> u64 {
        self.epoch
    }

    /// Records a granted epoch.
    pub(crate) fn grant(&mut self, epoch: u64) {
        if epoch > self.epoch {
            self.epoch = epoch;
            self.write();
        }
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
        let running: String = self.running.iter().map(|(pid, start)| format!("{pid} {start}\n")).collect();
        let text = format!("mark {}\nepoch {}\n{running}", descendants::own_mark(), self.epoch);
        let part = self.path.with_extension("tmp");
        // Only the next run after a crash reads this file. It works without it.
        let _ = std::fs::write(&part, text).and_then(|()| std::fs::rename(&part, &self.path));
    }
}

fn entry(line: &str) -> Option<(u32, u64)> {
    let (pid, start) = line.split_once(' ')?;
    Some((pid.parse().ok()?, start.parse().ok()?))
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

    #[tokio::test]
    async fn epochs_outlive_their_supervisor() {
        let folder = tempfile::tempdir().unwrap();
        let mut registry = PidRegistry::open(folder.path()).await.unwrap();
        assert_eq!(registry.epoch(), 0);
        registry.grant(u64::MAX - 7);
        registry.grant(3);
        assert_eq!(PidRegistry::open(folder.path()).await.unwrap().epoch(), u64::MAX - 7);
    }

    #[tokio::test]
    async fn children_of_a_killed_supervisors_services_are_ended() {
        let folder = tempfile::tempdir().unwrap();
        let mark = format!("{}-0-", u32::MAX);
        std::fs::write(folder.path().join("processes"), format!("mark {mark}\nepoch 4\n")).unwrap();
        let mut command = std::process::Command::new("sh");
        command.args(["-c", "setsid sleep 60 >/dev/null 2>&1 & echo $!"]).env(descendants::MARK, format!("{mark}1"));
        let pid: u32 = String::from_utf8(command.output().unwrap().stdout).unwrap().trim().parse().unwrap();
        // The shell's child becomes `setsid` and then `sleep`.
        let program = || std::fs::read_to_string(format!("/proc/{pid}/comm")).unwrap();
        let began = Instant::now();
        while program() != "sleep\n" {
            assert!(began.elapsed() < REMOVAL_TIME, "{}", program());
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
        PidRegistry::open(folder.path()).await.unwrap();
        assert_eq!(start_time(pid), None);
    }
}
