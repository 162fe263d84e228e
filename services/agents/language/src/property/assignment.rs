//! Clauses that assign a value to a target: "make the sac red", "set the opacity of the sac to 0.3".

use sg_proto::language::Reference;
use winnow::Parser;
use winnow::combinator::{alt, opt};

use super::light;
use super::opacity::{absolute, amount, opacity, transparency};
use super::size::multiple;
use super::tone::{Term, tone};
use super::value::{COLOR, Value, assign, property_name};
use crate::syntax::modifier::{connector, degree};
use crate::syntax::phrase::{Input, Outcome, article, color, end, exactly, one_of, skip};
use crate::syntax::reading::{Property, Reading, Verb};
use crate::syntax::target::{Target, focus, target_alone, target_then};

/// Parses "the sac red", "it 50 % transparent", "everything visible".
pub(crate) fn becoming(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    skip("me | us").parse_next(input)?;
    let (target, value) = target_then(input, |rest, _| any_value(rest))?;
    assign(target, value)
}

/// Parses a value for the target of the previous clause: "and transparent" after "make the sac red".
pub(crate) fn continued(before: &Reference, input: &mut Input<'_>) -> Outcome<Reading> {
    let value = any_value(input)?;
    assign(Target { reference: before.clone(), unknown: 0 }, value)
}

fn any_value(input: &mut Input<'_>) -> Outcome<Value> {
    skip(
        "be | to be | should be | should become | must be | needs to be | ought to be | become | look | \
     appear | all",
    )
    .parse_next(input)?;
    let ended = |parser: fn(&mut Input<'_>) -> Outcome<Value>| {
        move |input: &mut Input<'_>| {
            let found = parser(input)?;
            end(input)?;
            Ok(found)
        }
    };
    alt((
        ended(opacity),
        ended(visibility),
        ended(original_color),
        ended(a_color),
        ended(|i| tone(i).map(Value::Tone)),
        ended(|i| light::quality(i).map(Value::Light)),
        ended(|i| multiple(i).map(|factor| Value::Scale(Some(factor)))),
        ended(size),
    ))
    .parse_next(input)
}

fn a_color(input: &mut Input<'_>) -> Outcome<Value> {
    skip("in | to | into | as | with | of | using").parse_next(input)?;
    article(input)?;
    opt((exactly(COLOR), opt(exactly("to | of | be")))).parse_next(input)?;
    let (color, name) = color(input)?;
    opt(alt((exactly(COLOR), exactly("tone | shade | one")))).parse_next(input)?;
    Ok(Value::Color(color, name))
}

fn original_color(input: &mut Input<'_>) -> Outcome<Value> {
    skip("in | to | back to | with | back").parse_next(input)?;
    exactly("its | their | the").parse_next(input)?;
    exactly("own | original | old | natural | real | former | first | initial | true | default").parse_next(input)?;
    exactly(COLOR).parse_next(input)?;
    skip("back").parse_next(input)?;
    Ok(Value::OriginalColor)
}

fn visibility(input: &mut Input<'_>) -> Outcome<Value> {
    skip("fully | completely | totally").parse_next(input)?;
    alt((
        exactly("visible | shown | appear | reappear").map(|_| Value::Visible(true)),
        exactly("invisible | hidden | disappear | vanish | gone").map(|_| Value::Visible(false)),
    ))
    .parse_next(input)
}

fn size(input: &mut Input<'_>) -> Outcome<Value> {
    let degree = degree(input)?;
    let factor = degree.pick(1.2, 1.5, 2.5);
    let bigger = alt((exactly("bigger | larger | closer").map(|_| true), exactly("smaller").map(|_| false)))
        .parse_next(input)?;
    Ok(Value::Zoom(if bigger { factor } else { 1.0 / factor }))
}

fn property_value(property: Property, input: &mut Input<'_>) -> Outcome<Value> {
    connector(input)?;
    let found = match property {
        Property::Color => {
            article(input)?;
            let (color, name) = color(input)?;
            Value::Color(color, name)
        }
        Property::Opacity => absolute(amount(input)?)?,
        Property::Transparency => transparency(amount(input)?)?,
        Property::Saturation => Value::Tone(Term::Saturation.set(amount(input)?, false)),
        Property::Brightness => Value::Tone(Term::Brightness.set(amount(input)?, false)),
        Property::Temperature => Value::Tone(Term::Temperature.set(amount(input)?, false)),
    };
    end(input)?;
    Ok(found)
}

/// Parses "the colour of the sac to red", "the sac's opacity to 0.3", "the opacity to 30 %".
pub(crate) fn property(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    alt((property_of, property_after, property_of_focus)).parse_next(input)
}

fn property_of(input: &mut Input<'_>) -> Outcome<Reading> {
    article(input)?;
    let property = property_name(input)?;
    exactly("of | for | on").parse_next(input)?;
    let (target, value) = target_then(input, |rest, _| property_value(property, rest))?;
    Ok(Reading { property: Some(property), ..assign(target, value)? })
}

fn property_after(input: &mut Input<'_>) -> Outcome<Reading> {
    // "its" is the target.
    let of_it = opt(exactly("its | their")).parse_next(input)?;
    if of_it.is_some() {
        let property = property_name(input)?;
        let value = property_value(property, input)?;
        return Ok(Reading { property: Some(property), ..assign(focus(), value)? });
    }
    let (target, (property, value)) = target_then(input, |rest, _| {
        skip("'s").parse_next(rest)?;
        let property = property_name(rest)?;
        Ok((property, property_value(property, rest)?))
    })?;
    Ok(Reading { property: Some(property), ..assign(target, value)? })
}

fn property_of_focus(input: &mut Input<'_>) -> Outcome<Reading> {
    article(input)?;
    let property = property_name(input)?;
    let value = property_value(property, input)?;
    Ok(Reading { property: Some(property), ..assign(focus(), value)? })
}

/// Parses "the colour of the sac", "the sac's opacity": reset to the original value.
pub(crate) fn restoring(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    const ORIGINAL: &str = "own | original | old | natural | real | former | first | initial | true | default | full";
    fn original(property: Property) -> Value {
        match property {
            Property::Color => Value::OriginalColor,
            Property::Opacity | Property::Transparency => Value::Opacity { factor: 1.0, relative: false },
            Property::Saturation => Value::Tone(Term::Saturation.original()),
            Property::Brightness => Value::Tone(Term::Brightness.original()),
            Property::Temperature => Value::Tone(Term::Temperature.original()),
        }
    }
    let of = |input: &mut Input<'_>| {
        article(input)?;
        opt(exactly(ORIGINAL)).parse_next(input)?;
        let property = property_name(input)?;
        let target = match opt(exactly("of | to | for")).parse_next(input)? {
            Some(_) => target_alone(input)?,
            None => {
                end(input)?;
                focus()
            }
        };
        assign(target, original(property))
    };
    let after = |input: &mut Input<'_>| {
        let (target, property) = target_then(input, |rest, _| {
            opt(exactly("'s | its | their")).parse_next(rest)?;
            opt(exactly(ORIGINAL)).parse_next(rest)?;
            let property = property_name(rest)?;
            skip("back").parse_next(rest)?;
            end(rest)?;
            Ok(property)
        })?;
        assign(target, original(property))
    };
    let whose = |input: &mut Input<'_>| {
        exactly("its | their").parse_next(input)?;
        opt(exactly(ORIGINAL)).parse_next(input)?;
        let property = property_name(input)?;
        end(input)?;
        assign(focus(), original(property))
    };
    alt((of, whose, after)).parse_next(input)
}

/// Parses "the vessel to 0.5" after a clause with the same property.
pub(crate) fn same_property(property: Property, input: &mut Input<'_>) -> Outcome<Reading> {
    opt((exactly("that | those"), exactly("of"))).parse_next(input)?;
    let (target, value) = target_then(input, |rest, _| {
        one_of("to | at | is").parse_next(rest)?;
        property_value(property, rest)
    })?;
    Ok(Reading { property: Some(property), ..assign(target, value)? })
}
