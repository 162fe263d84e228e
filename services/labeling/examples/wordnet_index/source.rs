//! From the files of WordNet 3.0 (`wndb(5)`) to the bytes of the index. `services/labeling/src/wordnet.rs` documents and reads them.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::Path;

/// The first bytes of an index.
const MAGIC: &[u8; 8] = b"SGWN0001";

/// A synset of `data.noun` or `data.adj`.
struct Synset {
    lemmas: Vec<String>,
    /// More general nouns, or the head of an adjective's cluster.
    parents: Vec<usize>,
    /// Nouns that an adjective pertains to: "renal" to "kidney".
    pertains: Vec<usize>,
    /// Wholes that a noun is a part of.
    wholes: Vec<usize>,
}

/// The bytes of the index, unpacked.
///
/// Of the parts of wholes those stay that are of the same kind as the whole, as the cranium and the skull are bones: people use such
/// words for one another. Named instances ("Paris") are left out, and so are names whose last word has a capital ("family Felidae"): labels seldom contain them,
/// and misspelled words would find them.
///
/// # Errors
/// A file is missing or is not of WordNet's format.
pub(crate) fn index(folder: &Path) -> Result<Vec<u8>, String> {
    let nouns = Part::read(folder, "noun")?;
    let adjectives = Part::read(folder, "adj")?;
    let mut written = Written::default();
    written.part(&nouns);
    let count = written.depths.len();
    let numbers = written.numbers.clone();
    written.part(&adjectives);
    let adjective_numbers = std::mem::replace(&mut written.numbers, numbers);
    for (offset, synset) in &adjectives.synsets {
        for noun in &synset.pertains {
            if let (Some(from), Some(to)) = (adjective_numbers.get(offset), written.numbers.get(noun)) {
                written.pertains.push((*from, *to));
            }
        }
    }
    written.pertains.sort_unstable();
    written.extra.sort_unstable();
    written.wholes.sort_unstable();
    let exceptions = exceptions(folder, &written.words)?;
    Ok(written.bytes(count as u32, &exceptions))
}

/// One part of speech.
struct Part {
    synsets: BTreeMap<usize, Synset>,
    /// Rank of a sense by (normalized lemma, synset): 0 is the most frequent.
    ranks: HashMap<(String, usize), u8>,
}

fn text(folder: &Path, name: &str) -> Result<String, String> {
    let path = folder.join(name);
    std::fs::read_to_string(&path).map_err(|e| format!("{}: {e}; install the package wordnet-base", path.display()))
}

/// A lemma as queries are normalized: lower case, words apart by spaces, no marks.
fn normalized(lemma: &str) -> String {
    let bare = lemma.split('(').next().unwrap_or_default();
    bare.chars()
        .filter(|c| !matches!(c, '\'' | '.' | '/'))
        .map(|c| if matches!(c, '_' | '-') { ' ' } else { c.to_ascii_lowercase() })
        .collect()
}

fn is_kept(lemma: &str) -> bool {
    lemma.split(['_', '-']).next_back().is_some_and(|w| !w.starts_with(|c: char| c.is_ascii_uppercase()))
}

impl Part {
    fn read(folder: &Path, part: &str) -> Result<Self, String> {
        let mut synsets = BTreeMap::new();
        let data = text(folder, &format!("data.{part}"))?;
        for line in data.lines().filter(|l| !l.starts_with(' ')) {
            let (offset, synset) = synset(line).ok_or_else(|| format!("data.{part}: `{line}` is no synset"))?;
            if let Some(synset) = synset {
                synsets.insert(offset, synset);
            }
        }
        let mut ranks = HashMap::new();
        let index = text(folder, &format!("index.{part}"))?;
        for line in index.lines().filter(|l| !l.starts_with(' ')) {
            let fields: Vec<&str> = line.split_whitespace().collect();
            let lemma = fields.first().copied().unwrap_or_default();
            let senses = fields.iter().filter(|f| f.len() == 8 && f.bytes().all(|b| b.is_ascii_digit()));
            for (rank, offset) in senses.enumerate() {
                let offset = offset.parse().map_err(|e| format!("index.{part}: `{line}`: {e}"))?;
                let rank = rank.min(255) as u8;
                let known = ranks.entry((normalized(lemma), offset)).or_insert(rank);
                *known = rank.min(*known);
            }
        }
        Ok(Self { synsets, ranks })
    }
}

/// Offset and synset of a line of a data file. The inner `None` is a named instance.
#[allow(clippy::option_option, reason = "a line may be wrong, or right and left out")]
fn synset(line: &str) -> Option<(usize, Option<Synset>)> {
    let mut fields = line.split('|').next()?.split_whitespace();
    let offset = fields.next()?.parse().ok()?;
    let (_file, kind) = (fields.next()?, fields.next()?);
    let words = usize::from_str_radix(fields.next()?, 16).ok()?;
    let mut lemmas: Vec<String> = Vec::new();
    for _ in 0..words {
        let lemma = fields.next()?;
        fields.next()?;
        let key = normalized(lemma);
        if is_kept(lemma) && !lemmas.contains(&key) && !key.is_empty() {
            lemmas.push(key);
        }
    }
    let pointers: usize = fields.next()?.parse().ok()?;
    let mut synset = Synset { lemmas, parents: Vec::new(), pertains: Vec::new(), wholes: Vec::new() };
    let mut is_instance = false;
    for _ in 0..pointers {
        let (symbol, to, part) = (fields.next()?, fields.next()?.parse().ok()?, fields.next()?);
        fields.next()?;
        // A satellite names its head, and a head its satellites.
        match (symbol, part) {
            ("@", "n") => synset.parents.push(to),
            ("&", "a") if kind == "s" => synset.parents.push(to),
            ("@i", _) => is_instance = true,
            ("#p", "n") => synset.wholes.push(to),
            ("\\", "n") => synset.pertains.push(to),
            _ => {}
        }
    }
    Some((offset, (!is_instance).then_some(synset)))
}

/// Irregular plurals of known words: "teeth tooth".
fn exceptions(folder: &Path, known: &BTreeSet<String>) -> Result<String, String> {
    let mut lines = String::new();
    for line in text(folder, "noun.exc")?.lines() {
        let mut words = line.split(' ');
        if let (Some(plural), Some(singular)) = (words.next(), words.next())
            && known.contains(&normalized(singular))
        {
            lines.push_str(&format!("{}\t{}\n", normalized(plural), normalized(singular)));
        }
    }
    Ok(lines)
}

/// The columns of the index.
#[derive(Default)]
struct Written {
    depths: Vec<u8>,
    text: String,
    ranks: Vec<u8>,
    extra: Vec<(u32, u32)>,
    pertains: Vec<(u32, u32)>,
    wholes: Vec<(u32, u32)>,
    numbers: HashMap<usize, u32>,
    words: BTreeSet<String>,
}

impl Written {
    /// Appends a part of speech: its trees, each parent before its children.
    fn part(&mut self, part: &Part) {
        self.numbers.clear();
        let mut children: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        let mut stack: Vec<(usize, u8)> = Vec::new();
        for (offset, synset) in part.synsets.iter().rev() {
            match synset.parents.iter().find(|p| part.synsets.contains_key(p)) {
                Some(parent) => children.entry(*parent).or_default().push(*offset),
                None => stack.push((*offset, 0)),
            }
        }
        while let Some((offset, depth)) = stack.pop() {
            let Some(synset) = part.synsets.get(&offset).filter(|_| !self.numbers.contains_key(&offset)) else {
                continue;
            };
            self.numbers.insert(offset, self.depths.len() as u32);
            self.depths.push(depth);
            for lemma in &synset.lemmas {
                self.text.push_str(lemma);
                self.text.push('\t');
                self.ranks.push(part.ranks.get(&(lemma.clone(), offset)).copied().unwrap_or(255));
                self.words.insert(lemma.clone());
            }
            self.text.push('\n');
            stack.extend(children.get(&offset).into_iter().flatten().map(|child| (*child, depth.saturating_add(1))));
        }
        for (offset, synset) in &part.synsets {
            let kin = |whole: &&usize| {
                part.synsets.get(whole).is_some_and(|w| w.parents.iter().any(|p| synset.parents.contains(p)))
            };
            for whole in synset.wholes.iter().filter(kin) {
                if let (Some(own), Some(whole)) = (self.numbers.get(offset), self.numbers.get(whole)) {
                    self.wholes.push((*own, *whole));
                }
            }
            let first = synset.parents.iter().find(|p| part.synsets.contains_key(p));
            for parent in synset.parents.iter().filter(|p| Some(*p) != first) {
                if let (Some(child), Some(parent)) = (self.numbers.get(offset), self.numbers.get(parent)) {
                    self.extra.push((*child, *parent));
                }
            }
        }
    }

    fn bytes(&self, nouns: u32, exceptions: &str) -> Vec<u8> {
        let mut bytes = MAGIC.to_vec();
        bytes.extend(nouns.to_le_bytes());
        let mut section = |content: &[u8]| {
            bytes.extend((content.len() as u32).to_le_bytes());
            bytes.extend(content);
        };
        // Pairs by columns: the first column grows, so its differences are small.
        let pairs = |pairs: &[(u32, u32)]| {
            let before = std::iter::once(0).chain(pairs.iter().map(|p| p.0));
            let from = pairs.iter().zip(before).flat_map(|(p, b)| (p.0 - b).to_le_bytes());
            from.chain(pairs.iter().flat_map(|p| p.1.to_le_bytes())).collect::<Vec<u8>>()
        };
        section(&self.depths);
        section(self.text.as_bytes());
        section(&self.ranks);
        section(&pairs(&self.extra));
        section(&pairs(&self.pertains));
        section(&pairs(&self.wholes));
        section(exceptions.as_bytes());
        bytes
    }
}
