//! Requests and actions returned by a panel.

use sg_proto::scene::command::Action;

use crate::display::{Drafts, Request, ViewState};

/// Host of the panels.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum PanelHost {
    /// In a window, with a mouse and a keyboard.
    #[default]
    Window,
    /// Before the eyes, pointed at with a ray; there is a trigger with pressure and no keyboard.
    Headset,
}

/// An action of the display itself, on request of a panel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DisplayAction {
    /// Bring all that is drawn into view.
    Fit,
    /// Keep the present place under the next free number.
    Bookmark,
    /// Go to the bookmark with this number, from 1.
    Place(u8),
    /// Show the panels that hang around a person where they were hidden, and the other way round.
    Panels,
    /// Keep a picture of the view.
    Screenshot,
    /// Looks at the proposal with this zero-based number ([`ViewState::proposals`]). In a headset, a person turns by
    /// themselves, so the mark is emphasized instead.
    Proposal(u8),
}

/// A change under a hand.
#[derive(Debug, Clone, PartialEq)]
pub enum Draft {
    /// In progress: shown, not yet sent. Returned once for each change under the hand.
    Hold(Action),
    /// Just released; the same change is among the requests.
    Release(Action),
}

/// Output of the panels in one frame.
#[derive(Debug, Default, PartialEq)]
pub struct Output {
    /// Requests to send to the view port, in this order.
    pub requests: Vec<Request>,
    /// The draft under the hand.
    pub draft: Option<Draft>,
    /// Actions of the display itself.
    pub actions: Vec<DisplayAction>,
    /// Whether the colour of a unit is being chosen. A highlight would change what a person sees of it.
    pub is_choosing_color: bool,
}

impl Output {
    pub(super) fn change(&mut self, action: Action) {
        self.requests.push(Request::Change(Box::new(action)));
    }

    /// Has the change under the hand seen over the scene that the panels have shown.
    pub fn show_draft(&mut self, drafts: &mut Drafts, state: &ViewState) {
        match self.draft.take() {
            Some(Draft::Hold(action)) => drafts.hold(action),
            Some(Draft::Release(action)) => drafts.release(action, state.scene.revision()),
            None => (),
        }
    }

    /// Adds the output of another panel of the same frame.
    pub fn join(&mut self, other: Self) {
        self.requests.extend(other.requests);
        self.draft = other.draft.or(self.draft.take());
        self.actions.extend(other.actions);
        self.is_choosing_color |= other.is_choosing_color;
    }
}
