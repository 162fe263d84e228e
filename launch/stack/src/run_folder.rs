//! Clears what processes leave in the folder of a session or node, so that it stays bounded over months.
//!
//! Each process stores its pictures in a folder of its own below `blobs/`. The folder goes some time after the process:
//! receivers of a message still read the file that it names. A node also keeps scenes, below `scenes/`, which it fetched
//! from the home machine. They go by age and size.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{DirEntry, Metadata};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime};

/// Pause between two runs.
const PERIOD: Duration = Duration::from_secs(60);
/// How long the files of a process outlive it.
const KEEP_BLOBS: Duration = Duration::from_secs(300);
/// How long a scene stays after its last use.
const KEEP_SCENES: Duration = Duration::from_secs(7 * 24 * 3600);
/// Most bytes of all scenes of a node. The one that was used last stays in any case.
const MAX_SCENE_BYTES: u64 = 32 << 30;

/// Clears one folder.
#[derive(Debug)]
pub(crate) struct Cleaner {
    due: Instant,
    state: Arc<Mutex<Cleaning>>,
}

#[derive(Debug)]
struct Cleaning {
    run_dir: PathBuf,
    /// Entries below `blobs/` without a living process, with the time when that was first seen.
    unowned: BTreeMap<String, Instant>,
}

impl Cleaner {
    pub(crate) fn new(run_dir: &Path) -> Self {
        let state = Cleaning { run_dir: run_dir.to_owned(), unowned: BTreeMap::new() };
        Self { due: Instant::now(), state: Arc::new(Mutex::new(state)) }
    }

    /// Clears the folder beside the caller, about once a minute. `living` returns the instances that run.
    pub(crate) fn clean_if_due(&mut self, living: impl FnOnce() -> BTreeSet<String>) {
        let now = Instant::now();
        if now < self.due {
            return;
        }
        self.due = now + PERIOD;
        let (state, living) = (Arc::clone(&self.state), living());
        tokio::task::spawn_blocking(move || {
            let mut state = state.lock().unwrap_or_else(PoisonError::into_inner);
            state.clear_blobs(&living, now);
            clear_scenes(&state.run_dir.join("scenes"), SystemTime::now(), MAX_SCENE_BYTES);
        });
    }
}

impl Cleaning {
    /// Removes the files of processes that ended long ago.
    fn clear_blobs(&mut self, living: &BTreeSet<String>, now: Instant) {
        let folder = self.run_dir.join("blobs");
        let names: BTreeSet<String> =
            entries(&folder).filter_map(|e| e.file_name().into_string().ok()).filter(|n| !living.contains(n)).collect();
        self.unowned.retain(|name, _| names.contains(name));
        for name in names {
            let since = *self.unowned.entry(name.clone()).or_insert(now);
            if now.saturating_duration_since(since) >= KEEP_BLOBS {
                // The next run tries again.
                let _ = remove(&folder.join(name));
            }
        }
    }
}

/// Removes scenes that were not used for long, and beyond the size limit those that were not used for longest.
fn clear_scenes(folder: &Path, now: SystemTime, most_bytes: u64) {
    let used = |e: &DirEntry| e.metadata().and_then(|m| m.modified()).unwrap_or(SystemTime::UNIX_EPOCH);
    let mut scenes: Vec<_> = entries(folder).map(|e| (used(&e), e.path())).collect();
    // Newest first.
    scenes.sort_by(|a, b| b.cmp(a));
    let mut bytes = 0_u64;
    for (index, (used, path)) in scenes.into_iter().enumerate() {
        bytes = bytes.saturating_add(size(&path));
        let old = now.duration_since(used).is_ok_and(|age| age >= KEEP_SCENES);
        if index > 0 && (old || bytes > most_bytes) {
            // The next run tries again.
            let _ = remove(&path);
        }
    }
}

fn entries(folder: &Path) -> impl Iterator<Item = DirEntry> {
    std::fs::read_dir(folder).into_iter().flatten().flatten()
}

/// Bytes of a file, or of all files of a folder. Links are not followed.
fn size(path: &Path) -> u64 {
    match std::fs::symlink_metadata(path) {
        Ok(metadata) if metadata.is_dir() => entries(path).map(|e| size(&e.path())).sum(),
        Ok(metadata) => Metadata::len(&metadata),
        Err(_) => 0,
    }
}

fn remove(path: &Path) -> io::Result<()> {
    if std::fs::symlink_metadata(path)?.is_dir() { std::fs::remove_dir_all(path) } else { std::fs::remove_file(path) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<_> = entries(folder).map(|e| e.file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn files_of_dead_processes_go_after_a_while() {
        let run_dir = tempfile::tempdir().unwrap();
        let blobs = run_dir.path().join("blobs");
        for name in ["view-1", "view-2"] {
            std::fs::create_dir_all(blobs.join(name)).unwrap();
            std::fs::write(blobs.join(name).join("a.npy"), "x").unwrap();
        }
        std::fs::write(blobs.join("loose.png"), "x").unwrap();
        let mut cleaning = Cleaning { run_dir: run_dir.path().to_owned(), unowned: BTreeMap::new() };
        let began = Instant::now();
        let living = BTreeSet::from(["view-2".to_owned()]);
        cleaning.clear_blobs(&living, began);
        cleaning.clear_blobs(&living, began + KEEP_BLOBS / 2);
        assert_eq!(names(&blobs), ["loose.png", "view-1", "view-2"]);
        cleaning.clear_blobs(&living, began + KEEP_BLOBS);
        assert_eq!(names(&blobs), ["view-2"]);
        // Its time begins with its end.
        cleaning.clear_blobs(&BTreeSet::new(), began + 2 * KEEP_BLOBS);
        assert_eq!(names(&blobs), ["view-2"]);
        cleaning.clear_blobs(&BTreeSet::new(), began + 3 * KEEP_BLOBS);
        assert!(names(&blobs).is_empty() && cleaning.unowned.len() <= 1);
    }

    #[test]
    fn scenes_go_by_age_and_size_but_the_newest_stays() {
        let folder = tempfile::tempdir().unwrap();
        let now = SystemTime::now();
        let day = Duration::from_secs(24 * 3600);
        for (name, days) in [("a", 0), ("b", 1), ("c", 2), ("d", 8)] {
            let scene = folder.path().join(name);
            std::fs::create_dir_all(scene.join("units")).unwrap();
            std::fs::write(scene.join("units/x.ply"), [0; 1000]).unwrap();
            std::fs::File::open(&scene).unwrap().set_modified(now - days * day).unwrap();
        }
        clear_scenes(folder.path(), now, 10_000);
        assert_eq!(names(folder.path()), ["a", "b", "c"]);
        clear_scenes(folder.path(), now, 2500);
        assert_eq!(names(folder.path()), ["a", "b"]);
        clear_scenes(folder.path(), now + 30 * day, 10);
        assert_eq!(names(folder.path()), ["a"]);
    }
}
