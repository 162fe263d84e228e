//! Named viewpoints: "from the top", "reset the view".

use sg_proto::language::Act;
use sg_proto::scene::{NamedView, Orbit, set_view};
use winnow::Parser;
use winnow::combinator::{alt, opt};
use winnow::error::EmptyError;

use super::command::{Command, Construct, Effect};
use super::set_view::{SET_VIEW_FIELDS, resolve_view};
use crate::syntax::phrase::{Input, Outcome, article, end, exactly, one_of, skip};
use crate::syntax::reading::{Reading, Verb};
use crate::syntax::target::target_then;

/// The command "viewpoint".
pub(super) const VIEWPOINT: Command = Command {
    act: Act::SetView,
    title: "viewpoint",
    constructs: &[Construct::new(
        "(none) | view | look | see | show | show me | display | go | go to | go back to | \
                 switch to | change to | move to | set | change | let me see | i want to see | \
                 can i see | give me | use | look at | turn to | reset | restore | move | back to | \
                 return to | recentre | recenter | put | bring",
        viewpoint,
    )],
    examples: &["view from the top", "show it from below", "reset the view"],
    fields: SET_VIEW_FIELDS,
    effect: Effect::Visible,
    resolve: resolve_view,
};

fn side_name(input: &mut Input<'_>) -> Outcome<NamedView> {
    alt((
        exactly("front | anterior").map(|_| NamedView::Front),
        exactly("back | behind | rear | posterior").map(|_| NamedView::Back),
        exactly("left").map(|_| NamedView::Left),
        exactly("right").map(|_| NamedView::Right),
        exactly("top | above | superior | overhead | cranial").map(|_| NamedView::Top),
        exactly("bottom | below | underneath | beneath | inferior | caudal").map(|_| NamedView::Bottom),
    ))
    .parse_next(input)
}

const VIEW: &str = "view | viewpoint | perspective | side | position | angle | camera";

/// Parses "from the top", "it from above", "the top view". After "reset": "the view".
pub(super) fn viewpoint(verb: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let opposite = |input: &mut Input<'_>| {
        skip("from").parse_next(input)?;
        article(input)?;
        one_of("other side | opposite side | far side | reverse side").parse_next(input)?;
        end(input)?;
        let behind = Orbit { azimuth_degrees: 180.0, elevation_degrees: 0.0 };
        Ok(Reading::view(set_view::Change::Orbit(behind)))
    };
    let initial = |input: &mut Input<'_>| {
        skip("to | back to").parse_next(input)?;
        article(input)?;
        const FIRST: &str = "initial | original | first | starting | start | default | home | opening | usual";
        if matches!(verb.phrase, "reset" | "restore" | "recentre" | "recenter") {
            opt(exactly(FIRST)).parse_next(input)?;
            exactly(
                "view | viewpoint | camera | zoom | perspective | rotation | orientation | position | \
             angle | distance",
            )
            .parse_next(input)?;
        } else {
            let home = opt((exactly("home"), end)).parse_next(input)?;
            if home.is_some() && verb.phrase.is_empty() {
                return Err(EmptyError);
            }
            if home.is_none() {
                exactly(FIRST).parse_next(input)?;
                exactly(VIEW).parse_next(input)?;
            }
        }
        end(input)?;
        Ok(Reading::view(set_view::Change::Named(NamedView::Initial.into())))
    };
    let from = |input: &mut Input<'_>| {
        exactly("from").parse_next(input)?;
        article(input)?;
        let side = side_name(input)?;
        opt((opt(exactly("hand")), exactly("side | direction"))).parse_next(input)?;
        skip("of it | of the scene").parse_next(input)?;
        end(input)?;
        Ok(side)
    };
    let named = |input: &mut Input<'_>| {
        skip("at | to | back to | at it | me").parse_next(input)?;
        article(input)?;
        let side = alt((
            (exactly(VIEW), from).map(|(_, side)| side),
            (exactly(VIEW), exactly("to"), opt(article), side_name, end).map(|(.., side, ())| side),
            from,
            (side_name, opt(exactly("hand")), exactly(VIEW), end).map(|(side, ..)| side),
        ))
        .parse_next(input)?;
        Ok(Reading::view(set_view::Change::Named(side.into())))
    };
    // "the sac from above" shows the whole scene, but the name must be known.
    let of_target = |input: &mut Input<'_>| {
        skip("at").parse_next(input)?;
        let (target, side) = target_then(input, |rest, _| from(rest))?;
        if target.unknown > 0 { Err(EmptyError) } else { Ok(Reading::view(set_view::Change::Named(side.into()))) }
    };
    alt((opposite, initial, named, of_target)).parse_next(input)
}
