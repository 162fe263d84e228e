//! The error of a picture against a reference.

use crate::image::Image;

/// A pixel belongs to the footprint if A is above this in either picture.
pub const FOOTPRINT: f32 = 1.0 / 1024.0;

/// Two pictures of different sizes.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("pictures of {0} x {1} and {2} x {3} pixels cannot be compared")]
pub struct SizeMismatch(u32, u32, u32, u32);

/// Error of a picture against a reference.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Difference {
    /// Peak signal-to-noise ratio over RGB with peak 1, whole frame, in dB; infinite where nothing differs.
    pub psnr_db: f64,
    /// The same over pixels with A > 1/1024 in either picture; infinite if there is no such pixel.
    pub footprint_psnr_db: f64,
    /// Σ|A − A_ref| / ΣA_ref; 0 where both are empty, infinite where only the reference is.
    pub coverage_error: f64,
    /// Greatest difference of any of R, G, B.
    pub max_error: f64,
    /// Share of the footprint's pixels where R, G or B differs by more than 2/255.
    pub footprint_share_above_2_of_255: f64,
}

impl Difference {
    /// Compares two pictures of one size; sums are in f64.
    ///
    /// # Errors
    /// [`SizeMismatch`].
    pub fn between(image: &Image, reference: &Image) -> Result<Self, SizeMismatch> {
        if (image.width, image.height) != (reference.width, reference.height) {
            return Err(SizeMismatch(image.width, image.height, reference.width, reference.height));
        }
        let (mut frame, mut footprint) = (MeanSquare::default(), MeanSquare::default());
        let (mut coverage, mut reference_coverage, mut max_error, mut above) = (0.0, 0.0, 0.0, 0_u64);
        for (got, want) in image.pixels().zip(reference.pixels()) {
            let (&[r, g, b, a], &[r_ref, g_ref, b_ref, a_ref]) = (got, want) else { continue };
            let differences = [(r, r_ref), (g, g_ref), (b, b_ref)].map(|(x, y)| f64::from(x) - f64::from(y));
            let largest = differences.iter().map(|d| d.abs()).fold(0.0, worse);
            max_error = worse(max_error, largest);
            frame.add(differences);
            if a > FOOTPRINT || a_ref > FOOTPRINT {
                footprint.add(differences);
                above += u64::from(largest > 2.0 / 255.0);
            }
            coverage += (f64::from(a) - f64::from(a_ref)).abs();
            reference_coverage += f64::from(a_ref);
        }
        Ok(Self {
            psnr_db: frame.psnr_db(),
            footprint_psnr_db: footprint.psnr_db(),
            coverage_error: if coverage == 0.0 { 0.0 } else { coverage / reference_coverage },
            max_error,
            footprint_share_above_2_of_255: above as f64 / footprint.pixels.max(1) as f64,
        })
    }
}

/// The greater of two errors; a NaN is the greatest and stays.
fn worse(a: f64, b: f64) -> f64 {
    if b.is_nan() || b > a { b } else { a }
}

#[derive(Default)]
struct MeanSquare {
    sum: f64,
    pixels: u64,
}

impl MeanSquare {
    fn add(&mut self, differences: [f64; 3]) {
        self.sum += differences.iter().map(|d| d * d).sum::<f64>();
        self.pixels += 1;
    }

    fn psnr_db(&self) -> f64 {
        if self.sum == 0.0 { f64::INFINITY } else { -10.0 * (self.sum / (3 * self.pixels) as f64).log10() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(pixels: &[[f32; 4]]) -> Image {
        Image { width: pixels.len() as u32, height: 1, rgba: pixels.concat() }
    }

    #[test]
    fn by_hand() {
        let reference = picture(&[[0.5, 0.5, 0.5, 1.0], [0.0; 4], [0.0; 4], [0.0; 4]]);
        let image = picture(&[[0.6, 0.5, 0.5, 0.9], [0.0; 4], [0.0; 4], [0.0; 4]]);
        let d = Difference::between(&image, &reference).unwrap();
        // 0.1² over 12 and over 3 numbers.
        assert!((d.psnr_db - (20.0 + 10.0 * 12.0_f64.log10())).abs() < 1e-5, "{d:?}");
        assert!((d.footprint_psnr_db - (20.0 + 10.0 * 3.0_f64.log10())).abs() < 1e-5);
        assert!((d.coverage_error - 0.1).abs() < 1e-6);
        assert!((d.max_error - 0.1).abs() < 1e-6);
        assert_eq!(d.footprint_share_above_2_of_255, 1.0);
    }

    #[test]
    fn an_empty_picture_of_faint_gaussians_is_found_out() {
        let reference = picture(&[[0.003, 0.003, 0.003, 0.003]; 4]);
        let d = Difference::between(&picture(&[[0.0; 4]; 4]), &reference).unwrap();
        assert!(d.psnr_db > 50.0 && d.coverage_error == 1.0);
        let same = Difference::between(&reference, &reference).unwrap();
        assert_eq!((same.psnr_db, same.coverage_error, same.max_error), (f64::INFINITY, 0.0, 0.0));
        assert!(Difference::between(&picture(&[]), &reference).is_err());
    }

    #[test]
    fn a_nan_is_never_a_good_score() {
        let reference = picture(&[[0.5; 4], [0.5; 4]]);
        let d = Difference::between(&picture(&[[f32::NAN, 0.5, 0.5, 0.5], [0.5; 4]]), &reference).unwrap();
        assert!(d.psnr_db.is_nan() && d.max_error.is_nan());
    }
}
