//! The panels: name, size, and whether there is content.

use egui::Vec2;

use super::theme;
use crate::display::ViewState;

/// One of the panels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Panel {
    /// Units, light, viewpoint, history, display options.
    Scene,
    /// Brush and selection ("Select").
    Select,
    /// The conversation with the agents.
    Language,
    /// The virtual keyboard.
    Keyboard,
    /// The menu at the wrist of a person in a room.
    Wrist,
}

impl Panel {
    /// All.
    pub const ALL: [Self; 5] = [Self::Scene, Self::Select, Self::Language, Self::Keyboard, Self::Wrist];

    /// Name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Scene => "Scene control",
            Self::Select => "Select",
            Self::Language => "Language",
            Self::Keyboard => "Keyboard",
            Self::Wrist => "Wrist menu",
        }
    }

    /// Its size in points when it stands alone in front of a person, before multiplication by `Tools::scale`. Content
    /// beyond its height scrolls.
    #[must_use]
    pub fn size(self) -> Vec2 {
        match self {
            Self::Scene => Vec2::new(460.0, 760.0),
            Self::Select => Vec2::new(420.0, 700.0),
            Self::Language => Vec2::new(560.0, 640.0),
            Self::Keyboard => Vec2::new(760.0, 320.0),
            Self::Wrist => Vec2::new(340.0, 136.0),
        }
    }

    /// Its least width and height in metres for a viewing distance in metres. At this size, a line of its smallest text
    /// takes [`theme::LINE_DEGREES`].
    #[must_use]
    pub fn least_metres(self, distance: f64) -> [f64; 2] {
        let point = theme::metres_per_point(distance);
        [f64::from(self.size().x) * point, f64::from(self.size().y) * point]
    }

    /// Whether there is anything to show in it now.
    #[must_use]
    pub fn has_content(self, state: &ViewState) -> bool {
        match self {
            Self::Scene | Self::Keyboard | Self::Wrist => true,
            Self::Select => state.services.selection || state.services.scene,
            Self::Language => state.services.agents,
        }
    }
}
