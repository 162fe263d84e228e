//! History: undo, redo, reset.

use sg_proto::language::{Act, Clause};
use sg_proto::scene::command::Action;
use sg_proto::scene::{Redo, Reset, Undo};
use winnow::Parser;
use winnow::combinator::opt;
use winnow::error::EmptyError;

use super::command::{Command, Construct, Context, Effect, Field, complete};
use crate::resolution::{Refusal, Step, step_count};
use crate::syntax::number::plain_number;
use crate::syntax::phrase::{Input, Outcome, end, exactly, one_of, skip};
use crate::syntax::reading::{Reading, Verb};

/// The command "undo".
pub(super) const UNDO: Command = Command {
    act: Act::Undo,
    title: "undo",
    constructs: &[Construct::new(
        "undo | take back | take that back | take it back | go back | revert | roll back | \
             rollback",
        steps,
    )],
    examples: &["undo", "undo twice", "take back the last 3 changes"],
    fields: &[Field::optional_count("amount")],
    effect: Effect::Possible,
    resolve: resolve_undo,
};

/// The command "redo".
pub(super) const REDO: Command = Command {
    act: Act::Redo,
    title: "redo",
    constructs: &[Construct::new("redo | do again | bring back | reapply", steps)],
    examples: &["redo", "redo twice"],
    fields: &[Field::optional_count("amount")],
    effect: Effect::Possible,
    resolve: resolve_redo,
};

/// The command "reset the appearance".
pub(super) const RESET: Command = Command {
    act: Act::Reset,
    title: "reset the appearance",
    constructs: &[Construct::new(
        "reset | reset everything | reset all | reset it all | reset the scene | \
             reset the look | reset the appearance | reset the looks | reset all changes | \
             start over | start again | start from scratch | back to the start | \
             back to the beginning | go back to the start | go back to the beginning | \
             back to square one | restore everything | restore the original look | \
             restore the scene | restore the original | original look | back to the original | \
             back to the original look | go back to the original look | make everything as it was",
        complete,
    )],
    examples: &["reset", "start over"],
    fields: &[],
    effect: Effect::Possible,
    resolve: resolve_reset,
};

/// Parses "twice", "the last 3 changes", "that", "two steps".
fn steps(verb: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    skip("that | it | this | what i did | what you did | what we did").parse_next(input)?;
    skip("by | of").parse_next(input)?;
    skip(
        "the last | my last | the previous | my previous | the latest | last | the | the past | \
     the most recent | the next | next",
    )
    .parse_next(input)?;
    let adverb = opt(one_of("once | twice | thrice")).parse_next(input)?.map(|place| (place + 1) as f64);
    let count = match adverb {
        Some(count) => Some(count),
        None => opt(plain_number).parse_next(input)?,
    };
    let noun = opt(exactly(
        "change | changes | step | steps | action | actions | command | commands | edit | edits | \
     operation | operations | move | moves | time | times | thing | things | one | ones",
    ))
    .parse_next(input)?;
    skip("back | again").parse_next(input)?;
    end(input)?;
    if matches!(verb.phrase, "bring back" | "do again") && noun.is_none() && count.is_none() {
        return Err(EmptyError);
    }
    let count = count.unwrap_or(1.0);
    if !(1.0..=1000.0).contains(&count) || count.fract() != 0.0 {
        return Err(EmptyError);
    }
    Ok(Reading::plain(verb.act).map(|c| c.amount = Some(count)))
}

fn resolve_undo(clause: &Clause, context: &Context<'_>) -> Result<Step, Refusal> {
    if context.state.undo.is_empty() {
        return Err(Refusal::precondition("There is nothing to undo."));
    }
    Ok(Step::scene_wide(Action::Undo(Undo { steps: step_count(clause)? })))
}

fn resolve_redo(clause: &Clause, context: &Context<'_>) -> Result<Step, Refusal> {
    if context.state.redo.is_empty() {
        return Err(Refusal::precondition("There is nothing to redo."));
    }
    Ok(Step::scene_wide(Action::Redo(Redo { steps: step_count(clause)? })))
}

fn resolve_reset(_: &Clause, _: &Context<'_>) -> Result<Step, Refusal> {
    Ok(Step::scene_wide(Action::Reset(Reset {})))
}
