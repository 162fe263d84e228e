//! What later strokes say about the scale of the first one.
//!
//! The first green stroke alone has a family of masks. A mask that holds nothing of what was brushed green since is too
//! narrow, and one that holds all of what was brushed red is too wide. The other leaks go on. Where there is none, the
//! strokes ask for a union of parts, and all leaks go on.

use sg_walk::Seed;

/// The masks of the first green stroke.
#[derive(Debug, Clone)]
pub(crate) struct FirstStroke {
    /// Seeds of its walk.
    pub(super) seeds: Vec<Seed>,
    /// Limit of p − q of the masks.
    pub(super) threshold: f64,
    /// Selected nodes of each leak, narrowest first.
    pub(super) selected: Vec<Vec<bool>>,
}

impl FirstStroke {
    /// Limit of p − q of the masks.
    pub(crate) fn threshold(&self) -> f64 {
        self.threshold
    }

    /// Leaks that agree with the seeds of all strokes. `mass` is the number of Gaussians of each node.
    pub(super) fn consistent(&self, seeds: &[Seed], mass: &[f64]) -> Vec<bool> {
        let later = |kind: Seed| {
            let is_later = move |node: &usize| seeds[*node] == kind && self.seeds[*node] != kind;
            (0..seeds.len()).filter(is_later).collect::<Vec<usize>>()
        };
        let (green, red) = (later(Seed::Foreground), later(Seed::Background));
        let share = |nodes: &[usize], selected: &[bool]| {
            let sum = |of: &dyn Fn(&usize) -> bool| nodes.iter().filter(|n| of(n)).map(|n| mass[*n]).sum::<f64>();
            sum(&|n| selected[*n]) / sum(&|_| true)
        };
        let agrees = |selected: &Vec<bool>| {
            let too_narrow = !green.is_empty() && share(&green, selected) <= 0.0;
            let too_wide = !red.is_empty() && share(&red, selected) >= 1.0;
            !too_narrow && !too_wide
        };
        let consistent: Vec<bool> = self.selected.iter().map(agrees).collect();
        if consistent.contains(&true) { consistent } else { vec![true; self.selected.len()] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Six nodes in a row; the masks of the first stroke on node 0 hold 1, 2, 4 and 6 of them.
    fn first() -> FirstStroke {
        let mut seeds = vec![Seed::None; 6];
        seeds[0] = Seed::Foreground;
        let selected = [1, 2, 4, 6].map(|n| (0..6).map(|node| node < n).collect()).to_vec();
        FirstStroke { seeds, threshold: 0.0, selected }
    }

    fn consistent(later: &[(usize, Seed)]) -> Vec<bool> {
        let mut seeds = first().seeds;
        later.iter().for_each(|(node, seed)| seeds[*node] = *seed);
        first().consistent(&seeds, &[1.0; 6])
    }

    #[test]
    fn green_takes_the_narrow_masks_away_and_red_the_wide_ones() {
        assert_eq!(consistent(&[]), [true; 4]);
        assert_eq!(consistent(&[(1, Seed::Foreground)]), [false, true, true, true]);
        assert_eq!(consistent(&[(3, Seed::Background)]), [true, true, false, false]);
        assert_eq!(consistent(&[(1, Seed::Foreground), (3, Seed::Background)]), [false, true, false, false]);
        // A stroke across the rim takes only the masks away that it contradicts.
        let across = |kind| [(1, kind), (2, kind), (3, kind)];
        assert_eq!(consistent(&across(Seed::Foreground)), [false, true, true, true]);
        assert_eq!(consistent(&across(Seed::Background)), [true, true, false, false]);
    }

    #[test]
    fn strokes_that_no_scale_agrees_with_leave_all() {
        assert_eq!(consistent(&[(3, Seed::Foreground), (1, Seed::Background)]), [true; 4]);
    }
}
