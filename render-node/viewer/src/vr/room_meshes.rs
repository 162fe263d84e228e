//! All that is drawn in the room beside the scene and the panels: the floor, hands, lasers, brushes, arcs, and holes in the
//! picture for panels behind it.

use std::f64::consts::TAU;

use glam::{DQuat, DVec3};
use sg_gpu::{MOST_MESHES, MeshLook, PlacedMesh};

use super::hand_meshes::{bare_hand, controller};
use super::interaction::BrushMarker;
use super::meshes::Paint;
use crate::display::BrushSign;
use crate::hands::locomotion::Arc;
use crate::hands::{HandInput, Joints, Pose, Rectangle, Side};
use crate::panels::theme;

/// Metres from a person to the end of the floor.
const FLOOR: f64 = 100.0;

/// Opacity of the floor's strongest lines.
const FLOOR_OPACITY: f32 = 0.5;

/// Radius of a laser, and its length where it meets nothing, metres.
const LASER: (f64, f64) = (0.0012, 0.3);

/// Radius of the place that a person jumps to, metres.
const LANDING: f64 = 0.25;

/// Rods of its ring.
const RING: u32 = 20;

/// White.
const WHITE: [f32; 3] = [1.0; 3];

/// The nearest thing that a hand's ray meets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Met {
    Nothing,
    /// A panel, at this place of the room.
    Panel(DVec3),
    /// The scene.
    Scene(DVec3),
}

/// A panel that hangs behind the picture, and shows through a hole in it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Hole {
    pub(super) place: Rectangle,
    /// Radius of its corners, metres.
    pub(super) corner: f64,
    /// Half the depth in metres around the scene's front over which it fades.
    pub(super) softness: f64,
    /// Least share that is seen through the scene.
    pub(super) ghost: f32,
}

/// One hand as it is seen.
#[derive(Debug, Clone, Copy)]
pub(super) struct SeenHand<'a> {
    pub(super) side: Side,
    pub(super) input: &'a HandInput,
    /// Its joints, for a hand without a controller.
    pub(super) joints: Option<&'a Joints>,
    pub(super) sign: BrushSign,
    pub(super) brush: Option<BrushMarker>,
    /// What its laser meets; `None` without a laser.
    pub(super) laser: Option<Met>,
}

/// A floor to draw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Floor {
    /// Height in the room, metres.
    pub(super) height: f64,
    /// Whether the background is dark.
    pub(super) is_on_dark: bool,
}

/// All of a frame.
pub(super) struct Room<'a> {
    pub(super) hands: [SeenHand<'a>; 2],
    pub(super) head: DVec3,
    pub(super) floor: Option<Floor>,
    pub(super) arc: Option<&'a Arc>,
    pub(super) holes: &'a [Hole],
    /// Lines from labels to the controls that they are about.
    pub(super) leaders: &'a [[DVec3; 2]],
}

/// Colour of a sign's brush.
fn color_of(sign: BrushSign) -> [f32; 3] {
    let [r, g, b, _] = theme::color_of(sign).to_array();
    [r, g, b].map(|byte| f32::from(byte) / 255.0)
}

impl Room<'_> {
    /// The meshes of a frame in the order of their drawing, at most [`MOST_MESHES`].
    pub(super) fn meshes(&self) -> Vec<PlacedMesh> {
        let mut all: Vec<PlacedMesh> = self.floor.iter().map(|floor| floor.mesh(self.head)).collect();
        let mut clear: Vec<PlacedMesh> = Vec::new();
        for hand in &self.hands {
            all.extend(hand.solids());
            clear.extend(hand.clear());
        }
        // Balls before rods: one draw for each.
        all.sort_by_key(|mesh| (mesh.look != MeshLook::Floor, mesh.mesh));
        for hole in self.holes {
            let Hole { place, corner, softness, ghost } = *hole;
            let paint = Paint { look: MeshLook::Hole, color: [0.0; 4], softness, ghost };
            all.push(paint.rectangle(&place, corner));
        }
        let leaders = self.leaders.iter().map(|[from, to]| Paint::beam(WHITE, 0.8).rod(*from, *to, 0.0006));
        clear.extend(leaders);
        clear.extend(self.arc.into_iter().flat_map(arc_meshes));
        clear.sort_by_key(|mesh| (mesh.look == MeshLook::Ball, mesh.mesh));
        all.extend(clear);
        all.truncate(MOST_MESHES);
        all
    }
}

impl Floor {
    /// The floor around a head. Its lines stay where they are in the room.
    fn mesh(self, head: DVec3) -> PlacedMesh {
        let [r, g, b] = if self.is_on_dark { [0.62, 0.66, 0.72] } else { [0.28, 0.31, 0.36] };
        let paint = Paint { look: MeshLook::Floor, color: [r, g, b, FLOOR_OPACITY], softness: 0.01, ghost: 0.0 };
        let position = DVec3::new(head.x.round(), self.height, head.z.round());
        let pose = Pose { position, orientation: DQuat::from_rotation_x(-0.25 * TAU) };
        paint.rectangle(&Rectangle { pose, size: glam::DVec2::splat(2.0 * FLOOR) }, 0.0)
    }
}

impl SeenHand<'_> {
    /// The hand, and the point that its laser meets.
    fn solids(&self) -> Vec<PlacedMesh> {
        let accent = color_of(self.sign);
        let mut meshes = match (self.joints, self.input.grip) {
            (Some(joints), _) => bare_hand(joints, accent),
            (None, Some(grip)) => controller(&grip, self.side, self.input, accent),
            (None, None) => Vec::new(),
        };
        if let (Some(aim), Some(Met::Panel(at) | Met::Scene(at))) = (self.input.aim, self.laser) {
            // As large before the eyes at any distance.
            let radius = 0.003 + 0.004 * at.distance(aim.position);
            let dot = Paint { softness: 2.0 * radius, ghost: 0.6, ..Paint::solid([0.94, 0.89, 0.26]) };
            meshes.push(dot.ball(at - 0.5 * radius * aim.forward(), DQuat::IDENTITY, DVec3::splat(radius)));
        }
        meshes
    }

    /// The laser and the brush.
    fn clear(&self) -> Vec<PlacedMesh> {
        let accent = color_of(self.sign);
        let mut meshes = Vec::new();
        if let (Some(aim), Some(met)) = (self.input.aim, self.laser) {
            let (to, opacity) = match met {
                Met::Nothing => (aim.position + LASER.1 * aim.forward(), 0.3),
                Met::Panel(at) => (at, 0.85),
                Met::Scene(at) => (at, 0.5),
            };
            let color = if matches!(met, Met::Panel(_)) { WHITE } else { accent };
            meshes.push(Paint::beam(color, opacity).rod(aim.position, to, LASER.0));
        }
        let Some(BrushMarker { at, radius, .. }) = self.brush else { return meshes };
        let turn = self.input.aim.or(self.input.grip).map_or(DQuat::IDENTITY, |pose| pose.orientation);
        if let Some(aim) = self.input.aim {
            meshes.push(Paint::beam(accent, 0.9).rod(aim.position, at, 0.0018));
        }
        // A plus or a minus in the middle tells the signs apart without colour.
        let half = (0.4 * radius).clamp(0.002, 0.008);
        let bars: &[DVec3] = match self.sign {
            BrushSign::Add => &[DVec3::X, DVec3::Y],
            BrushSign::Remove => &[DVec3::X],
        };
        let bar = |way: &DVec3| {
            let way = half * (turn * *way);
            Paint { ghost: 0.5, ..Paint::beam(WHITE, 0.95) }.rod(at - way, at + way, 0.2 * half)
        };
        meshes.extend(bars.iter().map(bar));
        let [r, g, b] = accent;
        let shell =
            Paint { look: MeshLook::Ball, color: [r, g, b, 1.0], softness: (0.08 * radius).max(1e-4), ghost: 0.3 };
        meshes.push(shell.ball(at, turn, DVec3::splat(radius.max(0.001))));
        meshes
    }
}

/// The arc of a jump and its landing place. An arc without a landing place is dashed.
fn arc_meshes(arc: &Arc) -> Vec<PlacedMesh> {
    let lands = arc.landing.is_some();
    let color = if lands { color_of(BrushSign::Add) } else { color_of(BrushSign::Remove) };
    let paint = Paint { ghost: 0.4, ..Paint::beam(color, 0.9) };
    let pieces = arc.points.array_windows::<2>().enumerate();
    let mut meshes: Vec<PlacedMesh> =
        pieces.filter(|(k, _)| lands || k % 2 == 0).map(|(_, [from, to])| paint.rod(*from, *to, 0.004)).collect();
    let Some(landing) = arc.landing else { return meshes };
    let around = |k: u32| {
        let turn = TAU * f64::from(k) / f64::from(RING);
        landing + LANDING * DVec3::new(turn.cos(), 0.0, turn.sin()) + 0.01 * DVec3::Y
    };
    meshes.extend((0..RING).map(|k| paint.rod(around(k), around(k + 1), 0.008)));
    meshes.push(paint.rod(landing, landing + 0.15 * DVec3::Y, 0.004));
    meshes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hands::locomotion::arc;
    use glam::DVec2;

    fn hand(side: Side, input: &HandInput) -> SeenHand<'_> {
        let (sign, at) = (BrushSign::Add, DVec3::new(0.1, 1.2, -0.6));
        let brush = Some(BrushMarker { at, radius: 0.05, sign });
        SeenHand { side, input, joints: None, sign, brush, laser: Some(Met::Scene(DVec3::new(0.1, 1.2, -1.2))) }
    }

    #[test]
    fn meshes_come_in_the_order_that_hiding_needs() {
        let pose = Pose { position: DVec3::new(0.1, 1.2, -0.5), orientation: DQuat::IDENTITY };
        let input = HandInput { grip: Some(pose), aim: Some(pose), ..HandInput::default() };
        let thrown = arc(&pose, DVec3::new(0.0, 1.6, 0.0), 0.0);
        let place = Rectangle { pose, size: DVec2::splat(0.3) };
        let holes = [Hole { place, corner: 0.0, softness: 0.01, ghost: 0.3 }];
        let room = Room {
            hands: [hand(Side::Left, &input), hand(Side::Right, &input)],
            head: DVec3::new(0.4, 1.6, -0.6),
            floor: Some(Floor { height: 0.0, is_on_dark: true }),
            arc: Some(&thrown),
            holes: &holes,
            leaders: &[[DVec3::ZERO, DVec3::ONE]],
        };
        let meshes = room.meshes();
        assert!(meshes.len() <= MOST_MESHES && meshes.iter().all(|mesh| mesh.to_room.is_finite()));
        let rank = |look| match look {
            MeshLook::Floor => 0,
            MeshLook::Solid => 1,
            MeshLook::Hole => 2,
            MeshLook::Beam => 3,
            MeshLook::Ball => 4,
        };
        assert!(meshes.is_sorted_by_key(|mesh| rank(mesh.look)), "one group after the other");
        for (look, count) in [(MeshLook::Floor, 1), (MeshLook::Hole, 1), (MeshLook::Ball, 2)] {
            assert_eq!(meshes.iter().filter(|mesh| mesh.look == look).count(), count, "{look:?}");
        }
        // Few draws: successive meshes of one shape and look are one.
        let draws = 1 + meshes.array_windows::<2>().filter(|[a, b]| (a.mesh, a.look) != (b.mesh, b.look)).count();
        assert!(draws <= 6, "{draws}");
        // The floor follows the person by whole lines.
        let middle = meshes[0].to_room.transform_point3(DVec3::ZERO);
        assert!(middle.distance(DVec3::new(0.0, 0.0, -1.0)) < 1e-12);
    }

    #[test]
    fn an_arc_without_a_landing_place_is_dashed_and_has_no_ring() {
        let level = Pose { position: DVec3::new(0.0, 1.2, 0.0), orientation: DQuat::IDENTITY };
        let lands = arc(&level, DVec3::ZERO, 0.0);
        let misses = arc(&level, DVec3::new(50.0, 0.0, 0.0), 0.0);
        assert!(lands.landing.is_some() && misses.landing.is_none());
        let pieces = lands.points.len() - 1;
        assert_eq!(arc_meshes(&lands).len(), pieces + RING as usize + 1);
        assert_eq!(arc_meshes(&misses).len(), pieces.div_ceil(2));
    }

    #[test]
    fn a_hand_that_is_lost_draws_nothing() {
        let input = HandInput::default();
        let lost = SeenHand { brush: None, laser: None, ..hand(Side::Left, &input) };
        assert!(lost.solids().is_empty() && lost.clear().is_empty());
    }
}
