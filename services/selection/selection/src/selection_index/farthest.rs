//! Automatic background: the nodes farthest from the foreground.

use sg_clusters::neighbours::Graph;
use sg_clusters::shortest::nearest_source;
use sg_walk::Seed;

/// The share of each component that becomes background.
const SHARE: f64 = 0.05;

/// Path lengths between nodes, and the component of each node.
#[derive(Debug, Clone)]
pub(super) struct FarthestRule {
    pub(super) graph: Graph,
    /// `None` for nodes outside all components.
    pub(super) component: Vec<Option<u32>>,
}

impl FarthestRule {
    /// Seeds the farthest nodes as background and returns their number.
    ///
    /// In each component with active nodes, the quota is a twentieth of these nodes, rounded up. The order is the path
    /// length from the foreground; ties go to the smaller id. Without foreground no node is seeded.
    pub(super) fn seed(&self, active: &[bool], seeds: &mut [Seed]) -> usize {
        let Self { graph, component } = self;
        let sources: Vec<u32> = (0..).zip(&*seeds).filter(|(_, s)| **s == Seed::Foreground).map(|(u, _)| u).collect();
        if sources.is_empty() {
            return 0;
        }
        let (distance, _) = nearest_source(graph, &sources);
        let components = component.iter().flatten().max().map_or(0, |c| *c as usize + 1);
        let mut nodes: Vec<Vec<u32>> = vec![Vec::new(); components];
        for (u, c) in (0..).zip(component) {
            if let (true, Some(c)) = (active[u as usize], c) {
                nodes[*c as usize].push(u);
            }
        }
        let mut chosen = 0;
        for mut nodes in nodes {
            let quota = (SHARE * nodes.len() as f64).ceil() as usize;
            nodes.retain(|&u| seeds[u as usize] == Seed::None && distance[u as usize].is_finite());
            nodes.sort_by(|&a, &b| distance[b as usize].total_cmp(&distance[a as usize]).then(a.cmp(&b)));
            for &u in nodes.iter().take(quota) {
                seeds[u as usize] = Seed::Background;
                chosen += 1;
            }
        }
        chosen
    }
}
