//! What the processes of a stack use: memory, descriptors, threads, processor time; and the files that they keep.

use std::path::Path;

use sg_runtime::process::ProcessStat;

use crate::bench::processor_time;

/// Use of one process at a time.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ProcessUse {
    /// Process id.
    pub pid: u32,
    /// Anonymous resident memory, KiB: what the process holds beside its files.
    pub anonymous_kib: u64,
    /// Open descriptors.
    pub descriptors: u64,
    /// Sockets among them. In the supervisor they are the links of its router.
    pub sockets: u64,
    /// Threads.
    pub threads: u64,
    /// Memory maps.
    pub maps: u64,
    /// Processor time so far, milliseconds.
    pub processor_ms: u64,
}

impl ProcessUse {
    /// `None` for a process that is gone.
    #[must_use]
    pub fn of(pid: u32) -> Option<Self> {
        let folder = format!("/proc/{pid}");
        let status = std::fs::read_to_string(format!("{folder}/status")).ok()?;
        let field = |name: &str| -> Option<u64> {
            status.lines().find_map(|l| l.strip_prefix(name))?.split_whitespace().next()?.parse().ok()
        };
        let descriptors: Vec<_> = std::fs::read_dir(format!("{folder}/fd")).ok()?.flatten().collect();
        let is_socket =
            |path: &Path| std::fs::read_link(path).is_ok_and(|t| t.to_string_lossy().starts_with("socket:"));
        Some(Self {
            pid,
            anonymous_kib: field("RssAnon:")?,
            descriptors: descriptors.len() as u64,
            sockets: descriptors.iter().filter(|d| is_socket(&d.path())).count() as u64,
            threads: field("Threads:")?,
            maps: std::fs::read_to_string(format!("{folder}/maps")).ok()?.lines().count() as u64,
            processor_ms: u64::try_from(processor_time(pid.into()).as_millis()).unwrap_or(u64::MAX),
        })
    }
}

/// Processes below another one, at any depth: all of them, and those that have ended without being waited for.
#[must_use]
pub fn descendants(root: u32) -> (u64, u64) {
    let pids = std::fs::read_dir("/proc").into_iter().flatten().flatten();
    let pids = pids.filter_map(|e| e.file_name().to_str()?.parse::<u32>().ok());
    let mut rest: Vec<(u32, ProcessStat)> = pids.filter_map(|pid| Some((pid, ProcessStat::of(pid)?))).collect();
    let (mut below, mut zombies) = (vec![root], 0);
    let mut at = 0;
    while let Some(parent) = below.get(at).copied() {
        at += 1;
        rest.retain(|(pid, stat)| {
            let is_child = u32::try_from(stat.parent) == Ok(parent);
            if is_child {
                below.push(*pid);
                zombies += u64::from(stat.zombie);
            }
            !is_child
        });
    }
    (below.len() as u64 - 1, zombies)
}

/// Files below a folder.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct DiskUse {
    /// Sum of their sizes, bytes.
    pub bytes: u64,
    /// Number of files and folders.
    pub entries: u64,
}

impl DiskUse {
    /// Files below a folder, without those of the folders that are left out. Links are not followed.
    #[must_use]
    pub fn of(folder: &Path, without: &[&Path]) -> Self {
        let mut found = Self::default();
        let mut folders = vec![folder.to_owned()];
        while let Some(folder) = folders.pop() {
            for entry in std::fs::read_dir(&folder).into_iter().flatten().flatten() {
                let path = entry.path();
                // A file may go meanwhile.
                let Ok(metadata) = std::fs::symlink_metadata(&path) else { continue };
                if without.contains(&path.as_path()) {
                    continue;
                }
                found.entries += 1;
                if metadata.is_dir() {
                    folders.push(path);
                } else {
                    found.bytes += metadata.len();
                }
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn this_process_uses_something() {
        let used = ProcessUse::of(std::process::id()).unwrap();
        assert!(used.anonymous_kib > 100 && used.descriptors >= 3 && used.threads >= 1 && used.maps > 10, "{used:?}");
        let socket = std::os::unix::net::UnixDatagram::unbound().unwrap();
        let with = ProcessUse::of(std::process::id()).unwrap();
        assert!(with.sockets > 0, "{with:?}");
        drop(socket);
        assert_eq!(ProcessUse::of(u32::MAX), None);
    }

    #[test]
    fn children_of_children_are_counted() {
        let mut shell = std::process::Command::new("sh");
        shell.args(["-c", "sleep 60 & echo; wait"]).stdout(std::process::Stdio::piped());
        let mut shell = std::os::unix::process::CommandExt::process_group(&mut shell, 0).spawn().unwrap();
        // The line comes when the second process is there.
        std::io::Read::read_exact(shell.stdout.as_mut().unwrap(), &mut [0]).unwrap();
        assert_eq!(descendants(shell.id()), (1, 0));
        let group = nix::unistd::Pid::from_raw(shell.id().try_into().unwrap());
        nix::sys::signal::killpg(group, nix::sys::signal::Signal::SIGKILL).unwrap();
        shell.wait().unwrap();
    }

    #[test]
    fn files_are_counted_without_those_left_out() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::create_dir_all(path("a/b")).unwrap();
        std::fs::write(path("a/b/c"), [0; 10]).unwrap();
        std::fs::write(path("d"), [0; 5]).unwrap();
        assert_eq!(DiskUse::of(folder.path(), &[]), DiskUse { bytes: 15, entries: 4 });
        assert_eq!(DiskUse::of(folder.path(), &[&path("a")]), DiskUse { bytes: 5, entries: 1 });
    }
}
