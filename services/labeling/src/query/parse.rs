//! From a text to groups of nouns and looks, with what is excluded.

use crate::attributes::quality::{self, Constraint, Look, Quality};
use crate::text::{Phrase, words};
use crate::wordnet::WordNet;

/// How many units a text means.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Number {
    /// One.
    One,
    /// All that match.
    Several,
}

/// A part of a query: a noun, looks, or both.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Group {
    /// The words that name the thing, without looks and generic nouns.
    pub(super) nouns: Phrase,
    /// All words, looks included, as a label could have them: "grey matter".
    pub(super) whole: Phrase,
    /// All words as they were said, for a sentence encoder: "brain tissue".
    pub(super) text: String,
    /// For each word of the whole, whether it states a look.
    pub(super) is_look: Vec<bool>,
    /// What the thing must look like.
    pub(super) constraints: Vec<Constraint>,
    /// Whether there is a noun, if only "thing".
    pub(super) has_noun: bool,
    /// Whether all things are meant: "everything".
    pub(super) universal: bool,
}

/// A query.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Query {
    /// What is meant; any of them.
    pub(super) groups: Vec<Group>,
    /// What is excluded from it.
    pub(super) excluded: Vec<Group>,
    pub(super) number: Number,
}

/// Words before a query that ask for it.
const LEADS: [&str; 46] = [
    "show",
    "me",
    "please",
    "select",
    "find",
    "where",
    "wheres",
    "is",
    "are",
    "pick",
    "which",
    "what",
    "label",
    "highlight",
    "mark",
    "brush",
    "look",
    "for",
    "give",
    "want",
    "i",
    "to",
    "see",
    "can",
    "could",
    "you",
    "need",
    "take",
    "get",
    "there",
    "hide",
    "zoom",
    "go",
    "us",
    "let",
    "grab",
    "choose",
    "isolate",
    "and",
    "now",
    "then",
    "just",
    "only",
    "also",
    "with",
    "search",
];
/// Nouns without a meaning of their own.
const GENERIC: [&str; 31] = [
    "thing",
    "one",
    "part",
    "object",
    "item",
    "piece",
    "structure",
    "region",
    "stuff",
    "unit",
    "cluster",
    "area",
    "element",
    "component",
    "group",
    "gaussian",
    "segment",
    "material",
    "side",
    "label",
    "shape",
    "section",
    "layer",
    "covering",
    "cover",
    "coating",
    "blob",
    "lump",
    "bit",
    "tangle",
    "network",
];
/// Nouns and pronouns for all things.
const UNIVERSAL: [&str; 6] = ["everything", "all", "anything", "rest", "others", "scene"];
/// Words that ask for several things.
const SEVERAL: [&str; 16] = [
    "both",
    "all",
    "every",
    "each",
    "two",
    "three",
    "four",
    "five",
    "six",
    "several",
    "some",
    "many",
    "these",
    "those",
    "everything",
    "most",
];
/// Words before a noun phrase that say nothing of its meaning.
const ARTICLES: [&str; 5] = ["the", "a", "an", "my", "our"];
/// Words that say nothing here.
const FILLERS: [&str; 26] = [
    "the", "a", "an", "that", "which", "who", "is", "are", "thats", "its", "this", "of", "at", "on", "in", "to", "by",
    "very", "really", "please", "there", "it", "any", "colored", "coloured", "looking",
];
/// Words that turn what follows into an exclusion.
const NEGATIONS: [&str; 17] = [
    "not",
    "isnt",
    "arent",
    "dont",
    "doesnt",
    "without",
    "except",
    "excepting",
    "excluding",
    "neither",
    "no",
    "besides",
    "minus",
    "nor",
    "non",
    "wasnt",
    "never",
];

/// Words for what a thing of the same kind is: "things like", "similar to", "that looks like".
const ALIKE: [&[&str]; 18] = [
    &["that", "looks", "like"],
    &["that", "look", "like"],
    &["which", "looks", "like"],
    &["which", "look", "like"],
    &["that", "is", "like"],
    &["that", "are", "like"],
    &["looks", "like"],
    &["looking", "like"],
    &["look", "like"],
    &["just", "like"],
    &["like"],
    &["similar", "to"],
    &["resembling"],
    &["that", "resembles"],
    &["that", "resemble"],
    &["resembles"],
    &["resemble"],
    &["alike", "to"],
];
/// Pronouns for what is selected.
const PRONOUNS: [&str; 7] = ["this", "that", "it", "these", "those", "them", "selection"];
/// Nouns behind a pronoun: "this one".
const BEHIND_PRONOUNS: [&str; 3] = ["one", "ones", "selection"];

/// What things should be like.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Model {
    /// The selection: "things like this".
    Selection,
    /// What a text means: "things like the sac".
    Named(String),
    /// Any thing of that kind: "something like a tube" means tubes.
    Kind(String),
}

/// A query for things that are like another one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Alike {
    pub(super) model: Model,
    pub(super) number: Number,
}

/// Reads a query for things that are like another one: only nouns without a meaning of their own stand before "like". `None` for
/// any other query.
pub(super) fn alike(text: &str) -> Option<Alike> {
    let all = words(text);
    let is_no_name = |word: &String| {
        let word = word.as_str();
        LEADS.contains(&word)
            || FILLERS.contains(&word)
            || SEVERAL.contains(&word)
            || UNIVERSAL.contains(&word)
            || matches!(word, "something" | "other" | "more" | "another")
            || singular_generic(word).is_some()
    };
    let start = all.iter().position(|word| !is_no_name(word)).filter(|_| !all.is_empty());
    // "Looks" may be read as words without a name too, so the longest reading of the connection is searched from the front.
    let (at, length) = (0..=start.unwrap_or(all.len())).find_map(|at| {
        let rest = all.get(at..)?;
        let found =
            ALIKE.iter().find(|words| rest.len() > words.len() && rest.iter().zip(**words).all(|(a, b)| a == b))?;
        Some((at, found.len()))
    })?;
    let (before, model) = (all.get(..at)?, all.get(at + length..)?);
    let model: Vec<&str> = model.iter().map(String::as_str).filter(|word| !matches!(*word, "please" | ",")).collect();
    let several = before.iter().any(|word| {
        let word = word.as_str();
        SEVERAL.contains(&word)
            || UNIVERSAL.contains(&word)
            || matches!(word, "other" | "more" | "what")
            || singular_generic(word).is_some_and(|singular| singular != word)
    });
    let number = if several || before.is_empty() { Number::Several } else { Number::One };
    let behind_article: &[&str] = model.strip_prefix(&["the"]).unwrap_or(&model);
    let model = match behind_article {
        [] => return None,
        [pronoun, rest @ ..]
            if PRONOUNS.contains(pronoun)
                && rest.iter().all(|w| BEHIND_PRONOUNS.contains(w) || singular_generic(w).is_some()) =>
        {
            Model::Selection
        }
        ["what", "is" | "i", "selected"] => Model::Selection,
        ["a" | "an", rest @ ..] if !rest.is_empty() => Model::Kind(rest.join(" ")),
        _ => Model::Named(model.join(" ")),
    };
    Some(Alike { model, number })
}

/// Reads a query.
pub(super) fn parse(text: &str, net: &WordNet) -> Query {
    let all = words(text);
    let start = all.iter().position(|w| !LEADS.contains(&w.as_str())).unwrap_or(all.len());
    let end = all.iter().rposition(|w| w != "please").map_or(0, |at| at + 1);
    let asked = all.get(start..end).unwrap_or_default();
    let (wanted, unwanted) = split(asked);
    let mut groups = groups(&wanted, net);
    let excluded = self::groups(&unwanted, net);
    let is_bare = groups.is_empty();
    if is_bare && !excluded.is_empty() {
        groups.push(Group { universal: true, ..Group::default() });
    }
    let plural = |w: &String| SEVERAL.contains(&w.as_str()) || is_plural(w, net);
    let heads = groups.iter().filter_map(|g| g.whole.words.get(g.whole.head));
    let several = groups.len() > 1
        || groups.iter().any(|g| g.universal)
        || wanted.iter().any(|w| SEVERAL.contains(&w.as_str()))
        || wanted.iter().any(|w| singular_generic(w).is_some_and(|s| s != w))
        || heads.into_iter().any(plural);
    Query { groups, excluded, number: if several { Number::Several } else { Number::One } }
}

/// The words that state what is meant, and those that state what is excluded.
fn split(asked: &[String]) -> (Vec<String>, Vec<String>) {
    let is = |at: usize, word: &str| asked.get(at).is_some_and(|w| w == word);
    let mut at = 0;
    while at < asked.len() {
        // "everything but the liver": "but" excludes behind a word for all things.
        let before = asked.get(..at).unwrap_or_default();
        let of_all = before.iter().any(|w| UNIVERSAL.contains(&w.as_str()) || SEVERAL.contains(&w.as_str()));
        let two_words = (is(at, "other") && is(at + 1, "than")) || (is(at, "apart") && is(at + 1, "from"));
        let negates = asked.get(at).is_some_and(|w| NEGATIONS.contains(&w.as_str()));
        if negates || two_words || (is(at, "but") && of_all) {
            let wanted = before.iter().filter(|w| *w != "but" && *w != "and").cloned().collect();
            let from = at + if two_words { 2 } else { 1 };
            let rest = asked.get(from..).unwrap_or_default();
            let unwanted = rest.iter().filter(|w| !NEGATIONS.contains(&w.as_str()) || *w == "nor");
            return (wanted, unwanted.map(|w| if w == "nor" { "or".to_owned() } else { w.clone() }).collect());
        }
        at += 1;
    }
    (asked.to_vec(), Vec::new())
}

/// The groups that "and", "or" and commas part. A part without a noun belongs to the next one: "small and red thing".
fn groups(words: &[String], net: &WordNet) -> Vec<Group> {
    let mut groups = Vec::new();
    let mut pending: Vec<String> = Vec::new();
    let parts: Vec<&[String]> = words.split(|w| matches!(w.as_str(), "and" | "or" | ",")).collect();
    let has_nouns = parts.iter().any(|part| group(part, net).has_noun);
    for part in parts {
        pending.extend_from_slice(part);
        let read = group(&pending, net);
        if read.has_noun || (!has_nouns && !read.constraints.is_empty()) {
            groups.push(read);
            pending.clear();
        }
    }
    let last = group(&pending, net);
    if !last.constraints.is_empty() {
        // Looks behind a noun describe it: "the thing, red".
        match groups.last_mut() {
            Some(group) => group.constraints.extend(last.constraints),
            None => groups.push(last),
        }
    }
    groups
}

/// One group of words.
fn group(words: &[String], net: &WordNet) -> Group {
    let mut group = Group::default();
    let mut nouns: Vec<String> = Vec::new();
    let mut whole: Vec<String> = Vec::new();
    let mut at = 0;
    while let Some(word) = words.get(at) {
        let rest: Vec<&str> = words.get(at..).unwrap_or_default().iter().map(String::as_str).collect();
        if UNIVERSAL.contains(&word.as_str()) && (word != "all" || !names_more(&rest)) {
            group.universal = true;
            group.has_noun = true;
            at += 1;
        } else if let Some((constraint, length)) =
            quality::constraint(&rest).filter(|(c, length)| !is_noun(c, &rest, *length, net))
        {
            for _ in 0..length {
                group.is_look.push(true);
            }
            whole.extend(rest.iter().take(length).map(|w| (*w).to_owned()));
            group.constraints.push(constraint);
            at += length;
        } else {
            if singular_generic(word).is_some() {
                group.has_noun = true;
            } else if !FILLERS.contains(&word.as_str()) && !SEVERAL.contains(&word.as_str()) {
                nouns.push(word.clone());
                whole.push(word.clone());
                group.is_look.push(false);
            } else if word == "of" {
                // The head of "root of the tooth" stands before it.
                nouns.push(word.clone());
                whole.push(word.clone());
            }
            at += 1;
        }
    }
    let said = words.iter().position(|w| !ARTICLES.contains(&w.as_str())).unwrap_or(words.len());
    group.text = words.get(said..).unwrap_or_default().join(" ");
    group.nouns = Phrase::of_words(&nouns);
    group.whole = Phrase::of_words(&whole);
    group.has_noun |= !group.nouns.is_empty();
    group.universal &= group.nouns.is_empty() && group.constraints.is_empty();
    group
}

/// Whether words behind "all" name or describe something.
fn names_more(rest: &[&str]) -> bool {
    rest.iter().skip(1).any(|w| !FILLERS.contains(w) && singular_generic(w).is_none())
}

/// Whether the word of a look is the name of a thing here: special names of colours are those of things ("bone", "salmon").
fn is_noun(constraint: &Constraint, rest: &[&str], length: usize, net: &WordNet) -> bool {
    let is_last = rest.iter().skip(length).all(|w| FILLERS.contains(w) || *w == "of");
    let is_special = matches!(constraint.look, Look::Color(_)) && length == 1;
    is_special && is_last && net.senses(&constraint.words).iter().any(|s| net.is_noun(s.synset))
}

/// The singular of a generic noun.
fn singular_generic(word: &str) -> Option<&str> {
    let singular = word.strip_suffix('s').filter(|w| GENERIC.contains(w)).unwrap_or(word);
    GENERIC.contains(&singular).then_some(singular)
}

/// The singular of a noun, if it has another one.
pub(super) fn singular(word: &str, net: &WordNet) -> Option<String> {
    net.dictionary_forms(word).into_iter().find(|form| form != word)
}

fn is_plural(word: &str, net: &WordNet) -> bool {
    let ends = |ending: &str| word.ends_with(ending);
    !ends("ss") && !ends("us") && !ends("is") && singular(word, net).is_some()
}

impl Group {
    /// The same group with a shape in place of its head noun: "ball" means what is round. `None` where the noun names no shape.
    pub(super) fn by_shape(&self, net: &WordNet) -> Option<Self> {
        let head = self.nouns.words.get(self.nouns.head)?;
        let quality: Option<Quality> =
            quality::shape(head).or_else(|| singular(head, net).and_then(|s| quality::shape(&s)))?;
        let mut other = self.clone();
        other.nouns = Phrase::of_words(
            &self
                .nouns
                .words
                .iter()
                .enumerate()
                .filter(|(at, _)| *at != self.nouns.head)
                .map(|(_, w)| w.clone())
                .collect::<Vec<_>>(),
        );
        other.whole = Phrase::default();
        other.is_look.clear();
        if let Some(quality) = quality {
            let words = head.clone();
            other.constraints.push(Constraint { look: Look::Quality(quality), superlative: false, words });
        }
        (!other.constraints.is_empty()).then_some(other)
    }

    /// The words of the looks.
    pub(super) fn look(&self) -> String {
        self.constraints.iter().map(|c| c.words.as_str()).collect::<Vec<_>>().join(" ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wordnet;

    fn read(text: &str) -> (String, String, Number) {
        let query = parse(text, wordnet::embedded().unwrap());
        let tell = |groups: &[Group]| {
            let one = |g: &Group| {
                let nouns = if g.universal { "*".to_owned() } else { g.nouns.words.join(" ") };
                format!("{nouns}[{}]", g.look())
            };
            groups.iter().map(one).collect::<Vec<_>>().join(" + ")
        };
        (tell(&query.groups), tell(&query.excluded), query.number)
    }

    #[test]
    fn likeness_has_a_model() {
        use Number::{One, Several};
        let read = |text: &str| alike(text).map(|alike| (alike.model, alike.number));
        let named = |text: &str| Model::Named(text.into());
        for (text, expected) in [
            ("things like the sac", (named("the sac"), Several)),
            ("select everything similar to the left kidney, please", (named("the left kidney"), Several)),
            ("the other parts that look like the sac", (named("the sac"), Several)),
            ("the one like the sac", (named("the sac"), One)),
            ("what looks like the sac", (named("the sac"), Several)),
            ("parts that resemble the sac", (named("the sac"), Several)),
            ("like the sac", (named("the sac"), Several)),
            ("things like this", (Model::Selection, Several)),
            ("things like this one", (Model::Selection, Several)),
            ("more like the selection", (Model::Selection, Several)),
            ("others like it", (Model::Selection, Several)),
            ("a thing like a tube", (Model::Kind("tube".into()), One)),
            ("something that looks like a ball", (Model::Kind("ball".into()), One)),
        ] {
            assert_eq!(read(text), Some(expected), "{text}");
        }
        for text in ["the plant like thing", "the sac", "things like", "a sac like the vein", "", "the red one"] {
            assert_eq!(read(text), None, "{text}");
        }
    }

    #[test]
    fn texts_become_groups() {
        use Number::{One, Several};
        for (text, wanted, excluded, number) in [
            ("Show me the left kidney, please", "kidney[left]", "", One),
            ("both kidneys", "kidneys[]", "", Several),
            ("everything but the liver", "*[]", "liver[]", Several),
            ("all except the road and the tree", "*[]", "road[] + tree[]", Several),
            ("without skin and skull", "*[]", "skin[] + skull[]", Several),
            ("the ball that is neither red, white nor yellow", "ball[]", "[red] + [white] + [yellow]", One),
            ("the largest red thing", "[largest red]", "", One),
            ("the small and red one", "[small red]", "", One),
            ("the cup and the spoon", "cup[] + spoon[]", "", Several),
            ("red things", "[red]", "", Several),
            ("the eye that isn't on the left", "eye[]", "[left]", One),
            ("green but not the tree", "[green]", "tree[]", One),
            ("everything that is not red", "*[]", "[red]", Several),
            ("all the bones", "bones[]", "", Several),
            ("", "", "", One),
            ("not", "", "", One),
        ] {
            assert_eq!(read(text), (wanted.into(), excluded.into(), number), "{text}");
        }
    }
}
