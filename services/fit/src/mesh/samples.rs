//! Samples within the tetrahedra of a mesh, and their order in space.

use glam::{DAffine3, DMat3, DVec3, Vec3};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use sg_volume::MeshField;
use sg_volume::mesh::MeshCell;

use crate::pieces::{Piece, Pieces};
use crate::shape::outer;

/// Even samples of one tetrahedron.
pub(super) struct CellSampler {
    pub(super) cell: MeshCell,
    gradients: [Vec3; 4],
    /// The start of the sequence: that of neighbours differs, so that their samples form no lattice together.
    start: [f64; 3],
}

/// Steps of the additive recurrence with the lowest discrepancy in three dimensions: powers of the reciprocal of the real root
/// of x⁴ = x + 1 (Roberts 2018, "The unreasonable effectiveness of quasirandom sequences").
const STEPS: [f64; 3] = [0.819_172_513_396_164_4, 0.671_043_606_703_789_2, 0.549_700_477_901_970_3];

impl CellSampler {
    pub(super) fn new(field: &MeshField, cell: u32) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(u64::from(cell));
        Self {
            cell: field.cell(cell as usize),
            gradients: field.corner_gradients(cell as usize),
            start: [random.random(), random.random(), random.random()],
        }
    }

    /// Position, raw value and gradient of sample `k`. The only one is in the middle.
    pub(super) fn sample(&self, k: usize, count: usize) -> (DVec3, f64, Vec3) {
        let c = if count == 1 {
            [0.25; 4]
        } else {
            folded([0, 1, 2].map(|axis| (self.start[axis] + k as f64 * STEPS[axis]).fract()))
        };
        let at = self.cell.corners.iter().zip(c).map(|(p, c)| *p * c).sum();
        let raw = self.cell.values.iter().zip(c).map(|(v, c)| v * c).sum();
        let gradient = self.gradients.iter().zip(c).map(|(g, c)| *g * c as f32).sum();
        (at, raw, gradient)
    }
}

/// Barycentric coordinates of a point of the unit cube, folded into a tetrahedron: even where the points are (Rocchini and
/// Cignoni 2000, "Generating random points in a tetrahedron").
fn folded([mut s, mut t, mut u]: [f64; 3]) -> [f64; 4] {
    if s + t > 1.0 {
        (s, t) = (1.0 - s, 1.0 - t);
    }
    if t + u > 1.0 {
        (t, u) = (1.0 - u, 1.0 - s - t);
    } else if s + t + u > 1.0 {
        (s, u) = (1.0 - t - u, s + t + u - 1.0);
    }
    [1.0 - s - t - u, s, t, u]
}

/// A sample with its tetrahedron, and the number of that one's samples.
pub(super) struct RawSample {
    pub(super) at: DVec3,
    pub(super) raw: f64,
    pub(super) gradient: Vec3,
    pub(super) cell: u32,
    pub(super) count: u32,
    pub(super) weight: f32,
}

/// The samples of one base unit along a Morton curve: neighbours in the list are neighbours in space.
pub(super) struct Samples {
    /// From the middle of the mesh.
    pub(super) positions: Vec<[f32; 3]>,
    pub(super) weights: Vec<f32>,
    own: Vec<RawSample>,
    pub(super) importance: f64,
}

impl Samples {
    /// `half` is half the longest side of the mesh.
    pub(super) fn new(mut own: Vec<RawSample>, half: f64) -> Self {
        own.par_sort_by_cached_key(|sample| (morton(sample.at, half), sample.cell));
        Self {
            positions: own.iter().map(|sample| sample.at.as_vec3().to_array()).collect(),
            weights: own.iter().map(|sample| sample.weight).collect(),
            importance: own.iter().map(|sample| f64::from(sample.weight)).sum(),
            own,
        }
    }

    /// A random way from the middle of a sample's part of its tetrahedron: that of a point of the whole one, made smaller.
    pub(super) fn within(&self, field: &MeshField, sample: usize, at: [f64; 3]) -> DVec3 {
        let Some(sample) = self.own.get(sample) else { return DVec3::ZERO };
        let cell = field.cell(sample.cell as usize);
        let point: DVec3 = cell.corners.iter().zip(folded(at)).map(|(p, c)| *p * c).sum();
        (point - cell.middle()) / f64::from(sample.count).cbrt()
    }
}

/// The place on a Morton curve through the cube from −`half` to `half`, with 21 bits for each axis.
fn morton(at: DVec3, half: f64) -> u64 {
    let spread = |x: f64| {
        let cells = f64::from(1 << 21);
        let mut bits = ((0.5 + 0.5 * x / half) * cells).clamp(0.0, cells - 1.0) as u64;
        for (shift, mask) in [
            (32, 0x001f_0000_0000_ffff),
            (16, 0x001f_0000_ff00_00ff),
            (8, 0x100f_00f0_0f00_f00f),
            (4, 0x10c3_0c30_c30c_30c3),
            (2, 0x1249_2492_4924_9249),
        ] {
            bits = (bits | bits << shift) & mask;
        }
        bits
    };
    spread(at.x) | spread(at.y) << 1 | spread(at.z) << 2
}

/// The samples of one base unit as the pieces of cells: one piece for each.
pub(super) struct SamplePieces<'a> {
    pub(super) samples: &'a Samples,
    pub(super) field: &'a MeshField,
}

impl Pieces for SamplePieces<'_> {
    fn for_each(&self, point: u32, mut f: impl FnMut(Piece)) {
        if let Some(sample) = self.samples.own.get(point as usize) {
            let volume = self.field.cell(sample.cell as usize).volume() / f64::from(sample.count);
            f(Piece { place: sample.at, weight: sample.weight, share: volume / self.unit_volume(), point });
        }
    }

    fn value_and_gradient(&self, piece: &Piece) -> (f64, Vec3) {
        self.samples
            .own
            .get(piece.point as usize)
            .map_or((f64::NAN, Vec3::ZERO), |sample| (sample.raw, sample.gradient))
    }

    fn extent(&self, piece: &Piece) -> DMat3 {
        let Some(sample) = self.samples.own.get(piece.point as usize) else { return DMat3::ZERO };
        // The covariance of a tetrahedron, made smaller to the sample's part of it.
        let cell = self.field.cell(sample.cell as usize);
        let middle = cell.middle();
        let sum = cell.corners.iter().fold(DMat3::ZERO, |sum, corner| sum + outer(*corner - middle));
        sum * (f64::from(sample.count).powf(-2.0 / 3.0) / 20.0)
    }

    fn to_world(&self) -> DAffine3 {
        DAffine3::from_translation(self.field.middle())
    }

    fn unit_volume(&self) -> f64 {
        self.field.reference_length().powi(3)
    }

    fn reference_length(&self) -> f64 {
        self.field.reference_length()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn folded_points_are_in_the_tetrahedron(at in prop::array::uniform3(0.0..1.0_f64)) {
            let c = folded(at);
            prop_assert!(c.iter().all(|c| *c >= -1e-12), "{c:?}");
            prop_assert!((c.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn folded_points_are_even() {
        let count = 200_000.0;
        let mut sum = [0.0; 4];
        let mut square = 0.0;
        for k in 0..200_000 {
            let c = folded(STEPS.map(|step| (0.5 + f64::from(k) * step).fract()));
            (0..4).for_each(|i| sum[i] += c[i]);
            square += c[1] * c[1];
        }
        // The moments of an even tetrahedron: 1/4, and 1/10.
        assert!(sum.iter().all(|s| (s / count - 0.25).abs() < 1e-3), "{sum:?}");
        assert!((square / count - 0.1).abs() < 1e-3, "{}", square / count);
    }

    #[test]
    fn the_curve_orders_octants() {
        let at = |x, y, z| morton(DVec3::new(x, y, z), 1.0);
        let octants: Vec<u64> = (0..8)
            .map(|k| {
                at(
                    if k & 1 > 0 { 0.5 } else { -0.5 },
                    if k & 2 > 0 { 0.5 } else { -0.5 },
                    if k & 4 > 0 { 0.5 } else { -0.5 },
                )
            })
            .collect();
        assert!(octants.is_sorted());
        assert_eq!(at(1.0, 1.0, 1.0), (1 << 63) - 1);
        assert_eq!(at(-1.0, -1.0, -1.0), 0);
    }
}
