use glam::DVec2;
use proptest::prelude::*;

use super::*;
use crate::synthetic::test_scene;

fn path_of(poses: Vec<[DVec3; 2]>) -> CameraPath {
    CameraPath { up: DVec3::Z, near: Some(0.5), fov_y_degrees: 40.0, poses }
}

fn pose(eye: [f64; 3], target: [f64; 3]) -> [DVec3; 2] {
    [DVec3::from_array(eye), DVec3::from_array(target)]
}

fn forward(camera: &Camera) -> DVec3 {
    camera.view().inverse().transform_vector3(DVec3::Z)
}

#[test]
fn a_file_is_parsed_and_a_wrong_line_is_named() {
    let text = "# a way\nup 0 -1 0\nnear 0.2\n\nfov 80\npose 0 0 -3  0 0 0\n  pose 1 0 -2 0 0 0\n";
    let path = CameraPath::parse(text, "a.txt").unwrap();
    assert_eq!((path.up, path.near, path.fov_y_degrees), (DVec3::NEG_Y, Some(0.2), 80.0));
    assert_eq!(path.poses, [pose([0.0, 0.0, -3.0], [0.0; 3]), pose([1.0, 0.0, -2.0], [0.0; 3])]);
    for (text, want) in [
        ("pose 0 0 1 0 0", "a.txt, line 1: it is no `up X Y Z`"),
        ("pose 0 0 1 0 0 NaN", "line 1"),
        ("up 0 0 1\nnear -1\npose 0 1 0 0 0 0", "line 2"),
        ("up 0 0 1\npose 1 1 1 1 1 1", "line 2: the eye and its target coincide"),
        ("pose 0 1 0 0 0 0\nfov 200", "line 1: the vertical field of view is 200"),
        ("pose 0 0 1 0 0 0", "line 1: the up direction is zero or along"),
        ("up 0 0 1\n", "no line `pose X Y Z X Y Z`"),
        ("jump 1", "line 1"),
    ] {
        let error = CameraPath::parse(text, "a.txt").unwrap_err().to_string();
        assert!(error.contains(want), "{text}: {error}");
    }
    let many = "pose 0 1 0 0 0 0\n".repeat(MAX_POSES + 1);
    assert!(CameraPath::parse(&many, "a.txt").unwrap_err().to_string().contains("line 1001: more than 1000 poses"));
}

#[test]
fn a_straight_way_is_straight_and_even() {
    let path = path_of(vec![pose([0.0, -3.0, 0.0], [0.0; 3]), pose([0.0, -1.0, 0.0], [0.0, 2.0, 0.0])]);
    let frames = path.frames([64, 48], 5);
    for (k, camera) in frames.iter().enumerate() {
        assert!(camera.eye().distance(DVec3::new(0.0, -3.0 + 0.5 * k as f64, 0.0)) < 1e-9, "{k}: {}", camera.eye());
        assert!(forward(camera).distance(DVec3::Y) < 1e-9);
        assert!(camera.check("frame").is_ok() && camera.near == 0.5 && camera.width == 64);
    }
    let first = path.cameras([64, 48]).next().unwrap();
    let off = frames[0].world_to_camera.iter().zip(first.world_to_camera).map(|(a, b)| (a - b).abs());
    assert!(off.fold(0.0, f64::max) < 1e-9, "the first picture is that of the first pose");
}

#[test]
fn a_turn_on_the_spot_takes_its_time_and_stays_upright() {
    // From looking along y and down to looking along x and down.
    let path = path_of(vec![
        pose([0.0; 3], [0.0, 2.0, -1.0]),
        pose([0.0; 3], [0.0, 2.0, -1.0]),
        pose([0.0; 3], [2.0, 0.0, -1.0]),
    ]);
    let frames = path.frames([64, 48], 10);
    let turns: Vec<f64> = frames.windows(2).map(|p| forward(&p[0]).angle_between(forward(&p[1]))).collect();
    assert!(turns.iter().all(|turn| (turn - turns[0]).abs() < 0.01 * turns[0] && *turn > 0.1), "{turns:?}");
    for camera in &frames {
        assert!(camera.eye().length() < 1e-12);
        let right = camera.view().inverse().transform_vector3(DVec3::X);
        assert!(right.z.abs() < 1e-9, "the horizon is level");
    }
    assert!(forward(&frames[9]).distance(DVec3::new(2.0, 0.0, -1.0).normalize()) < 1e-9);
}

#[test]
fn one_pose_stays_where_it_is() {
    let path = path_of(vec![pose([0.0, -3.0, 0.0], [0.0; 3])]);
    let frames = path.frames([64, 48], 3);
    assert_eq!(frames.len(), 3);
    assert!(frames.iter().all(|camera| camera.eye().distance(DVec3::new(0.0, -3.0, 0.0)) < 1e-9));
    assert!(path_of(Vec::new()).frames([64, 48], 3).is_empty());
}

proptest! {
    #[test]
    fn a_way_is_even_smooth_and_passes_every_pose(
        points in proptest::collection::vec(proptest::array::uniform3(-10.0..10.0_f64), 2..8),
    ) {
        let points: Vec<DVec3> = points.into_iter().map(DVec3::from_array).collect();
        prop_assume!(points.windows(2).all(|p| p[0].distance(p[1]) > 2.0));
        // All look at one far place, so that the eye's way dominates.
        let target = DVec3::new(0.0, 100.0, 0.0);
        let path = path_of(points.iter().map(|eye| [*eye, target]).collect());
        let frames = path.frames([8, 8], 4000);
        let eyes: Vec<DVec3> = frames.iter().map(Camera::eye).collect();
        let total: f64 = eyes.windows(2).map(|p| p[0].distance(p[1])).sum();
        for point in &points {
            let nearest = eyes.iter().map(|eye| eye.distance(*point)).fold(f64::INFINITY, f64::min);
            prop_assert!(nearest < 2e-3 * total, "{point} is passed at {nearest}");
        }
        let longest = eyes.windows(2).map(|p| p[0].distance(p[1])).fold(0.0, f64::max);
        prop_assert!(longest < 2.0 * total / 3999.0, "{longest} of {total}");
        for frame in &frames {
            prop_assert!(frame.check("frame").is_ok());
        }
    }
}

#[test]
fn a_turn_shows_the_scene_from_every_side() {
    let scene = test_scene(&[("cloud", 400)]);
    let look = Appearance::of(&scene);
    let view = framed_turn(&scene, &look, (DVec3::new(-0.5, 0.8, -0.35), DVec3::Z), 40.0, 1.5);
    let (mut most, mut least) = (0.0_f64, f64::INFINITY);
    for k in 0..36 {
        let camera = view.orbited(10.0 * f64::from(k), 0.0).camera(150, 100);
        let reach = (0..scene.len()).filter_map(|i| scene.position(i)).map(|p| {
            let p = camera.view().transform_point3(p);
            let pixel = DVec2::new(camera.fx * p.x / p.z, camera.fy * p.y / p.z);
            (pixel / DVec2::new(75.0, 50.0)).abs().max_element()
        });
        let reach = reach.fold(0.0, f64::max);
        (most, least) = (most.max(reach), least.min(reach));
    }
    assert!(most <= 1.0, "a centre is cut off: {most}");
    assert!(least > 0.4, "the scene is small: {least}");
    // Nothing to see: the box is framed.
    let mut hidden = look.clone();
    hidden.base[0].visible = false;
    let view = framed_turn(&scene, &hidden, (DVec3::Y, DVec3::Z), 40.0, 1.0);
    assert!(view.check().is_ok());
}
