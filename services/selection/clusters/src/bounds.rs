//! Axis-aligned boxes, f64, in the frame of the points.

/// An axis-aligned box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Smallest corner.
    pub min: [f64; 3],
    /// Largest corner.
    pub max: [f64; 3],
}

impl Bounds {
    /// The empty box.
    pub const EMPTY: Self = Self { min: [f64::INFINITY; 3], max: [f64::NEG_INFINITY; 3] };

    /// Extends the box by a point.
    pub fn add(&mut self, p: &[f64; 3]) {
        *self = self.union(&Self { min: *p, max: *p });
    }

    /// The smallest box around two boxes.
    #[must_use]
    pub fn union(&self, other: &Self) -> Self {
        Self {
            min: std::array::from_fn(|a| self.min[a].min(other.min[a])),
            max: std::array::from_fn(|a| self.max[a].max(other.max[a])),
        }
    }

    /// Squared distance between two boxes, zero if they overlap.
    #[must_use]
    pub fn distance_squared(&self, other: &Self) -> f64 {
        (0..3)
            .map(|a| {
                let gap = (self.min[a] - other.max[a]).max(other.min[a] - self.max[a]).max(0.0);
                gap * gap
            })
            .sum()
    }

    /// Squared distance to a point.
    #[must_use]
    pub fn point_distance_squared(&self, p: &[f64; 3]) -> f64 {
        self.distance_squared(&Self { min: *p, max: *p })
    }
}
