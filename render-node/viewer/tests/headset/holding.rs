//! A scene in two hands.

use glam::{DQuat, DVec2, DVec3};
use proptest::prelude::*;
use sg_scene::model::SceneBox;
use sg_viewer::hands::{
    Bookmarks, ComfortVignette, Grab, HandInput, MIN_APART, MOST_BOOKMARKS, Origin, Placement, Pose, SCALES, Side,
    Stance, TurnMode,
};

const STILL: (DVec3, TurnMode, Side) = (DVec3::ZERO, TurnMode::Off, Side::Right);

fn at(position: DVec3, turn: DVec3, squeeze: f64) -> HandInput {
    let grip = Some(Pose { position, orientation: DQuat::from_scaled_axis(turn) });
    HandInput { grip, squeeze, ..HandInput::default() }
}

fn vector(reach: f64) -> impl Strategy<Value = DVec3> {
    proptest::array::uniform3(-reach..reach).prop_map(DVec3::from_array)
}

fn hand() -> impl Strategy<Value = HandInput> {
    (vector(1.0), vector(3.0), prop::bool::ANY).prop_map(|(p, t, on)| at(p, t, f64::from(u8::from(on))))
}

fn home() -> Placement {
    let bounds = SceneBox { min: DVec3::new(-10.0, 0.0, 5.0), max: DVec3::new(30.0, 20.0, 25.0) };
    Placement::fit(bounds, DVec3::Z, DVec3::Y, Stance::Standing, Origin::Floor)
}

fn scene() -> Grab {
    Grab::new(home(), DVec3::new(10.0, 10.0, 15.0))
}

/// How far a scene's points within its box stand apart in two placements, metres.
fn moved(a: &Placement, b: &Placement) -> f64 {
    let corners = [DVec3::new(-10.0, 0.0, 5.0), DVec3::new(30.0, 20.0, 25.0), DVec3::new(-10.0, 20.0, 25.0)];
    corners.iter().map(|p| a.to_room(*p).distance(b.to_room(*p))).fold(0.0, f64::max)
}

#[test]
fn a_fitted_scene_is_a_metre_long_and_stands_upright_in_front() {
    let placement = home();
    assert!((placement.scale - 1.0 / 40.0).abs() < 1e-15);
    assert!(placement.to_room(DVec3::new(10.0, 10.0, 15.0)).distance(DVec3::new(0.0, 1.2, -0.8)) < 1e-12);
    let way = |d: DVec3| placement.rotation * d;
    assert!(way(DVec3::Z).distance(DVec3::Y) < 1e-12, "up stays up");
    assert!(way(DVec3::Y).distance(DVec3::NEG_Z) < 1e-12, "forward is away");
    assert!(way(DVec3::X).distance(DVec3::X) < 1e-12, "right stays right");
    let cube = SceneBox { min: DVec3::ZERO, max: DVec3::ONE };
    for (stance, origin, height) in [
        (Stance::Seated, Origin::Floor, 0.9),
        (Stance::Standing, Origin::Eyes, -0.4),
        (Stance::Seated, Origin::Eyes, -0.3),
    ] {
        let seated = Placement::fit(cube, DVec3::NEG_Y, DVec3::Z, stance, origin);
        assert!((seated.to_room(DVec3::splat(0.5)).y - height).abs() < 1e-12);
    }
    for (up, forward) in [(DVec3::ZERO, DVec3::Y), (DVec3::Z, DVec3::Z), (DVec3::NAN, DVec3::NAN)] {
        let point = SceneBox { min: DVec3::ONE, max: DVec3::ONE };
        let placed = Placement::fit(point, up, forward, Stance::Standing, Origin::Floor);
        assert!(placed.checked().is_some() && placed.scale == 1.0);
    }
}

proptest! {
    #[test]
    fn one_hand_keeps_the_grabbed_point(path in prop::collection::vec((vector(1.0), vector(3.0)), 2..20), side in 0..2_usize) {
        let mut scene = scene();
        let rest = HandInput::default();
        let both = |h: HandInput| if side == 0 { [h, rest] } else { [rest, h] };
        let first = at(path[0].0, path[0].1, 1.0);
        scene.step(&both(first), [true; 2], STILL, 0.01);
        prop_assert!(moved(&scene.placement(), &home()) < 1e-12, "closing the hand moves nothing");
        // The scene's points under the hand and 10 cm along its axes.
        let points = [DVec3::ZERO, 0.1 * DVec3::X, 0.1 * DVec3::Y];
        let held = points.map(|p| scene.placement().to_scene(first.grip.unwrap().to_room(p)));
        for (position, turn) in path {
            let hand = at(position, turn, 1.0);
            scene.step(&both(hand), [true; 2], STILL, 0.01);
            for (p, held) in points.iter().zip(held) {
                prop_assert!(scene.placement().to_room(held).distance(hand.grip.unwrap().to_room(*p)) < 1e-9);
            }
            prop_assert!((scene.placement().scale - home().scale).abs() < 1e-15);
        }
    }

    #[test]
    fn two_hands_keep_their_grabbed_points(path in prop::collection::vec((vector(0.5), vector(0.5)), 2..20)) {
        let mut scene = scene();
        let mut held: Option<[DVec3; 2]> = None;
        for (left, right) in path {
            scene.step(&[at(left, left, 1.0), at(right, right, 1.0)], [true; 2], STILL, 0.01);
            prop_assume!(left.distance(right) > MIN_APART);
            let now = scene.placement();
            let [p, q] = *held.get_or_insert([now.to_scene(left), now.to_scene(right)]);
            let scale = now.scale / home().scale;
            prop_assert!(now.to_room(0.5 * (p + q)).distance(0.5 * (left + right)) < 1e-9, "the middle stays");
            if scale > SCALES[0] * 1.001 && scale < SCALES[1] * 0.999 {
                prop_assert!(now.to_room(p).distance(left) < 1e-9 && now.to_room(q).distance(right) < 1e-9);
            }
        }
    }

    #[test]
    fn taking_hold_and_letting_go_never_jumps(hands in prop::collection::vec((hand(), hand()), 1..30)) {
        let mut scene = scene();
        for (left, right) in hands {
            // The earlier grips do not matter: hands open and close in place, and nothing moves.
            scene.step(&[left, right], [true; 2], STILL, 0.01);
            let before = scene.placement();
            for (l, r) in [(1.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, 0.0), (0.0, 0.0), (1.0, 1.0), (0.0, 0.0)] {
                let hands = [HandInput { squeeze: l, ..left }, HandInput { squeeze: r, ..right }];
                scene.step(&hands, [true; 2], STILL, 0.01);
                prop_assert!(moved(&scene.placement(), &before) < 1e-9);
            }
        }
    }

    #[test]
    fn a_lost_hand_lets_go_and_nan_moves_nothing(
        away in vector(2.0), bad in prop_oneof![Just(f64::NAN), Just(f64::INFINITY)], which in 0..4_usize, squeeze in 0.5..1.0_f64,
    ) {
        let mut scene = scene();
        let held = at(DVec3::new(0.1, 1.0, -0.3), DVec3::ZERO, 1.0);
        let rest = HandInput::default();
        scene.step(&[held, rest], [true; 2], STILL, 0.01);
        let before = scene.placement();
        let grip = held.grip.unwrap();
        let broken = match which {
            0 => HandInput { grip: None, ..held },
            1 => HandInput { grip: Some(Pose { position: DVec3::new(bad, 0.0, 0.0), ..grip }), ..held },
            2 => HandInput { grip: Some(Pose { orientation: DQuat::from_xyzw(bad, 0.0, 0.0, 1.0), ..grip }), ..held },
            _ => HandInput { grip: Some(Pose { orientation: DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0), ..grip }), ..held },
        };
        scene.step(&[broken, HandInput { squeeze: bad, stick: DVec2::splat(f64::NAN), ..rest }], [true; 2], STILL, f64::NAN);
        prop_assert_eq!(scene.placement(), before);
        // It comes back elsewhere, still closed.
        scene.step(&[at(away, away, squeeze), rest], [true; 2], STILL, 0.01);
        prop_assert!(moved(&scene.placement(), &before) < 1e-12);
    }

    #[test]
    fn limits_hold_whatever_hands_do(hands in prop::collection::vec((hand(), hand(), -2.0..2.0_f64), 1..60)) {
        let mut scene = scene();
        for (left, right, stick) in hands {
            let right = HandInput { stick: DVec2::new(stick, 0.0), ..right };
            scene.step(&[left, right], [true; 2], (DVec3::Y, TurnMode::Smooth(90.0), Side::Right), 0.02);
            let scale = scene.placement().scale / home().scale;
            prop_assert!((SCALES[0] * (1.0 - 1e-12)..=SCALES[1] * (1.0 + 1e-12)).contains(&scale));
            prop_assert!(scene.placement().checked().is_some());
            prop_assert!((scene.placement().rotation.length() - 1.0).abs() < 1e-12);
        }
        scene.reset();
        prop_assert!(moved(&scene.placement(), &home()) < 1e-12);
    }
}

#[test]
fn two_hands_turn_a_scene_all_the_way_around() {
    let mut scene = scene();
    for step in 0..=64 {
        let angle = f64::from(step) / 64.0 * std::f64::consts::TAU;
        let arm = 0.3 * DVec3::new(angle.cos(), 0.0, angle.sin());
        let middle = DVec3::new(0.0, 1.0, -0.5);
        scene.step(&[at(middle - arm, DVec3::ZERO, 1.0), at(middle + arm, DVec3::ZERO, 1.0)], [true; 2], STILL, 0.01);
    }
    assert!(moved(&scene.placement(), &home()) < 1e-9, "{}", moved(&scene.placement(), &home()));
}

#[test]
fn the_stick_turns_about_the_head_at_once_or_about_the_middle_evenly() {
    let tilt = |x: f64| [HandInput::default(), HandInput { stick: DVec2::new(x, 0.0), ..HandInput::default() }];
    let head = DVec3::new(0.2, 1.6, 0.1);
    let mut snapped = scene();
    // One turn for each tilt, however long it is held.
    for x in [0.5, 0.8, 1.0, 0.9, 0.5, 1.0, 0.0, 1.0, 0.0] {
        snapped.step(&tilt(x), [true; 2], (head, TurnMode::Snap(30.0), Side::Right), 0.01);
    }
    assert!(moved(&snapped.placement(), &home().turned(head, DVec3::Y, 60_f64.to_radians())) < 1e-12);
    let mut smooth = scene();
    for x in [1.0, 1.0, 0.1, -1.0, f64::NAN] {
        smooth.step(&tilt(x), [true; 2], (head, TurnMode::Smooth(90.0), Side::Right), 0.05);
    }
    let middle = home().to_room(DVec3::new(10.0, 10.0, 15.0));
    assert!(moved(&smooth.placement(), &home().turned(middle, DVec3::Y, 4.5_f64.to_radians())) < 1e-12);
    // The other hand's stick, and one while the scene is held, do nothing.
    let before = smooth.placement();
    smooth.step(&tilt(1.0), [true; 2], (head, TurnMode::Snap(30.0), Side::Left), 0.05);
    let held = [at(DVec3::Y, DVec3::ZERO, 1.0), tilt(1.0)[1]];
    smooth.step(&held, [true; 2], (head, TurnMode::Smooth(30.0), Side::Right), 0.05);
    assert!(moved(&smooth.placement(), &before) < 1e-12);
}

#[test]
fn a_squeeze_that_is_meant_for_something_else_holds_nothing() {
    let mut scene = scene();
    scene.step(&[at(DVec3::Y, DVec3::ZERO, 1.0), HandInput::default()], [false, true], STILL, 0.01);
    assert!(!scene.is_held() && scene.is_squeezed(Side::Left));
    scene.step(&[at(DVec3::ZERO, DVec3::ZERO, 1.0), HandInput::default()], [false, true], STILL, 0.01);
    assert_eq!(scene.placement(), home());
}

#[test]
fn bookmarks_are_kept_replaced_and_bounded() {
    let mut marks = Bookmarks::default();
    let mut scene = scene();
    let there = home().turned(DVec3::ZERO, DVec3::X, 1.0);
    marks.keep("above", home());
    marks.keep("above", there);
    assert_eq!(marks.all().len(), 1);
    scene.go(marks.find("above").unwrap());
    assert!(moved(&scene.placement(), &there) < 1e-12);
    // A placement beyond the limits keeps its middle.
    let tiny = home().scaled(DVec3::Y, home().scale * 1e-6);
    scene.go(tiny);
    let middle = DVec3::new(10.0, 10.0, 15.0);
    assert!((scene.placement().scale / home().scale - SCALES[0]).abs() < 1e-12);
    assert!(scene.placement().to_room(middle).distance(tiny.to_room(middle)) < 1e-9);
    let before = scene.placement();
    scene.go(Placement { scale: f64::NAN, ..home() });
    assert_eq!(scene.placement(), before);
    for k in 0..2 * MOST_BOOKMARKS {
        marks.keep(&k.to_string(), home());
    }
    assert!(
        marks.all().len() == MOST_BOOKMARKS
            && marks.find("above").is_none()
            && marks.forget("40")
            && !marks.forget("40")
    );
    let stored = serde_json::to_string(&marks).unwrap();
    assert_eq!(serde_json::from_str::<Bookmarks>(&stored).unwrap(), marks);
}

#[test]
fn the_vignette_comes_with_motion_around_the_head_and_goes_with_it() {
    let head = Pose { position: DVec3::new(0.0, 1.6, 0.0), orientation: DQuat::IDENTITY };
    let mut comfort = ComfortVignette::default();
    let mut placement = home();
    let mut strengths = Vec::new();
    // Turned about the head by 90° in a second, then left alone.
    for frame in 0..180 {
        if frame < 90 {
            placement = placement.turned(head.position, DVec3::Y, 1_f64.to_radians());
        }
        strengths.push(comfort.step(&placement, &head, false, 1.0 / 90.0));
    }
    assert_eq!(strengths[0], 0.0, "where a scene stands at first it has not moved to");
    assert!(strengths[89] > 0.9 && strengths[179] == 0.0, "{} {}", strengths[89], strengths[179]);
    assert!(strengths.windows(2).all(|w| (w[1] - w[0]).abs() <= 1.0 / 90.0 / 0.3 + 1e-12), "it never flashes");
    // A jump is no motion, and neither is NaN.
    comfort.step(&placement.turned(head.position, DVec3::Y, 0.5), &head, true, 1.0 / 90.0);
    assert_eq!(comfort.step(&Placement { scale: f64::NAN, ..placement }, &head, false, 1.0 / 90.0), 0.0);
    assert_eq!(comfort.step(&placement, &head, false, f64::NAN), 0.0);
}

/// The scene's own upright axis in the room.
fn up(scene: &Grab) -> DVec3 {
    scene.placement().rotation * (home().rotation.inverse() * DVec3::Y)
}

proptest! {
    #[test]
    fn a_locked_scene_stays_upright_in_any_hands(path in prop::collection::vec((hand(), hand()), 2..20)) {
        let mut scene = scene();
        scene.lock_upright(true);
        for (left, right) in path {
            scene.step(&[left, right], [true; 2], STILL, 0.01);
            prop_assert!(up(&scene).distance(DVec3::Y) < 1e-9, "{}", up(&scene));
        }
    }

    #[test]
    fn a_lock_rights_a_tilted_scene_about_its_middle(turn in vector(3.0), yaw in -3.0..3.0_f64) {
        let mut scene = scene();
        let middle = DVec3::new(10.0, 10.0, 15.0);
        let pivot = home().to_room(middle);
        let turned = home().turned(pivot, DVec3::Y, yaw).turned(pivot, turn, turn.length());
        scene.go(turned);
        scene.lock_upright(true);
        prop_assert!(up(&scene).distance(DVec3::Y) < 1e-9);
        prop_assert!(scene.placement().to_room(middle).distance(pivot) < 1e-9);
        // The lock again, and its end, change nothing.
        let righted = scene.placement();
        scene.lock_upright(true);
        scene.lock_upright(false);
        prop_assert_eq!(scene.placement(), righted);
    }
}

#[test]
fn a_hand_turns_a_locked_scene_about_the_vertical_by_its_own_turn() {
    let mut scene = scene();
    scene.lock_upright(true);
    let place = DVec3::new(0.1, 1.2, -0.6);
    scene.step(&[at(place, DVec3::ZERO, 1.0), HandInput::default()], [true; 2], STILL, 0.01);
    scene.step(&[at(place, DVec3::new(0.0, 0.5, 0.0), 1.0), HandInput::default()], [true; 2], STILL, 0.01);
    let want = home().turned(place, DVec3::Y, 0.5);
    assert!(moved(&scene.placement(), &want) < 1e-9);
    assert!(!scene.travel(DVec3::X), "a held scene stays in its hand");
    scene.step(&[HandInput::default(); 2], [true; 2], STILL, 0.01);
    let before = scene.placement();
    assert!(scene.travel(DVec3::X) && !scene.travel(DVec3::ZERO) && !scene.travel(DVec3::NAN));
    assert!((scene.placement().translation - before.translation).distance(DVec3::NEG_X) < 1e-12);
}
