//! Round lengths and their units, as people read them off a picture.

/// Units of labels: the least length in millimetres that each names, its millimetres and its symbol.
pub(super) const LABELS: [(f64, f64, &str); 4] =
    [(1e3, 1e3, "m"), (1.0, 1.0, "mm"), (1e-3, 1e-3, "µm"), (0.0, 1e-6, "nm")];

/// The greatest length of 1, 2 or 5 times a power of ten that is at most `most`. `None` for what is no length.
pub(super) fn round_length(most: f64) -> Option<f64> {
    if !(most.is_normal() && most > 0.0) {
        return None;
    }
    let exponent = most.log10().floor() as i32;
    // A bound just below a power of ten can round to it or fall short of it, so the neighbours are tried as well.
    let round = [exponent + 1, exponent, exponent - 1].into_iter().flat_map(|e| [5.0, 2.0, 1.0].map(|x| (x, e)));
    round.map(|(x, e)| x * 10_f64.powi(e)).find(|length| *length <= most * (1.0 + 1e-9))
}
