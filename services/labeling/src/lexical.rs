//! An index over labels that finds them by word, inflection, synonym, broader term, spelling and sound.
//!
//! A term is one word of a label, or up to three neighbours. A query is compared once with each different term, not with each label:
//! through tables for letters, stems and meanings, and by letters and sound for words that no dictionary has. Then the words of the
//! query are laid on those of each label.

use std::collections::HashMap;

use rphonetic::DoubleMetaphone;
use rust_stemmers::{Algorithm, Stemmer};

use crate::relation::{Evidence, Relation};
use crate::text::Phrase;
use crate::usage;
use crate::wordnet::{self, Sense, Synset, WordNet, WordNetError};

/// Most words of a term.
const MAX_TERM: usize = 3;
/// Most meanings of a word that are looked at.
const MAX_SENSES: usize = 6;
/// Most steps to a broader meaning.
const MAX_STEPS: u8 = 6;
/// Most steps to a narrower meaning: farther ones are other things.
const MAX_NARROWER: u8 = 2;
/// Meanings with more narrower ones are too general to identify a thing: "object", "artifact", "organism".
const MAX_GENERALITY: usize = 6000;
/// Fewest letters of either part of a word that is written together.
const MIN_PART: usize = 3;
/// Share of a phrase that its head counts; the other words share the rest.
const HEAD_SHARE: f64 = 0.6;
/// What a match counts in which the label's head takes no part: "artery" to "artery clip".
const BESIDE_HEAD: f64 = 0.72;
/// What a match counts in which both sides have a describing word that the other lacks: "left kidney" to "right kidney".
const CONFLICT: f64 = 0.6;
/// What words of a compound count one by one: a steering wheel is no wheel with a steering.
const COMPOUND_PARTS: f64 = 0.7;
/// What a match loses for each word of the label that the query lacks.
const EXTRA_WORD: f64 = 0.97;

/// What the words of a query say about one label.
#[derive(Debug, Clone, PartialEq)]
pub struct LexicalMatch {
    /// Share of queries with this evidence that mean the label, 0 to 1, see [`Relation::score`].
    pub score: f64,
    /// What speaks for it, in the order of the query.
    pub evidence: Vec<Evidence>,
    /// For each word of the query, whether evidence covers it.
    pub(crate) covered: Vec<bool>,
}

/// A word or a few neighbouring words.
struct Term {
    text: String,
    /// The letters without spaces.
    joined: String,
    /// Stems of the words, for single words and compounds alike.
    stem: String,
    /// Dictionary forms of the whole.
    forms: Vec<String>,
    senses: Vec<Sense>,
    /// Codes of the sound; empty for words that are short or not English letters.
    sounds: Vec<String>,
    /// Last parts of a word that is written together, by dictionary forms: "shaft" of "crankshaft".
    endings: Vec<String>,
    is_single: bool,
}

/// A term's place in a phrase.
#[derive(Clone, Copy)]
struct Span {
    start: usize,
    length: usize,
    term: usize,
}

struct Label {
    phrase: Phrase,
    spans: Vec<Span>,
}

/// The relation of one term of a query to each term of the labels, with its score.
type Relations = Vec<Option<(Relation, f64)>>;

/// A term of a query that some label has something to do with.
struct QueryTerm {
    start: usize,
    length: usize,
    relations: Relations,
}

/// An index over labels.
pub struct Index {
    net: &'static WordNet,
    labels: Vec<Option<Label>>,
    terms: Vec<Term>,
    by_text: HashMap<String, usize>,
    by_joined: HashMap<String, Vec<usize>>,
    by_stem: HashMap<String, Vec<usize>>,
    by_form: HashMap<String, Vec<usize>>,
    by_ending: HashMap<String, Vec<usize>>,
    /// Terms of one word.
    single: Vec<usize>,
    /// Terms with a meaning, and terms with a broader meaning, with its steps.
    by_synset: HashMap<Synset, Vec<(usize, u8, u8)>>,
    letters: Letters,
}

/// What is known of the letters of words.
struct Letters {
    stemmer: Stemmer,
    metaphone: DoubleMetaphone,
}

impl Index {
    /// An index over labels, in their order. An item without a label matches no word.
    ///
    /// # Errors
    /// [`WordNetError`] if the embedded synonyms are damaged.
    pub fn new<'l>(labels: impl IntoIterator<Item = Option<&'l str>>) -> Result<Self, WordNetError> {
        let mut index = Self {
            net: wordnet::embedded()?,
            labels: Vec::new(),
            terms: Vec::new(),
            by_text: HashMap::new(),
            by_joined: HashMap::new(),
            by_stem: HashMap::new(),
            by_form: HashMap::new(),
            by_ending: HashMap::new(),
            single: Vec::new(),
            by_synset: HashMap::new(),
            letters: Letters { stemmer: Stemmer::create(Algorithm::English), metaphone: DoubleMetaphone::new(Some(8)) },
        };
        for label in labels {
            let phrase = label.map(Phrase::of).filter(|p| !p.is_empty());
            let label = phrase.map(|phrase| {
                let mut spans = Vec::new();
                for (start, length) in places(phrase.words.len()) {
                    let text = phrase.words[start..start + length].join(" ");
                    spans.push(Span { start, length, term: index.term(&text, length == 1) });
                }
                Label { phrase, spans }
            });
            index.labels.push(label);
        }
        Ok(index)
    }

    /// Number of items.
    #[must_use]
    pub fn len(&self) -> usize {
        self.labels.len()
    }

    /// Whether there are no items.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.labels.is_empty()
    }

    /// The content words of an item's label.
    pub(crate) fn words_of(&self, item: usize) -> &[String] {
        self.labels.get(item).and_then(Option::as_ref).map_or(&[], |l| &l.phrase.words)
    }

    /// The dictionary that the index reads.
    pub(crate) fn net(&self) -> &'static WordNet {
        self.net
    }

    /// The number of a term, which is new or known.
    fn term(&mut self, text: &str, is_single: bool) -> usize {
        if let Some(known) = self.by_text.get(text) {
            return *known;
        }
        let at = self.terms.len();
        let term = Term::new(text, is_single, self.net, &self.letters);
        self.by_text.insert(text.to_owned(), at);
        self.by_joined.entry(term.joined.clone()).or_default().push(at);
        self.by_stem.entry(term.stem.clone()).or_default().push(at);
        for form in &term.forms {
            self.by_form.entry(form.clone()).or_default().push(at);
        }
        for ending in &term.endings {
            self.by_ending.entry(ending.clone()).or_default().push(at);
        }
        if is_single {
            self.single.push(at);
        }
        for sense in &term.senses {
            for (synset, steps) in above(self.net, sense.synset, MAX_STEPS) {
                self.by_synset.entry(synset).or_default().push((at, steps, sense.rank));
            }
        }
        self.terms.push(term);
        at
    }

    /// What a phrase says about each item, in their order; `None` where nothing relates them.
    #[must_use]
    pub fn matches(&self, phrase: &Phrase) -> Vec<Option<LexicalMatch>> {
        let query: Vec<QueryTerm> = places(phrase.words.len())
            .map(|(start, length)| {
                let text = phrase.words[start..start + length].join(" ");
                let term = Term::new(&text, length == 1, self.net, &self.letters);
                QueryTerm { start, length, relations: self.relations(&term) }
            })
            .filter(|asked| asked.relations.iter().any(Option::is_some))
            .collect();
        let whole = phrase.words.join(" ");
        let is_compound = phrase.words.len() > 1 && !self.net.dictionary_forms(&whole).is_empty();
        let align = |label: &Option<Label>| label.as_ref().and_then(|l| self.align(phrase, is_compound, &query, l));
        self.labels.iter().map(align).collect()
    }

    /// The relation of a query's term to every term of the labels, with its score.
    fn relations(&self, query: &Term) -> Relations {
        let mut best: Relations = vec![None; self.terms.len()];
        let mut offer = |at: usize, relation: Relation, factor: f64| {
            // A compound whose head is the label's word names a kind of it, although the dictionary calls "wheel" a short form
            // of "steering wheel".
            let is_own_head = self
                .terms
                .get(at)
                .is_some_and(|t| query.text.strip_suffix(t.text.as_str()).is_some_and(|rest| rest.ends_with(' ')));
            let relation = if is_own_head { Relation::Narrower(1) } else { relation };
            let score = relation.score() * factor;
            if let Some(known) = best.get_mut(at)
                && known.is_none_or(|(_, k)| score > k)
            {
                *known = Some((relation, score));
            }
        };
        if let Some(at) = self.by_text.get(&query.text) {
            offer(*at, Relation::Exact, 1.0);
        }
        for at in self.by_joined.get(&query.joined).into_iter().flatten() {
            offer(*at, Relation::Spacing, 1.0);
        }
        for at in self.by_stem.get(&query.stem).into_iter().flatten() {
            offer(*at, Relation::Inflection, 1.0);
        }
        for form in &query.forms {
            for at in self.by_form.get(form).into_iter().flatten() {
                offer(*at, Relation::Inflection, 1.0);
            }
            for at in self.by_ending.get(form).into_iter().flatten().filter(|_| query.is_single) {
                offer(*at, Relation::Ending, 1.0);
            }
        }
        for form in std::iter::once(&query.text).chain(&query.forms) {
            for name in usage::other_names(form) {
                for at in self.by_text.get(name).into_iter().chain(self.by_form.get(name).into_iter().flatten()) {
                    offer(*at, Relation::Usage, 1.0);
                }
            }
        }
        for sense in &query.senses {
            let is_general = self.net.generality(sense.synset) > MAX_GENERALITY;
            for (at, steps, rank) in self.by_synset.get(&sense.synset).into_iter().flatten() {
                let factor = commonness(sense.rank) * commonness(*rank);
                match steps {
                    0 => offer(*at, Relation::Synonym, factor),
                    _ if !is_general => offer(*at, Relation::Broader(*steps), factor),
                    _ => {}
                }
            }
            for (synset, steps) in above(self.net, sense.synset, MAX_NARROWER).into_iter().skip(1) {
                let own = self.by_synset.get(&synset).into_iter().flatten().filter(|(_, steps, _)| *steps == 0);
                for (at, _, rank) in own {
                    offer(*at, Relation::Narrower(steps), commonness(sense.rank) * commonness(*rank));
                }
            }
            let pertains = self.net.pertains_to(sense.synset).map(|noun| (noun, Relation::Pertains));
            let parts = self.net.kindred_wholes(sense.synset).map(|whole| (whole, Relation::Part));
            for (other, relation) in pertains.chain(parts) {
                let own = self.by_synset.get(&other).into_iter().flatten().filter(|(_, steps, _)| *steps == 0);
                for (at, _, rank) in own {
                    offer(*at, relation, commonness(sense.rank) * commonness(*rank));
                }
            }
        }
        if query.is_single {
            for at in &self.single {
                if let Some(relation) = self.terms.get(*at).and_then(|term| misspelling(query, term)) {
                    offer(*at, relation, 1.0);
                }
            }
        }
        best
    }

    /// Lays the words of a query on those of a label: the cover with the greatest weight.
    fn align(&self, phrase: &Phrase, is_compound: bool, query: &[QueryTerm], label: &Label) -> Option<LexicalMatch> {
        let count = phrase.words.len();
        let weight = |at: usize| match (count, at == phrase.head) {
            (1, _) => 1.0,
            (_, true) => HEAD_SHARE,
            (n, false) => (1.0 - HEAD_SHARE) / (n - 1) as f64,
        };
        // From the end: the best cover of the words from each place on.
        let mut best: Vec<(f64, Option<(usize, usize)>)> = vec![(0.0, None); count + 1];
        for start in (0..count).rev() {
            let mut own = (best[start + 1].0, None);
            for (at, asked) in query.iter().enumerate().filter(|(_, asked)| asked.start == start) {
                let weight: f64 = (start..start + asked.length).map(weight).sum();
                for (place, other) in label.spans.iter().enumerate() {
                    let Some((_, score)) = asked.relations.get(other.term).copied().flatten() else { continue };
                    let parts = if is_compound && asked.length < count { COMPOUND_PARTS } else { 1.0 };
                    let value = weight * score * parts + best[start + asked.length].0;
                    if value > own.0 + 1e-12 {
                        own = (value, Some((at, place)));
                    }
                }
            }
            best[start] = own;
        }
        let mut covered = vec![false; count];
        let mut used = vec![false; label.phrase.words.len()];
        let mut evidence = Vec::new();
        let mut start = 0;
        while start < count {
            let Some((at, place)) = best[start].1 else {
                start += 1;
                continue;
            };
            let (asked, other) = (query.get(at)?, label.spans.get(place)?);
            let (relation, score) = asked.relations.get(other.term).copied().flatten()?;
            covered[start..start + asked.length].fill(true);
            used[other.start..other.start + other.length].fill(true);
            let query = phrase.words[start..start + asked.length].join(" ");
            evidence.push(Evidence { query, label: self.terms.get(other.term)?.text.clone(), relation, score });
            start += asked.length;
        }
        if evidence.is_empty() {
            return None;
        }
        let mut score = best[0].0;
        if !used.get(label.phrase.head).copied().unwrap_or_default() {
            score *= BESIDE_HEAD;
        }
        let unused = used.iter().filter(|u| !**u).count();
        let is_special = evidence.iter().any(|e| matches!(e.relation, Relation::Narrower(_)));
        let is_general = evidence.iter().any(|e| matches!(e.relation, Relation::Broader(_) | Relation::Ending));
        let lacks = covered.contains(&false);
        // A broader term with a description asks for one kind, which the label need not be: "nasal bone" to "rib".
        if unused > 0 && (is_special || lacks) || lacks && is_general {
            score *= CONFLICT;
        }
        score *= EXTRA_WORD.powi(unused as i32);
        Some(LexicalMatch { score, evidence, covered })
    }
}

/// Start and length of the terms of a phrase.
fn places(words: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..words).flat_map(move |start| (1..=MAX_TERM.min(words - start)).map(move |length| (start, length)))
}

/// How much a meaning counts by its rank among those of its word.
fn commonness(rank: u8) -> f64 {
    0.96_f64.powi(i32::from(rank.min(10)))
}

/// A meaning and the broader ones with their least number of steps, the nearest first.
fn above(net: &WordNet, synset: Synset, most: u8) -> Vec<(Synset, u8)> {
    let mut found = vec![(synset, 0)];
    let mut at = 0;
    while let Some((from, steps)) = found.get(at).copied() {
        at += 1;
        if steps < most {
            for next in net.broader(from) {
                if !found.iter().any(|(known, _)| *known == next) {
                    found.push((next, steps + 1));
                }
            }
        }
    }
    found
}

impl Term {
    fn new(text: &str, is_single: bool, net: &WordNet, letters: &Letters) -> Self {
        let forms = net.dictionary_forms(text);
        let mut senses: Vec<Sense> = Vec::new();
        for sense in forms.iter().flat_map(|f| net.senses(f)) {
            if senses.len() < MAX_SENSES && !senses.iter().any(|s| s.synset == sense.synset) {
                senses.push(sense);
            }
        }
        let stem = text.split(' ').map(|w| letters.stemmer.stem(w)).collect::<Vec<_>>().join(" ");
        let is_plain = is_single && text.len() > 1 && text.bytes().all(|b| b.is_ascii_lowercase());
        let mut sounds = Vec::new();
        if is_plain {
            let codes = letters.metaphone.double_metaphone(text);
            for code in [codes.primary(), codes.alternate()] {
                if code.len() > 1 && !sounds.contains(&code) {
                    sounds.push(code);
                }
            }
        }
        let endings = if is_plain { endings(text, net) } else { Vec::new() };
        Self { text: text.to_owned(), joined: text.replace(' ', ""), stem, forms, senses, sounds, endings, is_single }
    }
}

/// The last parts of a word whose first parts are words as well.
fn endings(text: &str, net: &WordNet) -> Vec<String> {
    let cuts = MIN_PART..(text.len() + 1).saturating_sub(MIN_PART);
    cuts.filter_map(|at| text.split_at_checked(at))
        .filter(|(first, _)| net.contains(first))
        .flat_map(|(_, last)| net.dictionary_forms(last))
        .collect()
}

/// Whether one word may be a wrong spelling of another.
///
/// A word that the dictionary has is rarely a mistyped other word, but it may sound like one to a recognizer of speech ("tale", "tail").
fn misspelling(query: &Term, label: &Term) -> Option<Relation> {
    let (a, b) = (query.text.chars().count(), label.text.chars().count());
    let longest = a.max(b);
    if a.min(b) < 3 || a.abs_diff(b) > 3 || query.text == label.text {
        return None;
    }
    if query.text.bytes().chain(label.text.bytes()).any(|c| c.is_ascii_digit()) {
        return None;
    }
    let edits = strsim::damerau_levenshtein(&query.text, &label.text);
    let sounds_alike = query.sounds.iter().any(|s| label.sounds.contains(s));
    let is_known = !query.forms.is_empty();
    let same_start = query.text.chars().next() == label.text.chars().next();
    if !is_known {
        let most = match longest {
            0..=5 => 1,
            6..=8 => 2,
            _ => 3,
        };
        if edits <= most && (same_start || edits == 1) {
            return Some(Relation::Spelling(edits.min(255) as u8));
        }
    }
    (sounds_alike && edits <= if is_known { 2 } else { 3 } && 2 * edits <= longest).then_some(Relation::Sound)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn best(labels: &[&str], query: &str) -> Option<(String, f64, Relation)> {
        let index = Index::new(labels.iter().map(|l| Some(*l))).unwrap();
        let found = index.matches(&Phrase::of(query));
        let (at, found) = found
            .into_iter()
            .enumerate()
            .filter_map(|(at, m)| Some((at, m?)))
            .max_by(|a, b| a.1.score.total_cmp(&b.1.score))?;
        Some((labels[at].to_owned(), found.score, found.evidence[0].relation))
    }

    #[test]
    fn each_kind_of_relation() {
        let labels = ["skull", "left kidney", "artery", "tooth", "swim bladder", "fin", "blood"];
        for (query, label, relation) in [
            ("skull", "skull", Relation::Exact),
            ("teeth", "tooth", Relation::Inflection),
            ("swimbladder", "swim bladder", Relation::Spacing),
            ("air bladder", "swim bladder", Relation::Synonym),
            ("blood vessel", "artery", Relation::Broader(1)),
            ("skul", "skull", Relation::Spelling(1)),
            ("phin", "fin", Relation::Sound),
        ] {
            let (found, score, kind) = best(&labels, query).unwrap();
            assert_eq!((found.as_str(), kind), (label, relation), "{query}: {score}");
            assert!(score >= 0.5, "{query}: {score}");
        }
        let (label, score, _) = best(&labels, "cranium").unwrap();
        assert!(label == "skull" && score > 0.5, "{label} {score}");
        let (label, score, _) = best(&labels, "kidney").unwrap();
        assert!(label == "left kidney" && score > 0.9, "{label} {score}");
        let (label, score, _) = best(&labels, "renal").unwrap();
        assert!(label == "left kidney" && score > 0.5, "{label} {score}");
    }

    #[test]
    fn what_is_absent_scores_low() {
        let labels = ["right kidney", "front wheel", "heart"];
        for query in ["kidney stone", "left lung", "steering wheel", "car", "left kidney", "xyzzy", "house"] {
            let score = best(&labels, query).map_or(0.0, |b| b.1);
            assert!(score < 0.5, "{query}: {score}");
        }
    }

    #[test]
    fn a_query_without_words_matches_nothing() {
        let index = Index::new([Some("skull"), None, Some("")]).unwrap();
        assert_eq!(index.matches(&Phrase::of("")), [None, None, None]);
        assert_eq!(index.matches(&Phrase::of("the of")), [None, None, None]);
        assert_eq!(index.len(), 3);
    }

    proptest! {
        #[test]
        fn every_label_finds_itself_and_scores_stay_in_range(
            labels in prop::collection::vec("[a-z]{3,9}( [a-z]{3,9}){0,2}", 1..12),
            query in "\\PC{0,40}",
        ) {
            let index = Index::new(labels.iter().map(|l| Some(l.as_str()))).unwrap();
            for label in &labels {
                let phrase = Phrase::of(label);
                let found = index.matches(&phrase);
                let at = labels.iter().position(|l| l == label).unwrap();
                if !phrase.is_empty() {
                    prop_assert!((found[at].as_ref().unwrap().score - 1.0).abs() < 1e-9, "{label}: {:?}", found[at]);
                }
            }
            for found in index.matches(&Phrase::of(&query)).into_iter().flatten() {
                prop_assert!((0.0..=1.0 + 1e-12).contains(&found.score));
            }
        }
    }
}
