//! The table of panels. The window, the headset and the tests use it.

use super::panel::Panel;

impl Panel {
    /// All panels. A window stacks those of one side in this order, and has tabs in this order where it is narrow. In a headset the first one shows the notices.
    pub const ALL: &'static [Self] = &[Self::SCENE, Self::SELECT, Self::LANGUAGE, Self::KEYBOARD, Self::WRIST];
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    #[test]
    fn no_two_panels_hang_at_one_place() {
        for (k, one) in Panel::ALL.iter().enumerate() {
            assert!(Panel::ALL.iter().skip(k + 1).all(|other| other.place != one.place), "{one:?}");
        }
    }

    #[test]
    fn names_and_titles_are_unique() {
        let names: HashSet<_> = Panel::ALL.iter().map(|panel| panel.name).collect();
        let titles: HashSet<_> = Panel::ALL.iter().map(|panel| panel.title).collect();
        assert_eq!((names.len(), titles.len()), (Panel::ALL.len(), Panel::ALL.len()));
    }
}
