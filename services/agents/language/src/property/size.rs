//! Values of size: "twice as big", "to 50 %", "by a factor of 2".

use winnow::Parser;
use winnow::combinator::{alt, opt};
use winnow::error::EmptyError;

use crate::syntax::number::{Quantity, quantity, times};
use crate::syntax::phrase::{Input, Outcome, exactly, one_of, phrase, skip};

const BIG: &str = "big | large | tall | long | wide";

/// Least and greatest factor that a sentence gives.
const FACTORS: std::ops::RangeInclusive<f64> = 0.001..=1000.0;

fn checked(factor: f64) -> Outcome<f64> {
    if FACTORS.contains(&factor) { Ok(factor) } else { Err(EmptyError) }
}

/// Parses a factor on the size after "make the sac": "twice as big", "half the size", "20 % bigger".
pub(crate) fn multiple(input: &mut Input<'_>) -> Outcome<f64> {
    let share = |input: &mut Input<'_>| {
        let amount = quantity(input)?;
        if amount.share { Ok(amount.value) } else { Err(EmptyError) }
    };
    let as_big = |input: &mut Input<'_>| {
        let times = alt((exactly("half").map(|_| 0.5), times, share)).parse_next(input)?;
        exactly("as").parse_next(input)?;
        let big = alt((exactly(BIG).map(|_| true), exactly("small").map(|_| false))).parse_next(input)?;
        skip("as before | as now | as it is | as it was").parse_next(input)?;
        Ok(if big { times } else { 1.0 / times })
    };
    let of_its_size = |input: &mut Input<'_>| {
        let times =
            alt((exactly("half").map(|_| 0.5), exactly("double").map(|_| 2.0), times, share)).parse_next(input)?;
        skip("of").parse_next(input)?;
        exactly("the | its | their").parse_next(input)?;
        opt(exactly("former | original | present | current | old")).parse_next(input)?;
        exactly("size").parse_next(input)?;
        Ok(times)
    };
    let bigger = |input: &mut Input<'_>| {
        let by = share(input)?;
        let grows =
            alt((exactly("bigger | larger").map(|_| true), exactly("smaller").map(|_| false))).parse_next(input)?;
        Ok(if grows { 1.0 + by } else { 1.0 - by })
    };
    let bigger_by = |input: &mut Input<'_>| {
        let grows =
            alt((exactly("bigger | larger").map(|_| true), exactly("smaller").map(|_| false))).parse_next(input)?;
        factor_by(Some(grows), input)
    };
    alt((as_big, of_its_size, bigger, bigger_by)).parse_next(input).and_then(checked)
}

/// Parses a factor after "scale the sac": "to 50 %", "by 2", "by a factor of 2", "to half its size", "twice".
pub(crate) fn factor(grows: Option<bool>, input: &mut Input<'_>) -> Outcome<f64> {
    let to = |input: &mut Input<'_>| {
        phrase("to").parse_next(input)?;
        skip("be").parse_next(input)?;
        let value = alt((multiple, numeral)).parse_next(input)?;
        skip("of its size | of the size | of its former size | its size | the size | of its original size")
            .parse_next(input)?;
        Ok(value)
    };
    let twice = |input: &mut Input<'_>| {
        let value = times(input)?;
        Ok(if grows == Some(false) { 1.0 / value } else { value })
    };
    alt((to, |i: &mut Input<'_>| factor_by(grows, i), multiple, twice)).parse_next(input).and_then(checked)
}

/// A factor. A bare number above 10 is a percentage.
fn numeral(input: &mut Input<'_>) -> Outcome<f64> {
    let value = alt((one_of("half").map(|_| 0.5), quantity.map(Quantity::as_opacity))).parse_next(input)?;
    opt(exactly("x | times")).parse_next(input)?;
    Ok(value)
}

/// "by 2", "by a factor of 2", "by 20 %". Without a direction "by 50 %" is half.
fn factor_by(grows: Option<bool>, input: &mut Input<'_>) -> Outcome<f64> {
    phrase("by").parse_next(input)?;
    let plain = opt(one_of("a factor of | a factor")).parse_next(input)?.is_some();
    let amount = quantity(input)?;
    opt(exactly("x | times")).parse_next(input)?;
    match (grows, plain || !amount.share) {
        (Some(false), true) => Ok(1.0 / amount.value),
        (_, true) => Ok(amount.as_opacity()),
        (Some(true), false) => Ok(1.0 + amount.value),
        (Some(false), false) => Ok(1.0 - amount.value),
        (None, false) => Ok(amount.value),
    }
}
