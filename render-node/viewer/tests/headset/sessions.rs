//! Sessions under Monado: reached, used, lost and found again.

use std::time::{Duration, Instant};

use glam::{DVec2, DVec3};
use sg_scene::model::SceneBox;
use sg_viewer::hands::{Grab, HandInput, Origin, Placement, Pointer, Pose, Rectangle, Side, Stance, TurnMode};
use sg_viewer::xr::{Frame, FrameOutcome, Headset, Options, PAUSE, PanelLayer, XrError};

use crate::monado::{Display, Puppet, Runtime, is_inside, run_inside};

const PATIENCE: Duration = Duration::from_secs(20);

/// Makes frames until `done` accepts one that was shown.
fn until(headset: &mut Headset, what: &str, mut done: impl FnMut(&mut Frame<'_>) -> bool) {
    let begun = Instant::now();
    let mut finished = false;
    while !finished {
        assert!(begun.elapsed() < PATIENCE, "waited in vain for: {what}");
        let step = headset.frame(|frame| {
            finished = done(frame);
            Ok::<(), XrError>(())
        });
        if !matches!(step.unwrap(), FrameOutcome::Shown | FrameOutcome::Hidden) {
            std::thread::sleep(PAUSE);
        }
    }
}

fn near(hand: &HandInput, at: [f32; 3]) -> bool {
    hand.grip.is_some_and(|g| g.position.distance(DVec3::from_array(at.map(f64::from))) < 1e-3)
}

#[test]
fn a_scene_is_drawn_held_and_scaled() {
    run_inside("sessions::inside_a_scene_is_drawn_held_and_scaled");
}

#[test]
#[ignore = "run by the test without `inside`"]
fn inside_a_scene_is_drawn_held_and_scaled() {
    if !is_inside() {
        return;
    }
    let _runtime = Runtime::start(&Display::None);
    let mut puppet = Puppet::connect();
    let mut headset = Headset::open(Options::default()).unwrap();
    println!("{:?} on {:?}, {:?}", headset.names(), headset.gpu(), headset.size());
    assert_eq!(headset.origin(), Origin::Floor);
    // Monado's simulated headset is opaque and has no cameras: there is nothing to switch.
    println!("surroundings: {:?}", headset.surroundings());
    assert_eq!(headset.surroundings(), None);
    println!("unknown controllers: {:?}; refresh rates {:?}", headset.unknown_controllers(), headset.refresh_rates());
    for known in ["khr/simple", "oculus/touch", "valve/index", "microsoft/motion", "htc/vive"] {
        assert!(!headset.unknown_controllers().iter().any(|path| path.contains(known)), "{known}");
    }

    until(&mut headset, "hands", |f| f.hands.iter().all(|h| h.grip.is_some()));
    assert!(headset.is_focused());
    println!("controllers {:?}", headset.controllers());
    assert!(headset.controllers().iter().all(|c| c.as_deref().is_some_and(|c| c.contains("index"))));

    // The head is at its given place. The eyes are an eye's distance apart, both looking ahead.
    until(&mut headset, "the head", |f| f.head.position.distance(DVec3::new(0.0, 1.6, 0.0)) < 1e-3);
    until(&mut headset, "eyes", |frame| {
        let [left, right] = frame.eyes;
        let apart = right.pose.position - left.pose.position;
        println!("eyes {apart} apart, {:?}, {} Hz", left.fov, 1.0 / frame.period);
        assert!(apart.length() > 0.05 && apart.length() < 0.08 && apart.x > 0.05);
        for eye in [left, right] {
            assert!(eye.pose.forward().distance(DVec3::NEG_Z) < 1e-3);
            assert!(eye.fov.left < -0.3 && eye.fov.right > 0.3 && eye.fov.up > 0.3 && eye.fov.down < -0.3);
        }
        true
    });

    // Lenses hide only the pictures' edges: straight ahead is visible.
    until(&mut headset, "what lenses hide", |frame| {
        let (version, eyes) = frame.hidden();
        println!("hidden: {:?} triangles of the eyes, change {version}", eyes.each_ref().map(Vec::len));
        for triangle in eyes.iter().flatten() {
            assert!(triangle.iter().any(|corner| corner.length() > 0.3), "{triangle:?}");
        }
        true
    });

    // Trigger, stick and buttons are read as they are.
    puppet.right.trigger = 0.5;
    puppet.right.stick = [0.0, -1.0];
    puppet.left.a = true;
    puppet.left.b = true;
    puppet.send();
    until(&mut headset, "inputs", |f| {
        let [left, right] = f.hands;
        (right.trigger - 0.5).abs() < 1e-3 && !right.click && right.stick.y < -0.9 && left.primary && left.secondary
    });
    puppet.right.trigger = 1.0;
    puppet.left.a = false;
    puppet.send();
    until(&mut headset, "a click", |f| f.hands[1].click && !f.hands[0].primary && f.hands[0].secondary);
    until(&mut headset, "a pulse", |f| {
        f.pulse(Side::Left, 0.5, Duration::ZERO).unwrap();
        f.pulse(Side::Right, 2.0, Duration::from_millis(20)).unwrap();
        true
    });

    // Both hands close on the scene and part to twice the distance; then one carries it.
    let cube = SceneBox { min: DVec3::splat(-2.0), max: DVec3::splat(2.0) };
    let home = Placement::fit(cube, DVec3::Y, DVec3::NEG_Z, Stance::Standing, headset.origin());
    let mut scene = Grab::new(home, DVec3::ZERO);
    let mut hold = |headset: &mut Headset, what: &str, hands: [[f32; 3]; 2], squeezes: [f64; 2]| {
        until(headset, what, |f| {
            scene.step(&f.hands, [true; 2], (f.head.position, TurnMode::Off, Side::Right), f.period);
            let squeezed = f.hands.iter().zip(squeezes).all(|(h, s)| (h.squeeze - s).abs() < 1e-3);
            squeezed && near(&f.hands[0], hands[0]) && near(&f.hands[1], hands[1])
        });
        scene.placement()
    };
    let (left, right) = ([-0.2, 1.2, -0.8], [0.2, 1.2, -0.8]);
    (puppet.left.position, puppet.right.position) = (left, right);
    puppet.send();
    assert_eq!(hold(&mut headset, "open hands there", [left, right], [0.0; 2]), home);
    (puppet.left.squeeze, puppet.right.squeeze) = (1.0, 1.0);
    puppet.send();
    let held = hold(&mut headset, "closed hands", [left, right], [1.0; 2]);
    assert!((held.scale - home.scale).abs() < 1e-6);
    let (wide_left, wide_right) = ([-0.4, 1.3, -0.8], [0.4, 1.3, -0.8]);
    (puppet.left.position, puppet.right.position) = (wide_left, wide_right);
    puppet.send();
    let scaled = hold(&mut headset, "parted hands", [wide_left, wide_right], [1.0; 2]);
    println!("scale {} of {}", scaled.scale, home.scale);
    assert!((scaled.scale / home.scale - 2.0).abs() < 1e-3, "{}", scaled.scale / home.scale);
    assert!(scaled.to_room(DVec3::ZERO).distance(DVec3::new(0.0, 1.3, -0.8)) < 1e-3);
    puppet.left.squeeze = 0.0;
    puppet.send();
    let kept = hold(&mut headset, "one hand open", [wide_left, wide_right], [0.0, 1.0]);
    let carried_right = [0.5, 1.1, -0.6];
    puppet.right.position = carried_right;
    puppet.send();
    let carried = hold(&mut headset, "a carried scene", [wide_left, carried_right], [0.0, 1.0]);
    let way = carried.to_room(DVec3::ZERO) - kept.to_room(DVec3::ZERO);
    assert!(way.distance(DVec3::new(0.1, -0.2, 0.2)) < 1e-3, "{way}");

    // It ends on request.
    headset.leave();
    let begun = Instant::now();
    while headset.frame(|_| Ok::<(), XrError>(())).unwrap() != FrameOutcome::Ended {
        assert!(begun.elapsed() < PATIENCE, "the session does not end");
    }
    assert!(headset.gpu().is_none() && headset.frame(|_| Ok::<(), XrError>(())).unwrap() == FrameOutcome::Ended);
}

#[test]
fn a_board_is_pointed_at_pressed_and_scrolled() {
    run_inside("sessions::inside_a_board_is_pointed_at_pressed_and_scrolled");
}

#[test]
#[ignore = "run by the test without `inside`"]
fn inside_a_board_is_pointed_at_pressed_and_scrolled() {
    if !is_inside() {
        return;
    }
    let options = Options { retry_pause: Duration::from_millis(50), ..Options::default() };
    let runtime = Runtime::start(&Display::None);
    let mut puppet = Puppet::connect();
    let mut headset = Headset::open(options).unwrap();
    let pose = Pose { position: DVec3::new(0.0, 1.2, -1.4), orientation: glam::DQuat::IDENTITY };
    let place = Rectangle { pose, size: DVec2::new(1.0, 0.5) };
    let mut board = PanelLayer::new(egui::vec2(400.0, 200.0), 1.0, place);
    let mut pointer = Pointer::default();
    let (mut presses, mut draws, mut scrolled) = (0, 0, 0.0_f32);
    let mut rings = |headset: &mut Headset, what: &str, wanted: (i32, bool)| {
        until(headset, what, |frame| {
            let hands = frame.hands;
            let pointed = pointer.step(&[board.place], &hands);
            let by = pointed.as_ref().map(|p| (p, &hands[p.side.index()]));
            board
                .show(frame, by, Vec::new(), false, |ui| {
                    draws += 1;
                    // Half the board is the button.
                    let button = egui::Button::new("Ring").min_size(egui::vec2(190.0, 190.0));
                    presses += i32::from(
                        ui.put(egui::Rect::from_min_size(egui::pos2(5.0, 5.0), egui::vec2(190.0, 190.0)), button)
                            .clicked(),
                    );
                    scrolled += ui.input(|i| i.smooth_scroll_delta().y);
                })
                .unwrap();
            presses == wanted.0 && pointed.is_some() == wanted.1
        });
        (draws, scrolled)
    };
    // The Index's pointer looks down from the hand. The hit of the ray decides the hand's next place.
    let aim = std::cell::Cell::new(None);
    until(&mut headset, "an aim", |f| {
        aim.set(f.hands[1].aim.zip(f.hands[1].grip));
        near(&f.hands[1], [0.2, 1.2, -0.4])
    });
    let (ray, grip) = aim.get().unwrap();
    let at = |x: f64, y: f64| {
        let target = place.point(DVec2::new(x, y));
        let start = target + ray.forward() * ((target.z + 0.4) / -ray.forward().z);
        let hand = start - (ray.position - grip.position);
        [hand.x as f32, hand.y as f32, hand.z as f32]
    };
    println!("the ray goes {}", ray.forward());
    puppet.left.position = [-3.0, 1.0, 3.0];
    puppet.right.position = at(0.25, 0.5);
    puppet.send();
    rings(&mut headset, "pointing at the board", (0, true));
    puppet.right.trigger = 1.0;
    puppet.send();
    until(&mut headset, "the trigger", |f| f.hands[1].trigger > 0.9);
    rings(&mut headset, "a pulled trigger", (0, true));
    puppet.right.trigger = 0.0;
    puppet.send();
    rings(&mut headset, "a press", (1, true));
    // Beside the button a pull presses nothing, and the stick scrolls.
    puppet.right.position = at(0.75, 0.5);
    puppet.right.stick = [0.0, -1.0];
    puppet.send();
    until(&mut headset, "the stick", |f| f.hands[1].stick.y < -0.9);
    let mut scrolled = 0.0;
    for _ in 0..5 {
        (_, scrolled) = rings(&mut headset, "scrolling", (1, true));
    }
    assert!(scrolled < -10.0, "{scrolled}");
    // A hand that points away: the board is shown as it is, without being drawn.
    puppet.right.position = [3.0, 1.0, 3.0];
    puppet.right.stick = [0.0; 2];
    puppet.send();
    rings(&mut headset, "a hand elsewhere", (1, false));
    for _ in 0..40 {
        rings(&mut headset, "rest", (1, false));
    }
    let (drawn, _) = rings(&mut headset, "rest", (1, false));
    for _ in 0..10 {
        rings(&mut headset, "rest", (1, false));
    }
    let (drawn_later, _) = rings(&mut headset, "rest", (1, false));
    println!("drawn {drawn} times, then {drawn_later}");
    assert_eq!(drawn, drawn_later, "a board that nobody touches is not drawn");

    // Another runtime: the board is there again by itself.
    runtime.kill();
    while headset.frame(|_| Ok::<(), XrError>(())).unwrap() != FrameOutcome::Away {}
    let _runtime = Runtime::start(&Display::None);
    let mut puppet = Puppet::connect();
    puppet.right.position = at(0.25, 0.5);
    puppet.send();
    rings(&mut headset, "the board again", (1, true));
    puppet.right.trigger = 1.0;
    puppet.send();
    until(&mut headset, "the trigger", |f| f.hands[1].trigger > 0.9);
    rings(&mut headset, "a pulled trigger", (1, true));
    puppet.right.trigger = 0.0;
    puppet.send();
    rings(&mut headset, "another press", (2, true));
}

#[test]
fn a_runtime_that_is_killed_is_found_again() {
    run_inside("sessions::inside_a_runtime_that_is_killed_is_found_again");
}

#[test]
#[ignore = "run by the test without `inside`"]
fn inside_a_runtime_that_is_killed_is_found_again() {
    if !is_inside() {
        return;
    }
    let options = Options { retry_pause: Duration::from_millis(100), tries: 100, ..Options::default() };
    // First there is none.
    match Headset::open(options) {
        Err(error @ XrError::NoRuntime { .. }) => println!("{error}"),
        other => panic!("{:?}", other.err()),
    }
    let runtime = Runtime::start(&Display::None);
    drop(Puppet::connect());
    let mut headset = Headset::open(options).unwrap();
    let panel = headset.panel([64, 32]).unwrap();
    until(&mut headset, "a panel", |f| {
        f.draw_panel(panel, |_| ()).unwrap();
        true
    });
    let mut frames = 0;
    until(&mut headset, "frames", |_| {
        frames += 1;
        frames == 10
    });
    runtime.kill();
    let killed = Instant::now();
    while headset.frame(|_| Ok::<(), XrError>(())).unwrap() != FrameOutcome::Away {
        assert!(killed.elapsed() < PATIENCE, "nobody notices that the runtime is gone");
    }
    println!("gone: {}, noticed after {:?}", headset.away().unwrap(), killed.elapsed());
    assert!(headset.gpu().is_none());
    // The loop goes on meanwhile, without waiting.
    let asked = Instant::now();
    for _ in 0..20 {
        assert_eq!(headset.frame(|_| Ok::<(), XrError>(())).unwrap(), FrameOutcome::Away);
        std::thread::sleep(PAUSE);
    }
    println!("20 steps without a runtime in {:?}", asked.elapsed());

    let _runtime = Runtime::start(&Display::None);
    let started = Instant::now();
    while headset.frame(|_| Ok::<(), XrError>(())).unwrap() != FrameOutcome::Back {
        assert!(started.elapsed() < PATIENCE, "the runtime is not found again");
        std::thread::sleep(PAUSE);
    }
    println!("back after {:?}", started.elapsed());
    let mut frames = 0;
    until(&mut headset, "frames of the new session", |f| {
        assert!(matches!(f.draw_panel(panel, |_| ()), Err(XrError::NoPanel)), "panels of the old one are gone");
        frames += 1;
        frames == 10
    });
    println!("{:?}", headset.timing());
}

#[test]
fn a_runtime_that_stays_away_is_given_up() {
    run_inside("sessions::inside_a_runtime_that_stays_away_is_given_up");
}

#[test]
#[ignore = "run by the test without `inside`"]
fn inside_a_runtime_that_stays_away_is_given_up() {
    if !is_inside() {
        return;
    }
    let options = Options { retry_pause: Duration::from_millis(20), tries: 3, ..Options::default() };
    let runtime = Runtime::start(&Display::None);
    drop(Puppet::connect());
    let mut headset = Headset::open(options).unwrap();
    until(&mut headset, "a frame", |_| true);
    runtime.kill();
    let begun = Instant::now();
    let error = loop {
        assert!(begun.elapsed() < PATIENCE, "it is looked for for ever");
        match headset.frame(|_| Ok::<(), XrError>(())) {
            Ok(_) => std::thread::sleep(PAUSE),
            Err(error) => break error,
        }
    };
    println!("{error}");
    assert!(matches!(error, XrError::Gone { tries: 3, .. }));
    assert_eq!(headset.frame(|_| Ok::<(), XrError>(())).unwrap(), FrameOutcome::Ended);
}

#[test]
fn a_lost_device_is_opened_again_with_its_session() {
    run_inside("sessions::inside_a_lost_device_is_opened_again_with_its_session");
}

#[test]
#[ignore = "run by the test without `inside`"]
fn inside_a_lost_device_is_opened_again_with_its_session() {
    if !is_inside() {
        return;
    }
    let _runtime = Runtime::start(&Display::None);
    drop(Puppet::connect());
    let mut headset = Headset::open(Options::default()).unwrap();
    until(&mut headset, "a frame", |_| true);
    headset.gpu().unwrap().lose();
    let begun = Instant::now();
    let error = loop {
        assert!(begun.elapsed() < PATIENCE, "nobody notices that the device is lost");
        let drawn = headset.frame(|frame| -> Result<(), Box<dyn std::error::Error>> {
            frame.draw_eyes(|_| ())?;
            frame.gpu().check()?;
            Ok(())
        });
        if let Err(error) = drawn {
            break error;
        }
    };
    println!("{error}");
    headset.restart(error.to_string());
    assert!(headset.away().unwrap().to_string().contains("lost"));
    while headset.frame(|_| Ok::<(), XrError>(())).unwrap() != FrameOutcome::Back {
        assert!(begun.elapsed() < PATIENCE, "the headset does not come back");
    }
    until(&mut headset, "a frame on the new device", |frame| {
        frame.draw_eyes(|targets| assert_eq!(targets.len(), 2)).unwrap();
        frame.gpu().check().unwrap();
        true
    });
    headset.leave();
}

/// Outside Monado's folder there is usually no headset. The message names the missing part and the remedy.
#[test]
fn missing_files_are_reported_in_one_line() {
    match Headset::open(Options::default()) {
        Ok(headset) => println!("SKIPPED without a headset: there is {:?}", headset.names()),
        Err(error) => {
            println!("{error}");
            let line = error.to_string();
            assert!(!line.contains('\n') && (line.contains("use the window") || line.contains("refused")), "{line}");
        }
    }
}
