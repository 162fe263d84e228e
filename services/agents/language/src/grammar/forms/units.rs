//! Selecting, naming and deleting units; questions; steps of the history.

use sg_proto::language::{Act, Reference};
use sg_proto::limits::MAX_NAME_BYTES;
use sg_proto::scene::SetOperation;
use winnow::Parser;
use winnow::combinator::{alt, opt};
use winnow::error::EmptyError;

use super::{Reading, clause};
use crate::grammar::phrase::{
    Input, Outcome, advance, article, color, end, exactly, items, one_of, peek_at, plain_number, remaining, skip, slice,
};
use crate::grammar::target::{Target, target_alone, target_then};
use crate::token::Kind;

/// Ways to say "from the selection" and "to the selection" after their preposition.
const THE_SELECTION: &str = "the selection | my selection | the current selection | selection | what is selected | \
     the selected";

/// A clause that its beginning says completely.
pub(super) fn nothing(act: Act, input: &mut Input<'_>) -> Outcome<Reading> {
    end(input)?;
    // The one selection that is said without naming anything is all that is not selected.
    if act == Act::Select {
        let inverse = Reference { selection: true, complement: true, ..Reference::default() };
        return Ok(select(Target { reference: inverse, unknown: 0 }, SetOperation::Replace));
    }
    if act == Act::Describe {
        let reference = Reference { everything: true, ..Reference::default() };
        return Ok(Reading::of(act, Target { reference, unknown: 0 }));
    }
    Ok(Reading::plain(act))
}

fn select(target: Target, operation: SetOperation) -> Reading {
    Reading::of(Act::Select, target).map(|c| c.set_operation(operation))
}

/// "the sac", "the vessel to the selection", "the vessel too".
pub(super) fn selecting(opening: &str, input: &mut Input<'_>) -> Outcome<Reading> {
    let adds = matches!(opening, "add" | "also select" | "also pick" | "include");
    skip("only | just").parse_next(input)?;
    let (target, added) = target_then(input, |rest, _| {
        let to = opt((exactly("to | in | into"), one_of(THE_SELECTION))).parse_next(rest)?;
        let too = opt(one_of("too | as well | also | in addition | additionally")).parse_next(rest)?;
        end(rest)?;
        // "add the sac" could as well mean to make a unit of that name.
        if opening == "add" && to.is_none() { Err(EmptyError) } else { Ok(to.is_some() || too.is_some()) }
    })?;
    Ok(select(target, if adds || added { SetOperation::Add } else { SetOperation::Replace }))
}

/// "the vessel" after "deselect", "the vessel from the selection" after "remove".
pub(super) fn unselecting(opening: &str, input: &mut Input<'_>) -> Outcome<Reading> {
    let plain = matches!(opening, "deselect" | "unselect");
    let (target, ()) = target_then(input, |rest, target| {
        let from = opt((one_of("from | out of | off"), one_of(THE_SELECTION))).parse_next(rest)?;
        end(rest)?;
        // To deselect everything is to select nothing.
        let all = target.reference.everything && !target.reference.complement;
        if (plain || from.is_some()) && !all { Ok(()) } else { Err(EmptyError) }
    })?;
    Ok(select(target, SetOperation::Remove))
}

/// "the selection with the vessel", "with the vessel", "the selection to the vessel".
pub(super) fn intersecting(input: &mut Input<'_>) -> Outcome<Reading> {
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
    Ok(select(target, SetOperation::Intersect))
}

/// Most words of a name that is given.
const MAX_NAME_WORDS: usize = 8;

/// A name to give: in quotation marks, or the words up to the end of the clause, without their article.
fn name(input: &mut Input<'_>) -> Outcome<String> {
    article(input)?;
    if let Some(token) = peek_at(input, 0).filter(|t| t.kind == Kind::Quoted) {
        let name = token.text.clone();
        advance(input, 1);
        end(input)?;
        return checked(name);
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
            return checked(slice(input.state.source, words));
        }
    }
    Err(EmptyError)
}

fn checked(name: String) -> Outcome<String> {
    /// Words that point at something; as a name they can only be a slip.
    const NO_NAMES: &str = "it | this | that | them | these | those | selection | everything | all | something | unit | \
     label | structure | nothing | as | to | me | you | the | a";
    let fits =
        !name.is_empty() && name.len() <= MAX_NAME_BYTES && !items(NO_NAMES).any(|word| name.to_lowercase() == word);
    if fits { Ok(name) } else { Err(EmptyError) }
}

const UNIT: &str = "unit | label | structure | object | segment | component | part | group | region";

/// "this the sac", "the selection as aneurysm", "it 'left root'".
pub(super) fn naming(opening: &str, input: &mut Input<'_>) -> Outcome<Reading> {
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
        exactly(UNIT).parse_next(input)?;
        skip("from the selection | of the selection | from it").parse_next(input)?;
        one_of("called | named | with the name | labelled | labeled").void().parse_next(input)
    };
    let before_name = match opening {
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
    Ok(label(&name))
}

fn label(name: &str) -> Reading {
    let selection = Reference { selection: true, ..Reference::default() };
    Reading::of(Act::Label, Target { reference: selection, unknown: 0 }).map(|c| name.clone_into(&mut c.name))
}

/// "the sac" after "this is": a statement that gives a name needs its article, so that "this is great" gives none.
pub(super) fn name_only(input: &mut Input<'_>) -> Outcome<Reading> {
    let quoted = peek_at(input, 0).is_some_and(|t| t.kind == Kind::Quoted);
    let definite = peek_at(input, 0).is_some_and(|t| t.is("the"));
    if !quoted && !definite {
        return Err(EmptyError);
    }
    Ok(label(&name(input)?))
}

/// One unit, by name or as "it".
fn one_unit(target: &Target) -> Outcome<()> {
    let reference = &target.reference;
    let others = reference.selection || reference.everything || reference.complement;
    let one = (reference.names.len() == 1) != reference.focus;
    if one && !others { Ok(()) } else { Err(EmptyError) }
}

/// "the sac to dome", "the sac dome".
pub(super) fn renaming(opening: &str, input: &mut Input<'_>) -> Outcome<Reading> {
    let plain = matches!(opening, "call" | "name");
    let (target, name) = target_then(input, |rest, target| {
        one_unit(target)?;
        let linked = opt(one_of("to | as | into | to be")).parse_next(rest)?;
        // "call it dome" names the selection; and what nobody knows must be told apart from its new name.
        if (plain && target.reference.focus) || (target.unknown > 0 && linked.is_none()) {
            return Err(EmptyError);
        }
        name(rest)
    })?;
    Ok(Reading::of(Act::Rename, target).map(|c| c.name.clone_from(&name)))
}

/// "the sac with the selection", "the sac": the selection under a name that is there already.
pub(super) fn updating(opening: &str, input: &mut Input<'_>) -> Outcome<Reading> {
    let (target, ()) = target_then(input, |rest, target| {
        one_unit(target)?;
        let with = opt((exactly("with | by | from | to | as"), one_of(THE_SELECTION))).parse_next(rest)?;
        end(rest)?;
        if opening == "replace" && with.is_none() { Err(EmptyError) } else { Ok(()) }
    })?;
    let Some(name) = target.reference.names.first().cloned() else { return Err(EmptyError) };
    Ok(Reading { unknown: target.unknown, ..label(&name) }.map(|c| c.set_operation(SetOperation::Replace)))
}

/// "the sac", "the unit sac". What is deleted is never somebody's ("my files"), but a unit of the scene.
pub(super) fn deleting(opening: &str, input: &mut Input<'_>) -> Outcome<Reading> {
    let owned: Outcome<_> = exactly("my | our | your | his | her | their").parse_next(&mut input.clone());
    let mut at = *input;
    article(&mut at)?;
    let explicit = exactly(UNIT).parse_next(&mut at).is_ok();
    if owned.is_ok() || (matches!(opening, "remove" | "drop" | "get rid of") && !explicit) {
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
    // A complement belongs to the names it excepts.
    if target.reference.complement {
        references = vec![target.reference.clone()];
    } else if rest != Reference::default() {
        references.push(rest);
    }
    let clauses = references.into_iter().map(|reference| clause(Act::Delete, reference)).collect();
    Ok(Reading { clauses, unknown: target.unknown, property: None })
}

/// What a question is about: "the sac", "the sac's opacity", "the scene".
pub(super) fn subject(input: &mut Input<'_>) -> Outcome<Reading> {
    skip("about").parse_next(input)?;
    let (target, ()) = target_then(input, |rest, _| {
        skip("'s colour | 's color | 's opacity | 's transparency | 's size | 's properties").parse_next(rest)?;
        skip("like | look like | looking like | have | has | contain | contains | called | doing | there")
            .parse_next(rest)?;
        end(rest)
    })?;
    Ok(Reading::of(Act::Describe, target))
}

/// "the sac visible", "the sac red": a question that describing the unit answers.
pub(super) fn asking(input: &mut Input<'_>) -> Outcome<Reading> {
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

/// "twice", "the last 3 changes", "that", "two steps".
pub(super) fn steps(act: Act, opening: &str, input: &mut Input<'_>) -> Outcome<Reading> {
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
    if matches!(opening, "bring back" | "do again") && noun.is_none() && count.is_none() {
        return Err(EmptyError);
    }
    let count = count.unwrap_or(1.0);
    if !(1.0..=1000.0).contains(&count) || count.fract() != 0.0 {
        return Err(EmptyError);
    }
    Ok(Reading::plain(act).map(|c| c.amount = Some(count)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grammar::target::focus;

    #[test]
    fn a_rename_or_update_is_of_one_unit() {
        assert!(one_unit(&focus()).is_ok());
        let two = Reference { names: vec!["a".into(), "b".into()], ..Reference::default() };
        assert!(one_unit(&Target { reference: two, unknown: 0 }).is_err());
        let selection = Reference { selection: true, ..Reference::default() };
        assert!(one_unit(&Target { reference: selection, unknown: 0 }).is_err());
    }
}
