//! Words that describe the look of a unit.

use crate::attributes::judge::{FITS, Looks};
use crate::attributes::quality::{Constraint, Look, Quality};

/// Least membership of a word that is said without being asked for.
const CLEAR: f64 = 0.6;
/// Least membership of "in the middle".
const CENTRAL: f64 = 0.75;
/// Most places that are said: "on the left" and "at the top".
const MAX_PLACES: usize = 2;
/// Least range of the centres along an axis on which places are said, as a share of the greatest range.
const APART: f64 = 0.25;

const SHAPES: [(Quality, &str); 3] = [(Quality::Long, "long"), (Quality::Flat, "flat"), (Quality::Round, "round")];
const PLACES: [(Quality, &str); 6] = [
    (Quality::Left, "on the left"),
    (Quality::Right, "on the right"),
    (Quality::Top, "at the top"),
    (Quality::Bottom, "at the bottom"),
    (Quality::Front, "at the front"),
    (Quality::Back, "at the back"),
];

/// Words for the look of `unit`, the colour first: "dark red", "the largest", "long", "on the left". Sizes and places are those
/// among all units with attributes. A unit without attributes has none.
#[must_use]
pub fn describing(looks: &Looks, unit: usize) -> Vec<String> {
    let Some(attributes) = looks.of(unit) else { return Vec::new() };
    let among = looks.known();
    let membership = |quality, superlative| {
        let constraint = Constraint { look: Look::Quality(quality), superlative, words: String::new() };
        let memberships = looks.memberships(&constraint, &among);
        among.iter().position(|other| *other == unit).and_then(|at| memberships.get(at).copied()).unwrap_or_default()
    };
    let mut words = vec![sg_color::name_of(attributes.color).to_owned()];
    if among.len() > 1 {
        let sizes = [(Quality::Large, "the largest"), (Quality::Small, "the smallest")];
        let sizes = sizes.map(|(quality, word)| (membership(quality, true) >= FITS, word));
        // All units are equally large where both fit.
        if let [(true, word), (false, _)] | [(false, _), (true, word)] = sizes {
            words.push(word.to_owned());
        }
    }
    let shape = SHAPES.map(|(quality, word)| (membership(quality, false), word));
    let shape = shape.into_iter().filter(|(fit, _)| *fit >= CLEAR).max_by(|a, b| a.0.total_cmp(&b.0));
    words.extend(shape.map(|(_, word)| word.to_owned()));
    if membership(Quality::Transparent, false) >= CLEAR {
        words.push("transparent".to_owned());
    }
    if among.len() > 1 {
        let extent = looks.extent();
        let axes = [extent.x, extent.x, extent.y, extent.y, extent.z, extent.z];
        let apart = PLACES.into_iter().zip(axes).filter(|(_, along)| *along >= APART * extent.max_element());
        let fits = apart.map(|((quality, word), _)| (membership(quality, false), word));
        let mut places: Vec<(f64, &str)> = fits.filter(|(fit, _)| *fit >= CLEAR).collect();
        places.sort_by(|a, b| b.0.total_cmp(&a.0));
        if places.is_empty() && membership(Quality::Middle, false) >= CENTRAL {
            words.push("in the middle".to_owned());
        }
        words.extend(places.into_iter().take(MAX_PLACES).map(|(_, word)| word.to_owned()));
    }
    words
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::attributes::{Attributes, Gaussian};
    use crate::frame::Frame;

    fn unit(center: DVec3, half: DVec3, color: [f32; 3], opacity: f32) -> Option<Attributes> {
        let corners = (0..8).map(|k| {
            let side = |bit: i32| f64::from(2 * (k >> bit & 1) - 1);
            let position = center + half * DVec3::new(side(0), side(1), side(2));
            Gaussian { position, color, opacity, deviation: 0.01, area: 0.0 }
        });
        Attributes::of(corners).ok()
    }

    #[test]
    fn words_say_colour_size_shape_and_place() {
        let units = vec![
            unit(DVec3::new(-5.0, 0.0, 0.0), DVec3::splat(2.0), [0.8, 0.1, 0.1], 0.9),
            unit(DVec3::new(5.0, 0.1, 0.0), DVec3::new(0.1, 3.0, 0.1), [0.1, 0.2, 0.9], 0.9),
            unit(DVec3::new(0.0, 0.05, 0.0), DVec3::new(1.0, 1.0, 0.01), [1.0, 1.0, 1.0], 0.1),
            None,
        ];
        let looks = Looks::new(units, Frame::XYZ);
        let said = |unit| describing(&looks, unit).join(", ");
        assert_eq!(said(0), "red, the largest, round, on the left");
        assert!(said(1).contains("long") && said(1).ends_with("on the right"), "{}", said(1));
        assert!(said(2).contains("flat, transparent") && said(2).ends_with("in the middle"), "{}", said(2));
        assert_eq!(said(3), "");
        let alone = Looks::new(vec![unit(DVec3::ZERO, DVec3::ONE, [0.0; 3], 1.0)], Frame::XYZ);
        assert_eq!(describing(&alone, 0), ["black", "round"]);
    }

    #[test]
    fn equal_units_are_neither_largest_nor_smallest() {
        let at = |x| unit(DVec3::X * x, DVec3::ONE, [0.5; 3], 1.0);
        let looks = Looks::new(vec![at(0.0), at(9.0)], Frame::XYZ);
        assert!(describing(&looks, 0).iter().all(|word| !word.contains("est")), "{:?}", describing(&looks, 0));
    }
}
