//! Real spherical harmonics in the convention of 3DGS (Kerbl et al. 2023).

use glam::DVec3;
use sg_scene::model::Harmonics;

const C0: f64 = Harmonics::C0;
const C1: f64 = 0.488_602_511_902_919_9;
const C2: [f64; 5] = [
    1.092_548_430_592_079_2,
    -1.092_548_430_592_079_2,
    0.315_391_565_252_520_05,
    -1.092_548_430_592_079_2,
    0.546_274_215_296_039_6,
];
const C3: [f64; 7] = [
    -0.590_043_589_926_643_5,
    2.890_611_442_640_554,
    -0.457_045_799_464_465_8,
    0.373_176_332_590_115_4,
    -0.457_045_799_464_465_8,
    1.445_305_721_320_277,
    -0.590_043_589_926_643_5,
];

/// The 16 basis functions of degrees 0 to 3 at a unit direction, with the signs of 3DGS. Their order is that of 3DGS: degree by
/// degree, order −l to l.
#[must_use]
pub fn basis(direction: DVec3) -> [f64; 16] {
    let DVec3 { x, y, z } = direction;
    let (xx, yy, zz) = (x * x, y * y, z * z);
    [
        C0,
        -C1 * y,
        C1 * z,
        -C1 * x,
        C2[0] * x * y,
        C2[1] * y * z,
        C2[2] * (2.0 * zz - xx - yy),
        C2[3] * x * z,
        C2[4] * (xx - yy),
        C3[0] * y * (3.0 * xx - yy),
        C3[1] * x * y * z,
        C3[2] * y * (4.0 * zz - xx - yy),
        C3[3] * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        C3[4] * x * (4.0 * zz - xx - yy),
        C3[5] * z * (xx - yy),
        C3[6] * x * (xx - 3.0 * yy),
    ]
}

/// Colour ½ + C₀·dc + Σ basis·rest of Gaussian `i`. The unit `direction` points from the eye to the Gaussian, in the frame that
/// the harmonics are stored in. Not clamped; `None` past the end of the columns.
#[must_use]
pub fn color(harmonics: &Harmonics, i: usize, direction: DVec3) -> Option<DVec3> {
    let vector = |c: [f32; 3]| DVec3::from_array(c.map(f64::from));
    let mut sum = DVec3::splat(0.5) + C0 * vector(*harmonics.dc.get(i)?);
    let k = harmonics.rest_per_gaussian();
    if k > 0 {
        let rest = harmonics.rest.get(i * k..(i + 1) * k)?;
        for (factor, term) in basis(direction).iter().skip(1).zip(rest) {
            sum += *factor * vector(*term);
        }
    }
    Some(sum)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    /// Associated Legendre functions P_l^m(x) with the Condon-Shortley phase, by the textbook recurrence: a second way to
    /// the same numbers.
    fn legendre(l: i32, m: i32, x: f64) -> f64 {
        let mut p = (1..=m).fold(1.0, |p, k| -p * f64::from(2 * k - 1) * (1.0 - x * x).sqrt());
        let mut previous = 0.0;
        for n in m + 1..=l {
            (previous, p) = (p, (x * f64::from(2 * n - 1) * p - f64::from(n + m - 1) * previous) / f64::from(n - m));
        }
        p
    }

    fn factorial(n: i32) -> f64 {
        (1..=n).map(f64::from).product()
    }

    fn closed_form(l: i32, m: i32, d: DVec3) -> f64 {
        let (a, phi) = (m.abs(), d.y.atan2(d.x));
        let n = (f64::from(2 * l + 1) / (4.0 * PI) * factorial(l - a) / factorial(l + a)).sqrt();
        let p = legendre(l, a, d.z);
        match m {
            0 => n * p,
            m if m > 0 => 2.0_f64.sqrt() * n * p * (f64::from(a) * phi).cos(),
            _ => 2.0_f64.sqrt() * n * p * (f64::from(a) * phi).sin(),
        }
    }

    #[test]
    fn the_basis_is_that_of_the_legendre_functions() {
        for d in [DVec3::new(0.3, -0.5, 0.7), DVec3::new(-0.9, 0.1, -0.2), DVec3::new(0.4, 0.8, -0.6)] {
            let d = d.normalize();
            let got = basis(d);
            let mut k = 0;
            for l in 0..=3 {
                for m in -l..=l {
                    let want = closed_form(l, m, d);
                    assert!((got[k] - want).abs() < 1e-12, "l {l} m {m}: {} {want}", got[k]);
                    k += 1;
                }
            }
        }
    }

    #[test]
    fn a_colour_adds_its_terms() {
        let harmonics =
            Harmonics { degree: 1, dc: vec![[1.0, 0.0, -1.0]], rest: vec![[0.0; 3], [0.5, 0.0, 0.0], [0.0; 3]] };
        let got = color(&harmonics, 0, DVec3::Z).unwrap();
        let want = DVec3::new(0.5 + C0 + 0.5 * C1, 0.5, 0.5 - C0);
        assert!((got - want).length() < 1e-12);
        assert!(color(&harmonics, 1, DVec3::Z).is_none());
    }
}
