//! Deletion of editable units.

use sg_proto::language::{Act, Clause, Reference};
use sg_proto::scene::DeleteUnit;
use sg_proto::scene::command::Action;
use winnow::Parser;
use winnow::error::EmptyError;

use super::command::{Command, Construct, Context, Effect, Ellipsis, Field};
use crate::resolution::{Refusal, Step, editable_unit};
use crate::syntax::phrase::{Input, Outcome, UNIT_NOUN, article, exactly};
use crate::syntax::reading::{Reading, Verb, clause};
use crate::syntax::target::target_alone;

/// The command "delete".
pub(super) const DELETE: Command = Command {
    act: Act::Delete,
    title: "delete",
    constructs: &[Construct::with_ellipsis(
        "delete | erase | discard | forget | remove | drop | throw away | get rid of",
        Ellipsis::Verb,
        delete,
    )],
    examples: &["delete the {unit}", "delete the unit {unit}"],
    fields: &[Field::required("target")],
    effect: Effect::None,
    resolve,
};

/// Parses "the sac", "the unit sac". "my files" is not a unit.
fn delete(verb: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let owned: Outcome<_> = exactly("my | our | your | his | her | their").parse_next(&mut input.clone());
    let mut at = *input;
    article(&mut at)?;
    let explicit = exactly(UNIT_NOUN).parse_next(&mut at).is_ok();
    if owned.is_ok() || (matches!(verb.phrase, "remove" | "drop" | "get rid of") && !explicit) {
        return Err(EmptyError);
    }
    let target = target_alone(input)?;
    let mut references: Vec<Reference> = target
        .reference
        .names
        .iter()
        .map(|name| Reference { names: vec![name.clone()], ..Reference::default() })
        .collect();
    let rest = Reference { names: Vec::new(), ..target.reference.clone() };
    // A complement stays one reference.
    if target.reference.complement {
        references = vec![target.reference.clone()];
    } else if rest != Reference::default() {
        references.push(rest);
    }
    let clauses = references.into_iter().map(|reference| clause(Act::Delete, reference)).collect();
    Ok(Reading { clauses, unknown: target.unknown, property: None })
}

fn resolve(clause: &Clause, context: &Context<'_>) -> Result<Step, Refusal> {
    let name = editable_unit(clause, context.state, "delete")?;
    Ok(Step::Change { action: Action::DeleteUnit(DeleteUnit { name: name.clone() }), units: vec![name] })
}
