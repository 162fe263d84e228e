//! Merged units: "merge the sac and the vessel", "merge the sac and the neck as aneurysm".

use sg_proto::language::{Act, Clause};
use sg_proto::scene::MergeUnits;
use sg_proto::scene::command::Action;
use winnow::Parser;
use winnow::combinator::opt;
use winnow::error::EmptyError;

use super::command::{Command, Construct, Context, Effect, Field};
use super::naming::{name, named};
use crate::resolution::{Refusal, Step, checked_name, is_base_unit, name_taken, target_of};
use crate::syntax::phrase::{Input, Outcome, exactly, skip};
use crate::syntax::reading::{Reading, Verb};
use crate::syntax::target::{Target, target_then};
use crate::unit_names::{self, Lookup};

/// The command "merge".
pub(super) const MERGE: Command = Command {
    act: Act::Merge,
    title: "merge",
    constructs: &[Construct::new("merge | combine | join | unite | fuse", merge)],
    examples: &["merge the {unit} and the {other} as 'both'", "merge the {unit} with the {other}"],
    fields: &[Field::required("target"), Field::optional("name")],
    effect: Effect::Possible,
    resolve,
};

/// Parses "the sac and the neck", "the neck into the sac", "the sac with the neck as aneurysm".
fn merge(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let (target, (others, goes_first, new)) = target_then(input, |rest, _| {
        let mut others = Target::default();
        let mut goes_first = false;
        let joined = opt(exactly("with | into | to")).parse_next(rest)?;
        if let Some(word) = joined {
            let known = |input: &mut Input<'_>| {
                let (target, new) = target_then(input, |rest, _| named(rest))?;
                if target.unknown > 0 && word.text != "with" { Err(EmptyError) } else { Ok((target, new)) }
            };
            if let Some((target, new)) = opt(known).parse_next(rest)? {
                goes_first = word.text != "with";
                others = target;
                return Ok((others, goes_first, new));
            }
            if word.text == "with" {
                return Err(EmptyError);
            }
            // "into aneurysm" is a new name, and so is "into one unit called aneurysm".
            skip(
                "one unit called | one unit named | a unit called | a unit named | one called | a single unit called | \
                 a new unit called",
            )
            .parse_next(rest)?;
            return Ok((others, goes_first, Some(name(rest)?)));
        }
        Ok((others, goes_first, named(rest)?))
    })?;
    let (mut reference, unknown) = (target.reference, target.unknown + others.unknown);
    let more = others.reference;
    if goes_first {
        reference.names.splice(0..0, more.names);
    } else {
        reference.names.extend(more.names);
    }
    reference.selection |= more.selection;
    reference.focus |= more.focus;
    reference.everything |= more.everything;
    reference.complement |= more.complement;
    let reading = Reading::of(Act::Merge, Target { reference, unknown });
    Ok(reading.map(|c| c.name = new.clone().unwrap_or_default()))
}

fn resolve(clause: &Clause, context: &Context<'_>) -> Result<Step, Refusal> {
    let state = context.state;
    let target = target_of(clause, state)?;
    if target.selection || target.everything || target.complement {
        return Err(Refusal::precondition(
            "Only units can be merged. Say their names: “merge the sac and the neck”. Save the selection under a name first.",
        ));
    }
    let units = target.units;
    let Some(first) = units.first().filter(|_| units.len() > 1) else {
        return Err(Refusal::invalid("Merge what with what? Say two names: “merge the sac and the neck”."));
    };
    let name = if clause.name.trim().is_empty() { String::new() } else { checked_name(clause)? };
    if name.is_empty() && is_base_unit(first, state) {
        return Err(Refusal::precondition(format!(
            "“{first}” is part of the scene file and keeps its Gaussians. Give the merged unit a name: “merge the {} as 'both'”.",
            units.join(" and the ")
        )));
    }
    if let Lookup::Unique(other) = unit_names::lookup(&name, &unit_names::addressable(state))
        && !name.is_empty()
        && (!units.iter().any(|u| u == other) || is_base_unit(other, state))
    {
        return Err(name_taken(other));
    }
    let made = if name.is_empty() { first.clone() } else { name.clone() };
    Ok(Step::Change { action: Action::MergeUnits(MergeUnits { units, name }), units: vec![made] })
}
