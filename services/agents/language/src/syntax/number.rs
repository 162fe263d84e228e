//! Parsers of numbers, percentages and fractions.

use text2num::{Language, text2digits};
use winnow::Parser;
use winnow::combinator::{alt, opt, preceded};
use winnow::error::EmptyError;

use super::phrase::{Input, Outcome, advance, exactly, mark, one_of, phrase, remaining, token};
use super::token::Kind;

/// A spoken number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Quantity {
    /// The value. Percentages are divided by 100.
    pub(crate) value: f64,
    /// Whether it is a percentage or a fraction.
    pub(crate) share: bool,
}

impl Quantity {
    /// The number as an opacity. A bare number above 10 is a percentage.
    pub(crate) fn as_opacity(self) -> f64 {
        if !self.share && self.value > 10.0 { self.value / 100.0 } else { self.value }
    }
}

/// Largest accepted number.
const MAX_QUANTITY: f64 = 1e6;

/// Parses a number in digits or words, a percentage or a fraction (`half`, `two thirds`, `1/2`).
pub(crate) fn quantity(input: &mut Input<'_>) -> Outcome<Quantity> {
    let found = alt((spoken_fraction, numeric)).parse_next(input)?;
    if found.value <= MAX_QUANTITY { Ok(found) } else { Err(EmptyError) }
}

fn percent_sign<'t>() -> impl Parser<Input<'t>, (), EmptyError> {
    alt((mark('%').void(), phrase("per cent"), exactly("percent | pct | percents").void()))
}

fn numeric(input: &mut Input<'_>) -> Outcome<Quantity> {
    let value = plain_number.parse_next(input)?;
    if let Some(below) = opt(preceded(mark('/'), plain_number)).parse_next(input)? {
        let value = value / below;
        return if value.is_finite() { Ok(Quantity { value, share: true }) } else { Err(EmptyError) };
    }
    match opt(percent_sign()).parse_next(input)? {
        Some(()) => Ok(Quantity { value: value / 100.0, share: true }),
        None => Ok(Quantity { value, share: false }),
    }
}

/// Parses a number in digits or words.
pub(crate) fn plain_number(input: &mut Input<'_>) -> Outcome<f64> {
    alt((digits, spoken_number)).parse_next(input)
}

fn digits(input: &mut Input<'_>) -> Outcome<f64> {
    let token = token(input)?;
    match token.kind {
        Kind::Number(value) => Ok(value),
        _ => Err(EmptyError),
    }
}

/// Largest number of words in a number.
const MAX_NUMBER_WORDS: usize = 8;

fn whole_number(words: &[&str]) -> Option<f64> {
    thread_local! {
        static ENGLISH: Language = Language::english();
    }
    // Ordinals are not numbers: "a third" is a fraction, "the third" a name.
    let text = ENGLISH.with(|english| text2digits(&words.join(" "), english)).ok()?;
    text.parse().ok()
}

fn spoken_number(input: &mut Input<'_>) -> Outcome<f64> {
    let words: Vec<&str> = remaining(input)
        .iter()
        .take(MAX_NUMBER_WORDS)
        .take_while(|t| t.kind == Kind::Word)
        .map(|t| t.text.as_str())
        .collect();
    // "a hundred" is 100, "a thousand" is 1000.
    let skipped = usize::from(matches!(words.get(..2), Some(["a", "hundred" | "thousand"])));
    let words = words.get(skipped..).unwrap_or_default();
    for length in (1..=words.len()).rev() {
        let Some(candidate) = words.get(..length) else { continue };
        let value = match candidate.iter().position(|w| *w == "point") {
            None => whole_number(candidate),
            Some(at) => decimal(candidate.get(..at).unwrap_or_default(), candidate.get(at + 1..).unwrap_or_default()),
        };
        if let Some(value) = value {
            advance(input, skipped + length);
            return Ok(value);
        }
    }
    Err(EmptyError)
}

/// Parses "zero point two five".
fn decimal(whole: &[&str], digits: &[&str]) -> Option<f64> {
    if digits.is_empty() {
        return None;
    }
    let mut value = if whole.is_empty() { 0.0 } else { whole_number(whole)? };
    let mut place = 0.1;
    for digit in digits {
        let digit = whole_number(&[digit]).filter(|d| *d < 10.0)?;
        value += digit * place;
        place /= 10.0;
    }
    Some((value * 1e9).round() / 1e9)
}

fn spoken_fraction(input: &mut Input<'_>) -> Outcome<Quantity> {
    const PARTS: [(&str, f64); 8] = [
        ("half", 2.0),
        ("third", 3.0),
        ("quarter", 4.0),
        ("fourth", 4.0),
        ("fifth", 5.0),
        ("sixth", 6.0),
        ("eighth", 8.0),
        ("tenth", 10.0),
    ];
    const ABOVE: &str = "a | one | two | three | four | five | six | seven | eight | nine";
    let above = opt(one_of(ABOVE)).parse_next(input)?.map_or(1.0, |place| place.max(1) as f64);
    let part = token(input)?;
    let below = PARTS
        .iter()
        .find(|(word, _)| part.text == *word || part.text.strip_suffix('s') == Some(word) || part.lemma == *word)
        .map(|(_, below)| *below)
        .ok_or(EmptyError)?;
    let of = opt(phrase("of")).parse_next(input)?;
    // "half of the sac" is not a number.
    if of.is_some() { Err(EmptyError) } else { Ok(Quantity { value: above / below, share: true }) }
}

/// Parses a count: `once`, `twice`, `three times`, `2x`, `two steps`.
pub(crate) fn times(input: &mut Input<'_>) -> Outcome<f64> {
    let adverb = one_of("once | twice | thrice").map(|place| (place + 1) as f64);
    let counted = (plain_number, exactly("times | time | x | steps | step | notches | notch")).map(|(n, _)| n);
    alt((adverb, counted)).parse_next(input)
}
