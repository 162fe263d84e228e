//! Session names for opened files.

use std::ffi::OsStr;
use std::path::Path;

use crate::terminal::Failure;

/// Number of letters from the file's name, and from the hash of its path.
const LETTERS: (usize, usize) = (24, 8);

/// Session name of a file. The same file always has the same session, so its edits are found again.
///
/// # Errors
/// The file does not exist.
pub(crate) fn session_of(path: &Path) -> Result<String, Failure> {
    let path = std::fs::canonicalize(path).map_err(|e| Failure::Input(format!("{}: {e}", path.display())))?;
    let stem = |name: Option<&OsStr>| {
        let name = name.unwrap_or_default().to_string_lossy().into_owned();
        name.split('.').find(|part| !part.is_empty()).unwrap_or_default().to_owned()
    };
    let own = stem(path.file_name());
    // Scene files share one name. Their folder tells them apart.
    let own = if own == "scene" { stem(path.parent().and_then(Path::file_name)) } else { own };
    let letters = own.chars().map(|c| if c.is_ascii_alphanumeric() || c == '_' { c } else { '-' });
    let hash = blake3::hash(path.as_os_str().as_encoded_bytes()).to_hex();
    let hash: String = hash.chars().take(LETTERS.1).collect();
    Ok(format!("{}-{hash}", letters.take(LETTERS.0).collect::<String>()))
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
