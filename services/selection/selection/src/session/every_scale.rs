//! The answers of a selection at every scale.

use std::sync::Arc;

use sg_scene::mask::Mask;

use super::{SelectionError, SelectionSession, ones};
use crate::answers::{AnswerChange, Answers, NoAnswer};
use crate::selection_index::Walk;
use crate::strokes::Kind;
use crate::tuning::Tuning;

impl SelectionSession {
    /// The walk of the first answer to the present strokes, and all answers. `None` without a family.
    pub(super) fn walk_at_every_scale(&mut self) -> Result<Option<(Walk, Answers)>, SelectionError> {
        let threshold = self.tuning.threshold;
        let known = self.first.clone().filter(|first| first.threshold() == threshold);
        let strokes = if known.is_none() { self.first_strokes() } else { None };
        let is_first =
            strokes.as_ref().is_some_and(|[green, red]| (green, red) == (&self.foreground, &self.background));
        let first = match (known, strokes, self.index.family()) {
            (None, Some([green, red]), Some(family)) if !is_first => {
                let strokes = [ones(&green), ones(&red)];
                Some(Arc::new(self.index.first_stroke(&mut family.clone(), threshold, strokes)?))
            }
            (known, ..) => known,
        };
        let Some(family) = &mut self.family else { return Ok(None) };
        let strokes = [ones(&self.foreground), ones(&self.background)];
        let found = self.index.walk_at_every_scale(family, threshold, strokes, first.as_deref())?;
        let Some((walk, answers, masks)) = found else { return Ok(None) };
        self.first = if is_first { Some(Arc::new(masks)) } else { first };
        Ok(Some((walk, answers)))
    }

    /// Gaussians under the walk strokes up to the first green one: foreground and background. `None` without a green one.
    fn first_strokes(&self) -> Option<[Mask; 2]> {
        let mut strokes = [Mask::empty(self.index.gaussians()), Mask::empty(self.index.gaussians())];
        for applied in &self.applied {
            let Some(stroke) = applied.walk_stroke() else { continue };
            let green = stroke.kind == Kind::Foreground;
            applied.hits.iter().for_each(|&g| strokes[usize::from(!green)].set(g as usize, true));
            if green {
                return Some(strokes);
            }
        }
        None
    }

    /// The answers to the strokes at every scale ([`crate::answers`]). `None` without a walk stroke or without a family.
    ///
    /// A tuning does not change the answers, apart from its threshold. So a user steps between the same ones.
    ///
    /// # Errors
    /// [`SelectionError::Walk`].
    pub fn answers(&mut self) -> Result<Option<&Answers>, SelectionError> {
        if self.answers.is_none() && self.walk.is_some() {
            self.answers = self.walk_at_every_scale()?.map(|(_, answers)| answers);
        }
        Ok(self.answers.as_ref())
    }

    /// The answers, where they are known without a solve.
    #[must_use]
    pub fn known_answers(&self) -> Option<&Answers> {
        self.answers.as_ref()
    }

    /// The tuning that takes another answer to the walk strokes. As a step it is the choice of that answer.
    ///
    /// # Errors
    /// [`SelectionError::NoWalk`] without a walk stroke, [`SelectionError::NoAnswer`] without such an answer.
    pub fn other_answer(&mut self, change: AnswerChange) -> Result<Tuning, SelectionError> {
        let tuning = self.tuning;
        if self.walk.is_none() {
            return Err(SelectionError::NoWalk);
        }
        let answers = self.answers()?.ok_or(NoAnswer::OneScale)?;
        let answer = answers.changed(tuning.leak, change)?;
        Ok(Tuning { leak: answer.leak, ..tuning })
    }
}
