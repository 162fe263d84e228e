//! The newest few of something by id, so that a request that comes again gets what it got.

use std::collections::VecDeque;

/// At most a fixed number of values, the oldest dropped first.
#[derive(Debug, Clone)]
pub struct Recent<T> {
    capacity: usize,
    items: VecDeque<(String, T)>,
}

impl<T> Recent<T> {
    /// Room for `capacity` values.
    #[must_use]
    pub fn new(capacity: usize) -> Self {
        Self { capacity, items: VecDeque::new() }
    }

    /// The value kept under an id. Nothing is ever kept under the empty id.
    #[must_use]
    pub fn get(&self, id: &str) -> Option<&T> {
        self.items.iter().find(|(kept, _)| kept == id).map(|(_, value)| value)
    }

    /// Keeps a value as the newest, in place of what was under the same id.
    pub fn keep(&mut self, id: &str, value: T) {
        self.drop(id);
        if id.is_empty() || self.capacity == 0 {
            return;
        }
        if self.items.len() >= self.capacity {
            self.items.pop_front();
        }
        self.items.push_back((id.to_owned(), value));
    }

    /// Forgets what is under an id.
    pub fn drop(&mut self, id: &str) {
        self.items.retain(|(kept, _)| kept != id);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_are_kept_and_never_more_than_there_is_room_for() {
        let mut recent = Recent::new(2);
        for (id, value) in [("a", 1), ("b", 2), ("a", 3), ("c", 4), ("", 5)] {
            recent.keep(id, value);
        }
        assert_eq!(
            (recent.get("a"), recent.get("b"), recent.get("c"), recent.get("")),
            (Some(&3), None, Some(&4), None)
        );
        recent.drop("a");
        assert_eq!(recent.get("a"), None);
    }
}
