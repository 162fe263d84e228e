//! Copied Gaussians: "duplicate the sac", "make a copy of the sac as twin".

use sg_proto::language::{Act, Clause};
use sg_proto::scene::DuplicateGaussians;
use sg_proto::scene::command::Action;
use winnow::Parser;

use super::command::{Command, Construct, Context, Effect, Ellipsis, Field};
use super::naming::named;
use crate::resolution::{Refusal, Step, checked_name, name_taken, target_of};
use crate::syntax::phrase::{Input, Outcome, one_of, skip};
use crate::syntax::reading::{Reading, Verb};
use crate::syntax::target::target_then;
use crate::unit_names::{self, Lookup};

/// The command "duplicate".
pub(super) const DUPLICATE: Command = Command {
    act: Act::Duplicate,
    title: "duplicate",
    constructs: &[
        Construct::with_ellipsis("duplicate | copy | clone | replicate", Ellipsis::Verb, duplicate),
        Construct::new("make | create | add | give me", a_copy),
    ],
    examples: &["duplicate the {unit}", "make a copy of the {unit} as twin"],
    fields: &[Field::required("target"), Field::optional("name")],
    effect: Effect::Possible,
    resolve,
};

/// Parses "the sac", "the selection as twin".
fn duplicate(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let (target, name) = target_then(input, |rest, _| named(rest))?;
    Ok(Reading::of(Act::Duplicate, target).map(|c| c.name = name.clone().unwrap_or_default()))
}

/// Parses "a copy of the sac", "another copy of the selection as twin".
fn a_copy(verb: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    skip("me").parse_next(input)?;
    one_of(
        "a copy of | another copy of | one copy of | one more copy of | a duplicate of | another duplicate of | a clone of | \
         another clone of",
    )
    .parse_next(input)?;
    duplicate(verb, input)
}

fn resolve(clause: &Clause, context: &Context<'_>) -> Result<Step, Refusal> {
    let target = target_of(clause, context.state)?;
    let name = if clause.name.trim().is_empty() { String::new() } else { checked_name(clause)? };
    if let Lookup::Unique(other) = unit_names::lookup(&name, &unit_names::addressable(context.state))
        && !name.is_empty()
    {
        return Err(name_taken(other));
    }
    let units = target.units.clone();
    Ok(Step::Change { action: Action::DuplicateGaussians(DuplicateGaussians { target: Some(target), name }), units })
}
