//! Opacity of a target.

use sg_proto::language::{Act, Clause};
use sg_proto::scene::SetOpacity;
use sg_proto::scene::command::Action;
use winnow::Parser;
use winnow::combinator::{alt, opt};
use winnow::error::EmptyError;

use super::command::{Command, Construct, Context, Effect, Ellipsis, Field};
use super::verbs::{DECREASE, INCREASE, MAKE, SET};
use crate::property::assignment::{becoming, property, restoring};
use crate::property::opacity::{absolute, amount, faded, transparency};
use crate::property::tone::Term;
use crate::property::value::{Value, assign, property_name};
use crate::resolution::{Refusal, Step, number, target_of};
use crate::syntax::modifier::{degree, factor_by};
use crate::syntax::phrase::{Input, Outcome, article, end, exactly, one_of, skip};
use crate::syntax::reading::{Property, Reading, Verb};
use crate::syntax::target::{focus, target_then};

/// The command "opacity".
pub(super) const SET_OPACITY: Command = Command {
    act: Act::SetOpacity,
    title: "opacity",
    constructs: &[
        Construct::with_ellipsis(MAKE, Ellipsis::VerbTargetOrValue, becoming),
        Construct::with_ellipsis(SET, Ellipsis::PropertyOrValue, property),
        Construct::with_ellipsis(
            "fade | fade out | fade down | dim | ghost | tone down | thin | thin out",
            Ellipsis::VerbOrValue,
            fading,
        ),
        Construct::with_ellipsis(INCREASE, Ellipsis::Verb, |verb, input| term_change(verb, true, input)),
        Construct::with_ellipsis(DECREASE, Ellipsis::Verb, |verb, input| term_change(verb, false, input)),
        Construct::new("reset | restore | bring back", restoring),
    ],
    examples: &[
        "fade everything else to 20 percent",
        "set the opacity of the {unit} to 0.3",
        "make the {unit} half transparent",
        "make it more transparent",
        "dim the {unit} by 50 %",
        "make the {unit} opaque",
        "set the transparency of the {unit} to 80 %",
        "reduce the opacity of the {unit} by a third",
    ],
    fields: &[Field::required("target"), Field::required("amount"), Field::required("relative")],
    effect: Effect::Coverage,
    resolve,
};

/// Parses "the rest to 20 percent", "the soil by half", "the soil a bit", "to 20 percent".
fn fading(verb: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let usual = match verb.phrase {
        "fade out" => Value::Opacity { factor: 0.1, relative: false },
        "ghost" => Value::Opacity { factor: 0.15, relative: false },
        _ => Value::Opacity { factor: 0.5, relative: true },
    };
    let with_target = |input: &mut Input<'_>| {
        let (target, value) = target_then(input, |rest, _| {
            let away = opt(exactly("out | away | down | back | off")).parse_next(rest)?;
            let usual = match away.map(|t| t.text.as_str()) {
                Some("out" | "away" | "off") => Value::Opacity { factor: 0.1, relative: false },
                _ => usual.clone(),
            };
            let by = opt(faded).parse_next(rest)?;
            end(rest)?;
            Ok(by.unwrap_or(usual))
        })?;
        assign(target, value)
    };
    let without = |input: &mut Input<'_>| {
        let value = faded(input)?;
        end(input)?;
        assign(focus(), value)
    };
    alt((with_target, without)).parse_next(input)
}

/// Parses "the opacity of the sac by a third", "the sac's transparency to 80 %", "its saturation".
pub(super) fn term_change(verb: Verb, raised: bool, input: &mut Input<'_>) -> Outcome<Reading> {
    let of = |input: &mut Input<'_>| {
        article(input)?;
        let property = property_name(input)?;
        match opt(exactly("of | for | on")).parse_next(input)? {
            Some(_) => {
                let (target, value) = target_then(input, |rest, _| changed(verb, raised, property, rest))?;
                assign(target, value)
            }
            None => {
                let value = changed(verb, raised, property, input)?;
                assign(focus(), value)
            }
        }
    };
    let after = |input: &mut Input<'_>| {
        let (target, value) = target_then(input, |rest, _| {
            skip("'s").parse_next(rest)?;
            let property = property_name(rest)?;
            changed(verb, raised, property, rest)
        })?;
        assign(target, value)
    };
    let whose = |input: &mut Input<'_>| {
        exactly("its | their").parse_next(input)?;
        let property = property_name(input)?;
        let value = changed(verb, raised, property, input)?;
        assign(focus(), value)
    };
    alt((of, whose, after)).parse_next(input)
}

fn changed(verb: Verb, raised: bool, property: Property, input: &mut Input<'_>) -> Outcome<Value> {
    match property {
        Property::Color => return Err(EmptyError),
        Property::Saturation => return tone_changed(verb, raised, Term::Saturation, input),
        Property::Brightness => return tone_changed(verb, raised, Term::Brightness, input),
        Property::Temperature => return tone_changed(verb, raised, Term::Temperature, input),
        Property::Opacity | Property::Transparency => {}
    }
    let opaque = property == Property::Opacity;
    let to = opt((one_of("to | up to | down to"), amount)).parse_next(input)?;
    if let Some((_, value)) = to {
        let found = if opaque { absolute(value)? } else { transparency(value)? };
        end(input)?;
        return Ok(found);
    }
    // Opacity may exceed 1, so a transparency cannot be scaled.
    let by = if opaque { opt(|i: &mut Input<'_>| factor_by(raised, i)).parse_next(input)? } else { None };
    let degree = degree(input)?;
    end(input)?;
    let more = raised == opaque;
    let usual = match verb.phrase {
        "double" | "triple" | "halve" if !opaque => return Err(EmptyError),
        "double" => 2.0,
        "triple" => 3.0,
        "halve" => 0.5,
        _ if more => degree.pick(4.0 / 3.0, 2.0, 4.0),
        _ => degree.pick(0.75, 0.5, 0.25),
    };
    Ok(Value::Opacity { factor: by.unwrap_or(usual), relative: true })
}

fn tone_changed(verb: Verb, raised: bool, term: Term, input: &mut Input<'_>) -> Outcome<Value> {
    let to = opt((one_of("to | up to | down to"), amount)).parse_next(input)?;
    if let Some((_, value)) = to {
        end(input)?;
        return Ok(Value::Tone(term.set(value, false)));
    }
    let by = if term == Term::Temperature {
        None
    } else {
        opt(|i: &mut Input<'_>| factor_by(raised, i)).parse_next(input)?
    };
    let degree = degree(input)?;
    end(input)?;
    let usual = match (verb.phrase, term) {
        ("double" | "triple" | "halve", Term::Temperature) => return Err(EmptyError),
        ("double", _) => 2.0,
        ("triple", _) => 3.0,
        ("halve", _) => 0.5,
        _ => term.step(raised, degree),
    };
    Ok(Value::Tone(term.set(by.unwrap_or(usual), true)))
}

fn resolve(clause: &Clause, context: &Context<'_>) -> Result<Step, Refusal> {
    let target = target_of(clause, context.state)?;
    let units = target.units.clone();
    let factor = number(clause, "opacity")? as f32;
    let set = SetOpacity { target: Some(target), factor, relative: clause.relative };
    Ok(Step::Change { action: Action::SetOpacity(set), units })
}
