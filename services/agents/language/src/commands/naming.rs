//! Names: save the selection as a unit, rename a unit.

use sg_proto::bus::Code;
use sg_proto::language::{Act, Clause, Reference};
use sg_proto::limits::MAX_NAME_BYTES;
use sg_proto::scene::command::Action;
use sg_proto::scene::{RenameUnit, SaveUnit, SetOperation};
use winnow::Parser;
use winnow::combinator::{alt, opt};
use winnow::error::EmptyError;

use super::command::{Command, Construct, Context, Effect, Field};
use crate::resolution::{Refusal, Step, checked_name, is_base_unit, name_taken, need_selection, renamable_unit, unit};
use crate::syntax::phrase::{
    Input, Outcome, THE_SELECTION, UNIT_NOUN, advance, article, end, exactly, items, one_of, peek_at, remaining, skip,
    slice,
};
use crate::syntax::reading::{Reading, Verb};
use crate::syntax::target::{Target, target_then};
use crate::syntax::token::Kind;
use crate::unit_names::{self, Lookup};

/// The command "name the selection".
pub(super) const LABEL: Command = Command {
    act: Act::Label,
    title: "name the selection",
    constructs: &[
        Construct::new(
            "call | name | label | save | store | tag | keep | remember | make | create | add",
            name_selection,
        ),
        Construct::new("this is | that is | these are | those are | that's", name_only),
        Construct::new("update | overwrite | replace | redefine", update),
    ],
    examples: &["call this the {unit}", "save the selection as {unit}", "label it 'left root'", "update the {unit}"],
    fields: &[Field::required("name"), Field::optional("operation")],
    effect: Effect::None,
    resolve: resolve_label,
};

/// The command "rename".
pub(super) const RENAME: Command = Command {
    act: Act::Rename,
    title: "rename",
    constructs: &[Construct::new("rename | relabel | call | name | change the name of", rename)],
    examples: &["rename the {unit} to dome", "call the {unit} aneurysm"],
    fields: &[Field::required("target"), Field::required("name")],
    effect: Effect::None,
    resolve: resolve_rename,
};

/// Largest number of words of a new name.
const MAX_NAME_WORDS: usize = 8;

/// Parses a new name: quoted, or the words up to the end of the clause without their article.
pub(super) fn name(input: &mut Input<'_>) -> Outcome<String> {
    article(input)?;
    if let Some(token) = peek_at(input, 0).filter(|t| t.kind == Kind::Quoted) {
        let name = token.text.clone();
        advance(input, 1);
        end(input)?;
        return valid_name(name);
    }
    let tokens = remaining(input);
    for length in 1..=MAX_NAME_WORDS.min(tokens.len()) {
        let Some(words) = tokens.get(..length) else { break };
        if !words.iter().all(|t| matches!(t.kind, Kind::Word | Kind::Number(_))) {
            break;
        }
        let mut rest = *input;
        advance(&mut rest, length);
        skip("from the selection | from this selection | from what is selected | for the selection")
            .parse_next(&mut rest)?;
        if end(&mut rest).is_ok() {
            *input = rest;
            return valid_name(slice(input.state.source, words));
        }
    }
    Err(EmptyError)
}

fn valid_name(name: String) -> Outcome<String> {
    /// Words that are not accepted as names.
    const NO_NAMES: &str = "it | this | that | them | these | those | one | selection | everything | all | something | unit | \
     label | structure | nothing | as | to | me | you | the | a";
    let fits =
        !name.is_empty() && name.len() <= MAX_NAME_BYTES && !items(NO_NAMES).any(|word| name.to_lowercase() == word);
    if fits { Ok(name) } else { Err(EmptyError) }
}

/// Parses "this the sac", "the selection as aneurysm", "it 'left root'".
fn name_selection(verb: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let subject = opt(alt((one_of(
        "this | that | it | these | those | them | the selection | my selection | \
     the current selection | selection | the selected part | the selected region | \
     the selected structure | the selected area | the selected thing | what is selected | \
     what 's selected | what i selected | what i have selected | what i brushed | what i marked | \
     this selection | this part | this region | this structure | this thing | this one | this area",
    )
    .void(),)))
    .parse_next(input)?;
    let titled = |input: &mut Input<'_>| {
        opt(exactly("a | an | the")).parse_next(input)?;
        opt(exactly("new | editable")).parse_next(input)?;
        exactly(UNIT_NOUN).parse_next(input)?;
        skip("from the selection | of the selection | from it").parse_next(input)?;
        one_of("called | named | with the name | labelled | labeled").void().parse_next(input)
    };
    let before_name = match verb.phrase {
        "make" | "create" | "add" => titled(input).is_ok(),
        "save" | "store" | "keep" | "remember" => {
            let as_unit = |i: &mut Input<'_>| {
                exactly("as").parse_next(i)?;
                titled(i)
            };
            opt(alt((
                as_unit,
                one_of(
                    "as | under the name | under the name of | under | called | named | with the name | \
                 by the name of",
                )
                .void(),
            )))
            .parse_next(input)?
            .is_some()
        }
        _ => {
            let linked = opt(one_of("as | with | with the name | with the label | to be")).parse_next(input)?;
            subject.is_some() || linked.is_some()
        }
    };
    if !before_name {
        return Err(EmptyError);
    }
    let name = name(input)?;
    Ok(label_reading(&name))
}

fn label_reading(name: &str) -> Reading {
    let selection = Reference { selection: true, ..Reference::default() };
    Reading::of(Act::Label, Target { reference: selection, unknown: 0 }).map(|c| name.clone_into(&mut c.name))
}

/// Parses "the sac" after "this is". It needs the article: "this is great" is not a name.
fn name_only(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let quoted = peek_at(input, 0).is_some_and(|t| t.kind == Kind::Quoted);
    let definite = peek_at(input, 0).is_some_and(|t| t.is("the"));
    if !quoted && !definite {
        return Err(EmptyError);
    }
    Ok(label_reading(&name(input)?))
}

/// Parses "as aneurysm", "under the name aneurysm", or nothing.
pub(super) fn named(input: &mut Input<'_>) -> Outcome<Option<String>> {
    let new = opt((
        one_of(
            "as | under the name | and call it | and name it | and name the copy | and call the copy | named | called",
        ),
        name,
    ))
    .parse_next(input)?;
    end(input)?;
    Ok(new.map(|(_, name)| name))
}

/// Succeeds for one unit, by name or as "it".
fn one_unit(target: &Target) -> Outcome<()> {
    let reference = &target.reference;
    let others = reference.selection || reference.everything || reference.complement;
    let one = (reference.names.len() == 1) != reference.focus;
    if one && !others { Ok(()) } else { Err(EmptyError) }
}

/// Parses "the sac to dome", "the sac dome".
fn rename(verb: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let plain = matches!(verb.phrase, "call" | "name");
    let (target, name) = target_then(input, |rest, target| {
        one_unit(target)?;
        let linked = opt(one_of("to | as | into | to be")).parse_next(rest)?;
        // "call it dome" names the selection. An unknown name needs "to" before the new name.
        if (plain && target.reference.focus) || (target.unknown > 0 && linked.is_none()) {
            return Err(EmptyError);
        }
        name(rest)
    })?;
    Ok(Reading::of(Act::Rename, target).map(|c| c.name.clone_from(&name)))
}

/// Parses "the sac with the selection", "the sac": the unit is replaced by the selection.
fn update(verb: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let (target, ()) = target_then(input, |rest, target| {
        one_unit(target)?;
        let with = opt((exactly("with | by | from | to | as"), one_of(THE_SELECTION))).parse_next(rest)?;
        end(rest)?;
        if verb.phrase == "replace" && with.is_none() { Err(EmptyError) } else { Ok(()) }
    })?;
    let Some(name) = target.reference.names.first().cloned() else { return Err(EmptyError) };
    Ok(Reading { unknown: target.unknown, ..label_reading(&name) }.map(|c| c.set_operation(SetOperation::Replace)))
}

fn resolve_label(clause: &Clause, context: &Context<'_>) -> Result<Step, Refusal> {
    let state = context.state;
    need_selection(state)?;
    let spoken = checked_name(clause)?;
    let replace = clause.operation() == SetOperation::Replace;
    let name = if replace {
        // The unit to update must exist, in any spelling.
        unit(&spoken, state)?.to_owned()
    } else {
        // Derived units do not occupy a name.
        match unit_names::lookup(&spoken, &unit_names::addressable(state)) {
            Lookup::Missing(_) => spoken,
            Lookup::Unique(name) if !is_base_unit(name, state) => {
                return Err(Refusal::new(
                    Code::AlreadyExists,
                    format!(
                        "The name “{name}” exists already. Say “update the {name}” to replace it by the selection, or use another name."
                    ),
                ));
            }
            Lookup::Unique(_) | Lookup::Ambiguous(_) => {
                return Err(name_taken(&spoken));
            }
        }
    };
    if is_base_unit(&name, state) {
        return Err(Refusal::precondition(format!(
            "“{name}” is part of the scene file and cannot be replaced. Use another name."
        )));
    }
    let save = SaveUnit { name: name.clone(), replace };
    Ok(Step::Change { action: Action::SaveUnit(save), units: vec![name] })
}

fn resolve_rename(clause: &Clause, context: &Context<'_>) -> Result<Step, Refusal> {
    let name = renamable_unit(clause, context.state)?;
    let new_name = checked_name(clause)?;
    if let Lookup::Unique(other) = unit_names::lookup(&new_name, &unit_names::addressable(context.state))
        && other != name
    {
        return Err(name_taken(other));
    }
    let units = vec![new_name.clone()];
    Ok(Step::Change { action: Action::RenameUnit(RenameUnit { name, new_name }), units })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::syntax::target::focus;

    #[test]
    fn only_one_unit_can_be_renamed_or_updated() {
        assert!(one_unit(&focus()).is_ok());
        let two = Reference { names: vec!["a".into(), "b".into()], ..Reference::default() };
        assert!(one_unit(&Target { reference: two, unknown: 0 }).is_err());
        let selection = Reference { selection: true, ..Reference::default() };
        assert!(one_unit(&Target { reference: selection, unknown: 0 }).is_err());
    }
}
