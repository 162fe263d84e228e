//! Saturation, brightness and temperature: changes of colours that keep their pattern.

use glam::DVec3;

use crate::recolor::BRIGHTNESS;

/// A change of colours. With Y the [brightness](BRIGHTNESS) of a colour c, it becomes b·k·(Y + s·(c − Y)) for the factors s on the
/// saturation and b on the brightness. The vector k = (1 + t/2, 1, 1 − t/2) / Y(1 + t/2, 1, 1 − t/2) is that of the temperature t:
/// grey keeps its brightness. Stored colours are used as they are, without a transfer curve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tone {
    /// Factor s on the distance from grey, 0 to 4.
    pub saturation: f32,
    /// Factor b on the brightness, 0 to 4.
    pub brightness: f32,
    /// Temperature t, −1 (blue) to 1 (red).
    pub temperature: f32,
}

impl Default for Tone {
    fn default() -> Self {
        Self::NEUTRAL
    }
}

impl Tone {
    /// No change.
    pub const NEUTRAL: Self = Self { saturation: 1.0, brightness: 1.0, temperature: 0.0 };

    /// Greatest factor on saturation and brightness.
    pub const MOST: f32 = 4.0;

    /// Whether it changes no colour.
    #[must_use]
    pub fn is_neutral(self) -> bool {
        self == Self::NEUTRAL
    }

    /// Both changes together: factors multiply and temperatures add up, each within its range. The order does not matter.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            saturation: (self.saturation * other.saturation).clamp(0.0, Self::MOST),
            brightness: (self.brightness * other.brightness).clamp(0.0, Self::MOST),
            temperature: (self.temperature + other.temperature).clamp(-1.0, 1.0),
        }
    }

    /// The colour that it makes of `color`. It is linear, so that it acts on offsets and coefficients of colours too. Without a
    /// change it returns every bit.
    #[must_use]
    pub fn of(self, color: DVec3) -> DVec3 {
        if self.is_neutral() {
            return color;
        }
        let warmth = 0.5 * f64::from(self.temperature);
        let warm = DVec3::new(1.0 + warmth, 1.0, 1.0 - warmth);
        let grey = DVec3::splat(color.dot(BRIGHTNESS));
        let mixed = grey + f64::from(self.saturation) * (color - grey);
        warm * (f64::from(self.brightness) / warm.dot(BRIGHTNESS)) * mixed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tone(saturation: f32, brightness: f32, temperature: f32) -> Tone {
        Tone { saturation, brightness, temperature }
    }

    #[test]
    fn by_hand() {
        let c = DVec3::new(0.8, 0.4, 0.2);
        let grey = 0.2126 * 0.8 + 0.7152 * 0.4 + 0.0722 * 0.2;
        let near = |got: DVec3, want: [f64; 3]| assert!((got - DVec3::from_array(want)).length() < 1e-9, "{got}");
        near(tone(0.0, 1.0, 0.0).of(c), [grey; 3]);
        near(tone(0.5, 1.0, 0.0).of(c), [0.5 * (0.8 + grey), 0.5 * (0.4 + grey), 0.5 * (0.2 + grey)]);
        near(tone(1.0, 0.5, 0.0).of(c), [0.4, 0.2, 0.1]);
        // (1.25, 1, 0.75) over its brightness.
        let k = 1.25 * 0.2126 + 0.7152 + 0.75 * 0.0722;
        near(tone(1.0, 1.0, 0.5).of(c), [1.25 * 0.8 / k, 0.4 / k, 0.75 * 0.2 / k]);
    }

    #[test]
    fn grey_keeps_its_brightness_and_no_change_keeps_every_bit() {
        for t in [-1.0, -0.3, 0.7, 1.0] {
            let warm = tone(2.0, 1.0, t).of(DVec3::splat(0.6));
            assert!((warm.dot(BRIGHTNESS) - 0.6).abs() < 1e-12, "{t}: {warm}");
        }
        let odd = DVec3::new(0.1 + 0.2, -1e-300, f64::MAX);
        assert_eq!(Tone::NEUTRAL.of(odd).to_array().map(f64::to_bits), odd.to_array().map(f64::to_bits));
        assert!(!tone(0.5, 1.0, 0.0).of(DVec3::NAN).is_finite());
    }

    #[test]
    fn two_changes_are_one_in_any_order() {
        let (a, b) = (tone(0.5, 0.8, 0.2), tone(3.0, 1.5, -0.6));
        assert_eq!(a.and(b), b.and(a));
        let c = DVec3::new(0.7, 0.1, 0.3);
        let apart = tone(0.5, 1.0, 0.0).of(tone(3.0, 1.0, 0.0).of(c));
        assert!((tone(0.5, 1.0, 0.0).and(tone(3.0, 1.0, 0.0)).of(c) - apart).length() < 1e-7);
        assert_eq!(tone(4.0, 4.0, 0.8).and(tone(4.0, 4.0, 0.8)), tone(4.0, 4.0, 1.0));
        assert_eq!(a.and(Tone::NEUTRAL), a);
    }
}
