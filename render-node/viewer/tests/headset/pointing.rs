//! Rays against panels.

use glam::{DQuat, DVec2, DVec3};
use proptest::prelude::*;
use sg_viewer::hands::{HandInput, Pointer, Pose, Rectangle, Side, nearest};

proptest! {
    #[test]
    fn a_hand_that_points_at_a_point_hits_it(
        at in proptest::array::uniform2(0.0..1.0_f64), from in proptest::array::uniform3(-2.0..2.0_f64),
        turn in proptest::array::uniform3(-1.5..1.5_f64),
    ) {
        let pose = Pose { position: DVec3::new(0.3, 1.5, -1.2), orientation: DQuat::from_scaled_axis(DVec3::from_array(turn)) };
        let panel = Rectangle { pose, size: DVec2::new(0.6, 0.45) };
        let (at, from) = (DVec2::from_array(at), DVec3::from_array(from));
        let target = panel.point(at);
        let side = (pose.orientation.inverse() * (from - pose.position)).z;
        prop_assume!(side.abs() > 0.01);
        let orientation = DQuat::from_rotation_arc(DVec3::NEG_Z, (target - from).normalize());
        let hit = panel.hit(&Pose { position: from, orientation });
        match hit {
            Some((found, distance)) => {
                prop_assert!(side > 0.0);
                prop_assert!((found - at).length() < 1e-6, "{found}, not {at}");
                prop_assert!((distance - from.distance(target)).abs() < 1e-9);
            }
            // Rounding at the very edge, or the back.
            None => prop_assert!(side < 0.0 || at.min_element() < 1e-9 || at.max_element() > 1.0 - 1e-9),
        }
    }
}

#[test]
fn the_nearer_of_two_is_pointed_at() {
    let at = |z: f64| Rectangle {
        pose: Pose { position: DVec3::new(0.0, 0.0, z), orientation: DQuat::IDENTITY },
        size: DVec2::ONE,
    };
    let (which, where_on_it, distance) = nearest(&[at(-3.0), at(-1.0), at(2.0)], &Pose::IDENTITY).unwrap();
    assert_eq!((which, where_on_it, distance), (1, DVec2::splat(0.5), 1.0));
    let away = Pose { orientation: DQuat::from_rotation_y(2.0), ..Pose::IDENTITY };
    assert!(nearest(&[at(-3.0)], &away).is_none());
}

#[test]
fn the_pointer_follows_the_pressing_hand_and_stays_with_its_control() {
    let panel = |x: f64| Rectangle {
        pose: Pose { position: DVec3::new(x, 0.0, -1.0), orientation: DQuat::IDENTITY },
        size: DVec2::ONE,
    };
    let panels = [panel(-2.0), panel(2.0)];
    let hand = |x: f64, trigger: f64| HandInput {
        aim: Some(Pose { position: DVec3::new(x, 0.0, 0.0), orientation: DQuat::IDENTITY }),
        trigger,
        ..HandInput::default()
    };
    let mut pointer = Pointer::default();
    let mut step = |left: HandInput, right: HandInput| {
        let pointed = pointer.step(&panels, &[left, right]);
        pointed.map(|p| (p.side, p.rectangle, p.at.x, p.pressed))
    };
    // Both hands hover: the right one has it, until the left one presses.
    assert_eq!(step(hand(-2.0, 0.0), hand(2.0, 0.0)), Some((Side::Right, 1, 0.5, false)));
    assert_eq!(step(hand(-2.0, 1.0), hand(2.0, 0.0)), Some((Side::Left, 0, 0.5, true)));
    // Dragged over the edge, and onto the other panel: still the first one's.
    assert_eq!(step(hand(2.0, 1.0), hand(2.0, 0.0)), Some((Side::Left, 0, 4.5, true)));
    // The other hand's trigger presses nothing meanwhile, nor afterwards while it is held.
    assert_eq!(step(hand(2.0, 1.0), hand(2.0, 1.0)), Some((Side::Left, 0, 4.5, true)));
    assert_eq!(step(hand(2.0, 0.0), hand(2.0, 1.0)), Some((Side::Left, 0, 4.5, false)), "let go");
    assert_eq!(step(hand(0.0, 0.0), hand(2.0, 1.0)), None);
    assert_eq!(step(hand(0.0, 0.0), hand(2.0, 0.0)), Some((Side::Right, 1, 0.5, false)));
    // A brush that is drawn across a panel does not press it.
    assert_eq!(step(hand(0.0, 0.0), hand(0.0, 1.0)), None);
    assert_eq!(step(hand(0.0, 0.0), hand(2.0, 1.0)), None);
    // A hand that is lost lets go.
    assert_eq!(step(hand(0.0, 0.0), hand(2.0, 0.0)).map(|p| p.3), Some(false));
    assert_eq!(step(hand(0.0, 0.0), hand(2.0, 1.0)).map(|p| p.3), Some(true));
    assert_eq!(step(hand(0.0, 0.0), HandInput { aim: None, ..hand(2.0, 1.0) }), None);
    assert_eq!(step(hand(0.0, 0.0), hand(2.0, 1.0)), None, "what was pressed is not taken up again");
}
