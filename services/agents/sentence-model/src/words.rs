//! Words of a sentence with what a gazetteer knows of them: names of the scene, colours and numbers.

use std::ops::Range;
use std::sync::LazyLock;

use rust_stemmers::{Algorithm, Stemmer};

static STEMMER: LazyLock<Stemmer> = LazyLock::new(|| Stemmer::create(Algorithm::English));

/// Numbers in words. "One" is a pronoun as well.
const NUMBERS: &str = "zero two three four five six seven eight nine ten eleven twelve thirteen fourteen fifteen sixteen seventeen \
 eighteen nineteen twenty thirty forty fifty sixty seventy eighty ninety hundred half quarter third fifth tenth";

/// What a gazetteer knows of a word.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Kind {
    Plain,
    Number,
    Color,
    /// A name of the scene.
    Name,
    Mark,
}

/// A word of a sentence.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Word {
    /// The word in lower case.
    pub(crate) text: String,
    stem: String,
    pub(crate) kind: Kind,
    /// Its bytes in the sentence.
    pub(crate) place: Range<usize>,
}

impl Word {
    /// The stem of the word, without what differs from scene to scene.
    pub(crate) fn key(&self) -> &str {
        match self.kind {
            Kind::Plain | Kind::Mark => &self.stem,
            Kind::Number => "<number>",
            Kind::Color => "<color>",
            Kind::Name => "<name>",
        }
    }
}

/// The words of names, for [`words`].
#[derive(Debug, Default)]
pub(crate) struct Names(Vec<Vec<String>>);

impl Names {
    pub(crate) fn of<'n>(names: impl IntoIterator<Item = &'n str>) -> Self {
        let stems = |name: &str| split(name).map(|place| stem(&name[place].to_lowercase())).collect::<Vec<_>>();
        Self(names.into_iter().map(stems).filter(|stems| !stems.is_empty()).collect())
    }

    /// Number of words of the longest name that begins here.
    fn length_at(&self, words: &[Word]) -> usize {
        let fits = |name: &&Vec<String>| {
            name.len() <= words.len() && name.iter().zip(words).all(|(stem, word)| *stem == word.stem)
        };
        self.0.iter().filter(fits).map(Vec::len).max().unwrap_or(0)
    }
}

fn stem(word: &str) -> String {
    if word.bytes().all(|b| b.is_ascii_lowercase()) { STEMMER.stem(word).into_owned() } else { word.to_owned() }
}

/// Places of the words of a text: letters and digits together, the possessive and each mark alone. Hyphens part words.
fn split(text: &str) -> impl Iterator<Item = Range<usize>> {
    let is_apostrophe = |c: char| matches!(c, '\'' | '\u{2019}');
    let is_inside = |c: char| c.is_alphanumeric() || c == '#';
    let mut rest = 0;
    std::iter::from_fn(move || {
        let mut letters = text.get(rest..)?.char_indices().map(|(i, c)| (i + rest, c)).peekable();
        while letters.next_if(|(_, c)| c.is_whitespace() || "-_\u{2010}\u{2011}\"“”".contains(*c)).is_some() {}
        let (start, first) = letters.next()?;
        let mut end = start + first.len_utf8();
        if is_apostrophe(first) && text[end..].starts_with(['s', 'S']) && !text[end + 1..].starts_with(is_inside) {
            end += 1;
        } else if is_inside(first) {
            for (at, c) in letters {
                // A contraction is one word, a possessive is not, and a decimal point belongs to its number.
                let behind = text[at + c.len_utf8()..].chars().take_while(|c| is_inside(*c)).collect::<String>();
                let contracts = is_apostrophe(c) && !behind.is_empty() && !behind.eq_ignore_ascii_case("s");
                let is_point = c == '.' && behind.starts_with(|c: char| c.is_ascii_digit());
                if !(is_inside(c) || contracts || is_point) {
                    break;
                }
                end = at + c.len_utf8();
            }
        }
        rest = end;
        Some(start..end)
    })
}

/// The words of a text.
pub(crate) fn words(text: &str, names: &Names) -> Vec<Word> {
    let word = |place: Range<usize>| {
        let said = text[place.clone()].to_lowercase().replace('\u{2019}', "'");
        let kind = if !said.contains(char::is_alphanumeric) {
            Kind::Mark
        } else if said.starts_with(|c: char| c.is_ascii_digit()) || NUMBERS.split(' ').any(|number| number == said) {
            Kind::Number
        } else if said.starts_with('#') || sg_color::is_word(&said) {
            Kind::Color
        } else {
            Kind::Plain
        };
        Word { stem: stem(&said), text: said, kind, place }
    };
    let mut words: Vec<Word> = split(text).map(word).collect();
    let mut at = 0;
    while at < words.len() {
        let length = names.length_at(&words[at..]);
        words[at..at + length].iter_mut().for_each(|word| word.kind = Kind::Name);
        at += length.max(1);
    }
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(text: &str) -> Vec<String> {
        words(text, &Names::default()).into_iter().map(|word| word.text).collect()
    }

    #[test]
    fn a_sentence_is_parted_into_words_and_marks() {
        assert_eq!(
            texts("Don't hide the sac's see-through wall!"),
            ["don't", "hide", "the", "sac", "'s", "see", "through", "wall", "!"]
        );
        assert_eq!(texts("0.4, 30% or #FF8800"), ["0.4", ",", "30", "%", "or", "#ff8800"]);
        assert_eq!(texts("Größe ’s “Ä”"), ["größe", "'s", "ä"]);
        assert!(texts("  ").is_empty());
    }

    #[test]
    fn a_gazetteer_marks_names_colours_and_numbers() {
        let names = Names::of(["left ventricle", "bone"]);
        let kinds: Vec<Kind> = words("Left ventricles white, bones 30", &names).into_iter().map(|w| w.kind).collect();
        assert_eq!(kinds, [Kind::Name, Kind::Name, Kind::Color, Kind::Mark, Kind::Name, Kind::Number]);
    }

    #[test]
    fn places_are_those_of_the_text() {
        let text = "Fade “Ädern” to ½, it’s fine";
        for word in words(text, &Names::default()) {
            assert_eq!(text[word.place.clone()].to_lowercase().replace('’', "'"), word.text);
        }
    }
}
