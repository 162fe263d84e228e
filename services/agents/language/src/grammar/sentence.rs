//! Parser of a whole utterance: clause after clause, with ellipsis, and the parts that are not understood.

use sg_proto::language::Clause;
use winnow::Parser;
use winnow::combinator::{alt, repeat};

use crate::commands::command::{Construct, Ellipsis};
use crate::commands::table::TABLE;
use crate::property::assignment;
use crate::syntax::phrase::{
    CLOSERS, CONJUNCTIONS, EXCEPTING, Input, Outcome, advance, end, is_break, one_of, over, peek_at, remaining, slice,
};
use crate::syntax::reading::{Property, Reading, Verb};
use crate::syntax::target::target_alone;
use crate::syntax::token::{self, Token};

/// Largest number of clauses in an utterance.
const MAX_CLAUSES: usize = 64;

/// Words before a clause without a meaning of their own, such as politeness.
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

/// Negations and conditions.
const NEGATIONS: &str = "don't | dont | do not | never | not | no need to | you must not | you shouldn't | stop | avoid | \
 without | if | unless | when | while | until | before | why | instead of | except";

/// The parsed utterance.
#[derive(Debug, Default, Clone, PartialEq)]
pub(super) struct Sentence {
    pub(super) clauses: Vec<Clause>,
    pub(super) not_understood: Vec<String>,
    /// Number of unknown names in the clauses.
    pub(super) unknown: usize,
}

impl Sentence {
    /// Whether every part is understood, with known names alone.
    pub(super) fn is_certain(&self) -> bool {
        self.not_understood.is_empty() && self.unknown == 0 && !self.clauses.is_empty()
    }
}

/// All opening phrases of the table, as tokens.
#[derive(Debug)]
pub(super) struct OpeningIndex {
    all: Vec<Opening>,
    /// First lemmas. They end a list of names.
    pub(super) first_lemmas: Vec<String>,
}

#[derive(Debug)]
struct Opening {
    words: Vec<Token>,
    verb: Verb,
    construct: &'static Construct,
    /// Position in the table. The first of two equal readings wins.
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
        let mut first_lemmas: Vec<String> =
            openings.iter().filter_map(|o| o.words.first()).map(|t| t.lemma.clone()).collect();
        first_lemmas.sort_unstable();
        first_lemmas.dedup();
        Self { all: openings, first_lemmas }
    }
}

/// The previous clause, for ellipsis in the next one.
#[derive(Debug, Clone)]
struct Antecedent<'b> {
    opening: &'b Opening,
    clause: Clause,
    property: Option<Property>,
}

/// Parses all clauses.
pub(super) fn parse(openings: &OpeningIndex, mut input: Input<'_>) -> Sentence {
    let mut sentence = Sentence::default();
    let mut antecedent: Option<Antecedent<'_>> = None;
    // Start of the current part that is not understood.
    let mut failed_from: Option<usize> = None;
    // Whether the antecedent of "it" and "the rest" was not understood.
    let mut antecedent_lost = false;
    let all = remaining(&input);
    let source = input.state.source;
    loop {
        let is_start = all.len() == remaining(&input).len();
        let sentence_ended = skip_conjunctions(&mut input, is_start);
        if sentence_ended {
            failed_from = None;
        }
        let at = all.len() - remaining(&input).len();
        if remaining(&input).is_empty() {
            break;
        }
        let blocked = is_blocked(&input);
        let reading = if blocked || sentence.clauses.len() >= MAX_CLAUSES {
            None
        } else {
            clause(openings, &mut input, antecedent.as_ref())
        };
        match reading {
            Some((opening, reading)) if !(antecedent_lost && refers_back(&reading)) => {
                antecedent_lost &= !names_target(&reading);
                failed_from = None;
                let end = all.len() - remaining(&input).len();
                let words = slice(source, all.get(at..end).unwrap_or_default());
                sentence.unknown += reading.unknown;
                antecedent = reading.clauses.last().map(|clause| Antecedent {
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
                let from = failed_from.unwrap_or(at);
                let end = all.len() - remaining(&input).len();
                let words = slice(source, all.get(from..end).unwrap_or_default());
                if failed_from.is_some() {
                    sentence.not_understood.pop();
                }
                if !words.is_empty() {
                    sentence.not_understood.push(words);
                }
                failed_from = Some(from);
                antecedent = None;
                antecedent_lost = true;
            }
        }
    }
    sentence
}

/// Whether a reading refers to an antecedent.
fn refers_back(reading: &Reading) -> bool {
    reading
        .clauses
        .iter()
        .filter_map(|c| c.target.as_ref())
        .any(|t| t.focus || (t.complement && t.names.is_empty() && !t.selection))
}

fn names_target(reading: &Reading) -> bool {
    reading.clauses.iter().filter_map(|c| c.target.as_ref()).any(|t| !t.names.is_empty() || t.selection || t.everything)
}

/// Skips conjunctions, marks and politeness between clauses, and at the start of the utterance. Returns whether a sentence ended.
fn skip_conjunctions(input: &mut Input<'_>, is_start: bool) -> bool {
    // "also" may belong to the next clause ("also select the sac").
    const SKIPPED: &str = "and | then | but | plus | after that | afterwards | followed by";
    let mut ended = false;
    loop {
        let conjunction: Outcome<usize> = one_of(SKIPPED).parse_next(input);
        if conjunction.is_ok() {
            continue;
        }
        let mut alone = *input;
        let polite: Outcome<()> = repeat(1.., alt((one_of(PRELUDES), one_of(CLOSERS)))).parse_next(&mut alone);
        // "Next" is about a tour where it is all that is said.
        let is_step = is_start && remaining(input).iter().any(|token| token.text == "next");
        if polite.is_ok() && !(is_step && over(&mut alone.clone()).is_ok()) && peek_at(&alone, 0).is_none_or(is_break) {
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

/// Whether the next clause is negated or conditional. Such a clause is never executed.
fn is_blocked(input: &Input<'_>) -> bool {
    let mut at = *input;
    loop {
        // "don't show the sac" is a way to say "hide the sac", and a tour can stop.
        const COMMANDS: &str =
            "don't show | do not show | stop the tour | stop this tour | stop touring | stop the walkthrough";
        let alone = (one_of("stop"), over).map(|(place, ())| place);
        let hides: Outcome<usize> = alt((one_of(COMMANDS), alone)).parse_next(&mut at.clone());
        let negation: Outcome<usize> = one_of(NEGATIONS).parse_next(&mut at.clone());
        if hides.is_ok() || negation.is_ok() {
            return hides.is_err();
        }
        let prelude: Outcome<usize> = one_of(PRELUDES).parse_next(&mut at);
        if prelude.is_err() {
            return false;
        }
    }
}

/// Skips a clause that is not understood: at least one token, up to the next mark or conjunction. A negated or
/// conditional clause extends to the end of its sentence.
fn skip_clause(input: &mut Input<'_>, blocked: bool) {
    advance(input, 1);
    while let Some(token) = peek_at(input, 0) {
        let conjunction: Outcome<usize> = one_of(CONJUNCTIONS).parse_next(&mut { *input });
        let stops = if blocked {
            ['.', '!', '?', ';'].iter().any(|m| token.is_mark(*m))
        } else {
            is_break(token) || conjunction.is_ok()
        };
        if stops {
            return;
        }
        advance(input, 1);
    }
}

/// Parses one clause: with its own verb, after politeness, or with ellipsis.
fn clause<'b>(
    openings: &'b OpeningIndex,
    input: &mut Input<'_>,
    antecedent: Option<&Antecedent<'b>>,
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
    let antecedent = antecedent?;
    let mut at = start;
    let lead: Outcome<usize> = one_of("the same for | likewise | also | then").parse_next(&mut at);
    let (reading, rest) = elliptical_clause(antecedent, &at, lead == Ok(0))?;
    *input = rest;
    Some((antecedent.opening, reading))
}

/// Rank of a reading, smallest first: unknown names, words left, position in the table.
type Rank = (usize, usize, usize);

/// A reading, its opening and the rest of the input.
type Found<'b, 't> = (&'b Opening, Reading, Input<'t>);

/// The best reading of a clause with its own verb.
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
        // A clause without a verb needs known names.
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

/// Whether a clause ends here, with no exception after it.
fn ends_here(input: &Input<'_>) -> bool {
    let excepted: Outcome<usize> = one_of(EXCEPTING).parse_next(&mut input.clone());
    end(&mut input.clone()).is_ok() && excepted.is_err()
}

/// A clause without verb, object or both: "and the pot brown", "and transparent", "and the vessel to 0.5",
/// "and the trunk too".
///
/// `same`: it asks for the same, so that its value is that of the antecedent.
fn elliptical_clause<'t>(antecedent: &Antecedent<'_>, input: &Input<'t>, same: bool) -> Option<(Reading, Input<'t>)> {
    let opening = antecedent.opening;
    let read = || {
        let mut at = *input;
        let reading = (opening.construct.parse)(opening.verb, &mut at).ok()?;
        Some((reading, at))
    };
    let with_known_names = || read().filter(|(reading, _)| reading.unknown == 0);
    let continued = || {
        let mut at = *input;
        let reading = assignment::continued(antecedent.clause.target.as_ref()?, &mut at).ok()?;
        Some((reading, at))
    };
    let same_property = || {
        let mut at = *input;
        let reading = assignment::same_property(antecedent.property?, &mut at).ok()?;
        Some((reading, at))
    };
    let likewise = || {
        let mut at = *input;
        let target = target_alone(&mut at).ok().filter(|t| t.unknown == 0)?;
        antecedent.clause.target.as_ref()?;
        let clause = Clause { target: Some(target.reference), ..antecedent.clause.clone() };
        Some((Reading { clauses: vec![clause], unknown: 0, property: antecedent.property }, at))
    };
    match opening.construct.ellipsis {
        Ellipsis::None => None,
        Ellipsis::Verb if same => with_known_names(),
        _ if same => likewise(),
        Ellipsis::Verb => with_known_names(),
        Ellipsis::VerbOrValue => with_known_names().or_else(likewise),
        Ellipsis::VerbTargetOrValue => read().or_else(continued).or_else(likewise),
        Ellipsis::PropertyOrValue => same_property().or_else(likewise),
    }
}
