//! Kept viewpoints: "bookmark this view as entry", "go back to the entry view", "forget view 2", "list the bookmarks".
//!
//! Named viewpoints and units go before kept ones of the same name: "the front view" is the front, and "go to the sac" frames the
//! sac. "The bookmark front" is always a kept one.

use sg_proto::language::{Act, Clause};
use sg_proto::scene::command::Action;
use sg_proto::scene::{ForgetView, KeepView, set_view};
use winnow::Parser;
use winnow::combinator::{alt, opt};
use winnow::error::EmptyError;

use super::command::{Command, Construct, Context, Effect, Field, complete};
use super::naming::{name, named};
use super::orbit::orbit;
use super::set_view::{SET_VIEW_FIELDS, resolve_view};
use super::viewpoint::viewpoint;
use crate::query;
use crate::resolution::{Refusal, Step, checked_name, kept_view};
use crate::syntax::number::plain_number;
use crate::syntax::phrase::{
    Input, Outcome, advance, article, end, exactly, items, one_of, peek_at, remaining, skip, slice,
};
use crate::syntax::reading::{Reading, Verb};
use crate::syntax::target::{has_name, is_sentence_word, known_lengths, target_alone};
use crate::syntax::token::{Kind, Token, is_file};
use crate::unit_names;

/// The command "keep a viewpoint".
pub(super) const KEEP_VIEW: Command = Command {
    act: Act::KeepView,
    title: "keep a viewpoint",
    constructs: &[
        Construct::new("bookmark", bookmark),
        Construct::new("remember | memorize | memorise | keep | save | store", keep),
        Construct::new("call | name | label | tag", call),
        Construct::new("add | make | create | set | save | store | put", new_bookmark),
    ],
    examples: &["bookmark this view as entry", "remember this view", "save this view as entry"],
    fields: &[Field::optional("name")],
    effect: Effect::None,
    resolve: resolve_keep,
};

/// Title of the command that goes to a kept viewpoint.
pub(crate) const GO_TO_TITLE: &str = "go to a kept viewpoint";

/// The command "go to a kept viewpoint".
pub(super) const GO_TO_VIEW: Command = Command {
    act: Act::SetView,
    title: GO_TO_TITLE,
    constructs: &[
        Construct::new(
            "go to | go back to | jump to | jump back to | fly to | fly back to | move to | move back to | \
                 take me to | take me back to | bring me to | bring me back to | return to | back to | switch to | \
                 switch back to | change to | set the view to | set view to | change the view to | \
                 switch the view to | move the camera to | restore | recall | load",
            go,
        ),
        Construct::new(
            "show | show me | display | bring up | bring back | see | let me see | can i see | i want to see | \
                 look at | look from | open | use | give me",
            show,
        ),
    ],
    examples: &["go to the bookmark entry", "go back to the view entry", "take me to view 2"],
    fields: SET_VIEW_FIELDS,
    effect: Effect::Visible,
    resolve: resolve_view,
};

/// The command "forget a viewpoint".
pub(super) const FORGET_VIEW: Command = Command {
    act: Act::ForgetView,
    title: "forget a viewpoint",
    constructs: &[Construct::new("forget | delete | remove | erase | discard | drop | get rid of", forget)],
    examples: &["forget the view entry", "delete the bookmark entry"],
    fields: &[Field::required("name")],
    effect: Effect::None,
    resolve: resolve_forget,
};

/// The command "list the viewpoints".
pub(super) const LIST_VIEWS: Command = Command {
    act: Act::ListViews,
    title: "list the kept viewpoints",
    constructs: &[
        Construct::new(
            "list | show | show me | display | see | let me see | give me | name | what | what are | which | \
                 which are | are there | do i have | do we have | how many",
            list,
        ),
        Construct::new("what is bookmarked | what have i bookmarked | which views did i keep", complete),
    ],
    examples: &["list the bookmarks", "which views are kept?"],
    fields: &[],
    effect: Effect::None,
    resolve: resolve_list,
};

/// Participles before a kept viewpoint.
const KEPT: &str = "kept | saved | stored | remembered | bookmarked";

/// Words that tell one viewpoint from another, and name none.
const RELATIVE: &str =
    "last | previous | next | current | present | same | best | better | good | nice | new | whole | camera";

/// Most words of a name that no kept viewpoint has.
const MAX_UNKNOWN_WORDS: usize = 5;

/// A noun beside a name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Noun {
    /// "View": a named viewpoint may be meant as well.
    View,
    /// "Bookmark" and what else means kept viewpoints alone.
    Bookmark,
}

/// A kept viewpoint as it was said.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Spoken {
    name: String,
    /// `None` for a name alone.
    noun: Option<Noun>,
    /// Number of unknown names.
    unknown: usize,
}

/// Parses "bookmark", "saved view", "camera position".
fn noun(input: &mut Input<'_>) -> Outcome<Noun> {
    let kept = opt(exactly(KEPT)).parse_next(input)?;
    let found = alt((
        exactly("bookmark").value(Noun::Bookmark),
        (exactly("camera"), exactly("view | viewpoint | position | angle")).value(Noun::View),
        exactly("view | viewpoint").value(Noun::View),
    ))
    .parse_next(input)?;
    Ok(if kept.is_some() { Noun::Bookmark } else { found })
}

/// Parses a noun at the end of the clause.
fn noun_at_end(input: &mut Input<'_>) -> Outcome<Noun> {
    let found = noun(input)?;
    end(input)?;
    Ok(found)
}

/// Parses "the bookmark entry", "view 2", "the entry view", "entry" at the end of the clause.
fn spoken_view(input: &mut Input<'_>) -> Outcome<Spoken> {
    article(input)?;
    alt((known_name, after_noun, before_noun)).parse_next(input)
}

/// Kept names that begin here, the longest first, each with its number of tokens.
fn known(input: &Input<'_>) -> Vec<(String, usize)> {
    let names = input.state.kept_views;
    let tokens = remaining(input);
    match tokens.first() {
        Some(token) if token.kind == Kind::Quoted && has_name(names, &token.text) => vec![(token.text.clone(), 1)],
        _ => known_lengths(names, tokens)
            .into_iter()
            .map(|length| (slice(input.state.source, tokens.get(..length).unwrap_or_default()), length))
            .collect(),
    }
}

/// Parses "entry", "entry view", "view 2".
fn known_name(input: &mut Input<'_>) -> Outcome<Spoken> {
    for (name, length) in known(input) {
        let mut rest = *input;
        advance(&mut rest, length);
        let behind = opt(noun).parse_next(&mut rest)?;
        if end(&mut rest).is_ok() {
            *input = rest;
            // "View 2" says by itself that it is a viewpoint.
            let says_view = name.to_lowercase().split_whitespace().any(|word| matches!(word, "view" | "viewpoint"));
            let noun = behind.or(says_view.then_some(Noun::View));
            return Ok(Spoken { name, noun, unknown: 0 });
        }
    }
    Err(EmptyError)
}

/// Parses "bookmark entry", "view called entry", "view 2".
fn after_noun(input: &mut Input<'_>) -> Outcome<Spoken> {
    let noun = noun(input)?;
    skip("called | named | with the name | number | no").parse_next(input)?;
    for (name, length) in known(input) {
        let mut rest = *input;
        advance(&mut rest, length);
        if end(&mut rest).is_ok() {
            *input = rest;
            return Ok(Spoken { name, noun: Some(noun), unknown: 0 });
        }
    }
    // "Please" is no name.
    if end(&mut { *input }).is_ok() {
        return Err(EmptyError);
    }
    let number = opt((plain_number.verify(|number: &f64| number.fract() == 0.0), end)).parse_next(input)?;
    if let Some((number, ())) = number {
        // The scene names viewpoints "view 1", "view 2", and so on.
        let name = format!("view {number}");
        let unknown = usize::from(!has_name(input.state.kept_views, &name));
        return Ok(Spoken { name, noun: Some(Noun::Bookmark), unknown });
    }
    let is_quoted = peek_at(input, 0).is_some_and(|t| t.kind == Kind::Quoted);
    if is_quoted || noun == Noun::Bookmark {
        return Ok(Spoken { name: name(input)?, noun: Some(Noun::Bookmark), unknown: 1 });
    }
    unknown_name(input, |rest| end(rest).map(|()| noun))
}

/// Parses "entry view", "'entry' bookmark", where nothing is kept under that name.
fn before_noun(input: &mut Input<'_>) -> Outcome<Spoken> {
    if let Some(token) = peek_at(input, 0).filter(|t| t.kind == Kind::Quoted) {
        let name = token.text.clone();
        advance(input, 1);
        noun_at_end(input)?;
        return Ok(Spoken { name, noun: Some(Noun::Bookmark), unknown: 1 });
    }
    unknown_name(input, noun_at_end)
}

/// Parses a name that no kept viewpoint has, before `tail`: a few words that are not part of the sentence.
fn unknown_name<'t>(input: &mut Input<'t>, tail: impl Fn(&mut Input<'t>) -> Outcome<Noun>) -> Outcome<Spoken> {
    let tokens = remaining(input);
    for length in 1..=MAX_UNKNOWN_WORDS {
        let words = tokens.get(..length).ok_or(EmptyError)?;
        if !words.last().is_some_and(|token| is_name_word(token)) {
            break;
        }
        let mut rest = *input;
        advance(&mut rest, length);
        if let Ok(noun) = tail(&mut rest) {
            let name = slice(input.state.source, words);
            *input = rest;
            return Ok(Spoken { name, noun: Some(noun), unknown: 1 });
        }
    }
    Err(EmptyError)
}

fn is_name_word(token: &Token) -> bool {
    match token.kind {
        Kind::Word => !is_sentence_word(&token.text) && !items(RELATIVE).any(|word| token.text == word),
        Kind::Number(_) => true,
        Kind::Quoted | Kind::Color(_) | Kind::File | Kind::Mark(_) => false,
    }
}

/// Whether the clause ends with a known target, such as "the sac".
fn is_target(input: &Input<'_>) -> bool {
    target_alone(&mut { *input }).is_ok_and(|target| target.unknown == 0)
}

/// Parses "the bookmark entry", "the entry view", "entry".
fn go(verb: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let start = *input;
    let spoken = spoken_view(input)?;
    if spoken.noun != Some(Noun::Bookmark) {
        // "The front view" stays the front.
        let mut at = start;
        if let Ok(side) = viewpoint(verb, &mut at) {
            *input = at;
            return Ok(side);
        }
        // "Go to the left" stays a turn.
        let turns = spoken.noun.is_none() && orbit(verb, &mut { start }).is_ok();
        if turns || is_target(&start) {
            return Err(EmptyError);
        }
    }
    let change = set_view::Change::Kept(spoken.name);
    Ok(Reading { unknown: spoken.unknown, ..Reading::view(change) })
}

/// Parses "the bookmark entry", "the entry view". "Show entry" is about a unit. So is "show the lateral view", unless that view is
/// kept.
fn show(verb: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let spoken = spoken_view(&mut { *input })?;
    let is_view = match spoken.noun {
        Some(Noun::Bookmark) => true,
        Some(Noun::View) => spoken.unknown == 0,
        None => false,
    };
    if is_view { go(verb, input) } else { Err(EmptyError) }
}

/// Parses "the bookmark entry", "view 2", "entry". "Remove the sac" is about a unit.
fn forget(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let start = *input;
    let spoken = spoken_view(input)?;
    if spoken.noun != Some(Noun::Bookmark) && is_target(&start) {
        return Err(EmptyError);
    }
    let reading = Reading::plain(Act::ForgetView).map(|c| c.name.clone_from(&spoken.name));
    Ok(Reading { unknown: spoken.unknown, ..reading })
}

fn keeping(name: &str) -> Reading {
    Reading::plain(Act::KeepView).map(|c| name.clone_into(&mut c.name))
}

/// Parses "this view", "the camera position". Returns whether a picture may be meant as well.
fn subject(input: &mut Input<'_>) -> Outcome<bool> {
    let this = opt(exactly("this | that")).parse_next(input)?;
    article(input)?;
    opt(exactly("current | present")).parse_next(input)?;
    let is_picture = alt((
        exactly("view").value(true),
        (exactly("camera"), exactly("view | viewpoint | position | angle")).value(false),
        exactly("viewpoint | perspective").value(false),
    ))
    .parse_next(input)?;
    Ok(is_picture && this.is_none())
}

/// Refuses the name of a file: "save this view as entry.png" is about a picture.
fn no_file(name: String) -> Outcome<String> {
    if is_file(&name) { Err(EmptyError) } else { Ok(name) }
}

/// Parses "as entry" or nothing at the end of the clause.
fn new_name(input: &mut Input<'_>) -> Outcome<String> {
    skip("here | for later | for now").parse_next(input)?;
    no_file(named(input)?.unwrap_or_default())
}

/// Parses "", "this", "this view as entry", "here as entry".
fn bookmark(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    opt(alt((
        subject.void(),
        exactly("this | that | it | here").void(),
        one_of("where i am | what i see | this place | this spot").void(),
    )))
    .parse_next(input)?;
    Ok(keeping(&new_name(input)?))
}

/// Parses "this view", "the camera position as home". "Save the view" is about a picture.
fn keep(verb: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let may_be_picture = subject(input)?;
    let name = new_name(input)?;
    let saves_picture = matches!(verb.phrase, "keep" | "save" | "store");
    if may_be_picture && name.is_empty() && saves_picture { Err(EmptyError) } else { Ok(keeping(&name)) }
}

/// Parses "this view entry", "the viewpoint as entry".
fn call(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    subject(input)?;
    skip("as | to be | with the name").parse_next(input)?;
    Ok(keeping(&no_file(name(input)?)?))
}

/// Parses "a bookmark here as entry", "this view to my bookmarks".
fn new_bookmark(_: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    let titled = |input: &mut Input<'_>| {
        article(input)?;
        opt(exactly("new")).parse_next(input)?;
        exactly("bookmark").parse_next(input)?;
        skip("of this | of it | of this view | of the view | for this | for this view | for the view | at this view")
            .parse_next(input)
    };
    let listed = |input: &mut Input<'_>| {
        alt((subject.void(), exactly("this | that | it").void())).parse_next(input)?;
        one_of("to my bookmarks | to the bookmarks | to bookmarks | in my bookmarks | in the bookmarks")
            .void()
            .parse_next(input)
    };
    alt((titled, listed)).parse_next(input)?;
    Ok(keeping(&new_name(input)?))
}

/// Parses "the bookmarks", "views are kept", "bookmarks do I have". "Show the views" may be about anything.
fn list(verb: Verb, input: &mut Input<'_>) -> Outcome<Reading> {
    skip("all | all of | any | the list of | a list of").parse_next(input)?;
    article(input)?;
    let kept = opt(exactly(KEPT)).parse_next(input)?;
    let bookmarks = alt((
        exactly("bookmarks").value(true),
        (exactly("camera"), exactly("views | viewpoints | positions | angles")).value(false),
        exactly("views | viewpoints").value(false),
    ))
    .parse_next(input)?;
    let tail = opt(one_of(
        "are kept | are saved | are stored | are bookmarked | are remembered | are there | exist | called | \
         i kept | i saved | i have | i have kept | i have saved | that i kept | that i saved | that i have | \
         that are kept | that are saved | do i have | do we have | do you know | did i keep | did i save | \
         have i kept | have i saved",
    ))
    .parse_next(input)?;
    end(input)?;
    let is_said = bookmarks || kept.is_some() || tail.is_some() || verb.phrase == "list";
    if is_said { Ok(Reading::plain(Act::ListViews)) } else { Err(EmptyError) }
}

fn resolve_keep(clause: &Clause, context: &Context<'_>) -> Result<Step, Refusal> {
    if clause.name.trim().is_empty() {
        return Ok(Step::scene_wide(Action::KeepView(KeepView { name: String::new() })));
    }
    let name = checked_name(clause)?;
    let names = unit_names::kept_views(context.state);
    // In other capitals it is the same viewpoint, and speech has none.
    let same = |kept: &&str| !names.contains(&name.as_str()) && kept.to_lowercase() == name.to_lowercase();
    let name = names.iter().copied().find(same).map_or_else(|| name.clone(), str::to_owned);
    Ok(Step::scene_wide(Action::KeepView(KeepView { name })))
}

fn resolve_forget(clause: &Clause, context: &Context<'_>) -> Result<Step, Refusal> {
    let name = kept_view(&clause.name, context.state)?.to_owned();
    Ok(Step::scene_wide(Action::ForgetView(ForgetView { name })))
}

fn resolve_list(_: &Clause, context: &Context<'_>) -> Result<Step, Refusal> {
    Ok(Step::Answer { text: query::kept_views(context.state), units: Vec::new() })
}
