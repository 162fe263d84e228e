//! Hints of a first run: three at most, one at a time, beside the control that each is about. A hint ends for good when a person
//! dismisses it, or has done what it says.

use egui::{Align2, Area, Button, Color32, Id, Order, Pos2, Rect, Shape, Stroke, StrokeKind, Ui, Vec2};
use serde::{Deserialize, Serialize};

use crate::display::ViewState;
use crate::panels::theme;

/// Points between a hint in the picture and the picture's edge, and of the head that points from it.
const GAP: f32 = 10.0;
const HEAD: f32 = 8.0;

/// Points between a control and the ring around it, and of the ring's round corners.
const RING: f32 = 1.0;
const ROUND: f32 = 6.0;

/// One hint.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Hint {
    /// Brush something.
    Brush,
    /// Name what is selected.
    Name,
    /// Say something to the agents.
    Ask,
}

impl Hint {
    /// All, in the order in which they are shown.
    pub const ALL: [Self; 3] = [Self::Brush, Self::Name, Self::Ask];

    /// What it says.
    #[must_use]
    pub fn text(self) -> &'static str {
        match self {
            Self::Brush => "Brush a structure (B)",
            Self::Name => "Name it (Ctrl+S)",
            Self::Ask => "Ask for something (Enter)",
        }
    }

    /// Whether it has been followed.
    fn is_followed(self, state: &ViewState) -> bool {
        match self {
            Self::Brush => !state.selected.is_none(),
            Self::Name => state.scene.units().any(|unit| !unit.derived),
            Self::Ask => !state.conversation.turns.is_empty(),
        }
    }
}

/// Places of the controls that hints are about, in this frame.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct HintPlaces {
    /// The tool "brush".
    pub(super) brush: Option<Rect>,
    /// The field for a name.
    pub(super) name: Option<Rect>,
    /// The field for the agents.
    pub(super) ask: Option<Rect>,
}

impl HintPlaces {
    fn of(&self, hint: Hint) -> Option<Rect> {
        match hint {
            Hint::Brush => self.brush,
            Hint::Name => self.name,
            Hint::Ask => self.ask,
        }
    }
}

/// Shows the first hint that is not done at the side of the `picture`, where its control is in sight. Hints that are followed or dismissed are added to
/// `done`.
pub(super) fn show(ui: &Ui, places: HintPlaces, picture: Rect, state: &ViewState, done: &mut Vec<Hint>) {
    let followed = |hint: &Hint| hint.is_followed(state) && !done.contains(hint);
    let newly: Vec<Hint> = Hint::ALL.into_iter().filter(followed).collect();
    done.extend(newly);
    let Some(hint) = Hint::ALL.into_iter().find(|hint| !done.contains(hint)) else { return };
    let Some(place) = places.of(hint) else { return };
    // In the picture, so that it covers no control.
    let screen = ui.ctx().content_rect();
    let is_right_of_it = place.center().x < picture.center().x;
    let (side, pivot, x) = if is_right_of_it {
        (place.right_center(), Align2::LEFT_CENTER, picture.left() + GAP)
    } else {
        (place.left_center(), Align2::RIGHT_CENTER, picture.right() - GAP)
    };
    let at = Pos2::new(x, side.y);
    let area = Area::new(Id::unique("hint")).order(Order::Foreground).fixed_pos(at).pivot(pivot);
    area.show(ui.ctx(), |ui| {
        let (fill, text) = (ui.visuals().selection.bg_fill, ui.visuals().selection.stroke.color);
        let card = theme::card(ui).fill(fill).stroke(Stroke::NONE).show(ui, |ui| {
            ui.horizontal(|ui| {
                ui.colored_label(text, hint.text());
                let dismiss = ui.add(Button::new("×").small());
                ui.ctx().accesskit_node_builder(dismiss.id, |node| node.set_label("dismiss the hint"));
                if dismiss.on_hover_text("not again").clicked() {
                    done.push(hint);
                }
            });
        });
        // A ring around the control, and a head at the card that points to it: a line would cross other controls.
        let painter = ui.painter().with_clip_rect(screen);
        painter.rect_stroke(place.expand(RING), ROUND, Stroke::new(2.0, fill), StrokeKind::Outside);
        let card = card.response.rect;
        let (edge, way) = if is_right_of_it { (card.left_center(), -HEAD) } else { (card.right_center(), HEAD) };
        let half = Vec2::new(0.0, HEAD);
        let head = vec![edge - half, edge + Vec2::new(way, 0.0), edge + half];
        painter.add(Shape::convex_polygon(head, fill, Stroke::new(0.0, Color32::TRANSPARENT)));
    });
}
