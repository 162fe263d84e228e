//! Polygons: the mouse sets one corner after another, and the closed polygon selects as a lasso does.

use egui::Pos2;

/// Points within which a press on the first or the last corner closes the polygon.
pub(super) const CLOSE: f32 = 9.0;

/// Most corners.
const CORNERS: usize = 2000;

/// The instruction beside the picture.
pub(super) const HINT: &str = "Click corner by corner. Enter, a double click or a click on the first corner closes the polygon; with Shift it \
                    takes away. Backspace takes back a corner, Esc cancels.";

/// The polygon under way.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Polygon {
    /// Points of the window.
    pub(super) corners: Vec<Pos2>,
    /// Whether the button still holds the last corner.
    pub(super) is_held: bool,
    /// Whether Enter closes it at this frame.
    pub(super) is_closed: bool,
}

impl Polygon {
    /// A press at a place; returns whether it closes the polygon.
    pub(super) fn press(&mut self, at: Pos2) -> bool {
        let near = |corner: Option<&Pos2>| corner.is_some_and(|corner| corner.distance(at) <= CLOSE);
        if near(self.corners.first()) || near(self.corners.last()) {
            // The second press of a double click lies on the last corner.
            return self.corners.len() >= 3;
        }
        if self.corners.len() < CORNERS {
            self.corners.push(at);
            self.is_held = true;
        }
        false
    }

    /// Whether a press at a place closes it on its first corner.
    pub(super) fn closes_at(&self, at: Pos2) -> bool {
        self.corners.len() >= 3 && self.corners.first().is_some_and(|first| first.distance(at) <= CLOSE)
    }

    /// Forgets all corners.
    pub(super) fn clear(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_polygon_closes_on_its_first_and_its_last_corner() {
        let place = |k: u8| Pos2::new(50.0 * f32::from(k), if k == 1 { 80.0 } else { 10.0 });
        let mut polygon = Polygon::default();
        for k in 0..2 {
            assert!(!polygon.press(place(k)) && !polygon.press(place(k)), "two corners enclose nothing");
        }
        assert_eq!(polygon.corners.len(), 2, "a corner is set once");
        assert!(!polygon.press(place(2)));
        let near = |corner: Pos2| corner + egui::Vec2::splat(5.0);
        assert!(polygon.closes_at(near(place(0))) && polygon.clone().press(near(place(0))));
        assert!(!polygon.closes_at(near(place(2))) && polygon.clone().press(near(place(2))));
        assert!(!polygon.press(place(3)) && polygon.corners.len() == 4);
        (0..5000).for_each(|k| {
            polygon.press(Pos2::new(300.0 + 20.0 * k as f32, 500.0));
        });
        assert_eq!(polygon.corners.len(), CORNERS);
    }
}
