//! Colours that units give to Gaussians which have light and dark places of their own.

use glam::DVec3;

/// Rec. 709 weights of brightness.
pub const BRIGHTNESS: DVec3 = DVec3::new(0.2126, 0.7152, 0.0722);

/// Range of the factor of [`recolored`] and [`recolored_unlit`].
pub const KEPT: [f64; 2] = [0.5, 1.5];

/// Least brightness of a palette colour that offsets are compared with.
const DARKEST: f64 = 1.0 / 256.0;

/// The colour `given` to a Gaussian of colour `own` in a base unit of colour `palette`. It is brighter or darker by the ratio of the
/// own colour to the palette's, from ½ to 3/2. So a recoloured structure keeps its light and dark places.
#[must_use]
pub fn recolored(given: DVec3, own: DVec3, palette: DVec3) -> DVec3 {
    let mean = palette.dot(BRIGHTNESS);
    let factor = if mean > DARKEST { own.dot(BRIGHTNESS) / mean } else { 1.0 + 0.0 * own.dot(BRIGHTNESS) };
    given * factor.clamp(KEPT[0], KEPT[1])
}

/// The colour `given` to a Gaussian without shading columns that looks like `own` from the eye: a photographed surface of middle
/// brightness takes the colour itself.
#[must_use]
pub fn recolored_unlit(given: DVec3, own: DVec3) -> DVec3 {
    given * (KEPT[0] + own.dot(BRIGHTNESS)).clamp(KEPT[0], KEPT[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recoloured_structure_keeps_its_light_and_dark_places() {
        let (red, palette) = (DVec3::new(0.8, 0.2, 0.2), DVec3::splat(0.4));
        let of = |own: f64| recolored(red, DVec3::splat(own), palette);
        assert!((of(0.4) - red).length() < 1e-12);
        assert!((of(0.5) - 1.25 * red).length() < 1e-12 && (of(0.3) - 0.75 * red).length() < 1e-12);
        // Its hue is the given one, whatever hue its own colour has.
        let leaf = recolored(red, DVec3::new(0.2, 0.5, 0.1), palette);
        assert!(leaf.cross(red).length() < 1e-12 && leaf.length() > red.length());
        assert_eq!((of(0.0), of(4.0)), (0.5 * red, 1.5 * red));
        assert_eq!(recolored(red, DVec3::ONE, DVec3::ZERO), red, "a black palette has no darker places");
        assert!(
            !recolored(red, DVec3::NAN, palette).is_finite() && !recolored(red, DVec3::NAN, DVec3::ZERO).is_finite()
        );
        assert!((recolored_unlit(red, DVec3::splat(0.5)) - red).length() < 1e-12);
        assert!((recolored_unlit(red, DVec3::splat(0.1)) - 0.6 * red).length() < 1e-12);
        assert!((recolored_unlit(red, DVec3::splat(9.0)) - 1.5 * red).length() < 1e-12);
    }
}
