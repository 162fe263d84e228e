//! Panels in the room: their placement, pointers and movement, and the requests made on them.

use egui::{Align2, Color32, Stroke, Ui};
use glam::{DQuat, DVec2, DVec3};

use super::callouts::Callouts;
use super::interaction::{Interaction, PanelCapture};
use super::room_meshes::Hole;
use crate::display::{Tools, ViewState};
use crate::hands::{
    Eye, HandInput, Origin, Pointed, Pointer, Pose, RaisedHand, Rectangle, Side, Stance, Switch, facing, nearest,
};
use crate::panels::{Output, Panel, Panels, RoomPlace, theme};
use crate::xr::{Counts, Frame, PanelLayer, XrError};

/// Metres from the person to panels that hang around them.
const DISTANCE: f64 = 1.1;

/// Metres from the eyes to a panel below them.
const BELOW: f64 = 0.7;

/// Pixels of a point.
const SHARPNESS: f32 = 1.5;

/// Half the depth in metres around the scene's front over which a panel fades, and the share of it that is seen through the
/// scene.
const BEHIND: (f64, f32) = (0.01, 0.3);

/// The wrist menu's reading distance to the eyes, and its distance below the palm, metres.
const WRIST: (f64, f64) = (0.45, 0.08);

/// Cosines of the angle between palm and eyes: above the first the wrist menu appears, below the second it goes. A hand
/// held out to its side looks inwards by itself.
const TURNED: [f64; 2] = [0.9, 0.75];

/// Cosines of the angle between gaze and palm, likewise.
const LOOKED_AT: f64 = 0.7;

/// Panels of one person.
pub(super) struct PanelLayers {
    panels: Vec<PlacedPanel>,
    callouts: [Callouts; 2],
    raised: [RaisedHand; 2],
    pointer: Pointer,
    pointed: Option<Pointed>,
    grips: [Switch; 2],
    /// The carried panel and its pose in the hand.
    carried: [Option<(usize, Pose)>; 2],
    state: bool,
    /// Whether the wrist menu is visible.
    wrist: bool,
    /// State and tools of the newest frame.
    newest: Option<(ViewState, Tools)>,
    frames: u64,
}

/// A panel that hangs in the room.
struct PlacedPanel {
    panel: Panel,
    layer: PanelLayer,
    /// Whether its content may have changed since its layout.
    stale: bool,
    /// Frame number of that layout.
    since: u64,
}

impl PlacedPanel {
    /// Whether the scene can hide it. Panels for a hand close to the eyes are in front of everything.
    fn is_behind_pictures(&self) -> bool {
        matches!(self.panel.place, RoomPlace::Around { .. })
    }
}

/// Initial placement of a panel around a person with eyes at this height of the room, metres. The wrist menu gets its
/// place from a hand.
fn hangs(panel: Panel, height: f64) -> Rectangle {
    let (pose, distance) = match panel.place {
        RoomPlace::Around { degrees } => {
            let turn = DQuat::from_rotation_y(-degrees.to_radians());
            let position = turn * DVec3::new(0.0, 0.0, -DISTANCE) + DVec3::new(0.0, height - 0.2, 0.0);
            (Pose { position, orientation: turn }, DISTANCE)
        }
        RoomPlace::Below => {
            let position = DVec3::new(0.0, height - 0.6, -0.6);
            (Pose { position, orientation: DQuat::from_rotation_x(-0.6) }, BELOW)
        }
        RoomPlace::Wrist => (Pose { position: DVec3::ZERO, orientation: DQuat::IDENTITY }, WRIST.0),
    };
    Rectangle { pose, size: DVec2::from(panel.least_metres(distance)) }
}

/// Initial placement of a panel in a room around a standing or seated person.
#[must_use]
pub fn first_place(panel: Panel, stance: Stance, origin: Origin) -> Rectangle {
    hangs(panel, eyes(stance, origin))
}

/// Metres from y = 0 of the room to the eyes: the scene is fitted a little below them.
fn eyes(stance: Stance, origin: Origin) -> f64 {
    stance.height(origin) + 0.4
}

impl PanelLayers {
    /// Panels about a person.
    pub(super) fn new(stance: Stance, origin: Origin) -> Self {
        let eyes = eyes(stance, origin);
        let placed = |panel: &Panel| {
            let layer = PanelLayer::new(panel.size, SHARPNESS, hangs(*panel, eyes));
            PlacedPanel { panel: *panel, layer, stale: true, since: 0 }
        };
        Self {
            panels: Panel::ALL.iter().map(placed).collect(),
            callouts: Side::BOTH.map(Callouts::new),
            raised: [RaisedHand::default(); 2],
            pointer: Pointer::default(),
            pointed: None,
            grips: [Switch::default(); 2],
            carried: [None; 2],
            state: true,
            wrist: false,
            newest: None,
            frames: 0,
        }
    }

    /// Layout and draw counts of a panel.
    pub(super) fn counts(&self, panel: Panel) -> Option<Counts> {
        self.panels.iter().find(|placed| placed.panel == panel).map(|placed| placed.layer.counts())
    }

    /// Swaps hidden and shown panels; returns the pending output of hidden panels.
    pub(super) fn turn_over(&mut self, panels: &mut Panels) -> Output {
        self.state = !self.state;
        let mut left = Output::default();
        if !self.state {
            self.panels.iter().for_each(|placed| left.join(panels.put_away(placed.panel)));
        }
        left
    }

    /// Placement of a panel, unless it is hidden.
    pub(super) fn place(&self, panel: Panel) -> Option<Rectangle> {
        let hidden = if panel.place == RoomPlace::Wrist { !self.wrist } else { !self.state };
        self.panels.iter().find(|placed| placed.panel == panel && !hidden).map(|placed| placed.layer.place)
    }

    /// Holes in the eyes' pictures for the visible panels around the person. The panel that a hand points at or carries is
    /// whole; of the others a part is seen through the scene.
    pub(super) fn holes(&self, panels: &Panels, state: &ViewState) -> Vec<Hole> {
        let hung = self.visible(panels, state).into_iter().filter_map(|k| self.panels.get(k).map(|hung| (k, hung)));
        let behind = hung.filter(|(_, hung)| hung.is_behind_pictures());
        let hole = |(k, hung): (usize, &PlacedPanel)| {
            let held = self.carried.iter().flatten().any(|(layer, _)| *layer == k);
            let pointed = self.pointed.is_some_and(|pointed| pointed.rectangle == k);
            let (softness, ghost) = if held || pointed { (BEHIND.0, 1.0) } else { BEHIND };
            Hole { place: hung.layer.place, corner: 0.0, softness, ghost }
        };
        behind.map(hole).collect()
    }

    /// Where on a panel a hand's ray ends, in the room.
    pub(super) fn pointed_by(&self, side: Side) -> Option<DVec3> {
        let pointed = self.pointed.filter(|pointed| pointed.side == side)?;
        Some(self.panels.get(pointed.rectangle)?.layer.place.point(pointed.at))
    }

    /// Hangs labels beside the hands that are raised to the eyes, or beside both hands with [`Tools::callouts`]. A hand that
    /// is `busy` or whose palm shows the wrist menu is not raised. Returns lines from labels to controls.
    pub(super) fn hang_callouts(
        &mut self,
        (hands, head): (&[HandInput; 2], &Pose),
        busy: [bool; 2],
        (tools, state): (&Tools, &ViewState),
        seconds: f64,
    ) -> Vec<[DVec3; 2]> {
        let menu = Interaction::adds(tools).other();
        let mut leaders = Vec::new();
        for side in Side::BOTH {
            let k = side.index();
            let (grip, has_menu) = (hands[k].grip, self.wrist && side == menu);
            let busy = busy[k] || has_menu || self.pointed.is_some_and(|pointed| pointed.side == side);
            let raised = self.raised[k].step(grip.map(|grip| grip.position), head, busy, seconds);
            let shown = grip.filter(|_| raised || (tools.callouts && !has_menu));
            let lines = || Interaction::legend(side, tools, state);
            leaders.extend(self.callouts[k].hang(shown, head.position, lines, tools));
        }
        leaders
    }

    /// Where the labels of a hand hang, while they are shown.
    pub(super) fn callouts(&self, side: Side) -> Option<Rectangle> {
        self.callouts[side.index()].place()
    }

    /// Indices of the visible panels.
    fn visible(&self, panels: &Panels, state: &ViewState) -> Vec<usize> {
        let hangs = |panel: Panel| match panel.place {
            RoomPlace::Wrist => self.wrist,
            RoomPlace::Below => self.state && panels.is_typing(),
            RoomPlace::Around { .. } => self.state && panel.has_content(state),
        };
        let all = self.panels.iter().enumerate().filter(|(_, placed)| hangs(placed.panel));
        all.map(|(k, _)| k).collect()
    }

    /// Takes in the hands' rays and grabs; returns the input captured by the panels.
    pub(super) fn step(
        &mut self,
        (hands, head): (&[HandInput; 2], &Pose),
        panels: &Panels,
        tools: &Tools,
        state: &ViewState,
    ) -> PanelCapture {
        self.turn_wrist(&hands[Interaction::adds(tools).other().index()], head);
        let visible = self.visible(panels, state);
        let rectangles: Vec<Rectangle> = visible.iter().map(|k| self.panels[*k].layer.place).collect();
        self.pointed = self.pointer.step(&rectangles, hands);
        let mut captured = PanelCapture::default();
        for side in Side::BOTH {
            let k = side.index();
            captured.triggers[k] = self.pointer.has(side, self.pointed.as_ref());
            let was = self.grips[k].is_on();
            let squeezed = self.grips[k].press(hands[k].squeeze);
            let Some(aim) = hands[k].aim.filter(|_| squeezed) else {
                self.carried[k] = None;
                continue;
            };
            if !was
                && let Some((at, ..)) = nearest(&rectangles, &aim)
                && let layer = visible[at]
                && self.panels[layer].panel.place != RoomPlace::Wrist
            {
                let pose = self.panels[layer].layer.place.pose;
                let back = aim.orientation.inverse();
                let held =
                    Pose { position: back * (pose.position - aim.position), orientation: back * pose.orientation };
                self.carried[k] = Some((layer, held));
            }
            if let Some((layer, held)) = self.carried[k] {
                captured.grips[k] = true;
                let place = &mut self.panels[layer].layer.place;
                place.pose = Pose {
                    position: aim.position + aim.orientation * held.position,
                    orientation: (aim.orientation * held.orientation).normalize(),
                };
                // A stick makes it larger and smaller.
                let stick = hands[k].stick.y;
                if stick.abs() > 0.3 {
                    place.size = (place.size * (1.0 + 0.02 * stick)).clamp(DVec2::splat(0.1), DVec2::splat(4.0));
                }
            }
        }
        // From here on the index counts all panels, not only visible ones.
        if let Some(pointed) = &mut self.pointed {
            pointed.rectangle = visible[pointed.rectangle];
        }
        captured
    }

    /// Has the wrist menu be at the hand that does not brush while its palm and the eyes look at each other.
    fn turn_wrist(&mut self, hand: &HandInput, head: &Pose) {
        let turned = |(grip, palm): (Pose, DVec3)| {
            let way = (head.position - grip.position).normalize_or_zero();
            let looks = palm.dot(way) > TURNED[usize::from(self.wrist)] && -head.forward().dot(way) > LOOKED_AT;
            looks.then_some(grip)
        };
        let at = hand.grip.zip(hand.palm).and_then(turned);
        self.wrist = at.is_some();
        let layer = self.panels.iter_mut().find(|placed| placed.panel.place == RoomPlace::Wrist);
        if let (Some(grip), Some(PlacedPanel { layer, .. })) = (at, layer) {
            let position = grip.position - DVec3::new(0.0, WRIST.1, 0.0);
            layer.place.pose = Pose { position, orientation: facing(position, head.position) };
        }
    }

    /// Index of the panel to lay out next because its content has changed; the two indices after the panels are the hands'
    /// labels. Among the visible ones, the longest waiting comes first. Laying out a panel takes longer than all else in a
    /// frame beside the picture. A scene that changes in every frame changes all of them.
    fn turn(&self, eyes: &[Eye; 2], visible: &[usize], tools: &Tools) -> Option<usize> {
        let sees = |place: &Rectangle| eyes.iter().any(|eye| eye.may_see(place));
        let panels = visible.iter().filter_map(|k| self.panels.get(*k).map(|placed| (*k, placed)));
        let panels = panels.filter(|(_, h)| h.stale && sees(&h.layer.place)).map(|(k, placed)| (k, placed.since));
        let labels = self.callouts.iter().enumerate().filter(|(_, labels)| labels.is_stale(tools));
        let labels = labels.filter(|(_, labels)| labels.place().is_some_and(|place| sees(&place)));
        let labels = labels.map(|(k, labels)| (self.panels.len() + k, labels.since));
        panels.chain(labels).min_by_key(|(_, since)| *since).map(|(k, _)| k)
    }

    /// Draws and shows all layers; returns the output of the panels. Panels are behind the eyes' pictures if these have holes
    /// for them.
    pub(super) fn show(
        &mut self,
        frame: &mut Frame<'_>,
        panels: &mut Panels,
        state: &ViewState,
        tools: &mut Tools,
        has_holes: bool,
    ) -> Result<Output, XrError> {
        self.frames += 1;
        if self.newest.as_ref().is_none_or(|(s, t)| !same(s, state) || t != tools) {
            self.panels.iter_mut().for_each(|placed| placed.stale = true);
            self.newest = Some((state.clone(), tools.clone()));
        }
        let visible = self.visible(panels, state);
        let turn = self.turn(&frame.eyes, &visible, tools);
        let hands = frame.hands;
        let mut output = Output::default();
        for k in visible {
            let pointed = self.pointed.filter(|p| p.rectangle == k);
            let Some(placed) = self.panels.get_mut(k) else { continue };
            placed.layer.in_front = !(has_holes && placed.is_behind_pictures());
            let PlacedPanel { panel, layer, stale, since } = placed;
            let panel = *panel;
            let by = pointed.as_ref().map(|p| (p, &hands[p.side.index()]));
            // A panel under a pointer is updated at once; the keyboard's letters appear in another panel.
            let changed = turn == Some(k) || (*stale && by.is_some()) || panels.wants_drawing(panel);
            let before = layer.counts().laid_out;
            layer.show(frame, by, Vec::new(), changed, |ui| {
                theme::apply(ui.ctx(), tools);
                output.join(panels.show(panel, ui, state, tools));
                if Panel::ALL.first() == Some(&panel) {
                    // One panel alone shows notices.
                    let notices =
                        egui::Area::new(egui::Id::unique("notices")).anchor(Align2::CENTER_BOTTOM, [0.0, -16.0]);
                    notices.interactable(false).show(ui.ctx(), |ui| panels.notices(ui, state));
                }
                mark(ui);
            })?;
            if layer.counts().laid_out > before {
                (*stale, *since) = (false, self.frames);
            }
        }
        for (k, labels) in self.callouts.iter_mut().enumerate() {
            labels.show(frame, tools, turn == Some(self.panels.len() + k), self.frames)?;
        }
        Ok(output)
    }
}

/// Intersection of a hand's ray with a panel.
fn mark(ui: &Ui) {
    if let Some(at) = ui.input(|i| i.pointer.latest_pos()) {
        let painter = ui.ctx().debug_painter();
        painter.circle(at, 5.0, Color32::from_white_alpha(180), Stroke::new(1.5, Color32::BLACK));
    }
}

/// Whether the panels' content is equal. All of it is shared and replaced on change.
fn same(a: &ViewState, b: &ViewState) -> bool {
    use std::sync::Arc;
    Arc::ptr_eq(&a.scene, &b.scene)
        && Arc::ptr_eq(&a.undo, &b.undo)
        && a.steps_at == b.steps_at
        && Arc::ptr_eq(&a.redo, &b.redo)
        && Arc::ptr_eq(&a.selected, &b.selected)
        && Arc::ptr_eq(&a.conversation, &b.conversation)
        && Arc::ptr_eq(&a.notices, &b.notices)
        && Arc::ptr_eq(&a.labeling, &b.labeling)
        && a.tour == b.tour
        && a.clusters.as_ref().map(Arc::as_ptr) == b.clusters.as_ref().map(Arc::as_ptr)
        && a.proposals.as_ref().map(Arc::as_ptr) == b.proposals.as_ref().map(Arc::as_ptr)
        && a.answers == b.answers
        && (a.services, a.uncommitted, a.trial_tuning, a.walk_capabilities)
            == (b.services, b.uncommitted, b.trial_tuning, b.walk_capabilities)
}
