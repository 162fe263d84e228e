//! Visibility: show, hide, show one target alone.

use sg_proto::language::{Act, Clause};
use sg_proto::scene::command::Action;
use sg_proto::scene::{SetVisibility, ShowOnly};
use winnow::Parser;
use winnow::combinator::alt;
use winnow::error::EmptyError;

use super::command::{Command, Construct, Context, Effect, Ellipsis, Field};
use super::verbs::{self, MAKE};
use crate::property::assignment::becoming;
use crate::property::value::{Value, assign};
use crate::resolution::{Refusal, Step, target_of};
use crate::syntax::phrase::{Input, Outcome, article, end, exactly, one_of, skip};
use crate::syntax::reading::{Reading, Verb};
use crate::syntax::target::target_then;

/// The command "show only".
pub(super) const SHOW_ONLY: Command = Command {
    act: Act::ShowOnly,
    title: "show only",
    constructs: &[
        Construct::with_ellipsis(
            "show only | show just | see only | see just | show me only | show me just | only show | just show | \
                 only show me | just show me | show nothing but | show me nothing but | \
                 display only | only display | display just | isolate | solo | single out | \
                 let me see only | let me see just | keep only | only keep | leave only | only",
            Ellipsis::Verb,
            target,
        ),
        Construct::new(verbs::SHOW, shown_alone),
    ],
    examples: &["show only the {unit}", "isolate the {unit}", "show the {unit} alone"],
    fields: &[Field::required("target")],
    effect: Effect::Coverage,
    resolve: resolve_show_only,
};

/// The command "show".
pub(super) const SHOW: Command = Command {
    act: Act::Show,
    title: "show",
    constructs: &[
        Construct::with_ellipsis(verbs::SHOW, Ellipsis::Verb, target),
        Construct::with_ellipsis("turn | switch | bring", Ellipsis::Verb, switching),
        Construct::with_ellipsis(MAKE, Ellipsis::VerbTargetOrValue, becoming),
    ],
    examples: &["show the {unit}", "show everything", "bring back the {unit}", "make the {unit} visible"],
    fields: &[Field::required("target")],
    effect: Effect::Coverage,
    resolve: |clause, context| resolve_visibility(clause, context, true),
};

/// The command "hide".
pub(super) const HIDE: Command = Command {
    act: Act::Hide,
    title: "hide",
    constructs: &[
        Construct::with_ellipsis(
            "hide | conceal | turn off | switch off | remove | take away | take out | take off | \
                 get rid of | don't show | do not show | suppress",
            Ellipsis::Verb,
            target,
        ),
        Construct::with_ellipsis("turn | switch | take | remove", Ellipsis::Verb, switching),
        Construct::with_ellipsis(MAKE, Ellipsis::VerbTargetOrValue, becoming),
    ],
    examples: &["hide the {unit}", "hide the {unit} and the {other}", "switch off the {unit}", "hide everything else"],
    fields: &[Field::required("target")],
    effect: Effect::Visible,
    resolve: |clause, context| resolve_visibility(clause, context, false),
};

/// Parses a target at the end of the clause.
fn target(verb: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    // "remove the sac" hides it; "remove the unit sac" removes the name.
    let mut at = *input;
    let unit: Outcome<_> = (article, exactly("unit | label | name")).parse_next(&mut at);
    if matches!(verb.phrase, "remove" | "get rid of") && unit.is_ok() {
        return Err(EmptyError);
    }
    let (target, ()) = target_then(input, |rest, _| {
        if verb.act == Act::Hide {
            skip(
                "from view | from the view | from the picture | from the image | from the scene | \
             from sight | from the screen",
            )
            .parse_next(rest)?;
        }
        end(rest)
    })?;
    Ok(Reading::of(verb.act, target))
}

/// Parses "the sac off", "it back on", "the sac out of the picture".
fn switching(verb: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let (target, visible) = target_then(input, |rest, _| {
        let visible = match verb.phrase {
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
    assign(target, Value::Visible(visible))
}

/// Parses "the sac alone".
fn shown_alone(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
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

fn resolve_show_only(clause: &Clause, context: &Context<'_>) -> Result<Step, Refusal> {
    let target = target_of(clause, context.state)?;
    let units = target.units.clone();
    Ok(Step::Change { action: Action::ShowOnly(ShowOnly { target: Some(target) }), units })
}

fn resolve_visibility(clause: &Clause, context: &Context<'_>, visible: bool) -> Result<Step, Refusal> {
    let target = target_of(clause, context.state)?;
    let units = target.units.clone();
    let set = SetVisibility { target: Some(target), visible };
    Ok(Step::Change { action: Action::SetVisibility(set), units })
}
