//! Tools of the left mouse button.

use crate::panels::Icon;

/// Tool of the left button.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MouseTool {
    /// It moves the eye.
    #[default]
    Navigate,
    /// Brushes over the front surface.
    Brush,
    /// Draws a lasso.
    Lasso,
    /// It draws a rectangle around it.
    Rectangle,
    /// Sets the corners of a polygon.
    Polygon,
    /// Draws a sphere about a place of the surface.
    Sphere,
    /// Draws a box about a place of the surface.
    Box,
    /// Moves, turns and scales the selection.
    Move,
}

impl MouseTool {
    /// All, in the order of the toolbar.
    pub const ALL: [Self; 8] =
        [Self::Navigate, Self::Brush, Self::Lasso, Self::Rectangle, Self::Polygon, Self::Sphere, Self::Box, Self::Move];

    /// The tool of the next window. A scene opens as a rule without a selection, so that nothing can be moved.
    #[must_use]
    pub fn at_first(self) -> Self {
        if self == Self::Move { Self::Navigate } else { self }
    }

    /// Name in the window.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Navigate => "navigate",
            Self::Brush => "brush",
            Self::Lasso => "lasso",
            Self::Rectangle => "rectangle",
            Self::Polygon => "polygon",
            Self::Sphere => "sphere",
            Self::Box => "box",
            Self::Move => "move",
        }
    }

    /// Its icon.
    pub(super) fn icon(self) -> Icon {
        match self {
            Self::Navigate => Icon::Arrows,
            Self::Brush => Icon::Brush,
            Self::Lasso => Icon::Lasso,
            Self::Rectangle => Icon::Rectangle,
            Self::Polygon => Icon::Polygon,
            Self::Sphere => Icon::Sphere,
            Self::Box => Icon::Cube,
            Self::Move => Icon::Move,
        }
    }

    /// One line on the effect of a drag, with its key.
    #[must_use]
    pub fn hint(self) -> &'static str {
        match self {
            Self::Navigate => "A drag turns the scene. (N)",
            Self::Brush => "A drag selects what it brushes over; with Shift it takes away. (B)",
            Self::Lasso => "A drag selects what it encircles; with Shift it takes away. (L)",
            Self::Rectangle => "A drag selects what is inside the rectangle; with Shift it takes away. (R)",
            Self::Polygon => "Clicks set corners, Enter selects what is inside; with Shift it takes away. (J)",
            Self::Sphere => "A drag from a surface selects what is in the sphere; with Shift it takes away. (O)",
            Self::Box => "A drag from a surface selects what is in the box; with Shift it takes away. (C)",
            Self::Move => "Arrows move the selection, rings turn it, the square scales it. (Shift+M)",
        }
    }
}
