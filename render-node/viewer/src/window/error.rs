//! Errors of a window.

/// Reason for a window's failure to open or to continue.
#[derive(Debug, thiserror::Error)]
pub enum WindowError {
    /// No display to open it on.
    #[error("no window can be opened: {0}; set DISPLAY, or start with `display = \"none\"`")]
    Display(String),
    /// No device to show anything with.
    #[error("nothing can be shown in the window: {0}; install a Vulkan driver, or start with `display = \"none\"`")]
    Surface(String),
    /// No threads to draw with.
    #[error("no threads to draw with: {0}")]
    Threads(String),
}
