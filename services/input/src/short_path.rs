//! Paths for people.

use std::path::Path;

use crate::printable;

/// A path for people: `~` stands for the home folder, and letters that a screen cannot show are escaped.
#[must_use]
pub fn short_path(path: &Path) -> String {
    let home = std::env::home_dir().filter(|home| home.parent().is_some());
    shortened(path, home.as_deref())
}

fn shortened(path: &Path, home: Option<&Path>) -> String {
    let text = match home.and_then(|home| path.strip_prefix(home).ok()) {
        Some(rest) => format!("~/{}", rest.display()),
        None => path.display().to_string(),
    };
    printable(&text).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_home_folder_is_a_tilde() {
        let of = |path: &str| shortened(Path::new(path), Some(Path::new("/users/ada")));
        assert_eq!(of("/users/ada/heart/sac.ply"), "~/heart/sac.ply");
        assert_eq!(of("/users/adam/sac.ply"), "/users/adam/sac.ply");
        assert_eq!(shortened(Path::new("/data/a\nb.ply"), None).lines().count(), 1);
    }
}
