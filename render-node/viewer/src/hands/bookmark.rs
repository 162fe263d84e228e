//! Placements to come back to.

use super::placement::Placement;

/// Most bookmarks kept; the oldest makes room.
pub const MOST_BOOKMARKS: usize = 32;

/// A placement with a name.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Bookmark {
    /// Name.
    pub name: String,
    /// Placement of the scene.
    pub placement: Placement,
}

/// Placements with names, in the order they were made.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Bookmarks {
    kept: Vec<Bookmark>,
}

impl Bookmarks {
    /// Keeps a placement; it replaces one of the same name in place.
    pub fn keep(&mut self, name: &str, placement: Placement) {
        if let Some(known) = self.kept.iter_mut().find(|b| b.name == name) {
            known.placement = placement;
            return;
        }
        if self.kept.len() >= MOST_BOOKMARKS {
            self.kept.remove(0);
        }
        self.kept.push(Bookmark { name: name.to_owned(), placement });
    }

    /// Removes one; returns whether it existed.
    pub fn forget(&mut self, name: &str) -> bool {
        let before = self.kept.len();
        self.kept.retain(|b| b.name != name);
        self.kept.len() < before
    }

    /// All of them.
    #[must_use]
    pub fn all(&self) -> &[Bookmark] {
        &self.kept
    }

    /// The placement of that name.
    #[must_use]
    pub fn find(&self, name: &str) -> Option<Placement> {
        self.kept.iter().find(|b| b.name == name).map(|b| b.placement)
    }
}
