//! Rays against panels.

use glam::{DQuat, DVec2, DVec3};
use proptest::prelude::*;
use sg_render_node::hands::{Pose, Rectangle, nearest};

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
