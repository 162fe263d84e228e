//! The ground grid below what is visible and the box of what is visible, over a window's picture.

use std::sync::Arc;

use egui::{Color32, Rect, Shape, Vec2};
use glam::DVec3;
use sg_scene::appearance::Appearance;
use sg_scene::camera::Camera;
use sg_scene::model::{Scene, SceneBox};
use sg_scene::orientation::{Axis, LengthUnit};
use sg_scene::subject::Subject;

use super::round_length::{LABELS, round_length};
use crate::display::number_format::number;
use crate::display::{LatestWorker, is_requested, visible_parts};

/// Least number of cells along the box's longer side on the ground.
const CELLS: f64 = 5.0;

/// Most steps of a grid from the scene's origin: beyond them a line's place has too few digits.
const FARTHEST: f64 = 1e9;

/// Points from the picture's left and lower edges to the label, above the scale bar.
pub(super) const INSET: Vec2 = Vec2::new(18.0, 56.0);

/// A grid on the ground below a box, scene coordinates.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Ground {
    /// Distance between neighbouring lines: 1, 2 or 5 times a power of ten.
    pub(super) step: f64,
    pub(super) lines: Vec<[DVec3; 2]>,
}

/// The grid that covers a box's lowest side, with lines at multiples of its step. `None` for a box without extent across `up`,
/// or one too far from the origin.
pub(super) fn ground(bounds: SceneBox, up: Axis) -> Option<Ground> {
    let up = up.vector();
    let lowest = if up.element_sum() > 0.0 { bounds.min } else { bounds.max };
    let level = up.abs() * lowest;
    let (a, b) = (DVec3::new(up.z, up.x, up.y).abs(), DVec3::new(up.y, up.z, up.x).abs());
    let step = round_length(bounds.size().dot(a).max(bounds.size().dot(b)) / CELLS)?;
    let span = |axis: DVec3| {
        let (low, high) = ((bounds.min.dot(axis) / step).floor(), (bounds.max.dot(axis) / step).ceil());
        let high = high.max(low + 1.0);
        (low.abs().max(high.abs()) < FARTHEST).then_some((low, high))
    };
    let (along_a, along_b) = (span(a)?, span(b)?);
    let mut lines = Vec::new();
    for ((axis, (low, high)), (across, (from, to))) in [((a, along_a), (b, along_b)), ((b, along_b), (a, along_a))] {
        lines.extend((0..=(high - low) as u32).map(|k| {
            let at = level + step * (low + f64::from(k)) * axis;
            [at + step * from * across, at + step * to * across]
        }));
    }
    Some(Ground { step, lines })
}

/// The edges of a box.
pub(super) fn edges(bounds: SceneBox) -> impl Iterator<Item = [DVec3; 2]> {
    let corner =
        move |k: u32| DVec3::select(glam::BVec3::new(k & 1 != 0, k & 2 != 0, k & 4 != 0), bounds.max, bounds.min);
    let ends = (0..8).flat_map(|k| [1, 2, 4].map(|bit| (k, k | bit))).filter(|(a, b)| a != b);
    ends.map(move |(a, b)| [corner(a), corner(b)])
}

/// The distance of the grid's lines and the edges of the box in words, in the scene's unit where it has one.
pub(super) fn label(step: f64, bounds: SceneBox, unit: Option<LengthUnit>) -> String {
    let (factor, symbol) = unit.map_or((1.0, String::new()), |unit| {
        let millimetres = unit.millimetres();
        let (_, of, symbol) = LABELS.into_iter().find(|(least, ..)| step * millimetres >= *least).unwrap_or(LABELS[0]);
        (millimetres / of, format!(" {symbol}"))
    });
    let [x, y, z] = (factor * bounds.size()).to_array().map(number);
    format!("grid {}{symbol}, box {x} × {y} × {z}{symbol}", number(factor * step))
}

/// What the lines on the picture depend on.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Seen {
    pub(super) camera: Camera,
    pub(super) rect: Rect,
    /// Number of the surface in front, where it is known.
    pub(super) front: Option<u64>,
    pub(super) bounds: SceneBox,
    pub(super) up: Axis,
    pub(super) ink: Color32,
}

/// The grid and the box of one window.
pub(super) struct GroundGrid {
    pub(super) worker: LatestWorker<(Arc<Scene>, Appearance), Option<SceneBox>>,
    pub(super) requested: Option<(Arc<Scene>, Appearance)>,
    pub(super) bounds: Option<SceneBox>,
    pub(super) drawn: Option<(Seen, Vec<Shape>)>,
}

impl GroundGrid {
    /// The grid of a window. The box is found beside the loop; `wake` is called after each.
    ///
    /// # Errors
    /// The system's error if it cannot start a thread.
    pub(super) fn new(wake: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        let work = move |(scene, appearance): (Arc<Scene>, Appearance)| Subject::of(&scene, &appearance).bounds();
        let worker = LatestWorker::new("finds-box", work, wake)?;
        Ok(Self { worker, requested: None, bounds: None, drawn: None })
    }

    /// Whether no box is computed or waits.
    pub(super) fn is_idle(&self) -> bool {
        self.worker.is_idle()
    }

    /// The newest box of what is visible. Asks for that of `scene` and `appearance` where it is not known; does not wait.
    pub(super) fn bounds(&mut self, scene: &Arc<Scene>, appearance: &Appearance) -> Option<SceneBox> {
        if let Some(found) = self.worker.take() {
            self.bounds = found;
        }
        if !is_requested(self.requested.as_ref(), scene, appearance) {
            let wanted = (Arc::clone(scene), visible_parts(appearance));
            self.worker.submit(wanted.clone());
            self.requested = Some(wanted);
        }
        self.bounds
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn bounds() -> SceneBox {
        SceneBox { min: DVec3::new(-3.0, 10.0, -20.0), max: DVec3::new(117.0, 80.0, 35.5) }
    }

    #[test]
    fn the_grid_lies_below_the_box_at_round_places() {
        for up in Axis::ALL {
            let Ground { step, lines } = ground(bounds(), up).unwrap();
            let up = up.vector();
            let lowest = (bounds().min.dot(up)).min(bounds().max.dot(up));
            for [from, to] in &lines {
                assert!(
                    (from.dot(up) - lowest).abs() < 1e-9 && (to.dot(up) - lowest).abs() < 1e-9,
                    "{up}: {from} {to}"
                );
                let across = (DVec3::ONE - up.abs()) * *from / step;
                assert!((across - across.round()).abs().max_element() < 1e-9, "{up}: {from} of {step}");
            }
            let (min, max) =
                lines.iter().flatten().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)));
            let ground = DVec3::ONE - up.abs();
            assert!(
                (ground * min).cmple(ground * bounds().min).all() && (ground * max).cmpge(ground * bounds().max).all()
            );
        }
        let along_z = ground(bounds(), Axis::PlusZ).unwrap();
        assert_eq!((along_z.step, along_z.lines.len()), (20.0, 8 + 5));
    }

    #[test]
    fn the_label_has_the_scene_s_unit() {
        let edges = bounds();
        assert_eq!(label(20.0, edges, None), "grid 20, box 120 × 70 × 56");
        assert_eq!(label(20.0, edges, Some(LengthUnit::Millimetre)), "grid 20 mm, box 120 × 70 × 56 mm");
        assert_eq!(label(20.0, edges, Some(LengthUnit::Metre)), "grid 20 m, box 120 × 70 × 56 m");
        assert_eq!(label(0.5, edges, Some(LengthUnit::Micrometre)), "grid 500 nm, box 120,000 × 70,000 × 55,500 nm");
    }

    #[test]
    fn a_box_without_extent_or_far_away_has_no_grid() {
        let at = |min: DVec3, size: DVec3| ground(SceneBox { min, max: min + size }, Axis::PlusY);
        assert_eq!(at(DVec3::ONE, DVec3::Y), None);
        assert_eq!(at(DVec3::splat(1e12), DVec3::ONE), None);
        assert_eq!(at(DVec3::ZERO, DVec3::splat(f64::NAN)), None);
        // A side without extent has a strip of one cell.
        assert_eq!(at(DVec3::ZERO, DVec3::X).unwrap().lines.len(), 6 + 2);
    }

    #[test]
    fn a_box_has_twelve_edges_along_its_axes() {
        let all: Vec<_> = edges(bounds()).collect();
        assert_eq!(all.len(), 12);
        assert!(all.iter().all(|[a, b]| (*b - *a).to_array().iter().filter(|x| **x != 0.0).count() == 1), "{all:?}");
    }

    proptest! {
        #[test]
        fn a_grid_has_few_lines(
            size in proptest::array::uniform3(-6.0..6.0_f64), middle in proptest::array::uniform3(-1.0..1.0_f64), up in 0..6_usize,
        ) {
            let half = DVec3::from_array(size.map(|e| 10_f64.powf(e)));
            let middle = DVec3::from_array(middle);
            let found = ground(SceneBox { min: middle - half, max: middle + half }, Axis::ALL[up]);
            prop_assert!(found.is_none_or(|ground| (8..40).contains(&ground.lines.len())));
        }
    }
}
