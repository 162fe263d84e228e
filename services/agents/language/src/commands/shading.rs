//! Terms of the shading.

use sg_proto::language::{Act, Clause};
use sg_proto::scene::command::Action;
use sg_proto::scene::{SetTerm, ShadingTerm};
use winnow::Parser;
use winnow::combinator::{alt, opt};
use winnow::error::EmptyError;

use super::command::{Command, Construct, Context, Effect, Field};
use crate::resolution::{Refusal, Step, missing};
use crate::syntax::phrase::{Input, Outcome, article, end, exactly, one_of, skip};
use crate::syntax::reading::{Reading, Verb};

/// The command "shading terms".
pub(super) const SET_TERM: Command = Command {
    act: Act::SetTerm,
    title: "shading terms",
    constructs: &[Construct::new(
        "(none) | show | show me | show only | show just | show me only | only show | just show | \
             display | display only | view | render | draw | switch to | switch back to | \
             go back to | back to | use | set | let me see | only | just | restore | return to | \
             turn on",
        term,
    )],
    examples: &["show the normals", "show only the diffuse term", "full shading"],
    fields: &[Field::required("term")],
    effect: Effect::Visible,
    resolve,
};

/// Parses "the normals", "the diffuse term", "full shading".
fn term(verb: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let only = |input: &mut Input<'_>| {
        let alone = opt(one_of("only | alone | by itself | on its own | just")).parse_next(input)?;
        Ok(alone.is_some())
    };
    skip("only | just | me").parse_next(input)?;
    article(input)?;
    let normals = alt((
        one_of("surface normals | normal vectors | normal map | normal directions | surface orientation").void(),
        exactly("normals").void(),
    ))
    .map(|()| ShadingTerm::Normal);
    let full = one_of(
        "full shading | normal shading | usual shading | complete shading | regular shading | \
     whole shading | ordinary shading | standard shading | all terms | all the terms | full model | \
     full lighting | full light model | whole model | complete model | shaded view | \
     shaded picture | shading",
    )
    .map(|_| ShadingTerm::Full);
    let part = |input: &mut Input<'_>| {
        let term = alt((
            exactly("ambient").map(|_| ShadingTerm::Ambient),
            exactly("diffuse").map(|_| ShadingTerm::Diffuse),
            exactly("specular").map(|_| ShadingTerm::Specular),
        ))
        .parse_next(input)?;
        let noun = opt(one_of(
            "term | part | component | shading | pass | contribution | map | light | lighting | \
         channel | reflection | reflections | highlights | colour | color",
        ))
        .parse_next(input)?;
        // "specular" alone is ambiguous: it may ask for more specular light.
        if noun.is_none() && verb.phrase.is_empty() && !only(input)? { Err(EmptyError) } else { Ok(term) }
    };
    let term = alt((normals, full, part)).parse_next(input)?;
    only(input)?;
    end(input)?;
    if verb.phrase == "use" && term != ShadingTerm::Full {
        return Err(EmptyError);
    }
    Ok(Reading::plain(Act::SetTerm).map(|c| c.set_term(term)))
}

fn resolve(clause: &Clause, _: &Context<'_>) -> Result<Step, Refusal> {
    match clause.term() {
        ShadingTerm::Unspecified => Err(missing("shading term")),
        term => Ok(Step::scene_wide(Action::SetTerm(SetTerm { term: term.into() }))),
    }
}
