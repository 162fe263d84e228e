//! The view that shows most of a target: "show me the best view of the sac".

use sg_proto::language::{Act, Clause};
use sg_proto::scene::Target as SceneTarget;
use winnow::Parser;
use winnow::combinator::opt;

use super::command::{Command, Construct, Context, Effect, Field};
use crate::resolution::{Refusal, Step, selected_count, target_of};
use crate::syntax::phrase::{Input, Outcome, article, end, exactly, one_of, skip};
use crate::syntax::reading::{Reading, Verb};
use crate::syntax::target::target_then;

/// The command "best view".
pub(super) const BEST_VIEW: Command = Command {
    act: Act::BestView,
    title: "best view",
    constructs: &[
        Construct::new(
            "(none) | show | show me | give me | find | find me | get | get me | take | go to | take me to | bring me to | \
             move to | turn to | switch to | change to | set | choose | pick | use | look from | see | view | display | look at | \
             let me see | i want to see | can i see | i want | i would like | what is | what's | which is | where is | \
             look for | search for",
            view_of,
        ),
        Construct::new(
            "show | show me | look at | see | view | display | let me see | i want to see | can i see | turn | present | put",
            from_its_best_side,
        ),
        Construct::new(
            "where can i see | from where can i see | where do i see | from where do i see | how can i see | how do i see | \
             where should i look to see | which view shows | which angle shows | what view shows | what angle shows | \
             which side shows | which direction shows | which viewpoint shows",
            seen_best,
        ),
    ],
    examples: &["show me the best view of the {unit}", "show the {unit} from its best side", "the best view"],
    fields: &[Field::optional("target")],
    effect: Effect::Possible,
    resolve,
};

/// Praise of a view.
const BEST: &str = "best | clearest | nicest | ideal | optimal | optimum | perfect | good | better | nice | clear | prettiest | \
     most informative | most revealing | most useful | most telling | least hidden | least occluded";

/// Words for a view.
const VIEW: &str = "view | viewpoint | perspective | side | angle | viewing angle | camera angle | direction | viewing direction | \
     position | camera position | vantage point | shot | look | projection";

fn praise(input: &mut Input<'_>) -> Outcome<()> {
    skip("very | really | single").parse_next(input)?;
    one_of(BEST).void().parse_next(input)
}

/// Parses "the best view of the sac", "the best angle to see it from", "a good view".
fn view_of(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    skip("from | at | for").parse_next(input)?;
    article(input)?;
    praise(input)?;
    one_of(VIEW).parse_next(input)?;
    if opt(end).parse_next(input)?.is_some() {
        return Ok(Reading::plain(Act::BestView));
    }
    one_of(
        "of | on | onto | at | for | to | to see | to view | to show | to look at | for seeing | for viewing | for looking at | \
         from which to see | that shows",
    )
    .parse_next(input)?;
    let (target, ()) = target_then(input, |rest, _| {
        skip("from").parse_next(rest)?;
        end(rest)
    })?;
    Ok(Reading::of(Act::BestView, target))
}

/// Parses "the sac from its best side", "it from where it is seen best".
fn from_its_best_side(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let (target, ()) = target_then(input, |rest, _| {
        exactly("from | in | to | at").parse_next(rest)?;
        opt(exactly("its | their | the | a | an")).parse_next(rest)?;
        praise(rest)?;
        one_of(VIEW).parse_next(rest)?;
        end(rest)
    })?;
    Ok(Reading::of(Act::BestView, target))
}

/// Parses "the sac best", "most of the sac".
fn seen_best(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    const MOST: &str = "best | most clearly | clearest | well | clearly | the best | in full | completely";
    let most = opt(one_of("most of | the most of")).parse_next(input)?.is_some();
    let (target, ()) = target_then(input, |rest, _| {
        if !most {
            one_of(MOST).parse_next(rest)?;
        }
        skip("from").parse_next(rest)?;
        end(rest)
    })?;
    Ok(Reading::of(Act::BestView, target))
}

/// Without a target it is the selection, or everything.
fn resolve(clause: &Clause, context: &Context<'_>) -> Result<Step, Refusal> {
    let target = match &clause.target {
        Some(_) => target_of(clause, context.state)?,
        None if selected_count(context.state) > 0 => SceneTarget { selection: true, ..SceneTarget::default() },
        None => SceneTarget { everything: true, ..SceneTarget::default() },
    };
    Ok(Step::BestView(target))
}
