//! Numbers for people, the same on screen, in replies and on a terminal: commas between thousands, and no zero after the decimal
//! point that says nothing. JSON and CSV have plain numbers.

/// A whole number with commas between thousands.
#[must_use]
pub fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::with_capacity(digits.len() + digits.len() / 3);
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// A number with at most so many decimals. Trailing zeros are dropped, and negative zero loses its sign. A tie rounds away from
/// zero, as people round: 12.5 becomes 13.
#[must_use]
pub fn decimals(x: f64, most: usize) -> String {
    if !x.is_finite() {
        return x.to_string();
    }
    // Formatting alone rounds a tie to the even digit.
    let unit = 10_f64.powi(most.min(15) as i32);
    let scaled = x.abs() * unit;
    let rounded = if scaled.fract() == 0.5 { scaled.ceil() / unit } else { x.abs() };
    let text = format!("{rounded:.most$}");
    let (whole, fraction) = text.split_once('.').unwrap_or((&text, ""));
    let whole = whole.parse().map_or_else(|_| whole.to_owned(), grouped);
    let fraction = fraction.trim_end_matches('0');
    let sign = if x < 0.0 && text.bytes().any(|b| matches!(b, b'1'..=b'9')) { "-" } else { "" };
    let point = if fraction.is_empty() { "" } else { "." };
    format!("{sign}{whole}{point}{fraction}")
}

/// A number with four significant digits. Digits before the point all stay.
#[must_use]
pub fn significant(x: f64) -> String {
    let digits = if x == 0.0 { 0.0 } else { 3.0 - x.abs().log10().floor() };
    decimals(x, digits.clamp(0.0, 9.0) as usize)
}

/// Words for a range of values, of which an end may be open: "values from 1 to 2", "values above 1", "values below 2".
#[must_use]
pub fn values_between(low: Option<f64>, high: Option<f64>) -> String {
    match (low, high) {
        (Some(low), Some(high)) => format!("values from {} to {}", significant(low), significant(high)),
        (Some(low), None) => format!("values above {}", significant(low)),
        (None, Some(high)) => format!("values below {}", significant(high)),
        (None, None) => "all values".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thousands_have_commas_and_idle_zeros_go() {
        assert_eq!([0, 999, 1000, 4144, 1_234_567].map(grouped), ["0", "999", "1,000", "4,144", "1,234,567"]);
        let pairs = [(20.0, "20"), (12.5, "12.5"), (-0.001, "0"), (-0.25, "-0.25"), (1000.0, "1,000"), (0.128, "0.13")];
        for (x, written) in pairs {
            assert_eq!(decimals(x, 2), written);
        }
        assert_eq!(decimals(f64::NAN, 2), "NaN");
    }

    #[test]
    fn a_tie_rounds_away_from_zero() {
        for (x, most, written) in
            [(12.5, 0, "13"), (13.5, 0, "14"), (-0.5, 0, "-1"), (0.25, 1, "0.3"), (2.125, 2, "2.13")]
        {
            assert_eq!(decimals(x, most), written);
        }
        assert_eq!(decimals(f64::MAX, 2), decimals(f64::MAX, 0));
    }
}
