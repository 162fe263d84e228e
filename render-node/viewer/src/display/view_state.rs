//! The state that a display shows.

use std::sync::Arc;

use glam::DVec3;
use sg_edit::EditState;
use sg_proto::scene::selection_step::Step;
use sg_proto::scene::{StrokeMode, WalkTuning};
use sg_proto::selection::{Proposal, ProposalsReply};
use sg_scene::mask::Mask;
use sg_scene::model::SceneBox;

use super::conversation::Conversation;

/// Lines that are kept for a person to read.
pub const NOTICES: usize = 8;

/// The newest of everything that a display shows, each part by itself as new as it is known. Cheap to clone.
#[derive(Debug, Clone)]
pub struct ViewState {
    /// The scene at its newest revision.
    pub scene: Arc<EditState>,
    /// Steps of undo, newest first.
    pub undo: Arc<[String]>,
    /// Steps of redo, next first.
    pub redo: Arc<[String]>,
    /// What is selected, or will be as soon as it is durable, or would be if the stroke under way ended now.
    pub selected: Arc<Mask>,
    /// Whether `selected` is more than the scene has committed.
    pub uncommitted: bool,
    /// What `selected` is the walk's with, while a hand tries that.
    pub trial_tuning: Option<WalkTuning>,
    /// What the selection's process does with walks; absent while it is away.
    pub walk_capabilities: Option<WalkCapabilities>,
    /// Where a next stroke would tell most, as it was told last.
    pub proposals: Option<Arc<ProposalsReply>>,
    /// Super-Gaussian of each Gaussian, [`sg_raster::structure::NO_CLUSTER`] for none; absent until clusters are known.
    pub clusters: Option<Arc<[u32]>>,
    /// The conversation with the agents.
    pub conversation: Arc<Conversation>,
    /// Which services answer.
    pub services: ServiceAvailability,
    /// What went wrong or is worth knowing, newest last, at most [`NOTICES`] lines.
    pub notices: Arc<[Notice]>,
}

impl ViewState {
    /// A scene of which nothing else is known.
    #[must_use]
    pub fn of(scene: Arc<EditState>) -> Self {
        Self {
            selected: Arc::clone(scene.selection().mask()),
            scene,
            undo: Arc::default(),
            redo: Arc::default(),
            uncommitted: false,
            trial_tuning: None,
            walk_capabilities: None,
            proposals: None,
            clusters: None,
            conversation: Arc::default(),
            services: ServiceAvailability::default(),
            notices: Arc::default(),
        }
    }

    /// What the last walk is done with, or is being tried with; `None` where there is no walk, or nobody who would do it
    /// again with something else.
    #[must_use]
    pub fn tuning(&self) -> Option<WalkTuning> {
        let first = self.walk_capabilities.filter(|_| self.services.selection)?.tuning?;
        let steps = self.scene.selection().steps();
        let is_walk = |step: &Option<Step>| matches!(step, Some(Step::Stroke(s)) if s.mode() == StrokeMode::Walk);
        if !steps.iter().any(|s| is_walk(&s.step)) {
            return None;
        }
        let tuned = |step: &Option<Step>| if let Some(Step::Tuning(t)) = step { Some(*t) } else { None };
        Some(self.trial_tuning.or_else(|| steps.iter().rev().find_map(|s| tuned(&s.step))).unwrap_or(first))
    }

    /// How many places for a next stroke can be asked for; 0 where there is no walk that could go on.
    #[must_use]
    pub fn most_proposals(&self) -> u32 {
        self.tuning().and(self.walk_capabilities).map_or(0, |w| w.most_proposals)
    }

    /// Where a next stroke would tell most, best first, as far as that is about the selection that is there.
    #[must_use]
    pub fn proposals(&self) -> &[Proposal] {
        let about = |p: &&Arc<ProposalsReply>| p.selection_hash == self.scene.selection().hash();
        self.proposals.as_ref().filter(about).filter(|_| self.most_proposals() > 0).map_or(&[], |p| &p.proposals)
    }

    /// Where in a scene with these bounds the proposal of a number from 0 lies.
    #[must_use]
    pub fn proposal_at(&self, bounds: SceneBox, number: usize) -> Option<DVec3> {
        let normalized = DVec3::from_slice(self.proposals().get(number)?.point.get(..3)?);
        Some(bounds.denormalize(normalized)).filter(|at| at.is_finite())
    }
}

/// Walk capabilities of the selection service.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WalkCapabilities {
    /// What they are done with where no step says otherwise; `None` where nothing else can be asked for.
    pub tuning: Option<WalkTuning>,
    /// Most places for a next stroke that it tells of at once.
    pub most_proposals: u32,
}

/// Which services answer: a control whose service is away is not drawn.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ServiceAvailability {
    /// The scene takes changes.
    pub scene: bool,
    /// Strokes become selections.
    pub selection: bool,
    /// The agents take part in a conversation.
    pub agents: bool,
}

/// A line for a person.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Notice {
    /// Counts up, so that a display can tell a new line from one it has shown.
    pub number: u64,
    /// The event and a remedy.
    pub text: String,
    /// Whether something asked for was not done.
    pub refused: bool,
}
