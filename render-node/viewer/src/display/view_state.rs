//! The state that a display shows.

use std::sync::Arc;

use glam::DVec3;
use sg_edit::EditState;
use sg_proto::language::Tour;
use sg_proto::scene::selection_step::Step;
use sg_proto::scene::{StrokeMode, WalkTuning};
use sg_proto::selection::{Answers, Proposal, ProposalsReply};
use sg_scene::mask::Mask;
use sg_scene::model::SceneBox;

use super::clusters::Clusters;
use super::conversation::Conversation;
use super::labeling::Labeling;

/// Most notices kept for a person.
pub const NOTICES: usize = 8;

/// The newest state for a display; each part is as new as its source. Cheap to clone.
#[derive(Debug, Clone)]
pub struct ViewState {
    /// The scene at its newest revision.
    pub scene: Arc<EditState>,
    /// Steps of undo, newest first.
    pub undo: Arc<[String]>,
    /// Steps of redo, next first.
    pub redo: Arc<[String]>,
    /// Revision of the scene that `undo` and `redo` belong to; see [`ViewState::knows_steps`].
    pub steps_at: u64,
    /// The selection: committed, or soon durable, or as if the stroke under way ended now.
    pub selected: Arc<Mask>,
    /// Whether `selected` is more than the scene has committed.
    pub uncommitted: bool,
    /// The walk's parameters behind `selected`, while a hand tries them.
    pub trial_tuning: Option<WalkTuning>,
    /// The selection process's support for walks; absent while it is away.
    pub walk_capabilities: Option<WalkCapabilities>,
    /// The answers to the walk strokes of the selection, as the selection service told them last.
    pub answers: Option<Arc<Answers>>,
    /// The newest proposals for a next stroke.
    pub proposals: Option<Arc<ProposalsReply>>,
    /// Super-Gaussians; absent until they are known.
    pub clusters: Option<Arc<Clusters>>,
    /// The conversation with the agents.
    pub conversation: Arc<Conversation>,
    /// State of the speech service; absent while it is away.
    pub speech: Option<Arc<sg_proto::speech::State>>,
    /// The agents' tour that is under way; absent without one.
    pub tour: Option<Arc<Tour>>,
    /// What the labeling service has told.
    pub labeling: Arc<Labeling>,
    /// Which services answer.
    pub services: ServiceAvailability,
    /// Errors and other notices, newest last, at most [`NOTICES`] lines.
    pub notices: Arc<[Notice]>,
}

impl ViewState {
    /// State of a scene before any other part is known.
    #[must_use]
    pub fn of(scene: Arc<EditState>) -> Self {
        Self {
            selected: Arc::clone(scene.selection().mask()),
            steps_at: scene.revision(),
            scene,
            undo: Arc::default(),
            redo: Arc::default(),
            uncommitted: false,
            trial_tuning: None,
            walk_capabilities: None,
            answers: None,
            proposals: None,
            clusters: None,
            conversation: Arc::default(),
            speech: None,
            tour: None,
            labeling: Arc::default(),
            services: ServiceAvailability::default(),
            notices: Arc::default(),
        }
    }

    /// This state with another one of its scene, such as a draft. The selection of a scene with other Gaussians goes.
    #[must_use]
    pub fn with_scene(&self, scene: Arc<EditState>) -> Self {
        let mut state = Self { scene, ..self.clone() };
        if !state.scene.has_gaussians_of(&self.scene) {
            state.selected = Arc::clone(state.scene.selection().mask());
            (state.uncommitted, state.trial_tuning) = (false, None);
        }
        state
    }

    /// Whether `undo` and `redo` are those of the shown scene. Until their answer comes they may be of an earlier revision, and a
    /// label would name a step that undo does not take back.
    #[must_use]
    pub fn knows_steps(&self) -> bool {
        self.steps_at >= self.scene.revision()
    }

    /// Whether an open microphone waits for a button or key that is held to talk.
    #[must_use]
    pub fn waits_to_talk(&self) -> bool {
        self.speech.as_ref().is_some_and(|speech| waits_to_talk(speech))
    }

    /// The change that undo takes back, as far as it is known.
    #[must_use]
    pub fn undo_step(&self) -> Option<&String> {
        self.undo.first().filter(|_| self.knows_steps())
    }

    /// The change that redo brings back, as far as it is known.
    #[must_use]
    pub fn redo_step(&self) -> Option<&String> {
        self.redo.first().filter(|_| self.knows_steps())
    }

    /// Parameters of the last walk or of its current trial. `None` without a walk, or without a service that can repeat it
    /// with others.
    #[must_use]
    pub fn tuning(&self) -> Option<WalkTuning> {
        let first = self.walk_capabilities.filter(|_| self.services.selection)?.tuning?;
        let steps = self.scene.selection().steps();
        let is_walk = |step: &Option<Step>| matches!(step, Some(Step::Stroke(s)) if s.mode() == StrokeMode::Walk);
        if !steps.iter().any(|s| is_walk(&s.step)) {
            return None;
        }
        let tuned = |step: &Option<Step>| if let Some(Step::Tuning(t)) = step { Some(*t) } else { None };
        let answered = || self.answers.as_ref().and_then(|answers| answers.tuning);
        let stored = || steps.iter().rev().find_map(|s| tuned(&s.step));
        Some(self.trial_tuning.or_else(stored).or_else(answered).unwrap_or(first))
    }

    /// The answers to the walk strokes, if there is more than one.
    #[must_use]
    pub fn answers(&self) -> Option<&Answers> {
        self.tuning()?;
        self.answers.as_deref().filter(|answers| answers.steps.len() > 1)
    }

    /// Most proposals for a next stroke; 0 without a walk to continue.
    #[must_use]
    pub fn most_proposals(&self) -> u32 {
        self.tuning().and(self.walk_capabilities).map_or(0, |w| w.most_proposals)
    }

    /// Proposals for a next stroke, best first, if they belong to the current selection.
    #[must_use]
    pub fn proposals(&self) -> &[Proposal] {
        let about = |p: &&Arc<ProposalsReply>| p.selection_hash == self.scene.selection().hash();
        self.proposals.as_ref().filter(about).filter(|_| self.most_proposals() > 0).map_or(&[], |p| &p.proposals)
    }

    /// Position of the proposal with this zero-based number, in a scene with these bounds.
    #[must_use]
    pub fn proposal_at(&self, bounds: SceneBox, number: usize) -> Option<DVec3> {
        let normalized = DVec3::from_slice(self.proposals().get(number)?.point.get(..3)?);
        Some(bounds.denormalize(normalized)).filter(|at| at.is_finite())
    }
}

/// Whether something hears where this state is from.
#[must_use]
pub(crate) fn has_microphone(speech: &sg_proto::speech::State) -> bool {
    !speech.input.is_empty() && !speech.recognizer.is_empty()
}

/// Whether an open microphone waits for a button or key that is held to talk.
#[must_use]
pub(crate) fn waits_to_talk(speech: &sg_proto::speech::State) -> bool {
    has_microphone(speech) && speech.trigger() == sg_proto::speech::Trigger::Held && !speech.muted
}

/// Walk capabilities of the selection service.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WalkCapabilities {
    /// Default parameters of walks; `None` if other parameters are not supported.
    pub tuning: Option<WalkTuning>,
    /// Most proposals that one answer holds.
    pub most_proposals: u32,
}

/// Available services: a control whose service is away is not drawn.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ServiceAvailability {
    /// The scene takes changes.
    pub scene: bool,
    /// Strokes become selections.
    pub selection: bool,
    /// The agents take part in a conversation.
    pub agents: bool,
    /// A text finds units, and units have best views.
    pub labeling: bool,
}

/// A line for a person.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Notice {
    /// Counts up, so that a display can distinguish a new line from a shown one.
    pub number: u64,
    /// The event and a remedy.
    pub text: String,
    /// Whether a request failed.
    pub refused: bool,
}
