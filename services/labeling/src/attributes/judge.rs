//! How well a demand on the look fits a unit among others.
//!
//! Every answer is a membership from 0 to 1, as of a fuzzy set (Zadeh 1965). From [`FITS`] on the demand counts as met.

use glam::DVec3;

use crate::attributes::Attributes;
use crate::attributes::quality::{Constraint, Look, Quality};
use crate::frame::Frame;

/// Least membership that counts as met.
pub const FITS: f64 = 0.5;
/// Values that differ by less than this share are equally large, high or long.
const TIE: f64 = 0.12;
/// Least ratio of the greatest size to the smallest at which there are large and small ones.
const SIZES_DIFFER: f64 = 1.3;
/// Least range of the candidates' centres on an axis, as a share of that of all units, at which they have sides.
const SIDES_DIFFER: f64 = 0.1;
/// Coordinate, in halves of the range, from which a unit is on a side.
const SIDE: f64 = 0.25;

/// The looks of all units of a scene.
#[derive(Debug, Clone)]
pub struct Looks {
    units: Vec<Option<Attributes>>,
    /// Centres along right, up and front.
    places: Vec<Option<DVec3>>,
    /// Least and greatest centre.
    range: (DVec3, DVec3),
    frame: Frame,
}

impl Looks {
    /// The looks of units in their order, and the frame of words such as "left".
    #[must_use]
    pub fn new(units: Vec<Option<Attributes>>, frame: Frame) -> Self {
        let places: Vec<Option<DVec3>> =
            units.iter().map(|unit| unit.as_ref().map(|a| frame.coordinates(a.center))).collect();
        let range = range(places.iter().flatten().copied());
        Self { units, places, range, frame }
    }

    /// The same looks with one more unit behind them, in the same frame.
    #[must_use]
    pub fn with(&self, unit: Option<Attributes>) -> Self {
        Self::new(self.units.iter().copied().chain([unit]).collect(), self.frame)
    }

    /// Number of units, with and without attributes.
    #[must_use]
    pub fn len(&self) -> usize {
        self.units.len()
    }

    /// Whether there is no unit.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.units.is_empty()
    }

    /// The attributes of a unit, if it has any.
    #[must_use]
    pub fn of(&self, unit: usize) -> Option<&Attributes> {
        self.units.get(unit).and_then(Option::as_ref)
    }

    /// The range of all centres along right, up and front, in scene lengths.
    #[must_use]
    pub fn extent(&self) -> DVec3 {
        (self.range.1 - self.range.0).max(DVec3::ZERO)
    }

    /// The units that have attributes, in rising order.
    #[must_use]
    pub fn known(&self) -> Vec<usize> {
        (0..self.units.len()).filter(|unit| self.of(*unit).is_some()).collect()
    }

    /// How well a demand fits each candidate, in their order. Sizes and places are judged among the candidates, since the small red
    /// one is small among the red ones. A single candidate is judged among all units.
    #[must_use]
    pub fn memberships(&self, constraint: &Constraint, candidates: &[usize]) -> Vec<f64> {
        match &constraint.look {
            Look::BasicColor(name) => self.each(candidates, |a| basic_color(name, a.color)),
            Look::Color(color) => self.each(candidates, |a| {
                let apart = distance(sg_color::oklab(*color), sg_color::oklab(a.color));
                ramp(f64::from(apart), 0.25, 0.05)
            }),
            Look::Quality(quality) if constraint.superlative => self.most(*quality, candidates),
            Look::Quality(quality) if quality.is_absolute() => self.each(candidates, |a| self.absolute(*quality, a)),
            Look::Quality(quality) => self.relative(*quality, candidates),
        }
    }

    fn each(&self, candidates: &[usize], fit: impl Fn(&Attributes) -> f64) -> Vec<f64> {
        candidates.iter().map(|unit| self.of(*unit).map_or(0.0, &fit)).collect()
    }

    /// Membership in a quality of one unit alone. Each ramp passes [`FITS`] in its middle.
    fn absolute(&self, quality: Quality, a: &Attributes) -> f64 {
        let long = ramp(a.elongation(), 0.35, 0.85);
        let flat = ramp(a.flatness(), 0.35, 0.85);
        match quality {
            Quality::Long => long,
            Quality::Flat => flat,
            Quality::Thin => long.max(flat),
            Quality::Thick => 1.0 - long.max(flat),
            Quality::Round => ramp(a.roundness(), 0.25, 0.85),
            Quality::Tall => ramp(self.upright(a), 0.8, 1.8),
            Quality::Transparent => ramp(a.opacity, 0.7, 0.1),
            Quality::Opaque => ramp(a.opacity, 0.4, 0.8),
            Quality::Dark => ramp(lightness(a), 0.6, 0.3),
            Quality::Bright => ramp(lightness(a), 0.6, 0.9),
            _ => 0.0,
        }
    }

    /// Extent upwards over that across.
    fn upright(&self, a: &Attributes) -> f64 {
        let along = |direction| a.deviation_along(direction);
        let across = along(self.frame.right()).max(along(self.frame.front()));
        if across > 0.0 { along(self.frame.up()) / across } else { f64::from(along(self.frame.up()) > 0.0) * 10.0 }
    }

    /// Memberships in a quality that depends on the others.
    fn relative(&self, quality: Quality, candidates: &[usize]) -> Vec<f64> {
        let among: Vec<usize> = if candidates.iter().filter(|c| self.of(**c).is_some()).count() > 1 {
            candidates.to_vec()
        } else {
            (0..self.units.len()).collect()
        };
        match quality {
            Quality::Large | Quality::Small | Quality::Dense | Quality::Sparse => {
                let value = |unit: &usize| self.of(*unit).map(|a| self.amount(quality, a).max(1e-300).ln());
                let known: Vec<f64> = among.iter().filter_map(value).filter(|v| v.is_finite()).collect();
                let least = known.iter().copied().fold(f64::INFINITY, f64::min);
                let most = known.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                let differ = most - least > SIZES_DIFFER.ln();
                let share = |v: f64| if differ { ((v - least) / (most - least)).clamp(0.0, 1.0) } else { FITS };
                candidates.iter().map(|unit| value(unit).map_or(0.0, share)).collect()
            }
            Quality::Middle => {
                let range = if among.len() > 2 { self.range_of(&among) } else { self.range };
                let middle = |p: DVec3| 1.0 - relative_place(p, range).abs().max_element().min(1.0);
                candidates.iter().map(|unit| self.place(*unit).map_or(0.0, middle)).collect()
            }
            _ => {
                let Some(direction) = direction(quality) else { return vec![0.0; candidates.len()] };
                let extent = |(least, most): (DVec3, DVec3)| (most - least).dot(direction).abs();
                let own = self.range_of(&among);
                let range = if extent(own) > SIDES_DIFFER * extent(self.range) { own } else { self.range };
                let side = |p: DVec3| FITS + (relative_place(p, range).dot(direction) - SIDE) / (2.0 - 2.0 * SIDE);
                candidates.iter().map(|unit| self.place(*unit).map_or(0.0, |p| side(p).clamp(0.0, 1.0))).collect()
            }
        }
    }

    /// 1 for the candidate that has most of a quality, and for those as good as it; less than [`FITS`] for the others.
    fn most(&self, quality: Quality, candidates: &[usize]) -> Vec<f64> {
        if direction(quality).is_some() || quality == Quality::Middle {
            let all = self.relative(quality, candidates);
            let best = all.iter().copied().fold(0.0, f64::max);
            return all.into_iter().map(|m| if m >= best - 0.02 { 1.0 } else { 0.8 * FITS * m }).collect();
        }
        let values: Vec<f64> = self.each(candidates, |a| self.amount(quality, a));
        let best = values.iter().copied().fold(0.0, f64::max);
        values.into_iter().map(|v| if v >= (1.0 - TIE) * best { 1.0 } else { 0.8 * FITS * v / best }).collect()
    }

    /// How much of a quality a unit has, on any scale above 0.
    fn amount(&self, quality: Quality, a: &Attributes) -> f64 {
        let tiny = f64::MIN_POSITIVE;
        match quality {
            Quality::Large => a.size(),
            Quality::Small => 1.0 / a.size().max(tiny),
            Quality::Long => a.deviations[0],
            Quality::Thin => 1.0 / a.deviations[2].max(tiny),
            Quality::Thick => a.deviations[2],
            Quality::Tall => a.deviation_along(self.frame.up()),
            Quality::Dense => a.density(),
            Quality::Sparse => 1.0 / a.density().max(tiny),
            Quality::Flat => a.flatness(),
            Quality::Round => a.roundness(),
            Quality::Transparent => 1.0 - a.opacity,
            Quality::Opaque => a.opacity,
            Quality::Dark => 1.0 - lightness(a),
            Quality::Bright => lightness(a),
            _ => 0.0,
        }
    }

    fn place(&self, unit: usize) -> Option<DVec3> {
        self.places.get(unit).copied().flatten()
    }

    fn range_of(&self, units: &[usize]) -> (DVec3, DVec3) {
        range(units.iter().filter_map(|unit| self.place(*unit)))
    }
}

/// The direction of a place in coordinates along right, up and front.
fn direction(quality: Quality) -> Option<DVec3> {
    Some(match quality {
        Quality::Left => DVec3::NEG_X,
        Quality::Right => DVec3::X,
        Quality::Top => DVec3::Y,
        Quality::Bottom => DVec3::NEG_Y,
        Quality::Front => DVec3::Z,
        Quality::Back => DVec3::NEG_Z,
        _ => return None,
    })
}

fn range(places: impl Iterator<Item = DVec3>) -> (DVec3, DVec3) {
    places.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(least, most), p| (least.min(p), most.max(p)))
}

/// −1 to 1 on each axis of a range; 0 where it has no extent.
fn relative_place(p: DVec3, (least, most): (DVec3, DVec3)) -> DVec3 {
    let (middle, half) = (0.5 * (least + most), 0.5 * (most - least));
    DVec3::from_array(std::array::from_fn(|k| if half[k] > 0.0 { (p[k] - middle[k]) / half[k] } else { 0.0 }))
}

/// 0 at `from` and before, 1 at `to` and beyond, linear between; `to` may be less than `from`.
fn ramp(x: f64, from: f64, to: f64) -> f64 {
    ((x - from) / (to - from)).clamp(0.0, 1.0)
}

fn lightness(a: &Attributes) -> f64 {
    f64::from(sg_color::oklab(a.color)[0])
}

fn distance(a: [f32; 3], b: [f32; 3]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f32>().sqrt()
}

/// How well a basic colour's name fits a colour: by how much nearer another basic colour is in Oklab.
fn basic_color(name: &str, color: [f32; 3]) -> f64 {
    let (own, nearest) = sg_color::basic_distances(name, color);
    ramp(f64::from(own - nearest), 0.07, 0.0)
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use crate::attributes::quality::constraint;

    fn unit(center: DVec3, deviations: DVec3, color: [f32; 3], opacity: f64) -> Option<Attributes> {
        let mut sorted = deviations.to_array();
        sorted.sort_by(|a, b| b.total_cmp(a));
        let covariance = DMat3::from_diagonal(deviations * deviations);
        Some(Attributes { count: 100, center, covariance, deviations: sorted, color, opacity })
    }

    const RED: [f32; 3] = [0.9, 0.1, 0.1];
    const BLUE: [f32; 3] = [0.1, 0.2, 0.9];

    fn looks() -> Looks {
        let units = vec![
            unit(DVec3::new(-5.0, 0.0, 0.0), DVec3::splat(3.0), RED, 0.9),
            unit(DVec3::new(5.0, 0.0, 0.0), DVec3::splat(1.0), RED, 0.9),
            unit(DVec3::new(0.0, 5.0, 0.0), DVec3::new(8.0, 0.5, 0.5), BLUE, 0.1),
            unit(DVec3::new(0.0, -5.0, 1.0), DVec3::new(12.0, 0.3, 12.0), BLUE, 0.9),
            None,
        ];
        Looks::new(units, Frame::XYZ)
    }

    fn fitting(text: &str, candidates: &[usize]) -> Vec<usize> {
        let words: Vec<&str> = text.split(' ').collect();
        let (constraint, taken) = constraint(&words).unwrap();
        assert_eq!(taken, words.len(), "{text}");
        let memberships = looks().memberships(&constraint, candidates);
        assert!(memberships.iter().all(|m| (0.0..=1.0).contains(m)), "{text}: {memberships:?}");
        candidates.iter().zip(memberships).filter(|(_, m)| *m >= FITS).map(|(c, _)| *c).collect()
    }

    #[test]
    fn words_fit_the_units_that_look_like_them() {
        let all = [0, 1, 2, 3, 4];
        for (text, expected) in [
            ("red", vec![0, 1]),
            ("blue", vec![2, 3]),
            ("green", vec![]),
            ("round", vec![0, 1]),
            ("long", vec![2]),
            ("thin", vec![2, 3]),
            ("flat", vec![3]),
            ("transparent", vec![2]),
            ("opaque", vec![0, 1, 3]),
            ("left", vec![0]),
            ("right", vec![1]),
            ("top", vec![2]),
            ("bottom", vec![3]),
            ("leftmost", vec![0]),
            ("smallest", vec![1]),
            ("longest", vec![3]),
            ("thinnest", vec![3]),
            ("navy", vec![]),
        ] {
            assert_eq!(fitting(text, &all), expected, "{text}");
        }
        assert_eq!(fitting("large", &[0, 1]), [0]);
        assert_eq!(fitting("small", &[0, 1]), [1]);
        assert_eq!(fitting("largest", &[0, 1]), [0]);
        assert_eq!(fitting("largest", &[1, 1]), [1, 1], "equally large");
        assert_eq!(fitting("left", &[1]), [0_usize; 0], "a single candidate is judged among all");
        assert_eq!(fitting("red", &[4]), [0_usize; 0], "without attributes nothing fits");
    }
}
