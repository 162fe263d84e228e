//! Proposal marks in the room: discs with a number that face the eyes. Behind the scene they shine through it.

use std::sync::Arc;

use egui::{Pos2, Vec2};
use glam::{DQuat, DVec2, DVec3};
use sg_proto::selection::ProposalsReply;

use super::room_meshes::Hole;
use crate::display::ViewState;
use crate::hands::{Pose, Rectangle, facing};
use crate::panels::theme;
use crate::xr::{Frame, PanelLayer, XrError};

/// Points across a mark.
const SIDE: f32 = 2.0 * theme::MARK + 2.0;

/// Pixels of a point: a mark is small and stands close.
const SHARPNESS: f32 = 3.0;

/// Scale of the emphasized mark.
const LIT: f64 = 1.6;

/// Least distance from the eyes that a mark is made to be read from, metres.
const CLOSEST: f64 = 0.2;

/// Half the depth in metres around the scene's front over which a mark fades: its place is on a surface.
const SOFTNESS: f64 = 0.03;

/// Share of a mark that is seen through the scene.
const GHOST: f32 = 0.5;

/// A mark of the room, with its number and its emphasis.
struct HungMark {
    layer: PanelLayer,
    wanted: (usize, bool),
    drawn: Option<(usize, bool)>,
}

/// The marks of one person.
#[derive(Default)]
pub(super) struct MarkerOverlay {
    /// Unused ones are kept.
    panel_layers: Vec<HungMark>,
    /// How many hang there now.
    count: usize,
    /// The emphasized mark, and its set of proposals.
    lit: Option<(Arc<ProposalsReply>, usize)>,
}

impl MarkerOverlay {
    /// Has the mark of a number from 0 stand out, or no longer.
    pub(super) fn light_up(&mut self, number: usize, state: &ViewState) {
        let was = self.is_lit(number, state);
        self.lit = state.proposals.as_ref().filter(|_| !was).map(|p| (Arc::clone(p), number));
    }

    fn is_lit(&self, number: usize, state: &ViewState) -> bool {
        let of = |(of, k): &(Arc<ProposalsReply>, usize)| {
            *k == number && state.proposals.as_ref().is_some_and(|now| Arc::ptr_eq(now, of))
        };
        self.lit.as_ref().is_some_and(of)
    }

    /// Their positions, and the emphasized one.
    pub(super) fn places(&self) -> Vec<(Rectangle, bool)> {
        self.panel_layers.iter().take(self.count).map(|mark| (mark.layer.place, mark.wanted.1)).collect()
    }

    /// Hangs them where `at` says that the proposal of a number is in the room. Returns a hole for each.
    pub(super) fn hang(&mut self, eyes: DVec3, state: &ViewState, at: impl Fn(usize) -> Option<DVec3>) -> Vec<Hole> {
        let nowhere = Pose { position: DVec3::ZERO, orientation: DQuat::IDENTITY };
        self.count = 0;
        let mut holes = Vec::new();
        for (k, place) in (0..state.proposals().len()).filter_map(|k| at(k).map(|place| (k, place))) {
            let lit = self.is_lit(k, state);
            if self.panel_layers.len() == self.count {
                let place = Rectangle { pose: nowhere, size: DVec2::ONE };
                let layer = PanelLayer::new(Vec2::splat(SIDE), SHARPNESS, place);
                self.panel_layers.push(HungMark { layer, wanted: (k, lit), drawn: None });
            }
            let Some(mark) = self.panel_layers.get_mut(self.count) else { break };
            self.count += 1;
            mark.wanted = (k, lit);
            let metres = theme::metres_per_point(place.distance(eyes).max(CLOSEST)) * if lit { LIT } else { 1.0 };
            let pose = Pose { position: place, orientation: facing(place, eyes) };
            mark.layer.place = Rectangle { pose, size: DVec2::splat(f64::from(SIDE) * metres) };
            // The disc alone, and not the corners of its layer.
            let size = DVec2::splat(f64::from(2.0 * theme::MARK - 0.5) * metres);
            let place = Rectangle { pose, size };
            holes.push(Hole { place, corner: 0.5 * size.x, softness: SOFTNESS, ghost: GHOST });
        }
        holes
    }

    /// Draws and shows them: behind the eyes' pictures if these have holes for them.
    pub(super) fn show(&mut self, frame: &mut Frame<'_>, has_holes: bool) -> Result<(), XrError> {
        for HungMark { layer, wanted, drawn } in self.panel_layers.iter_mut().take(self.count) {
            layer.in_front = !has_holes;
            let (k, lit) = *wanted;
            let changed = drawn.replace(*wanted) != Some(*wanted);
            layer.show(frame, None, Vec::new(), changed, |ui| {
                theme::mark(ui.painter(), Pos2::new(0.5 * SIDE, 0.5 * SIDE), k, lit);
            })?;
        }
        Ok(())
    }
}
