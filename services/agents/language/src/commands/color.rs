//! Colour of a target.

use sg_proto::language::{Act, Clause};
use sg_proto::scene::SetColor;
use sg_proto::scene::command::Action;

use super::command::{Command, Construct, Context, Effect, Ellipsis, Field};
use super::verbs::{MAKE, PAINT, SET};
use crate::property::assignment::{becoming, property, restoring};
use crate::resolution::{Refusal, Step, color_of, target_of};

/// The command "colour".
pub(super) const SET_COLOR: Command = Command {
    act: Act::SetColor,
    title: "colour",
    constructs: &[
        Construct::with_ellipsis(PAINT, Ellipsis::VerbTargetOrValue, becoming),
        Construct::with_ellipsis(MAKE, Ellipsis::VerbTargetOrValue, becoming),
        Construct::with_ellipsis(SET, Ellipsis::PropertyOrValue, property),
        Construct::new(
            "reset | restore | give back | bring back | revert | clear | remove | undo | give | \
                 make",
            restoring,
        ),
    ],
    examples: &[
        "make the {unit} red",
        "colour the {unit} forest green",
        "make the {unit} green and the {other} brown",
        "paint it #ff8800",
        "turn the {unit} blue",
        "set the colour of the {unit} to light blue",
        "give the {unit} a dark red colour",
        "restore the colour of the {unit}",
    ],
    fields: &[Field::required("target"), Field::optional("color"), Field::optional("color_name")],
    effect: Effect::Coverage,
    resolve,
};

fn resolve(clause: &Clause, context: &Context<'_>) -> Result<Step, Refusal> {
    let target = target_of(clause, context.state)?;
    let units = target.units.clone();
    let color = color_of(clause.color.as_ref())?;
    Ok(Step::Change { action: Action::SetColor(SetColor { target: Some(target), color }), units })
}
