//! What can be done to a selection beside brushing: set operations, regions, ranges, pieces, likeness.
//!
//! An operation turns a mask into a mask and depends on nothing else but the scene, so operations and strokes can be drawn
//! in any order (see [`crate::session`] for the order in which they count). Lengths are fractions of the scene box's
//! longest edge and places are normalized by the box, as for strokes. Gaussians without a finite position belong to no
//! region and no piece, are grown into by nothing, and are never selected by [`Operation::Invert`].

use serde::{Deserialize, Serialize};
use sg_scene::camera::Camera;

/// How what an operation finds is combined with what is selected.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Combine {
    /// Selected is what was selected or is found.
    #[default]
    Add,
    /// Selected is what was selected and is not found.
    Remove,
    /// Selected is what was selected and is found.
    Intersect,
    /// Selected is what is found.
    Replace,
}

/// A number that every Gaussian has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Attribute {
    /// Peak opacity as in the file, 0 to 1.
    Opacity,
    /// Geometric mean of the three standard deviations, as a fraction of the scene box's longest edge.
    Scale,
    /// Red of its own colour as stored: palette and offset, or the constant term of its harmonics; likewise the others.
    Red,
    /// Green.
    Green,
    /// Blue.
    Blue,
}

/// One operation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "operation", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Operation {
    /// Selects what is not selected and takes away what is, in every base unit in which something is selected; in all of
    /// them where nothing is.
    Invert,
    /// Selects whatever is closer than this to the centre of something selected of the same base unit.
    Grow {
        /// Fraction of the box's longest edge.
        distance: f64,
    },
    /// Takes away whatever is closer than this to the centre of something unselected of the same base unit.
    Shrink {
        /// Fraction of the box's longest edge.
        distance: f64,
    },
    /// Selects the unselected pieces of at most `most` Gaussians that touch the selection. A piece is connected over the
    /// neighbour graph.
    FillHoles {
        /// Largest hole.
        most: usize,
    },
    /// Keeps the largest pieces of the selection; of equal ones that with the smallest index.
    LargestPieces {
        /// How many.
        keep: usize,
    },
    /// Keeps the piece of the selection whose Gaussian is nearest to a point.
    PieceAt {
        /// Normalized by the scene's box.
        at: [f64; 3],
    },
    /// Finds, in every base unit in which something is selected, what is like the selection: features no farther from
    /// their mean over the selection than `threshold` times their root-mean-square distance from it there.
    Similar {
        /// At least 0; 2 is about as unlike as what is selected.
        threshold: f64,
        /// With what was selected.
        #[serde(default)]
        combine: Combine,
    },
    /// Finds the centres in a box along the axes, its faces included.
    Box {
        /// Least corner, normalized.
        min: [f64; 3],
        /// Greatest corner, normalized.
        max: [f64; 3],
        /// With what was selected.
        #[serde(default)]
        combine: Combine,
    },
    /// Finds the centres closer than a radius to a point.
    Sphere {
        /// Normalized.
        centre: [f64; 3],
        /// Fraction of the box's longest edge.
        radius: f64,
        /// With what was selected.
        #[serde(default)]
        combine: Combine,
    },
    /// Finds the centres on the side of a plane to which its normal points, the plane excluded.
    Plane {
        /// A point of it, normalized.
        point: [f64; 3],
        /// In the scene frame, of any length but 0.
        normal: [f64; 3],
        /// With what was selected.
        #[serde(default)]
        combine: Combine,
    },
    /// Finds the centres that a camera sees within a polygon (even-odd rule) and between two depths, hidden or not.
    Lasso {
        /// The camera through which the polygon was drawn.
        camera: Box<Camera>,
        /// Corners in pixels.
        polygon: Vec<[f64; 2]>,
        /// Least depth along the view axis, in the scene's length unit.
        #[serde(default)]
        near: f64,
        /// Greatest depth.
        #[serde(default = "farthest")]
        far: f64,
        /// With what was selected.
        #[serde(default)]
        combine: Combine,
    },
    /// Finds the Gaussians with an attribute between two numbers, both included.
    Range {
        /// Which.
        attribute: Attribute,
        /// Least.
        min: f64,
        /// Greatest.
        max: f64,
        /// With what was selected.
        #[serde(default)]
        combine: Combine,
    },
}

fn farthest() -> f64 {
    f64::MAX
}

/// Most corners of a lasso.
pub const MOST_CORNERS: usize = 10_000;

impl Operation {
    /// Checks that the operation can be done.
    ///
    /// # Errors
    /// What is wrong and what would be right, in words.
    pub fn check(&self) -> Result<(), String> {
        let length = |name: &str, x: f64| match x {
            x if x >= 0.0 && x.is_finite() => Ok(()),
            x => Err(format!("the {name} is {x}; it must be finite and at least 0")),
        };
        let place = |name: &str, p: &[f64; 3]| match p {
            p if p.iter().all(|x| x.is_finite()) => Ok(()),
            p => Err(format!("the {name} {p:?} is not finite")),
        };
        let span = |min: f64, max: f64| match () {
            () if min <= max => Ok(()),
            () => Err(format!("from {min} to {max} there is nothing; write the smaller number first")),
        };
        match self {
            Self::Invert | Self::FillHoles { .. } => Ok(()),
            Self::Grow { distance } | Self::Shrink { distance } => length("distance", *distance),
            Self::LargestPieces { keep: 0 } => Err("0 pieces are none; keep at least 1".to_owned()),
            Self::LargestPieces { .. } => Ok(()),
            Self::PieceAt { at } => place("point", at),
            Self::Similar { threshold, .. } => length("threshold", *threshold),
            Self::Box { min, max, .. } => {
                place("corner", min)?;
                place("corner", max)?;
                min.iter().zip(max).try_for_each(|(a, b)| span(*a, *b))
            }
            Self::Sphere { centre, radius, .. } => {
                place("centre", centre)?;
                length("radius", *radius)
            }
            Self::Plane { point, normal, .. } => {
                place("point", point)?;
                place("normal", normal)?;
                let is_none = normal.iter().all(|x| *x == 0.0);
                if is_none { Err("the normal has no length".to_owned()) } else { Ok(()) }
            }
            Self::Lasso { camera, polygon, near, far, .. } => {
                camera.check("lasso").map_err(|e| e.to_string())?;
                if polygon.len() < 3 || polygon.len() > MOST_CORNERS {
                    return Err(format!("a lasso of {} corners; 3 to {MOST_CORNERS} are needed", polygon.len()));
                }
                if let Some(bad) = polygon.iter().find(|c| !c.iter().all(|x| x.is_finite())) {
                    return Err(format!("the corner {bad:?} is not finite"));
                }
                span(*near, *far)
            }
            Self::Range { min, max, .. } => span(*min, *max),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn operations_are_read_as_they_are_written() {
        let camera = r#"{"width":64,"height":64,"fx":64,"fy":64,"cx":32,"cy":32,"world_to_camera":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1]}"#;
        for text in [
            r#"{"operation":"invert"}"#.to_owned(),
            r#"{"operation":"grow","distance":0.02}"#.to_owned(),
            r#"{"operation":"fill-holes","most":50}"#.to_owned(),
            r#"{"operation":"largest-pieces","keep":1}"#.to_owned(),
            r#"{"operation":"piece-at","at":[0.5,0.5,0.5]}"#.to_owned(),
            r#"{"operation":"similar","threshold":2,"combine":"intersect"}"#.to_owned(),
            r#"{"operation":"box","min":[0,0,0],"max":[1,1,0.5],"combine":"remove"}"#.to_owned(),
            r#"{"operation":"sphere","centre":[0.5,0.5,0.5],"radius":0.1}"#.to_owned(),
            r#"{"operation":"plane","point":[0.5,0.5,0.5],"normal":[0,0,1]}"#.to_owned(),
            format!(r#"{{"operation":"lasso","camera":{camera},"polygon":[[0,0],[9,0],[9,9]]}}"#),
            r#"{"operation":"range","attribute":"opacity","min":0.5,"max":1,"combine":"replace"}"#.to_owned(),
        ] {
            let operation: Operation = serde_json::from_str(&text).unwrap_or_else(|e| panic!("{text}: {e}"));
            assert_eq!(operation.check(), Ok(()), "{text}");
            let again = serde_json::to_string(&operation).unwrap();
            assert_eq!(serde_json::from_str::<Operation>(&again).unwrap(), operation);
        }
    }

    #[test]
    fn what_makes_no_sense_is_named() {
        for (text, part) in [
            (r#"{"operation":"grow","distance":-1}"#, "the distance is -1"),
            (r#"{"operation":"largest-pieces","keep":0}"#, "keep at least 1"),
            (r#"{"operation":"box","min":[0,0,1],"max":[1,1,0]}"#, "from 1 to 0 there is nothing"),
            (r#"{"operation":"plane","point":[0,0,0],"normal":[0,0,0]}"#, "the normal has no length"),
            (r#"{"operation":"range","attribute":"red","min":1,"max":0}"#, "write the smaller number first"),
        ] {
            let operation: Operation = serde_json::from_str(text).unwrap();
            let said = operation.check().unwrap_err();
            assert!(said.contains(part), "{text}: {said}");
        }
        for text in [
            r#"{"operation":"grwo","distance":1}"#,
            r#"{"operation":"grow"}"#,
            r#"{"operation":"grow","distance":1,"x":2}"#,
            r#"{"operation":"range","attribute":"hue","min":0,"max":1}"#,
        ] {
            assert!(serde_json::from_str::<Operation>(text).is_err(), "{text}");
        }
    }
}
