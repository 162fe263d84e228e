//! A whole utterance: clause after clause, verbs and objects carried over, what cannot be read set aside.

use sg_proto::language::Clause;
use winnow::Parser;
use winnow::combinator::{alt, repeat};

use crate::commands::command::{Construct, Ellipsis};
use crate::commands::table::TABLE;
use crate::property::assignment;
use crate::syntax::phrase::{
    CLOSERS, EXCEPTING, Input, JOINTS, Outcome, advance, end, is_break, one_of, peek_at, remaining, slice,
};
use crate::syntax::reading::{Property, Reading, Verb};
use crate::syntax::target::target_alone;
use crate::syntax::token::{self, Token};

/// Most clauses of one utterance.
const MAX_CLAUSES: usize = 64;

/// Politeness and other words before a clause that mean nothing.
const PRELUDES: &str = "please | kindly | could you | can you | would you | will you | could we | can we | could i | \
 can i | may i | shall we | would you please | could you please | can you please | would you mind | \
 i want you to | i want to | i would like you to | i would like to | i'd like you to | i'd like to | \
 i need you to | i need to | we need to | we should | you should | you can | you could | let 's | \
 let us | go ahead and | try to | now | right now | ok | okay | alright | hey | hi | hello | well | \
 so | uh | um | er | just | simply | next | finally | lastly | first | second | secondly | thirdly | \
 then | also | and | but | plus | afterwards | after that | if possible | tell me | do you know | \
 say | yes | perhaps | maybe | actually | quickly | again | once more | in addition | \
 at the same time | the same for | and then | help me to | help me | be so kind and | \
 be so kind as to";

/// Words that turn a clause into its opposite, or into one with a condition.
const BLOCKERS: &str = "don't | dont | do not | never | not | no need to | you must not | you shouldn't | stop | avoid | \
 without | if | unless | when | while | until | before | why | instead of | except";

/// What was read.
#[derive(Debug, Default, Clone, PartialEq)]
pub(super) struct Sentence {
    pub(super) clauses: Vec<Clause>,
    pub(super) not_understood: Vec<String>,
    /// Names in the clauses that the scene does not have.
    pub(super) unknown: usize,
}

/// OpeningIndex of every clause, each as lemmas, with their place in the table.
#[derive(Debug)]
pub(super) struct OpeningIndex {
    all: Vec<Opening>,
    /// First lemmas, for telling where a list of names ends.
    pub(super) first: Vec<String>,
}

#[derive(Debug)]
struct Opening {
    words: Vec<Token>,
    verb: Verb,
    construct: &'static Construct,
    /// Place in the table: the earlier of two equal readings is taken.
    order: usize,
}

impl OpeningIndex {
    pub(super) fn of_table() -> Self {
        let mut openings = Vec::new();
        for entry in TABLE {
            for construct in entry.constructs {
                for phrase in construct.phrases() {
                    let order = openings.len();
                    openings.push(Opening {
                        words: token::tokens(phrase),
                        verb: Verb { act: entry.act, phrase },
                        construct,
                        order,
                    });
                }
            }
        }
        let mut first: Vec<String> = openings.iter().filter_map(|o| o.words.first()).map(|t| t.lemma.clone()).collect();
        first.sort_unstable();
        first.dedup();
        Self { all: openings, first }
    }
}

/// What a clause leaves for the next one to lean on.
#[derive(Debug, Clone)]
struct Carried<'b> {
    opening: &'b Opening,
    clause: Clause,
    property: Option<Property>,
}

/// Reads all clauses.
pub(super) fn read(openings: &OpeningIndex, mut input: Input<'_>) -> Sentence {
    let mut sentence = Sentence::default();
    let mut carried: Option<Carried<'_>> = None;
    // Where the part that was not understood began, if the last one was not.
    let mut lost: Option<usize> = None;
    // Whether "it" and "the rest" would lean on something that was not understood.
    let mut dangling = false;
    let all = remaining(&input);
    let source = input.state.source;
    loop {
        let sentence_ended = skip_joints(&mut input);
        if sentence_ended {
            lost = None;
        }
        let at = all.len() - remaining(&input).len();
        if remaining(&input).is_empty() {
            break;
        }
        let blocked = is_blocked(&input);
        let reading = if blocked || sentence.clauses.len() >= MAX_CLAUSES {
            None
        } else {
            clause(openings, &mut input, carried.as_ref())
        };
        match reading {
            Some((opening, reading)) if !(dangling && leans(&reading)) => {
                dangling &= !names_something(&reading);
                lost = None;
                let end = all.len() - remaining(&input).len();
                let words = slice(source, all.get(at..end).unwrap_or_default());
                sentence.unknown += reading.unknown;
                carried = reading.clauses.last().map(|clause| Carried {
                    opening,
                    clause: clause.clone(),
                    property: reading.property,
                });
                sentence.clauses.extend(reading.clauses.into_iter().map(|c| Clause { words: words.clone(), ..c }));
            }
            unread => {
                if unread.is_none() {
                    skip_clause(&mut input, blocked);
                }
                let from = lost.unwrap_or(at);
                let end = all.len() - remaining(&input).len();
                let words = slice(source, all.get(from..end).unwrap_or_default());
                if lost.is_some() {
                    sentence.not_understood.pop();
                }
                if !words.is_empty() {
                    sentence.not_understood.push(words);
                }
                lost = Some(from);
                carried = None;
                dangling = true;
            }
        }
    }
    sentence
}

/// Whether a reading refers to something said before.
fn leans(reading: &Reading) -> bool {
    reading
        .clauses
        .iter()
        .filter_map(|c| c.target.as_ref())
        .any(|t| t.focus || (t.complement && t.names.is_empty() && !t.selection))
}

fn names_something(reading: &Reading) -> bool {
    reading.clauses.iter().filter_map(|c| c.target.as_ref()).any(|t| !t.names.is_empty() || t.selection || t.everything)
}

/// Leaves out joining words, marks, and politeness that stands alone; says whether a sentence ended among them.
fn skip_joints(input: &mut Input<'_>) -> bool {
    // "also" may belong to what follows ("also select the sac"), so it stays.
    const SKIPPED: &str = "and | then | but | plus | after that | afterwards | followed by";
    let mut ended = false;
    loop {
        let joint: Outcome<usize> = one_of(SKIPPED).parse_next(input);
        if joint.is_ok() {
            continue;
        }
        let mut alone = *input;
        let polite: Outcome<()> = repeat(1.., alt((one_of(PRELUDES), one_of(CLOSERS)))).parse_next(&mut alone);
        if polite.is_ok() && peek_at(&alone, 0).is_none_or(is_break) {
            *input = alone;
            continue;
        }
        match peek_at(input, 0) {
            Some(token) if is_break(token) => {
                ended |= ['.', '!', '?', ';'].iter().any(|m| token.is_mark(*m));
                advance(input, 1);
            }
            _ => return ended,
        }
    }
}

/// Whether the clause here is forbidden or conditional, so that no part of it may be done.
fn is_blocked(input: &Input<'_>) -> bool {
    let mut at = *input;
    loop {
        // "don't show the sac" is a way to say "hide the sac".
        let hides: Outcome<usize> = one_of("don't show | do not show").parse_next(&mut at.clone());
        let blocker: Outcome<usize> = one_of(BLOCKERS).parse_next(&mut at.clone());
        if hides.is_ok() || blocker.is_ok() {
            return hides.is_err();
        }
        let prelude: Outcome<usize> = one_of(PRELUDES).parse_next(&mut at);
        if prelude.is_err() {
            return false;
        }
    }
}

/// Skips what could not be read: at least one token, to the next mark or joining word. What is forbidden or conditional
/// reaches over joining words to the end of its sentence.
fn skip_clause(input: &mut Input<'_>, blocked: bool) {
    advance(input, 1);
    while let Some(token) = peek_at(input, 0) {
        let joint: Outcome<usize> = one_of(JOINTS).parse_next(&mut { *input });
        let stops = if blocked {
            ['.', '!', '?', ';'].iter().any(|m| token.is_mark(*m))
        } else {
            is_break(token) || joint.is_ok()
        };
        if stops {
            return;
        }
        advance(input, 1);
    }
}

/// One clause: as it stands, without its politeness, or leaning on the one before.
fn clause<'b>(
    openings: &'b OpeningIndex,
    input: &mut Input<'_>,
    carried: Option<&Carried<'b>>,
) -> Option<(&'b Opening, Reading)> {
    let start = *input;
    let mut at = start;
    loop {
        if let Some((opening, reading, rest)) = full_clause(openings, &at) {
            *input = rest;
            return Some((opening, reading));
        }
        let prelude: Outcome<usize> = one_of(PRELUDES).parse_next(&mut at);
        if prelude.is_err() {
            break;
        }
    }
    let carried = carried?;
    let mut at = start;
    let _: Outcome<usize> = one_of("the same for | likewise | also | then").parse_next(&mut at);
    let (reading, rest) = carried_clause(carried, &at)?;
    *input = rest;
    Some((carried.opening, reading))
}

/// How good a reading is, the least first: unknown names, words left over, place in the table.
type Rank = (usize, usize, usize);

/// A reading, its beginning, and what is left after it.
type Found<'b, 't> = (&'b Opening, Reading, Input<'t>);

/// The best reading of a clause with its own verb: fewest unknown names, then most words, then first in the table.
fn full_clause<'b, 't>(openings: &'b OpeningIndex, input: &Input<'t>) -> Option<Found<'b, 't>> {
    let tokens = remaining(input);
    let mut best: Option<(Rank, Found<'b, 't>)> = None;
    for opening in &openings.all {
        let Some(here) = tokens.get(..opening.words.len()) else { continue };
        if !here.iter().zip(&opening.words).all(|(t, w)| t.text == w.text || (t.lemma == w.lemma && t.kind == w.kind)) {
            continue;
        }
        let mut at = *input;
        advance(&mut at, opening.words.len());
        let Ok(reading) = (opening.construct.parse)(opening.verb, &mut at) else { continue };
        // Without a verb only what is surely there makes a sentence.
        let fits = reading.clauses.iter().all(|c| c.act() == opening.verb.act)
            && !(opening.words.is_empty() && reading.unknown > 0)
            && ends_here(&at)
            && remaining(&at).len() < tokens.len();
        if !fits {
            continue;
        }
        let rank = (reading.unknown, remaining(&at).len(), opening.order);
        if best.as_ref().is_none_or(|(least, _)| rank < *least) {
            best = Some((rank, (opening, reading, at)));
        }
    }
    best.map(|(_, found)| found)
}

/// Whether a clause is over here, with nothing taken out of it by what follows.
fn ends_here(input: &Input<'_>) -> bool {
    let excepted: Outcome<usize> = one_of(EXCEPTING).parse_next(&mut input.clone());
    end(&mut input.clone()).is_ok() && excepted.is_err()
}

/// A clause that leaves out its verb, its object, or both: "and the pot brown", "and transparent", "and the vessel to 0.5",
/// "and the trunk too".
fn carried_clause<'t>(carried: &Carried<'_>, input: &Input<'t>) -> Option<(Reading, Input<'t>)> {
    let opening = carried.opening;
    let read = || {
        let mut at = *input;
        let reading = (opening.construct.parse)(opening.verb, &mut at).ok()?;
        Some((reading, at))
    };
    let with_known_names = || read().filter(|(reading, _)| reading.unknown == 0);
    let continued = || {
        let mut at = *input;
        let reading = assignment::continued(carried.clause.target.as_ref()?, &mut at).ok()?;
        Some((reading, at))
    };
    let same_property = || {
        let mut at = *input;
        let reading = assignment::same_property(carried.property?, &mut at).ok()?;
        Some((reading, at))
    };
    let likewise = || {
        let mut at = *input;
        let target = target_alone(&mut at).ok().filter(|t| t.unknown == 0)?;
        carried.clause.target.as_ref()?;
        let clause = Clause { target: Some(target.reference), ..carried.clause.clone() };
        Some((Reading { clauses: vec![clause], unknown: 0, property: carried.property }, at))
    };
    match opening.construct.ellipsis {
        Ellipsis::None => None,
        Ellipsis::Verb => with_known_names(),
        Ellipsis::VerbOrValue => with_known_names().or_else(likewise),
        Ellipsis::VerbTargetOrValue => read().or_else(continued).or_else(likewise),
        Ellipsis::PropertyOrValue => same_property().or_else(likewise),
    }
}
