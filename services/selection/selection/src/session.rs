//! A selection session: a list of steps and the resulting mask.
//!
//! Each walk stroke solves one walk from all walk strokes so far and replaces the *walk layer*. All other steps (cluster
//! strokes, point strokes, operations, fixed masks) then apply to the layer in their order. Foreground adds, background
//! removes. So the mask depends only on the list of steps, and walk strokes count as if they came first. The last tuning
//! of the list sets the parameters of the walk, at any position.

use std::borrow::Cow;
use std::sync::Arc;

use serde::Serialize;
use sg_scene::mask::Mask;

use crate::answers::{Answers, NoAnswer};
use crate::brush::OpenStroke;
use crate::selection_index::{FirstStroke, SelectionIndex, Walk};
use crate::steps::{Step, StepError};
use crate::strokes::{Kind, MAX_STEPS, Mode, Stroke};
use crate::tuning::Tuning;
use sg_clusters::geometry::GeometryError;
use sg_walk::elimination::{Elimination, EliminationFamily};
use sg_walk::uncertainty::{Uncertainty, node_uncertainty, proposals};
use sg_walk::{THRESHOLD, WalkError};

mod every_scale;

/// A failed step. The selection is unchanged.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SelectionError {
    /// The step has an impossible value.
    #[error(transparent)]
    Step(#[from] StepError),
    /// The selection has [`MAX_STEPS`] steps.
    #[error("a selection holds at most {MAX_STEPS} strokes; save it as a unit and start anew")]
    TooMany,
    /// Leak and threshold need a walk, and the selection has none.
    #[error("the selection has no walk to change the leak or the threshold of; brush in walk mode first")]
    NoWalk,
    /// There is no such other answer to the walk strokes.
    #[error(transparent)]
    NoAnswer(#[from] NoAnswer),
    /// The walk could not be solved.
    #[error(transparent)]
    Walk(#[from] WalkError),
    /// The neighbour graph or the features of the scene could not be computed.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
    /// An operation on an index without an operation context.
    #[error("the selection was prepared without the scene; operations need it")]
    NoOperationContext,
}

/// A proposed place for the next walk stroke (see [`sg_walk::uncertainty`]).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Proposal {
    /// The cluster.
    pub cluster: usize,
    /// Centre of the cluster in normalized coordinates of the scene's box. A walk stroke of radius 0 there seeds the cluster.
    pub point: [f64; 3],
    /// Number of Gaussians of the cluster.
    pub gaussians: usize,
    /// Probability of foreground.
    pub p: f64,
    /// Probability of background.
    pub q: f64,
    /// 1 − |p − q|.
    pub uncertainty: f64,
    /// Expected Σ |Δp| over all Gaussians after a seed in this cluster.
    pub expected_shift: f64,
    /// Expected number of Gaussians that change sides after a seed in this cluster.
    pub expected_change: f64,
}

/// A step with the Gaussians under it; only strokes have hits.
#[derive(Debug, Clone)]
struct AppliedStep {
    step: Step,
    hits: Arc<[u32]>,
}

impl AppliedStep {
    /// The stroke of a walk step; `None` for other steps.
    fn walk_stroke(&self) -> Option<&Stroke> {
        self.step.stroke().filter(|s| s.mode == Mode::Walk)
    }
}

/// The state of a selection. Each method that changes it either succeeds or leaves it unchanged.
#[derive(Debug, Clone)]
pub struct SelectionSession {
    index: Arc<SelectionIndex>,
    applied: Vec<AppliedStep>,
    foreground: Mask,
    background: Mask,
    tuning: Tuning,
    /// Whether a step or a call set the tuning. Otherwise the first answer sets the leak, where there is a family.
    tuned: bool,
    elimination: Option<Elimination>,
    /// Whether the elimination is that of the walk. After a walk at every scale it is that of an earlier one.
    eliminated: bool,
    family: Option<EliminationFamily>,
    /// The masks of the first green walk stroke, once another stroke needs them.
    first: Option<Arc<FirstStroke>>,
    /// The answers to the present strokes. `None` until they are asked for if the tuning is set.
    answers: Option<Answers>,
    walk: Option<Walk>,
    walk_layer: Mask,
    mask: Mask,
}

impl SelectionSession {
    /// An empty selection.
    #[must_use]
    pub fn new(index: Arc<SelectionIndex>) -> Self {
        let empty = Mask::empty(index.gaussians());
        Self {
            tuning: default_tuning(&index),
            tuned: false,
            elimination: index.elimination().cloned(),
            eliminated: false,
            family: index.family().cloned(),
            first: None,
            answers: None,
            index,
            applied: Vec::new(),
            foreground: empty.clone(),
            background: empty.clone(),
            walk: None,
            walk_layer: empty.clone(),
            mask: empty,
        }
    }

    /// The index of the scene.
    #[must_use]
    pub fn index(&self) -> &Arc<SelectionIndex> {
        &self.index
    }

    /// The selected Gaussians, by scene-wide index.
    #[must_use]
    pub fn mask(&self) -> &Mask {
        &self.mask
    }

    /// The last walk; `None` without a walk stroke.
    #[must_use]
    pub fn walk(&self) -> Option<&Walk> {
        self.walk.as_ref()
    }

    /// Whether some step takes all of these Gaussians away from the walk.
    #[must_use]
    pub fn excludes(&self, gaussians: &Mask) -> bool {
        let excludes = |step: &Step| matches!(step, Step::Exclude(mask) if gaussians.is_subset_of(mask));
        self.steps().any(excludes)
    }

    /// All steps, in order.
    pub fn steps(&self) -> impl ExactSizeIterator<Item = &Step> {
        self.applied.iter().map(|d| &d.step)
    }

    /// Adds a step. Returns the number of Gaussians under a stroke, and 0 for other steps.
    ///
    /// # Errors
    /// [`SelectionError`]; the selection is then unchanged.
    pub fn add_step(&mut self, step: Step) -> Result<usize, SelectionError> {
        step.check()?;
        let hits = step.stroke().map(|stroke| self.index.hits(stroke)).unwrap_or_default();
        self.apply_step(AppliedStep { step, hits: hits.into() })
    }

    /// Adds a stroke. Returns the number of Gaussians under it.
    ///
    /// # Errors
    /// [`SelectionError`]; the selection is then unchanged.
    pub fn add_stroke(&mut self, stroke: Stroke) -> Result<usize, SelectionError> {
        self.add_step(stroke.into())
    }

    /// Adds a stroke with the hits that an [`OpenStroke`] collected, without another search.
    ///
    /// # Errors
    /// [`SelectionError`]; the selection is then unchanged.
    pub fn add_open_stroke(&mut self, stroke: Stroke, open: &OpenStroke) -> Result<usize, SelectionError> {
        stroke.check().map_err(StepError::from)?;
        let mut hits: Vec<u32> = open.hits().iter().copied().filter(|g| self.index.has(*g)).collect();
        hits.sort_unstable();
        if hits.is_empty() {
            let (samples, _) = stroke.in_scene(self.index.bounds());
            hits = self.index.hits_of_miss(&stroke, &samples);
        }
        self.apply_step(AppliedStep { step: stroke.into(), hits: hits.into() })
    }

    fn apply_step(&mut self, applied: AppliedStep) -> Result<usize, SelectionError> {
        if self.applied.len() >= MAX_STEPS {
            return Err(SelectionError::TooMany);
        }
        let hits = applied.hits.len();
        if let Step::Tuning(tuning) = applied.step {
            self.tune(tuning)?;
            self.applied.push(applied);
        } else if let Some(kind) = applied.walk_stroke().map(|s| s.kind) {
            let mut next = self.clone();
            next.applied.push(applied.clone());
            next.seed(kind, &applied.hits)?;
            *self = next;
        } else {
            let mut mask = self.mask.clone();
            apply(&self.index, &mut mask, &applied)?;
            self.mask = mask;
            self.applied.push(applied);
        }
        Ok(hits)
    }

    /// Adds seeds to the walk without a step, for a preview (see [`crate::preview`]). Returns the new mask.
    ///
    /// # Errors
    /// [`SelectionError`]; the session is then invalid.
    pub(crate) fn seed(&mut self, kind: Kind, hits: &[u32]) -> Result<&Mask, SelectionError> {
        let side = if kind == Kind::Foreground { &mut self.foreground } else { &mut self.background };
        hits.iter().for_each(|&g| side.set(g as usize, true));
        self.solve()?;
        Ok(&self.mask)
    }

    /// Solves the walk from the present seeds and rebuilds the mask.
    fn solve(&mut self) -> Result<(), SelectionError> {
        self.answers = None;
        if !self.tuned
            && let Some((walk, answers)) = self.walk_at_every_scale()?
        {
            self.tuning.leak = answers.first().leak;
            self.walk = Some(walk);
            self.answers = Some(answers);
            self.eliminated = false;
            return self.rebuild_mask();
        }
        let (foreground, background) = (ones(&self.foreground), ones(&self.background));
        self.walk =
            Some(self.index.walk_incremental(&mut self.elimination, self.tuning.leak, foreground, background)?);
        self.eliminated = true;
        self.rebuild_mask()
    }

    /// Rebuilds the mask from the walk's probabilities and the other steps.
    fn rebuild_mask(&mut self) -> Result<(), SelectionError> {
        if let Some(walk) = &self.walk {
            self.walk_layer = self.layer_of(walk);
        }
        self.mask = self.with_later_steps(self.walk_layer.clone())?;
        Ok(())
    }

    /// Applies all steps except walk strokes, in order, to a given walk layer.
    ///
    /// # Errors
    /// [`SelectionError`] if an operation fails.
    pub fn with_later_steps(&self, layer: Mask) -> Result<Mask, SelectionError> {
        let mut mask = layer;
        for applied in self.applied.iter().filter(|d| d.walk_stroke().is_none()) {
            apply(&self.index, &mut mask, applied)?;
        }
        Ok(mask)
    }

    /// Gaussians under the foreground brush of walk strokes.
    #[must_use]
    pub fn foreground(&self) -> &Mask {
        &self.foreground
    }

    /// Gaussians under the background brush of walk strokes.
    #[must_use]
    pub fn background(&self) -> &Mask {
        &self.background
    }

    /// Parameters of the walk.
    #[must_use]
    pub fn tuning(&self) -> Tuning {
        self.tuning
    }

    /// Changes leak and threshold without a step, for example while a slider moves.
    ///
    /// A new leak solves the walk again with the same elimination order. A new threshold needs no solve. The farthest rule
    /// has no leak, so a new leak has no effect there.
    ///
    /// # Errors
    /// [`SelectionError::NoWalk`], [`SelectionError::Step`]; the selection is then unchanged.
    pub fn tune(&mut self, tuning: Tuning) -> Result<(), SelectionError> {
        tuning.check().map_err(StepError::from)?;
        if self.walk.is_none() {
            return Err(SelectionError::NoWalk);
        }
        let mut next = self.clone();
        next.tuning = tuning;
        next.tuned = true;
        if tuning.threshold != self.tuning.threshold {
            next.answers = None;
        }
        if tuning.leak == self.tuning.leak {
            next.rebuild_mask()?;
        } else {
            // The answers are those of the strokes.
            let answers = next.answers.take();
            next.solve()?;
            next.answers = answers;
        }
        *self = next;
        Ok(())
    }

    /// The elimination of the present walk.
    fn solved_elimination(&self, walk: &Walk) -> Option<Cow<'_, Elimination>> {
        let kept = self.elimination.as_ref()?;
        if self.eliminated {
            return Some(Cow::Borrowed(kept));
        }
        let mut own = kept.clone();
        own.solve(&walk.seeds, self.tuning.leak, Some(&self.index.active(&walk.units))).ok()?;
        Some(Cow::Owned(own))
    }

    /// Uncertainty of the last walk, one entry per node. `None` without a walk or without an elimination in f64.
    #[must_use]
    pub fn uncertainty(&self) -> Option<Uncertainty> {
        let walk = self.walk.as_ref()?;
        let elimination = self.solved_elimination(walk)?;
        let active = self.index.active(&walk.units);
        let query = self.index.proposal_query(&active, self.tuning.threshold);
        node_uncertainty(&elimination, &walk.seeds, &walk.solution, &query)
    }

    /// At most `count` proposals for the next stroke, best first and spread out. Empty without a walk or without an
    /// elimination in f64.
    #[must_use]
    pub fn proposals(&self, count: usize) -> Vec<Proposal> {
        let Some(walk) = &self.walk else { return Vec::new() };
        let Some(elimination) = self.solved_elimination(walk) else { return Vec::new() };
        let active = self.index.active(&walk.units);
        let query = self.index.proposal_query(&active, self.tuning.threshold);
        proposals(&elimination, &walk.seeds, &walk.solution, &query, count)
            .into_iter()
            .filter_map(|c| {
                Some(Proposal {
                    cluster: c.node,
                    point: self.index.point(c.node)?,
                    gaussians: self.index.members(c.node).len(),
                    p: walk.solution.p[c.node],
                    q: walk.solution.q[c.node],
                    uncertainty: c.uncertainty,
                    expected_shift: c.shift,
                    expected_change: c.change,
                })
            })
            .collect()
    }

    /// The mask with one more stroke. The session stays unchanged.
    ///
    /// # Errors
    /// [`SelectionError`].
    pub fn preview(&self, stroke: Stroke) -> Result<Mask, SelectionError> {
        let mut session = self.clone();
        session.add_stroke(stroke)?;
        Ok(session.mask)
    }

    /// Removes the last step and returns it; `None` for an empty selection.
    ///
    /// # Errors
    /// [`SelectionError`] if the remaining walk cannot be solved; the selection is then unchanged.
    pub fn undo(&mut self) -> Result<Option<Step>, SelectionError> {
        let Some((last, earlier)) = self.applied.split_last() else { return Ok(None) };
        let mut blank = Self::new(Arc::clone(&self.index));
        blank.elimination.clone_from(&self.elimination);
        blank.family.clone_from(&self.family);
        // The first stroke is the same, unless it goes.
        if earlier.iter().any(|d| d.walk_stroke().is_some_and(|s| s.kind == Kind::Foreground)) {
            blank.first.clone_from(&self.first);
        }
        let rebuilt = blank.replay(earlier)?;
        let step = last.step.clone();
        *self = rebuilt;
        Ok(Some(step))
    }

    /// The selection of a list of strokes. The result equals adding them one by one, but needs one walk only.
    ///
    /// # Errors
    /// [`SelectionError`].
    pub fn of_strokes(index: &Arc<SelectionIndex>, strokes: &[Stroke]) -> Result<Self, SelectionError> {
        Self::of_steps(index, &strokes.iter().cloned().map(Step::Stroke).collect::<Vec<_>>())
    }

    /// The selection of a list of steps. The result equals adding them one by one, but needs one walk only.
    ///
    /// # Errors
    /// [`SelectionError`].
    pub fn of_steps(index: &Arc<SelectionIndex>, steps: &[Step]) -> Result<Self, SelectionError> {
        let applied = steps
            .iter()
            .map(|step| {
                step.check()?;
                let hits = step.stroke().map(|stroke| index.hits(stroke)).unwrap_or_default();
                Ok(AppliedStep { step: step.clone(), hits: hits.into() })
            })
            .collect::<Result<Vec<_>, SelectionError>>()?;
        Self::new(Arc::clone(index)).replay(&applied)
    }

    /// Applies steps to an empty selection.
    fn replay(self, applied: &[AppliedStep]) -> Result<Self, SelectionError> {
        let mut session = self;
        if applied.len() > MAX_STEPS {
            return Err(SelectionError::TooMany);
        }
        let mut walks = false;
        for applied in applied {
            // One walk for all strokes: only the last result counts.
            if let Some(stroke) = applied.walk_stroke() {
                let side = match stroke.kind {
                    Kind::Foreground => &mut session.foreground,
                    Kind::Background | Kind::Toggle => &mut session.background,
                };
                applied.hits.iter().for_each(|&g| side.set(g as usize, true));
                walks = true;
            }
            if let Step::Tuning(tuning) = applied.step {
                session.tuning = tuning;
                session.tuned = true;
            }
            session.applied.push(applied.clone());
        }
        if walks {
            session.solve()?;
        } else {
            session.rebuild_mask()?;
        }
        Ok(session)
    }

    fn layer_of(&self, walk: &Walk) -> Mask {
        let index = &self.index;
        Mask::from_fn(index.gaussians(), |g| {
            index.node_of(g as u32).is_some_and(|node| {
                walk.units[index.unit_of_node(node)] && walk.solution.leads(node, self.tuning.threshold)
            })
        })
    }
}

/// Parameters of the walk without a tuning step.
fn default_tuning(index: &SelectionIndex) -> Tuning {
    Tuning { leak: index.options().leak, threshold: THRESHOLD }
}

fn ones(mask: &Mask) -> impl Iterator<Item = u32> + '_ {
    mask.ones().map(|g| g as u32)
}

/// Applies a step to a mask. Walk strokes and tunings have no effect here.
fn apply(index: &SelectionIndex, mask: &mut Mask, applied: &AppliedStep) -> Result<(), SelectionError> {
    let stroke = match &applied.step {
        Step::Stroke(stroke) => stroke,
        Step::Operation(operation) => {
            let context = index.operation_context().ok_or(SelectionError::NoOperationContext)?;
            context.apply(operation, mask)?;
            mask.subtract(index.left_out());
            return Ok(());
        }
        Step::FixedMask(fixed) => {
            mask.union_with(fixed);
            mask.subtract(index.left_out());
            return Ok(());
        }
        Step::Exclude(excluded) => {
            mask.subtract(excluded);
            return Ok(());
        }
        Step::Tuning(_) => return Ok(()),
    };
    match stroke.mode {
        Mode::Walk => {}
        Mode::Point => {
            let add = stroke.kind == Kind::Foreground;
            applied.hits.iter().for_each(|&g| mask.set(g as usize, add));
        }
        Mode::Cluster => {
            let mut clusters: Vec<usize> = applied.hits.iter().filter_map(|&g| index.cluster_of(g)).collect();
            clusters.sort_unstable();
            clusters.dedup();
            for c in clusters {
                let members = index.members(c);
                let add = stroke.kind.selects(members, mask);
                members.iter().for_each(|&g| mask.set(g as usize, add));
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod every_scale_tests;
#[cfg(test)]
mod tests;
