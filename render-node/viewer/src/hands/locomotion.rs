//! A person's ways through the scene without walking: flying, and jumps onto the floor. The scene moves; the room stays.

use glam::{DQuat, DVec2, DVec3};

use super::placement::{Placement, Pose};

/// Metres in a second of a stick at its end.
pub const FLY_SPEED: f64 = 1.5;

/// A stick at rest is within this of its middle.
const REST: f64 = 0.15;

/// Longest step, in seconds, that a flight takes at once.
const LONGEST_STEP: f64 = 0.1;

/// A stick pushed forward beyond the first aims; one that comes back below the second lets go.
const AIMS: [f64; 2] = [0.7, 0.4];

/// Speed at which a thrown point leaves the hand, and its fall: metres per second, and per second squared.
const THROW: (f64, f64) = (6.0, 9.81);

/// Seconds between two points of an arc.
const ARC_STEP: f64 = 0.05;

/// Most points of an arc.
pub const ARC_POINTS: usize = 40;

/// Greatest distance of a landing place from the head over the floor, metres.
pub const FARTHEST: f64 = 8.0;

/// Motion of the person in a flight, in metres of the room. `stick` is right and forward, each −1 to 1, and `pointing` is the pose
/// of a hand: forward is where it points. The speed grows with the square of the tilt. Non-finite input gives no motion.
#[must_use]
pub fn flight(pointing: &Pose, stick: DVec2, seconds: f64) -> DVec3 {
    let tilt = stick.length();
    if !(tilt > REST && tilt.is_finite() && seconds.is_finite()) {
        return DVec3::ZERO;
    }
    let share = ((tilt.min(1.0) - REST) / (1.0 - REST)).powi(2);
    let direction = stick / tilt;
    let way = pointing.orientation * DVec3::new(direction.x, 0.0, -direction.y);
    let moved = FLY_SPEED * share * seconds.clamp(0.0, LONGEST_STEP) * way;
    if moved.is_finite() { moved } else { DVec3::ZERO }
}

/// The path of a point thrown by a hand, down to the floor.
#[derive(Debug, Clone, PartialEq)]
pub struct Arc {
    /// Points of the room from the hand on, at most [`ARC_POINTS`]. The last one is on the floor if it lands.
    pub points: Vec<DVec3>,
    /// Where it meets the floor, at most [`FARTHEST`] from the head; `None` if it does not.
    pub landing: Option<DVec3>,
}

/// Throws a point from a hand along its forward axis onto the floor at this height, metres. `head` bounds the distance.
#[must_use]
pub fn arc(hand: &Pose, head: DVec3, floor: f64) -> Arc {
    let (speed, fall) = THROW;
    let (from, velocity) = (hand.position, speed * hand.forward());
    let at = |t: f64| from + t * velocity - DVec3::new(0.0, 0.5 * fall * t * t, 0.0);
    // The later time at which the height is that of the floor.
    let discriminant = velocity.y * velocity.y + 2.0 * fall * (from.y - floor);
    let ground = (discriminant >= 0.0).then(|| (velocity.y + discriminant.sqrt()) / fall).filter(|t| *t >= 0.0);
    let longest = ARC_STEP * (ARC_POINTS - 1) as f64;
    let end = ground.unwrap_or(longest).min(longest);
    let steps = ((end / ARC_STEP).ceil() as usize).clamp(1, ARC_POINTS - 1);
    let points: Vec<DVec3> =
        (0..=steps).map(|k| at(end * k as f64 / steps as f64)).filter(|point| point.is_finite()).collect();
    let landing = ground.filter(|t| *t <= longest).map(|t| DVec3 { y: floor, ..at(t) });
    let landing = landing.filter(|l| l.is_finite() && (*l - head).with_y(0.0).length() <= FARTHEST);
    Arc { points, landing }
}

/// Motion of the person in a jump to a place of the floor: the head comes to stand over it.
#[must_use]
pub fn jump(head: DVec3, landing: DVec3) -> DVec3 {
    (landing - head).with_y(0.0)
}

/// A person who moves by `by` metres of the room: the scene moves the other way.
#[must_use]
pub fn passed(placement: &Placement, by: DVec3) -> Placement {
    Placement { translation: placement.translation - by, ..*placement }
}

/// The part of a turn about an axis of unit length, its twist: the nearest turn about that axis alone. A turn by 180° about
/// an axis at right angles has none.
#[must_use]
pub fn twist(turn: DQuat, axis: DVec3) -> DQuat {
    let along = turn.xyz().dot(axis) * axis;
    let twist = DQuat::from_xyzw(along.x, along.y, along.z, turn.w);
    if twist.length() > 1e-9 { twist.normalize() } else { DQuat::IDENTITY }
}

/// A stick that aims at a landing place while it is pushed forward, and jumps there when it is let go.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Teleport {
    aiming: bool,
    arc: Option<Arc>,
}

impl Teleport {
    /// Takes in the stick and the hand's pointing pose. Returns the landing place when the stick is let go over one. A hand
    /// that is lost or `busy` gives its aim up.
    pub fn step(&mut self, hand: Option<Pose>, stick: DVec2, (head, floor): (DVec3, f64), busy: bool) -> Option<DVec3> {
        let Some(hand) = hand.filter(|_| !busy) else {
            *self = Self::default();
            return None;
        };
        if stick.y > AIMS[0] {
            self.aiming = true;
        } else if self.aiming && stick.length() < AIMS[1] {
            self.aiming = false;
            return self.arc.take().and_then(|arc| arc.landing);
        }
        self.arc = self.aiming.then(|| arc(&hand, head, floor));
        None
    }

    /// The arc while the stick aims.
    #[must_use]
    pub fn aimed(&self) -> Option<&Arc> {
        self.arc.as_ref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn pose(position: DVec3, turn: DVec3) -> Pose {
        Pose { position, orientation: DQuat::from_scaled_axis(turn) }
    }

    const LEVEL: Pose = Pose { position: DVec3::new(0.2, 1.2, -0.3), orientation: DQuat::IDENTITY };

    #[test]
    fn a_flight_goes_where_the_hand_points_and_a_stick_at_rest_goes_nowhere() {
        let forward = flight(&LEVEL, DVec2::Y, 0.01);
        assert!(forward.distance(DVec3::new(0.0, 0.0, -FLY_SPEED * 0.01)) < 1e-12, "{forward}");
        let aside = flight(&LEVEL, DVec2::X, 0.01);
        assert!(aside.distance(DVec3::new(FLY_SPEED * 0.01, 0.0, 0.0)) < 1e-12, "{aside}");
        let up = flight(&pose(DVec3::ZERO, DVec3::new(0.5 * std::f64::consts::PI, 0.0, 0.0)), DVec2::Y, 0.01);
        assert!(up.distance(DVec3::new(0.0, FLY_SPEED * 0.01, 0.0)) < 1e-12, "{up}");
        for stick in [DVec2::ZERO, DVec2::splat(0.1), DVec2::NAN, DVec2::INFINITY] {
            assert_eq!(flight(&LEVEL, stick, 0.01), DVec3::ZERO);
        }
        // A long pause is no leap.
        assert!(flight(&LEVEL, DVec2::Y, 60.0).length() <= FLY_SPEED * LONGEST_STEP + 1e-12);
    }

    #[test]
    fn the_scene_passes_a_person_who_moves() {
        let at = Placement { scale: 2.0, ..Placement::IDENTITY };
        let ahead = DVec3::new(0.3, 1.0, -2.0);
        let point = at.to_scene(ahead);
        let passed = passed(&at, DVec3::new(0.0, 0.0, -0.5));
        assert!(passed.to_room(point).distance(ahead + DVec3::new(0.0, 0.0, 0.5)) < 1e-12);
    }

    #[test]
    fn an_arc_lands_where_a_thrown_point_does() {
        // By hand: level at 6 m/s from 1.2 m, it falls for √(2·1.2/9.81) s.
        let head = DVec3::new(0.0, 1.6, 0.0);
        let thrown = arc(&LEVEL, head, 0.0);
        let t = (2.0_f64 * 1.2 / 9.81).sqrt();
        let landing = thrown.landing.unwrap();
        assert!(landing.distance(DVec3::new(0.2, 0.0, -0.3 - 6.0 * t)) < 1e-9, "{landing}");
        assert_eq!(thrown.points.first(), Some(&LEVEL.position));
        assert!(thrown.points.last().unwrap().distance(landing) < 1e-9);
        let stands = passed(&Placement::IDENTITY, jump(head, landing));
        let there = stands.to_room(landing);
        assert!(there.with_y(0.0).distance(head.with_y(0.0)) < 1e-9, "the person stands there");
        assert_eq!(stands.translation.y, 0.0);
        // Straight up it comes down on the hand's own place; too far away there is no landing.
        let up = arc(&pose(LEVEL.position, DVec3::new(0.5 * std::f64::consts::PI, 0.0, 0.0)), head, 0.0);
        assert!(up.landing.is_some_and(|l| l.distance(LEVEL.position.with_y(0.0)) < 1e-9));
        assert_eq!(arc(&LEVEL, head + DVec3::new(20.0, 0.0, 0.0), 0.0).landing, None);
        // From below the floor, and of a hand that is not finite.
        assert_eq!(arc(&LEVEL, head, 50.0).landing, None);
        assert_eq!(arc(&Pose { position: DVec3::NAN, ..LEVEL }, head, 0.0).landing, None);
    }

    #[test]
    fn a_stick_aims_and_jumps_when_it_is_let_go() {
        let (head, floor) = (DVec3::new(0.0, 1.6, 0.0), 0.0);
        let mut teleport = Teleport::default();
        let mut step = |stick: DVec2, busy: bool| {
            let landing = teleport.step(Some(LEVEL), stick, (head, floor), busy);
            (landing, teleport.aimed().is_some())
        };
        assert_eq!(step(DVec2::new(0.0, 0.5), false), (None, false));
        assert_eq!(step(DVec2::Y, false), (None, true));
        assert_eq!(step(DVec2::new(0.0, 0.5), false), (None, true), "still aims");
        assert_eq!(step(DVec2::ZERO, false), (arc(&LEVEL, head, floor).landing, false));
        assert_eq!(step(DVec2::ZERO, false), (None, false), "once");
        step(DVec2::Y, false);
        assert_eq!(step(DVec2::Y, true), (None, false), "a busy hand gives its aim up");
        assert_eq!(step(DVec2::ZERO, false), (None, false));
        step(DVec2::Y, false);
        assert_eq!(teleport.step(None, DVec2::ZERO, (head, floor), false), None, "so does a lost one");
        assert_eq!(teleport, Teleport::default());
    }

    proptest! {
        #[test]
        fn an_arc_is_bounded_and_never_below_the_floor(
            at in proptest::array::uniform3(-3.0..3.0_f64), turn in proptest::array::uniform3(-4.0..4.0_f64)
        ) {
            let hand = pose(DVec3::from_array(at), DVec3::from_array(turn));
            let thrown = arc(&hand, DVec3::ZERO, -3.0);
            prop_assert!(thrown.points.len() <= ARC_POINTS && thrown.points.len() >= 2);
            prop_assert!(thrown.points.iter().all(|p| p.y >= -3.0 - 1e-9));
            if let Some(landing) = thrown.landing {
                prop_assert!(landing.y == -3.0 && landing.with_y(0.0).length() <= FARTHEST);
            }
        }

        #[test]
        fn a_twist_turns_about_its_axis_alone(turn in proptest::array::uniform3(-3.0..3.0_f64), yaw in -3.0..3.0_f64) {
            let any = DQuat::from_scaled_axis(DVec3::from_array(turn));
            let up = DVec3::Y;
            let twisted = twist(any, up);
            prop_assert!((twisted * up).distance(up) < 1e-9 && (twisted.length() - 1.0).abs() < 1e-9);
            let about = DQuat::from_axis_angle(up, yaw);
            prop_assert!(twist(about, up).angle_between(about) < 1e-6);
        }
    }
}
