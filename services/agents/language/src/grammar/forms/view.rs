//! The viewpoint: sides, targets, turns, distance.

use sg_proto::language::{Act, Reference};
use sg_proto::scene::{NamedView, Orbit, SetView, Target as SceneTarget, set_view::Change};
use winnow::Parser;
use winnow::combinator::{alt, opt};
use winnow::error::EmptyError;

use super::{Degree, Reading, degree};
use crate::grammar::phrase::{
    Input, Outcome, article, end, exactly, mark, one_of, phrase, plain_number, quantity, skip, times,
};
use crate::grammar::target::{Target, target_then};

fn view(change: Change) -> Reading {
    let view = SetView { change: Some(change) };
    Reading::plain(Act::SetView).map(|c| c.view = Some(view.clone()))
}

fn turned(azimuth_degrees: f64, elevation_degrees: f64) -> Reading {
    view(Change::Orbit(Orbit { azimuth_degrees, elevation_degrees }))
}

fn side_name(input: &mut Input<'_>) -> Outcome<NamedView> {
    alt((
        exactly("front | anterior").map(|_| NamedView::Front),
        exactly("back | behind | rear | posterior").map(|_| NamedView::Back),
        exactly("left").map(|_| NamedView::Left),
        exactly("right").map(|_| NamedView::Right),
        exactly("top | above | superior | overhead | cranial").map(|_| NamedView::Top),
        exactly("bottom | below | underneath | beneath | inferior | caudal").map(|_| NamedView::Bottom),
    ))
    .parse_next(input)
}

const VIEW: &str = "view | viewpoint | perspective | side | position | angle | camera";

/// "from the top", "it from above", "the top view", "the view"; with "reset", the view it was opened with.
pub(super) fn side(opening: &str, input: &mut Input<'_>) -> Outcome<Reading> {
    let back_side = |input: &mut Input<'_>| {
        skip("from").parse_next(input)?;
        article(input)?;
        one_of("other side | opposite side | far side | reverse side").parse_next(input)?;
        end(input)?;
        Ok(turned(180.0, 0.0))
    };
    let initial = |input: &mut Input<'_>| {
        skip("to | back to").parse_next(input)?;
        article(input)?;
        const FIRST: &str = "initial | original | first | starting | start | default | home | opening | usual";
        if matches!(opening, "reset" | "restore" | "recentre" | "recenter") {
            opt(exactly(FIRST)).parse_next(input)?;
            exactly(
                "view | viewpoint | camera | zoom | perspective | rotation | orientation | position | \
             angle | distance",
            )
            .parse_next(input)?;
        } else {
            let home = opt((exactly("home"), end)).parse_next(input)?;
            if home.is_some() && opening.is_empty() {
                return Err(EmptyError);
            }
            if home.is_none() {
                exactly(FIRST).parse_next(input)?;
                exactly(VIEW).parse_next(input)?;
            }
        }
        end(input)?;
        Ok(view(Change::Named(NamedView::Initial.into())))
    };
    let from = |input: &mut Input<'_>| {
        exactly("from").parse_next(input)?;
        article(input)?;
        let side = side_name(input)?;
        opt((opt(exactly("hand")), exactly("side | direction"))).parse_next(input)?;
        skip("of it | of the scene").parse_next(input)?;
        end(input)?;
        Ok(side)
    };
    let named = |input: &mut Input<'_>| {
        skip("at | to | back to | at it | me").parse_next(input)?;
        article(input)?;
        let side = alt((
            (exactly(VIEW), from).map(|(_, side)| side),
            (exactly(VIEW), exactly("to"), opt(article), side_name, end).map(|(.., side, ())| side),
            from,
            (side_name, opt(exactly("hand")), exactly(VIEW), end).map(|(side, ..)| side),
        ))
        .parse_next(input)?;
        Ok(view(Change::Named(side.into())))
    };
    // "the sac from above": the view is of the whole scene whatever was named, but only of what is there.
    let of_target = |input: &mut Input<'_>| {
        skip("at").parse_next(input)?;
        let (target, side) = target_then(input, |rest, _| from(rest))?;
        if target.unknown > 0 { Err(EmptyError) } else { Ok(view(Change::Named(side.into()))) }
    };
    alt((back_side, initial, named, of_target)).parse_next(input)
}

/// A target to look at.
pub(super) fn look_at(opening: &str, input: &mut Input<'_>) -> Outcome<Reading> {
    fn focused(target: Target) -> Reading {
        let view = SetView { change: Some(Change::Focus(SceneTarget::default())) };
        Reading::of(Act::SetView, target).map(|c| c.view = Some(view.clone()))
    }
    if matches!(opening, "fit" | "frame") {
        let whole = |input: &mut Input<'_>| {
            one_of(
                "to the window | to window | to the screen | to screen | to the view | to view | \
             the view | view | the window",
            )
            .parse_next(input)?;
            end(input)
        };
        if opt(whole).parse_next(input)?.is_some() {
            let reference = Reference { everything: true, ..Reference::default() };
            return Ok(focused(Target { reference, unknown: 0 }));
        }
    }
    skip("the camera on | the view on | the camera at | me").parse_next(input)?;
    let (target, ()) = target_then(input, |rest, _| {
        let tail = opt(one_of(
            "is | are | in the view | into view | into the view | in view | closely | more closely | \
         up close | closer | into focus | in the centre | in the center | in the middle | \
         to the window | to the view",
        ))
        .parse_next(rest)?;
        if opening == "bring" && tail.is_none() {
            return Err(EmptyError);
        }
        end(rest)
    })?;
    Ok(focused(target))
}

/// Degrees of a turn whose angle is not said.
const USUAL_TURN: f64 = 30.0;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Direction {
    Left,
    Right,
    Up,
    Down,
}

/// "left 30 degrees", "by 45° to the right", "it up", "around", "the view a bit to the left".
///
/// Without an object, and for the view or the camera, the eye moves the way that is said; a thing that is turned left
/// shows its right side, so for it the eye moves the other way.
pub(super) fn turn(opening: &str, input: &mut Input<'_>) -> Outcome<Reading> {
    let eye = opt(alt((
        one_of("the view | the camera | the viewpoint | the eye | view | camera | me | my view").map(|_| true),
        one_of(
            "it | the scene | the object | the model | the volume | the data | the picture | the image | \
         everything | this | the whole scene | the whole thing | the view of it",
        )
        .map(|_| false),
    )))
    .parse_next(input)?;
    if matches!(opening, "move" | "go") && eye == Some(false) {
        // To move a thing is not to turn it.
        return Err(EmptyError);
    }
    if eye.is_none() && !matches!(opening, "move" | "go") {
        let of_unit = |input: &mut Input<'_>| {
            let (target, turn) = target_then(input, |rest, _| angles(rest))?;
            if target.unknown > 0 { Err(EmptyError) } else { Ok(turn) }
        };
        if let Some((azimuth, elevation)) = opt(of_unit).parse_next(input)? {
            return Ok(turned(-azimuth, -elevation));
        }
    }
    let (azimuth, elevation) = angles(input)?;
    let sign = if eye == Some(false) { -1.0 } else { 1.0 };
    Ok(turned(sign * azimuth, sign * elevation))
}

/// Azimuth and elevation in degrees, as the eye would move.
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
        let said = before.or(after);
        if direction.is_none() && said.is_none() {
            return Err(EmptyError);
        }
        let degrees = said.unwrap_or(USUAL_TURN) * repeated;
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

fn angle(input: &mut Input<'_>) -> Outcome<f64> {
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
        // "two times" repeats a turn; it is not an angle.
        if opt(exactly("times | time | x | steps | step")).parse_next(input)?.is_some() {
            return Err(EmptyError);
        }
        opt(unit).parse_next(input)?;
        Ok(degrees)
    };
    alt((
        part_of_a_turn,
        counted,
        one_of(super::SLIGHTLY).map(|_| 10.0),
        one_of(super::MUCH).map(|_| 60.0),
        phrase("further").map(|()| USUAL_TURN),
    ))
    .parse_next(input)
}

fn zoomed(factor: f64, input: &mut Input<'_>) -> Outcome<Reading> {
    end(input)?;
    if (0.01..=100.0).contains(&factor) { Ok(view(Change::Zoom(factor))) } else { Err(EmptyError) }
}

/// "twice", "a bit", "by 50 %", "2x", "to 200 %".
pub(super) fn zoom(closer: bool, input: &mut Input<'_>) -> Outcome<Reading> {
    let directed = |factor: f64| if closer { factor } else { 1.0 / factor };
    skip("more | further | closer | it | again | some more | even more").parse_next(input)?;
    let absolute = opt((exactly("to"), quantity)).parse_next(input)?;
    if let Some((_, value)) = absolute {
        return zoomed(value.as_opacity(), input);
    }
    let by = opt(|i: &mut Input<'_>| {
        if opt(phrase("by")).parse_next(i)?.is_some() {
            let factor = opt(one_of("a factor of | a factor")).parse_next(i)?;
            let amount = quantity(i)?;
            opt(exactly("x | times")).parse_next(i)?;
            return match (amount.share && factor.is_none(), closer) {
                (true, true) => Ok(1.0 + amount.value),
                (true, false) => Ok(1.0 - amount.value),
                (false, true) if amount.value > 10.0 => Ok(1.0 + amount.value / 100.0),
                (false, false) if amount.value > 10.0 => Ok(1.0 - amount.value / 100.0),
                (false, _) => Ok(directed(amount.value)),
            };
        }
        Err(EmptyError)
    })
    .parse_next(input)?;
    if let Some(factor) = by {
        return zoomed(factor, input);
    }
    let magnified = opt(|i: &mut Input<'_>| {
        let value = plain_number(i)?;
        exactly("x").parse_next(i)?;
        Ok(value)
    })
    .parse_next(input)?;
    if let Some(value) = magnified {
        return zoomed(directed(value), input);
    }
    let percent = opt(|i: &mut Input<'_>| {
        let amount = quantity(i)?;
        if amount.share { Ok(amount.value) } else { Err(EmptyError) }
    })
    .parse_next(input)?;
    if let Some(share) = percent {
        return zoomed(if closer { 1.0 + share } else { 1.0 - share }, input);
    }
    let steps = opt(times).parse_next(input)?.unwrap_or(1.0);
    let degree: Degree = degree(input)?;
    skip("more | further | closer | some more").parse_next(input)?;
    zoomed(directed(degree.pick(1.2, 1.5, 2.5).powf(steps)), input)
}

/// "to 200 %", "2x", "by 150 percent".
pub(super) fn zoom_to(input: &mut Input<'_>) -> Outcome<Reading> {
    skip("to | by | at | it to | it by | by a factor of | up to").parse_next(input)?;
    let value = quantity(input)?;
    opt(exactly("x | times")).parse_next(input)?;
    zoomed(value.as_opacity(), input)
}
