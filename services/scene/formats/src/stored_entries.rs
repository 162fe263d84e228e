//! Folders of entries that programs store for themselves: each holds the newest ones only.

use std::path::Path;
use std::{fs, io};

/// Removes the oldest files with an ending, by the time of their last change, until `most` are left.
///
/// # Errors
/// The system's error. A file that another process has removed meanwhile is none.
pub fn keep_newest(folder: &Path, extension: &str, most: usize) -> io::Result<()> {
    let mut entries = Vec::new();
    for file in fs::read_dir(folder)? {
        let path = file?.path();
        if path.extension().is_some_and(|own| own == extension) {
            match fs::metadata(&path).and_then(|metadata| metadata.modified()) {
                Ok(modified) => entries.push((modified, path)),
                Err(error) if error.kind() == io::ErrorKind::NotFound => {}
                Err(error) => return Err(error),
            }
        }
    }
    entries.sort();
    let surplus = entries.len().saturating_sub(most);
    for (_, path) in entries.into_iter().take(surplus) {
        match fs::remove_file(path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, SystemTime};

    use super::*;

    #[test]
    fn the_oldest_entries_go_and_other_files_stay() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let start = SystemTime::now() - Duration::from_secs(100);
        for (age, name) in ["b.entry", "a.entry", "c.entry", "old.txt", "d.entry"].into_iter().enumerate() {
            let file = fs::File::create(path(name)).unwrap();
            file.set_modified(start + Duration::from_secs(age as u64)).unwrap();
        }
        keep_newest(folder.path(), "entry", 2).unwrap();
        let left = ["a.entry", "b.entry", "c.entry", "d.entry", "old.txt"].map(|name| path(name).exists());
        assert_eq!(left, [false, false, true, true, true]);
        assert!(keep_newest(&path("nowhere"), "entry", 2).is_err());
    }
}
