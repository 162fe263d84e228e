//! Tours from unit to unit: "give me a tour", "next stop", "pause the tour".

use sg_proto::language::{Act, Clause, TourStep};
use winnow::Parser;
use winnow::combinator::opt;
use winnow::error::EmptyError;

use super::command::{Command, Construct, Context, Effect, Field};
use crate::resolution::{Refusal, Step, target_of};
use crate::syntax::phrase::{Input, Outcome, end, exactly, one_of, over, skip};
use crate::syntax::reading::{Reading, Verb};
use crate::syntax::target::{target_alone, target_then};

/// Most stops of a tour.
pub(crate) const MAX_STOPS: usize = 32;

/// The command "tour".
pub(super) const TOUR: Command = Command {
    act: Act::Tour,
    title: "tour",
    constructs: &[
        Construct::new(
            "(none) | give me | give us | take me on | take us on | start | begin | do | make | run | play | launch | i want | \
             i would like | i'd like | can i have | could i have | let 's have | let's have | show me | show us | \
             let 's do | let's do | let 's take | let's take | lead me on | go on | another",
            a_tour,
        ),
        Construct::new(
            "tour | show me around | show us around | guide me through | guide us through | guide me around | walk me through | \
             walk us through | walk through | take me through | take us through | take me around | lead me through | \
             lead us through | fly me through | fly through | visit | present",
            through,
        ),
        Construct::new("pause | wait here | stay here", |_, i| paused(i)),
        Construct::new(
            "go on | continue | carry on | resume | proceed | keep going | unpause | go ahead | move along",
            |_, i| of_tour(TourStep::Resume, i),
        ),
        Construct::new(
            "next stop | the next stop | next one | the next one | go to the next | go on to the next | on to the next | move on | \
             move on to the next | skip | skip this | skip it | skip this one | skip ahead | to the next | show me the next | \
             show the next | next station",
            |_, i| of_tour(TourStep::Next, i),
        ),
        Construct::new("next", next_alone),
        Construct::new(
            "previous stop | the previous stop | previous one | go to the previous | back to the previous | \
             go back to the previous | to the previous | go back one | go back a | back one | show me the previous | \
             show the previous | previous | the last stop | go back to the last | back to the last",
            |_, i| of_tour(TourStep::Previous, i),
        ),
        Construct::new(
            "stop | end | quit | cancel | leave | abort | finish | exit | close | no more of | enough of | that 's enough of | \
             that is enough of",
            ended,
        ),
    ],
    examples: &["give me a tour", "pause the tour", "next stop"],
    fields: &[Field::optional("target"), Field::optional("tour")],
    effect: Effect::Possible,
    resolve,
};

const A_TOUR: &str = "tour | walkthrough | walk through | walk-through | flythrough | fly through | fly-through | round trip | \
     sightseeing tour | tour guide";

fn step(step: TourStep) -> Reading {
    Reading::plain(Act::Tour).map(|c| c.tour = step.into())
}

fn started(reading: Reading) -> Reading {
    reading.map(|c| c.tour = TourStep::Start.into())
}

fn the_tour(input: &mut Input<'_>) -> Outcome<()> {
    opt(exactly("the | this | that | our | my | a | an")).parse_next(input)?;
    skip("guided | little | quick | short | whole | complete | virtual").parse_next(input)?;
    one_of(A_TOUR).void().parse_next(input)
}

/// Parses "a guided tour of the scene", "the tour", "a tour through the vessel and the sac".
fn a_tour(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    skip("me | us | on").parse_next(input)?;
    the_tour(input)?;
    if opt(end).parse_next(input)?.is_some() {
        return Ok(started(Reading::plain(Act::Tour)));
    }
    one_of("of | through | around | over | across | to | about | along | for").parse_next(input)?;
    Ok(started(Reading::of(Act::Tour, target_alone(input)?)))
}

/// Parses "me around", "the vessels one by one", "every unit".
fn through(verb: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    if opt(end).parse_next(input)?.is_some() {
        // "present" and "visit" name what.
        let is_whole = !matches!(verb.phrase, "present" | "visit");
        return if is_whole { Ok(started(Reading::plain(Act::Tour))) } else { Err(EmptyError) };
    }
    let (target, ()) = target_then(input, |rest, _| {
        let each = opt(one_of("one by one | one after another | one after the other | in turn | each in turn"))
            .parse_next(rest)?
            .is_some();
        if matches!(verb.phrase, "present" | "visit") && !each {
            return Err(EmptyError);
        }
        end(rest)
    })?;
    Ok(started(Reading::of(Act::Tour, target)))
}

/// Parses "the tour", "here", and nothing.
fn paused(input: &mut Input<'_>) -> Outcome<Reading> {
    skip("a moment | a minute | a second | for a moment | for a minute | for a second | here | there")
        .parse_next(input)?;
    // "Wait" amid an utterance takes something back.
    if over(&mut input.clone()).is_err() {
        the_tour(input)?;
    }
    of_tour(TourStep::Pause, input)
}

/// Parses "the tour", "with the tour", and nothing.
fn of_tour(to: TourStep, input: &mut Input<'_>) -> Outcome<Reading> {
    skip("here | there").parse_next(input)?;
    skip("stop | one | station | unit | part | structure").parse_next(input)?;
    opt((opt(exactly("with | on | in | of")), the_tour)).parse_next(input)?;
    end(input)?;
    Ok(step(to))
}

/// Parses the end of the utterance after "next": "next, hide the bone" begins another command.
fn next_alone(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    over(&mut input.clone())?;
    end(input)?;
    Ok(step(TourStep::Next))
}

/// Parses "the tour". "Stop" alone is the whole utterance.
fn ended(verb: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    if verb.phrase == "stop" && over(&mut input.clone()).is_ok() {
        end(input)?;
        return Ok(step(TourStep::End));
    }
    skip("with | the rest of").parse_next(input)?;
    the_tour(input)?;
    end(input)?;
    Ok(step(TourStep::End))
}

/// Stops of a tour that begins: the visible units of the target. Without one they are the units that somebody saved, or else
/// those of the file.
fn resolve(clause: &Clause, context: &Context<'_>) -> Result<Step, Refusal> {
    let step = match clause.tour() {
        TourStep::Unspecified => TourStep::Start,
        step => step,
    };
    if step != TourStep::Start {
        return Ok(Step::Tour { step, stops: Vec::new() });
    }
    let state = context.state;
    let saved = || state.units.iter().filter(|unit| !unit.derived);
    let base = || state.base_units.iter().filter(|unit| unit.count > unit.deleted);
    let is_visible = |name: &String| {
        base().any(|unit| unit.name == *name && unit.visible && unit.opacity > 0.0)
            || saved().any(|unit| unit.name == *name && unit.visible && unit.opacity > 0.0)
    };
    let (named, mut stops): (bool, Vec<String>) = match &clause.target {
        Some(_) => {
            let target = target_of(clause, state)?;
            let all = || base().map(|unit| unit.name.clone()).chain(saved().map(|unit| unit.name.clone()));
            match (target.everything, target.complement) {
                (false, false) if target.units.is_empty() => {
                    return Err(Refusal::precondition("A tour visits units. Save the selection under a name first."));
                }
                (false, false) => (true, target.units),
                (everything, complement) => {
                    (false, all().filter(|name| everything || !complement || !target.units.contains(name)).collect())
                }
            }
        }
        None if saved().next().is_some() => (false, saved().map(|unit| unit.name.clone()).collect()),
        None => (false, base().map(|unit| unit.name.clone()).collect()),
    };
    if !named {
        stops.retain(is_visible);
    }
    stops.truncate(MAX_STOPS);
    if stops.is_empty() {
        return Err(Refusal::precondition("No unit is visible, so a tour has no stop. Say “show everything” first."));
    }
    Ok(Step::Tour { step, stops })
}
