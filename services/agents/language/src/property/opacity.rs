//! Values of opacity: adjectives, numbers, fading.

use winnow::Parser;
use winnow::combinator::{alt, opt};
use winnow::error::EmptyError;

use super::value::Value;
use crate::syntax::modifier::{MUCH, SLIGHTLY, connector, degree, factor_by};
use crate::syntax::number::{Quantity, quantity, times};
use crate::syntax::phrase::{Input, Outcome, article, exactly, one_of, skip};

/// An absolute opacity.
pub(crate) fn absolute(factor: f64) -> Outcome<Value> {
    if (0.0..=1000.0).contains(&factor) { Ok(Value::Opacity { factor, relative: false }) } else { Err(EmptyError) }
}

/// An absolute transparency.
pub(crate) fn transparency(share: f64) -> Outcome<Value> {
    if (0.0..=1.0).contains(&share) { absolute(1.0 - share) } else { Err(EmptyError) }
}

const TRANSPARENT: &str = "transparent | translucent | see through | seethrough | faint | ghostly";
const OPAQUE: &str = "opaque | solid | dense";

/// Parses an adjective of opacity: `true` for opaque, `false` for transparent.
fn adjective(input: &mut Input<'_>) -> Outcome<bool> {
    alt((one_of(TRANSPARENT).map(|_| false), one_of(OPAQUE).map(|_| true))).parse_next(input)
}

/// Parses an adjective, or the noun that stands with a number: "40 % transparency".
fn quality(input: &mut Input<'_>) -> Outcome<bool> {
    let noun = alt((exactly("transparency").map(|_| false), exactly("opacity").map(|_| true)));
    alt((adjective, noun)).parse_next(input)
}

/// Parses a value of opacity.
pub(crate) fn opacity(input: &mut Input<'_>) -> Outcome<Value> {
    alt((comparative, multiple, numeric_value, adjective_value)).parse_next(input)
}

/// Parses "a bit more transparent", "less opaque by 20 percent", "fainter".
fn comparative(input: &mut Input<'_>) -> Outcome<Value> {
    let degree = degree(input)?;
    let more = alt((
        (exactly("more | less"), quality).map(|(word, opaque)| (word.text == "more") == opaque),
        (exactly("more | less"), exactly("visible")).map(|(word, _)| word.text == "more"),
        exactly("fainter | dimmer").map(|_| false),
    ))
    .parse_next(input)?;
    let by = opt(|i: &mut Input<'_>| factor_by(more, i)).parse_next(input)?;
    let usual = if more { degree.pick(4.0 / 3.0, 2.0, 4.0) } else { degree.pick(0.75, 0.5, 0.25) };
    Ok(Value::Opacity { factor: by.unwrap_or(usual), relative: true })
}

/// Parses "twice as transparent", "half as opaque", "three times as opaque".
fn multiple(input: &mut Input<'_>) -> Outcome<Value> {
    let times = alt((exactly("half").map(|_| 0.5), times)).parse_next(input)?;
    exactly("as").parse_next(input)?;
    let opaque = quality(input)?;
    skip("as before | as now | as it is | as it was").parse_next(input)?;
    let factor = if opaque { times } else { 1.0 / times };
    if factor.is_finite() && factor > 0.0 { Ok(Value::Opacity { factor, relative: true }) } else { Err(EmptyError) }
}

/// Parses "50 percent transparent", "to 30 % opacity", "at an opacity of 0.3".
fn numeric_value(input: &mut Input<'_>) -> Outcome<Value> {
    skip("at | to | with | by | an | a | at an | with an | to an | at a | with a | to a").parse_next(input)?;
    let (value, opaque) =
        alt(((quantity, quality), (quality, connector, quantity).map(|(opaque, (), value)| (value, opaque))))
            .parse_next(input)?;
    let value = value.as_opacity();
    if opaque { absolute(value) } else { transparency(value) }
}

/// Parses "transparent", "semi-transparent", "nearly opaque", "completely transparent".
fn adjective_value(input: &mut Input<'_>) -> Outcome<Value> {
    const GRADES: &str = "semi | partly | partially | slightly | a bit | a little | a little bit | somewhat | very | \
     highly | mostly | really | quite | nearly | almost | nearly completely | almost completely | \
     fully | completely | totally | entirely | perfectly | absolutely";
    let grade = opt(one_of(GRADES)).parse_next(input)?;
    let opaque = adjective(input)?;
    // Opacity of "transparent" and of "opaque" with this adverb.
    let (transparent, solid) = match grade {
        None => (0.3, 1.0),
        Some(0..=2) => (0.5, 0.5),
        Some(3..=7) => (0.75, 0.25),
        Some(8..=12) => (0.1, 1.0),
        Some(13..=16) => (0.05, 0.9),
        Some(_) => (0.0, 1.0),
    };
    absolute(if opaque { solid } else { transparent })
}

/// Parses a share or factor in numbers or words.
pub(crate) fn amount(input: &mut Input<'_>) -> Outcome<f64> {
    let named = alt((
        one_of("full | maximum | max | the maximum | normal").map(|_| 1.0),
        one_of("none | minimum | nothing | the minimum").map(|_| 0.0),
    ));
    alt((named, quantity.map(|q: Quantity| q.as_opacity()))).parse_next(input)
}

pub(crate) fn faded(input: &mut Input<'_>) -> Outcome<Value> {
    let to = |input: &mut Input<'_>| {
        one_of("to | down to | until | at").parse_next(input)?;
        article(input)?;
        let value = amount(input)?;
        let opaque = opt(quality).parse_next(input)?;
        if opaque == Some(false) { transparency(value) } else { absolute(value) }
    };
    let by = |input: &mut Input<'_>| Ok(Value::Opacity { factor: factor_by(false, input)?, relative: true });
    let words = alt((
        one_of(SLIGHTLY).map(|_| Value::Opacity { factor: 0.75, relative: true }),
        one_of(MUCH).map(|_| Value::Opacity { factor: 0.25, relative: true }),
        one_of("completely | fully | entirely | totally").map(|_| Value::Opacity { factor: 0.0, relative: false }),
        one_of("halfway | half way | by half | half").map(|_| Value::Opacity { factor: 0.5, relative: true }),
    ));
    alt((to, by, words)).parse_next(input)
}
