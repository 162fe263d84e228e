//! The smallest pieces of the grammar: words, phrases, the end of a clause, numbers, colours.

use sg_proto::scene::Color;
use text2num::{Language, text2digits};
use winnow::Parser;
use winnow::combinator::{alt, opt, preceded, repeat};
use winnow::error::EmptyError;
use winnow::stream::{Stateful, Stream as _, TokenSlice};
use winnow::token::any;

use crate::color;
use crate::token::{Kind, Token};

/// What the parsers know beside the tokens.
#[derive(Debug)]
pub(super) struct Known<'t> {
    /// The utterance.
    pub(super) source: &'t str,
    /// Names of the scene's units, each with its folded words.
    pub(super) names: &'t [(String, Vec<String>)],
    /// First words of everything that may begin a clause.
    pub(super) beginnings: &'t [String],
    /// Whether something is selected.
    pub(super) has_selection: bool,
    /// From where the scene is looked at.
    pub(super) view: Option<&'t sg_proto::scene::View>,
}

/// The rest of the utterance.
pub(super) type Input<'t> = Stateful<TokenSlice<'t, &'t Token>, &'t Known<'t>>;

/// A parsed piece, or nothing.
pub(super) type Outcome<O> = Result<O, EmptyError>;

/// The token `ahead` places on.
pub(super) fn peek_at<'t>(input: &Input<'t>, ahead: usize) -> Option<&'t Token> {
    remaining(input).get(ahead).copied()
}

/// All tokens that are left.
pub(super) fn remaining<'t>(input: &Input<'t>) -> &'t [&'t Token] {
    input.input.peek_finish()
}

/// The next token.
pub(super) fn token<'t>(input: &mut Input<'t>) -> Outcome<&'t Token> {
    any.map(|t: &&'t Token| *t).parse_next(input)
}

/// Skips `count` tokens.
pub(super) fn advance(input: &mut Input<'_>, count: usize) {
    for _ in 0..count {
        let _: Outcome<&Token> = token(input);
    }
}

/// The items of a list that is written as one text: `"a bit | a little"`.
pub(super) fn items(list: &'static str) -> impl Iterator<Item = &'static str> {
    list.split('|').map(str::trim)
}

/// One word of a list, in any inflection.
pub(super) fn word<'t>(list: &'static str) -> impl Parser<Input<'t>, &'t Token, EmptyError> {
    token.verify(move |t: &&'t Token| items(list).any(|w| t.is(w)))
}

/// One word, written exactly so.
pub(super) fn exactly<'t>(list: &'static str) -> impl Parser<Input<'t>, &'t Token, EmptyError> {
    token.verify(move |t: &&'t Token| t.kind == Kind::Word && items(list).any(|w| t.text == w))
}

/// One mark.
pub(super) fn mark<'t>(c: char) -> impl Parser<Input<'t>, &'t Token, EmptyError> {
    token.verify(move |t: &&'t Token| t.is_mark(c))
}

/// How many tokens of `tokens` a phrase takes, its words in any inflection; none if it does not stand there.
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

/// The longest of some phrases that stands here; gives its place in the list.
pub(super) fn one_of<'t>(list: &'static str) -> impl Parser<Input<'t>, usize, EmptyError> {
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

/// A phrase, its words in any inflection.
pub(super) fn phrase<'t>(phrase: &'static str) -> impl Parser<Input<'t>, (), EmptyError> {
    move |input: &mut Input<'t>| {
        let length = phrase_length(remaining(input), phrase).ok_or(EmptyError)?;
        advance(input, length);
        Ok(())
    }
}

/// Leaves out one of some phrases if it stands here.
pub(super) fn skip<'t>(list: &'static str) -> impl Parser<Input<'t>, (), EmptyError> {
    opt(one_of(list)).void()
}

/// `the`, `a`, `my` and the like, if one stands here.
pub(super) fn article(input: &mut Input<'_>) -> Outcome<()> {
    opt(exactly("the | a | an | my | our")).void().parse_next(input)
}

/// Words that close a clause without meaning anything.
pub(super) const CLOSERS: &str = "please | now | right now | thanks | thank you | for me | for us | again | too | as well | instead | \
 in the picture | in the image | in the scene | in this scene | in the view | on the screen | \
 if you can | if possible | at once | first | will you | would you | okay | ok";

/// Words that take something out of what was said before them.
pub(super) const EXCEPTING: &str = "except | except for | apart from | other than | besides | excluding";

/// Words that stand between clauses.
pub(super) const JOINTS: &str = "and | then | but | plus | also | after that | afterwards | followed by";

/// Marks that stand between clauses.
pub(super) fn is_break(token: &Token) -> bool {
    matches!(
        token.kind,
        Kind::Mark(',' | ';' | '.' | '!' | '?' | ':' | '-' | '\u{2013}' | '\u{2014}' | '&' | '\u{2026}')
    )
}

/// The end of a clause: the end of the utterance, a mark or a joining word; closing words before it are taken.
pub(super) fn end(input: &mut Input<'_>) -> Outcome<()> {
    let _: Vec<usize> = repeat(0.., one_of(CLOSERS)).parse_next(input)?;
    let tokens = remaining(input);
    // What comes after "except" is looked at by whoever knows what it is excepted from.
    let excepted = items(EXCEPTING).any(|e| phrase_length(tokens, e).is_some());
    let ends = excepted
        || tokens.first().is_none_or(|t| is_break(t))
        || items(JOINTS).any(|j| phrase_length(tokens, j).is_some());
    if ends { Ok(()) } else { Err(EmptyError) }
}

/// A number as it was said.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Quantity {
    /// Its value; a percentage is already divided by 100.
    pub(super) value: f64,
    /// Whether it was said as a percentage or as a fraction of something.
    pub(super) share: bool,
}

impl Quantity {
    /// As an opacity: a bare number above 10 can only have been meant in percent.
    pub(super) fn as_opacity(self) -> f64 {
        if !self.share && self.value > 10.0 { self.value / 100.0 } else { self.value }
    }
}

/// Largest number that is taken for meant.
const MAX_QUANTITY: f64 = 1e6;

/// A number in digits or words, a percentage, or a fraction (`half`, `two thirds`, `1/2`).
pub(super) fn quantity(input: &mut Input<'_>) -> Outcome<Quantity> {
    let found = alt((spoken_fraction, numeric)).parse_next(input)?;
    if found.value <= MAX_QUANTITY { Ok(found) } else { Err(EmptyError) }
}

fn percent_sign<'t>() -> impl Parser<Input<'t>, (), EmptyError> {
    alt((mark('%').void(), phrase("per cent"), exactly("percent | pct | percents").void()))
}

fn numeric(input: &mut Input<'_>) -> Outcome<Quantity> {
    let value = plain_number.parse_next(input)?;
    if let Some(below) = opt(preceded(mark('/'), plain_number)).parse_next(input)? {
        let value = value / below;
        return if value.is_finite() { Ok(Quantity { value, share: true }) } else { Err(EmptyError) };
    }
    match opt(percent_sign()).parse_next(input)? {
        Some(()) => Ok(Quantity { value: value / 100.0, share: true }),
        None => Ok(Quantity { value, share: false }),
    }
}

/// A number in digits or words.
pub(super) fn plain_number(input: &mut Input<'_>) -> Outcome<f64> {
    alt((digits, spoken_number)).parse_next(input)
}

fn digits(input: &mut Input<'_>) -> Outcome<f64> {
    let token = token(input)?;
    match token.kind {
        Kind::Number(value) => Ok(value),
        _ => Err(EmptyError),
    }
}

/// Longest number in words that is tried.
const MAX_NUMBER_WORDS: usize = 8;

fn whole_number(words: &[&str]) -> Option<f64> {
    thread_local! {
        static ENGLISH: Language = Language::english();
    }
    // An ordinal becomes "3rd", which is not a number here: "a third" is a fraction and "the third" a name.
    let text = ENGLISH.with(|english| text2digits(&words.join(" "), english)).ok()?;
    text.parse().ok()
}

fn spoken_number(input: &mut Input<'_>) -> Outcome<f64> {
    let words: Vec<&str> = remaining(input)
        .iter()
        .take(MAX_NUMBER_WORDS)
        .take_while(|t| t.kind == Kind::Word)
        .map(|t| t.text.as_str())
        .collect();
    // "a hundred" and "a thousand" are one hundred and one thousand.
    let skipped = usize::from(matches!(words.get(..2), Some(["a", "hundred" | "thousand"])));
    let words = words.get(skipped..).unwrap_or_default();
    for length in (1..=words.len()).rev() {
        let Some(candidate) = words.get(..length) else { continue };
        let value = match candidate.iter().position(|w| *w == "point") {
            None => whole_number(candidate),
            Some(at) => decimal(candidate.get(..at).unwrap_or_default(), candidate.get(at + 1..).unwrap_or_default()),
        };
        if let Some(value) = value {
            advance(input, skipped + length);
            return Ok(value);
        }
    }
    Err(EmptyError)
}

/// "zero point two five": the digits after the point are said one by one.
fn decimal(whole: &[&str], digits: &[&str]) -> Option<f64> {
    if digits.is_empty() {
        return None;
    }
    let mut value = if whole.is_empty() { 0.0 } else { whole_number(whole)? };
    let mut place = 0.1;
    for digit in digits {
        let digit = whole_number(&[digit]).filter(|d| *d < 10.0)?;
        value += digit * place;
        place /= 10.0;
    }
    Some((value * 1e9).round() / 1e9)
}

fn spoken_fraction(input: &mut Input<'_>) -> Outcome<Quantity> {
    const PARTS: [(&str, f64); 8] = [
        ("half", 2.0),
        ("third", 3.0),
        ("quarter", 4.0),
        ("fourth", 4.0),
        ("fifth", 5.0),
        ("sixth", 6.0),
        ("eighth", 8.0),
        ("tenth", 10.0),
    ];
    const ABOVE: &str = "a | one | two | three | four | five | six | seven | eight | nine";
    let above = opt(one_of(ABOVE)).parse_next(input)?.map_or(1.0, |place| place.max(1) as f64);
    let part = token(input)?;
    let below = PARTS
        .iter()
        .find(|(word, _)| part.text == *word || part.text.strip_suffix('s') == Some(word) || part.lemma == *word)
        .map(|(_, below)| *below)
        .ok_or(EmptyError)?;
    let of = opt(phrase("of")).parse_next(input)?;
    // "half of the sac" is a part of the sac, not a number.
    if of.is_some() { Err(EmptyError) } else { Ok(Quantity { value: above / below, share: true }) }
}

/// How often: `once`, `twice`, `three times`, `2x`, `two steps`.
pub(super) fn times(input: &mut Input<'_>) -> Outcome<f64> {
    let adverb = one_of("once | twice | thrice").map(|place| (place + 1) as f64);
    let counted = (plain_number, exactly("times | time | x | steps | step | notches | notch")).map(|(n, _)| n);
    alt((adverb, counted)).parse_next(input)
}

/// A colour by name or literal, and how it was said.
pub(super) fn color(input: &mut Input<'_>) -> Outcome<(Color, String)> {
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
    let said = slice(input.state.source, tokens.get(emphasis..length).unwrap_or_default());
    advance(input, length);
    Ok((color, said))
}

/// The source text of some tokens, white space reduced to single spaces.
pub(super) fn slice(source: &str, tokens: &[&Token]) -> String {
    let (Some(first), Some(last)) = (tokens.first(), tokens.last()) else { return String::new() };
    let text = source.get(first.start..last.end).unwrap_or_default();
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
