//! What people say beside commands: thanks and greetings, "what if", "how do I", "why did you do that?". Nothing changes.

use sg_proto::language::{Act, Clause, Intent, IntentRequest, Observation};

use super::forms::repaired;
use super::sentence::Sentence;
use super::word_pattern::{after, after_any, core, matched, matches_any, words};
use super::{Reader, interpret, question, scope, sentence_model, suggest};
use crate::commands::table::TABLE;
use crate::report;
use crate::syntax::token::{self, Token};
use crate::text::{join, join_with};

/// Most tokens of such an utterance.
const MOST_TOKENS: usize = 40;

/// Most commands that an answer about the last utterance names.
const MOST_TITLES: usize = 4;

/// Words that make small talk, and the answer. The first row of which a phrase is said gives the answer.
const SMALL_TALK: [(&[&str], &str); 5] = [
    (
        &[
            "thanks a lot",
            "thanks so much",
            "thanks very much",
            "thank you so much",
            "thank you very much",
            "thank you",
            "thanks",
            "many thanks",
            "thx",
            "cheers",
            "much appreciated",
        ],
        "You're welcome.",
    ),
    (
        &[
            "goodbye",
            "good bye",
            "bye bye",
            "bye",
            "see you later",
            "see you tomorrow",
            "see you soon",
            "see you",
            "good night",
            "that is all",
            "that 's all",
            "i am done",
            "i'm done",
            "we are done",
            "we're done",
        ],
        "Goodbye.",
    ),
    (
        &["who are you", "what are you", "what is your name", "what 's your name", "are you a robot", "are you human"],
        "I change the picture by what you say. Say “help” for examples.",
    ),
    (
        &[
            "hello there",
            "hello",
            "hi there",
            "hi",
            "hey there",
            "hey",
            "good morning",
            "good afternoon",
            "good evening",
            "good day",
            "how are you doing",
            "how are you",
            "nice to meet you",
        ],
        "Hello. Say “help” for examples.",
    ),
    (
        &[
            "good job",
            "great job",
            "nice job",
            "good work",
            "great work",
            "nice work",
            "well done",
            "perfect",
            "great",
            "excellent",
            "awesome",
            "amazing",
            "wonderful",
            "fantastic",
            "beautiful",
            "brilliant",
            "lovely",
            "nice",
            "cool",
            "super",
            "good",
            "that is/'s great/good/perfect/nice/better",
            "it is great/good/perfect/nice/better",
            "that/it looks good/great/nice/perfect/better",
            "looks good/great/nice/perfect/better",
            "i like/love it/that/this",
            "much better",
        ],
        "Glad you like it.",
    ),
];

/// Words beside small talk.
const FILLERS: [&str; 22] = [
    "ok",
    "okay",
    "oh",
    "ah",
    "wow",
    "yes",
    "well",
    "so",
    "very",
    "really",
    "and",
    "then",
    "now",
    "for now",
    "for today",
    "for your help",
    "for the help",
    "for that",
    "assistant",
    "computer",
    "everybody",
    "again",
];

/// Words that acknowledge, and the answer.
const ACKNOWLEDGED: [(&[&str], &str); 2] = [
    (
        &[
            "never mind",
            "nevermind",
            "forget it",
            "forget about it",
            "nothing",
            "no",
            "nope",
            "no thanks",
            "no thank you",
            "not now",
        ],
        "OK, nothing was changed.",
    ),
    (
        &[
            "ok",
            "okay",
            "alright",
            "all right",
            "fine",
            "i see",
            "i understand",
            "understood",
            "got it",
            "yes",
            "yeah",
            "yep",
            "sure",
            "right",
            "exactly",
        ],
        "OK.",
    ),
];

/// Politeness before and behind what is said.
const LEADS: [&str; 14] = [
    "please",
    "so",
    "and",
    "but",
    "ok",
    "okay",
    "hey",
    "hi",
    "hello",
    "well",
    "tell me",
    "can you tell me",
    "could you tell me",
    "now",
];
const TAILS: [&str; 5] = ["please", "then", "now", "exactly", "again"];

/// Questions about the last utterance.
const ABOUT_LAST: [&str; 15] = [
    "why",
    "why that/this",
    "why did you do that/this/it/so",
    "why did that/this happen",
    "why did you X",
    "why have you X",
    "what did you do",
    "what did you just do",
    "what did you do just",
    "what have you done",
    "what have you just done",
    "what did you change",
    "what have you changed",
    "what happened/changed",
    "what just happened/changed",
];

/// Beginnings of what somebody only imagines.
const HYPOTHETICAL: [&str; 18] = [
    "what would happen if/when",
    "what happens if/when",
    "what will happen if/when",
    "what if",
    "what would it/that/this look like if",
    "what would it/that/this be like if",
    "how would it/that/this look if",
    "would it/that help if/to",
    "would it/that be better if/to",
    "would i/we see",
    "would i/we still see",
    "suppose",
    "supposing",
    "imagine",
    "assume",
    "assuming",
    "hypothetically",
    "let 's/us say/suppose/imagine/assume",
];

/// Words that make a sentence with "if" a question about what is not so.
const IRREAL: [&str; 2] = ["would", "were"];

/// Beginnings with "if" that are polite.
const POLITE_IF: [&str; 6] =
    ["if you", "if possible", "if i may", "if it/that 's", "if it/that is/isn't/was/would", "if there"];

/// Beginnings of what shall not be done.
const NEGATED: [&str; 12] = [
    "don't",
    "dont",
    "do not",
    "never",
    "you must not",
    "you mustn't",
    "you should not",
    "you shouldn't",
    "you don't need to",
    "you do not need to",
    "no need to",
    "there is no need to",
];

/// Words behind "don't" with another meaning: "don't show the bone" hides it.
const OTHERWISE: [&str; 9] = ["show", "display", "let", "forget", "hesitate", "worry", "mind", "want", "need"];

/// Words of a negation that goes on with a wish.
const BUT: [&str; 4] = ["but", "instead", "rather", "only"];

/// Sentences that nothing shall be done.
const NOT_ASKED: [&str; 4] = [
    "i/we/nobody never said/asked/told/wanted X",
    "nobody said/asked/told X",
    "i/we did not say/ask/tell/want X",
    "i/we didn't say/ask/tell/want X",
];

/// Sentences that something shall stay as it is.
const LEFT_ALONE: [&str; 6] = [
    "leave/keep X as it/they is/are",
    "leave/keep X as it 's",
    "leave/keep X the way it/they is/are",
    "leave/keep X the way it 's",
    "leave X alone/unchanged/untouched",
    "keep X unchanged/untouched",
];

/// Beginnings of the question how something is done.
const HOW: [&str; 9] = [
    "how do/can/could/would/should/must i/we/you/one",
    "how does/can one",
    "how to",
    "how would i/you go about",
    "what do/should/must/can/could i/we say/do to",
    "what do i/we have/need to say/do to",
    "what is/'s the way to",
    "what is/'s the command/word/phrase to/for",
    "which command/words do/should i/we use/say to",
];

/// Verbs of questions about language.
const ABOUT_WORDS: [&str; 7] = ["say", "spell", "pronounce", "translate", "know", "feel", "think"];

/// Acts that undo does not take back.
const KEEPING: [Act; 12] = [
    Act::List,
    Act::ListViews,
    Act::QuerySelection,
    Act::Describe,
    Act::Help,
    Act::Export,
    Act::SavePicture,
    Act::SaveCopy,
    Act::Open,
    Act::Tour,
    Act::Undo,
    Act::Redo,
];

/// An intent that is an answer alone.
pub(super) fn answering(answer: impl Into<String>) -> Intent {
    Intent { answer: answer.into(), backend: super::NAME.to_owned(), ..Intent::default() }
}

/// The answer to a sentence that nothing shall be done.
pub(super) fn unchanged() -> Intent {
    answering("Nothing was changed.")
}

/// The answer to a question about the state of the scene. It is shorter than the description that a command gives.
pub(super) fn state(text: &str, tokens: &[Token], observation: &Observation) -> Option<Intent> {
    let is_short = tokens.len() <= MOST_TOKENS;
    is_short.then(|| question::answer(text, tokens, observation)).flatten().map(answering)
}

/// The intent of an utterance that is no command, as far as that is sure before anything in it is repaired.
pub(super) fn of(
    reader: &Reader<'_>,
    request: &IntentRequest,
    text: &str,
    tokens: &[Token],
    literal: &Sentence,
) -> Option<Intent> {
    let all = words(tokens);
    let said = core(&all, &LEADS, &TAILS);
    if let Some(answer) = small_talk(&all) {
        return Some(answering(answer));
    }
    if let Some(answer) = about_last(request, said) {
        return Some(answering(answer));
    }
    if is_imagined(said, tokens) {
        return Some(answering("Nothing was changed. Do it to see how it looks; “undo” takes it back."));
    }
    // Clauses beside a negation are those of other sentences.
    if literal.clauses.is_empty() && is_unwanted(said) {
        return Some(unchanged());
    }
    if let Some(answer) = how_to(reader, text, said) {
        return Some(answering(answer));
    }
    if let Some(sentence) = question::reworded(reader, text, tokens) {
        return Some(repaired(sentence, text, String::new()));
    }
    // What is known to be impossible is not taken for a misspelt command.
    let is_unread = literal.clauses.is_empty() && !literal.not_understood.is_empty();
    let refusal = is_unread.then(|| scope::refusal(reader, &all)).flatten()?;
    // "Red is too alarming for the patient, make it teal" asks for no medical advice.
    if sentence_model::command(reader, text).is_some() {
        return None;
    }
    Some(Intent { not_understood: literal.not_understood.clone(), ..answering(refusal) })
}

/// The intent with an answer where nothing of the utterance was understood.
pub(super) fn finished(reader: &Reader<'_>, tokens: &[Token], intent: Intent) -> Intent {
    if !intent.clauses.is_empty() {
        return intent;
    }
    let all = words(tokens);
    let acknowledged = ACKNOWLEDGED.iter().find(|(phrases, _)| matches_any(&all, phrases));
    if let Some((_, answer)) = acknowledged {
        return answering(*answer);
    }
    if !intent.not_understood.is_empty() && !scope::is_known(reader, &all) {
        return Intent { answer: scope::nothing_known(), suggestions: Vec::new(), ..intent };
    }
    intent
}

/// The answer to an utterance of small talk alone.
fn small_talk(words: &[Token]) -> Option<&'static str> {
    let mut rest = words;
    let mut first: Option<usize> = None;
    while !rest.is_empty() {
        let talk =
            SMALL_TALK.iter().enumerate().filter_map(|(row, (phrases, _))| Some((row, after_any(rest, phrases)?)));
        if let Some((row, behind)) = talk.min_by_key(|(_, behind)| behind.len()) {
            first = Some(first.map_or(row, |before| before.min(row)));
            rest = behind;
        } else {
            rest = after_any(rest, &FILLERS)?;
        }
    }
    SMALL_TALK.get(first?).map(|(_, answer)| *answer)
}

fn has(words: &[Token], any: &[&str]) -> bool {
    words.iter().any(|t| any.contains(&t.text.as_str()))
}

/// Whether something is only imagined.
fn is_imagined(said: &[Token], tokens: &[Token]) -> bool {
    let asks = tokens.iter().any(|t| t.is_mark('?'));
    // "If the bone were hidden, would I see the sac?"
    let is_irreal = after(said, "if").is_some() && has(said, &IRREAL) && after_any(said, &POLITE_IF).is_none();
    // "What would the sac look like if it were red?"
    let is_wondered = after(said, "what/how would").is_some() && has(said, &["if"]) && asks;
    is_irreal || is_wondered || after_any(said, &HYPOTHETICAL).is_some()
}

/// Whether a sentence says that something shall not be done.
fn is_unwanted(said: &[Token]) -> bool {
    let negated = after_any(said, &NEGATED).is_some_and(|rest| {
        let means_otherwise = rest.first().is_none_or(|t| OTHERWISE.contains(&t.text.as_str()));
        !means_otherwise && !has(said, &BUT)
    });
    // "Keep the bone white and the skin as it is" asks for something as well.
    let is_one = |object: &[Token]| !has(object, &BUT) && !has(object, &["and"]);
    let left_alone = LEFT_ALONE.iter().any(|pattern| matched(said, pattern).is_some_and(is_one));
    negated || left_alone || matches_any(said, &NOT_ASKED)
}

/// Sentences that do what somebody asks how to do.
fn how_to(reader: &Reader<'_>, source: &str, said: &[Token]) -> Option<String> {
    let wish = after_any(said, &HOW).filter(|wish| !wish.is_empty())?;
    let is_about_words = wish.first().is_some_and(|t| ABOUT_WORDS.contains(&t.text.as_str()));
    if is_about_words || !scope::is_known(reader, wish) {
        return None;
    }
    let ways = suggest::ways(reader, source, wish);
    let quoted: Vec<String> = ways.iter().map(|way| format!("“{way}”")).collect();
    (!quoted.is_empty()).then(|| format!("Say {}.", join_with(&quoted, "or")))
}

/// What the last utterance was, how it was read and what it changed.
fn about_last(request: &IntentRequest, said: &[Token]) -> Option<String> {
    if !matches_any(said, &ABOUT_LAST) {
        return None;
    }
    let is_question = |utterance: &str| {
        let all = words(&token::tokens(utterance));
        matches_any(core(&all, &LEADS, &TAILS), &ABOUT_LAST)
    };
    let mut turns = request.conversation.iter().enumerate().rev();
    let Some((place, last)) = turns.find(|(_, turn)| !is_question(&turn.utterance)) else {
        return Some("Nothing was said before, so nothing was done.".to_owned());
    };
    let earlier = IntentRequest {
        text: last.utterance.clone(),
        observation: request.observation.clone(),
        conversation: request.conversation.get(..place).unwrap_or_default().to_vec(),
    };
    let intent = interpret(&earlier).unwrap_or_default();
    let title =
        |clause: &Clause| TABLE.iter().find(|row| row.act == clause.act()).map(|row| format!("“{}”", row.title));
    let mut titles: Vec<String> = intent.clauses.iter().filter_map(title).collect();
    titles.dedup();
    titles.truncate(MOST_TITLES);
    let reply = report::sentence(last.reply.lines().next().unwrap_or_default());
    let utterance = last.utterance.trim();
    if titles.is_empty() {
        return Some(format!("You said “{utterance}”, and nothing was changed. The answer was: {reply}"));
    }
    let scene = request.observation.as_ref().and_then(|observation| observation.scene.as_ref());
    let is_undoable = scene.is_some_and(|scene| !scene.undo.is_empty())
        && intent.clauses.iter().any(|clause| !KEEPING.contains(&clause.act()));
    let hint = if is_undoable { " Say “undo” to take it back." } else { "" };
    Some(format!("You said “{utterance}”, which was read as {}: {reply}{hint}", join(&titles)))
}
