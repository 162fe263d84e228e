//! The Super-Gaussians of a scene, with the members of each.

use std::sync::Arc;

use sg_raster::structure::NO_CLUSTER;
use sg_selection::cluster_members::ClusterMembers;

/// Super-Gaussians, by Gaussian and by Super-Gaussian.
///
/// [`Self::new`] visits every Gaussian, so it belongs beside a loop that draws. Everything else costs as much as it returns.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Clusters {
    labels: Arc<[u32]>,
    members: ClusterMembers,
}

impl Clusters {
    /// Super-Gaussians by the label of each Gaussian, [`NO_CLUSTER`] for none. Labels count from 0 and are below the number of
    /// Gaussians; others count as none.
    #[must_use]
    pub fn new(labels: Arc<[u32]>) -> Self {
        let known =
            labels.iter().map(|label| Some(*label).filter(|l| *l != NO_CLUSTER && (*l as usize) < labels.len()));
        let count = known.clone().flatten().max().map_or(0, |most| most as usize + 1);
        let members = ClusterMembers::new(known, count);
        Self { labels, members }
    }

    /// The label of each Gaussian, [`NO_CLUSTER`] for none.
    #[must_use]
    pub fn labels(&self) -> &Arc<[u32]> {
        &self.labels
    }

    /// Number of Super-Gaussians.
    #[must_use]
    pub fn count(&self) -> usize {
        self.members.count()
    }

    /// Gaussians of a Super-Gaussian, ascending; none for an unknown label.
    #[must_use]
    pub fn members(&self, label: u32) -> &[u32] {
        self.members.get(label as usize)
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
