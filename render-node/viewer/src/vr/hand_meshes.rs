//! A person's hands as they are seen: plain controllers, and bare hands of balls and bones.

use glam::{DQuat, DVec3};
use sg_gpu::PlacedMesh;

use super::meshes::Paint;
use crate::hands::{HandInput, JOINTS, Joints, Pose, Side};

/// Colours of a controller's body, of its controls, and of a pressed control.
const BODY: [f32; 3] = [0.36, 0.38, 0.42];
const CONTROL: [f32; 3] = [0.16, 0.17, 0.19];
const PRESSED: [f32; 3] = [0.94, 0.89, 0.26];

/// Colour of a bare hand.
const SKIN: [f32; 3] = [0.72, 0.72, 0.74];

/// Direction that the face with stick and buttons looks in, in the axes of the grip: thumb end and back. Not of unit length.
const FACE: DVec3 = DVec3::new(0.0, 0.75, -0.66);

/// Middle of the controller's head, in the axes of the grip, metres.
const HEAD: DVec3 = DVec3::new(0.0, 0.006, -0.046);

/// A control of a controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Control {
    Trigger,
    Grip,
    Stick,
    Primary,
    Secondary,
    Menu,
}

impl Control {
    const ALL: [Self; 6] = [Self::Trigger, Self::Grip, Self::Stick, Self::Primary, Self::Secondary, Self::Menu];

    /// The control that a line of the legend is about; `None` for a gesture.
    pub(super) fn named(name: &str) -> Option<Self> {
        match name {
            "trigger" => Some(Self::Trigger),
            "grip" => Some(Self::Grip),
            "A" | "X" => Some(Self::Primary),
            "B" | "Y" | "B, menu" | "Y, menu" => Some(Self::Secondary),
            _ if name.starts_with("stick") => Some(Self::Stick),
            _ => None,
        }
    }

    /// Its middle in the axes of the grip, metres. The left controller mirrors the right one.
    pub(super) fn place(self, side: Side) -> DVec3 {
        let face = FACE.normalize();
        let across = |x: f64, along: f64| HEAD + 0.017 * face + DVec3::new(x, along * 0.66, along * 0.75);
        let right = match self {
            Self::Trigger => DVec3::new(0.0, -0.019, -0.040),
            Self::Grip => DVec3::new(-0.015, -0.006, 0.004),
            Self::Stick => across(-0.009, -0.003),
            Self::Primary => across(0.010, 0.006),
            Self::Secondary => across(0.012, -0.008),
            Self::Menu => across(-0.006, 0.014),
        };
        if side == Side::Left { DVec3::new(-right.x, right.y, right.z) } else { right }
    }

    /// Half axes of its ball, metres.
    fn axes(self) -> DVec3 {
        match self {
            Self::Trigger => DVec3::new(0.006, 0.009, 0.011),
            Self::Grip => DVec3::new(0.004, 0.007, 0.013),
            Self::Stick => DVec3::new(0.0065, 0.0065, 0.006),
            Self::Primary | Self::Secondary => DVec3::new(0.0045, 0.0045, 0.0025),
            Self::Menu => DVec3::new(0.003, 0.003, 0.002),
        }
    }

    /// Whether it is used now.
    fn is_used(self, hand: &HandInput) -> bool {
        match self {
            Self::Trigger => hand.trigger > 0.1,
            Self::Grip => hand.squeeze > 0.1,
            Self::Stick => hand.stick_click || hand.stick.length() > 0.15,
            Self::Primary => hand.primary,
            Self::Secondary => hand.secondary,
            Self::Menu => hand.menu,
        }
    }
}

/// A controller at a grip pose. `accent` is the colour of the hand's brush.
pub(super) fn controller(grip: &Pose, side: Side, hand: &HandInput, accent: [f32; 3]) -> Vec<PlacedMesh> {
    let turn = grip.orientation;
    let (top, end) = (DVec3::new(0.0, 0.0, -0.036), DVec3::new(0.0, 0.0, 0.052));
    let body = Paint::solid(BODY);
    let facing = turn * DQuat::from_rotation_arc(DVec3::Z, FACE.normalize());
    let mut meshes = vec![
        body.ball(grip.to_room(top), turn, DVec3::splat(0.0155)),
        Paint::solid(accent).ball(grip.to_room(end), turn, DVec3::splat(0.0158)),
        body.ball(grip.to_room(HEAD), facing, DVec3::new(0.025, 0.023, 0.017)),
    ];
    for control in Control::ALL {
        let color = match control {
            _ if control.is_used(hand) => PRESSED,
            Control::Trigger => accent,
            _ => CONTROL,
        };
        let upright = matches!(control, Control::Trigger | Control::Grip);
        let turn = if upright { turn } else { facing };
        meshes.push(Paint::solid(color).ball(grip.to_room(control.place(side)), turn, control.axes()));
    }
    meshes.push(body.rod(grip.to_room(top), grip.to_room(end), 0.0155));
    meshes
}

/// Radius of a joint's ball, metres, by its place in the order of the joints.
fn radius(joint: usize) -> f64 {
    match joint {
        0 => 0.0,
        1 => 0.017,
        5 | 10 | 15 | 20 | 25 => 0.0068,
        4 | 9 | 14 | 19 | 24 => 0.0076,
        2 | 6 | 11 | 16 | 21 => 0.0115,
        _ => 0.009,
    }
}

/// Bones of a hand as pairs of joints: along the fingers, from the wrist, and across the knuckles.
fn bones() -> impl Iterator<Item = (usize, usize)> {
    let fingers = [2, 6, 11, 16, 21];
    let along = fingers.into_iter().flat_map(|first| {
        let last = if first == 2 { first + 3 } else { first + 4 };
        (first..last).map(|k| (k, k + 1))
    });
    let from_wrist = fingers.into_iter().map(|first| (1, first));
    along.chain(from_wrist).chain([(7, 12), (12, 17), (17, 22)])
}

/// A bare hand. Joints that are not seen are left out with their bones. The index finger's tip has the colour of the hand's
/// brush.
pub(super) fn bare_hand(joints: &Joints, accent: [f32; 3]) -> Vec<PlacedMesh> {
    let place = |k: usize| joints.get(k).copied().flatten();
    let balls = (1..JOINTS).filter_map(|k| {
        let pose = place(k)?;
        let color = if k == 10 { accent } else { SKIN };
        Some(Paint::solid(color).ball(pose.position, pose.orientation, DVec3::splat(radius(k))))
    });
    let rods = bones().filter_map(|(a, b)| {
        let thickness = radius(a).min(radius(b));
        Some(Paint::solid(SKIN).rod(place(a)?.position, place(b)?.position, thickness))
    });
    balls.chain(rods).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_line_about_a_control_has_its_place_and_hands_are_mirrored() {
        for (name, control) in [
            ("trigger", Some(Control::Trigger)),
            ("stick pressed", Some(Control::Stick)),
            ("X", Some(Control::Primary)),
            ("Y, menu", Some(Control::Secondary)),
            ("palm to the eyes", None),
        ] {
            assert_eq!(Control::named(name), control, "{name}");
        }
        for control in Control::ALL {
            let [left, right] = Side::BOTH.map(|side| control.place(side));
            assert_eq!(left * DVec3::new(-1.0, 1.0, 1.0), right);
            assert!(right.length() < 0.08, "{control:?} is within a hand: {right}");
        }
    }

    #[test]
    fn a_pressed_control_stands_out_and_a_controller_follows_its_grip() {
        let grip = Pose { position: DVec3::new(0.2, 1.1, -0.4), orientation: DQuat::from_rotation_y(1.0) };
        let accent = [0.0, 0.62, 0.45];
        let rest = controller(&grip, Side::Right, &HandInput::default(), accent);
        let pulled = HandInput { trigger: 1.0, ..HandInput::default() };
        let pressed = controller(&grip, Side::Right, &pulled, accent);
        assert_eq!(rest.iter().zip(&pressed).filter(|(a, b)| a != b).count(), 1);
        for mesh in &rest {
            let middle = mesh.to_room.transform_point3(DVec3::ZERO);
            assert!(mesh.to_room.is_finite() && middle.distance(grip.position) < 0.1);
        }
    }

    #[test]
    fn a_hand_draws_the_joints_that_are_seen() {
        let joint = |k: usize| {
            Some(Pose { position: DVec3::new(0.01 * k as f64, 1.0, 0.002 * (k * k) as f64), ..Pose::IDENTITY })
        };
        let mut joints: Joints = std::array::from_fn(joint);
        let all = bare_hand(&joints, [0.0; 3]);
        assert_eq!(all.len(), 25 + 19 + 5 + 3);
        assert!(all.iter().all(|mesh| mesh.to_room.is_finite()));
        joints[10] = None;
        assert_eq!(bare_hand(&joints, [0.0; 3]).len(), all.len() - 2);
        assert!(bare_hand(&[None; JOINTS], [0.0; 3]).is_empty());
        assert!(bones().all(|(a, b)| a < JOINTS && b < JOINTS));
    }
}
