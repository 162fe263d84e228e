//! Operations on a selection: set operations, regions, attribute ranges, connected pieces and similarity.
//!
//! An operation maps a mask to a mask and depends only on the scene. Operations and strokes mix freely; [`crate::session`]
//! defines their order. Lengths are fractions of the scene box's longest edge. Points are normalized by the box, as for
//! strokes. Gaussians without a finite position belong to no region and no piece. [`Operation::Grow`] and
//! [`Operation::Invert`] never select them.

use sg_scene::camera::Camera;

/// Combination of the found Gaussians with the selection.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Combine {
    /// Union.
    #[default]
    Add,
    /// Difference: the selection without the found Gaussians.
    Remove,
    /// Intersection.
    Intersect,
    /// The found Gaussians alone.
    Replace,
}

/// A scalar attribute of a Gaussian.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Attribute {
    /// Peak opacity as in the file, 0 to 1.
    Opacity,
    /// Geometric mean of the three standard deviations, as a fraction of the scene box's longest edge.
    Scale,
    /// Red of the stored colour: palette plus offset, or the constant term of the harmonics.
    Red,
    /// Green of the stored colour.
    Green,
    /// Blue of the stored colour.
    Blue,
}

/// One operation.
#[derive(Debug, Clone, PartialEq)]
pub enum Operation {
    /// Inverts the selection in every base unit with a selected Gaussian. An empty selection is inverted in all units.
    Invert,
    /// Selects every Gaussian whose centre is closer than `distance` to a selected centre of the same base unit.
    Grow {
        /// Fraction of the box's longest edge.
        distance: f64,
    },
    /// Deselects every Gaussian whose centre is closer than `distance` to an unselected centre of the same base unit.
    Shrink {
        /// Fraction of the box's longest edge.
        distance: f64,
    },
    /// Selects the unselected pieces of at most `most` Gaussians that touch the selection. A piece is connected over the
    /// neighbour graph.
    FillHoles {
        /// Number of Gaussians of the largest filled hole.
        most: usize,
    },
    /// Keeps the largest pieces of the selection. Ties go to the piece with the smallest index.
    LargestPieces {
        /// Number of pieces.
        keep: usize,
    },
    /// Keeps the piece of the selection with the Gaussian nearest to a point.
    PieceAt {
        /// Normalized by the scene's box.
        at: [f64; 3],
    },
    /// Finds similar Gaussians in every base unit with a selected Gaussian. The feature distance to the selection's mean is
    /// at most `threshold` times the root-mean-square distance of the selected Gaussians.
    Similar {
        /// At least 0. At 2 the result is about as varied as the selection itself.
        threshold: f64,
        /// Combination with the selection.
        combine: Combine,
    },
    /// Finds the centres in a closed axis-aligned box.
    Box {
        /// Smallest corner, normalized.
        min: [f64; 3],
        /// Largest corner, normalized.
        max: [f64; 3],
        /// Combination with the selection.
        combine: Combine,
    },
    /// Finds the centres closer than a radius to a point.
    Sphere {
        /// Normalized.
        centre: [f64; 3],
        /// Fraction of the box's longest edge.
        radius: f64,
        /// Combination with the selection.
        combine: Combine,
    },
    /// Finds the centres in the open half-space in front of a plane.
    Plane {
        /// A point of the plane, normalized.
        point: [f64; 3],
        /// Normal in the scene frame, of any length but 0. It points into the half-space.
        normal: [f64; 3],
        /// Combination with the selection.
        combine: Combine,
    },
    /// Finds the centres that project into a polygon (even-odd rule) between two depths. Occlusion is ignored.
    Lasso {
        /// The camera of the polygon.
        camera: Box<Camera>,
        /// Corners in pixels.
        polygon: Vec<[f64; 2]>,
        /// Smallest depth along the view axis, in the scene's length unit.
        near: f64,
        /// Largest depth.
        far: f64,
        /// Combination with the selection.
        combine: Combine,
    },
    /// Finds the Gaussians with an attribute in a closed interval.
    Range {
        /// The attribute.
        attribute: Attribute,
        /// Smallest value.
        min: f64,
        /// Largest value.
        max: f64,
        /// Combination with the selection.
        combine: Combine,
    },
}

/// Most corners of a lasso.
pub const MAX_CORNERS: usize = 10_000;

/// An impossible value of an operation.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum OperationError {
    /// A length is negative or not finite.
    #[error("the {name} is {value}; it must be finite and at least 0")]
    Length {
        /// Name of the value.
        name: &'static str,
        /// The value.
        value: f64,
    },
    /// A point or a direction is not finite.
    #[error("the {name} {value:?} is not finite")]
    NotFinite {
        /// Name of the value.
        name: &'static str,
        /// The coordinates.
        value: Vec<f64>,
    },
    /// An interval ends before it begins.
    #[error("the interval from {min} to {max} is empty; write the smaller number first")]
    EmptyInterval {
        /// First number.
        min: f64,
        /// Second number.
        max: f64,
    },
    /// No piece is kept.
    #[error("0 pieces leave no selection; keep at least 1")]
    NoPieces,
    /// The normal of a plane is zero.
    #[error("the normal has no length")]
    ZeroNormal,
    /// The camera of a lasso is unusable. The text names the field.
    #[error("{0}")]
    Camera(String),
    /// A lasso has too few corners, or too many.
    #[error("a lasso of {0} corners; it must have 3 to {MAX_CORNERS}")]
    Corners(usize),
}

impl Operation {
    /// Checks the values of the operation.
    ///
    /// # Errors
    /// [`OperationError`] with the first wrong value.
    pub fn check(&self) -> Result<(), OperationError> {
        let length = |name, value: f64| match value {
            x if x >= 0.0 && x.is_finite() => Ok(()),
            value => Err(OperationError::Length { name, value }),
        };
        let finite = |name, p: &[f64]| match p {
            p if p.iter().all(|x| x.is_finite()) => Ok(()),
            p => Err(OperationError::NotFinite { name, value: p.to_vec() }),
        };
        let interval =
            |min: f64, max: f64| if min <= max { Ok(()) } else { Err(OperationError::EmptyInterval { min, max }) };
        match self {
            Self::Invert | Self::FillHoles { .. } => Ok(()),
            Self::Grow { distance } | Self::Shrink { distance } => length("distance", *distance),
            Self::LargestPieces { keep: 0 } => Err(OperationError::NoPieces),
            Self::LargestPieces { .. } => Ok(()),
            Self::PieceAt { at } => finite("point", at),
            Self::Similar { threshold, .. } => length("threshold", *threshold),
            Self::Box { min, max, .. } => {
                finite("corner", min)?;
                finite("corner", max)?;
                min.iter().zip(max).try_for_each(|(a, b)| interval(*a, *b))
            }
            Self::Sphere { centre, radius, .. } => {
                finite("centre", centre)?;
                length("radius", *radius)
            }
            Self::Plane { point, normal, .. } => {
                finite("point", point)?;
                finite("normal", normal)?;
                let is_zero = normal.iter().all(|x| *x == 0.0);
                if is_zero { Err(OperationError::ZeroNormal) } else { Ok(()) }
            }
            Self::Lasso { camera, polygon, near, far, .. } => {
                camera.check("lasso").map_err(|e| OperationError::Camera(e.to_string()))?;
                if polygon.len() < 3 || polygon.len() > MAX_CORNERS {
                    return Err(OperationError::Corners(polygon.len()));
                }
                if let Some(bad) = polygon.iter().find(|c| !c.iter().all(|x| x.is_finite())) {
                    return Err(OperationError::NotFinite { name: "corner", value: bad.to_vec() });
                }
                interval(*near, *far)
            }
            Self::Range { min, max, .. } => interval(*min, *max),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrong_values_are_named() {
        let combine = Combine::Add;
        for (operation, part) in [
            (Operation::Grow { distance: -1.0 }, "the distance is -1"),
            (Operation::LargestPieces { keep: 0 }, "keep at least 1"),
            (Operation::Box { min: [0.0, 0.0, 1.0], max: [1.0, 1.0, 0.0], combine }, "from 1 to 0 is empty"),
            (Operation::Plane { point: [0.0; 3], normal: [0.0; 3], combine }, "the normal has no length"),
            (
                Operation::Range { attribute: Attribute::Red, min: 1.0, max: 0.0, combine },
                "write the smaller number first",
            ),
            (Operation::PieceAt { at: [0.0, f64::NAN, 0.0] }, "the point [0.0, NaN, 0.0] is not finite"),
        ] {
            let message = operation.check().unwrap_err().to_string();
            assert!(message.contains(part), "{message}");
        }
    }
}
