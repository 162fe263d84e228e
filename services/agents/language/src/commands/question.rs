//! Questions: list, describe, selection.

use sg_proto::language::{Act, Clause, Reference};
use winnow::Parser;
use winnow::combinator::alt;
use winnow::error::EmptyError;

use super::command::{Command, Construct, Context, Effect, Ellipsis, Field, complete};
use crate::query;
use crate::resolution::{Refusal, Step, target};
use crate::syntax::phrase::{Input, Outcome, color, end, exactly, skip};
use crate::syntax::reading::{Reading, Verb};
use crate::syntax::target::{Target, alike_alone, target_then};

/// The command "list".
pub(super) const LIST: Command = Command {
    act: Act::List,
    title: "list",
    constructs: &[Construct::new(
        "list | list them | list all | list everything | list the units | list all units | \
             list units | list all the units | list the structures | list all structures | \
             list the labels | list the parts | list the objects | give me a list | \
             give me a list of the units | give me a list of units | give me a list of all units | \
             show me a list | show a list | show me a list of the units | show the list of units | \
             show me the list of units | guided list of units | list of units | what is there | \
             what's there | what is in there | what is here | what is in the scene | \
             what's in the scene | what is in this scene | what's in this scene | \
             what is in the picture | what can i see | what is visible | what's visible | \
             what is shown | what is hidden | what's hidden | what units are there | \
             what units exist | what units do you know | which units are there | which units exist | \
             what structures are there | which structures are there | what structures can i see | \
             which structures can i see | which structures do you know | \
             what structures do you know | what labels are there | which labels are there | \
             what parts are there | which parts are there | what objects are there | \
             which objects are there | what are the units | what are the structures | \
             what are the units called | name the units | name all units | \
             how many units are there | how many structures are there | which units are visible | \
             which units are hidden | what units are visible | what units are hidden | \
             what do we have | what have we got | what can i select | what can i colour | \
             what can i color",
        complete,
    )],
    examples: &["list the units", "what is there?", "which structures can I see?"],
    fields: &[],
    effect: Effect::None,
    resolve: resolve_list,
};

/// The command "ask about the selection".
pub(super) const QUERY_SELECTION: Command = Command {
    act: Act::QuerySelection,
    title: "ask about the selection",
    constructs: &[Construct::new(
        "what is selected | what's selected | what is currently selected | \
             what is selected now | what is the selection | what's the selection | \
             what is the current selection | what is in the selection | what's in the selection | \
             what have i selected | what did i select | what do i have selected | \
             what i have selected | what am i selecting | is anything selected | \
             is something selected | is there a selection | how many are selected | \
             how much is selected | how many gaussians are selected | how many points are selected | \
             how big is the selection | how large is the selection | describe the selection | \
             tell me about the selection | which part is selected | which unit is selected | \
             which structure is selected | which units are selected | show me what is selected | \
             what's currently selected",
        complete,
    )],
    examples: &["what is selected?", "how big is the selection?"],
    fields: &[],
    effect: Effect::None,
    resolve: resolve_selection,
};

/// The command "describe".
pub(super) const DESCRIBE: Command = Command {
    act: Act::Describe,
    title: "describe",
    constructs: &[
        Construct::with_ellipsis(
            "describe | what is | what's | what are | tell me about | tell me more about | \
                 tell me something about | explain | how big is | how big are | how large is | \
                 how large are | how small is | how many gaussians has | how many gaussians are in | \
                 how many gaussians does | how many points does | how transparent is | \
                 how transparent are | how opaque is | how opaque are | what colour is | \
                 what colour are | what color is | what color are | what colour has | \
                 which colour is | which color is | which colour has | what is the colour of | \
                 what is the color of | what's the colour of | what's the color of | \
                 what is the opacity of | what's the opacity of | what is the size of | \
                 what's the size of | what are the properties of | how visible is | \
                 how much of the picture is | how much of the scene is | what about | info on | \
                 information about | details of | details about",
            Ellipsis::Verb,
            subject,
        ),
        Construct::new("is | are", question),
        Construct::new("what | which | is there | are there | does anything", likeness),
        Construct::new(
            "describe | describe it all | describe what you see | describe the view | \
                 what do you see | what can you see | tell me what you see | what am i looking at | \
                 what are we looking at | what is this scene | what does the scene look like | \
                 how many gaussians are there | how many gaussians",
            whole_scene,
        ),
    ],
    examples: &["describe the scene", "what is the {unit}?", "how big is the {unit}?", "is the {unit} visible?"],
    fields: &[Field::optional("target")],
    effect: Effect::None,
    resolve: resolve_describe,
};

/// Parses the subject of a question: "the sac", "the sac's opacity", "the scene".
fn subject(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    skip("about").parse_next(input)?;
    let (target, ()) = target_then(input, |rest, _| {
        skip("'s colour | 's color | 's opacity | 's transparency | 's size | 's properties").parse_next(rest)?;
        skip("like | look like | looking like | have | has | contain | contains | called | doing | there")
            .parse_next(rest)?;
        end(rest)
    })?;
    Ok(Reading::of(Act::Describe, target))
}

/// Parses "the sac visible", "the sac red". The description of the unit answers such a question.
fn question(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let (target, ()) = target_then(input, |rest, _| {
        skip("currently | now | still | already | completely | fully | in | there").parse_next(rest)?;
        alt((
            exactly(
                "visible | hidden | shown | transparent | opaque | invisible | selected | drawn | big | \
             large | small",
            )
            .void(),
            color.void(),
            end,
        ))
        .parse_next(rest)?;
        end(rest)
    })?;
    if target.unknown > 0 && !input.state.names.is_empty() {
        return Err(EmptyError);
    }
    Ok(Reading::of(Act::Describe, target))
}

/// Parses "units are like the sac", "looks like this", "anything similar to the sac".
fn likeness(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    Ok(Reading::of(Act::Describe, alike_alone(input)?))
}

/// Parses the end of "describe what you see".
fn whole_scene(verb: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    end(input)?;
    let reference = Reference { everything: true, ..Reference::default() };
    Ok(Reading::of(verb.act, Target { reference, unknown: 0 }))
}

fn resolve_list(_: &Clause, context: &Context<'_>) -> Result<Step, Refusal> {
    Ok(Step::Answer { text: query::list(context.state, context.frame), units: Vec::new() })
}

fn resolve_selection(_: &Clause, context: &Context<'_>) -> Result<Step, Refusal> {
    Ok(Step::Answer { text: query::selection(context.state), units: Vec::new() })
}

fn resolve_describe(clause: &Clause, context: &Context<'_>) -> Result<Step, Refusal> {
    let Context { state, frame, .. } = *context;
    let reference = clause.target.clone().unwrap_or(Reference { everything: true, ..Reference::default() });
    if reference.everything {
        return Ok(Step::Answer { text: query::scene(state, frame), units: Vec::new() });
    }
    if reference.complement {
        return Ok(Step::Answer { text: query::list(state, frame), units: Vec::new() });
    }
    let target = target(&reference, state)?;
    let mut parts: Vec<String> = target.units.iter().filter_map(|name| query::unit(name, state, frame)).collect();
    if target.selection {
        parts.push(query::selection(state));
    }
    Ok(Step::Answer { text: parts.join("\n"), units: target.units })
}
