//! Robust slopes of sampled quantities.

use crate::bench::quantile;

/// Most points of a fit. Longer series are thinned to medians of equal stretches.
const MAX_POINTS: usize = 200;

/// Slope of a line through points `(x, y)`: the median of the slopes of all pairs, so that up to 29 % of outliers do not
/// matter (Theil 1950; Sen, JASA 63, 1968). `None` for fewer than two different x.
#[must_use]
pub fn slope(points: &[(f64, f64)]) -> Option<f64> {
    let points = thinned(points);
    let mut slopes = Vec::with_capacity(points.len() * points.len() / 2);
    for (i, (x, y)) in points.iter().enumerate() {
        slopes.extend(points.iter().skip(i + 1).filter(|(other, _)| other != x).map(|(u, v)| (v - y) / (u - x)));
    }
    (!slopes.is_empty()).then(|| quantile(&mut slopes, 0.5))
}

fn thinned(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let stretch = points.len().div_ceil(MAX_POINTS).max(1);
    let middle =
        |part: &[(f64, f64)], of: fn(&(f64, f64)) -> f64| quantile(&mut part.iter().map(of).collect::<Vec<_>>(), 0.5);
    points.chunks(stretch).map(|part| (middle(part, |p| p.0), middle(part, |p| p.1))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outliers_do_not_change_the_slope() {
        let line = |i: u32| (f64::from(i), 3.0 * f64::from(i) + 7.0);
        let mut points: Vec<_> = (0..1000).map(line).collect();
        assert!((slope(&points).unwrap() - 3.0).abs() < 1e-9);
        for point in points.iter_mut().step_by(5) {
            point.1 = 1e6;
        }
        assert!((slope(&points).unwrap() - 3.0).abs() < 0.05);
    }

    #[test]
    fn a_step_in_a_level_series_is_no_slope() {
        let points: Vec<_> = (0..300).map(|i| (f64::from(i), if i < 20 { 10.0 } else { 14.0 })).collect();
        assert_eq!(slope(&points), Some(0.0));
        assert_eq!(slope(&[(1.0, 2.0), (1.0, 3.0)]), None);
    }
}
