//! Panels as quad layers of a frame.

use crate::hands::Rectangle;

/// A panel's images, made by [`super::Headset::panel`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct PanelId {
    pub(super) at: usize,
    /// Number of its session.
    pub(super) session: u64,
}

/// A panel as it hangs in the room.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quad {
    /// The panel.
    pub panel: PanelId,
    /// Its placement and size.
    pub place: Rectangle,
    /// Whether it is in front of the eyes' pictures. Behind them it shows where they have less than full opacity.
    pub in_front: bool,
}
