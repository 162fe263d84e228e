//! Other answers to the strokes: more, less, the whole thing, only this part.

use sg_proto::language::{Act, Clause};
use sg_proto::selection::{AnswerStep, StrokesRequest};

use super::command::{Command, Construct, Context, Effect, Field};
use crate::resolution::{Refusal, Step, missing, need_selection};
use crate::syntax::phrase::{Input, Outcome, end};
use crate::syntax::reading::{Reading, Verb};

/// The command "take another answer".
pub(super) const TAKE_ANSWER: Command = Command {
    act: Act::TakeAnswer,
    title: "more or less of a Region",
    constructs: &[
        Construct::new(
            "more | a bit more | a little more | some more | more of it | more of this | more of that | more than this | \
                 more than that | select more | select more of it | take more | wider | a wider answer | the wider answer | \
                 take the wider answer | bigger | larger | a larger part | the larger part | too little | that is too little | \
                 it is too little",
            |verb, input| other(verb, input, AnswerStep::Wider),
        ),
        Construct::new(
            "less | a bit less | a little less | less of it | less of this | less of that | less than this | less than that | \
                 select less | select less of it | take less | narrower | a narrower answer | the narrower answer | \
                 take the narrower answer | smaller | a smaller part | the smaller part | too much | that is too much | \
                 it is too much",
            |verb, input| other(verb, input, AnswerStep::Narrower),
        ),
        Construct::new(
            "the whole thing | whole thing | the entire thing | the whole structure | the entire structure | the whole of it | \
                 the complete structure | i mean the whole thing | i meant the whole thing | select the whole thing | \
                 take the whole thing | select the whole structure | take the whole structure | the widest answer | \
                 take the widest answer",
            |verb, input| other(verb, input, AnswerStep::Widest),
        ),
        Construct::new(
            "only this part | just this part | only this bit | just this bit | only this piece | just this piece | only that part | \
                 just that part | this part | this part only | this bit only | this part alone | select only this part | \
                 select just this part | take only this part | i mean only this part | i meant only this part | \
                 the narrowest answer | take the narrowest answer",
            |verb, input| other(verb, input, AnswerStep::Narrowest),
        ),
        Construct::new(
            "the first answer | take the first answer | back to the first answer | go back to the first answer",
            |verb, input| other(verb, input, AnswerStep::First),
        ),
    ],
    examples: &["more", "less", "the whole thing", "only this part"],
    fields: &[Field::required("answer")],
    effect: Effect::None,
    resolve,
};

/// Parses the end of "more", "the whole thing" and their like.
fn other(verb: Verb, input: &mut Input<'_>, step: AnswerStep) -> Outcome<Reading> {
    end(input)?;
    Ok(Reading::plain(verb.act).map(|c| c.set_answer(step)))
}

fn resolve(clause: &Clause, context: &Context<'_>) -> Result<Step, Refusal> {
    if clause.answer() == AnswerStep::Unspecified {
        return Err(missing("answer"));
    }
    need_selection(context.state)?;
    Ok(Step::Strokes(StrokesRequest { answer: clause.answer, ..StrokesRequest::default() }))
}
