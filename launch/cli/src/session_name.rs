//! Session names for opened files.

use std::path::Path;

use sg_formats::files::short_name;

use crate::terminal::Failure;

/// Number of letters from the hash of the file's path.
const HASH_LETTERS: usize = 8;

/// Session name of a file. The same file always has the same session, so its Gaussians are found again.
///
/// # Errors
/// The file does not exist.
pub(crate) fn session_of(path: &Path) -> Result<String, Failure> {
    let path = std::fs::canonicalize(path).map_err(|e| Failure::Input(format!("{}: {e}", path.display())))?;
    let hash = blake3::hash(path.as_os_str().as_encoded_bytes()).to_hex();
    let hash: String = hash.chars().take(HASH_LETTERS).collect();
    Ok(format!("{}-{hash}", short_name(&path)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use sg_runtime::session::SessionDir;

    #[test]
    fn session_name_depends_on_name_and_path() {
        let folder = tempfile::tempdir().unwrap();
        let name = |path: &str| {
            let path = folder.path().join(path);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(&path, "").unwrap();
            session_of(&path).unwrap()
        };
        let begins = |path: &str, with: &str| {
            let name = name(path);
            assert_eq!(name.rsplit_once('-').map(|(stem, hash)| (stem, hash.len())), Some((with, 8)), "{name}");
            assert!(SessionDir::named(&name).is_ok(), "{name}");
        };
        begins("tooth.raw.zst", "tooth");
        begins("a skull/scene.toml", "a-skull");
        begins("Ünder the very long name of a file.ply", "-nder-the-very-long-name");
        begins(".hidden", "hidden");
        assert_eq!(name("tooth.raw.zst"), session_of(&folder.path().join("./tooth.raw.zst")).unwrap());
        assert_ne!(name("tooth.raw.zst"), name("other/tooth.raw.zst"));
        assert!(matches!(session_of(&folder.path().join("none")), Err(Failure::Input(_))));
    }
}
