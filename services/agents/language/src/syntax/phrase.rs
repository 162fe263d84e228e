//! Parsers of words, phrases, colours and the end of a clause.

use std::cell::Cell;

use sg_proto::scene::Color;
use winnow::Parser;
use winnow::combinator::{alt, opt, repeat};
use winnow::error::EmptyError;
use winnow::stream::{Stateful, Stream as _, TokenSlice};
use winnow::token::any;

use crate::color;
use crate::syntax::token::{Kind, Token};

/// Context of the parsers: the utterance and the scene.
#[derive(Debug)]
pub(crate) struct ParseContext<'t> {
    /// The utterance.
    pub(crate) source: &'t str,
    /// Names of the scene's units, each with its normalized words.
    pub(crate) names: &'t [(String, Vec<String>)],
    /// Names of kept viewpoints, each with its normalized words.
    pub(crate) kept_views: &'t [(String, Vec<String>)],
    /// First lemmas of all opening phrases.
    pub(crate) opening_lemmas: &'t [String],
    /// Whether something is selected.
    pub(crate) has_selection: bool,
    /// Whether "it" is a unit of the last command.
    pub(crate) has_focus: bool,
    /// The current viewpoint.
    pub(crate) view: Option<&'t sg_proto::scene::View>,
    /// Readings of targets that may still be tried in this utterance. Without a limit, a long list of names that no command
    /// takes would be read again from each of its names for seconds.
    pub(crate) readings_left: Cell<usize>,
}

/// The remaining tokens.
pub(crate) type Input<'t> = Stateful<TokenSlice<'t, &'t Token>, &'t ParseContext<'t>>;

/// The result of a parser.
pub(crate) type Outcome<O> = Result<O, EmptyError>;

/// The token after `ahead` others.
pub(crate) fn peek_at<'t>(input: &Input<'t>, ahead: usize) -> Option<&'t Token> {
    remaining(input).get(ahead).copied()
}

/// All remaining tokens.
pub(crate) fn remaining<'t>(input: &Input<'t>) -> &'t [&'t Token] {
    input.input.peek_finish()
}

/// Takes the next token.
pub(crate) fn token<'t>(input: &mut Input<'t>) -> Outcome<&'t Token> {
    any.map(|t: &&'t Token| *t).parse_next(input)
}

/// Skips `count` tokens.
pub(crate) fn advance(input: &mut Input<'_>, count: usize) {
    for _ in 0..count {
        let _: Outcome<&Token> = token(input);
    }
}

/// The items of a list in one text: `"a bit | a little"`.
pub(crate) fn items(list: &'static str) -> impl Iterator<Item = &'static str> {
    list.split('|').map(str::trim)
}

/// Parses one word of a list in any inflection.
pub(crate) fn word<'t>(list: &'static str) -> impl Parser<Input<'t>, &'t Token, EmptyError> {
    token.verify(move |t: &&'t Token| items(list).any(|w| t.is(w)))
}

/// Parses one word of a list, spelled exactly.
pub(crate) fn exactly<'t>(list: &'static str) -> impl Parser<Input<'t>, &'t Token, EmptyError> {
    token.verify(move |t: &&'t Token| t.kind == Kind::Word && items(list).any(|w| t.text == w))
}

/// Parses a mark.
pub(crate) fn mark<'t>(c: char) -> impl Parser<Input<'t>, &'t Token, EmptyError> {
    token.verify(move |t: &&'t Token| t.is_mark(c))
}

/// Number of tokens that a phrase takes, its words in any inflection. `None`: the phrase does not match.
fn phrase_length(tokens: &[&Token], phrase: &str) -> Option<usize> {
    let mut length = 0;
    for word in phrase.split(' ') {
        if !tokens.get(length)?.is(word) {
            return None;
        }
        length += 1;
    }
    Some(length)
}

/// Parses the longest matching phrase of a list. Returns its position in the list.
pub(crate) fn one_of<'t>(list: &'static str) -> impl Parser<Input<'t>, usize, EmptyError> {
    move |input: &mut Input<'t>| {
        let tokens = remaining(input);
        let longest = items(list)
            .enumerate()
            .filter_map(|(place, phrase)| phrase_length(tokens, phrase).map(|length| (length, place)))
            .max_by_key(|(length, place)| (*length, std::cmp::Reverse(*place)));
        let (length, place) = longest.ok_or(EmptyError)?;
        advance(input, length);
        Ok(place)
    }
}

/// Parses a phrase, its words in any inflection.
pub(crate) fn phrase<'t>(phrase: &'static str) -> impl Parser<Input<'t>, (), EmptyError> {
    move |input: &mut Input<'t>| {
        let length = phrase_length(remaining(input), phrase).ok_or(EmptyError)?;
        advance(input, length);
        Ok(())
    }
}

/// Skips one of some phrases, if it matches.
pub(crate) fn skip<'t>(list: &'static str) -> impl Parser<Input<'t>, (), EmptyError> {
    opt(one_of(list)).void()
}

/// Skips `the`, `a`, `my` and similar words.
pub(crate) fn article(input: &mut Input<'_>) -> Outcome<()> {
    opt(exactly("the | a | an | my | our")).void().parse_next(input)
}

/// Words without meaning at the end of a clause.
pub(crate) const CLOSERS: &str = "please | now | right now | thanks | thank you | for me | for us | again | too | as well | instead | \
 in the picture | in the image | in the scene | in this scene | in the view | on the screen | \
 if you can | if possible | at once | first | will you | would you | okay | ok";

/// Phrases for the selection after "from" or "to".
pub(crate) const THE_SELECTION: &str = "the selection | my selection | the current selection | selection | what is selected | \
     the selected | what i have brushed | what i 've brushed | what i brushed | what i have selected | what i selected | \
     my brushed part | the brushed part";

/// Nouns for a unit.
pub(crate) const UNIT_NOUN: &str = "unit | label | structure | object | segment | component | part | group | region";

/// Words that begin an exception.
pub(crate) const EXCEPTING: &str = "except | except for | apart from | other than | besides | excluding";

/// Conjunctions between clauses.
pub(crate) const CONJUNCTIONS: &str = "and | then | but | plus | also | after that | afterwards | followed by";

/// Marks between clauses.
pub(crate) fn is_break(token: &Token) -> bool {
    matches!(
        token.kind,
        Kind::Mark(',' | ';' | '.' | '!' | '?' | ':' | '-' | '\u{2013}' | '\u{2014}' | '&' | '\u{2026}')
    )
}

/// Parses the end of a clause: the end of the utterance, a mark or a conjunction, after closing words.
pub(crate) fn end(input: &mut Input<'_>) -> Outcome<()> {
    let _: Vec<usize> = repeat(0.., one_of(CLOSERS)).parse_next(input)?;
    let tokens = remaining(input);
    // The caller handles the exception.
    let excepted = items(EXCEPTING).any(|e| phrase_length(tokens, e).is_some());
    let ends = excepted
        || tokens.first().is_none_or(|t| is_break(t))
        || items(CONJUNCTIONS).any(|j| phrase_length(tokens, j).is_some());
    if ends { Ok(()) } else { Err(EmptyError) }
}

/// Parses the end of the utterance, after closing words and marks.
pub(crate) fn over(input: &mut Input<'_>) -> Outcome<()> {
    let closing = alt((one_of(CLOSERS).void(), token.verify(|t: &&Token| is_break(t)).void()));
    let _: Vec<()> = repeat(0.., closing).parse_next(input)?;
    if remaining(input).is_empty() { Ok(()) } else { Err(EmptyError) }
}

/// Parses a colour by name or literal. Returns it with its spoken name.
pub(crate) fn color(input: &mut Input<'_>) -> Outcome<(Color, String)> {
    let tokens = remaining(input);
    let first = tokens.first().ok_or(EmptyError)?;
    let (color, length) = match first.kind {
        Kind::Color(channels) => (color::from_rgb(channels), 1),
        Kind::Quoted => (color::from_phrase(&first.text).ok_or(EmptyError)?, 1),
        _ => {
            let words: Vec<&str> = tokens
                .iter()
                .take(color::MAX_WORDS)
                .take_while(|t| t.kind == Kind::Word)
                .map(|t| t.text.as_str())
                .collect();
            color::from_words(&words).ok_or(EmptyError)?
        }
    };
    let emphasis = tokens.iter().take(length.saturating_sub(1)).take_while(|t| color::is_emphasis(&t.text)).count();
    let spoken = slice(input.state.source, tokens.get(emphasis..length).unwrap_or_default());
    advance(input, length);
    Ok((color, spoken))
}

/// The source text of some tokens, with single spaces.
pub(crate) fn slice(source: &str, tokens: &[&Token]) -> String {
    let (Some(first), Some(last)) = (tokens.first(), tokens.last()) else { return String::new() };
    let text = source.get(first.start..last.end).unwrap_or_default();
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
