//! Hands without controllers: made joints, and their interpretation.

use glam::DVec3;
use sg_viewer::hands::{BareHand, HandInput, JOINTS, Joints, Pose};

/// Places among the joints.
const PALM: usize = 0;
const WRIST: usize = 1;
const THUMB_TIP: usize = 5;
const INDEX_TIP: usize = 10;

/// A right hand at the origin, palm down, fingers along −z. Each joint is bent by this share of a right angle.
fn hand(bend: f64, apart: f64) -> Joints {
    let mut joints: Joints = [None; JOINTS];
    let mut put = |k: usize, position: DVec3| joints[k] = Some(Pose { position, ..Pose::IDENTITY });
    put(PALM, DVec3::new(0.0, 0.0, -0.05));
    put(WRIST, DVec3::ZERO);
    for (finger, x) in [(6, -0.03), (11, -0.01), (16, 0.01), (21, 0.03)] {
        put(finger, DVec3::new(x, 0.0, -0.03));
        let mut at = DVec3::new(x, 0.0, -0.09);
        let mut angle = 0.0_f64;
        for k in 0..4 {
            put(finger + 1 + k, at);
            angle += if finger == 6 { 0.3 } else { bend } * std::f64::consts::FRAC_PI_2;
            at += 0.03 * DVec3::new(0.0, -angle.sin(), -angle.cos());
        }
    }
    for k in 2..=5 {
        put(k, DVec3::new(-0.04, -0.02, -0.03 - 0.02 * k as f64));
    }
    let tip = joints[INDEX_TIP].map_or(DVec3::ZERO, |t| t.position);
    joints[THUMB_TIP] = Some(Pose { position: tip + apart * DVec3::NEG_Y, ..Pose::IDENTITY });
    joints
}

#[test]
fn an_open_hand_does_nothing_and_points_ahead() {
    let mut bare = BareHand::default();
    let read = bare.read(Some(&hand(0.0, 0.08)));
    assert_eq!((read.trigger, read.squeeze, read.click), (0.0, 0.0, false));
    let aim = read.aim.unwrap_or(Pose::IDENTITY);
    // From the wrist to a knuckle 3 cm to its left and 9 cm ahead, level.
    assert!(aim.forward().distance(DVec3::new(-0.03, 0.0, -0.09).normalize()) < 1e-9, "{aim:?}");
    assert!((aim.orientation * DVec3::Y).distance(DVec3::Y) < 1e-9);
    assert!(read.grip.is_some_and(|g| g.position == DVec3::new(0.0, 0.0, -0.05)));
}

#[test]
fn a_pinch_is_a_pulled_trigger_that_does_not_flicker() {
    let mut bare = BareHand::default();
    let mut at = |apart: f64| bare.read(Some(&hand(0.1, apart)));
    assert!(!at(0.03).click);
    let touching = at(0.010);
    assert!(touching.click && touching.trigger > 0.99 && touching.squeeze == 0.0, "{touching:?}");
    assert!(at(0.027).click, "as far apart as before the pinch began, it still holds");
    let apart = at(0.035);
    assert!(!apart.click && apart.trigger < 0.4);
    assert!(!at(0.027).click);
    // The aim stays while the fingers close.
    assert_eq!(at(0.010).aim, at(0.08).aim);
}

#[test]
fn a_fist_holds_and_presses_nothing() {
    let mut bare = BareHand::default();
    let closed = bare.read(Some(&hand(0.95, 0.010)));
    assert!(closed.squeeze > 0.9 && closed.trigger == 0.0 && !closed.click, "{closed:?}");
    let open = bare.read(Some(&hand(0.0, 0.08)));
    assert_eq!((open.squeeze, open.trigger), (0.0, 0.0));
    // A pinch that is there stays one while the other fingers close.
    assert!(bare.read(Some(&hand(0.0, 0.010))).click);
    let both = bare.read(Some(&hand(0.95, 0.010)));
    assert!(both.click && both.squeeze == 0.0, "{both:?}");
    // Let go, it is the fist that it looks like.
    let fist = bare.read(Some(&hand(0.95, 0.08)));
    assert!(!fist.click && bare.read(Some(&hand(0.95, 0.08))).squeeze > 0.9);
}

#[test]
fn a_hand_that_is_lost_lets_go() {
    let mut bare = BareHand::default();
    assert!(bare.read(Some(&hand(0.0, 0.010))).click);
    assert_eq!(bare.read(None), HandInput::default());
    // Between touching and apart nothing is on that was not before.
    assert!(!bare.read(Some(&hand(0.0, 0.027))).click);
    // Joints that are not seen are no fingers.
    let mut part = hand(0.95, 0.010);
    (part[THUMB_TIP], part[14], part[WRIST]) = (None, None, None);
    let read = bare.read(Some(&part));
    assert_eq!((read.trigger, read.squeeze, read.aim), (0.0, 0.0, None));
    let mut nowhere = hand(0.0, 0.01);
    nowhere.iter_mut().for_each(|j| *j = Some(Pose::IDENTITY));
    let read = bare.read(Some(&nowhere));
    assert!(read.squeeze == 0.0 && read.aim.is_none(), "{read:?}");
}
