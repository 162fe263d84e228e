//! Similarity transforms: rotation, uniform scale and translation, in f64.

use glam::{DMat4, DQuat, DVec3};

/// The map x ↦ s·R·x + t of a frame onto itself.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Similarity {
    /// R, of unit length.
    pub rotation: DQuat,
    /// s, above 0.
    pub scale: f64,
    /// t, in the length unit of the frame.
    pub translation: DVec3,
}

impl Similarity {
    /// The map that changes nothing.
    pub const IDENTITY: Self = Self { rotation: DQuat::IDENTITY, scale: 1.0, translation: DVec3::ZERO };

    /// Turns and scales about `pivot`, then moves by `shift`: x ↦ pivot + s·R·(x − pivot) + shift.
    #[must_use]
    pub fn about(pivot: DVec3, rotation: DQuat, scale: f64, shift: DVec3) -> Self {
        let linear = Self { rotation, scale, translation: DVec3::ZERO };
        // Without a turn, a pivot would only bring its rounding.
        let moved = if rotation == DQuat::IDENTITY && scale == 1.0 { DVec3::ZERO } else { pivot - linear.apply(pivot) };
        Self { translation: moved + shift, ..linear }
    }

    /// The image of a point.
    #[must_use]
    pub fn apply(&self, point: DVec3) -> DVec3 {
        self.scale * (self.rotation * point) + self.translation
    }

    /// This map, then `later`.
    #[must_use]
    pub fn then(&self, later: &Self) -> Self {
        Self {
            rotation: (later.rotation * self.rotation).normalize(),
            scale: later.scale * self.scale,
            translation: later.apply(self.translation),
        }
    }

    /// The map back.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let back = Self { rotation: self.rotation.conjugate(), scale: self.scale.recip(), translation: DVec3::ZERO };
        Self { translation: -back.apply(self.translation), ..back }
    }

    /// The map as a matrix.
    #[must_use]
    pub fn matrix(&self) -> DMat4 {
        DMat4::from_scale_rotation_translation(DVec3::splat(self.scale), self.rotation, self.translation)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn similarity() -> impl Strategy<Value = Similarity> {
        let three = || prop::array::uniform3(-2.0..2.0_f64).prop_map(DVec3::from_array);
        (three(), three(), -3.0..3.0_f64, -1.0..1.0_f64).prop_map(|(pivot, shift, angle, scale)| {
            let axis = pivot.try_normalize().unwrap_or(DVec3::Z);
            Similarity::about(pivot, DQuat::from_axis_angle(axis, angle), scale.exp(), shift)
        })
    }

    proptest! {
        #[test]
        fn maps_compose_and_go_back(a in similarity(), b in similarity(), p in prop::array::uniform3(-2.0..2.0_f64)) {
            let p = DVec3::from_array(p);
            prop_assert!((a.then(&b).apply(p) - b.apply(a.apply(p))).length() < 1e-12);
            prop_assert!((a.inverse().apply(a.apply(p)) - p).length() < 1e-12);
            prop_assert!((a.matrix().transform_point3(p) - a.apply(p)).length() < 1e-12);
            prop_assert!((a.then(&a.inverse()).apply(p) - p).length() < 1e-12);
        }
    }

    #[test]
    fn the_pivot_stays_where_it_is_and_a_pure_shift_is_exact() {
        let pivot = DVec3::new(1e5, -3.0, 0.1);
        let turn = Similarity::about(pivot, DQuat::from_rotation_z(1.0), 2.0, DVec3::ZERO);
        assert!((turn.apply(pivot) - pivot).length() < 1e-9);
        let shift = DVec3::new(0.1, 0.2, 0.3);
        assert_eq!(Similarity::about(pivot, DQuat::IDENTITY, 1.0, shift).translation, shift);
        assert_eq!(Similarity::about(pivot, DQuat::IDENTITY, 1.0, DVec3::ZERO), Similarity::IDENTITY);
    }
}
