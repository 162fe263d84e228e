//! What lies outside the grammar: utterances without a known word, and things that the program cannot do.

use std::collections::BTreeSet;
use std::sync::LazyLock;

use super::Reader;
use crate::color;
use crate::commands::command::{Command, Construct};
use crate::commands::table::TABLE;
use crate::syntax::target::is_sentence_word;
use crate::syntax::token::{self, Kind, Token};
use crate::text::join;

/// Most commands that a refusal names.
const MOST_NAMED: usize = 12;

/// Words of commands that everyday talk has as well.
const COMMON: [&str; 44] = [
    "i", "you", "us", "let", "let's", "me", "tell", "say", "know", "do", "does", "go", "get", "give", "have", "take",
    "use", "try", "want", "like", "need", "see", "look", "be", "there", "here", "going", "come", "back", "up", "down",
    "out", "over", "one", "two", "time", "great", "good", "way", "long", "first", "last", "we", "off",
];

/// What the program cannot do, and words that ask for it.
const TOPICS: [(&str, &[&str]); 12] = [
    (
        "give medical advice",
        &[
            "rupture",
            "treatment",
            "treat",
            "therapy",
            "diagnose",
            "diagnosis",
            "prognosis",
            "malignant",
            "benign",
            "coil or",
            "or coil",
            "coiling",
            "clipping or",
            "surgery",
            "operate on",
            "medication",
            "is it dangerous",
            "is this dangerous",
            "life expectancy",
            "risk of",
            "healthy",
        ],
    ),
    (
        "book or buy anything",
        &["book me", "book us", "book a", "book an", "book the", "reserve", "order me", "order a", "buy"],
    ),
    (
        "send messages",
        &[
            "send this",
            "send a",
            "send an",
            "send the",
            "send it to",
            "send me",
            "mail",
            "email",
            "e mail",
            "text message",
            "phone",
        ],
    ),
    ("tell the weather or the news", &["weather", "forecast", "the news"]),
    ("play music or videos", &["music", "song", "movie", "video", "play some"]),
    ("set timers or reminders", &["timer", "alarm", "remind me to", "reminder", "calendar"]),
    (
        "translate",
        &[
            "translate",
            "translation",
            "in french",
            "into french",
            "in german",
            "into german",
            "in spanish",
            "in italian",
        ],
    ),
    (
        "search the web",
        &[
            "google",
            "wikipedia",
            "search the web",
            "search the internet",
            "on the internet",
            "newest papers",
            "latest papers",
        ],
    ),
    (
        "segment by myself. Brush a structure, and it grows to the whole",
        &[
            "segment the",
            "segment all",
            "segment this",
            "segment it",
            "segment everything",
            "automatically segment",
            "segmentation",
        ],
    ),
    (
        "filter or resample the data",
        &["denoise", "median filter", "gaussian filter", "filter over", "resample", "remove the noise", "register the"],
    ),
    (
        "compute flow or stress",
        &["shear stress", "wall shear", "simulate", "simulation", "blood flow", "blood pressure", "flow rate"],
    ),
    ("tell stories", &["joke", "poem", "tell me a story", "sing"]),
];

/// Lemmas of the words that commands have: the first of their phrases, and those of their examples.
static KNOWN: LazyLock<BTreeSet<String>> = LazyLock::new(|| {
    let phrases = TABLE.iter().flat_map(|row| row.constructs.iter().flat_map(Construct::phrases));
    let first = phrases.filter_map(|phrase| token::tokens(phrase).into_iter().next());
    let examples = TABLE.iter().flat_map(|row| row.examples).flat_map(|example| token::tokens(example));
    first.chain(examples).filter(is_content).map(|t| t.lemma).collect()
});

/// "I can colour, show, hide … and more": the commands whose titles are verbs of theirs.
static ABILITIES: LazyLock<String> = LazyLock::new(|| {
    let titles = TABLE.iter().filter(|row| has_verb_title(row)).map(|row| row.title.to_owned());
    let named: Vec<String> = titles.take(MOST_NAMED).chain(["more".to_owned()]).collect();
    format!("I can {}; say “help” for examples.", join(&named))
});

/// Whether the title of a command is one of its verbs.
pub(super) fn has_verb_title(row: &Command) -> bool {
    !row.title.contains(' ') && row.constructs.iter().flat_map(Construct::phrases).any(|phrase| phrase == row.title)
}

/// Whether a word has a meaning of its own.
pub(super) fn is_content(token: &Token) -> bool {
    token.kind == Kind::Word && !is_sentence_word(&token.text) && !COMMON.contains(&token.text.as_str())
}

/// Whether a word belongs to a name of the scene.
fn is_named(reader: &Reader<'_>, token: &Token) -> bool {
    reader.normalized.iter().chain(&reader.normalized_views).any(|(_, lemmas)| lemmas.contains(&token.lemma))
}

/// Whether some words have one that a command or a name has.
pub(super) fn is_known(reader: &Reader<'_>, words: &[Token]) -> bool {
    words.iter().any(|t| match t.kind {
        Kind::Word => is_content(t) && (KNOWN.contains(&t.lemma) || color::is_word(&t.text) || is_named(reader, t)),
        Kind::Number(_) | Kind::Quoted | Kind::Color(_) | Kind::File => true,
        Kind::Mark(mark) => mark == '%',
    })
}

/// The answer to a sentence without a known word.
pub(super) fn nothing_known() -> String {
    format!("I can't do that here. {}", *ABILITIES)
}

/// Whether some words hold a phrase of which not every word belongs to a name of the scene.
fn holds(reader: &Reader<'_>, words: &[Token], phrase: &str) -> bool {
    let phrase: Vec<&str> = phrase.split(' ').collect();
    words.windows(phrase.len()).any(|said| {
        let fits = said.iter().zip(&phrase).all(|(token, word)| token.is(word));
        fits && !said.iter().all(|token| is_named(reader, token))
    })
}

/// The refusal of what the program cannot do, if the words ask for it.
pub(super) fn refusal(reader: &Reader<'_>, words: &[Token]) -> Option<String> {
    let asks = |phrases: &[&str]| phrases.iter().any(|phrase| holds(reader, words, phrase));
    let (what, _) = TOPICS.iter().find(|(_, phrases)| asks(phrases))?;
    Some(format!("I can't {what}. {}", *ABILITIES))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn abilities_are_verbs_of_the_table() {
        let text = nothing_known();
        for verb in ["colour", "show", "hide", "select"] {
            assert!(text.contains(verb), "{text}");
        }
        assert!(text.starts_with("I can't do that here. I can colour,") && !text.contains('\n'), "{text}");
    }
}
