//! Light: strength, parts, direction.

use sg_proto::bus::Code;
use sg_proto::language::{Act, Clause};
use sg_proto::scene::command::Action;
use sg_proto::scene::{LightMode, SetLight, Vector};
use winnow::Parser;
use winnow::combinator::{alt, opt, peek};
use winnow::error::EmptyError;

use super::command::{Command, Construct, Context, Effect, Ellipsis, Field};
use super::verbs::MAKE;
use crate::property::assignment::becoming;
use crate::property::light::{Part, headlight, part, quality};
use crate::resolution::{Refusal, Step, missing};
use crate::syntax::modifier::{connector, degree, factor_by};
use crate::syntax::number::quantity;
use crate::syntax::phrase::{Input, Outcome, article, end, exactly, one_of, skip};
use crate::syntax::reading::{Reading, Verb};
use crate::syntax::target::target_then;
use crate::syntax::viewer_axes::{light_preset, light_source};

/// The command "light".
pub(super) const SET_LIGHT: Command = Command {
    act: Act::SetLight,
    title: "light",
    constructs: &[
        Construct::with_ellipsis("(none) | make | with | use | i want | give me | add", Ellipsis::Verb, words),
        Construct::with_ellipsis("set | change | make | put | turn | adjust | (none)", Ellipsis::Verb, light_property),
        Construct::with_ellipsis(MAKE, Ellipsis::VerbTargetOrValue, becoming),
        Construct::new(
            "light | illuminate | put the light | move the light | place the light | \
                 set the light | shine the light | shine light | shine | turn the light | \
                 point the light | the light comes | bring the light",
            direction,
        ),
        Construct::new(
            "turn up | increase | raise | boost | brighten | brighten up | double | triple | \
                 strengthen",
            |verb, input| strength(verb, true, input),
        ),
        Construct::new(
            "turn down | decrease | reduce | lower | dim | darken | halve | weaken | turn off | \
                 switch off | remove",
            |verb, input| strength(verb, false, input),
        ),
        Construct::with_ellipsis(
            "turn on | switch on | switch to | turn to | go to | go back to",
            Ellipsis::Verb,
            words,
        ),
        Construct::new("reset | restore", original),
    ],
    examples: &[
        "brighter",
        "use a headlight",
        "studio lighting",
        "switch to a rim light",
        "light from the left",
        "light it from above",
        "more specular",
        "less ambient",
        "make it shinier",
        "turn down the light",
        "set the ambient light to 50 %",
        "reset the light",
    ],
    fields: &[Field::required("light")],
    effect: Effect::Visible,
    resolve,
};

fn light(change: SetLight) -> Reading {
    Reading::plain(Act::SetLight).map(|c| c.light = Some(change))
}

/// Parses "brighter", "more light", "less specular", "no ambient", "a headlight", "studio lighting".
fn words(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let amount = |input: &mut Input<'_>| {
        let degree = degree(input)?;
        let more = exactly("more | less | no").parse_next(input)?.text.clone();
        let part = part(input)?;
        if more == "no" {
            // A scene without light is black, so "no light" is not understood.
            return if part == Part::Brightness { Err(EmptyError) } else { Ok(part.set(0.0, false)) };
        }
        let grows = more == "more";
        let by = opt(|i: &mut Input<'_>| factor_by(grows, i)).parse_next(input)?;
        Ok(part.scaled(grows, by, degree))
    };
    let change = alt((amount, headlight, light_preset, quality)).parse_next(input)?;
    skip("on | mode").parse_next(input)?;
    end(input)?;
    Ok(light(change))
}

/// Parses "the light": that of a scene which nobody changed.
fn original(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    article(input)?;
    exactly("light | lights | lighting | illumination").parse_next(input)?;
    end(input)?;
    let one = Some(1.0);
    Ok(light(SetLight {
        mode: LightMode::Headlight.into(),
        ambient: one,
        diffuse: one,
        specular: one,
        shininess: one,
        ..SetLight::default()
    }))
}

/// Parses "the ambient light to 50 %", "the light brighter", "the lights up a bit", "specular off".
fn light_property(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    article(input)?;
    let part = part(input)?;
    let change = alt((
        |i: &mut Input<'_>| {
            connector(i)?;
            skip("come | shine | coming").parse_next(i)?;
            exactly("from").parse_next(i)?;
            if part == Part::Brightness { light_source(i) } else { Err(EmptyError) }
        },
        |i: &mut Input<'_>| {
            let grows = alt((
                exactly("up | higher | stronger | more").map(|_| true),
                exactly("down | lower | weaker | less").map(|_| false),
            ))
            .parse_next(i)?;
            let by = opt(|i: &mut Input<'_>| factor_by(grows, i)).parse_next(i)?;
            let degree = degree(i)?;
            Ok(part.scaled(grows, by, degree))
        },
        |i: &mut Input<'_>| {
            exactly("off").parse_next(i)?;
            if part == Part::Brightness { Err(EmptyError) } else { Ok(part.set(0.0, false)) }
        },
        |i: &mut Input<'_>| {
            connector(i)?;
            let degree = degree(i)?;
            let grows = alt((exactly("stronger | higher").map(|_| true), exactly("weaker | lower").map(|_| false)))
                .parse_next(i)?;
            Ok(part.scaled(grows, None, degree))
        },
        |i: &mut Input<'_>| {
            connector(i)?;
            let found = alt((quality, headlight)).parse_next(i)?;
            if part == Part::Brightness { Ok(found) } else { Err(EmptyError) }
        },
        |i: &mut Input<'_>| {
            connector(i)?;
            let value = quantity(i)?;
            let value = if part == Part::Shininess { value.value } else { value.as_opacity() };
            if (0.0..=1000.0).contains(&value) { Ok(part.set(value, false)) } else { Err(EmptyError) }
        },
    ))
    .parse_next(input)?;
    end(input)?;
    Ok(light(change))
}

/// Parses "from the left", "it from above", "comes from behind", "on the left".
fn direction(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let place = |input: &mut Input<'_>| {
        skip("come | comes | coming | shine | is | so that it comes").parse_next(input)?;
        let placed = opt(one_of("from | to come from | on | at | to | towards")).parse_next(input)?;
        let over = exactly("above | below | behind | overhead | over | under | underneath | beneath");
        if placed.is_none() {
            peek(over).parse_next(input)?;
        }
        let change = light_source(input)?;
        end(input)?;
        Ok(change)
    };
    let about = |input: &mut Input<'_>| {
        let (target, change) = target_then(input, |rest, _| place(rest))?;
        if target.unknown > 0 { Err(EmptyError) } else { Ok(change) }
    };
    let change = alt((place, about)).parse_next(input)?;
    Ok(light(change))
}

/// Parses the object of "turn up" or "turn down": "the light by 20 %", "the specular highlights".
fn strength(verb: Verb, up: bool, input: &mut Input<'_>) -> Outcome<Reading> {
    let named = |input: &mut Input<'_>| {
        article(input)?;
        part(input)
    };
    let bare = matches!(verb.phrase, "brighten" | "brighten up" | "darken");
    let part = if bare {
        let object = opt(alt((
            named,
            one_of(
                "it | the scene | the picture | the image | everything | things | it all | the view | \
             the whole scene",
            )
            .map(|_| Part::Brightness),
        )))
        .parse_next(input)?;
        object.unwrap_or(Part::Brightness)
    } else {
        named(input)?
    };
    if matches!(verb.phrase, "turn off" | "switch off" | "remove") {
        end(input)?;
        return if part == Part::Brightness { Err(EmptyError) } else { Ok(light(part.set(0.0, false))) };
    }
    let to = opt((one_of("to | up to | down to"), quantity)).parse_next(input)?;
    if let Some((_, value)) = to {
        end(input)?;
        return Ok(light(part.set(value.as_opacity(), false)));
    }
    let by = opt(|i: &mut Input<'_>| factor_by(up, i)).parse_next(input)?;
    let degree = degree(input)?;
    end(input)?;
    let factor = match verb.phrase {
        "double" => Some(2.0),
        "triple" => Some(3.0),
        "halve" => Some(0.5),
        _ => by,
    };
    Ok(light(part.scaled(up, factor, degree)))
}

fn resolve(clause: &Clause, _: &Context<'_>) -> Result<Step, Refusal> {
    let light = clause.light.ok_or_else(|| missing("light"))?;
    Ok(Step::scene_wide(Action::SetLight(checked_light(light)?)))
}

fn checked_light(light: SetLight) -> Result<SetLight, Refusal> {
    let numbers = [light.ambient, light.diffuse, light.specular, light.shininess];
    let direction = light.direction.is_none_or(|Vector { x, y, z }| {
        let length = x * x + y * y + z * z;
        length.is_finite() && length > 0.0
    });
    if numbers.iter().flatten().all(|v| v.is_finite() && *v >= 0.0) && direction {
        Ok(light)
    } else {
        Err(Refusal::new(Code::OutOfRange, "The light needs numbers of 0 or more and a direction that is not zero."))
    }
}
