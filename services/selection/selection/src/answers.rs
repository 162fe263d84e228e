//! One stroke, answered at every scale: nested masks over the leak, the first answer among them, and clear steps.
//!
//! A walk with a large leak stays near its stroke, and one with a small leak fills the structure around it. The masks are
//! nested ([`sg_walk::elimination`]), so they form a scale. [`leaks`] lists its leaks. *Clear steps* are masks that differ
//! from their neighbours by at least two fifths of the larger one. One step is the first answer; a user goes to a narrower
//! or a wider one.
//!
//! The rule of the first answer weighs three things:
//!
//! - the leak that suits the stroke. Its share of the scene counts, and whether it lies on a surface or in a filled volume.
//! - the growth of the mask with the leak. A structure is where the mask stops to grow.
//! - a penalty for masks that take nearly everything.
//!
//! Later strokes leave out the leaks that their first stroke's masks disagree with.
//!
//! `docs/selecting.md` has the formula, and the scenes on which its numbers were chosen.

use serde::{Deserialize, Serialize};

/// Number of leaks of a family.
pub const LEAKS: usize = 12;

/// Decades between two leaks. The largest leak is 1.
const SPACING: f64 = 0.4;

/// The least share of the larger mask by which two clear steps differ.
pub const CLEAR: f64 = 0.4;

/// Leak that suits a stroke over the whole scene, in decades, and its change with each decade of the stroke's share.
const USUAL: (f64, f64) = (-2.15, 0.3);

/// Neighbours of a cluster on a surface and in a filled volume, between which the leak rises by so many decades. Walks in a
/// volume have more ways, so the same leak reaches farther. A flat mosaic has 6 neighbours a tile on the mean.
const FILLED: (f64, f64, f64) = (7.5, 12.5, 0.8);

/// Weight of the growth of the mask over [`SPACING`] decades.
const GROWTH: f64 = 2.3;

/// Share of the scene from which a mask takes nearly everything, the share at which the penalty is full, and the penalty.
const NEARLY_ALL: (f64, f64, f64) = (0.8, 1.0, 8.0);

/// Decades of the leak between a clear step and the usual next narrower and next wider one.
const NEXT: (f64, f64) = (0.5, 1.1);

/// Leaks of a family, widest mask last: from 1 down to 10^-4.4.
#[must_use]
pub fn leaks() -> [f64; LEAKS] {
    std::array::from_fn(|i| 10.0_f64.powf(-SPACING * i as f64))
}

/// One answer of a family.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Answer {
    /// ε.
    pub leak: f64,
    /// Gaussians of the mask, before later steps of the selection.
    pub gaussians: usize,
    /// Weight across the mask's boundary over the lesser of the weights inside and outside; 0 for an empty or full mask.
    pub conductance: f64,
}

/// Which answer of a family.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Scale {
    /// The clear step below the first answer.
    Narrower,
    /// The first answer.
    #[default]
    Default,
    /// The clear step above the first answer.
    Wider,
}

/// Another answer than the one that is taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AnswerChange {
    /// The next narrower clear step.
    Narrower,
    /// The next wider clear step.
    Wider,
    /// The narrowest clear step.
    Narrowest,
    /// The widest clear step.
    Widest,
    /// The first answer.
    First,
}

/// There is no such other answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum NoAnswer {
    /// The walk has no family.
    #[error("the strokes have one answer here; change Reach to select more or less")]
    OneScale,
    /// Nothing is narrower.
    #[error("this is the narrowest answer to the strokes; brush what does not belong to it in red")]
    Narrowest,
    /// Nothing is wider.
    #[error("this is the widest answer to the strokes; brush what is missing in green")]
    Widest,
    /// The first answer is taken.
    #[error("this is the first answer to the strokes already")]
    First,
}

/// What the first answer is judged by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shown {
    /// Gaussians of the clusters under the foreground strokes.
    pub hit: usize,
    /// Gaussians of the base units that the walk is restricted to.
    pub all: usize,
    /// Mean number of neighbours of the clusters under the foreground strokes.
    pub neighbours: f64,
}

/// The answers to the strokes of a selection.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Answers {
    /// One answer a leak, narrowest first.
    pub family: Vec<Answer>,
    /// The clear steps, as positions in the family, narrowest first.
    pub steps: Vec<usize>,
    /// The first answer, as a position in the steps.
    pub first: usize,
}

impl Answers {
    /// Judges a family, narrowest first. `None` for an empty family.
    #[must_use]
    pub fn new(family: Vec<Answer>, shown: Shown) -> Option<Self> {
        Self::among(family, shown, |_| true)
    }

    /// The same with steps at some positions of the family only. `None` without one.
    #[must_use]
    pub fn among(family: Vec<Answer>, shown: Shown, allowed: impl Fn(usize) -> bool) -> Option<Self> {
        let growth = growth(&family);
        let decades = |i: usize| family[i].leak.log10();
        let best = |score: &dyn Fn(usize) -> f64, among: &mut dyn Iterator<Item = usize>| {
            among.max_by(|a, b| score(*a).total_cmp(&score(*b)).then(b.cmp(a)))
        };
        let filled = ((shown.neighbours - FILLED.0) / (FILLED.1 - FILLED.0)).clamp(0.0, 1.0);
        let usual = USUAL.0 + USUAL.1 * (shown.hit.max(1) as f64 / shown.all.max(1) as f64).log10() + FILLED.2 * filled;
        let suits = |i: usize| {
            let share = family[i].gaussians as f64 / shown.all.max(1) as f64;
            let nearly_all = ((share - NEARLY_ALL.0) / (NEARLY_ALL.1 - NEARLY_ALL.0)).clamp(0.0, 1.0);
            -(decades(i) - usual).powi(2) - GROWTH * growth[i] - NEARLY_ALL.2 * nearly_all
        };
        let first = best(&suits, &mut (0..family.len()).filter(|i| allowed(*i)))?;
        let clear = |narrow: usize, wide: usize| {
            let [narrow, wide] = [narrow, wide].map(|i| family[i].gaussians);
            wide > 0 && narrow as f64 <= (1.0 - CLEAR) * wide as f64
        };
        let next = |from: usize, by: f64, among: &mut dyn Iterator<Item = usize>| {
            best(&|i| -(decades(i) - decades(from) - by).powi(2) - GROWTH * growth[i], among)
        };
        let narrower = |i: usize, last: usize| allowed(i) && family[i].gaussians > 0 && clear(i, last);
        let wider = |last: usize, i: usize| allowed(i) && clear(last, i);
        let mut steps = vec![first];
        let mut last = first;
        while let Some(i) = next(last, NEXT.0, &mut (0..last).filter(|i| narrower(*i, last))) {
            steps.insert(0, i);
            last = i;
        }
        let position = steps.len() - 1;
        last = first;
        while let Some(i) = next(last, -NEXT.1, &mut (last + 1..family.len()).filter(|i| wider(last, *i))) {
            steps.push(i);
            last = i;
        }
        Some(Self { family, steps, first: position })
    }

    /// The first answer.
    #[must_use]
    pub fn first(&self) -> Answer {
        self.family[self.steps[self.first]]
    }

    /// The clear step with this leak, or the nearest one, as a position in the steps.
    #[must_use]
    pub fn step_at(&self, leak: f64) -> usize {
        let far = |step: &usize| (self.family[*step].leak.ln() - leak.max(f64::MIN_POSITIVE).ln()).abs();
        (0..self.steps.len()).min_by(|a, b| far(&self.steps[*a]).total_cmp(&far(&self.steps[*b]))).unwrap_or(0)
    }

    /// The answer so many clear steps wider than the one at `leak`; negative numbers are narrower. `None` beyond the ends.
    #[must_use]
    pub fn stepped(&self, leak: f64, by: i64) -> Option<Answer> {
        let to = i64::try_from(self.step_at(leak)).ok()?.checked_add(by)?;
        self.steps.get(usize::try_from(to).ok()?).map(|step| self.family[*step])
    }

    /// Another answer than the one at `leak`.
    ///
    /// # Errors
    /// [`NoAnswer`].
    pub fn changed(&self, leak: f64, change: AnswerChange) -> Result<Answer, NoAnswer> {
        let at = |step: usize| self.family[self.steps[step]];
        // A leak of one's own may lie beyond the last steps. Then the nearest of them is on the way.
        let nearest = at(self.step_at(leak));
        let (answer, none) = match change {
            AnswerChange::Narrower => {
                (self.stepped(leak, -1).or((nearest.leak > leak).then_some(nearest)), NoAnswer::Narrowest)
            }
            AnswerChange::Wider => {
                (self.stepped(leak, 1).or((nearest.leak < leak).then_some(nearest)), NoAnswer::Widest)
            }
            AnswerChange::Narrowest => (Some(at(0)), NoAnswer::Narrowest),
            AnswerChange::Widest => (Some(at(self.steps.len() - 1)), NoAnswer::Widest),
            AnswerChange::First => (Some(self.first()), NoAnswer::First),
        };
        answer.filter(|answer| answer.leak != leak).ok_or(none)
    }

    /// One of the three named answers. `None` where there is no clear step on that side.
    #[must_use]
    pub fn at(&self, scale: Scale) -> Option<Answer> {
        let by = match scale {
            Scale::Narrower => -1,
            Scale::Default => 0,
            Scale::Wider => 1,
        };
        self.stepped(self.first().leak, by)
    }
}

/// The growth of the logarithm of each mask over [`SPACING`] decades of the leak.
fn growth(family: &[Answer]) -> Vec<f64> {
    let size = |i: usize| (family[i].gaussians.max(1) as f64).ln();
    (0..family.len())
        .map(|i| {
            let (narrow, wide) = (i.saturating_sub(1), (i + 1).min(family.len() - 1));
            let decades = (family[narrow].leak / family[wide].leak).log10();
            if decades > 0.0 { (size(wide) - size(narrow)) * SPACING / decades } else { 0.0 }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn family(sizes: &[usize]) -> Vec<Answer> {
        let answer = |(gaussians, leak)| Answer { leak, gaussians, conductance: 0.1 };
        sizes.iter().copied().zip(leaks()).map(answer).collect()
    }

    const SHOWN: Shown = Shown { hit: 50, all: 10_000, neighbours: 6.0 };

    #[test]
    fn a_plateau_near_the_usual_leak_is_the_first_answer_and_its_neighbours_are_clear_steps() {
        let sizes = [50, 60, 80, 300, 900, 1000, 1010, 1020, 4000, 9000, 9900, 10_000];
        let answers = Answers::new(family(&sizes), SHOWN).unwrap();
        let first = answers.first();
        assert!((1000..=1020).contains(&first.gaussians), "{answers:?}");
        let (narrower, wider) = (answers.at(Scale::Narrower).unwrap(), answers.at(Scale::Wider).unwrap());
        assert!(narrower.gaussians <= 612 && wider.gaussians >= 1667, "{answers:?}");
        assert_eq!(answers.at(Scale::Default), Some(first));
        // The same steps from any of them.
        assert_eq!(answers.stepped(wider.leak, -2), Some(narrower));
        assert_eq!(answers.stepped(narrower.leak, 1), Some(first));
        // A leak between two steps is that of the nearest.
        assert_eq!(answers.stepped(1.1 * first.leak, 0), Some(first));
        assert_eq!(answers.stepped(0.0, 0).map(|a| a.leak), answers.stepped(1e-30, 0).map(|a| a.leak));
    }

    #[test]
    fn families_without_a_choice() {
        assert_eq!(Answers::new(Vec::new(), SHOWN), None);
        for sizes in [[0; LEAKS], [10_000; LEAKS]] {
            let answers = Answers::new(family(&sizes), Shown { hit: 0, all: 0, neighbours: 0.0 }).unwrap();
            assert_eq!((answers.steps.len(), answers.first), (1, 0));
            assert!(answers.at(Scale::Narrower).is_none() && answers.at(Scale::Wider).is_none());
            assert_eq!(answers.stepped(1.0, i64::MIN), None);
        }
    }

    #[test]
    fn another_answer_is_a_step_away_or_is_refused() {
        let sizes = [50, 60, 80, 300, 900, 1000, 1010, 1020, 4000, 9000, 9900, 10_000];
        let answers = Answers::new(family(&sizes), SHOWN).unwrap();
        let at = |step: usize| answers.family[answers.steps[step]];
        let (last, first) = (answers.steps.len() - 1, answers.first);
        assert!(first > 0 && first < last);
        let changed = |step: usize, change| answers.changed(at(step).leak, change);
        assert_eq!(changed(first, AnswerChange::Narrower), Ok(at(first - 1)));
        assert_eq!(changed(first, AnswerChange::Wider), Ok(at(first + 1)));
        assert_eq!(changed(first, AnswerChange::Narrowest), Ok(at(0)));
        assert_eq!(changed(first, AnswerChange::Widest), Ok(at(last)));
        assert_eq!(changed(0, AnswerChange::First), Ok(at(first)));
        assert_eq!(changed(0, AnswerChange::Narrower), Err(NoAnswer::Narrowest));
        assert_eq!(changed(0, AnswerChange::Narrowest), Err(NoAnswer::Narrowest));
        assert_eq!(changed(last, AnswerChange::Wider), Err(NoAnswer::Widest));
        assert_eq!(changed(last, AnswerChange::Widest), Err(NoAnswer::Widest));
        assert_eq!(changed(first, AnswerChange::First), Err(NoAnswer::First));
        // A leak of one's own beyond the ends leads to the last step on that side.
        assert_eq!(answers.changed(100.0, AnswerChange::Wider).map(|a| a.leak < 100.0), Ok(true));
        assert_eq!(answers.changed(100.0, AnswerChange::Narrower), Err(NoAnswer::Narrowest));
        assert_eq!(answers.changed(0.0, AnswerChange::Wider), Err(NoAnswer::Widest));
    }

    #[test]
    fn answers_that_are_not_allowed_are_no_steps() {
        let sizes = [50, 60, 80, 300, 900, 1000, 1010, 1020, 4000, 9000, 9900, 10_000];
        let all = Answers::new(family(&sizes), SHOWN).unwrap();
        let narrow = Answers::among(family(&sizes), SHOWN, |i| i < 4).unwrap();
        assert!(narrow.steps.iter().all(|i| *i < 4) && narrow.first().gaussians <= 300);
        assert_eq!(Answers::among(family(&sizes), SHOWN, |i| i < 12), Some(all));
        assert_eq!(Answers::among(family(&sizes), SHOWN, |_| false), None);
    }

    proptest! {
        #[test]
        fn neighbour_steps_are_clear(
            mut sizes in proptest::collection::vec(0..20_000_usize, 1..=LEAKS),
            hit in 0..500_usize,
            neighbours in 0.0..20.0_f64,
        ) {
            sizes.sort_unstable();
            let answers = Answers::new(family(&sizes), Shown { hit, all: 20_000, neighbours }).unwrap();
            prop_assert!(answers.steps.is_sorted() && answers.first < answers.steps.len());
            for pair in answers.steps.windows(2) {
                let [narrow, wide] = [pair[0], pair[1]].map(|i| answers.family[i].gaussians as f64);
                prop_assert!(narrow <= (1.0 - CLEAR) * wide, "{narrow} and {wide}");
            }
            // Nothing that is clearly smaller or larger lies beyond the last steps.
            let [least, most] = [0, answers.steps.len() - 1].map(|i| answers.family[answers.steps[i]].gaussians as f64);
            prop_assert!(sizes.iter().all(|n| *n == 0 || *n as f64 > (1.0 - CLEAR) * least));
            prop_assert!(sizes.iter().all(|n| most > (1.0 - CLEAR) * *n as f64));
            for i in 0..answers.steps.len() {
                prop_assert_eq!(answers.step_at(answers.family[answers.steps[i]].leak), i);
            }
        }
    }
}
