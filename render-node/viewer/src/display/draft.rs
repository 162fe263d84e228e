//! A change in progress: visible at once in this display, not yet published.
//!
//! A dragged slider makes one draft after another. On release, the display requests one change. The draft shows until the
//! scene confirms it or a second has passed, so that nothing flickers.

use std::sync::Arc;
use std::time::{Duration, Instant};

use sg_edit::EditState;
use sg_proto::scene::command::Action;
use sg_scene::model::Scene;

/// Longest time that a draft shows after its release.
const SETTLES: Duration = Duration::from_secs(1);

/// The draft of one display, if any.
#[derive(Debug, Default)]
pub struct Drafts {
    held: Option<Draft>,
}

#[derive(Debug)]
struct Draft {
    action: Action,
    /// Revision of the scene at the request, and the deadline for its confirmation.
    asked: Option<(u64, Instant)>,
    /// The cached result and the state that it was made from.
    made: Option<(Arc<EditState>, Arc<EditState>)>,
}

impl Drafts {
    /// A hand makes this change and continues.
    pub fn hold(&mut self, action: Action) {
        self.held = Some(Draft { action, asked: None, made: None });
    }

    /// The hand lets go: the change, requested at this revision, shows until the scene confirms it.
    pub fn release(&mut self, action: Action, revision: u64) {
        self.held = Some(Draft { action, asked: Some((revision, Instant::now() + SETTLES)), made: None });
    }

    /// The hand gives its change up.
    pub fn drop_held(&mut self) {
        self.held.take_if(|draft| draft.asked.is_none());
    }

    /// Whether a hand is at a change that was not requested.
    #[must_use]
    pub fn is_held(&self) -> bool {
        self.held.as_ref().is_some_and(|draft| draft.asked.is_none())
    }

    /// Whether the display shows exactly the scene's state.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.held.is_none()
    }

    /// Time until a released draft stops showing without a confirmation; `None` while there is none.
    #[must_use]
    pub fn expires_in(&self) -> Option<Duration> {
        let (_, until) = self.held.as_ref()?.asked?;
        Some(until.saturating_duration_since(Instant::now()))
    }

    /// The state with the draft applied, as the scene's owner would apply it. Returns the state itself without a draft, or
    /// if it would reject the draft. Drops a draft that the scene has confirmed.
    #[must_use]
    pub fn over(&mut self, scene: &Arc<Scene>, state: &Arc<EditState>) -> Arc<EditState> {
        let told = |d: &mut Draft| d.asked.is_some_and(|(at, until)| state.revision() > at || Instant::now() > until);
        self.held.take_if(told);
        let Some(Draft { action, made, .. }) = &mut self.held else { return Arc::clone(state) };
        if let Some((_, after)) = made.as_ref().filter(|(of, _)| Arc::ptr_eq(of, state)) {
            return Arc::clone(after);
        }
        let after = state.after(scene, action.clone()).map_or_else(|_| Arc::clone(state), Arc::new);
        *made = Some((Arc::clone(state), Arc::clone(&after)));
        after
    }
}
