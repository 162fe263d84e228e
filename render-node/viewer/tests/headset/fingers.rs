//! Hands without controllers, as Monado's scripted devices bend their fingers.

use std::time::{Duration, Instant};

use glam::DVec3;
use sg_viewer::hands::HandInput;
use sg_viewer::xr::{FrameOutcome, Headset, Options, PAUSE, XrError};

use crate::monado::{Display, Puppet, Runtime, is_inside, run_inside};

const PATIENCE: Duration = Duration::from_secs(20);

/// Makes frames until the hands are as they have to be.
fn until(headset: &mut Headset, what: &str, holds: impl Fn(&[HandInput; 2]) -> bool) -> [HandInput; 2] {
    let begun = Instant::now();
    let mut hands = [HandInput::default(); 2];
    loop {
        let step = headset.frame(|frame| {
            hands = frame.hands;
            Ok::<(), XrError>(())
        });
        match step.unwrap() {
            FrameOutcome::Shown | FrameOutcome::Hidden if holds(&hands) => return hands,
            FrameOutcome::Shown | FrameOutcome::Hidden => (),
            _ => std::thread::sleep(PAUSE),
        }
        assert!(begun.elapsed() < PATIENCE, "waited in vain for {what}: {hands:?}");
    }
}

#[test]
fn a_hand_without_a_controller_holds_with_its_fist() {
    run_inside("fingers::inside_a_hand_without_a_controller_holds_with_its_fist");
}

#[test]
#[ignore = "run by the test without `inside`"]
fn inside_a_hand_without_a_controller_holds_with_its_fist() {
    if !is_inside() {
        return;
    }
    let _runtime = Runtime::start(&Display::None);
    let mut puppet = Puppet::connect();
    let mut headset = Headset::open(Options::default()).unwrap();
    until(&mut headset, "controllers", |hands| hands.iter().all(|h| h.grip.is_some()));
    // The right controller is laid down; its hand is still seen, open.
    puppet.right.active = false;
    puppet.right.curl = Some(0.0);
    puppet.left.squeeze = 1.0;
    puppet.send();
    let at = DVec3::new(0.2, 1.2, -0.4);
    let near = |h: &HandInput| h.grip.is_some_and(|g| g.position.distance(at) < 0.15);
    let open =
        until(&mut headset, "an open hand", |[left, right]| near(right) && right.squeeze < 0.1 && left.squeeze > 0.9);
    let aim = open[1].aim.expect("a hand that is seen points");
    println!("open: {:?}", open[1]);
    assert!(aim.forward().z < -0.5, "it points ahead: {}", aim.forward());
    // The other hand has its controller as before.
    assert!(open[0].grip.is_some());
    puppet.right.curl = Some(1.0);
    puppet.send();
    let fist = until(&mut headset, "a fist", |[_, right]| right.squeeze > 0.7);
    println!("fist: {:?}", fist[1]);
    assert!(fist[1].trigger == 0.0 && !fist[1].click, "a fist presses nothing");
    puppet.right.curl = None;
    puppet.send();
    until(&mut headset, "no hand", |[_, right]| *right == HandInput::default());
    // The controller is taken up again.
    puppet.right.active = true;
    puppet.right.trigger = 1.0;
    puppet.send();
    until(&mut headset, "the controller", |[_, right]| right.trigger > 0.9 && right.grip.is_some());
}
