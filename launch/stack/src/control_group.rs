//! Control groups (cgroup v2) of services' processes, where a service manager leaves some to this process.
//!
//! The kernel puts every child of a process into its group and ends a group in one step. A process can clear the mark in
//! its environment ([`crate::descendants`]), but not leave its group. Where there are no groups the mark stands alone.

use std::ffi::OsStr;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use sg_input::file::read_text;
use sg_input::limits::SMALL_TEXT_BYTES;

/// Environment variable with the folder of a new process's group. Only the short-lived parent reads it.
pub(crate) const GROUP: &str = "SUPERGAUSSIAN_CONTROL_GROUP";

/// Longest wait for killed processes to leave their group.
const REMOVAL_TIME: Duration = Duration::from_secs(2);
/// Pause between two attempts to remove a group.
const POLL_PERIOD: Duration = Duration::from_millis(2);

/// Folder of this process's own group, if groups below it are this process's to make.
///
/// A service manager owns its tree and marks the parts that it delegates (`Delegate=yes` of systemd). At the root of the
/// tree that this process sees, as in a container, there is no service manager.
pub fn delegated() -> Option<&'static Path> {
    static OWN: OnceLock<Option<PathBuf>> = OnceLock::new();
    let find = || {
        let mounts = read_text(Path::new("/proc/self/mountinfo"), SMALL_TEXT_BYTES).ok()?;
        let groups = read_text(Path::new("/proc/self/cgroup"), SMALL_TEXT_BYTES).ok()?;
        let (folder, top) = own_folder(&mounts, &groups)?;
        let writable = rustix::fs::access(&folder, rustix::fs::Access::WRITE_OK).is_ok();
        (writable && (top || is_marked(&folder))).then_some(folder)
    };
    OWN.get_or_init(find).as_deref()
}

/// The folder of a process's group and whether it is the topmost one, from its `mountinfo` and `cgroup` of `/proc`.
fn own_folder(mounts: &str, groups: &str) -> Option<(PathBuf, bool)> {
    let group = groups.lines().find_map(|line| line.strip_prefix("0::"))?;
    mounts.lines().find_map(|line| {
        let (mount, system) = line.split_once(" - ")?;
        if system.split(' ').next() != Some("cgroup2") {
            return None;
        }
        let mut fields = mount.split(' ').skip(3);
        let (root, place) = (fields.next()?, fields.next()?);
        let below = Path::new(group).strip_prefix(root).ok()?;
        Some((Path::new(place).join(below), below.as_os_str().is_empty()))
    })
}

/// Whether a service manager has marked a group as delegated.
fn is_marked(folder: &Path) -> bool {
    ["user.delegate", "trusted.delegate"].iter().any(|name| {
        let mut value = [0; 8];
        rustix::fs::getxattr(folder, *name, &mut value[..]).is_ok_and(|length| length > 0 && value[0] == b'1')
    })
}

/// The folder of the group for a mark, or of all groups for marks that begin so.
fn folder_of(mark: &str) -> Option<PathBuf> {
    let (supervisor, number) = mark.rsplit_once('-')?;
    Some(delegated()?.join(format!("supergaussian-{supervisor}")).join(number))
}

/// Makes the group of a service's process. `None` without control groups.
pub(crate) fn create(mark: &str) -> Option<PathBuf> {
    let folder = folder_of(mark)?;
    std::fs::create_dir_all(&folder).ok()?;
    // Linux 5.14 and later.
    if folder.join("cgroup.kill").exists() {
        return Some(folder);
    }
    let _ = std::fs::remove_dir(&folder);
    None
}

/// Moves this process into a group.
pub(crate) fn enter(folder: &OsStr) -> io::Result<()> {
    std::fs::write(Path::new(folder).join("cgroup.procs"), "0")
}

/// Kills all processes in the group of a mark, or in those of marks that begin so, and removes them.
pub(crate) fn end(mark: &str) {
    let Some(folder) = folder_of(mark).filter(|folder| folder.exists()) else { return };
    // With all groups below it.
    let killed = std::fs::write(folder.join("cgroup.kill"), "1");
    let began = Instant::now();
    while killed.is_ok() && !remove(&folder) && began.elapsed() < REMOVAL_TIME {
        std::thread::sleep(POLL_PERIOD);
    }
}

/// Removes a group and those below it. False while one has processes.
fn remove(folder: &Path) -> bool {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        if entry.file_type().is_ok_and(|t| t.is_dir()) {
            // A failure shows in the next line.
            let _ = std::fs::remove_dir(entry.path());
        }
    }
    std::fs::remove_dir(folder).is_ok() || !folder.exists()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::{Command, Stdio};

    #[test]
    fn the_own_group_is_found_below_every_kind_of_mount() {
        let systemd = "25 30 0:23 / /sys/fs/cgroup rw,nosuid - cgroup2 cgroup2 rw,nsdelegate\n";
        let user = "0::/user.slice/user-1000.slice/user@1000.service/app.slice/stack.service\n";
        let (folder, top) = own_folder(systemd, user).unwrap();
        assert!(folder.ends_with("user@1000.service/app.slice/stack.service") && !top);
        // Beside version 1.
        let both = "31 30 0:26 / /sys/fs/cgroup/cpu rw - cgroup cgroup rw,cpu\n\
                    40 30 0:35 / /sys/fs/cgroup/unified rw - cgroup2 cgroup2 rw\n";
        let (folder, top) = own_folder(both, "2:cpu:/a\n0::/\n").unwrap();
        assert_eq!((folder.as_path(), top), (Path::new("/sys/fs/cgroup/unified/"), true));
        // Bound from a part of the tree.
        let bound = "40 30 0:35 /box /sys/fs/cgroup rw - cgroup2 cgroup2 rw\n";
        assert_eq!(own_folder(bound, "0::/box/inner\n"), Some(("/sys/fs/cgroup/inner".into(), false)));
        assert_eq!(own_folder(bound, "0::/elsewhere\n"), None);
        assert_eq!(own_folder("31 30 0:26 / /c rw - cgroup cgroup rw,cpu\n", "2:cpu:/a\n"), None);
        assert_eq!(own_folder("", ""), None);
    }

    #[test]
    #[allow(clippy::print_stderr, reason = "a skipped test says so")]
    fn a_process_without_mark_or_parent_ends_with_its_group() {
        let supervisor = format!("{}-group-test", std::process::id());
        let (mark, other) = (format!("{supervisor}-1"), format!("{supervisor}-12"));
        let (Some(group), Some(beside)) = (create(&mark), create(&other)) else {
            eprintln!("SKIPPED: no control groups are delegated to this process");
            return;
        };
        let start = |group: &Path| {
            // The last process has another session, another parent and no environment.
            let text = format!(
                "echo 0 > '{}/cgroup.procs'; (setsid env -i sleep 64 >/dev/null 2>&1 &) ; sleep 0.2",
                group.display()
            );
            assert!(Command::new("sh").args(["-c", &text]).stdin(Stdio::null()).status().unwrap().success());
        };
        let inside =
            |group: &Path| std::fs::read_to_string(group.join("cgroup.procs")).unwrap_or_default().lines().count();
        start(&group);
        start(&beside);
        assert_eq!((inside(&group), inside(&beside)), (1, 1));
        end(&mark);
        assert!(!group.exists());
        assert_eq!(inside(&beside), 1, "another mark is another service");
        // All that is left of the supervisor.
        end(&format!("{supervisor}-"));
        assert!(!beside.exists() && !beside.parent().unwrap().exists());
        // Twice is once.
        end(&mark);
    }
}
