//! Numbers that commands bring: finite, and within their range.

use glam::Vec3;
use sg_proto::scene::{Color, Vector};

use super::error::EditError;
use super::wire::{WireError, decode_color, decode_vector};

/// Largest factor that an opacity or a shading term may be given.
pub(super) const MAX_FACTOR: f32 = 1e6;

/// A factor: finite, at least 0.
pub(super) fn factor(value: f32, field: &'static str) -> Result<f32, EditError> {
    if !value.is_finite() {
        return Err(EditError::NotFinite { field, found: value.into() });
    }
    if !(0.0..=MAX_FACTOR).contains(&value) {
        return Err(EditError::OutOfRange { field, found: value.into(), want: "at least 0 and at most a million" });
    }
    // Minus zero is zero: the two must not be different states.
    Ok(value + 0.0)
}

/// A colour: RGB, 0 to 1.
pub(super) fn color(value: &Color, field: &'static str) -> Result<Vec3, EditError> {
    for x in [value.red, value.green, value.blue] {
        if !x.is_finite() {
            return Err(EditError::NotFinite { field, found: x.into() });
        }
        if !(0.0..=1.0).contains(&x) {
            return Err(EditError::OutOfRange { field, found: x.into(), want: "0 to 1 for red, green and blue" });
        }
    }
    Ok(decode_color(value) + Vec3::ZERO)
}

/// A direction: finite, of some length.
pub(super) fn direction(value: &Vector, field: &'static str) -> Result<Vec3, EditError> {
    let v = decode_vector(value);
    for x in v.to_array() {
        if !x.is_finite() {
            return Err(EditError::NotFinite { field, found: x });
        }
    }
    // Scaled by its largest part first: the square of a long or short vector leaves f64.
    let largest = v.abs().max_element();
    let Some(unit) = (v / largest).try_normalize() else {
        return Err(EditError::OutOfRange { field, found: largest, want: "a direction of some length" });
    };
    // Vectors that fit in f32 keep their bits; others keep their direction.
    let narrow = v.as_vec3();
    Ok(if narrow.is_finite() && narrow.length() > 0.0 { narrow } else { unit.as_vec3() })
}

/// A message's complaint as the refusal of a command.
pub(super) fn malformed(error: &WireError) -> EditError {
    EditError::Malformed { field: error.field(), reason: error.to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_finite_numbers_in_range_pass() {
        assert_eq!(factor(0.2, "f"), Ok(0.2));
        assert_eq!(factor(-0.0, "f").map(f32::to_bits), Ok(0.0_f32.to_bits()));
        for bad in [f32::NAN, f32::INFINITY, -1e-9, 2e6] {
            assert!(factor(bad, "f").is_err(), "{bad}");
        }
        let with = |red| color(&Color { red, green: 0.5, blue: 1.0 }, "c");
        assert_eq!(with(0.0), Ok(Vec3::new(0.0, 0.5, 1.0)));
        assert!(with(1.01).is_err() && with(-0.01).is_err() && with(f32::NAN).is_err());
    }

    #[test]
    fn directions_survive_any_length() {
        let at = |x| direction(&Vector { x, y: 0.0, z: 0.0 }, "d");
        assert_eq!(at(3.0), Ok(Vec3::new(3.0, 0.0, 0.0)));
        assert_eq!(at(1e200), Ok(Vec3::X));
        assert_eq!(at(1e-60), Ok(Vec3::X));
        assert!(at(0.0).is_err() && at(f64::NAN).is_err() && at(f64::INFINITY).is_err());
    }
}
