//! Numbers on screen: one format for panels, the window's bars and legends.
//!
//! - Thousands are separated by commas, as in the agents' replies and in the history.
//! - No digit is written that says nothing: trailing zeros after the decimal point are dropped.
//! - A space stands between a number and its unit, except before °.

use sg_input::number_format::{decimals, grouped};

/// A number of things.
pub(crate) fn count(n: usize) -> String {
    grouped(n as u64)
}

/// A share or a factor in percent: two decimals below 1 %, one below 10 %.
pub(crate) fn percent(x: f64) -> String {
    let percent = 100.0 * x;
    match percent.abs() {
        size if size > 0.0 && size < 0.005 => "< 0.01 %".to_owned(),
        size if size < 0.995 => format!("{} %", decimals(percent, 2)),
        size if size < 9.95 => format!("{} %", decimals(percent, 1)),
        _ => format!("{} %", decimals(percent, 0)),
    }
}

/// Any number: three decimals below 1, two below 10, none above; a power of ten where it is tiny or huge.
pub(crate) fn number(x: f64) -> String {
    match x.abs() {
        size if size != 0.0 && !(1e-3..1e6).contains(&size) => format!("{x:.1e}"),
        size if size < 0.9995 => decimals(x, 3),
        size if size < 9.995 => decimals(x, 2),
        _ => decimals(x, 0),
    }
}

/// A number of the order of one: at most two decimals.
pub(crate) fn decimal(x: f64) -> String {
    decimals(x, 2)
}

/// A factor.
pub(crate) fn factor(x: f64) -> String {
    format!("× {}", decimal(x))
}

/// An angle in degrees.
pub(crate) fn degrees(x: f64) -> String {
    format!("{}°", decimals(x, 0))
}

/// A length in centimetres, from metres.
pub(crate) fn centimetres(metres: f64) -> String {
    format!("{} cm", decimals(100.0 * metres, 1))
}

/// A duration in milliseconds, from seconds.
pub(crate) fn milliseconds(seconds: f64) -> String {
    format!("{} ms", decimals(1e3 * seconds, 0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thousands_have_commas() {
        assert_eq!([0, 999, 1000, 4144, 1_234_567].map(count), ["0", "999", "1,000", "4,144", "1,234,567"]);
    }

    #[test]
    fn shares_have_the_digits_that_they_need() {
        let pairs = [
            (0.0, "0 %"),
            (1e-5, "< 0.01 %"),
            (0.0005, "0.05 %"),
            (0.005, "0.5 %"),
            (0.00999, "1 %"),
            (0.0519, "5.2 %"),
            (0.08, "8 %"),
            (0.0999, "10 %"),
            (0.18, "18 %"),
            (2.0, "200 %"),
        ];
        for (x, written) in pairs {
            assert_eq!(percent(x), written);
        }
    }

    #[test]
    fn numbers_are_short() {
        let pairs = [
            (0.0, "0"),
            (-0.0, "0"),
            (1e-12, "1.0e-12"),
            (0.013, "0.013"),
            (-0.0004, "-4.0e-4"),
            (0.53, "0.53"),
            (0.9999, "1"),
            (-0.95, "-0.95"),
            (4.5, "4.5"),
            (9.999, "10"),
            (74.508, "75"),
            (65_535.0, "65,535"),
            (2e6, "2.0e6"),
            (f64::NAN, "NaN"),
        ];
        for (x, written) in pairs {
            assert_eq!(number(x), written);
        }
        assert_eq!([1e-12, -1e-12, 0.5, -0.95, 2.0].map(decimal), ["0", "0", "0.5", "-0.95", "2"]);
        assert_eq!((factor(1.0), factor(0.25), degrees(-179.6)), ("× 1".into(), "× 0.25".into(), "-180°".into()));
        assert_eq!(milliseconds(1.234), "1,234 ms");
        assert_eq!([0.01, 0.012, 0.5].map(centimetres), ["1 cm", "1.2 cm", "50 cm"]);
    }
}
