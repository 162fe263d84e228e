//! Values of the volume: ranges of values, and the level and window of a transfer function.

use sg_proto::scene::{ValueRange, ValueWindow};
use winnow::Parser;
use winnow::combinator::{alt, opt, preceded};
use winnow::error::EmptyError;

use crate::syntax::modifier::{Degree, connector, degree};
use crate::syntax::number::plain_number;
use crate::syntax::phrase::{Input, Outcome, article, end, exactly, mark, one_of, skip};

/// Largest number of a value, either sign.
const MAX_VALUE: f64 = 1e9;

/// Parses a number of either sign with its unit: "-600", "minus 600 HU", "1.5".
pub(crate) fn value(input: &mut Input<'_>) -> Outcome<f64> {
    let is_negative =
        opt(alt((mark('-').void(), mark('\u{2212}').void(), exactly("minus | negative").void()))).parse_next(input)?;
    let size = plain_number.parse_next(input)?;
    skip("hu | hounsfield units | hounsfield").parse_next(input)?;
    let value = if is_negative.is_some() { -size } else { size };
    if value.abs() <= MAX_VALUE { Ok(value) } else { Err(EmptyError) }
}

/// Parses "values above 200", "everything below 0.3", "the densities between 100 and 200".
pub(crate) fn values(input: &mut Input<'_>) -> Outcome<ValueRange> {
    skip("me").parse_next(input)?;
    opt(exactly("all | only | just")).parse_next(input)?;
    article(input)?;
    skip("of the").parse_next(input)?;
    exactly(
        "value | values | voxel | voxels | intensity | intensities | density | densities | scalar | scalars | data | \
         everything | anything | all | parts | regions",
    )
    .parse_next(input)?;
    skip("with | that are | that is | which are | lying | with values | with a value | with a density | with intensities")
        .parse_next(input)?;
    range(input)
}

/// Parses "above 200", "below 0.3", "between 100 and 200", "from 100 to 200".
pub(crate) fn range(input: &mut Input<'_>) -> Outcome<ValueRange> {
    let between = |input: &mut Input<'_>| {
        one_of("between | from | in the range from | in the range of | in the range | within | in | ranging from")
            .parse_next(input)?;
        let low = value(input)?;
        opt(alt((
            exactly("and | to | until | till | through").void(),
            mark('-').void(),
            mark('\u{2013}').void(),
            mark('\u{2026}').void(),
        )))
        .parse_next(input)?;
        let high = value(input)?;
        Ok(ValueRange { low: Some(low.min(high)), high: Some(low.max(high)) })
    };
    let above = |input: &mut Input<'_>| {
        alt((
            one_of(
                "above | over | greater than | more than | higher than | larger than | bigger than | at least | beyond | \
                 exceeding | from | starting at | denser than | brighter than",
            )
            .void(),
            mark('>').void(),
        ))
        .parse_next(input)?;
        opt(mark('=')).parse_next(input)?;
        let low = value(input)?;
        skip("up | upwards | on | and above | and up | or more | and higher").parse_next(input)?;
        Ok(ValueRange { low: Some(low), high: None })
    };
    let below = |input: &mut Input<'_>| {
        alt((
            one_of(
                "below | under | less than | lower than | smaller than | at most | up to | fainter than | darker than",
            )
            .void(),
            mark('<').void(),
        ))
        .parse_next(input)?;
        opt(mark('=')).parse_next(input)?;
        Ok(ValueRange { low: None, high: Some(value(input)?) })
    };
    alt((between, above, below)).parse_next(input)
}

/// One of the two numbers of a window.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Term {
    /// Level: the middle of the values.
    Level,
    /// Window: the width of the values.
    Window,
}

/// Parses "level", "window width", "the centre of the window".
pub(crate) fn term(input: &mut Input<'_>) -> Outcome<Term> {
    article(input)?;
    let level = one_of(
        "window level | window center | window centre | level of the window | center of the window | \
         centre of the window | level | center | centre | l",
    )
    .map(|_| Term::Level);
    let window = one_of("window width | width of the window | window size | window | width | w").map(|_| Term::Window);
    // The longer phrases begin with the shorter ones' words.
    alt((one_of("window width | window size").map(|_| Term::Window), level, window)).parse_next(input)
}

/// Parses "level 300, window 1500", "a window of 80 and a level of 40", "w 1500 l 300".
pub(crate) fn window(input: &mut Input<'_>) -> Outcome<ValueWindow> {
    let mut found = ValueWindow::default();
    set(&mut found, input)?;
    let mut more = *input;
    let second =
        opt(alt(((mark(','), opt(exactly("and | with"))).void(), mark('/').void(), exactly("and | with | at").void())))
            .parse_next(&mut more)
            .and_then(|_| set(&mut found, &mut more));
    if second.is_ok() {
        *input = more;
    }
    end(input)?;
    Ok(found)
}

/// Parses one of the two numbers. Each is given once.
fn set(found: &mut ValueWindow, input: &mut Input<'_>) -> Outcome<()> {
    let term = term(input)?;
    connector(input)?;
    let number = value(input)?;
    let slot = match term {
        Term::Level => &mut found.level,
        Term::Window => &mut found.window,
    };
    if slot.is_some() || (term == Term::Window && number <= 0.0) {
        return Err(EmptyError);
    }
    *slot = Some(number);
    Ok(())
}

/// Parses the rest of "raise the level by 100", "widen the window a bit".
pub(crate) fn stepped(term: Term, grows: bool, input: &mut Input<'_>) -> Outcome<ValueWindow> {
    let by = opt(preceded(exactly("by"), value)).parse_next(input)?;
    let degree = degree(input)?;
    end(input)?;
    let sign = if grows { 1.0 } else { -1.0 };
    Ok(match (term, by) {
        (_, None) => step(term, grows, degree),
        (Term::Level, Some(by)) => ValueWindow { level_change: sign * by, ..ValueWindow::default() },
        (Term::Window, Some(by)) => ValueWindow { window_change: sign * by, ..ValueWindow::default() },
    })
}

/// Parses "wider window", "a bit lower level".
pub(crate) fn compared(input: &mut Input<'_>) -> Outcome<ValueWindow> {
    article(input)?;
    let degree = degree(input)?;
    let words =
        [("wider | broader | larger", Term::Window, true), ("narrower | tighter | smaller", Term::Window, false)];
    let words = words.into_iter().chain([("higher", Term::Level, true), ("lower", Term::Level, false)]);
    for (word, of, grows) in words {
        if opt(exactly(word)).parse_next(input)?.is_some() {
            let named = term(input)?;
            end(input)?;
            return if named == of { Ok(step(of, grows, degree)) } else { Err(EmptyError) };
        }
    }
    Err(EmptyError)
}

/// A step that people can see: a part of the window for the level, a factor for the window.
fn step(term: Term, grows: bool, degree: Degree) -> ValueWindow {
    let sign = if grows { 1.0 } else { -1.0 };
    match term {
        Term::Level => ValueWindow { level_shift: sign * degree.pick(0.05, 0.15, 0.4), ..ValueWindow::default() },
        Term::Window => {
            let factor: f64 = degree.pick(1.15, 1.4, 2.0);
            ValueWindow { window_factor: Some(factor.powf(sign)), ..ValueWindow::default() }
        }
    }
}
