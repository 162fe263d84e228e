//! Measures of retrieval: where the item that a query means stands among all items.
//!
//! Recall@k is the share of queries whose item is among the first k. The mean reciprocal rank is the mean of 1/rank, with 0 for
//! an item that is not found (Voorhees 1999). Equal scores count against the measured method: an item has the worst rank among
//! those with its score.

use std::fmt;

/// Most ranks that the wider recall counts.
const FEW: usize = 5;

/// The scores of all items for one query.
#[derive(Debug, Clone, PartialEq)]
pub struct Ranking {
    scores: Vec<Option<f64>>,
}

impl Ranking {
    /// The scores of the items in their order, of any scale: a greater one is better. An item with `None` or NaN is not found.
    #[must_use]
    pub fn new(scores: Vec<Option<f64>>) -> Self {
        Self { scores: scores.into_iter().map(|score| score.filter(|score| !score.is_nan())).collect() }
    }

    /// Number of items, found or not.
    #[must_use]
    pub fn items(&self) -> usize {
        self.scores.len()
    }

    /// The rank of an item from 1, the worst among those with its score. `None` for an item that is not found.
    #[must_use]
    pub fn rank_of(&self, item: usize) -> Option<usize> {
        let own = self.scores.get(item).copied().flatten()?;
        Some(self.scores.iter().flatten().filter(|score| **score >= own).count())
    }
}

/// Some queries out of a number of queries.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Share {
    /// How many.
    pub count: usize,
    /// Of how many.
    pub of: usize,
}

impl Share {
    /// The share, 0 to 1. `None` without queries.
    #[must_use]
    pub fn value(&self) -> Option<f64> {
        (self.of > 0).then(|| self.count as f64 / self.of as f64)
    }
}

impl fmt::Display for Share {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.value() {
            Some(value) => write!(f, "{value:.2} ({} of {})", self.count, self.of),
            None => write!(f, "–"),
        }
    }
}

/// The measures over some queries. Queries that mean an item and queries that mean nothing are counted apart.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Tally {
    /// Queries that mean an item.
    meant: usize,
    first: usize,
    among_few: usize,
    /// Sum of 1/rank.
    reciprocal: f64,
    /// Sum of 1/items.
    chance: f64,
    /// Queries that mean nothing.
    absent: usize,
    /// Those of them that got an answer.
    answered: usize,
}

impl Tally {
    /// Counts a query that means an item. One whose item is not among the ranked ones counts as not found.
    pub fn add_meant(&mut self, ranking: &Ranking, item: usize) {
        self.meant += 1;
        self.chance += 1.0 / ranking.items().max(1) as f64;
        if let Some(rank) = ranking.rank_of(item) {
            self.first += usize::from(rank == 1);
            self.among_few += usize::from(rank <= FEW);
            self.reciprocal += 1.0 / rank as f64;
        }
    }

    /// Counts a query that means nothing, and whether it got an answer.
    pub fn add_absent(&mut self, is_answered: bool) {
        self.absent += 1;
        self.answered += usize::from(is_answered);
    }

    /// Queries that mean an item.
    #[must_use]
    pub fn meant(&self) -> usize {
        self.meant
    }

    /// Queries whose item has rank 1, of those that mean an item.
    #[must_use]
    pub fn recall_at_1(&self) -> Share {
        Share { count: self.first, of: self.meant }
    }

    /// Queries whose item has a rank of 5 or better, of those that mean an item.
    #[must_use]
    pub fn recall_at_5(&self) -> Share {
        Share { count: self.among_few, of: self.meant }
    }

    /// The mean of 1/rank over the queries that mean an item, 0 to 1. `None` without such queries.
    #[must_use]
    pub fn mean_reciprocal_rank(&self) -> Option<f64> {
        (self.meant > 0).then(|| self.reciprocal / self.meant as f64)
    }

    /// Recall@1 of a guess: the mean of 1/items over the queries that mean an item. `None` without such queries.
    #[must_use]
    pub fn chance(&self) -> Option<f64> {
        (self.meant > 0).then(|| self.chance / self.meant as f64)
    }

    /// Queries that got an answer, of those that mean nothing.
    #[must_use]
    pub fn false_answers(&self) -> Share {
        Share { count: self.answered, of: self.absent }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn equal_scores_have_their_worst_rank() {
        let ranking = Ranking::new(vec![Some(0.5), Some(0.9), None, Some(0.5), Some(f64::NAN), Some(-0.2)]);
        let ranks: Vec<Option<usize>> = (0..7).map(|item| ranking.rank_of(item)).collect();
        assert_eq!(ranks, [Some(3), Some(1), None, Some(3), None, Some(4), None]);
        assert_eq!(ranking.items(), 6);
        assert_eq!(Ranking::new(vec![Some(0.0); 4]).rank_of(2), Some(4), "a method that tells nothing apart");
    }

    #[test]
    fn measures_of_queries_by_hand() {
        let mut tally = Tally::default();
        assert_eq!((tally.mean_reciprocal_rank(), tally.chance(), tally.recall_at_1().value()), (None, None, None));
        assert_eq!(tally.recall_at_5().to_string(), "–");
        // Ranks 1, 2 and 6 of 8 items, and one item that is not found among 4.
        let falling = Ranking::new((0..8).map(|item| Some(-f64::from(item))).collect());
        for item in [0, 1, 5] {
            tally.add_meant(&falling, item);
        }
        tally.add_meant(&Ranking::new(vec![Some(1.0), Some(1.0), Some(1.0), None]), 3);
        assert_eq!((tally.meant(), tally.recall_at_1(), tally.recall_at_5()), (4, share(1, 4), share(2, 4)));
        let expected = (1.0 + 0.5 + 1.0 / 6.0) / 4.0;
        assert!((tally.mean_reciprocal_rank().unwrap() - expected).abs() < 1e-12);
        assert!((tally.chance().unwrap() - (3.0 / 8.0 + 0.25) / 4.0).abs() < 1e-12);
        for is_answered in [true, false, false] {
            tally.add_absent(is_answered);
        }
        assert_eq!(tally.false_answers(), share(1, 3));
        assert_eq!((tally.false_answers().to_string(), tally.meant()), ("0.33 (1 of 3)".to_owned(), 4));
    }

    fn share(count: usize, of: usize) -> Share {
        Share { count, of }
    }

    fn some_queries() -> impl Strategy<Value = Vec<(Vec<Option<u8>>, usize)>> {
        // Few levels, so that many scores are equal.
        let scores = prop::collection::vec(prop::option::weighted(0.8, 0_u8..6), 1..12);
        prop::collection::vec((scores, 0_usize..1000), 1..20)
    }

    /// The tally of some queries; each has scores, and a number that picks its item.
    fn tally<'q>(queries: impl IntoIterator<Item = &'q (Vec<Option<u8>>, usize)>) -> Tally {
        let mut tally = Tally::default();
        for (scores, pick) in queries {
            let ranking = Ranking::new(scores.iter().map(|score| score.map(f64::from)).collect());
            tally.add_meant(&ranking, pick % scores.len());
        }
        tally
    }

    proptest! {
        #[test]
        fn the_mean_reciprocal_rank_lies_between_recall_and_one(queries in some_queries()) {
            let tally = tally(&queries);
            let (first, few) = (tally.recall_at_1().value().unwrap(), tally.recall_at_5().value().unwrap());
            let mean = tally.mean_reciprocal_rank().unwrap();
            prop_assert!(mean >= first - 1e-12 && mean <= 1.0 + 1e-12, "{mean} {first}");
            // Other ranks are 2 or worse.
            prop_assert!(mean <= first + 0.5 * (1.0 - first) + 1e-12 && few >= first);
        }

        #[test]
        fn the_order_of_items_and_queries_does_not_matter(queries in some_queries(), turn in 0_usize..12) {
            let before = tally(&queries);
            let moved: Vec<(Vec<Option<u8>>, usize)> = queries
                .iter()
                .rev()
                .map(|(scores, pick)| {
                    let (count, at) = (scores.len(), pick % scores.len());
                    let turn = turn % count;
                    let mut scores = scores.clone();
                    scores.rotate_left(turn);
                    scores.reverse();
                    (scores, count - 1 - (at + count - turn) % count)
                })
                .collect();
            let after = tally(&moved);
            prop_assert_eq!(before.recall_at_1(), after.recall_at_1());
            prop_assert_eq!(before.recall_at_5(), after.recall_at_5());
            let means = (before.mean_reciprocal_rank().unwrap(), after.mean_reciprocal_rank().unwrap());
            prop_assert!((means.0 - means.1).abs() < 1e-12);
        }

        #[test]
        fn a_better_score_never_hurts(queries in some_queries()) {
            let better: Vec<(Vec<Option<u8>>, usize)> = queries
                .iter()
                .map(|(scores, pick)| {
                    let (mut scores, at) = (scores.clone(), pick % scores.len());
                    scores[at] = Some(6);
                    (scores, at)
                })
                .collect();
            let (before, after) = (tally(&queries), tally(&better));
            prop_assert!(after.mean_reciprocal_rank() >= before.mean_reciprocal_rank());
            prop_assert_eq!(after.recall_at_1().count, queries.len());
        }
    }
}
