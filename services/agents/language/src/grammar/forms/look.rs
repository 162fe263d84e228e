//! Colour, visibility, named properties, background, parts of the shading.

use sg_proto::language::{Act, Reference};
use sg_proto::scene::{Color, ShadingTerm};
use winnow::Parser;
use winnow::combinator::{alt, opt};
use winnow::error::EmptyError;

use super::becomes::{Becomes, COLOR, Property, property_name, reading};
use super::opacity::{absolute, amount, opacity, through};
use super::{Reading, connector, degree, light};
use crate::grammar::phrase::{Input, Outcome, article, color, end, exactly, one_of, skip};
use crate::grammar::target::{Target, focus, target_alone, target_then};

/// "the sac red", "it 50 % transparent", "everything visible".
pub(super) fn becoming(input: &mut Input<'_>) -> Outcome<Reading> {
    skip("me | us").parse_next(input)?;
    let (target, becomes) = target_then(input, |rest, _| becomes(rest))?;
    reading(target, becomes)
}

/// What a carried-over target becomes: "and transparent" after "make the sac red".
pub(in crate::grammar) fn continued(before: &Reference, input: &mut Input<'_>) -> Outcome<Reading> {
    let becomes = becomes(input)?;
    reading(Target { reference: before.clone(), unknown: 0 }, becomes)
}

fn becomes(input: &mut Input<'_>) -> Outcome<Becomes> {
    skip(
        "be | to be | should be | should become | must be | needs to be | ought to be | become | look | \
     appear | all",
    )
    .parse_next(input)?;
    let ended = |parser: fn(&mut Input<'_>) -> Outcome<Becomes>| {
        move |input: &mut Input<'_>| {
            let found = parser(input)?;
            end(input)?;
            Ok(found)
        }
    };
    alt((
        ended(opacity),
        ended(visibility),
        ended(own_color),
        ended(a_color),
        ended(|i| light::quality(i).map(Becomes::Light)),
        ended(size),
    ))
    .parse_next(input)
}

fn a_color(input: &mut Input<'_>) -> Outcome<Becomes> {
    skip("in | to | into | as | with | of | using").parse_next(input)?;
    article(input)?;
    opt((exactly(COLOR), opt(exactly("to | of | be")))).parse_next(input)?;
    let (color, name) = color(input)?;
    opt(alt((exactly(COLOR), exactly("tone | shade | one")))).parse_next(input)?;
    Ok(Becomes::Color(color, name))
}

fn own_color(input: &mut Input<'_>) -> Outcome<Becomes> {
    skip("in | to | back to | with | back").parse_next(input)?;
    exactly("its | their | the").parse_next(input)?;
    exactly("own | original | old | natural | real | former | first | initial | true | default").parse_next(input)?;
    exactly(COLOR).parse_next(input)?;
    skip("back").parse_next(input)?;
    Ok(Becomes::OwnColor)
}

fn visibility(input: &mut Input<'_>) -> Outcome<Becomes> {
    skip("fully | completely | totally").parse_next(input)?;
    alt((
        exactly("visible | shown | appear | reappear").map(|_| Becomes::Visible(true)),
        exactly("invisible | hidden | disappear | vanish | gone").map(|_| Becomes::Visible(false)),
    ))
    .parse_next(input)
}

fn size(input: &mut Input<'_>) -> Outcome<Becomes> {
    let degree = degree(input)?;
    let factor = degree.pick(1.2, 1.5, 2.5);
    let bigger = alt((exactly("bigger | larger | closer").map(|_| true), exactly("smaller").map(|_| false)))
        .parse_next(input)?;
    Ok(Becomes::Zoom(if bigger { factor } else { 1.0 / factor }))
}

fn value(property: Property, input: &mut Input<'_>) -> Outcome<Becomes> {
    connector(input)?;
    let found = match property {
        Property::Color => {
            article(input)?;
            let (color, name) = color(input)?;
            Becomes::Color(color, name)
        }
        Property::Opacity => absolute(amount(input)?)?,
        Property::Transparency => through(amount(input)?)?,
    };
    end(input)?;
    Ok(found)
}

/// "the colour of the sac to red", "the sac's opacity to 0.3", "the opacity to 30 %".
pub(super) fn property(input: &mut Input<'_>) -> Outcome<Reading> {
    alt((property_of, property_after, property_of_focus)).parse_next(input)
}

fn property_of(input: &mut Input<'_>) -> Outcome<Reading> {
    article(input)?;
    let property = property_name(input)?;
    exactly("of | for | on").parse_next(input)?;
    let (target, becomes) = target_then(input, |rest, _| value(property, rest))?;
    Ok(Reading { property: Some(property), ..reading(target, becomes)? })
}

fn property_after(input: &mut Input<'_>) -> Outcome<Reading> {
    // "its colour" says whose it is in one word.
    let of_it = opt(exactly("its | their")).parse_next(input)?;
    if of_it.is_some() {
        let property = property_name(input)?;
        let becomes = value(property, input)?;
        return Ok(Reading { property: Some(property), ..reading(focus(), becomes)? });
    }
    let (target, (property, becomes)) = target_then(input, |rest, _| {
        skip("'s").parse_next(rest)?;
        let property = property_name(rest)?;
        Ok((property, value(property, rest)?))
    })?;
    Ok(Reading { property: Some(property), ..reading(target, becomes)? })
}

fn property_of_focus(input: &mut Input<'_>) -> Outcome<Reading> {
    article(input)?;
    let property = property_name(input)?;
    let becomes = value(property, input)?;
    Ok(Reading { property: Some(property), ..reading(focus(), becomes)? })
}

/// "the colour of the sac", "the sac's opacity": back to how it was.
pub(super) fn restoring(input: &mut Input<'_>) -> Outcome<Reading> {
    const OLD: &str = "own | original | old | natural | real | former | first | initial | true | default | full";
    fn old(property: Property) -> Becomes {
        match property {
            Property::Color => Becomes::OwnColor,
            Property::Opacity | Property::Transparency => Becomes::Opacity { factor: 1.0, relative: false },
        }
    }
    let of = |input: &mut Input<'_>| {
        article(input)?;
        opt(exactly(OLD)).parse_next(input)?;
        let property = property_name(input)?;
        let target = match opt(exactly("of | to | for")).parse_next(input)? {
            Some(_) => target_alone(input)?,
            None => {
                end(input)?;
                focus()
            }
        };
        reading(target, old(property))
    };
    let after = |input: &mut Input<'_>| {
        let (target, property) = target_then(input, |rest, _| {
            opt(exactly("'s | its | their")).parse_next(rest)?;
            opt(exactly(OLD)).parse_next(rest)?;
            let property = property_name(rest)?;
            skip("back").parse_next(rest)?;
            end(rest)?;
            Ok(property)
        })?;
        reading(target, old(property))
    };
    let whose = |input: &mut Input<'_>| {
        exactly("its | their").parse_next(input)?;
        opt(exactly(OLD)).parse_next(input)?;
        let property = property_name(input)?;
        end(input)?;
        reading(focus(), old(property))
    };
    alt((of, whose, after)).parse_next(input)
}

/// A target alone.
pub(super) fn target(opening: &str, act: Act, input: &mut Input<'_>) -> Outcome<Reading> {
    // To remove a thing is to hide it; to remove a label or a unit is to delete it.
    let mut at = *input;
    let unit: Outcome<_> = (article, exactly("unit | label")).parse_next(&mut at);
    if matches!(opening, "remove" | "get rid of") && unit.is_ok() {
        return Err(EmptyError);
    }
    let (target, ()) = target_then(input, |rest, _| {
        if act == Act::Hide {
            skip(
                "from view | from the view | from the picture | from the image | from the scene | \
             from sight | from the screen",
            )
            .parse_next(rest)?;
        }
        end(rest)
    })?;
    Ok(Reading::of(act, target))
}

/// "the sac off", "it back on", "the sac out of the picture".
pub(super) fn switching(opening: &str, input: &mut Input<'_>) -> Outcome<Reading> {
    let (target, visible) = target_then(input, |rest, _| {
        let visible = match opening {
            "take" | "remove" => one_of(
                "off | away | from view | from the view | from the picture | from the image | \
             from the scene | from sight | out of the picture | out of view | out of the way | \
             out of the scene",
            )
            .map(|_| false)
            .parse_next(rest)?,
            "bring" => one_of("back | back on | back in | back into view").map(|_| true).parse_next(rest)?,
            _ => alt((one_of("on | back on").map(|_| true), one_of("off").map(|_| false))).parse_next(rest)?,
        };
        end(rest)?;
        Ok(visible)
    })?;
    reading(target, Becomes::Visible(visible))
}

/// "the sac alone".
pub(super) fn alone(input: &mut Input<'_>) -> Outcome<Reading> {
    let (target, ()) = target_then(input, |rest, _| {
        one_of(
            "only | alone | by itself | by themselves | on its own | on their own | and nothing else | \
         exclusively | in isolation | isolated",
        )
        .parse_next(rest)?;
        end(rest)
    })?;
    Ok(Reading::of(Act::ShowOnly, target))
}

/// A colour, or no more than that it is dark or light.
fn shade(input: &mut Input<'_>) -> Outcome<(Color, String)> {
    let grey = |level: f32| crate::color::from_rgb([level; 3]);
    alt((
        color,
        exactly("dark").map(|_| (grey(0.125), "dark grey".to_owned())),
        exactly("light | bright").map(|_| (grey(0.875), "light grey".to_owned())),
    ))
    .parse_next(input)
}

/// "the background to dark grey", "white background", "a black backdrop".
pub(super) fn background(input: &mut Input<'_>) -> Outcome<Reading> {
    fn place(input: &mut Input<'_>) -> Outcome<()> {
        exactly("background | backdrop | backgrounds").void().parse_next(input)
    }
    let before = |input: &mut Input<'_>| {
        article(input)?;
        place(input)?;
        opt(exactly(COLOR)).parse_next(input)?;
        connector(input)?;
        skip("into | in").parse_next(input)?;
        article(input)?;
        shade(input)
    };
    let after = |input: &mut Input<'_>| {
        article(input)?;
        let found = shade(input)?;
        opt(exactly(COLOR)).parse_next(input)?;
        place(input)?;
        Ok(found)
    };
    let of = |input: &mut Input<'_>| {
        article(input)?;
        exactly(COLOR).parse_next(input)?;
        exactly("of").parse_next(input)?;
        article(input)?;
        place(input)?;
        connector(input)?;
        shade(input)
    };
    let (color, name) = alt((before, after, of)).parse_next(input)?;
    opt(exactly(COLOR)).parse_next(input)?;
    end(input)?;
    Ok(Reading::plain(Act::SetBackground).map(|c| {
        c.color = Some(color);
        c.color_name.clone_from(&name);
    }))
}

/// "the normals", "the diffuse term", "full shading".
pub(super) fn term(opening: &str, input: &mut Input<'_>) -> Outcome<Reading> {
    let only = |input: &mut Input<'_>| {
        let alone = opt(one_of("only | alone | by itself | on its own | just")).parse_next(input)?;
        Ok(alone.is_some())
    };
    skip("only | just | me").parse_next(input)?;
    article(input)?;
    let normals = alt((
        one_of("surface normals | normal vectors | normal map | normal directions | surface orientation").void(),
        exactly("normals").void(),
    ))
    .map(|()| ShadingTerm::Normal);
    let full = one_of(
        "full shading | normal shading | usual shading | complete shading | regular shading | \
     whole shading | ordinary shading | standard shading | all terms | all the terms | full model | \
     full lighting | full light model | whole model | complete model | shaded view | \
     shaded picture | shading",
    )
    .map(|_| ShadingTerm::Full);
    let part = |input: &mut Input<'_>| {
        let term = alt((
            exactly("ambient").map(|_| ShadingTerm::Ambient),
            exactly("diffuse").map(|_| ShadingTerm::Diffuse),
            exactly("specular").map(|_| ShadingTerm::Specular),
        ))
        .parse_next(input)?;
        let noun = opt(one_of(
            "term | part | component | shading | pass | contribution | map | light | lighting | \
         channel | reflection | reflections | highlights | colour | color",
        ))
        .parse_next(input)?;
        // "specular" alone could as well be a wish for more of it.
        if noun.is_none() && opening.is_empty() && !only(input)? { Err(EmptyError) } else { Ok(term) }
    };
    let term = alt((normals, full, part)).parse_next(input)?;
    only(input)?;
    end(input)?;
    if opening == "use" && term != ShadingTerm::Full {
        return Err(EmptyError);
    }
    Ok(Reading::plain(Act::SetTerm).map(|c| c.set_term(term)))
}

/// "the vessel to 0.5" after the opacity of something else was set.
pub(in crate::grammar) fn same_property(property: Property, input: &mut Input<'_>) -> Outcome<Reading> {
    opt((exactly("that | those"), exactly("of"))).parse_next(input)?;
    let (target, becomes) = target_then(input, |rest, _| {
        one_of("to | at | is").parse_next(rest)?;
        value(property, rest)
    })?;
    Ok(Reading { property: Some(property), ..reading(target, becomes)? })
}
