//! Selection by name.

use sg_proto::language::{Act, Clause, Reference};
use sg_proto::scene::command::Action;
use sg_proto::scene::{Select, SetOperation};
use winnow::Parser;
use winnow::combinator::{alt, opt};
use winnow::error::EmptyError;

use super::command::{Command, Construct, Context, Effect, Ellipsis, Field, complete};
use crate::resolution::{Refusal, Step, need_selection, selected_count, target_of};
use crate::syntax::phrase::{Input, Outcome, THE_SELECTION, end, exactly, one_of, skip};
use crate::syntax::reading::{Reading, Verb};
use crate::syntax::target::{Target, target_alone, target_then};

/// The command "select".
pub(super) const SELECT: Command = Command {
    act: Act::Select,
    title: "select",
    constructs: &[
        Construct::with_ellipsis("add | also select | also pick | include", Ellipsis::Verb, select),
        Construct::with_ellipsis(
            "select | pick | choose | highlight | mark | grab | pick out | select only | \
                 select just",
            Ellipsis::Verb,
            select,
        ),
        Construct::new("find | find me | locate | search for | look for", select),
        Construct::with_ellipsis(
            "deselect | unselect | remove | take | subtract | exclude | drop | leave",
            Ellipsis::Verb,
            unselect,
        ),
        Construct::new("intersect | restrict | limit", intersect),
        Construct::new(
            "invert the selection | invert selection | flip the selection | \
                 reverse the selection | invert it",
            invert,
        ),
    ],
    examples: &[
        "select the {unit}",
        "find things like the {unit}",
        "add the {other} to the selection",
        "remove the {other} from the selection",
        "invert the selection",
    ],
    fields: &[Field::required("target"), Field::optional("operation")],
    effect: Effect::None,
    resolve,
};

/// The command "clear the selection".
pub(super) const CLEAR_SELECTION: Command = Command {
    act: Act::ClearSelection,
    title: "clear the selection",
    constructs: &[Construct::new(
        "clear the selection | clear selection | clear my selection | deselect | deselect all | \
             deselect everything | deselect it all | unselect | unselect all | unselect everything | \
             select nothing | select none | drop the selection | cancel the selection | \
             empty the selection | remove the selection | \
             forget the selection | reset the selection | deselect the selection",
        complete,
    )],
    examples: &["clear the selection", "deselect"],
    fields: &[],
    effect: Effect::None,
    resolve: resolve_clear,
};

fn selection(target: Target, operation: SetOperation) -> Reading {
    Reading::of(Act::Select, target).map(|c| c.set_operation(operation))
}

/// Parses "the sac", "the vessel to the selection", "the vessel too".
fn select(verb: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let adds = matches!(verb.phrase, "add" | "also select" | "also pick" | "include");
    skip("only | just").parse_next(input)?;
    let (target, added) = target_then(input, |rest, _| {
        let to = opt((exactly("to | in | into"), one_of(THE_SELECTION))).parse_next(rest)?;
        let too = opt(one_of("too | as well | also | in addition | additionally")).parse_next(rest)?;
        end(rest)?;
        // "add the sac" is ambiguous: it may ask for a new unit.
        if verb.phrase == "add" && to.is_none() { Err(EmptyError) } else { Ok(to.is_some() || too.is_some()) }
    })?;
    Ok(selection(target, if adds || added { SetOperation::Add } else { SetOperation::Replace }))
}

/// Parses "the vessel" after "deselect", "the vessel from the selection" after "remove".
fn unselect(verb: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let plain = matches!(verb.phrase, "deselect" | "unselect");
    let (target, ()) = target_then(input, |rest, target| {
        let from = opt((one_of("from | out of | off"), one_of(THE_SELECTION))).parse_next(rest)?;
        end(rest)?;
        // "deselect everything" clears the selection.
        let all = target.reference.everything && !target.reference.complement;
        if (plain || from.is_some()) && !all { Ok(()) } else { Err(EmptyError) }
    })?;
    Ok(selection(target, SetOperation::Remove))
}

/// Parses "the selection with the vessel", "with the vessel", "the selection to the vessel".
fn intersect(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let before = |input: &mut Input<'_>| {
        opt(one_of(THE_SELECTION)).parse_next(input)?;
        exactly("with | to | and").parse_next(input)?;
        target_alone(input)
    };
    let after = |input: &mut Input<'_>| {
        let (target, ()) = target_then(input, |rest, _| {
            exactly("with | and").parse_next(rest)?;
            one_of(THE_SELECTION).parse_next(rest)?;
            end(rest)
        })?;
        Ok(target)
    };
    let target = alt((before, after)).parse_next(input)?;
    Ok(selection(target, SetOperation::Intersect))
}

/// Parses the end of "invert the selection".
fn invert(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    end(input)?;
    let inverse = Reference { selection: true, complement: true, ..Reference::default() };
    Ok(selection(Target { reference: inverse, unknown: 0 }, SetOperation::Replace))
}

fn resolve(clause: &Clause, context: &Context<'_>) -> Result<Step, Refusal> {
    let target = target_of(clause, context.state)?;
    let operation = clause.operation();
    if matches!(operation, SetOperation::Remove | SetOperation::Intersect) {
        need_selection(context.state)?;
    }
    let units = target.units.clone();
    let select = Select { target: Some(target), operation: operation.into() };
    Ok(Step::Change { action: Action::Select(select), units })
}

fn resolve_clear(_: &Clause, context: &Context<'_>) -> Result<Step, Refusal> {
    if selected_count(context.state) == 0 {
        return Ok(Step::Answer { text: "Nothing is selected.".to_owned(), units: Vec::new() });
    }
    let select = Select { target: None, operation: SetOperation::Replace.into() };
    Ok(Step::scene_wide(Action::Select(select)))
}
