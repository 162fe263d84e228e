//! Background colour.

use sg_proto::language::{Act, Clause};
use sg_proto::scene::command::Action;
use sg_proto::scene::{Color, SetBackground};
use winnow::Parser;
use winnow::combinator::{alt, opt};

use super::command::{Command, Construct, Context, Effect, Field};
use crate::color;
use crate::property::value::COLOR;
use crate::resolution::{Refusal, Step, color_of, missing};
use crate::syntax::modifier::connector;
use crate::syntax::phrase::{Input, Outcome, article, color as parse_color, end, exactly, skip};
use crate::syntax::reading::{Reading, Verb};

/// The command "background".
pub(super) const SET_BACKGROUND: Command = Command {
    act: Act::SetBackground,
    title: "background",
    constructs: &[Construct::new(
        "(none) | set | change | make | turn | paint | colour | color | use | switch | switch to | \
             put | give me | i want | on | against | with | fill | put it on | show it on | \
             put it against | have",
        background,
    )],
    examples: &["white background", "set the background to dark grey", "make the background black"],
    fields: &[Field::required("color"), Field::optional("color_name")],
    effect: Effect::Visible,
    resolve,
};

/// Parses a colour, "dark" or "light".
fn shade(input: &mut Input<'_>) -> Outcome<(Color, String)> {
    let grey = |level: f32| color::from_rgb([level; 3]);
    alt((
        parse_color,
        exactly("dark").map(|_| (grey(0.125), "dark grey".to_owned())),
        exactly("light | bright").map(|_| (grey(0.875), "light grey".to_owned())),
    ))
    .parse_next(input)
}

/// Parses "the background to dark grey", "white background", "a black backdrop".
fn background(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
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

fn resolve(clause: &Clause, _: &Context<'_>) -> Result<Step, Refusal> {
    let color = color_of(clause.color.as_ref())?.ok_or_else(|| missing("colour"))?;
    Ok(Step::scene_wide(Action::SetBackground(SetBackground { color: Some(color) })))
}
