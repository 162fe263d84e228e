//! Numbers in TOML.

use glam::{DMat3, DMat4};

/// A value that reads back as the same `f32`: the short decimal if it does, else the exact one.
pub(crate) fn exact_f32(x: f32) -> f64 {
    let short = x.to_string().parse::<f64>().unwrap_or(f64::from(x));
    if short as f32 == x { short } else { f64::from(x) }
}

/// The affine map of 16 row-major numbers. `None` if a number is not finite, the last row is not 0 0 0 1, or the map is
/// singular.
pub(crate) fn transform(rows: &[f64]) -> Option<DMat4> {
    let rows: [f64; 16] = rows.try_into().ok()?;
    let matrix = DMat4::from_cols_array(&rows).transpose();
    let finite = rows.iter().all(|x| x.is_finite());
    let affine = rows.ends_with(&[0.0, 0.0, 0.0, 1.0]);
    let linear = DMat3::from_mat4(matrix);
    let (determinant, size) =
        (linear.determinant().abs(), linear.to_cols_array().iter().fold(0.0_f64, |m, x| m.max(x.abs())));
    // Relative to its own size: a scene in micrometres has a small determinant and is fine.
    (finite && affine && determinant > 1e-12 * size.powi(3)).then_some(matrix)
}

/// The 16 numbers of a matrix, row major.
pub(crate) fn row_major(matrix: &DMat4) -> [f64; 16] {
    matrix.transpose().to_cols_array()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn an_f32_reads_back_from_toml_with_its_bits(bits in any::<u32>()) {
            let x = f32::from_bits(bits);
            prop_assume!(x.is_finite());
            let text = format!("x = {}", toml::Value::Float(exact_f32(x)));
            let table: toml::Table = text.parse().unwrap();
            let back = table["x"].as_float().unwrap() as f32;
            prop_assert_eq!(back.to_bits(), bits, "{}", text);
        }
    }

    #[test]
    fn transforms_that_lose_space_are_refused() {
        let mut rows = row_major(&DMat4::IDENTITY);
        assert_eq!(transform(&rows), Some(DMat4::IDENTITY));
        rows[3] = 5.0;
        assert_eq!(transform(&rows).unwrap().transform_point3(glam::DVec3::ZERO).x, 5.0);
        rows[0] = 0.0;
        assert_eq!(transform(&rows), None);
        assert!(transform(&row_major(&DMat4::from_scale(glam::DVec3::splat(1e-9)))).is_some());
        assert_eq!(transform(&[1.0; 15]), None);
    }
}
