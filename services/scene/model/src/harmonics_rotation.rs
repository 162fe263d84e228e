//! Turning real spherical harmonics of degree 1 to 3, in the basis and sign convention of 3DGS.

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use crate::model::Harmonics;

/// Terms of degree 1 to 3 of one Gaussian.
const MOST_TERMS: usize = 15;

/// The matrices that rotate each band: the function d ↦ f(Mᵀd) has the coefficients D·c.
pub(crate) struct HarmonicsRotation {
    /// Row-major (2l+1)×(2l+1) matrices of l = 1, 2, 3.
    bands: [Vec<f64>; 3],
}

impl HarmonicsRotation {
    /// Of an orthogonal matrix (reflections included).
    ///
    /// D is the integral of Y(d)·Y(Mᵀd)ᵀ over the sphere. Four Gauss-Legendre heights times eight azimuths are exact
    /// for its polynomials of degree 6.
    pub(crate) fn new(map: DMat3) -> Self {
        const HEIGHTS: [(f64, f64); 4] = [
            (-0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
            (-0.339_981_043_584_856_26, 0.652_145_154_862_546_1),
            (0.339_981_043_584_856_26, 0.652_145_154_862_546_1),
            (0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
        ];
        let mut bands = [vec![0.0; 9], vec![0.0; 25], vec![0.0; 49]];
        let back = map.transpose();
        for (z, weight) in HEIGHTS {
            for azimuth in 0..8 {
                let angle = f64::from(azimuth) * std::f64::consts::FRAC_PI_4;
                let (sin, cos) = angle.sin_cos();
                let radius = (1.0 - z * z).sqrt();
                let d = DVec3::new(radius * cos, radius * sin, z);
                let weight = weight * std::f64::consts::FRAC_PI_4;
                let (here, there) = (basis(d), basis(back * d));
                for (l, matrix) in (1_usize..).zip(&mut bands) {
                    let band = l * l - 1..(l + 1) * (l + 1) - 1;
                    let (rows, columns) =
                        (here.get(band.clone()).unwrap_or_default(), there.get(band).unwrap_or_default());
                    for (row, y) in matrix.chunks_exact_mut(2 * l + 1).zip(rows) {
                        for (entry, x) in row.iter_mut().zip(columns) {
                            *entry += weight * y * x;
                        }
                    }
                }
            }
        }
        Self { bands }
    }

    /// Turns the terms of degree 1 and above of the Gaussians of these indices.
    pub(crate) fn apply(&self, harmonics: &mut Harmonics, gaussians: &[usize]) {
        let terms = harmonics.rest_per_gaussian();
        if terms == 0 {
            return;
        }
        let turned: Vec<[[f32; 3]; MOST_TERMS]> =
            gaussians.par_iter().map(|i| self.turned(harmonics.rest.get(i * terms..).unwrap_or_default())).collect();
        for (i, new) in gaussians.iter().zip(&turned) {
            for (to, from) in harmonics.rest.iter_mut().skip(i * terms).take(terms).zip(new) {
                *to = *from;
            }
        }
    }

    /// The turned terms of the first Gaussian of `rows`.
    fn turned(&self, rows: &[[f32; 3]]) -> [[f32; 3]; MOST_TERMS] {
        let mut turned = [[0.0; 3]; MOST_TERMS];
        let (mut from, mut to) = (rows, turned.as_mut_slice());
        for (l, matrix) in (1_usize..).zip(&self.bands) {
            let Some((band, later)) = from.split_at_checked(2 * l + 1) else { break };
            let Some((out, rest)) = to.split_at_mut_checked(2 * l + 1) else { break };
            for (out, row) in out.iter_mut().zip(matrix.chunks_exact(2 * l + 1)) {
                let mut sum = DVec3::ZERO;
                for (factor, c) in row.iter().zip(band) {
                    sum += *factor * DVec3::from_array(c.map(f64::from));
                }
                *out = sum.as_vec3().to_array();
            }
            (from, to) = (later, rest);
        }
        turned
    }
}

/// The 15 basis functions of degree 1 to 3 at a direction of unit length.
fn basis(d: DVec3) -> [f64; 15] {
    let DVec3 { x, y, z } = d;
    let (xx, yy, zz) = (x * x, y * y, z * z);
    [
        -0.488_602_511_902_919_9 * y,
        0.488_602_511_902_919_9 * z,
        -0.488_602_511_902_919_9 * x,
        1.092_548_430_592_079_2 * x * y,
        -1.092_548_430_592_079_2 * y * z,
        0.315_391_565_252_520_05 * (2.0 * zz - xx - yy),
        -1.092_548_430_592_079_2 * x * z,
        0.546_274_215_296_039_6 * (xx - yy),
        -0.590_043_589_926_643_5 * y * (3.0 * xx - yy),
        2.890_611_442_640_554 * x * y * z,
        -0.457_045_799_464_465_8 * y * (4.0 * zz - xx - yy),
        0.373_176_332_590_115_4 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        -0.457_045_799_464_465_8 * x * (4.0 * zz - xx - yy),
        1.445_305_721_320_277 * z * (xx - yy),
        -0.590_043_589_926_643_5 * x * (xx - 3.0 * yy),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;
    use proptest::prelude::*;

    fn value(harmonics: &Harmonics, d: DVec3) -> f64 {
        basis(d).iter().zip(&harmonics.rest).map(|(y, c)| y * f64::from(c[1])).sum()
    }

    proptest! {
        #[test]
        fn the_turned_function_has_the_value_of_the_old_one_turned_back(
            coefficients in proptest::collection::vec(-2.0_f32..2.0, 15),
            axis in proptest::array::uniform3(-1.0_f64..1.0),
            angle in -3.0_f64..3.0,
            mirror in any::<bool>(),
            direction in proptest::array::uniform3(-1.0_f64..1.0),
        ) {
            let (axis, d) = (DVec3::from_array(axis), DVec3::from_array(direction));
            prop_assume!(axis.length() > 0.1 && d.length() > 0.1);
            let mut map = DMat3::from_quat(DQuat::from_axis_angle(axis.normalize(), angle));
            if mirror {
                map *= -1.0;
            }
            let d = d.normalize();
            let old = Harmonics { degree: 3, dc: vec![[0.0; 3]], rest: coefficients.iter().map(|&c| [0.0, c, 1.0]).collect() };
            let mut new = old.clone();
            HarmonicsRotation::new(map).apply(&mut new, &[0]);
            prop_assert!((value(&new, d) - value(&old, map.transpose() * d)).abs() < 1e-5);
        }
    }
}
