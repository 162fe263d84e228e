//! Example sentences with their slots, and values that fill the slots.

use std::collections::BTreeMap;

use rand::RngExt as _;
use rand_chacha::ChaCha8Rng;

use crate::words::{Names, Word, words};

/// A part of a sentence whose value differs from one sentence to another.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Slot {
    /// A structure of the scene, or several.
    Thing,
    /// A second structure.
    Other,
    /// A colour.
    Color,
    /// An opacity.
    Amount,
    /// An angle.
    Angle,
    /// A number of steps.
    Count,
    /// A side of the scene.
    Side,
    /// A name that is given.
    Name,
    /// The name of a kept viewpoint.
    Kept,
}

impl Slot {
    /// All slots.
    pub const ALL: [Self; 9] = [
        Self::Thing,
        Self::Other,
        Self::Color,
        Self::Amount,
        Self::Angle,
        Self::Count,
        Self::Side,
        Self::Name,
        Self::Kept,
    ];

    /// Its name in braces.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Thing => "thing",
            Self::Other => "other",
            Self::Color => "color",
            Self::Amount => "amount",
            Self::Angle => "angle",
            Self::Count => "count",
            Self::Side => "side",
            Self::Name => "name",
            Self::Kept => "kept",
        }
    }

    /// The slot in braces, as commands have it.
    #[must_use]
    pub fn marked(self) -> String {
        format!("{{{}}}", self.name())
    }
}

/// Names that the scenes of examples have.
const NAMES: [&str; 26] = [
    "vessels", "bone", "tissue", "sac", "clip", "halo", "disk", "leaf", "trunk", "hull", "rotor", "enamel", "root",
    "petal", "filament", "shell", "brain", "skin", "muscle", "artery", "vein", "handle", "core", "lobe", "cyst",
    "stem",
];

/// Values of slots for which the files of examples have none.
const VALUES: [(Slot, &[&str]); 5] = [
    (Slot::Angle, &["30 degrees", "ninety degrees", "45°", "ten degrees", "180 degrees", "a quarter turn", "15 deg"]),
    (Slot::Count, &["three", "2", "five", "two", "4"]),
    (
        Slot::Side,
        &["left", "right", "top", "above", "below", "front", "back", "behind", "bottom", "underneath", "rear"],
    ),
    (
        Slot::Name,
        &[
            "dome",
            "my cut",
            "left lobe",
            "target one",
            "bleb",
            "candidate A",
            "the neck",
            "blister",
            "outer wall",
            "region 3",
            "arm two",
            "foo",
        ],
    ),
    (Slot::Kept, &["entry", "overview", "lateral", "home", "poster view", "start", "view 2", "close up"]),
];

/// Sections behind the sentences of a file, and the slots whose values they list.
const SECTIONS: [(&str, Slot); 3] = [("things", Slot::Thing), ("colors", Slot::Color), ("amounts", Slot::Amount)];

/// A fault in a file of examples.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{file}, line {line}: {fault}")]
pub struct ExampleError {
    /// Name of the file.
    pub file: String,
    /// Number of the line, from 1.
    pub line: usize,
    /// What is wrong.
    pub fault: String,
}

/// A part of an example.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Piece {
    Text(String),
    /// A slot, with the value that the example itself has.
    Slot(Slot, Option<String>),
}

/// A sentence with slots.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Template {
    /// Position of its file.
    author: usize,
    command: usize,
    pieces: Vec<Piece>,
}

/// Sentences with slots, the commands that they mean, and values of the slots.
#[derive(Debug, Clone, Default)]
pub struct Examples {
    commands: Vec<String>,
    templates: Vec<Template>,
    /// Values by their slot, each with its author.
    values: BTreeMap<Slot, Vec<(usize, String)>>,
}

/// A sentence with the command that it means and the slot of each word.
#[derive(Debug, Clone)]
pub(crate) struct Filled {
    /// Position of its template.
    pub(crate) template: usize,
    pub(crate) command: usize,
    pub(crate) words: Vec<Word>,
    pub(crate) slots: Vec<Option<Slot>>,
}

/// A sentence as somebody may say it, and what it means.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Spoken {
    /// The sentence in lower case.
    pub text: String,
    /// Position of the command that it means.
    pub command: usize,
    /// Slots with their words, in the order of the sentence.
    pub slots: Vec<(Slot, String)>,
}

impl Spoken {
    fn of(filled: &Filled) -> Self {
        let mut slots: Vec<(Slot, Vec<&str>)> = Vec::new();
        let mut before = None;
        for (word, slot) in filled.words.iter().zip(&filled.slots) {
            match (slot, slots.last_mut()) {
                (Some(slot), Some((_, said))) if before == Some(*slot) => said.push(&word.text),
                (Some(slot), _) => slots.push((*slot, vec![&word.text])),
                (None, _) => {}
            }
            before = *slot;
        }
        let said: Vec<&str> = filled.words.iter().map(|word| word.text.as_str()).collect();
        let slots = slots.into_iter().map(|(slot, said)| (slot, said.join(" "))).collect();
        Self { text: said.join(" "), command: filled.command, slots }
    }
}

impl Examples {
    /// Reads files of examples: their names and texts, one author each.
    ///
    /// A line has a command, a tab and a sentence. Behind `# things`, `# colors` and `# amounts` stand values of slots, one a line.
    /// Other lines that begin with `#` are comments.
    ///
    /// # Errors
    /// [`ExampleError`]: a line has no tab, an open brace, or a slot that its command lacks.
    pub fn parse<'t>(files: impl IntoIterator<Item = (&'t str, &'t str)>) -> Result<Self, ExampleError> {
        let mut examples = Self::default();
        for (author, (file, text)) in files.into_iter().enumerate() {
            let mut section = None;
            for (at, line) in text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()) {
                if let Some(comment) = line.strip_prefix("# ") {
                    let begins = SECTIONS.iter().find(|(name, _)| *name == comment.trim());
                    section = begins.map(|(_, slot)| *slot).or(section);
                } else if let Some(slot) = section {
                    examples.values.entry(slot).or_default().push((author, line.trim().to_owned()));
                } else if let Err(fault) = examples.add(author, line) {
                    return Err(ExampleError { file: file.to_owned(), line: at + 1, fault });
                }
            }
        }
        for (slot, values) in VALUES {
            let values = values.iter().map(|value| (usize::MAX, (*value).to_owned()));
            examples.values.entry(slot).or_default().extend(values);
        }
        Ok(examples)
    }

    fn add(&mut self, author: usize, line: &str) -> Result<(), String> {
        let (command, sentence) = line.split_once('\t').ok_or("no tab between command and sentence")?;
        let pieces = pieces(sentence)?;
        for piece in &pieces {
            if let Piece::Slot(slot, _) = piece
                && !command.contains(&slot.marked())
                && command.chars().any(char::is_lowercase)
            {
                return Err(format!("the command “{command}” has no slot {}", slot.marked()));
            }
        }
        let known = self.commands.iter().position(|other| other == command);
        let command = known.unwrap_or_else(|| {
            self.commands.push(command.to_owned());
            self.commands.len() - 1
        });
        self.templates.push(Template { author, command, pieces });
        Ok(())
    }

    /// The commands, in the order of their first sentences.
    #[must_use]
    pub fn commands(&self) -> &[String] {
        &self.commands
    }

    /// Number of sentences.
    #[must_use]
    pub fn len(&self) -> usize {
        self.templates.len()
    }

    /// Whether there is no sentence.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.templates.is_empty()
    }

    /// The examples of all authors but one, and those of that one. Both know all commands.
    #[must_use]
    pub fn without_author(&self, author: usize) -> (Self, Self) {
        let part = |keep: &dyn Fn(usize) -> bool| {
            let values = |values: &[(usize, String)]| {
                values.iter().filter(|(by, _)| *by == usize::MAX || keep(*by)).cloned().collect::<Vec<_>>()
            };
            Self {
                commands: self.commands.clone(),
                templates: self.templates.iter().filter(|template| keep(template.author)).cloned().collect(),
                values: self.values.iter().map(|(slot, all)| (*slot, values(all))).collect(),
            }
        };
        (part(&|by| by != author), part(&|by| by == author))
    }

    /// Each sentence once, with values in its slots.
    pub fn spoken(&self, random: &mut ChaCha8Rng) -> Vec<Spoken> {
        (0..self.templates.len()).map(|template| Spoken::of(&self.fill(template, random))).collect()
    }

    /// Names and descriptions of things.
    pub(crate) fn things(&self) -> impl Iterator<Item = &str> {
        let listed = self.values.get(&Slot::Thing).into_iter().flatten().map(|(_, value)| value.as_str());
        let own = self.templates.iter().flat_map(|template| &template.pieces).filter_map(|piece| match piece {
            Piece::Slot(Slot::Thing | Slot::Other, own) => own.as_deref(),
            _ => None,
        });
        listed.chain(own).chain(NAMES)
    }

    /// Names of the scenes in which the sentences are said.
    pub(crate) fn names() -> Names {
        Names::of(NAMES)
    }

    /// Each sentence some times, with other values in its slots.
    pub(crate) fn filled(&self, times: usize, random: &mut ChaCha8Rng) -> Vec<Filled> {
        let mut all = Vec::with_capacity(times * self.templates.len());
        for template in 0..self.templates.len() {
            all.extend((0..times).map(|_| self.fill(template, random)));
        }
        all
    }

    fn fill(&self, template: usize, random: &mut ChaCha8Rng) -> Filled {
        const ARTICLES: [&str; 8] = ["the", "a", "an", "that", "this", "those", "my", "both"];
        let Template { command, pieces, .. } = &self.templates[template];
        let names = Self::names();
        let mut filled = Filled { template, command: *command, words: Vec::new(), slots: Vec::new() };
        for piece in pieces {
            let (text, slot) = match piece {
                Piece::Text(text) => (text.clone(), None),
                Piece::Slot(slot, Some(own)) => (own.clone(), Some(*slot)),
                Piece::Slot(slot, None) => (self.value(*slot, random), Some(*slot)),
            };
            let mut added = words(&text, &names);
            let is_article = |word: Option<&Word>| word.is_some_and(|word| ARTICLES.contains(&word.text.as_str()));
            // "The" before a slot whose value has an article already.
            if slot.is_some() && is_article(filled.words.last()) && is_article(added.first()) {
                added.remove(0);
            }
            filled.slots.extend(added.iter().map(|_| slot));
            filled.words.extend(added);
        }
        filled
    }

    /// A value for a slot. Half of the things have the name that their scene gives them.
    fn value(&self, slot: Slot, random: &mut ChaCha8Rng) -> String {
        let is_thing = matches!(slot, Slot::Thing | Slot::Other);
        let kind = if is_thing { Slot::Thing } else { slot };
        let values = self.values.get(&kind).map(Vec::as_slice).unwrap_or_default();
        if is_thing && (values.is_empty() || random.random_bool(0.5)) {
            let name = |random: &mut ChaCha8Rng| NAMES[random.random_range(0..NAMES.len())];
            let (first, second) = (name(random), name(random));
            return match random.random_range(0..10) {
                0..=2 => first.to_owned(),
                3..=8 => format!("the {first}"),
                _ => format!("the {first} and the {second}"),
            };
        }
        if values.is_empty() { String::new() } else { values[random.random_range(0..values.len())].1.clone() }
    }
}

/// The parts of a sentence.
fn pieces(sentence: &str) -> Result<Vec<Piece>, String> {
    let mut pieces = Vec::new();
    let mut rest = sentence;
    while let Some((before, behind)) = rest.split_once('{') {
        if !before.trim().is_empty() {
            pieces.push(Piece::Text(before.to_owned()));
        }
        let (inside, after) = behind.split_once('}').ok_or("a brace is open")?;
        let (name, own) = inside.split_once(':').map_or((inside, None), |(name, own)| (name, Some(own.trim())));
        let slot = Slot::ALL.into_iter().find(|slot| slot.name() == name.trim());
        let slot = slot.ok_or_else(|| format!("no slot is called “{name}”"))?;
        pieces.push(Piece::Slot(slot, own.map(str::to_owned)));
        rest = after;
    }
    if !rest.trim().is_empty() {
        pieces.push(Piece::Text(rest.to_owned()));
    }
    if pieces.is_empty() { Err("the sentence is empty".to_owned()) } else { Ok(pieces) }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng as _;

    use super::*;

    #[test]
    fn sentences_and_values_of_a_file_are_read() {
        let text =
            "make {thing} {color}\tdip {thing:the old sac} in {color}\nOUT\tbook me a {color} flight\n# colors\nteal\n";
        let examples = Examples::parse([("one", text)]).unwrap();
        assert_eq!(examples.commands(), ["make {thing} {color}", "OUT"]);
        let spoken = examples.spoken(&mut ChaCha8Rng::seed_from_u64(1));
        let slots = vec![(Slot::Thing, "the old sac".to_owned()), (Slot::Color, "teal".to_owned())];
        assert_eq!(spoken[0], Spoken { text: "dip the old sac in teal".to_owned(), command: 0, slots });
        assert_eq!(spoken[1].text, "book me a teal flight");
    }

    #[test]
    fn a_fault_names_its_line() {
        for (text, fault) in [
            ("undo\ttake it back\nundo take it back", "no tab"),
            ("undo\ttake {it back", "open"),
            ("hide {thing}\tpaint {thing} {color}", "no slot {color}"),
            ("hide {thing}\tpaint {stuff}", "no slot is called “stuff”"),
            ("undo\t", "empty"),
        ] {
            let error = Examples::parse([("one", text)]).unwrap_err();
            assert_eq!(error.line, text.lines().count(), "{error}");
            assert!(error.to_string().contains(fault), "{error}");
        }
    }

    #[test]
    fn an_author_can_be_held_out() {
        let (first, second) = ("undo\tback one\n# colors\nteal", "redo\tonce more\n# colors\nrust");
        let examples = Examples::parse([("one", first), ("two", second)]).unwrap();
        let (rest, held) = examples.without_author(1);
        assert_eq!((rest.len(), held.len()), (1, 1));
        assert_eq!(rest.commands(), held.commands());
        assert_eq!(rest.values[&Slot::Color], [(0, "teal".to_owned())]);
    }
}
