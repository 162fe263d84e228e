//! Saved viewpoints of a window.

use sg_scene::view::View;

/// Most places of one window.
const PLACES: usize = 9;

/// Views by number, from 1.
#[derive(Debug, Default)]
pub(super) struct Bookmarks(Vec<View>);

impl Bookmarks {
    /// Keeps a view under the next number; `None` where all are taken.
    pub(super) fn keep(&mut self, view: View) -> Option<u8> {
        if self.0.len() >= PLACES {
            return None;
        }
        self.0.push(view);
        u8::try_from(self.0.len()).ok()
    }

    /// The view of a number.
    pub(super) fn place(&self, number: u8) -> Option<View> {
        self.0.get(usize::from(number).checked_sub(1)?).copied()
    }

    /// The numbers that are taken.
    pub(super) fn numbers(&self) -> impl Iterator<Item = u8> + use<> {
        1..=self.0.len() as u8
    }
}
