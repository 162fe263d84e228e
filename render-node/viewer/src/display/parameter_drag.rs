//! The dragged leak or threshold of the last walk: tried as the hand moves, committed as one step on release.

use std::time::{Duration, Instant};

use sg_edit::{LEAK_RANGE, reach_of};
use sg_proto::scene::{SelectionStep, WalkTuning, selection_step::Step};
use sg_proto::selection::{Answer, AnswerStep, Answers, StrokesRequest};

use super::number_format::{decimal, percent};
use super::request::Request;
use super::view_state::ViewState;

/// The least and the greatest threshold that a hand reaches.
pub const THRESHOLD_RANGE: (f64, f64) = (-0.95, 0.95);

/// Longest time that a released value shows before the scene confirms it.
const SETTLES: Duration = Duration::from_secs(1);

/// What a stick, a key or the wheel changes of a walk.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum WalkParameter {
    /// The answer to the strokes: narrower or wider, in steps. Without several answers it stands for [`Self::Leak`].
    #[default]
    Size,
    /// Leak to the background: a greater leak selects less.
    Leak,
    /// Required lead of the foreground.
    Threshold,
}

impl WalkParameter {
    /// All.
    pub const ALL: [Self; 3] = [Self::Size, Self::Leak, Self::Threshold];

    /// Those that a walk has.
    #[must_use]
    pub fn of(state: &ViewState) -> &'static [Self] {
        if state.answers().is_some() { &Self::ALL } else { &Self::ALL[1..] }
    }

    /// The one that a chosen parameter stands for in this state.
    #[must_use]
    pub fn in_state(self, state: &ViewState) -> Self {
        if Self::of(state).contains(&self) { self } else { Self::Leak }
    }

    /// The one before, or the one after it; the ends have themselves.
    #[must_use]
    pub fn beside(self, after: bool, state: &ViewState) -> Self {
        let all = Self::of(state);
        let at = all.iter().position(|p| *p == self.in_state(state)).unwrap_or(0);
        let to = if after { (at + 1).min(all.len() - 1) } else { at.saturating_sub(1) };
        all.get(to).copied().unwrap_or_default()
    }

    /// Name on panels and in the legend.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Size => "Size",
            Self::Leak => "Reach",
            Self::Threshold => "Strictness",
        }
    }

    /// The next one, round and round.
    #[must_use]
    pub fn next(self, state: &ViewState) -> Self {
        match self.beside(true, state) {
            last if last == self.in_state(state) => Self::of(state).first().copied().unwrap_or_default(),
            next => next,
        }
    }

    /// This number of a walk, for a person.
    #[must_use]
    pub fn written(self, tuning: WalkTuning, state: &ViewState) -> String {
        match self {
            Self::Size => state.answers().map(answer_place).unwrap_or_default(),
            Self::Leak => percent(reach_of(tuning.leak)),
            Self::Threshold => decimal(tuning.threshold),
        }
    }

    /// A walk with this number moved along its range, by a share of the whole range.
    #[must_use]
    pub fn moved(self, tuning: WalkTuning, by: f64) -> WalkTuning {
        let by = if by.is_finite() { by } else { 0.0 };
        match self {
            Self::Size => tuning,
            Self::Leak => {
                let (least, greatest) = LEAK_RANGE;
                let leak = tuning.leak.max(least) * (greatest / least).powf(by);
                WalkTuning { leak: leak.clamp(least, greatest), ..tuning }
            }
            Self::Threshold => {
                let (least, greatest) = THRESHOLD_RANGE;
                let threshold = tuning.threshold + by * (greatest - least);
                WalkTuning { threshold: threshold.clamp(least, greatest), ..tuning }
            }
        }
    }
}

/// The place of the taken answer among all, such as "2 of 3".
#[must_use]
pub fn answer_place(answers: &Answers) -> String {
    format!("{} of {}", answers.taken.saturating_add(1), answers.steps.len())
}

/// The request for a wider or a narrower answer to the walk strokes. `None` where none lies on that side.
#[must_use]
pub fn other_answer(wider: bool, include_hidden: bool, state: &ViewState) -> Option<Request> {
    beside_answer(wider, state)?;
    let answer = if wider { AnswerStep::Wider } else { AnswerStep::Narrower };
    Some(Request::Select(StrokesRequest { answer: answer.into(), include_hidden, ..StrokesRequest::default() }))
}

/// The answer that is the next wider or narrower one.
#[must_use]
pub fn beside_answer(wider: bool, state: &ViewState) -> Option<&Answer> {
    let answers = state.answers()?;
    let taken = answers.taken as usize;
    let beside = if wider { taken.checked_add(1) } else { taken.checked_sub(1) };
    beside.and_then(|step| answers.steps.get(step))
}

/// A drag of the parameters of the last walk.
#[derive(Debug, Clone, Default)]
pub struct ParameterDrag {
    held: Option<WalkTuning>,
    /// The released value, the scene's revision at that time, and the deadline for its confirmation.
    asked: Option<(WalkTuning, u64, Instant)>,
}

impl ParameterDrag {
    /// Whether a hand holds it.
    #[must_use]
    pub fn is_held(&self) -> bool {
        self.held.is_some()
    }

    /// The walk's parameters, as this hand has set them. `None` without a walk, or without a service that can repeat it.
    #[must_use]
    pub fn tuning(&self, state: &ViewState) -> Option<WalkTuning> {
        let told = state.tuning()?;
        let waits = |asked: &(WalkTuning, u64, Instant)| {
            let (_, at, until) = *asked;
            state.scene.revision() <= at && Instant::now() < until
        };
        Some(self.held.or_else(|| self.asked.filter(waits).map(|(tuning, ..)| tuning)).unwrap_or(told))
    }

    /// Sets these numbers; returns the resulting request, if the numbers are new.
    #[must_use]
    pub fn set(&mut self, tuning: WalkTuning, state: &ViewState) -> Option<Request> {
        if self.tuning(state)? == tuning {
            return None;
        }
        self.held = Some(tuning);
        Some(Request::Tune(tuning))
    }

    /// Moves one number along its range, as a share of the whole range; returns the resulting request.
    #[must_use]
    pub fn turn(&mut self, which: WalkParameter, by: f64, state: &ViewState) -> Option<Request> {
        self.set(which.moved(self.tuning(state)?, by), state)
    }

    /// The hand lets go at this revision of the scene: the values under the hand become a step.
    #[must_use]
    pub fn release(&mut self, revision: u64) -> Option<Request> {
        let tuning = self.held.take()?;
        self.asked = Some((tuning, revision, Instant::now() + SETTLES));
        let steps = vec![SelectionStep { step: Some(Step::Tuning(tuning)) }];
        Some(Request::Select(StrokesRequest { steps, ..StrokesRequest::default() }))
    }

    /// Cancels the drag.
    #[must_use]
    pub fn abandon(&mut self) -> Option<Request> {
        self.held.take().map(|_| Request::Forget)
    }
}
