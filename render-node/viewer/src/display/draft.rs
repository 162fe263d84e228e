//! A change that is still being made: seen at once in this display, not told to anybody.
//!
//! A slider that is dragged makes one draft after another; when it is let go, one change is asked for, and the draft shows
//! until the scene tells of it or a second has passed, so that nothing flickers in between.

use std::sync::Arc;
use std::time::{Duration, Instant};

use sg_edit::EditState;
use sg_proto::scene::command::Action;
use sg_scene::model::Scene;

/// Longest time that a draft outlives the hand that made it.
const SETTLES: Duration = Duration::from_secs(1);

/// The draft of one display, if there is one.
#[derive(Debug, Default)]
pub struct Drafts {
    held: Option<Draft>,
}

#[derive(Debug)]
struct Draft {
    action: Action,
    /// Revision of the scene at which the change was asked for, and until when it is waited for.
    asked: Option<(u64, Instant)>,
    /// The cached result and the state that it was made from.
    made: Option<(Arc<EditState>, Arc<EditState>)>,
}

impl Drafts {
    /// A hand makes this change and goes on.
    pub fn hold(&mut self, action: Action) {
        self.held = Some(Draft { action, asked: None, made: None });
    }

    /// The hand lets go: the change, which was asked for at this revision, shows until the scene tells of it.
    pub fn release(&mut self, action: Action, revision: u64) {
        self.held = Some(Draft { action, asked: Some((revision, Instant::now() + SETTLES)), made: None });
    }

    /// Whether nothing shows that the scene does not have.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.held.is_none()
    }

    /// The state with the draft on it, as the scene's owner would make it; the state itself where there is no draft, or none
    /// that it would accept. Forgets what the scene has told of.
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
