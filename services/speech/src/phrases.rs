//! Sentences that a recognizer expects, as templates with slots.
//!
//! The caller fills a [`PhraseGrammar`] from its table of commands and from the labels of the live scene. A template is text with
//!
//! - `{name}`: one value of a slot,
//! - `(a | b)`: one of several texts,
//! - `[a]`: a text that may be missing.
//!
//! Texts are as people write them. Recognizers compare spoken words ([`crate::spoken::words`]) and return the written form, with
//! the label as the scene spells it.

use std::collections::{BTreeMap, BTreeSet};

use crate::error::SpeechError;
use crate::spoken;

/// Most templates.
pub const MAX_TEMPLATES: usize = 4_000;

/// Most values of a slot.
pub const MAX_VALUES: usize = 4_000;

/// Most bytes of a template or a value.
pub const MAX_BYTES: usize = 500;

/// Deepest nesting of a template.
const MAX_DEPTH: usize = 6;

/// Most steps of a search for one sentence's template.
const MAX_STEPS: usize = 200_000;

#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Node {
    /// A written word with its spoken words.
    Text { written: String, spoken: Vec<String> },
    /// A slot by name.
    Slot(String),
    /// One of these; an empty one may be missing.
    Choice(Vec<Vec<Node>>),
}

/// Sentences that are expected. Equal grammars give equal recognizers, so a recognizer prepares again only for a new one.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct PhraseGrammar {
    slots: BTreeMap<String, Vec<Node>>,
    templates: Vec<Vec<Node>>,
}

/// One sentence of a grammar.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Sentence {
    /// As it is written.
    pub written: String,
    /// As it is said.
    pub spoken: String,
}

impl PhraseGrammar {
    /// A grammar without sentences.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Sets the values of a slot. Values that cannot be said, such as "…", are left out, and equal ones are taken once.
    ///
    /// # Errors
    /// [`SpeechError::Limit`]: too many values, or too long ones.
    pub fn set_slot<V: AsRef<str>>(
        &mut self,
        name: &str,
        values: impl IntoIterator<Item = V>,
    ) -> Result<(), SpeechError> {
        let mut nodes = Vec::new();
        for value in values {
            let value = value.as_ref().trim();
            check_length(value)?;
            let spoken = spoken::words(value);
            let node = Node::Text { written: value.to_owned(), spoken };
            if !matches!(&node, Node::Text { spoken, .. } if spoken.is_empty()) && !nodes.contains(&node) {
                nodes.push(node);
            }
            if nodes.len() > MAX_VALUES {
                return Err(SpeechError::Limit(format!(
                    "the slot {name} has more than {MAX_VALUES} values; leave some out"
                )));
            }
        }
        self.slots.insert(name.to_owned(), nodes);
        Ok(())
    }

    /// Adds a template.
    ///
    /// # Errors
    /// [`SpeechError::Limit`]: too many or too long templates, or brackets that do not match.
    pub fn add(&mut self, template: &str) -> Result<(), SpeechError> {
        check_length(template)?;
        if self.templates.len() >= MAX_TEMPLATES {
            return Err(SpeechError::Limit(format!("more than {MAX_TEMPLATES} templates; leave some out")));
        }
        let mut rest = template;
        let mut choices = parse(&mut rest, 0).map_err(|problem| in_template(template, problem))?;
        if !rest.is_empty() {
            return Err(in_template(template, "a bracket is closed that was never opened"));
        }
        let nodes = if choices.len() == 1 { choices.remove(0) } else { vec![Node::Choice(choices)] };
        if !self.templates.contains(&nodes) {
            self.templates.push(nodes);
        }
        Ok(())
    }

    /// The values of a slot as they are written; none for an unknown slot.
    pub fn slot(&self, name: &str) -> impl Iterator<Item = &str> {
        let nodes = self.slots.get(name).map_or(&[][..], |values| values);
        nodes.iter().filter_map(|node| match node {
            Node::Text { written, .. } => Some(written.as_str()),
            Node::Slot(_) | Node::Choice(_) => None,
        })
    }

    /// Whether no sentence can be said.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        !self.templates.iter().any(|template| self.is_sayable(template) && self.has_words(template))
    }

    pub(crate) fn slots(&self) -> impl Iterator<Item = (&str, &[Node])> {
        self.slots.iter().map(|(name, values)| (name.as_str(), &values[..]))
    }

    /// Templates all of whose slots have values.
    pub(crate) fn templates(&self) -> impl Iterator<Item = &[Node]> {
        let usable = |template: &&Vec<Node>| self.is_sayable(template) && self.has_words(template);
        self.templates.iter().filter(usable).map(|template| &template[..])
    }

    /// Whether it has a sentence: no slot that is needed is empty.
    pub(crate) fn is_sayable(&self, nodes: &[Node]) -> bool {
        nodes.iter().all(|node| match node {
            Node::Text { .. } => true,
            Node::Slot(name) => self.slots.get(name).is_some_and(|values| !values.is_empty()),
            Node::Choice(choices) => choices.iter().any(|choice| self.is_sayable(choice)),
        })
    }

    fn has_words(&self, nodes: &[Node]) -> bool {
        nodes.iter().any(|node| match node {
            Node::Text { spoken, .. } => !spoken.is_empty(),
            Node::Slot(_) => true,
            Node::Choice(choices) => choices.iter().any(|choice| self.has_words(choice)),
        })
    }

    /// All spoken words.
    #[must_use]
    pub fn vocabulary(&self) -> BTreeSet<String> {
        let mut words = BTreeSet::new();
        self.templates().for_each(|template| self.gather(template, &mut words));
        words
    }

    fn gather(&self, nodes: &[Node], words: &mut BTreeSet<String>) {
        for node in nodes {
            match node {
                Node::Text { spoken, .. } => words.extend(spoken.iter().cloned()),
                Node::Slot(name) => self.gather(self.slots.get(name).map_or(&[][..], |values| values), words),
                Node::Choice(choices) => choices.iter().for_each(|choice| self.gather(choice, words)),
            }
        }
    }

    /// The written form of spoken words, if they are a sentence of the grammar. The first template wins.
    #[must_use]
    pub fn written(&self, said: &str) -> Option<String> {
        let said = spoken::words(said);
        let words: Vec<&str> = said.iter().map(String::as_str).collect();
        let mut search = Search { grammar: self, words: &words, steps: 0 };
        let written = self.templates().find_map(|template| search.run(&[template], 0, Vec::new()))?;
        Some(written.join(" "))
    }

    /// Sentences of the grammar in the order of templates and values, at most `most` of them.
    #[must_use]
    pub fn sentences(&self, most: usize) -> Vec<Sentence> {
        let mut sentences = Vec::new();
        for template in self.templates() {
            self.expand(&[template], &mut Vec::new(), most, &mut sentences);
        }
        sentences
    }

    /// As [`Self::sentences`], where templates with many sentences leave room for all others: of a list that is too long, each
    /// template has an equal share at least.
    #[must_use]
    pub fn balanced_sentences(&self, most: usize) -> Vec<Sentence> {
        let mut lists: Vec<Vec<Sentence>> = self
            .templates()
            .map(|template| {
                let mut sentences = Vec::new();
                self.expand(&[template], &mut Vec::new(), most, &mut sentences);
                sentences
            })
            .collect();
        // The longest list that all may have: short lists leave their room to the others.
        let mut lengths: Vec<usize> = lists.iter().map(Vec::len).collect();
        lengths.sort_unstable();
        let (mut room, mut share) = (most, most);
        for (at, length) in lengths.iter().enumerate() {
            share = room / (lengths.len() - at);
            if *length > share {
                break;
            }
            room -= length;
        }
        lists.iter_mut().for_each(|list| list.truncate(share));
        lists.into_iter().flatten().collect()
    }

    fn expand<'g>(&'g self, rest: &[&'g [Node]], said: &mut Vec<&'g Node>, most: usize, out: &mut Vec<Sentence>) {
        if out.len() >= most {
            return;
        }
        let Some((first, later)) = rest.split_first() else {
            let (mut written, mut spoken) = (Vec::new(), Vec::new());
            for node in said.iter() {
                if let Node::Text { written: text, spoken: words } = node {
                    written.push(text.as_str());
                    spoken.extend(words.iter().map(String::as_str));
                }
            }
            out.push(Sentence { written: written.join(" "), spoken: spoken.join(" ") });
            return;
        };
        let Some((node, after)) = first.split_first() else { return self.expand(later, said, most, out) };
        let then = |choice: &'g [Node]| [&[choice, after], later].concat();
        match node {
            Node::Text { .. } => {
                said.push(node);
                self.expand(&[&[after], later].concat(), said, most, out);
                said.pop();
            }
            Node::Slot(name) => {
                for value in self.slots.get(name).into_iter().flatten() {
                    self.expand(&then(std::slice::from_ref(value)), said, most, out);
                }
            }
            Node::Choice(choices) => {
                for choice in choices {
                    self.expand(&then(choice), said, most, out);
                }
            }
        }
    }
}

/// A search for the template of spoken words.
struct Search<'g> {
    grammar: &'g PhraseGrammar,
    words: &'g [&'g str],
    steps: usize,
}

impl<'g> Search<'g> {
    /// The written words of `rest` if it says all words from `at` on.
    fn run(&mut self, rest: &[&'g [Node]], at: usize, written: Vec<&'g str>) -> Option<Vec<&'g str>> {
        self.steps += 1;
        if self.steps > MAX_STEPS {
            return None;
        }
        let Some((first, later)) = rest.split_first() else { return (at == self.words.len()).then_some(written) };
        let Some((node, after)) = first.split_first() else { return self.run(later, at, written) };
        let grammar = self.grammar;
        match node {
            Node::Text { written: text, spoken } => {
                let end = at + spoken.len();
                let says = self.words.get(at..end).is_some_and(|words| words.iter().eq(spoken.iter()));
                let mut written = written;
                written.push(text);
                if says { self.run(&[&[after], later].concat(), end, written) } else { None }
            }
            Node::Slot(name) => grammar.slots.get(name)?.iter().find_map(|value| {
                self.run(&[&[std::slice::from_ref(value), after], later].concat(), at, written.clone())
            }),
            Node::Choice(choices) => choices
                .iter()
                .find_map(|choice| self.run(&[&[choice.as_slice(), after], later].concat(), at, written.clone())),
        }
    }
}

fn check_length(text: &str) -> Result<(), SpeechError> {
    if text.len() > MAX_BYTES {
        return Err(SpeechError::Limit(format!(
            "a phrase has {} bytes, more than {MAX_BYTES}; shorten it",
            text.len()
        )));
    }
    Ok(())
}

fn in_template(template: &str, problem: &str) -> SpeechError {
    SpeechError::Limit(format!("template “{}”: {problem}", sg_input::printable(template)))
}

/// Parses alternatives up to a closing bracket or the end.
fn parse(rest: &mut &str, depth: usize) -> Result<Vec<Vec<Node>>, &'static str> {
    if depth > MAX_DEPTH {
        return Err("its brackets are nested too deeply");
    }
    let mut choices = vec![Vec::new()];
    loop {
        let end = rest.find(['{', '(', '[', '|', ')', ']', '}']).unwrap_or(rest.len());
        let (text, after) = rest.split_at(end);
        let nodes = choices.last_mut().ok_or("it is empty")?;
        for word in text.split_whitespace() {
            nodes.push(Node::Text { written: word.to_owned(), spoken: spoken::words(word) });
        }
        let Some(sign) = after.chars().next() else {
            *rest = after;
            return Ok(choices);
        };
        match sign {
            '{' => {
                let (name, behind) = after[1..].split_once('}').ok_or("a slot is not closed")?;
                nodes.push(Node::Slot(name.trim().to_owned()));
                *rest = behind;
            }
            '(' | '[' => {
                *rest = &after[1..];
                let mut inner = parse(rest, depth + 1)?;
                if sign == '[' {
                    inner.push(Vec::new());
                }
                let closing = if sign == '(' { ')' } else { ']' };
                *rest = rest.strip_prefix(closing).ok_or("a bracket is not closed")?;
                nodes.push(Node::Choice(inner));
            }
            '|' => {
                *rest = &after[1..];
                choices.push(Vec::new());
            }
            _ => {
                *rest = after;
                return Ok(choices);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn grammar() -> PhraseGrammar {
        let mut grammar = PhraseGrammar::new();
        grammar.set_slot("unit", ["sac", "left_kidney-2", "…", "sac"]).unwrap();
        grammar.set_slot("percent", ["20", "50"]).unwrap();
        for template in
            ["[please] (hide | show) the {unit}", "fade the {unit} to {percent} %", "undo", "open {nothing}"]
        {
            grammar.add(template).unwrap();
        }
        grammar
    }

    #[test]
    fn a_long_template_leaves_room_for_the_others() {
        let mut grammar = PhraseGrammar::new();
        let many: Vec<String> = ('a'..='z').map(|c| format!("unit {c}")).collect();
        grammar.set_slot("unit", &many).unwrap();
        for template in ["merge {unit} with {unit}", "hide {unit}", "undo"] {
            grammar.add(template).unwrap();
        }
        let all = grammar.balanced_sentences(10_000);
        assert_eq!(all, grammar.sentences(10_000));
        assert_eq!(all.len(), 26 * 26 + 26 + 1);
        let few = grammar.balanced_sentences(100);
        assert_eq!(few.len(), 100);
        assert_eq!(few.iter().filter(|s| s.written.starts_with("merge")).count(), 73);
        assert!(few.iter().any(|s| s.written == "undo"));
    }

    #[test]
    fn spoken_sentences_are_written_with_the_scenes_own_labels() {
        let grammar = grammar();
        let written = |said: &str| grammar.written(said);
        assert_eq!(written("hide the left kidney two").as_deref(), Some("hide the left_kidney-2"));
        assert_eq!(written("fade the sac to twenty percent").as_deref(), Some("fade the sac to 20 %"));
        assert_eq!(written("please show the sac").as_deref(), Some("please show the sac"));
        for other in ["hide the", "hide the sac now", "open", "", "fade the sac to thirty percent"] {
            assert_eq!(written(other), None, "{other}");
        }
        let vocabulary: Vec<String> = grammar.vocabulary().into_iter().collect();
        assert_eq!(vocabulary.join(" "), "fade fifty hide kidney left percent please sac show the to twenty two undo");
    }

    #[test]
    fn all_sentences_are_listed_and_all_are_sentences() {
        let grammar = grammar();
        let all = grammar.sentences(usize::MAX);
        assert_eq!(all.len(), 2 * 2 * 2 + 2 * 2 + 1);
        for sentence in &all {
            assert_eq!(grammar.written(&sentence.spoken).as_deref(), Some(sentence.written.as_str()));
        }
        assert_eq!(grammar.sentences(3), all[..3]);
    }

    #[test]
    fn bad_templates_and_too_much_are_refused() {
        let mut grammar = PhraseGrammar::new();
        for bad in ["hide (the", "hide the)", "a {unit", "[a", "a ] b", "((((((((a))))))))", &"x".repeat(501)] {
            let refused = grammar.add(bad).unwrap_err().to_string();
            assert!(!refused.contains('\n'), "{refused}");
        }
        assert!(grammar.set_slot("n", (0..5_000).map(|n| n.to_string())).is_err());
        assert!(grammar.is_empty() && grammar.sentences(9).is_empty());
        for n in 0..MAX_TEMPLATES {
            grammar.add(&format!("go {n}")).unwrap();
        }
        assert!(grammar.add("once more").is_err());
    }

    proptest! {
        #[test]
        fn any_template_is_taken_or_refused(template in "[a-c{}()|\\[\\] 1%]{0,30}", said in "[a-c ]{0,20}") {
            let mut grammar = PhraseGrammar::new();
            grammar.set_slot("a", ["b", "c 1"]).unwrap();
            if grammar.add(&template).is_ok() {
                for sentence in grammar.sentences(50) {
                    prop_assert!(grammar.written(&sentence.spoken).is_some() || sentence.spoken.is_empty(), "{sentence:?}");
                }
                let _ = grammar.written(&said);
            }
        }
    }
}
