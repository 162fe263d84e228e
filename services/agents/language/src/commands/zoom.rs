//! Zoom: "zoom in", "zoom to 200 %".

use sg_proto::language::Act;
use sg_proto::scene::set_view;
use winnow::Parser;
use winnow::combinator::opt;
use winnow::error::EmptyError;

use super::command::{Command, Construct, Effect, Ellipsis};
use super::set_view::{SET_VIEW_FIELDS, resolve_view};
use super::verbs::MAKE;
use crate::property::assignment::becoming;
use crate::syntax::modifier::{Degree, degree};
use crate::syntax::number::{plain_number, quantity, times};
use crate::syntax::phrase::{Input, Outcome, end, exactly, one_of, phrase, skip};
use crate::syntax::reading::{Reading, Verb};

/// The command "zoom".
pub(super) const ZOOM: Command = Command {
    act: Act::SetView,
    title: "zoom",
    constructs: &[
        Construct::new(
            "zoom in | zoom closer | closer | get closer | go closer | come closer | \
                 move closer | move in | magnify | enlarge | bigger | larger | make it bigger | \
                 make it larger | nearer | zoom it in | zoom the view in | a bit closer | \
                 a little closer | much closer",
            |_, input| zoom(true, input),
        ),
        Construct::new(
            "back off | back up | zoom out | zoom back | zoom back out | zoom away | further away | farther away | \
                 move back | move out | move away | go further away | step back | smaller | \
                 make it smaller | shrink | further out | pull back",
            |_, input| zoom(false, input),
        ),
        Construct::new("zoom | magnify | set the zoom | zoom the view", zoom_to),
        Construct::with_ellipsis(MAKE, Ellipsis::VerbTargetOrValue, becoming),
    ],
    examples: &["zoom in", "zoom out twice", "zoom to 200 %"],
    fields: SET_VIEW_FIELDS,
    effect: Effect::Visible,
    resolve: resolve_view,
};

fn zoomed(factor: f64, input: &mut Input<'_>) -> Outcome<Reading> {
    end(input)?;
    if (0.01..=100.0).contains(&factor) { Ok(Reading::view(set_view::Change::Zoom(factor))) } else { Err(EmptyError) }
}

/// Parses "twice", "a bit", "by 50 %", "2x", "to 200 %".
fn zoom(closer: bool, input: &mut Input<'_>) -> Outcome<Reading> {
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

/// Parses "to 200 %", "2x", "by 150 percent".
fn zoom_to(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    skip("to | by | at | it to | it by | by a factor of | up to").parse_next(input)?;
    let value = quantity(input)?;
    opt(exactly("x | times")).parse_next(input)?;
    zoomed(value.as_opacity(), input)
}
