//! Frame a target: "frame the selection", "zoom to the sac", "fit the view to the vessels".

use sg_proto::language::{Act, Reference};
use sg_proto::scene::{SetView, Target as SceneTarget, set_view};
use winnow::Parser;
use winnow::combinator::opt;
use winnow::error::EmptyError;

use super::command::{Command, Construct, Effect, Ellipsis};
use super::set_view::{SET_VIEW_FIELDS, resolve_view};
use crate::syntax::phrase::{Input, Outcome, end, one_of, skip};
use crate::syntax::reading::{Reading, Verb};
use crate::syntax::target::{Target, target_then};

/// The command "frame".
pub(super) const FRAME: Command = Command {
    act: Act::SetView,
    title: "frame",
    constructs: &[
        Construct::with_ellipsis(
            "look at | look closer at | zoom in closer on | zoom closer to | bring | take a look at | focus on | \
                 focus | centre on | \
                 center on | centre | center | frame | go to | fly to | move to | zoom to | \
                 zoom on | zoom onto | zoom in on | zoom in to | zoom into | fit | take me to | \
                 point the camera at | aim at | bring into view | show me where | home in on | \
                 get closer to | closer to",
            Ellipsis::Verb,
            frame,
        ),
        Construct::with_ellipsis(
            "fit the view to | fit view to | fit the camera to | fit the picture to | fit the window to",
            Ellipsis::Verb,
            frame,
        ),
    ],
    examples: &["frame the selection", "look at the {unit}", "fit the view to the {unit}", "zoom to the selection"],
    fields: SET_VIEW_FIELDS,
    effect: Effect::Visible,
    resolve: resolve_view,
};

/// Parses the target, and words such as "into view".
fn frame(verb: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    fn focused(target: Target) -> Reading {
        let view = SetView { change: Some(set_view::Change::Focus(SceneTarget::default())) };
        Reading::of(Act::SetView, target).map(|c| c.view = Some(view.clone()))
    }
    if matches!(verb.phrase, "fit" | "frame") {
        let whole = |input: &mut Input<'_>| {
            one_of(
                "to the window | to window | to the screen | to screen | to the view | to view | \
             the view | view | the window",
            )
            .parse_next(input)?;
            end(input)
        };
        if opt(whole).parse_next(input)?.is_some() {
            let reference = Reference { everything: true, ..Reference::default() };
            return Ok(focused(Target { reference, unknown: 0 }));
        }
    }
    skip("the camera on | the view on | the camera at | me").parse_next(input)?;
    let (target, ()) = target_then(input, |rest, _| {
        let tail = opt(one_of(
            "is | are | in the view | into view | into the view | in view | closely | more closely | \
         up close | closer | into focus | in the centre | in the center | in the middle | \
         to the window | to the view",
        ))
        .parse_next(rest)?;
        if verb.phrase == "bring" && tail.is_none() {
            return Err(EmptyError);
        }
        end(rest)
    })?;
    Ok(focused(target))
}
