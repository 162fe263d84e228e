//! Orbits: "rotate left 30 degrees".

use sg_proto::language::Act;
use sg_proto::scene::{Orbit, set_view};
use winnow::Parser;
use winnow::combinator::{alt, opt};
use winnow::error::EmptyError;

use super::command::{Command, Construct, Effect, Ellipsis};
use super::set_view::{SET_VIEW_FIELDS, resolve_view};
use crate::syntax::modifier::{MUCH, SLIGHTLY};
use crate::syntax::number::{plain_number, quantity, times};
use crate::syntax::phrase::{Input, Outcome, article, end, exactly, mark, one_of, phrase, skip};
use crate::syntax::reading::{Reading, Verb};
use crate::syntax::target::target_then;

/// The command "rotate".
pub(super) const ORBIT: Command = Command {
    act: Act::SetView,
    title: "rotate",
    constructs: &[Construct::with_ellipsis(
        "rotate | turn | spin | orbit | tilt | swing | move | go | revolve",
        Ellipsis::Verb,
        orbit,
    )],
    examples: &["rotate left 30 degrees", "turn it up", "rotate by 90 degrees"],
    fields: SET_VIEW_FIELDS,
    effect: Effect::Visible,
    resolve: resolve_view,
};

fn turned(azimuth_degrees: f64, elevation_degrees: f64) -> Reading {
    Reading::view(set_view::Change::Orbit(Orbit { azimuth_degrees, elevation_degrees }))
}

/// Default angle, degrees.
const DEFAULT_DEGREES: f64 = 30.0;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Direction {
    Left,
    Right,
    Up,
    Down,
}

/// Parses "left 30 degrees", "by 45° to the right", "it up", "around", "the view a bit to the left".
///
/// The camera moves in the named direction. An object turns in the named direction, so the camera moves the other
/// way.
pub(super) fn orbit(verb: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let camera = opt(alt((
        one_of("the view | the camera | the viewpoint | the eye | view | camera | me | my view").map(|_| true),
        one_of(
            "it | the scene | the object | the model | the volume | the data | the picture | the image | \
         everything | this | the whole scene | the whole thing | the view of it",
        )
        .map(|_| false),
    )))
    .parse_next(input)?;
    if matches!(verb.phrase, "move" | "go") && camera == Some(false) {
        // Moving an object is not a rotation.
        return Err(EmptyError);
    }
    if camera.is_none() && !matches!(verb.phrase, "move" | "go") {
        let of_unit = |input: &mut Input<'_>| {
            let (target, turn) = target_then(input, |rest, _| angles(rest))?;
            // A unit turns by itself; "it" without more is the picture.
            let unit = !target.reference.names.is_empty() || target.reference.selection;
            if target.unknown > 0 || unit { Err(EmptyError) } else { Ok(turn) }
        };
        if let Some((azimuth, elevation)) = opt(of_unit).parse_next(input)? {
            return Ok(turned(-azimuth, -elevation));
        }
    }
    let (azimuth, elevation) = angles(input)?;
    let sign = if camera == Some(false) { -1.0 } else { 1.0 };
    Ok(turned(sign * azimuth, sign * elevation))
}

/// Parses azimuth and elevation of the camera, degrees.
fn angles(input: &mut Input<'_>) -> Outcome<(f64, f64)> {
    let around = |input: &mut Input<'_>| {
        one_of(
            "around | round | half way around | halfway around | half way round | halfway round | \
         half around | to the other side",
        )
        .parse_next(input)?;
        end(input)?;
        Ok((180.0, 0.0))
    };
    let parts = |input: &mut Input<'_>| {
        let before = opt(angle).parse_next(input)?;
        let direction = opt(direction).parse_next(input)?;
        let after = if before.is_none() { opt(angle).parse_next(input)? } else { None };
        let repeated = opt(times).parse_next(input)?.unwrap_or(1.0);
        skip("around | round").parse_next(input)?;
        end(input)?;
        let degrees = before.or(after);
        if direction.is_none() && degrees.is_none() {
            return Err(EmptyError);
        }
        let degrees = degrees.unwrap_or(DEFAULT_DEGREES) * repeated;
        if !(degrees > 0.0 && degrees <= 3600.0) {
            return Err(EmptyError);
        }
        Ok(match direction.unwrap_or(Direction::Right) {
            Direction::Left => (-degrees, 0.0),
            Direction::Right => (degrees, 0.0),
            Direction::Up => (0.0, degrees),
            Direction::Down => (0.0, -degrees),
        })
    };
    alt((around, parts)).parse_next(input)
}

fn direction(input: &mut Input<'_>) -> Outcome<Direction> {
    skip("to | towards | toward").parse_next(input)?;
    article(input)?;
    let found = alt((
        exactly("left | leftwards | leftward").map(|_| Direction::Left),
        exactly("right | rightwards | rightward").map(|_| Direction::Right),
        exactly("up | upwards | upward").map(|_| Direction::Up),
        exactly("down | downwards | downward").map(|_| Direction::Down),
    ))
    .parse_next(input)?;
    opt(exactly("side")).parse_next(input)?;
    Ok(found)
}

pub(super) fn angle(input: &mut Input<'_>) -> Outcome<f64> {
    fn unit(input: &mut Input<'_>) -> Outcome<()> {
        alt((mark('°').void(), exactly("degrees | degree | deg | degs").void())).parse_next(input)
    }
    skip("by | through | another").parse_next(input)?;
    let part_of_a_turn = |input: &mut Input<'_>| {
        let share = quantity(input)?;
        opt(exactly("a")).parse_next(input)?;
        exactly("turn | turns | rotation | circle | revolution").parse_next(input)?;
        if share.share { Ok(360.0 * share.value) } else { Err(EmptyError) }
    };
    let counted = |input: &mut Input<'_>| {
        let degrees = plain_number(input)?;
        // "two times" is a count, not an angle.
        if opt(exactly("times | time | x | steps | step")).parse_next(input)?.is_some() {
            return Err(EmptyError);
        }
        opt(unit).parse_next(input)?;
        Ok(degrees)
    };
    alt((
        part_of_a_turn,
        counted,
        one_of(SLIGHTLY).map(|_| 10.0),
        one_of(MUCH).map(|_| 60.0),
        phrase("further").map(|()| DEFAULT_DEGREES),
    ))
    .parse_next(input)
}
