//! Deletion of Gaussians, their return, and the removal of names.

use sg_proto::language::{Act, Clause, Reference};
use sg_proto::scene::command::Action;
use sg_proto::scene::{DeleteGaussians, DeleteUnit, RestoreGaussians};
use winnow::Parser;
use winnow::combinator::opt;
use winnow::error::EmptyError;

use super::command::{Command, Construct, Context, Effect, Ellipsis, Field, complete};
use crate::resolution::{Refusal, Step, editable_unit, target_of};
use crate::syntax::phrase::{Input, Outcome, UNIT_NOUN, article, end, exactly, one_of, skip};
use crate::syntax::reading::{Reading, Verb, clause};
use crate::syntax::target::{Target, target_alone, target_then};

/// The command "delete".
pub(super) const DELETE_GAUSSIANS: Command = Command {
    act: Act::DeleteGaussians,
    title: "delete",
    constructs: &[
        Construct::with_ellipsis("delete | erase | discard | throw away | cut away | cut out", Ellipsis::Verb, delete),
        Construct::new("crop", crop),
    ],
    examples: &["delete the selection", "delete the {unit}", "crop to the selection"],
    fields: &[Field::required("target")],
    effect: Effect::Possible,
    resolve: resolve_delete,
};

/// The command "restore".
pub(super) const RESTORE_GAUSSIANS: Command = Command {
    act: Act::RestoreGaussians,
    title: "restore",
    constructs: &[Construct::new(
        "restore all deleted | restore everything deleted | restore everything that was deleted | \
             restore what was deleted | restore what i deleted | restore the deleted | restore deleted | \
             restore all that was deleted | restore all deleted gaussians | restore the deleted gaussians | \
             restore deleted gaussians | restore all deleted splats | restore the deleted splats | \
             restore deleted splats | undelete | undelete all | undelete everything | \
             bring back everything deleted | bring back everything that was deleted | \
             bring back what was deleted | bring back what i deleted | bring back all deleted | \
             bring back the deleted gaussians | bring back the deleted splats",
        complete,
    )],
    examples: &["restore everything deleted", "undelete everything"],
    fields: &[],
    effect: Effect::Possible,
    resolve: resolve_restore,
};

/// The command "remove the name".
pub(super) const REMOVE_NAME: Command = Command {
    act: Act::Delete,
    title: "remove a name",
    constructs: &[Construct::with_ellipsis(
        "forget | remove | drop | get rid of | unname | delete | erase | discard",
        Ellipsis::Verb,
        remove_name,
    )],
    examples: &["remove the name {unit}", "forget the {unit}"],
    fields: &[Field::required("target")],
    effect: Effect::None,
    resolve: resolve_name,
};

/// "my files" is not a unit.
fn is_owned(input: &Input<'_>) -> bool {
    let owned: Outcome<_> = exactly("my | our | your | his | her | their").parse_next(&mut input.clone());
    owned.is_ok()
}

/// Parses "the sac", "everything but the selection", "the selected splats".
fn delete(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    if is_owned(input) || names_a_name(input).is_some() {
        return Err(EmptyError);
    }
    let (target, ()) = target_then(input, |rest, _| {
        skip("from the scene | from the model | for good | completely | entirely").parse_next(rest)?;
        end(rest)
    })?;
    Ok(Reading::of(Act::DeleteGaussians, target))
}

/// Parses "", "to the sac", "to the selection", "the scene to the selection".
fn crop(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    skip("the scene | the model | the picture | everything | it").parse_next(input)?;
    let to = opt(exactly("to | around")).parse_next(input)?;
    let kept = if to.is_some() {
        target_alone(input)?
    } else {
        end(input)?;
        Target { reference: Reference { selection: true, ..Reference::default() }, unknown: 0 }
    };
    if kept.reference.complement || kept.reference.everything {
        return Err(EmptyError);
    }
    let reference = Reference { complement: true, ..kept.reference };
    Ok(Reading::of(Act::DeleteGaussians, Target { reference, unknown: kept.unknown }))
}

/// The rest after "the name", "the unit", "the label of": words for a name, not for Gaussians.
fn names_a_name<'t>(input: &Input<'t>) -> Option<Input<'t>> {
    let mut at = *input;
    let named = (|| {
        article(&mut at)?;
        exactly("name | label").parse_next(&mut at)?;
        opt(one_of("of")).parse_next(&mut at)
    })();
    named.ok().map(|_| at)
}

/// Parses "the name sac", "the name of the sac", after "forget" "the sac" too. "remove the sac" hides it.
fn remove_name(verb: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    if is_owned(input) {
        return Err(EmptyError);
    }
    let mut explicit = names_a_name(input);
    if explicit.is_none() && matches!(verb.phrase, "remove" | "drop" | "get rid of") {
        let mut at = *input;
        article(&mut at)?;
        let noun: Outcome<_> = exactly(UNIT_NOUN).parse_next(&mut at);
        explicit = noun.is_ok().then_some(*input);
    }
    match explicit {
        Some(rest) => *input = rest,
        None if matches!(verb.phrase, "forget" | "unname") => {}
        None => return Err(EmptyError),
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

fn resolve_delete(clause: &Clause, context: &Context<'_>) -> Result<Step, Refusal> {
    let target = target_of(clause, context.state)?;
    let units = target.units.clone();
    Ok(Step::Change { action: Action::DeleteGaussians(DeleteGaussians { target: Some(target) }), units })
}

fn resolve_restore(_: &Clause, context: &Context<'_>) -> Result<Step, Refusal> {
    if context.state.base_units.iter().all(|base| base.deleted == 0) {
        return Ok(Step::Answer { text: "Nothing is deleted.".to_owned(), units: Vec::new() });
    }
    Ok(Step::scene_wide(Action::RestoreGaussians(RestoreGaussians {})))
}

fn resolve_name(clause: &Clause, context: &Context<'_>) -> Result<Step, Refusal> {
    let name = editable_unit(clause, context.state, "unname")?;
    Ok(Step::Change { action: Action::DeleteUnit(DeleteUnit { name: name.clone() }), units: vec![name] })
}
