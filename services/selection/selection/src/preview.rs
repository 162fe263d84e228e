//! Preview of the selection while a stroke is drawn.
//!
//! The cost of a sample depends on its new hits only. Point strokes visit their new hits. Cluster strokes visit the newly
//! hit clusters. Walk strokes eliminate again only the columns that depend on the new seeds.

use glam::DVec3;
use sg_scene::mask::Mask;

use crate::brush::OpenStroke;
use crate::session::{SelectionError, SelectionSession};
use crate::steps::StepError;
use crate::strokes::{Kind, Mode, Stroke};

/// A selection with one unfinished stroke.
#[derive(Debug, Clone)]
pub struct Preview {
    /// The selection below, including the seeds of an unfinished walk stroke.
    session: SelectionSession,
    stroke: Stroke,
    open: OpenStroke,
    /// Number of Gaussians under the stroke, without those that are left out.
    hits: usize,
    /// Hit clusters, for cluster strokes; empty otherwise.
    hit_clusters: Vec<bool>,
    mask: Mask,
}

impl Preview {
    /// Begins a stroke without samples. The points of `stroke` are ignored.
    ///
    /// # Errors
    /// [`SelectionError::Step`] for an impossible stroke.
    pub fn begin(session: &SelectionSession, stroke: &Stroke) -> Result<Self, SelectionError> {
        let bare = Stroke { points: vec![[0.0; 3]], pressure: Vec::new(), ..stroke.clone() };
        bare.check().map_err(StepError::from)?;
        let index = session.index();
        let radius = stroke.radius * index.bounds().longest_edge();
        Ok(Self {
            open: OpenStroke::new(index.gaussians(), radius).with_depth_limit(stroke.depth_limit(index.bounds())),
            hits: 0,
            hit_clusters: vec![false; if stroke.mode == Mode::Cluster { index.clusters() } else { 0 }],
            mask: session.mask().clone(),
            stroke: Stroke { points: Vec::new(), pressure: Vec::new(), ..stroke.clone() },
            session: session.clone(),
        })
    }

    /// Adds samples, normalized by the scene's box. `pressure` has one factor on the radius per sample, or is empty.
    ///
    /// Returns the Gaussians that changed sides, ascending.
    ///
    /// # Errors
    /// [`SelectionError`]; samples with possible values still become part of the stroke.
    pub fn extend(&mut self, samples: &[[f64; 3]], pressure: &[f64]) -> Result<Vec<u32>, SelectionError> {
        // Check only the new samples: the whole stroke grows with every call.
        let Stroke { mode, kind, radius, .. } = self.stroke;
        let new = Stroke { mode, kind, radius, points: samples.to_vec(), pressure: pressure.to_vec(), depth: None };
        new.check().map_err(StepError::from)?;
        // A stroke has a factor at every point or at none. Earlier points without a factor get 1.
        let pressed = !pressure.is_empty() || !self.stroke.pressure.is_empty();
        if pressed {
            self.stroke.pressure.resize(self.stroke.points.len(), 1.0);
        }
        let mut new = Vec::new();
        for (k, sample) in samples.iter().enumerate() {
            let index = self.session.index();
            let at = index.bounds().denormalize(DVec3::from_array(*sample));
            let factor = pressure.get(k).copied().unwrap_or(1.0);
            let hits = match pressed {
                true => self.open.extend_with_pressure(index.brush(), at, factor),
                false => self.open.extend(index.brush(), at),
            };
            new.extend(hits.iter().copied().filter(|g| index.has(*g)));
            self.stroke.pressure.extend(pressed.then_some(factor));
        }
        self.hits += new.len();
        self.stroke.points.extend_from_slice(samples);
        let mut changed = match self.stroke.mode {
            Mode::Point => self.set_all(&new, self.stroke.kind == Kind::Foreground),
            Mode::Cluster => self.set_clusters(&new),
            Mode::Walk if new.is_empty() => Vec::new(),
            Mode::Walk => {
                let mask = self.session.seed(self.stroke.kind, &new)?;
                let changed = differing(&self.mask, mask);
                self.mask = mask.clone();
                changed
            }
        };
        changed.sort_unstable();
        Ok(changed)
    }

    /// The selected Gaussians.
    #[must_use]
    pub fn mask(&self) -> &Mask {
        &self.mask
    }

    /// The selection that the stroke is drawn over, with the walk of an unfinished walk stroke.
    #[must_use]
    pub fn session(&self) -> &SelectionSession {
        &self.session
    }

    /// Number of Gaussians under the stroke so far.
    #[must_use]
    pub fn hits(&self) -> usize {
        self.hits
    }

    /// The stroke so far.
    #[must_use]
    pub fn stroke(&self) -> &Stroke {
        &self.stroke
    }

    /// Selects or deselects Gaussians. Returns those that changed.
    fn set_all(&mut self, gaussians: &[u32], selected: bool) -> Vec<u32> {
        let changed: Vec<u32> = gaussians.iter().copied().filter(|&g| self.mask.get(g as usize) != selected).collect();
        changed.iter().for_each(|&g| self.mask.set(g as usize, selected));
        changed
    }

    /// Applies a cluster stroke to the newly hit clusters. Returns the Gaussians that changed.
    fn set_clusters(&mut self, hits: &[u32]) -> Vec<u32> {
        let index = std::sync::Arc::clone(self.session.index());
        let mut changed = Vec::new();
        for cluster in hits.iter().filter_map(|&g| index.cluster_of(g)) {
            if std::mem::replace(&mut self.hit_clusters[cluster], true) {
                continue;
            }
            let members = index.members(cluster);
            let selected = self.stroke.kind.selects(members, &self.mask);
            changed.extend(self.set_all(members, selected));
        }
        changed
    }
}

/// Symmetric difference of two masks of the same length: indices in exactly one of them, ascending.
#[must_use]
pub fn differing(one: &Mask, other: &Mask) -> Vec<u32> {
    let (mut either, mut both) = (one.clone(), one.clone());
    either.union_with(other);
    both.intersect_with(other);
    either.subtract(&both);
    either.ones().map(|g| g as u32).collect()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use proptest::prelude::*;

    use super::*;
    use crate::selection_index::{SelectionIndex, WalkOptions};
    use sg_clusters::cluster_graph::{ClusterGraph, GraphForm};
    use sg_clusters::clustering::{ClusteringOptions, cluster};
    use sg_clusters::geometry::{Geometry, GeometryOptions};
    use sg_clusters::progress::Silent;
    use sg_scene::synthetic::{point_scene, random_points};

    fn space() -> Arc<SelectionIndex> {
        let scene = point_scene(&random_points(1500, 3));
        let geometry = Geometry::of_scene(&scene, GeometryOptions::default(), &Silent).unwrap();
        let options = ClusteringOptions { max_clusters: 60, ..ClusteringOptions::default() };
        let (clustering, _) = cluster(&geometry, &options, &Silent).unwrap();
        let graph = ClusterGraph::new(&geometry, &clustering, GraphForm::Contact).unwrap();
        Arc::new(SelectionIndex::of_clusters(&scene, &clustering, &graph, WalkOptions::default()))
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 60, failure_persistence: None, ..ProptestConfig::default() })]

        /// After each sample, the preview equals the selection with the stroke so far, and the reported changes are complete.
        #[test]
        fn a_preview_is_what_the_stroke_would_select(
            before in prop::collection::vec((0..3_u8, 0..2_u8, prop::array::uniform3(0.0..1.0_f64)), 0..4),
            drawn in 0..3_u8, kind in 0..3_u8, radius in 0.02..0.2_f64, pressed in any::<bool>(),
            samples in prop::collection::vec((prop::array::uniform3(0.0..1.0_f64), 0.0..2.0_f64), 1..6),
        ) {
            let mode = |m: u8| [Mode::Walk, Mode::Cluster, Mode::Point][m as usize];
            let mut session = SelectionSession::new(space());
            for (m, k, at) in before {
                let kind = [Kind::Foreground, Kind::Background][k as usize];
                session.add_stroke(Stroke { mode: mode(m), kind, radius: 0.15, points: vec![at], pressure: Vec::new(), depth: None }).unwrap();
            }
            let kinds = if mode(drawn) == Mode::Cluster { 3 } else { 2 };
            let kind = [Kind::Foreground, Kind::Background, Kind::Toggle][kind as usize % kinds];
            let stroke = Stroke { mode: mode(drawn), kind, radius, points: Vec::new(), pressure: Vec::new(), depth: None };
            let mut preview = Preview::begin(&session, &stroke).unwrap();
            let mut shown = session.mask().clone();
            for (sample, factor) in samples {
                let factor = if pressed { vec![factor] } else { Vec::new() };
                for g in preview.extend(&[sample], &factor).unwrap() {
                    shown.set(g as usize, !shown.get(g as usize));
                }
                prop_assert_eq!(&shown, preview.mask());
                if preview.hits() > 0 {
                    prop_assert_eq!(&session.preview(preview.stroke().clone()).unwrap(), preview.mask());
                }
            }
        }
    }

    #[test]
    fn masks_differ_where_one_alone_is_set() {
        let of = |set: &[usize]| Mask::from_fn(130, |g| set.contains(&g));
        assert_eq!(differing(&of(&[0, 5, 64, 129]), &of(&[5, 63, 129])), [0, 63, 64]);
        assert_eq!(differing(&of(&[7]), &of(&[7])), [0_u32; 0]);
    }

    #[test]
    fn what_is_not_finite_is_refused() {
        let session = SelectionSession::new(space());
        let stroke = Stroke {
            mode: Mode::Point,
            kind: Kind::Foreground,
            radius: f64::NAN,
            points: Vec::new(),
            pressure: Vec::new(),
            depth: None,
        };
        assert!(Preview::begin(&session, &stroke).is_err());
        let mut preview = Preview::begin(&session, &Stroke { radius: 0.1, ..stroke }).unwrap();
        assert!(preview.extend(&[[0.5, f64::INFINITY, 0.5]], &[]).is_err());
        assert!(preview.extend(&[[0.5; 3]], &[-1.0]).is_err());
        assert!(preview.extend(&[[0.5; 3]], &[1.0, 1.0]).is_err());
    }
}
