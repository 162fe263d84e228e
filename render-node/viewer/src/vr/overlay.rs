//! Proposal marks in the room: discs with a number that face the eyes, in front of everything.

use std::sync::Arc;

use egui::{Pos2, Vec2};
use glam::{DQuat, DVec2, DVec3};
use sg_proto::selection::ProposalsReply;

use super::panel_layers::facing;
use crate::display::ViewState;
use crate::hands::{Pose, Rectangle};
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

/// The marks of one person.
#[derive(Default)]
pub(super) struct MarkerOverlay {
    /// Each with its drawn number and its emphasis; unused ones are kept.
    panel_layers: Vec<(PanelLayer, Option<(usize, bool)>)>,
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
        self.panel_layers
            .iter()
            .take(self.count)
            .map(|(layer, lit)| (layer.place, lit.is_some_and(|(_, lit)| lit)))
            .collect()
    }

    /// Hangs them where `at` says that the proposal of a number is in the room.
    pub(super) fn show(
        &mut self,
        frame: &mut Frame<'_>,
        state: &ViewState,
        at: impl Fn(usize) -> Option<DVec3>,
    ) -> Result<(), XrError> {
        let (eyes, nowhere) = (frame.head.position, Pose { position: DVec3::ZERO, orientation: DQuat::IDENTITY });
        self.count = 0;
        for (k, place) in (0..state.proposals().len()).filter_map(|k| at(k).map(|place| (k, place))) {
            let lit = self.is_lit(k, state);
            if self.panel_layers.len() == self.count {
                let place = Rectangle { pose: nowhere, size: DVec2::ONE };
                self.panel_layers.push((PanelLayer::new(Vec2::splat(SIDE), SHARPNESS, place), None));
            }
            let Some((layer, drawn)) = self.panel_layers.get_mut(self.count) else { break };
            self.count += 1;
            let metres = theme::metres_per_point(place.distance(eyes).max(CLOSEST)) * if lit { LIT } else { 1.0 };
            let pose = Pose { position: place, orientation: facing(place, eyes) };
            layer.place = Rectangle { pose, size: DVec2::splat(f64::from(SIDE) * metres) };
            let changed = drawn.replace((k, lit)) != Some((k, lit));
            layer.show(frame, None, Vec::new(), changed, |ui| {
                theme::mark(ui.painter(), Pos2::new(0.5 * SIDE, 0.5 * SIDE), k, lit);
            })?;
        }
        Ok(())
    }
}
