//! The Super-Gaussians of a scene, with the members of each.

use std::sync::Arc;

use sg_raster::structure::NO_CLUSTER;

/// Super-Gaussians, by Gaussian and by Super-Gaussian.
///
/// [`Self::new`] visits every Gaussian, so it belongs beside a loop that draws. Everything else costs as much as it returns.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Clusters {
    labels: Arc<[u32]>,
    /// Begin of each Super-Gaussian in `members`, and the end of the last one.
    starts: Vec<u32>,
    /// Gaussians, Super-Gaussian by Super-Gaussian, ascending in each.
    members: Vec<u32>,
}

impl Clusters {
    /// Super-Gaussians by the label of each Gaussian, [`NO_CLUSTER`] for none. Labels count from 0 and are below the number of
    /// Gaussians; others count as none.
    #[must_use]
    pub fn new(labels: Arc<[u32]>) -> Self {
        let known = |label: u32| label != NO_CLUSTER && (label as usize) < labels.len();
        let count = labels.iter().filter(|label| known(**label)).max().map_or(0, |most| *most as usize + 1);
        // A counting sort.
        let mut starts = vec![0_u32; count + 1];
        for label in labels.iter().filter(|label| known(**label)) {
            if let Some(next) = starts.get_mut(*label as usize + 1) {
                *next += 1;
            }
        }
        for k in 1..starts.len() {
            starts[k] += starts[k - 1];
        }
        let mut ends = starts.clone();
        let mut members = vec![0; starts.last().map_or(0, |all| *all as usize)];
        for (gaussian, label) in (0_u32..).zip(labels.iter()).filter(|(_, label)| known(**label)) {
            if let Some(end) = ends.get_mut(*label as usize) {
                if let Some(member) = members.get_mut(*end as usize) {
                    *member = gaussian;
                }
                *end += 1;
            }
        }
        Self { labels, starts, members }
    }

    /// The label of each Gaussian, [`NO_CLUSTER`] for none.
    #[must_use]
    pub fn labels(&self) -> &Arc<[u32]> {
        &self.labels
    }

    /// Number of Super-Gaussians.
    #[must_use]
    pub fn count(&self) -> usize {
        self.starts.len() - 1
    }

    /// Gaussians of a Super-Gaussian, ascending; none for an unknown label.
    #[must_use]
    pub fn members(&self, label: u32) -> &[u32] {
        let start = self.starts.get(label as usize);
        let end = (label as usize).checked_add(1).and_then(|next| self.starts.get(next));
        let range = start.zip(end).map(|(start, end)| *start as usize..*end as usize);
        range.and_then(|range| self.members.get(range)).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn members_are_those_with_the_label(
            labels in proptest::collection::vec(prop_oneof![0_u32..9, Just(NO_CLUSTER), Just(1_000_000)], 0..200),
        ) {
            let clusters = Clusters::new(labels.clone().into());
            for label in 0..12 {
                let of_it = (0_u32..).zip(&labels).filter(|(_, l)| **l == label && (label as usize) < labels.len());
                let want: Vec<u32> = of_it.map(|(gaussian, _)| gaussian).collect();
                prop_assert_eq!(clusters.members(label), want);
            }
            prop_assert_eq!(clusters.members(NO_CLUSTER), [0_u32; 0]);
            prop_assert!(clusters.count() <= 9);
        }
    }
}
