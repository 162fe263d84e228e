//! Eyes as cameras.

use glam::{DQuat, DVec2, DVec3};
use proptest::prelude::*;
use sg_scene::camera::{Camera, Light};
use sg_viewer::hands::{Eye, Fov, Placement, Pose, Rectangle};

use crate::NEAR;

fn pixel(camera: &Camera, p: DVec3) -> DVec2 {
    let p = camera.view().transform_point3(p);
    assert!(p.z > 0.0);
    DVec2::new(camera.fx * p.x / p.z + camera.cx, camera.fy * p.y / p.z + camera.cy)
}

#[test]
fn edges_of_the_field_of_view_are_edges_of_the_picture() {
    let fov = Fov { left: -0.9, right: 0.7, up: 0.8, down: -0.6 };
    let camera =
        Eye { pose: Pose::IDENTITY, fov }.camera([400, 300], &Placement::IDENTITY, NEAR, [0.0; 3], Light::default());
    let seen = |x: f64, y: f64| pixel(&camera, DVec3::new(x.tan(), y.tan(), -1.0));
    assert!(seen(fov.left, fov.up).length() < 1e-9, "top left");
    assert!((seen(fov.right, fov.down) - DVec2::new(400.0, 300.0)).length() < 1e-9, "bottom right");
    assert!(camera.check("eye").is_ok());
    let blind = Fov { left: 0.3, right: 0.3, ..fov };
    let camera =
        Eye { pose: Pose::IDENTITY, fov: blind }.camera([4, 4], &Placement::IDENTITY, NEAR, [0.0; 3], Light::default());
    assert!(camera.check("eye").is_err());
}

/// Whether a ray from the eye to one of many places of a rectangle is within the eye's view.
fn sees_a_place_of(eye: &Eye, rectangle: &Rectangle) -> bool {
    let places = (0..=8).flat_map(|x| (0..=8).map(move |y| DVec2::new(f64::from(x) / 8.0, f64::from(y) / 8.0)));
    places.map(|at| eye.pose.orientation.inverse() * (rectangle.point(at) - eye.pose.position)).any(|at| {
        let seen = eye.fov.in_picture(at.truncate() / -at.z);
        at.z < 0.0 && seen.cmpge(DVec2::ZERO).all() && seen.cmple(DVec2::ONE).all()
    })
}

#[test]
fn panels_behind_or_far_aside_are_not_visible() {
    let fov = Fov { left: -0.9, right: 0.7, up: 0.8, down: -0.6 };
    let eye = Eye { pose: Pose::IDENTITY, fov };
    let hung = |degrees: f64| {
        let orientation = DQuat::from_rotation_y(-degrees.to_radians());
        let pose = Pose { position: orientation * DVec3::new(0.0, 0.0, -1.1), orientation };
        Rectangle { pose, size: DVec2::new(0.4, 0.6) }
    };
    let seen: Vec<bool> = [-90.0, -55.0, 0.0, 45.0, 80.0, 180.0].map(|degrees| eye.may_see(&hung(degrees))).into();
    assert_eq!(seen, [false, true, true, true, false, false]);
}

proptest! {
    #[test]
    fn the_visible_part_of_a_rectangle_is_not_masked(
        turn in proptest::array::uniform4(-1.0..1.0_f64), at in proptest::array::uniform3(-2.0..2.0_f64),
        size in proptest::array::uniform2(0.01..4.0_f64), head in proptest::array::uniform4(-1.0..1.0_f64),
    ) {
        prop_assume!(DQuat::from_array(turn).length() > 0.1 && DQuat::from_array(head).length() > 0.1);
        let pose = |at, turn| Pose { position: at, orientation: DQuat::from_array(turn).normalize() };
        let eye = Eye { pose: pose(DVec3::ZERO, head), fov: Fov { left: -0.8, right: 0.9, up: 0.7, down: -0.75 } };
        let rectangle = Rectangle { pose: pose(DVec3::from_array(at), turn), size: DVec2::from_array(size) };
        prop_assert!(eye.may_see(&rectangle) || !sees_a_place_of(&eye, &rectangle));
    }

    #[test]
    fn a_scene_point_projects_to_its_place_in_the_room(
        scale in 1e-3..1e3_f64, turn in proptest::array::uniform4(-1.0..1.0_f64), head in proptest::array::uniform4(-1.0..1.0_f64),
        at in proptest::array::uniform3(-3.0..3.0_f64), eye in proptest::array::uniform3(-3.0..3.0_f64),
        offset in proptest::array::uniform3(-0.5..0.5_f64),
    ) {
        prop_assume!(DQuat::from_array(turn).length() > 0.1 && DQuat::from_array(head).length() > 0.1);
        let placement = Placement {
            scale, rotation: DQuat::from_array(turn).normalize(), translation: DVec3::from_array(at),
        };
        let pose = Pose { position: DVec3::from_array(eye), orientation: DQuat::from_array(head).normalize() };
        let fov = Fov { left: -0.8, right: 0.9, up: 0.7, down: -0.75 };
        let camera = Eye { pose, fov }.camera([640, 480], &placement, NEAR, [0.0; 3], Light::default());
        prop_assert!(camera.check("eye").is_ok());
        let local = DVec3::from_array(offset) + DVec3::new(0.0, 0.0, -1.5);
        let seen = pixel(&camera, placement.to_scene(pose.to_room(local)));
        let x = (local.x / -local.z - fov.left.tan()) / (fov.right.tan() - fov.left.tan()) * 640.0;
        let y = (fov.up.tan() - local.y / -local.z) / (fov.up.tan() - fov.down.tan()) * 480.0;
        prop_assert!((seen - DVec2::new(x, y)).length() < 1e-6);
        // A metre of the room is 1/scale units of the scene.
        let depth = camera.view().transform_point3(placement.to_scene(pose.to_room(local))).z;
        prop_assert!((depth * scale - -local.z).abs() < 1e-9 * (1.0 + 1.0 / scale));
        prop_assert!((camera.near * scale - NEAR).abs() < 1e-12, "{} of the scene", camera.near);
    }
}
