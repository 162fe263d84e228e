//! Parsers of degrees ("a bit"), connecting words and factors ("by 20 percent").

use winnow::Parser;
use winnow::combinator::{alt, opt};
use winnow::error::EmptyError;

use super::number::{Quantity, quantity};
use super::phrase::{Input, Outcome, exactly, mark, one_of, phrase};

/// Degree of a change.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Degree {
    Slight,
    Plain,
    Much,
}

impl Degree {
    /// Selects the value for this degree.
    pub(crate) fn pick(self, slight: f64, plain: f64, much: f64) -> f64 {
        match self {
            Self::Slight => slight,
            Self::Plain => plain,
            Self::Much => much,
        }
    }
}

pub(crate) const SLIGHTLY: &str =
    "a bit | a little | a little bit | a tiny bit | slightly | somewhat | a touch | a notch";

pub(crate) const MUCH: &str = "much | a lot | lots | far | way | considerably | significantly | strongly | a good deal | \
     even much";

/// Parses "a bit", "much" or nothing.
pub(crate) fn degree(input: &mut Input<'_>) -> Outcome<Degree> {
    alt((
        one_of(SLIGHTLY).map(|_| Degree::Slight),
        one_of(MUCH).map(|_| Degree::Much),
        opt(exactly("even | still")).map(|_| Degree::Plain),
    ))
    .parse_next(input)
}

/// Parses words between a property and its value.
pub(crate) fn connector(input: &mut Input<'_>) -> Outcome<()> {
    opt(alt((
        one_of(
            "to | at | as | be | to be | should be | must be | equal to | back to | down to | up to | \
         of | is",
        )
        .void(),
        mark('=').void(),
        mark(':').void(),
    )))
    .void()
    .parse_next(input)
}

/// Parses the factor of a change: "by 20 percent", "by half", "by a factor of 2", "two times".
pub(crate) fn factor_by(grows: bool, input: &mut Input<'_>) -> Outcome<f64> {
    phrase("by").parse_next(input)?;
    let factor = opt(one_of("a factor of | a factor")).parse_next(input)?;
    let amount: Quantity = quantity(input)?;
    let value = match (factor, amount.share, grows) {
        (Some(_), _, true) => amount.value,
        (Some(_), _, false) => 1.0 / amount.value,
        (None, true, true) => 1.0 + amount.value,
        (None, true, false) => 1.0 - amount.value,
        // A bare number above 1 is a percentage. One below 1 is ambiguous (sum or factor) and refused.
        (None, false, true) if amount.value > 1.0 => 1.0 + amount.value / 100.0,
        (None, false, false) if amount.value > 1.0 => 1.0 - amount.value / 100.0,
        _ => return Err(EmptyError),
    };
    if value.is_finite() && (0.0..=1000.0).contains(&value) { Ok(value) } else { Err(EmptyError) }
}
