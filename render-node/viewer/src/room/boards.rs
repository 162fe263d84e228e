//! Panels in the room: where they hang, who points at them, how they are moved, and what is asked for on them.

use egui::{Align2, Color32, Pos2, Stroke, Ui, Vec2};
use glam::{DQuat, DVec2, DVec3};

use super::acts::{Acts, SeenTip, Taken};
use crate::display::{Sense, Shown, Tools};
use crate::hands::{Eye, HandInput, Origin, Pointed, Pointer, Pose, Rectangle, Side, Stance, Switch, nearest};
use crate::panels::{Output, Panel, Panels, legend, theme};
use crate::xr::{Board, Counts, Frame, XrError};

/// Metres from the person to panels that hang around them.
const DISTANCE: f64 = 1.1;

/// Degrees to the right of straight ahead of each of them.
const ANGLES: [(Panel, f64); 3] = [(Panel::Scene, -55.0), (Panel::Prompt, 50.0), (Panel::Language, 92.0)];

/// Pixels of a point.
const SHARPNESS: f32 = 1.5;

/// Points of the tool legend across and down, and metres to the eyes that it is made to be read from.
const LEGEND: (Vec2, f64) = (Vec2::new(430.0, 580.0), 0.4);

/// Metres to the eyes that the wrist menu is made to be read from, and how far below the palm its middle is.
const WRIST: (f64, f64) = (0.45, 0.08);

/// How straight a palm looks at the eyes, as a cosine, before the wrist menu is there, and before it is gone again: a hand held
/// out to its side looks inwards by itself.
const TURNED: [f64; 2] = [0.9, 0.75];

/// How straight the eyes look at the palm, likewise.
const LOOKED_AT: f64 = 0.7;

/// Points across a brush's ring.
const RING: f32 = 64.0;

/// Panels of one person.
pub(super) struct Boards {
    panels: Vec<Hung>,
    legend: Board,
    /// What the legend said last, and in which frame it was laid out.
    said: (Option<Said>, u64),
    rings: [Board; 2],
    ring_senses: [Option<Sense>; 2],
    pointer: Pointer,
    pointed: Option<Pointed>,
    grips: [Switch; 2],
    /// Which panel a hand carries, and where it is in that hand.
    carried: [Option<(usize, Pose)>; 2],
    shown: bool,
    /// Whether the wrist menu is there.
    wrist: bool,
    /// What there was to show in the newest frame.
    newest: Option<(Shown, Tools)>,
    frames: u64,
}

/// What a legend says: the hand that adds, the lines of that and of the other one, whether it is light, its scale.
type Said = (Side, [Vec<(&'static str, String)>; 2], bool, f32);

/// A panel that hangs in the room.
struct Hung {
    panel: Panel,
    board: Board,
    /// Whether what it shows may have changed since it was laid out.
    stale: bool,
    /// In which frame it was.
    since: u64,
}

/// Where a panel hangs at first around a person whose eyes are at this height of the room, metres: upright at an angle, or,
/// for the keyboard, below the eyes and tilted.
fn hangs(panel: Panel, height: f64) -> Rectangle {
    let (pose, distance) = match ANGLES.iter().find(|(p, _)| *p == panel) {
        Some((_, degrees)) => {
            let turn = DQuat::from_rotation_y(-degrees.to_radians());
            let position = turn * DVec3::new(0.0, 0.0, -DISTANCE) + DVec3::new(0.0, height - 0.2, 0.0);
            (Pose { position, orientation: turn }, DISTANCE)
        }
        None => {
            let position = DVec3::new(0.0, height - 0.6, -0.6);
            (Pose { position, orientation: DQuat::from_rotation_x(-0.6) }, 0.7)
        }
    };
    Rectangle { pose, size: DVec2::from(panel.least_metres(distance)) }
}

/// Where a panel hangs at first in a room around a person who stands or sits.
#[must_use]
pub fn first_place(panel: Panel, stance: Stance, origin: Origin) -> Rectangle {
    hangs(panel, eyes(stance, origin))
}

/// Metres from y = 0 of the room to the eyes: the scene is fitted a little below them.
fn eyes(stance: Stance, origin: Origin) -> f64 {
    stance.height(origin) + 0.4
}

impl Boards {
    /// Panels about a person.
    pub(super) fn new(stance: Stance, origin: Origin) -> Self {
        let eyes = eyes(stance, origin);
        let hung = |panel: Panel| {
            let board = Board::new(panel.size(), SHARPNESS, hangs(panel, eyes));
            Hung { panel, board, stale: true, since: 0 }
        };
        let mut panels: Vec<_> = [Panel::Scene, Panel::Prompt, Panel::Language, Panel::Keyboard].map(hung).into();
        let nowhere = |size: Vec2, metres: DVec2| {
            let pose = Pose { position: DVec3::ZERO, orientation: DQuat::IDENTITY };
            Board::new(size, SHARPNESS, Rectangle { pose, size: metres })
        };
        let wrist = DVec2::from(Panel::Wrist.least_metres(WRIST.0));
        panels.push(Hung { panel: Panel::Wrist, board: nowhere(Panel::Wrist.size(), wrist), stale: true, since: 0 });
        let metres = theme::metres_per_point(LEGEND.1);
        let legend = DVec2::new(f64::from(LEGEND.0.x), f64::from(LEGEND.0.y)) * metres;
        Self {
            panels,
            legend: nowhere(LEGEND.0, legend),
            said: (None, 0),
            rings: [0, 1].map(|_| nowhere(Vec2::splat(RING), DVec2::ONE)),
            ring_senses: [None; 2],
            pointer: Pointer::default(),
            pointed: None,
            grips: [Switch::default(); 2],
            carried: [None; 2],
            shown: true,
            wrist: false,
            newest: None,
            frames: 0,
        }
    }

    /// What a panel has cost so far.
    pub(super) fn counts(&self, panel: Panel) -> Option<Counts> {
        self.panels.iter().find(|hung| hung.panel == panel).map(|hung| hung.board.counts())
    }

    /// Shows what was hidden, and the other way round; what panels that are put away still had to say.
    pub(super) fn turn_over(&mut self, panels: &mut Panels) -> Output {
        self.shown = !self.shown;
        let mut left = Output::default();
        if !self.shown {
            self.panels.iter().for_each(|hung| left.join(panels.put_away(hung.panel)));
        }
        left
    }

    /// Where a panel hangs, unless it is hidden.
    pub(super) fn place(&self, panel: Panel) -> Option<Rectangle> {
        let hidden = if panel == Panel::Wrist { !self.wrist } else { !self.shown };
        self.panels.iter().find(|hung| hung.panel == panel && !hidden).map(|hung| hung.board.place)
    }

    /// Which panels hang there now.
    fn visible(&self, panels: &Panels, shown: &Shown) -> Vec<usize> {
        let hangs = |panel: Panel| match panel {
            Panel::Wrist => self.wrist,
            Panel::Keyboard => self.shown && panels.is_typing(),
            panel => self.shown && panel.has_content(shown),
        };
        let all = self.panels.iter().enumerate().filter(|(_, hung)| hangs(hung.panel));
        all.map(|(k, _)| k).collect()
    }

    /// Takes in what hands point at and carry; what of them is the panels' now.
    pub(super) fn step(
        &mut self,
        (hands, head): (&[HandInput; 2], &Pose),
        panels: &Panels,
        tools: &Tools,
        shown: &Shown,
    ) -> Taken {
        self.turn_wrist(&hands[Acts::adds(tools).other().index()], head);
        let visible = self.visible(panels, shown);
        let rectangles: Vec<Rectangle> = visible.iter().map(|k| self.panels[*k].board.place).collect();
        self.pointed = self.pointer.step(&rectangles, hands);
        let mut taken = Taken::default();
        for side in Side::BOTH {
            let k = side.index();
            taken.triggers[k] = self.pointer.has(side, self.pointed.as_ref());
            let was = self.grips[k].is_on();
            let squeezed = self.grips[k].press(hands[k].squeeze);
            let Some(aim) = hands[k].aim.filter(|_| squeezed) else {
                self.carried[k] = None;
                continue;
            };
            if !was
                && let Some((at, ..)) = nearest(&rectangles, &aim)
                && let board = visible[at]
                && self.panels[board].panel != Panel::Wrist
            {
                let pose = self.panels[board].board.place.pose;
                let back = aim.orientation.inverse();
                let held =
                    Pose { position: back * (pose.position - aim.position), orientation: back * pose.orientation };
                self.carried[k] = Some((board, held));
            }
            if let Some((board, held)) = self.carried[k] {
                taken.grips[k] = true;
                let place = &mut self.panels[board].board.place;
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
        // What is pointed at is known by its place among all of them from here on.
        if let Some(pointed) = &mut self.pointed {
            pointed.rectangle = visible[pointed.rectangle];
        }
        taken
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
        let board = self.panels.iter_mut().find(|hung| hung.panel == Panel::Wrist);
        if let (Some(grip), Some(Hung { board, .. })) = (at, board) {
            let position = grip.position - DVec3::new(0.0, WRIST.1, 0.0);
            board.place.pose = Pose { position, orientation: facing(position, head.position) };
        }
    }

    /// Whose turn it is to be laid out anew because what it shows has changed, by its place among the panels, or behind them for
    /// the legend: of those that somebody sees the one that has waited longest. Laying out a panel takes longer than all else that
    /// a frame does beside the picture, and a scene that changes in every frame changes all of them.
    fn turn(&self, eyes: &[Eye; 2], visible: &[usize], legend: bool) -> Option<usize> {
        let sees = |place: &Rectangle| eyes.iter().any(|eye| eye.may_see(place));
        let panels = visible.iter().filter_map(|k| self.panels.get(*k).map(|hung| (*k, hung)));
        let panels = panels.filter(|(_, h)| h.stale && sees(&h.board.place)).map(|(k, hung)| (k, hung.since));
        let legend = (legend && sees(&self.legend.place)).then_some((self.panels.len(), self.said.1));
        panels.chain(legend).min_by_key(|(_, since)| *since).map(|(k, _)| k)
    }

    /// Draws and hangs everything; what was asked for on it.
    pub(super) fn show(
        &mut self,
        frame: &mut Frame<'_>,
        panels: &mut Panels,
        shown: &Shown,
        tools: &mut Tools,
        tips: [Option<SeenTip>; 2],
    ) -> Result<Output, XrError> {
        self.frames += 1;
        if self.newest.as_ref().is_none_or(|(s, t)| !same(s, shown) || t != tools) {
            self.panels.iter_mut().for_each(|hung| hung.stale = true);
            self.newest = Some((shown.clone(), tools.clone()));
        }
        let says = self.hang_legend(frame, tools, shown);
        let visible = self.visible(panels, shown);
        let news = says.is_some() && says != self.said.0;
        let turn = self.turn(&frame.eyes, &visible, news);
        let hands = frame.hands;
        let mut asked = Output::default();
        for k in visible {
            let pointed = self.pointed.filter(|p| p.rectangle == k);
            let Some(Hung { panel, board, stale, since }) = self.panels.get_mut(k) else { continue };
            let panel = *panel;
            let by = pointed.as_ref().map(|p| (p, &hands[p.side.index()]));
            // Who points at a panel waits for none; letters of the keyboard come up in another one.
            let changed = turn == Some(k) || (*stale && by.is_some()) || panels.wants_drawing(panel);
            let before = board.counts().laid_out;
            board.show(frame, by, Vec::new(), changed, |ui| {
                theme::apply(ui.ctx(), tools);
                asked.join(panels.show(panel, ui, shown, tools));
                if panel == Panel::Scene {
                    // What was not done is told on one panel alone.
                    let notices =
                        egui::Area::new(egui::Id::unique("notices")).anchor(Align2::CENTER_BOTTOM, [0.0, -16.0]);
                    notices.interactable(false).show(ui.ctx(), |ui| panels.notices(ui, shown));
                }
                mark(ui);
            })?;
            if board.counts().laid_out > before {
                (*stale, *since) = (false, self.frames);
            }
        }
        if let Some(says) = says {
            self.show_legend(frame, tools, says, turn == Some(self.panels.len()))?;
        }
        self.show_rings(frame, tips)?;
        Ok(asked)
    }

    /// Hangs the tool legend above the hand that does not brush, facing the eyes; what it says, where that hand is seen.
    fn hang_legend(&mut self, frame: &Frame<'_>, tools: &Tools, shown: &Shown) -> Option<Said> {
        let adds = Acts::adds(tools);
        let wrist = frame.hands[adds.other().index()].grip.filter(|_| self.shown)?;
        let position = wrist.position + DVec3::new(0.0, 0.2, 0.0);
        self.legend.place.pose = Pose { position, orientation: facing(position, frame.head.position) };
        let lines = [adds, adds.other()].map(|side| Acts::legend(side, tools, shown));
        Some((adds, lines, tools.light_panels, tools.scale))
    }

    /// Shows it as it was, or with what it says now.
    fn show_legend(&mut self, frame: &mut Frame<'_>, tools: &Tools, says: Said, anew: bool) -> Result<(), XrError> {
        let (adds, lines, ..) = &says;
        let before = self.legend.counts().laid_out;
        self.legend.show(frame, None, Vec::new(), anew, |ui| {
            theme::apply(ui.ctx(), tools);
            for (side, lines) in [*adds, adds.other()].iter().zip(lines) {
                ui.strong(if *side == Side::Left { "left hand" } else { "right hand" });
                let lines: Vec<(&str, &str)> = lines.iter().map(|(b, does)| (*b, does.as_str())).collect();
                ui.push_id(side.index(), |ui| legend(ui, &lines));
            }
        })?;
        if self.legend.counts().laid_out > before {
            self.said = (Some(says), self.frames);
        }
        Ok(())
    }

    /// A ring as large as the brush at each tip, facing the eyes.
    fn show_rings(&mut self, frame: &mut Frame<'_>, tips: [Option<SeenTip>; 2]) -> Result<(), XrError> {
        for (k, tip) in tips.iter().enumerate() {
            let Some(SeenTip { at, radius, sense }) = *tip else { continue };
            let changed = self.ring_senses[k].replace(sense) != Some(sense);
            let pose = Pose { position: at, orientation: facing(at, frame.head.position) };
            self.rings[k].place = Rectangle { pose, size: DVec2::splat(2.2 * radius.max(0.002)) };
            self.rings[k].show(frame, None, Vec::new(), changed, |ui| {
                let color = theme::color_of(sense);
                let middle = Pos2::new(0.5 * RING, 0.5 * RING);
                ui.painter().circle_stroke(middle, RING / 2.2, Stroke::new(3.0, color));
                ui.painter().circle_filled(middle, 2.0, color);
            })?;
        }
        Ok(())
    }
}

/// Turned so that what lies in it is upright and seen from `eye`.
pub(super) fn facing(at: DVec3, eye: DVec3) -> DQuat {
    let back = (eye - at).normalize_or(DVec3::Z);
    let right = DVec3::Y.cross(back).normalize_or(DVec3::X);
    DQuat::from_mat3(&glam::DMat3::from_cols(right, back.cross(right), back))
}

/// Where the ray of a hand meets a panel.
fn mark(ui: &Ui) {
    if let Some(at) = ui.input(|i| i.pointer.latest_pos()) {
        let painter = ui.ctx().debug_painter();
        painter.circle(at, 5.0, Color32::from_white_alpha(180), Stroke::new(1.5, Color32::BLACK));
    }
}

/// Whether nothing that panels show differs: everything in it is shared, and replaced where it changes.
fn same(a: &Shown, b: &Shown) -> bool {
    use std::sync::Arc;
    Arc::ptr_eq(&a.scene, &b.scene)
        && Arc::ptr_eq(&a.undo, &b.undo)
        && Arc::ptr_eq(&a.redo, &b.redo)
        && Arc::ptr_eq(&a.selected, &b.selected)
        && Arc::ptr_eq(&a.conversation, &b.conversation)
        && Arc::ptr_eq(&a.notices, &b.notices)
        && a.clusters.as_ref().map(Arc::as_ptr) == b.clusters.as_ref().map(Arc::as_ptr)
        && a.proposals.as_ref().map(Arc::as_ptr) == b.proposals.as_ref().map(Arc::as_ptr)
        && (a.offered, a.tentative, a.tried, a.walks) == (b.offered, b.tentative, b.tried, b.walks)
}
