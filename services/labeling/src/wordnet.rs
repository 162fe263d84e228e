//! WordNet's nouns and adjectives in a compact index: synonyms, broader terms, irregular plurals.
//!
//! The index is made of WordNet 3.0 (Miller 1995; Fellbaum 1998) by the example `wordnet_index`, and its licence stands beside it.
//! Packed by Zstandard it holds, after the magic `SGWN0001` and the number of noun synsets (u32), seven sections. Each has its length
//! in bytes before it (u32). All numbers are little endian.
//!
//! 1. Depth of each synset in its tree (u8). Synsets stand in preorder, so the depths give each one its first broader synset.
//! 2. The lemmas of each synset, each with a tab behind it; a line feed ends the synset.
//! 3. Rank of each lemma's sense (u8): 0 is its most frequent meaning.
//! 4. Further broader synsets: pairs of u32 by columns, the first column as differences.
//! 5. Adjectives and the nouns that they pertain to, in the same form.
//! 6. Parts and the wholes of the same kind, in the same form: the cranium and the skull, both bones.
//! 7. Irregular plurals: plural, tab, singular, line feed.
//!
//! Synsets of adjectives follow those of nouns. The broader synset of an adjective is the head of its cluster.

use std::collections::HashMap;
use std::hash::BuildHasher;
use std::sync::LazyLock;

use hashbrown::{DefaultHashBuilder, HashTable};

const MAGIC: &[u8] = b"SGWN0001";
const PACKED: &[u8] = include_bytes!("../wordnet/index.zst");
/// Most bytes that the index may unpack to.
const MAX_BYTES: usize = 16 << 20;
/// End of a chain of senses.
const NONE: u32 = u32::MAX;

/// A set of words with one meaning.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Synset(u32);

/// One meaning of a word.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sense {
    /// The meaning.
    pub synset: Synset,
    /// 0 is the word's most frequent meaning of its part of speech.
    pub rank: u8,
}

/// The bytes are no index.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the index of WordNet is damaged: {0}; make it again with the example wordnet_index")]
pub struct WordNetError(String);

/// WordNet's nouns and adjectives.
#[derive(Debug)]
pub struct WordNet {
    text: String,
    lemmas: Vec<Lemma>,
    /// The first lemma of each word; the others follow by [`Lemma::next`].
    words: HashTable<u32>,
    hasher: DefaultHashBuilder,
    parents: Vec<u32>,
    /// Number of narrower meanings by first broader meanings, itself included.
    sizes: Vec<u32>,
    extra_parents: Vec<(u32, u32)>,
    pertains: Vec<(u32, u32)>,
    wholes: Vec<(u32, u32)>,
    singulars: HashMap<String, String>,
    nouns: u32,
}

#[derive(Debug, Clone, Copy)]
struct Lemma {
    start: u32,
    length: u16,
    rank: u8,
    synset: u32,
    next: u32,
}

static EMBEDDED: LazyLock<Result<WordNet, WordNetError>> = LazyLock::new(|| WordNet::unpack(PACKED));

/// The embedded index, decoded at the first call.
///
/// # Errors
/// [`WordNetError`] if the program's copy is damaged.
pub fn embedded() -> Result<&'static WordNet, WordNetError> {
    EMBEDDED.as_ref().map_err(Clone::clone)
}

impl WordNet {
    /// Decodes an index.
    ///
    /// # Errors
    /// [`WordNetError`] names the part that is damaged.
    pub fn unpack(packed: &[u8]) -> Result<Self, WordNetError> {
        let raw = zstd::bulk::decompress(packed, MAX_BYTES).map_err(|e| WordNetError(e.to_string()))?;
        let mut rest =
            raw.strip_prefix(MAGIC).ok_or_else(|| WordNetError("it does not begin with its magic".into()))?;
        let nouns = number(&mut rest)?;
        let (depths, text, ranks) = (section(&mut rest)?, section(&mut rest)?, section(&mut rest)?);
        let extra_parents = pairs(section(&mut rest)?)?;
        let pertains = pairs(section(&mut rest)?)?;
        let wholes = pairs(section(&mut rest)?)?;
        let text = utf8(text)?.to_owned();
        let singulars = utf8(section(&mut rest)?)?
            .lines()
            .filter_map(|line| line.split_once('\t'))
            .map(|(plural, singular)| (plural.to_owned(), singular.to_owned()))
            .collect();
        let parents = parents(depths)?;
        let mut sizes = vec![1_u32; parents.len()];
        for (at, parent) in parents.iter().enumerate().rev() {
            let own = sizes.get(at).copied().unwrap_or_default();
            if let Some(above) = sizes.get_mut(*parent as usize) {
                *above += own;
            }
        }
        let lemmas = lemmas(&text, ranks, parents.len())?;
        let known = |(from, to): &(u32, u32)| (*from as usize) < parents.len() && (*to as usize) < parents.len();
        if !extra_parents.iter().chain(&pertains).chain(&wholes).all(known) {
            return Err(WordNetError("a pair names an unknown synset".into()));
        }
        let words = HashTable::with_capacity(lemmas.len());
        let hasher = DefaultHashBuilder::default();
        let mut net =
            Self { text, lemmas, words, hasher, parents, sizes, extra_parents, pertains, wholes, singulars, nouns };
        net.link();
        Ok(net)
    }

    /// Chains the lemmas of each word.
    fn link(&mut self) {
        let Self { text, lemmas, words, hasher, .. } = self;
        for at in 0..lemmas.len() as u32 {
            let word = word(text, lemmas, at);
            let hash = hasher.hash_one(word);
            let entry = words.entry(
                hash,
                |other| word_is(text, lemmas, *other, word),
                |other| hasher.hash_one(self::word(text, lemmas, *other)),
            );
            match entry {
                hashbrown::hash_table::Entry::Occupied(mut first) => {
                    let earlier = std::mem::replace(first.get_mut(), at);
                    if let Some(lemma) = lemmas.get_mut(at as usize) {
                        lemma.next = earlier;
                    }
                }
                hashbrown::hash_table::Entry::Vacant(place) => {
                    place.insert(at);
                }
            }
        }
    }

    fn first(&self, word: &str) -> Option<u32> {
        let hash = self.hasher.hash_one(word);
        self.words.find(hash, |at| word_is(&self.text, &self.lemmas, *at, word)).copied()
    }

    /// Whether a word or a compound of words is known, in its dictionary form: lower case, single spaces.
    #[must_use]
    pub fn contains(&self, lemma: &str) -> bool {
        self.first(lemma).is_some()
    }

    /// The meanings of a word or compound in its dictionary form, by falling frequency, nouns first among equals.
    #[must_use]
    pub fn senses(&self, lemma: &str) -> Vec<Sense> {
        let chain = std::iter::successors(self.first(lemma), |at| {
            self.lemmas.get(*at as usize).map(|l| l.next).filter(|next| *next != NONE)
        });
        let mut senses: Vec<Sense> = chain
            .filter_map(|at| self.lemmas.get(at as usize))
            .map(|l| Sense { synset: Synset(l.synset), rank: l.rank })
            .collect();
        senses.sort_by_key(|s| (s.rank, s.synset));
        senses
    }

    /// Whether a meaning is a noun's.
    #[must_use]
    pub fn is_noun(&self, synset: Synset) -> bool {
        synset.0 < self.nouns
    }

    /// The next broader meanings.
    pub fn broader(&self, synset: Synset) -> impl Iterator<Item = Synset> {
        let first = self.parents.get(synset.0 as usize).copied().filter(|p| *p != NONE);
        first.into_iter().chain(of_pairs(&self.extra_parents, synset.0)).map(Synset)
    }

    /// How general a meaning is: the number of narrower ones, itself included.
    #[must_use]
    pub fn generality(&self, synset: Synset) -> usize {
        self.sizes.get(synset.0 as usize).map_or(0, |size| *size as usize)
    }

    /// The nouns that an adjective pertains to: "renal" to the kidneys.
    pub fn pertains_to(&self, synset: Synset) -> impl Iterator<Item = Synset> {
        of_pairs(&self.pertains, synset.0).map(Synset)
    }

    /// Wholes of the same kind that a noun is a part of: the cranium of the skull, both bones.
    pub fn kindred_wholes(&self, synset: Synset) -> impl Iterator<Item = Synset> {
        of_pairs(&self.wholes, synset.0).map(Synset)
    }

    /// The words of a meaning.
    pub fn words_of(&self, synset: Synset) -> impl Iterator<Item = &str> {
        let from = self.lemmas.partition_point(|l| l.synset < synset.0);
        let own = self.lemmas.iter().enumerate().skip(from).take_while(move |(_, l)| l.synset == synset.0);
        own.map(|(at, _)| word(&self.text, &self.lemmas, at as u32))
    }

    /// Number of meanings.
    #[must_use]
    pub fn len(&self) -> usize {
        self.parents.len()
    }

    /// Whether the index is empty.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.parents.is_empty()
    }

    /// The dictionary forms that a noun in lower case may have, the likeliest first: itself, the singular of an irregular plural,
    /// and singulars by WordNet's rules of detachment (`morphy(7)`). Only known words are given.
    #[must_use]
    pub fn dictionary_forms(&self, word: &str) -> Vec<String> {
        const RULES: [(&str, &str); 8] = [
            ("ies", "y"),
            ("men", "man"),
            ("ses", "s"),
            ("xes", "x"),
            ("zes", "z"),
            ("ches", "ch"),
            ("shes", "sh"),
            ("s", ""),
        ];
        let mut forms: Vec<String> = Vec::new();
        let mut add = |form: String| {
            if !form.is_empty() && !forms.contains(&form) && self.contains(&form) {
                forms.push(form);
            }
        };
        add(word.to_owned());
        if let Some(singular) = self.singulars.get(word) {
            add(singular.clone());
        }
        if !word.ends_with("ss") && word.len() > 2 {
            for (ending, with) in RULES {
                if let Some(stem) = word.strip_suffix(ending) {
                    add(format!("{stem}{with}"));
                }
            }
        }
        forms
    }
}

fn word<'t>(text: &'t str, lemmas: &[Lemma], at: u32) -> &'t str {
    lemmas
        .get(at as usize)
        .and_then(|l| text.get(l.start as usize..l.start as usize + usize::from(l.length)))
        .unwrap_or_default()
}

fn word_is(text: &str, lemmas: &[Lemma], at: u32, other: &str) -> bool {
    word(text, lemmas, at) == other
}

/// The second numbers of the pairs whose first is `from`; the pairs are sorted.
fn of_pairs(pairs: &[(u32, u32)], from: u32) -> impl Iterator<Item = u32> {
    let start = pairs.partition_point(|p| p.0 < from);
    pairs.iter().skip(start).take_while(move |p| p.0 == from).map(|p| p.1)
}

fn number(rest: &mut &[u8]) -> Result<u32, WordNetError> {
    let (head, tail) = rest.split_first_chunk::<4>().ok_or_else(|| WordNetError("it ends too early".into()))?;
    *rest = tail;
    Ok(u32::from_le_bytes(*head))
}

fn section<'b>(rest: &mut &'b [u8]) -> Result<&'b [u8], WordNetError> {
    let length = number(rest)? as usize;
    let (own, tail) = rest.split_at_checked(length).ok_or_else(|| WordNetError("it ends too early".into()))?;
    *rest = tail;
    Ok(own)
}

fn utf8(bytes: &[u8]) -> Result<&str, WordNetError> {
    std::str::from_utf8(bytes).map_err(|e| WordNetError(e.to_string()))
}

fn pairs(bytes: &[u8]) -> Result<Vec<(u32, u32)>, WordNetError> {
    let (words, rest) = bytes.as_chunks::<4>();
    if !rest.is_empty() || words.len() % 2 != 0 {
        return Err(WordNetError("a column of pairs is incomplete".into()));
    }
    let (from, to) = words.split_at(words.len() / 2);
    let mut at = 0_u32;
    Ok(from
        .iter()
        .zip(to)
        .map(|(step, to)| {
            at = at.wrapping_add(u32::from_le_bytes(*step));
            (at, u32::from_le_bytes(*to))
        })
        .collect())
}

/// The parent of each synset, from depths in preorder.
fn parents(depths: &[u8]) -> Result<Vec<u32>, WordNetError> {
    let mut path: Vec<u32> = Vec::new();
    let mut parents = Vec::with_capacity(depths.len());
    for (at, depth) in depths.iter().enumerate() {
        let depth = usize::from(*depth);
        if depth > path.len() {
            return Err(WordNetError(format!("synset {at} has no parent")));
        }
        path.truncate(depth);
        parents.push(path.last().copied().unwrap_or(NONE));
        path.push(at as u32);
    }
    Ok(parents)
}

fn lemmas(text: &str, ranks: &[u8], synsets: usize) -> Result<Vec<Lemma>, WordNetError> {
    let mut lemmas = Vec::with_capacity(ranks.len());
    let (mut start, mut synset) = (0, 0);
    for (at, byte) in text.bytes().enumerate() {
        match byte {
            b'\t' => {
                let rank = *ranks.get(lemmas.len()).ok_or_else(|| WordNetError("a rank is missing".into()))?;
                let length = u16::try_from(at - start).map_err(|_| WordNetError("a word is too long".into()))?;
                lemmas.push(Lemma { start: start as u32, length, rank, synset, next: NONE });
                start = at + 1;
            }
            b'\n' => {
                synset += 1;
                start = at + 1;
            }
            _ => {}
        }
    }
    if synset as usize != synsets || lemmas.len() != ranks.len() {
        return Err(WordNetError(format!("{synset} synsets have words, {synsets} have depths")));
    }
    Ok(lemmas)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn net() -> &'static WordNet {
        embedded().unwrap()
    }

    fn share(a: &str, b: &str) -> bool {
        let b = net().senses(b);
        net().senses(a).iter().any(|s| b.iter().any(|t| s.synset == t.synset))
    }

    #[test]
    fn words_and_their_meanings() {
        let cranium = net().senses("cranium")[0].synset;
        assert!(net().kindred_wholes(cranium).any(|whole| net().words_of(whole).any(|w| w == "skull")));
        for (a, b) in [
            ("gear wheel", "gear"),
            ("backbone", "vertebral column"),
            ("windscreen", "windshield"),
            ("dentin", "dentine"),
        ] {
            assert!(share(a, b), "{a} {b}");
        }
        assert!(!share("kidney", "liver"));
        assert_eq!(net().senses("xyzzy"), []);
        assert!(net().len() > 80_000, "{}", net().len());
        let kidney = net().senses("kidney")[0].synset;
        assert!(net().words_of(kidney).eq(["kidney"]) && net().is_noun(kidney));
    }

    #[test]
    fn broader_terms_lead_to_entity() {
        let entity = net().senses("entity")[0].synset;
        for lemma in ["aorta", "kidney", "wheel", "apple"] {
            let mut at = net().senses(lemma)[0].synset;
            let mut steps = 0;
            while let Some(next) = net().broader(at).next() {
                at = next;
                steps += 1;
                assert!(steps < 30);
            }
            assert_eq!(at, entity, "{lemma}");
        }
        let general = |lemma: &str| net().generality(net().senses(lemma)[0].synset);
        assert!(general("entity") > general("artifact") && general("artifact") > general("vehicle"));
        assert_eq!(general("gallbladder"), 1, "nothing is more special");
        let renal = net().senses("renal")[0].synset;
        assert!(net().pertains_to(renal).any(|n| net().words_of(n).any(|w| w == "kidney")));
        let rear = net().senses("rear");
        assert!(rear.iter().any(|s| !net().is_noun(s.synset)));
    }

    #[test]
    fn plurals_have_their_singulars() {
        for (plural, singular) in [
            ("teeth", "tooth"),
            ("kidneys", "kidney"),
            ("arteries", "artery"),
            ("leaves", "leaf"),
            ("boxes", "box"),
            ("vertebrae", "vertebra"),
            ("ribs", "rib"),
            ("toothed whales", "toothed whale"),
        ] {
            assert!(net().dictionary_forms(plural).iter().any(|f| f == singular), "{plural}");
        }
        assert_eq!(net().dictionary_forms("glass"), ["glass"]);
        assert!(net().dictionary_forms("zzzs").is_empty());
    }

    #[test]
    fn a_damaged_index_is_refused() {
        assert!(WordNet::unpack(b"no index").is_err());
        let raw = zstd::bulk::decompress(PACKED, MAX_BYTES).unwrap();
        for cut in [4, 20, raw.len() / 2, raw.len() - 1] {
            let packed = zstd::bulk::compress(&raw[..cut], 1).unwrap();
            assert!(WordNet::unpack(&packed).is_err(), "{cut}");
        }
        let mut other = raw;
        other[3] ^= 1;
        assert!(WordNet::unpack(&zstd::bulk::compress(&other, 1).unwrap()).is_err());
    }
}
