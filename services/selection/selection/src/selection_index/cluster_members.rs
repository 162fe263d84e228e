//! Members of clusters, as one list with offsets.

/// Gaussians of each cluster, ascending.
#[derive(Debug, Clone)]
pub(super) struct ClusterMembers {
    offsets: Vec<usize>,
    members: Vec<u32>,
}

impl ClusterMembers {
    /// Sorts the Gaussians into `count` clusters. `labels` is the cluster of each Gaussian, below `count`.
    pub(super) fn new(labels: &[Option<u32>], count: usize) -> Self {
        let mut offsets = vec![0; count + 1];
        for &l in labels.iter().flatten() {
            offsets[l as usize + 1] += 1;
        }
        for l in 0..count {
            offsets[l + 1] += offsets[l];
        }
        let mut next = offsets.clone();
        let mut members = vec![0; offsets[count]];
        for (g, l) in (0..).zip(labels) {
            if let Some(l) = l {
                members[next[*l as usize]] = g;
                next[*l as usize] += 1;
            }
        }
        Self { offsets, members }
    }

    /// Number of clusters.
    pub(super) fn len(&self) -> usize {
        self.offsets.len() - 1
    }

    /// Members of a cluster, ascending.
    pub(super) fn get(&self, cluster: usize) -> &[u32] {
        &self.members[self.offsets[cluster]..self.offsets[cluster + 1]]
    }
}
