//! More shapes to choose numbers on: parts of very different sizes, shells around others, and many parts alike.

use std::f64::consts::TAU;

use glam::DVec3;
use rand::RngExt as _;
use rand_chacha::ChaCha8Rng;

use super::super::solid::{Sheet, Solid, direction};
use super::{Piece, Plan, arc, ball, curve, piece, tube};

/// A palm, a wrist and five fingers. A ring sits on one finger; the ring is wanted.
pub(super) fn hand(r: &mut ChaCha8Rng) -> Plan {
    let mut pieces = vec![
        ball(0, [0.0, 0.0, 0.0], [0.34, 0.12, 0.38]),
        tube(6, arc([0.0, 0.0, -0.30], [0.0, 0.0, -0.6], [0.02, 0.0, -0.95]), |t| 0.15 + 0.03 * t),
    ];
    for finger in 0..5 {
        let at = f64::from(finger) / 4.0;
        let (x, bend) = (0.30 - 0.58 * at, r.random_range(-0.1..0.25));
        let foot = [x, 0.0, 0.28 - 0.25 * (at - 0.4).powi(2)];
        let length = [0.34, 0.52, 0.58, 0.52, 0.40][finger as usize];
        let tip = [x * 1.5, bend, foot[2] + length];
        let middle = [x * 1.25, -0.3 * bend, foot[2] + 0.5 * length];
        pieces.push(tube(finger + 1, arc(foot, middle, tip), |t| 0.075 - 0.025 * t));
    }
    let ring = curve(48, |t| DVec3::new(0.012 + 0.10 * (TAU * t).cos(), 0.10 * (TAU * t).sin(), 0.46));
    pieces.push(tube(7, ring, |_| 0.022));
    Plan { pieces, target: &[7], haze: None }
}

/// A bunch of berries that touch, on a forked stalk; one berry is wanted.
pub(super) fn grapes(r: &mut ChaCha8Rng) -> Plan {
    let mut pieces = vec![tube(0, arc([0.0, 0.0, 1.0], [0.05, 0.0, 0.3], [0.0, 0.0, -0.7]), |t| 0.05 - 0.02 * t)];
    let mut centres: Vec<DVec3> = Vec::new();
    for _ in 0..4000 {
        let z = r.random_range(-0.8..0.6);
        let out = direction(r) * DVec3::new(1.0, 1.0, 0.0);
        let centre = out.normalize_or(DVec3::X) * (0.18 + 0.22 * r.random_range(0.0..1.0_f64)) + DVec3::Z * z;
        if centres.len() < 26 && centres.iter().all(|c| c.distance(centre) > 0.20) {
            centres.push(centre);
        }
    }
    for (k, c) in (1..).zip(centres) {
        let radius = r.random_range(0.10..0.14);
        pieces.push(ball(k, c.to_array(), [radius, radius, 1.15 * radius]));
    }
    Plan { pieces, target: &[3], haze: None }
}

/// A large shell with organs inside it and a cord through them; the largest organ is wanted.
pub(super) fn shells(r: &mut ChaCha8Rng) -> Plan {
    let mut pieces = vec![ball(0, [0.0; 3], [1.0, 0.7, 0.8])];
    let mut inside = |piece: Piece| pieces.push(Piece { inner: true, ..piece });
    for (k, (at, size)) in (1..).zip([
        ([-0.45, 0.0, 0.1], [0.30, 0.24, 0.34]),
        ([0.10, 0.15, 0.05], [0.22, 0.18, 0.26]),
        ([0.55, -0.1, 0.0], [0.16, 0.20, 0.22]),
        ([0.1, -0.28, -0.2], [0.14, 0.12, 0.12]),
    ]) {
        let shifted = DVec3::from_array(at) + 0.03 * direction(r);
        inside(ball(k, shifted.to_array(), size));
    }
    inside(tube(5, arc([-0.9, 0.0, -0.2], [0.0, 0.0, -0.35], [0.9, 0.05, 0.05]), |_| 0.04));
    Plan { pieces, target: &[1], haze: None }
}

/// A sea with haze below it, islands and a bridge between two of them; the bridge is wanted.
pub(super) fn islands(r: &mut ChaCha8Rng) -> Plan {
    let sheet = Sheet { half: 1.0, amplitude: 0.06 };
    let mut pieces = vec![piece(0, Solid::Sheet(sheet))];
    let places = [(-0.5, 0.0, 0.30), (0.5, 0.1, 0.26), (0.1, -0.6, 0.18), (-0.2, 0.65, 0.12)];
    for (k, (x, y, size)) in (1..).zip(places) {
        let tall = size * r.random_range(0.7..1.3);
        pieces.push(ball(k, [x, y, sheet.height(x, y) + 0.2 * size], [size, size, tall]));
    }
    pieces.push(tube(5, arc([-0.4, 0.0, 0.25], [0.0, 0.05, 0.5], [0.45, 0.1, 0.22]), |_| 0.05));
    Plan { pieces, target: &[5], haze: Some((0.2, 6)) }
}
