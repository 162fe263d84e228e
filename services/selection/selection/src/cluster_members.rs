//! Members of clusters, as one list with offsets.

/// Gaussians of each cluster, ascending.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ClusterMembers {
    /// Begin of each cluster in `members`, and the end of the last one.
    offsets: Vec<usize>,
    members: Vec<u32>,
}

impl ClusterMembers {
    /// Sorts the Gaussians into `count` clusters. `labels` gives the cluster of each Gaussian, in order. One of `count` or more
    /// is none. Each Gaussian is visited twice.
    #[must_use]
    pub fn new(labels: impl Iterator<Item = Option<u32>> + Clone, count: usize) -> Self {
        let known = labels.map(|label| label.map(|l| l as usize).filter(|l| *l < count));
        let mut offsets = vec![0; count + 1];
        for l in known.clone().flatten() {
            offsets[l + 1] += 1;
        }
        for l in 0..count {
            offsets[l + 1] += offsets[l];
        }
        let mut next = offsets.clone();
        let mut members = vec![0; offsets[count]];
        for (g, l) in (0..).zip(known) {
            if let Some(l) = l {
                members[next[l]] = g;
                next[l] += 1;
            }
        }
        Self { offsets, members }
    }

    /// Number of clusters.
    #[must_use]
    pub fn count(&self) -> usize {
        self.offsets.len() - 1
    }

    /// Members of a cluster, ascending; none for an unknown cluster.
    #[must_use]
    pub fn get(&self, cluster: usize) -> &[u32] {
        let ends = self.offsets.get(cluster).zip(self.offsets.get(cluster.saturating_add(1)));
        ends.map_or(&[], |(begin, end)| &self.members[*begin..*end])
    }
}
