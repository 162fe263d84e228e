//! Concavity of the contact between two clusters: the crease along which one structure meets another.
//!
//! Where two parts of a surface meet, the surface usually bends inwards (Hoffman and Richards 1984, the minima rule). Let n
//! be the outward unit normal of a Gaussian and x its centre. For a pair (a, b) across the contact,
//! max(0, −(n_a − n_b)·(x_a − x_b) / ‖x_a − x_b‖) is 0 on a flat or convex surface, and at most 2. The concavity c⁺ of a
//! contact is the mean over its nearest pairs. The factor exp(−(c⁺/κ)²) weakens the edge.
//!
//! It needs normals with a sign; [`crate::orientation`] gives them one where the file does not. A Gaussian without a normal
//! adds nothing, so contacts of clusters without normals keep their weights.

use glam::DVec3;
use rayon::prelude::*;

use crate::features::{FeatureKind, Row};
use crate::geometry::UnitGeometry;
use crate::orientation::oriented;

/// Pairs of Gaussians that a contact is judged by: the nearest ones.
const PAIRS: usize = 16;

/// κ: the concavity at which a crease weakens an edge to 1/e.
pub const CREASE: f64 = 0.1;

/// Outward unit normals of the vertices of a unit; zero where there is none.
///
/// Oriented features hold them. For invariant features they are found from the axis of the normal ([`oriented`]). Printed
/// features give none: their normals have the sign of the file, or that of an axis.
#[must_use]
pub fn outward_normals(unit: &UnitGeometry) -> Vec<[f32; 3]> {
    let rows = &unit.features.rows;
    match unit.features.kind {
        FeatureKind::Oriented => rows.par_iter().map(|row| [row[1], row[2], row[3]]).collect(),
        FeatureKind::Invariant => {
            let axes = rows.par_iter().map(axis).collect();
            oriented(&unit.vertices.position, &unit.graph, axes)
        }
        FeatureKind::Printed => Vec::new(),
    }
}

/// The axis ±n of an invariant row, from vech(n nᵀ). Zero where the projector is that of a plane or a ball.
fn axis(row: &Row) -> [f32; 3] {
    let r = std::f32::consts::FRAC_1_SQRT_2;
    let [xx, yy, zz, xy, xz, yz] = [row[1], row[2], row[3], r * row[4], r * row[5], r * row[6]];
    let columns = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
    let sizes = [xx, yy, zz];
    let largest = (0..3).fold(0, |m, a| if sizes[a] > sizes[m] { a } else { m });
    // The square of a projector on a line has trace 1, and that on a plane or a ball a half or less.
    let square: f32 = columns.as_flattened().iter().map(|x| x * x).sum();
    if !(square > 0.8 && sizes[largest] > 0.0) {
        return [0.0; 3];
    }
    columns[largest].map(|x| x / sizes[largest].sqrt())
}

/// −(n_a − n_b)·(x_a − x_b) / ‖x_a − x_b‖ where that is above 0. It is 0 for coincident centres and where a normal is missing.
#[must_use]
pub fn concavity(normals: [[f32; 3]; 2], positions: [[f64; 3]; 2]) -> f64 {
    let [a, b] = normals.map(|n| DVec3::from_array(n.map(f64::from)));
    let [x, y] = positions.map(DVec3::from_array);
    if a == DVec3::ZERO || b == DVec3::ZERO {
        return 0.0;
    }
    // A comparison with NaN is false, so that a broken normal adds nothing.
    match (x - y).try_normalize().map(|along| -(a - b).dot(along)) {
        Some(c) if c > 0.0 => c.min(2.0),
        _ => 0.0,
    }
}

/// Mean concavity of the nearest pairs. Each pair is (distance, concavity), sorted.
#[must_use]
pub fn mean_concavity(sorted: impl Iterator<Item = (f64, f64)>) -> f64 {
    let (sum, count) = sorted.take(PAIRS).fold((0.0, 0.0), |(sum, count), (_, c)| (sum + c, count + 1.0));
    if count > 0.0 { sum / count } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_valley_is_concave_and_a_ridge_is_not() {
        // Two slopes of 45°: normals lean towards each other in a valley.
        let r = std::f32::consts::FRAC_1_SQRT_2;
        let (left, right) = ([-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]);
        let valley = concavity([[r, 0.0, r], [-r, 0.0, r]], [left, right]);
        assert!((valley - std::f64::consts::SQRT_2).abs() < 1e-6, "{valley}");
        assert_eq!(concavity([[-r, 0.0, r], [r, 0.0, r]], [left, right]), 0.0);
        assert_eq!(concavity([[0.0, 0.0, 1.0]; 2], [left, right]), 0.0);
        // The order of the two means nothing.
        assert_eq!(concavity([[-r, 0.0, r], [r, 0.0, r]], [right, left]), valley);
    }

    #[test]
    fn the_axis_of_an_invariant_row_is_the_normal_up_to_its_sign() {
        for n in [[0.0, 0.6, -0.8], [1.0, 0.0, 0.0], [-0.48, 0.64, 0.6_f32]] {
            let s = std::f32::consts::SQRT_2;
            let mut row = Row::default();
            let vech = [n[0] * n[0], n[1] * n[1], n[2] * n[2], s * n[0] * n[1], s * n[0] * n[2], s * n[1] * n[2]];
            row[1..7].copy_from_slice(&vech);
            let found = axis(&row);
            let dot: f32 = found.iter().zip(&n).map(|(a, b)| a * b).sum();
            assert!((dot.abs() - 1.0).abs() < 1e-5, "{found:?} for {n:?}");
            let mut ball = Row::default();
            ball[1..4].fill(1.0 / 3.0);
            let mut plane = Row::default();
            plane[1..3].fill(0.5);
            let mut broken = row;
            broken[5] = f32::NAN;
            assert_eq!([axis(&ball), axis(&plane), axis(&broken), axis(&Row::default())], [[0.0; 3]; 4]);
        }
    }

    #[test]
    fn broken_normals_and_coincident_centres_add_nothing() {
        let up = [0.0, 0.0, 1.0];
        for bad in [[0.0; 3], [f32::NAN; 3], [f32::NAN, 0.0, 1.0]] {
            assert_eq!(concavity([bad, up], [[0.0; 3], [0.0, 0.0, 1.0]]), 0.0, "{bad:?}");
        }
        assert_eq!(concavity([[0.0, 0.0, -1.0], up], [[1.0; 3], [1.0; 3]]), 0.0);
        assert_eq!(mean_concavity(std::iter::empty()), 0.0);
        let many = (0..40).map(|i| (f64::from(i), if i < 16 { 0.5 } else { 2.0 }));
        assert_eq!(mean_concavity(many), 0.5, "the sixteen nearest");
    }
}
