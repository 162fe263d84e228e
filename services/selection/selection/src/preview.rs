//! What a selection would be if the stroke that is being drawn ended now.
//!
//! Each new sample costs what it hits: point strokes look at their new hits, cluster strokes at the clusters hit for the
//! first time, walk strokes solve again only what their new seeds change.

use glam::DVec3;
use sg_scene::mask::Mask;

use crate::brush::OpenStroke;
use crate::session::{SelectionError, SelectionSession};
use crate::strokes::{Kind, Mode, Stroke};

/// A stroke that is being drawn over a selection.
#[derive(Debug, Clone)]
pub struct Preview {
    /// The selection under it, and for walks the seeds it has added.
    session: SelectionSession,
    stroke: Stroke,
    open: OpenStroke,
    /// Clusters hit, for cluster strokes.
    seen: Vec<bool>,
    mask: Mask,
}

impl Preview {
    /// Begins a stroke without a sample; points that `stroke` has are not played.
    ///
    /// # Errors
    /// [`SelectionError::Stroke`] for a stroke that makes no sense whatever its points.
    pub fn begin(session: &SelectionSession, stroke: &Stroke) -> Result<Self, SelectionError> {
        let bare = Stroke { points: vec![[0.0; 3]], pressure: Vec::new(), ..stroke.clone() };
        bare.check().map_err(SelectionError::Stroke)?;
        let space = session.space();
        let radius = stroke.radius * space.bounds().longest_edge();
        Ok(Self {
            open: OpenStroke::new(space.gaussians(), radius).seen(stroke.behind(space.bounds())),
            seen: vec![false; if stroke.mode == Mode::Cluster { space.clusters() } else { 0 }],
            mask: session.mask().clone(),
            stroke: Stroke { points: Vec::new(), pressure: Vec::new(), ..stroke.clone() },
            session: session.clone(),
        })
    }

    /// Adds samples (normalized by the scene's box), with a factor on the radius at each of them or none. Returns the
    /// Gaussians that are selected now and were not before it, or the other way round, ascending.
    ///
    /// # Errors
    /// [`SelectionError`]; samples that make sense are then part of the stroke all the same.
    pub fn extend(&mut self, samples: &[[f64; 3]], pressure: &[f64]) -> Result<Vec<u32>, SelectionError> {
        // Not the stroke so far, which grows with every sample.
        let Stroke { mode, kind, radius, .. } = self.stroke;
        let new = Stroke { mode, kind, radius, points: samples.to_vec(), pressure: pressure.to_vec(), depth: None };
        new.check().map_err(SelectionError::Stroke)?;
        // A stroke has a factor at every point or at none: what came without had the factor 1.
        let pressed = !pressure.is_empty() || !self.stroke.pressure.is_empty();
        if pressed {
            self.stroke.pressure.resize(self.stroke.points.len(), 1.0);
        }
        let mut new = Vec::new();
        for (k, sample) in samples.iter().enumerate() {
            let space = self.session.space();
            let at = space.bounds().denormalize(DVec3::from_array(*sample));
            let factor = pressure.get(k).copied().unwrap_or(1.0);
            let hits = match pressed {
                true => self.open.extend_pressed(space.brush(), at, factor),
                false => self.open.extend(space.brush(), at),
            };
            new.extend_from_slice(hits);
            self.stroke.pressure.extend(pressed.then_some(factor));
        }
        self.stroke.points.extend_from_slice(samples);
        let mut changed = match self.stroke.mode {
            Mode::Point => self.flip(&new, self.stroke.kind == Kind::Foreground),
            Mode::Cluster => self.clusters(&new),
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

    /// What would be selected.
    #[must_use]
    pub fn mask(&self) -> &Mask {
        &self.mask
    }

    /// Gaussians hit so far.
    #[must_use]
    pub fn hits(&self) -> usize {
        self.open.hits().len()
    }

    /// The stroke so far.
    #[must_use]
    pub fn stroke(&self) -> &Stroke {
        &self.stroke
    }

    /// Sets some Gaussians; those that were otherwise.
    fn flip(&mut self, gaussians: &[u32], selected: bool) -> Vec<u32> {
        let otherwise = gaussians.iter().copied().filter(|&g| self.mask.get(g as usize) != selected);
        let changed: Vec<u32> = otherwise.collect();
        changed.iter().for_each(|&g| self.mask.set(g as usize, selected));
        changed
    }

    fn clusters(&mut self, hits: &[u32]) -> Vec<u32> {
        let space = std::sync::Arc::clone(self.session.space());
        let mut changed = Vec::new();
        for cluster in hits.iter().filter_map(|&g| space.cluster_of(g)) {
            if std::mem::replace(&mut self.seen[cluster], true) {
                continue;
            }
            let members = space.members(cluster);
            let selected = self.stroke.kind.selects(members, &self.mask);
            changed.extend(self.flip(members, selected));
        }
        changed
    }
}

/// Gaussians that one of two masks of the same length has and the other has not, ascending.
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
    use crate::space::{SelectionSpace, WalkOptions};
    use sg_clusters::cluster_graph::{ClusterGraph, GraphForm};
    use sg_clusters::clustering::{ClusteringOptions, cluster};
    use sg_clusters::geometry::{Geometry, GeometryOptions};
    use sg_clusters::progress::Silent;
    use sg_scene::synthetic::{point_scene, random_points};

    fn space() -> Arc<SelectionSpace> {
        let scene = point_scene(&random_points(1500, 3));
        let geometry = Geometry::of_scene(&scene, GeometryOptions::default(), &Silent).unwrap();
        let options = ClusteringOptions { max_clusters: 60, ..ClusteringOptions::default() };
        let (clustering, _) = cluster(&geometry, &options, &Silent).unwrap();
        let graph = ClusterGraph::new(&geometry, &clustering, GraphForm::Contact).unwrap();
        Arc::new(SelectionSpace::of_clusters(&scene, &clustering, &graph, WalkOptions::default()))
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 60, failure_persistence: None, ..ProptestConfig::default() })]

        /// Sample by sample, what is previewed is what the stroke so far would select, and what is told of is what
        /// changed.
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
