//! A panel's row in the table of panels: its name, its size, its places, and the function that draws it.

use std::fmt;

use egui::{Sense, Stroke, Ui, Vec2};

use super::control::scale;
use super::icon::{Icon, draw};
use super::output::Output;
use super::state::Panels;
use super::theme;
use crate::display::{Tools, ViewState};

/// Side of a window at which a panel is docked. Panels at one side share its height.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dock {
    /// At the left.
    Left,
    /// At the right.
    Right,
}

impl Dock {
    /// Both sides, in the order in which they take their width.
    pub const ALL: [Self; 2] = [Self::Left, Self::Right];
}

/// Place of a panel around a person in a headset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RoomPlace {
    /// Upright, at a distance.
    Around {
        /// Degrees to the right of straight ahead.
        degrees: f64,
    },
    /// Below the eyes and tilted, while a text field waits for letters.
    Below,
    /// Below the palm of the hand that does not brush, while it is turned to the eyes.
    Wrist,
}

/// One panel, a row of [`Panel::ALL`]. Its file in this folder defines the row, and the function that draws it.
#[derive(Clone, Copy)]
pub struct Panel {
    /// Short name: that of its picture `docs/pictures/panel-NAME.png`. Unique.
    pub name: &'static str,
    /// Title on screen, and its heading in `docs/panels.md`.
    pub title: &'static str,
    /// Picture beside its heading; `None` for a panel without a heading.
    pub(super) icon: Option<Icon>,
    /// Its size in points when it stands alone in front of a person, before multiplication by [`Tools::scale`]. Content
    /// beyond its height scrolls.
    pub size: Vec2,
    /// Its side in a window; `None` for a panel of headsets alone.
    pub dock: Option<Dock>,
    /// Its first place in a headset.
    pub place: RoomPlace,
    /// Whether the services that it needs answer.
    pub(super) has_content: fn(&ViewState) -> bool,
    /// Draws it into the rest of a [`Ui`] and returns its requests.
    pub(super) draw: fn(&mut Panels, &mut Ui, &ViewState, &mut Tools) -> Output,
}

impl Panel {
    /// Its least width and height in metres for a viewing distance in metres. At this size, a line of its smallest text
    /// takes [`theme::LINE_DEGREES`].
    #[must_use]
    pub fn least_metres(self, distance: f64) -> [f64; 2] {
        let point = theme::metres_per_point(distance);
        [f64::from(self.size.x) * point, f64::from(self.size.y) * point]
    }

    /// Whether there is anything to show in it now.
    #[must_use]
    pub fn has_content(self, state: &ViewState) -> bool {
        (self.has_content)(state)
    }

    /// Draws its title with its icon.
    pub(super) fn heading(self, ui: &mut Ui) {
        ui.horizontal(|ui| {
            if let Some(icon) = self.icon {
                let (rect, _) = ui.allocate_exact_size(Vec2::splat(20.0 * scale(ui)), Sense::hover());
                let stroke = Stroke::new(1.6 * scale(ui), ui.visuals().hyperlink_color);
                draw(ui.painter(), icon, true, rect.shrink(2.0 * scale(ui)), stroke);
            }
            ui.heading(self.title);
        });
    }
}

impl fmt::Debug for Panel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name)
    }
}

impl PartialEq for Panel {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

impl Eq for Panel {}
