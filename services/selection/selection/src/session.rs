//! A selection in the making: steps one after another, and the mask they amount to.
//!
//! Each walk stroke solves anew from all walk strokes so far and replaces the *walk layer*; then all other steps, strokes of
//! clusters and points and operations, are done over it again in the order they were taken. Foreground adds, background
//! removes. So a mask depends on the list of its steps alone, and a walk stroke counts as if it had come before all that is
//! no walk stroke. The last tuning among the steps says what the walk is done with, wherever it stands.

use std::sync::Arc;

use serde::Serialize;
use sg_scene::mask::Mask;

use crate::brush::OpenStroke;
use crate::space::{SelectionSpace, Walk};
use crate::steps::Step;
use crate::strokes::{Kind, MOST_STROKES, Mode, Stroke};
use crate::tuning::Tuning;
use sg_clusters::geometry::GeometryError;
use sg_walk::elimination::Elimination;
use sg_walk::uncertainty::{Doubts, doubts, proposals};
use sg_walk::{THRESHOLD, WalkError};

/// A stroke could not be added; the selection is as it was before.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SelectionError {
    /// The stroke makes no sense.
    #[error("{0}")]
    Stroke(String),
    /// There are as many strokes as a selection holds.
    #[error("a selection holds at most {MOST_STROKES} strokes; save it as a unit and start anew")]
    TooMany,
    /// A walk cannot be done with these numbers.
    #[error("{0}")]
    Tuning(String),
    /// Leak and threshold are those of a walk, and there is none.
    #[error("there is no walk whose leak or threshold could be changed; brush in walk mode first")]
    NoWalk,
    /// The walk could not be solved.
    #[error(transparent)]
    Walk(#[from] WalkError),
    /// The scene has no neighbours or features to operate by.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
    /// An operation in a space that was made without its scene.
    #[error("operations need the scene itself, which this selection was made without")]
    NoSurroundings,
}

/// Where a next stroke would tell most (see [`sg_walk::uncertainty`]).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Proposal {
    /// The cluster.
    pub cluster: usize,
    /// Its middle in normalized coordinates of the scene's box: a walk stroke of radius 0 there seeds it.
    pub point: [f64; 3],
    /// Its Gaussians.
    pub gaussians: usize,
    /// Probability of foreground.
    pub p: f64,
    /// Probability of background.
    pub q: f64,
    /// 1 − |p − q|.
    pub uncertainty: f64,
    /// Expected Σ |Δp| over all Gaussians once this cluster is seeded.
    pub expected_shift: f64,
    /// Expected number of Gaussians that change sides once it is.
    pub expected_change: f64,
}

/// A step and, for a stroke, what it hit.
#[derive(Debug, Clone)]
struct Drawn {
    step: Step,
    hits: Arc<[u32]>,
}

impl Drawn {
    /// The walk stroke that it is, if it is one.
    fn walk(&self) -> Option<&Stroke> {
        self.step.stroke().filter(|s| s.mode == Mode::Walk)
    }
}

/// The state of a selection. It changes only through [`SelectionSession::add_step`] and its kin, and each of them
/// either succeeds or leaves it as it was.
#[derive(Debug, Clone)]
pub struct SelectionSession {
    space: Arc<SelectionSpace>,
    drawn: Vec<Drawn>,
    foreground: Mask,
    background: Mask,
    tuning: Tuning,
    elimination: Option<Elimination>,
    walk: Option<Walk>,
    walk_layer: Mask,
    mask: Mask,
}

impl SelectionSession {
    /// An empty selection.
    #[must_use]
    pub fn new(space: Arc<SelectionSpace>) -> Self {
        let empty = Mask::empty(space.gaussians());
        Self {
            tuning: untuned(&space),
            elimination: space.elimination().cloned(),
            space,
            drawn: Vec::new(),
            foreground: empty.clone(),
            background: empty.clone(),
            walk: None,
            walk_layer: empty.clone(),
            mask: empty,
        }
    }

    /// The space it selects in.
    #[must_use]
    pub fn space(&self) -> &Arc<SelectionSpace> {
        &self.space
    }

    /// What is selected, over scene-wide indices.
    #[must_use]
    pub fn mask(&self) -> &Mask {
        &self.mask
    }

    /// The last walk, if there was one.
    #[must_use]
    pub fn walk(&self) -> Option<&Walk> {
        self.walk.as_ref()
    }

    /// Steps so far, in the order they were taken.
    pub fn steps(&self) -> impl ExactSizeIterator<Item = &Step> {
        self.drawn.iter().map(|d| &d.step)
    }

    /// Takes a step. Returns how many Gaussians it hit, if it is a stroke.
    ///
    /// # Errors
    /// [`SelectionError`]; the selection is then as it was before.
    pub fn add_step(&mut self, step: Step) -> Result<usize, SelectionError> {
        step.check().map_err(SelectionError::Stroke)?;
        let hits = step.stroke().map(|stroke| self.space.hits(stroke)).unwrap_or_default();
        self.add_drawn(Drawn { step, hits: hits.into() })
    }

    /// Plays a stroke. Returns how many Gaussians it hit.
    ///
    /// # Errors
    /// [`SelectionError`]; the selection is then as it was before.
    pub fn add_stroke(&mut self, stroke: Stroke) -> Result<usize, SelectionError> {
        self.add_step(stroke.into())
    }

    /// Plays a stroke whose hits were gathered while it was drawn (see [`OpenStroke`]): the brush is not asked again.
    ///
    /// # Errors
    /// [`SelectionError`]; the selection is then as it was before.
    pub fn add_open_stroke(&mut self, stroke: Stroke, open: &OpenStroke) -> Result<usize, SelectionError> {
        stroke.check().map_err(SelectionError::Stroke)?;
        let mut hits = open.hits().to_vec();
        hits.sort_unstable();
        if hits.is_empty() {
            let (samples, _) = stroke.in_scene(self.space.bounds());
            hits = self.space.instead_of_nothing(&stroke, &samples);
        }
        self.add_drawn(Drawn { step: stroke.into(), hits: hits.into() })
    }

    fn add_drawn(&mut self, drawn: Drawn) -> Result<usize, SelectionError> {
        if self.drawn.len() >= MOST_STROKES {
            return Err(SelectionError::TooMany);
        }
        let hits = drawn.hits.len();
        if let Step::Tuning(tuning) = drawn.step {
            self.tune(tuning)?;
            self.drawn.push(drawn);
        } else if let Some(kind) = drawn.walk().map(|s| s.kind) {
            let mut next = self.clone();
            next.drawn.push(drawn.clone());
            next.seed(kind, &drawn.hits)?;
            *self = next;
        } else {
            let mut mask = self.mask.clone();
            apply(&self.space, &mut mask, &drawn)?;
            self.mask = mask;
            self.drawn.push(drawn);
        }
        Ok(hits)
    }

    /// Adds seeds to the walk, without a step of their own: for what is being drawn (see [`crate::preview`]). Returns what
    /// would be selected.
    ///
    /// # Errors
    /// [`SelectionError`]; then the session is of no further use.
    pub(crate) fn seed(&mut self, kind: Kind, hits: &[u32]) -> Result<&Mask, SelectionError> {
        let side = if kind == Kind::Foreground { &mut self.foreground } else { &mut self.background };
        hits.iter().for_each(|&g| side.set(g as usize, true));
        self.solve()?;
        Ok(&self.mask)
    }

    /// Walks from the seeds that are there and lays the other steps over it.
    fn solve(&mut self) -> Result<(), SelectionError> {
        let (foreground, background) = (ones(&self.foreground), ones(&self.background));
        self.walk = Some(self.space.walk_again(&mut self.elimination, self.tuning.leak, foreground, background)?);
        self.lay()
    }

    /// Makes the mask from the walk's probabilities and the steps that lie over them.
    fn lay(&mut self) -> Result<(), SelectionError> {
        if let Some(walk) = &self.walk {
            self.walk_layer = self.layer_of(walk);
        }
        self.mask = self.laid_over(self.walk_layer.clone())?;
        Ok(())
    }

    /// All steps but walk strokes, in the order they were taken, over another layer than the walk's own.
    ///
    /// # Errors
    /// [`SelectionError`] where an operation cannot be done.
    pub fn laid_over(&self, layer: Mask) -> Result<Mask, SelectionError> {
        let mut mask = layer;
        for drawn in self.drawn.iter().filter(|d| d.walk().is_none()) {
            apply(&self.space, &mut mask, drawn)?;
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

    /// What the walk is done with.
    #[must_use]
    pub fn tuning(&self) -> Tuning {
        self.tuning
    }

    /// Does the walk with another leak or threshold, without a step of its own: for what is being scrubbed. The order and
    /// structure of the elimination are kept; for another threshold nothing is solved. Under the farthest rule, which has no
    /// leak, another leak changes nothing.
    ///
    /// # Errors
    /// [`SelectionError::NoWalk`], [`SelectionError::Tuning`]; the selection is then as it was before.
    pub fn tune(&mut self, tuning: Tuning) -> Result<(), SelectionError> {
        tuning.check().map_err(SelectionError::Tuning)?;
        if self.walk.is_none() {
            return Err(SelectionError::NoWalk);
        }
        let mut next = self.clone();
        next.tuning = tuning;
        if tuning.leak == self.tuning.leak {
            next.lay()?;
        } else {
            next.solve()?;
        }
        *self = next;
        Ok(())
    }

    /// What the last walk leaves open, one entry a node. None without a walk, and where walks are not eliminated in f64.
    #[must_use]
    pub fn doubts(&self) -> Option<Doubts> {
        let (walk, elimination) = (self.walk.as_ref()?, self.elimination.as_ref()?);
        let active = self.space.active(&walk.units);
        doubts(elimination, &walk.seeds, &walk.solution, &self.space.question(&active, self.tuning.threshold))
    }

    /// At most `count` places where a next stroke would tell most, best first and spread out. Empty without a walk, and
    /// where walks are not eliminated in f64.
    #[must_use]
    pub fn proposals(&self, count: usize) -> Vec<Proposal> {
        let (Some(walk), Some(elimination)) = (&self.walk, &self.elimination) else { return Vec::new() };
        let active = self.space.active(&walk.units);
        let question = self.space.question(&active, self.tuning.threshold);
        proposals(elimination, &walk.seeds, &walk.solution, &question, count)
            .into_iter()
            .filter_map(|c| {
                Some(Proposal {
                    cluster: c.node,
                    point: self.space.point(c.node)?,
                    gaussians: self.space.members(c.node).len(),
                    p: walk.solution.p[c.node],
                    q: walk.solution.q[c.node],
                    uncertainty: c.uncertainty,
                    expected_shift: c.shift,
                    expected_change: c.change,
                })
            })
            .collect()
    }

    /// What the mask would be with this stroke added; nothing changes.
    ///
    /// # Errors
    /// [`SelectionError`].
    pub fn preview(&self, stroke: Stroke) -> Result<Mask, SelectionError> {
        let mut session = self.clone();
        session.add_stroke(stroke)?;
        Ok(session.mask)
    }

    /// Takes the last step back and returns it.
    ///
    /// # Errors
    /// [`SelectionError`] if an earlier walk can no longer be solved; the selection is then as it was before.
    pub fn undo(&mut self) -> Result<Option<Step>, SelectionError> {
        let Some((last, earlier)) = self.drawn.split_last() else { return Ok(None) };
        let mut blank = Self::new(Arc::clone(&self.space));
        blank.elimination.clone_from(&self.elimination);
        let rebuilt = blank.replay(earlier)?;
        let step = last.step.clone();
        *self = rebuilt;
        Ok(Some(step))
    }

    /// The selection that a list of strokes amounts to: the same as playing them one by one, with one walk.
    ///
    /// # Errors
    /// [`SelectionError`].
    pub fn of_strokes(space: &Arc<SelectionSpace>, strokes: &[Stroke]) -> Result<Self, SelectionError> {
        Self::of_steps(space, &strokes.iter().cloned().map(Step::Stroke).collect::<Vec<_>>())
    }

    /// The selection that a list of steps amounts to: the same as taking them one by one, with one walk.
    ///
    /// # Errors
    /// [`SelectionError`].
    pub fn of_steps(space: &Arc<SelectionSpace>, steps: &[Step]) -> Result<Self, SelectionError> {
        let drawn = steps
            .iter()
            .map(|step| {
                step.check().map_err(SelectionError::Stroke)?;
                let hits = step.stroke().map(|stroke| space.hits(stroke)).unwrap_or_default();
                Ok(Drawn { step: step.clone(), hits: hits.into() })
            })
            .collect::<Result<Vec<_>, SelectionError>>()?;
        Self::new(Arc::clone(space)).replay(&drawn)
    }

    /// Plays strokes on an empty selection.
    fn replay(self, drawn: &[Drawn]) -> Result<Self, SelectionError> {
        let mut session = self;
        if drawn.len() > MOST_STROKES {
            return Err(SelectionError::TooMany);
        }
        let mut walks = false;
        for drawn in drawn {
            // One walk for all: only the last one is seen.
            if let Some(stroke) = drawn.walk() {
                let side = match stroke.kind {
                    Kind::Foreground => &mut session.foreground,
                    Kind::Background | Kind::Toggle => &mut session.background,
                };
                drawn.hits.iter().for_each(|&g| side.set(g as usize, true));
                walks = true;
            }
            if let Step::Tuning(tuning) = drawn.step {
                session.tuning = tuning;
            }
            session.drawn.push(drawn.clone());
        }
        if walks {
            session.solve()?;
        } else {
            session.lay()?;
        }
        Ok(session)
    }

    fn layer_of(&self, walk: &Walk) -> Mask {
        let space = &self.space;
        Mask::from_fn(space.gaussians(), |g| {
            space.node_of(g as u32).is_some_and(|node| {
                walk.units[space.unit_of_node(node)] && walk.solution.leads(node, self.tuning.threshold)
            })
        })
    }
}

/// What walks are done with where no step says otherwise.
fn untuned(space: &SelectionSpace) -> Tuning {
    Tuning { leak: space.options().leak, threshold: THRESHOLD }
}

fn ones(mask: &Mask) -> impl Iterator<Item = u32> + '_ {
    mask.ones().map(|g| g as u32)
}

/// Lays a step that is no walk stroke over a mask.
fn apply(space: &SelectionSpace, mask: &mut Mask, drawn: &Drawn) -> Result<(), SelectionError> {
    let stroke = match &drawn.step {
        Step::Stroke(stroke) => stroke,
        Step::Operation(operation) => {
            let surroundings = space.surroundings().ok_or(SelectionError::NoSurroundings)?;
            return Ok(surroundings.apply(operation, mask)?);
        }
        Step::Given(given) => {
            mask.union_with(given);
            return Ok(());
        }
        Step::Tuning(_) => return Ok(()),
    };
    match stroke.mode {
        Mode::Walk => {}
        Mode::Point => {
            let add = stroke.kind == Kind::Foreground;
            drawn.hits.iter().for_each(|&g| mask.set(g as usize, add));
        }
        Mode::Cluster => {
            let mut clusters: Vec<usize> = drawn.hits.iter().filter_map(|&g| space.cluster_of(g)).collect();
            clusters.sort_unstable();
            clusters.dedup();
            for c in clusters {
                let members = space.members(c);
                let add = stroke.kind.selects(members, mask);
                members.iter().for_each(|&g| mask.set(g as usize, add));
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
