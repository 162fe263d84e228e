//! The finite Gaussians of one base unit as points of the scene frame.

use glam::DVec3;
use rayon::prelude::*;
use sg_scene::model::BaseUnit;

/// Points in the scene frame, in an order that keeps spatial neighbours close in memory (Morton order).
///
/// A *vertex* is a position in these columns; `gaussian` maps it to the scene-wide index. Coincident points are contiguous,
/// ascending by that index. Coordinates are f64, because f32 cannot resolve neighbours far from the origin.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Vertices {
    /// Scene-wide index of each vertex.
    pub gaussian: Vec<u32>,
    /// Position of each vertex in the scene frame, in the scene's length unit.
    pub position: Vec<[f64; 3]>,
}

impl Vertices {
    /// The vertices of a unit, and the number of dropped Gaussians. Gaussians without a finite position are dropped.
    #[must_use]
    pub fn of_unit(unit: &BaseUnit) -> (Self, usize) {
        let first = u32::try_from(unit.first).unwrap_or(u32::MAX);
        let transform = unit.transform;
        let points: Vec<(u32, [f64; 3])> = unit
            .gaussians
            .position
            .par_iter()
            .zip(first..first.saturating_add(u32::try_from(unit.gaussians.len()).unwrap_or(u32::MAX)))
            .map(|(p, i)| (i, transform.transform_point3(p.as_dvec3())))
            .filter(|(_, p)| p.is_finite())
            .map(|(i, p)| (i, p.to_array()))
            .collect();
        let dropped = unit.gaussians.len() - points.len();
        (Self::ordered(points), dropped)
    }

    /// The vertices of finite points with their indices.
    #[must_use]
    pub fn ordered(points: Vec<(u32, [f64; 3])>) -> Self {
        let mut min = DVec3::INFINITY;
        let mut max = DVec3::NEG_INFINITY;
        for (_, p) in &points {
            min = min.min(DVec3::from_array(*p));
            max = max.max(DVec3::from_array(*p));
        }
        let extent = (max - min).max_element();
        // 21 bits per axis. In a box without extent all points get the same code.
        let factor = if extent > 0.0 { 2_097_151.0 / extent } else { 0.0 };
        let mut keyed: Vec<(u64, u32, [f64; 3])> = points
            .into_par_iter()
            .map(|(i, p)| {
                // Adding zero turns -0 into 0, so equal coordinates have equal bits.
                let p = p.map(|x| x + 0.0);
                let cell = (DVec3::from_array(p) - min) * factor;
                (morton(cell), i, p)
            })
            .collect();
        keyed.par_sort_unstable_by(|a, b| {
            a.0.cmp(&b.0)
                .then_with(|| a.2[0].total_cmp(&b.2[0]))
                .then_with(|| a.2[1].total_cmp(&b.2[1]))
                .then_with(|| a.2[2].total_cmp(&b.2[2]))
                .then_with(|| a.1.cmp(&b.1))
        });
        Self { gaussian: keyed.iter().map(|k| k.1).collect(), position: keyed.into_iter().map(|k| k.2).collect() }
    }

    /// Number of vertices.
    #[must_use]
    pub fn len(&self) -> usize {
        self.gaussian.len()
    }

    /// Whether there is no vertex.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.gaussian.is_empty()
    }

    /// First vertex of each run of coincident points, followed by the number of vertices.
    #[must_use]
    pub fn coincident_runs(&self) -> Vec<u32> {
        let mut starts: Vec<u32> = Vec::with_capacity(self.len() + 1);
        let mut last: Option<&[f64; 3]> = None;
        for (v, p) in (0..).zip(&self.position) {
            if last != Some(p) {
                starts.push(v);
            }
            last = Some(p);
        }
        starts.push(u32::try_from(self.len()).unwrap_or(u32::MAX));
        starts
    }
}

/// Squared Euclidean distance from coordinate differences. The expanded form would cancel far from the origin.
#[inline]
#[must_use]
pub fn distance_squared(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    let d = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
}

fn morton(cell: DVec3) -> u64 {
    spread(cell.x) | spread(cell.y) << 1 | spread(cell.z) << 2
}

/// Spreads the low 21 bits of the truncated value to every third bit.
fn spread(x: f64) -> u64 {
    let mut x = (x as u64) & 0x1f_ffff;
    x = (x | x << 32) & 0x001f_0000_0000_ffff;
    x = (x | x << 16) & 0x001f_0000_ff00_00ff;
    x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & 0x1249_2492_4924_9249
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coincident_points_stand_together_by_index() {
        let a = [1.0, 2.0, 3.0];
        let points = vec![(4, a), (1, [0.0, 0.0, -0.0]), (2, a), (9, [0.0, -0.0, 0.0]), (0, a)];
        let v = Vertices::ordered(points);
        assert_eq!(v.gaussian, [1, 9, 0, 2, 4]);
        assert_eq!(v.coincident_runs(), [0, 2, 5]);
    }

    #[test]
    fn morton_order_of_an_octant_is_z_y_x() {
        let corners: Vec<(u32, [f64; 3])> =
            (0..8u32).map(|i| (i, [f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2)])).rev().collect();
        assert_eq!(Vertices::ordered(corners).gaussian, [0, 1, 2, 3, 4, 5, 6, 7]);
    }
}
