//! The X display of this session.

/// Whether a window can be opened here: `DISPLAY` is set.
pub(crate) fn has_display() -> bool {
    std::env::var_os("DISPLAY").is_some_and(|display| !display.is_empty())
}
