//! The brush of one display: the preview before the press, the changes during the stroke, and the stroke's messages.
//!
//! The display computes hits itself, so that the highlight follows the hand in the same frame. For single Gaussians and
//! whole Super-Gaussians, hits are the final result. For a walk, hits are the seeds; the region follows with the
//! selection's own answer ([`super::ViewState::selected`]).

use std::sync::Arc;

use glam::DVec3;
use sg_clusters::polyline::DepthLimit;
use sg_proto::scene::{Stroke, StrokeDepth, StrokeKind, StrokeMode};
use sg_proto::selection::{SampleRequest, StrokesRequest};
use sg_scene::mask::Mask;
use sg_scene::model::{Scene, SceneBox};
use sg_selection::brush::{Brush, OpenStroke};

use super::clusters::Clusters;
use super::request::Request;
use super::tools::{BrushMode, Tools};

/// Least distance between two samples, as a share of the brush's radius: closer ones hit nothing new.
const STEP: f64 = 0.25;

/// Sign of a stroke.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BrushSign {
    /// It adds to the selection.
    Add,
    /// It takes away.
    Remove,
}

/// Position of a brush, in the scene frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BrushSample {
    /// Its middle, scene coordinates.
    pub at: DVec3,
    /// Factor on its radius, such as from a trigger's pressure; 1 without.
    pub pressure: f64,
}

/// A brush over one scene.
#[derive(Debug)]
pub struct BrushController {
    brush: Arc<Brush>,
    bounds: SceneBox,
    gaussians: usize,
    strokes: u64,
    /// Prefix of this brush's stroke ids.
    name: String,
    active: Option<ActiveStroke>,
    /// Eye position from which the brush touches a surface, if any.
    pub eye: Option<DVec3>,
}

#[derive(Debug)]
struct ActiveStroke {
    id: String,
    mode: BrushMode,
    sign: BrushSign,
    include_hidden: bool,
    /// Fraction of the box's longest edge.
    radius: f64,
    pressed: bool,
    open: OpenStroke,
    points: Vec<f64>,
    pressure: Vec<f64>,
    depth: Option<StrokeDepth>,
    /// Number of samples already sent.
    sent: usize,
    last: Option<DVec3>,
}

impl BrushController {
    /// A hand over a scene; `name` distinguishes it from other hands of the session.
    #[must_use]
    pub fn new(scene: &Scene, brush: Arc<Brush>, name: impl Into<String>) -> Self {
        let (bounds, gaussians) = (scene.bounds, scene.len());
        Self { brush, bounds, gaussians, strokes: 0, name: name.into(), active: None, eye: None }
    }

    /// Brushes over the same Gaussians, some of them elsewhere.
    pub fn set_brush(&mut self, brush: Arc<Brush>) {
        self.brush = brush;
    }

    /// The radius in the scene's length unit.
    #[must_use]
    pub fn radius(&self, tools: &Tools) -> f64 {
        tools.radius * self.bounds.longest_edge()
    }

    /// Depth limit behind the surface, if one is set.
    fn depth_limit(&self, tools: &Tools) -> Option<DepthLimit> {
        let most = tools.brush_depth.clamp(0.0, 1.0) * self.radius(tools);
        self.eye.filter(|_| tools.front_only).map(|eye| DepthLimit { eye, max_distance: most })
    }

    /// Whether a stroke is under way.
    #[must_use]
    pub fn is_drawing(&self) -> bool {
        self.active.is_some()
    }

    /// Gaussians hit by the stroke under way.
    #[must_use]
    pub fn hits(&self) -> usize {
        self.active.as_ref().map_or(0, |s| s.open.hits().len())
    }

    /// The selection if the brush were pressed at `sample`.
    #[must_use]
    pub fn would_select(
        &self,
        tools: &Tools,
        sample: BrushSample,
        sign: BrushSign,
        selected: &Mask,
        clusters: Option<&Clusters>,
    ) -> Mask {
        let radius = self.radius(tools) * sample.pressure.max(0.0);
        let hits = self.brush.hits_with_depth_limit(&[sample.at], radius, &[], self.depth_limit(tools));
        changed(selected, &hits, tools.mode, sign, clusters)
    }

    /// Presses the brush and gives the first sample.
    pub fn press(&mut self, tools: &Tools, sample: BrushSample, sign: BrushSign) {
        self.strokes += 1;
        let limit = self.depth_limit(tools);
        let depth = limit.map(|DepthLimit { eye, .. }| StrokeDepth {
            eye: self.bounds.normalize(eye).to_array().to_vec(),
            reach: tools.brush_depth.clamp(0.0, 1.0) * tools.radius,
        });
        self.active = Some(ActiveStroke {
            id: format!("{}-{}", self.name, self.strokes),
            mode: tools.mode,
            sign,
            include_hidden: tools.include_hidden,
            radius: tools.radius,
            pressed: tools.pressure,
            open: OpenStroke::new(self.gaussians, self.radius(tools)).with_depth_limit(limit),
            points: Vec::new(),
            pressure: Vec::new(),
            depth,
            sent: 0,
            last: None,
        });
        self.sample(sample);
    }

    /// Extends the stroke to `sample`. It skips a sample without a position or too close to the last one.
    pub fn sample(&mut self, sample: BrushSample) {
        let Some(stroke) = &mut self.active else { return };
        let step = STEP * stroke.radius * self.bounds.longest_edge();
        let near = stroke.last.is_some_and(|last| last.distance(sample.at) < step);
        if near || !sample.at.is_finite() || stroke.points.len() / 3 >= sg_proto::limits::MAX_STROKE_POINTS {
            return;
        }
        stroke.last = Some(sample.at);
        stroke.points.extend(self.bounds.normalize(sample.at).to_array());
        if stroke.pressed {
            let factor = if sample.pressure.is_finite() { sample.pressure.max(0.0) } else { 1.0 };
            stroke.pressure.push(factor);
            stroke.open.extend_with_pressure(&self.brush, sample.at, factor);
        } else {
            stroke.open.extend(&self.brush, sample.at);
        }
    }

    /// Unsent samples, for the selection's preview; each is sent once.
    #[must_use]
    pub fn pending_samples(&mut self) -> Option<Request> {
        let stroke = self.active.as_mut()?;
        let samples = stroke.points.len() / 3;
        if samples == stroke.sent {
            return None;
        }
        let from = std::mem::replace(&mut stroke.sent, samples);
        let samples = stroke.message(from);
        Some(Request::Sample(SampleRequest {
            stroke: stroke.id.clone(),
            samples: Some(samples),
            include_hidden: stroke.include_hidden,
        }))
    }

    /// The selection with the stroke under way, as far as this display knows. It is `selected` itself once the selection
    /// has answered for the stroke.
    #[must_use]
    pub fn selects(&self, selected: &Arc<Mask>, clusters: Option<&Clusters>) -> Arc<Mask> {
        match &self.active {
            Some(stroke) if !stroke.open.hits().is_empty() => {
                Arc::new(changed(selected, stroke.open.hits(), stroke.mode, stroke.sign, clusters))
            }
            _ => Arc::clone(selected),
        }
    }

    /// Lifts the brush: the whole stroke, to be selected with.
    #[must_use]
    pub fn release(&mut self) -> Option<Request> {
        let stroke = self.active.take().filter(|s| !s.points.is_empty())?;
        let (strokes, include_hidden) = (vec![stroke.message(0)], stroke.include_hidden);
        Some(Request::Select(StrokesRequest { strokes, include_hidden, ..StrokesRequest::default() }))
    }

    /// Cancels the stroke as if it had not begun.
    pub fn abandon(&mut self) {
        self.active = None;
    }
}

impl ActiveStroke {
    /// The samples from this one on.
    fn message(&self, from: usize) -> Stroke {
        let mode = match self.mode {
            BrushMode::Walk => StrokeMode::Walk,
            BrushMode::Cluster => StrokeMode::Cluster,
            BrushMode::Point => StrokeMode::Point,
        };
        let kind = match self.sign {
            BrushSign::Add => StrokeKind::Foreground,
            BrushSign::Remove => StrokeKind::Background,
        };
        Stroke {
            mode: mode.into(),
            kind: kind.into(),
            radius: self.radius,
            points: self.points.get(3 * from..).unwrap_or_default().to_vec(),
            pressure: self.pressure.get(from..).unwrap_or_default().to_vec(),
            depth: self.depth.clone(),
        }
    }
}

/// A mask with a brush hit added or removed: whole clusters in cluster mode, if known.
fn changed(selected: &Mask, hits: &[u32], mode: BrushMode, sign: BrushSign, clusters: Option<&Clusters>) -> Mask {
    let mut mask = selected.clone();
    change(&mut mask, hits, sign, clusters.filter(|_| mode == BrushMode::Cluster));
    mask
}

/// Adds hits to a mask or removes them, with the members of their clusters. Returns the number of visited Gaussians: hits, and
/// members of hit clusters once each.
fn change(mask: &mut Mask, hits: &[u32], sign: BrushSign, clusters: Option<&Clusters>) -> usize {
    let on = sign == BrushSign::Add;
    hits.iter().for_each(|i| mask.set(*i as usize, on));
    let Some(clusters) = clusters else { return hits.len() };
    let mut hit: Vec<u32> = hits.iter().filter_map(|i| clusters.labels().get(*i as usize)).copied().collect();
    hit.sort_unstable();
    hit.dedup();
    let members = hit.iter().flat_map(|label| clusters.members(*label));
    members.fold(hits.len(), |visited, i| {
        mask.set(*i as usize, on);
        visited + 1
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_brush_over_clusters_visits_their_members_and_no_other_gaussian() {
        // 25 Gaussians a cluster, in scenes of two sizes.
        let visited = |gaussians: usize| {
            let clusters = Clusters::new((0..gaussians).map(|i| (i / 25) as u32).collect());
            let mut mask = Mask::empty(gaussians);
            let visited = change(&mut mask, &[30, 31, 60], BrushSign::Add, Some(&clusters));
            assert_eq!(mask.ones().collect::<Vec<_>>(), (25..75).collect::<Vec<_>>());
            visited
        };
        assert_eq!(visited(1000), 3 + 50);
        assert_eq!(visited(1_000_000), visited(1000));
    }
}
