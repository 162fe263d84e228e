//! Sums of probabilities by their logarithms.

/// ln Σ exp(x). Of nothing it is −∞.
pub(crate) fn log_sum(logs: &[f32]) -> f32 {
    let most = logs.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    if !most.is_finite() {
        return most;
    }
    // Single terms are tiny beside the sum of 50,000 of them.
    let sum: f64 = logs.chunks(64).map(|part| f64::from(part.iter().map(|log| (log - most).exp()).sum::<f32>())).sum();
    most + sum.ln() as f32
}

/// ln(exp(a) + exp(b)).
pub(crate) fn log_add(a: f32, b: f32) -> f32 {
    log_sum(&[a, b])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_agree_with_f64_and_survive_extremes() {
        let logs: Vec<f32> = (0..50_000).map(|at| ((at * 7919) % 1000) as f32 / 40.0 - 20.0).collect();
        let exact = logs.iter().map(|log| f64::from(*log).exp()).sum::<f64>().ln();
        assert!((f64::from(log_sum(&logs)) - exact).abs() < 1e-5);
        assert_eq!(log_sum(&[]), f32::NEG_INFINITY);
        assert_eq!(log_sum(&[f32::NEG_INFINITY; 2]), f32::NEG_INFINITY);
        assert!((log_add(1000.0, 1000.0) - 1000.0 - 2_f32.ln()).abs() < 1e-3);
    }
}
