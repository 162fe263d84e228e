//! Processes that a service leaves behind: children of its children, also after a shell script or under another session
//! of the system.
//!
//! Every process of a service inherits a mark in its environment, and a control group where there are some
//! ([`control_group`]). When the service has ended, all processes with its mark or in its group are killed. The supervisor also adopts processes whose parents have ended, so that none gets lost by clearing its
//! environment. A small process beside the supervisor ([`reap_after`]) does the same if the supervisor itself is killed.

use std::collections::BTreeSet;
use std::io::{self, Read, Write as _};
use std::path::Path;
use std::process::{Child, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::sys::wait::{WaitPidFlag, waitpid};
use nix::unistd::{Pid, getpgrp, getpid};
use sg_input::{file, limits};
use sg_runtime::process::{ProcessStat, start_time};

use crate::{control_group, service_manager};

/// First argument with which this program kills the processes that a killed supervisor leaves behind.
pub const REAP_AFTER: &str = "reap-after";

/// Environment variable with the mark: process id and start time of the supervisor, and the number of the service's
/// process.
pub(crate) const MARK: &str = "SUPERGAUSSIAN_PROCESS";

/// Longest wait for killed processes to disappear.
const REMOVAL_TIME: Duration = Duration::from_secs(2);
/// Pause between two looks.
const POLL_PERIOD: Duration = Duration::from_millis(5);
/// How long after the supervisor's end a process may still start another one.
const SETTLING_TIME: Duration = Duration::from_millis(500);

/// Children that this process started and waits for itself.
static OWN: Mutex<BTreeSet<u32>> = Mutex::new(BTreeSet::new());
/// Whether this process adopts others.
static ADOPTS: AtomicBool = AtomicBool::new(false);

/// Children that this process waits for. Locked while one is started, so that none is taken for an adopted one.
pub(crate) fn own() -> MutexGuard<'static, BTreeSet<u32>> {
    OWN.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Common part of the marks of this process's services.
pub(crate) fn own_mark() -> String {
    let pid = std::process::id();
    format!("{pid}-{}-", start_time(pid).unwrap_or_default())
}

/// Makes the kernel give processes to this one when their parents end.
pub(crate) fn adopt() {
    // Without it the marks still find almost all of them.
    ADOPTS.store(nix::sys::prctl::set_child_subreaper(true).is_ok(), Ordering::Relaxed);
}

/// Kills all processes with a mark or in its group, or with marks that begin so, and waits until they are gone. Reaps adopted ones.
pub(crate) fn end_marked(mark: &str) {
    control_group::end(mark);
    let began = Instant::now();
    let mut killed = BTreeSet::new();
    let mut empty_looks = 0;
    while began.elapsed() < REMOVAL_TIME {
        let found = marked(mark);
        empty_looks = if found.is_empty() { empty_looks + 1 } else { 0 };
        // A process is without its environment for a moment while it becomes another program. So one look without any is
        // not enough, the first one neither.
        if empty_looks > 1 {
            break;
        }
        for pid in found {
            send_kill(pid);
            killed.insert(pid);
        }
        std::thread::sleep(POLL_PERIOD);
    }
    killed.into_iter().for_each(reap);
    if ADOPTS.load(Ordering::Relaxed) {
        end_adopted();
    }
}

/// Kills adopted processes without a mark of this supervisor, and reaps those that have ended.
fn end_adopted() {
    let own = own();
    let (this, group) = (getpid().as_raw(), getpgrp().as_raw());
    let mark = own_mark();
    for pid in processes().filter(|pid| !own.contains(pid)) {
        // A child in this process's group was started by other code of this process, which waits for it.
        let Some(stat) = ProcessStat::of(pid).filter(|s| s.parent == this && s.group != group) else { continue };
        if !stat.zombie {
            if mark_of(pid).is_some_and(|m| m.starts_with(&mark)) {
                // A process of a service that still runs.
                continue;
            }
            send_kill(pid);
        }
        reap(pid);
    }
}

/// Kills a process. It may be gone by now.
fn send_kill(pid: u32) {
    if let Ok(pid) = i32::try_from(pid) {
        let _ = kill(Pid::from_raw(pid), Signal::SIGKILL);
    }
}

/// Reaps a child that has ended. Others are left alone.
fn reap(pid: u32) {
    if let Ok(pid) = i32::try_from(pid) {
        let _ = waitpid(Pid::from_raw(pid), Some(WaitPidFlag::WNOHANG));
    }
}

/// Living processes with a mark, or with marks that begin so.
fn marked(mark: &str) -> Vec<u32> {
    let whole = !mark.ends_with('-');
    let has = |pid: &u32| mark_of(*pid).is_some_and(|m| if whole { m == mark } else { m.starts_with(mark) });
    processes().filter(has).collect()
}

fn processes() -> impl Iterator<Item = u32> {
    let entries = std::fs::read_dir("/proc").into_iter().flatten().flatten();
    entries.filter_map(|e| e.file_name().to_str()?.parse().ok())
}

/// The mark of a living process. Processes of other users cannot be read.
fn mark_of(pid: u32) -> Option<String> {
    let environment = file::read(Path::new(&format!("/proc/{pid}/environ")), limits::TEXT_BYTES).ok()?;
    let value = environment.split(|b| *b == 0).find_map(|v| v.strip_prefix(MARK.as_bytes())?.strip_prefix(b"="))?;
    Some(String::from_utf8_lossy(value).into_owned())
}

/// Starts the process that kills what this one leaves behind. It ends with this process, or when the result is dropped.
///
/// # Errors
/// The system's error.
pub(crate) fn start_reaper() -> io::Result<Child> {
    // Not the path of this program: a newer build may have replaced it.
    let mut command = std::process::Command::new("/proc/self/exe");
    command.arg(REAP_AFTER).arg(own_mark()).env_remove(MARK);
    service_manager::hide_from(&mut command);
    command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::null());
    let mut own = own();
    let child = command.spawn()?;
    own.insert(child.id());
    Ok(child)
}

/// The process of [`REAP_AFTER`], with the arguments after it: waits for the end of the supervisor at the other end of
/// standard input, and kills its services' processes.
pub fn reap_after(mut arguments: impl Iterator<Item = std::ffi::OsString>) {
    let Some(mark) = arguments.next().and_then(|a| a.into_string().ok()).filter(|m| m.ends_with('-')) else {
        let _ = writeln!(io::stderr(), "`{REAP_AFTER}` is for internal use");
        return;
    };
    // Ctrl-C and the end of a terminal are for the supervisor.
    let _ = nix::unistd::setsid();
    let _ = io::stdin().read_to_end(&mut Vec::new());
    let ended = Instant::now();
    loop {
        end_marked(&mark);
        if ended.elapsed() > SETTLING_TIME {
            return;
        }
        std::thread::sleep(SETTLING_TIME / 5);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::Command;

    #[test]
    fn marked_processes_end_wherever_they_are() {
        let mark = format!("{}0-test-1", own_mark());
        let other = format!("{}0-test-12", own_mark());
        let start = |mark: &str, script: &str| {
            let mut command = Command::new("sh");
            command.args(["-c", script]).env(MARK, mark).stdout(Stdio::piped()).spawn().unwrap()
        };
        // One below a shell, one in a session of its own that its parent has left.
        let mut shell = start(&mark, "sleep 61 & wait");
        let mut gone = start(&mark, "setsid sleep 62 >/dev/null 2>&1 & sleep 0.1");
        gone.wait().unwrap();
        let mut spared = start(&other, "exec sleep 63");
        let began = Instant::now();
        // The shell and both below.
        while marked(&mark).len() != 3 {
            assert!(began.elapsed() < Duration::from_secs(5), "{:?}", marked(&mark));
            std::thread::sleep(POLL_PERIOD);
        }
        end_marked(&mark);
        assert!(marked(&mark).is_empty());
        assert!(spared.try_wait().unwrap().is_none(), "another mark is another service");
        spared.kill().unwrap();
        spared.wait().unwrap();
        let _ = shell.wait();
    }
}
