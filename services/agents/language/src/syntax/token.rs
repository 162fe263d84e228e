//! Tokens of a text: words with lemmas, numbers, colour literals, quoted names, files, marks.

use std::sync::LazyLock;

use rust_stemmers::{Algorithm, Stemmer};
use winnow::Parser;
use winnow::ascii::{digit0, digit1, multispace0};
use winnow::combinator::{alt, opt, terminated};
use winnow::error::EmptyError;
use winnow::stream::{LocatingSlice, Stream as _};
use winnow::token::{any, one_of, take_while};

/// The kind of a token.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Kind {
    /// A word, or the possessive `'s`.
    Word,
    /// A number in digits, at least 0. A sign is a separate mark.
    Number(f64),
    /// A quoted name. The text of the token is without quotation marks.
    Quoted,
    /// A colour: `#rrggbb`, `rgb(…)` or another CSS function. RGB from 0 to 1.
    Color([f32; 3]),
    /// A file by its name or path, with one of [`FILE_ENDINGS`]. The text keeps its capitals.
    File,
    /// Any other character except white space.
    Mark(char),
}

/// Endings of the files that people name. A word with a dot and another ending is two sentences.
const FILE_ENDINGS: [&str; 30] = [
    ".ply", ".splat", ".ksplat", ".spz", ".sog", ".toml", ".sgproj", ".png", ".jpg", ".jpeg", ".webp", ".json", ".npy",
    ".nrrd", ".nhdr", ".nii", ".nii.gz", ".vti", ".raw", ".raw.gz", ".raw.zst", ".zst", ".mhd", ".mha", ".dcm", ".tif",
    ".tiff", ".h5", ".vtu", ".vtk",
];

/// Most characters of a path.
const MAX_PATH: usize = 1024;

/// Whether a text is the name or path of a file that people name: with a known ending, or from the root or the home folder.
pub(crate) fn is_file(text: &str) -> bool {
    let rooted = text.strip_prefix("~/").or_else(|| text.strip_prefix('/'));
    has_known_ending(text) || rooted.is_some_and(|rest| rest.starts_with(char::is_alphanumeric))
}

/// Whether a path ends as one of the files that people name.
pub(crate) fn has_known_ending(path: &str) -> bool {
    let name = path.rsplit('/').next().unwrap_or_default().to_lowercase();
    FILE_ENDINGS.iter().any(|ending| name.strip_suffix(ending).is_some_and(|stem| !stem.is_empty()))
}

/// A token with its position.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Token {
    /// The kind.
    pub(crate) kind: Kind,
    /// The text in lower case; a quotation and a file as they were written.
    pub(crate) text: String,
    /// The lemma: the stem of a word, or else the text.
    pub(crate) lemma: String,
    /// Offset of the first byte.
    pub(crate) start: usize,
    /// Offset after the last byte.
    pub(crate) end: usize,
}

impl Token {
    /// Whether the token is this word in any inflection.
    pub(crate) fn is(&self, word: &str) -> bool {
        self.kind == Kind::Word && (self.text == word || self.lemma == word)
    }

    /// Whether the token is this mark.
    pub(crate) fn is_mark(&self, mark: char) -> bool {
        self.kind == Kind::Mark(mark)
    }
}

static STEMMER: LazyLock<Stemmer> = LazyLock::new(|| Stemmer::create(Algorithm::English));

/// Irregular plurals that occur in names of structures.
const IRREGULAR: [(&str, &str); 26] = [
    ("leaves", "leaf"),
    ("calves", "calf"),
    ("halves", "half"),
    ("teeth", "tooth"),
    ("feet", "foot"),
    ("vertebrae", "vertebra"),
    ("aortae", "aorta"),
    ("trabeculae", "trabecula"),
    ("larvae", "larva"),
    ("hyphae", "hypha"),
    ("nebulae", "nebula"),
    ("supernovae", "supernova"),
    ("nuclei", "nucleus"),
    ("nucleoli", "nucleolus"),
    ("bronchi", "bronchus"),
    ("thrombi", "thrombus"),
    ("fungi", "fungus"),
    ("mitochondria", "mitochondrion"),
    ("ganglia", "ganglion"),
    ("septa", "septum"),
    ("atria", "atrium"),
    ("cilia", "cilium"),
    ("stomata", "stoma"),
    ("metastases", "metastasis"),
    ("stenoses", "stenosis"),
    ("haloes", "halo"),
];

/// Whether a lowercase word is an irregular plural.
pub(crate) fn is_irregular_plural(word: &str) -> bool {
    IRREGULAR.iter().any(|(plural, _)| *plural == word)
}

/// The lemma of a lowercase word. Words of other scripts are their own lemma.
pub(crate) fn lemma(word: &str) -> String {
    let singular = IRREGULAR.iter().find(|(plural, _)| *plural == word).map_or(word, |(_, singular)| singular);
    if singular.bytes().all(|b| b.is_ascii_lowercase()) {
        STEMMER.stem(singular).into_owned()
    } else {
        singular.to_owned()
    }
}

type Input<'s> = LocatingSlice<&'s str>;
type Outcome<O> = Result<O, EmptyError>;

/// Splits a text into tokens. Every text is valid.
pub(crate) fn tokens(source: &str) -> Vec<Token> {
    let mut input = LocatingSlice::new(source);
    let mut tokens: Vec<Token> = Vec::new();
    loop {
        let spaces: Outcome<&str> = multispace0.parse_next(&mut input);
        let before = tokens.last().filter(|_| spaces.is_ok_and(str::is_empty));
        let Ok(((kind, text), span)) = token(&mut input, before) else { break };
        let lemma = if kind == Kind::Word { lemma(&text) } else { text.clone() };
        tokens.push(Token { kind, text, lemma, start: span.start, end: span.end });
    }
    remove_hyphens(&mut tokens);
    tokens
}

/// The source text of some tokens.
pub(crate) fn text_of<'s>(source: &'s str, tokens: &[Token]) -> &'s str {
    match (tokens.first(), tokens.last()) {
        (Some(first), Some(last)) => source.get(first.start..last.end).unwrap_or_default(),
        _ => "",
    }
}

/// Whether the texts of the first tokens are these words.
pub(crate) fn begins_with(tokens: &[Token], words: &[&str]) -> bool {
    tokens.len() >= words.len() && words.iter().zip(tokens).all(|(word, token)| token.text == *word)
}

/// The lemmas of a name's words, without a leading article.
pub(crate) fn normalized_name(name: &str) -> Vec<String> {
    let mut lemmas: Vec<String> = tokens(name)
        .into_iter()
        .flat_map(|t| match t.kind {
            Kind::Quoted => normalized_name(&t.text),
            Kind::Mark(_) => Vec::new(),
            Kind::Word | Kind::Number(_) | Kind::Color(_) | Kind::File => vec![t.lemma],
        })
        .collect();
    if lemmas.len() > 1 && matches!(lemmas.first().map(String::as_str), Some("the" | "a" | "an")) {
        lemmas.remove(0);
    }
    lemmas
}

/// Removes hyphens and underscores inside words: `semi-transparent` is two words, `a - b` keeps its dash.
fn remove_hyphens(tokens: &mut Vec<Token>) {
    let is_hyphen: Vec<bool> = (0..tokens.len())
        .map(|i| {
            let (Some(before), Some(here), Some(after)) =
                (i.checked_sub(1).and_then(|b| tokens.get(b)), tokens.get(i), tokens.get(i + 1))
            else {
                return false;
            };
            let is_word = |t: &Token| matches!(t.kind, Kind::Word | Kind::Number(_));
            let hyphen = matches!(here.kind, Kind::Mark('-' | '_' | '\u{2010}' | '\u{2011}'));
            hyphen && is_word(before) && is_word(after) && before.end == here.start && here.end == after.start
        })
        .collect();
    let mut is_hyphen = is_hyphen.into_iter();
    tokens.retain(|_| !is_hyphen.next().unwrap_or(false));
}

/// Parses a token. `before` is the token that ends directly before it.
fn token(input: &mut Input<'_>, before: Option<&Token>) -> Outcome<((Kind, String), std::ops::Range<usize>)> {
    // An apostrophe directly after a word does not open a quotation.
    let behind_word = before.is_some_and(|t| t.kind == Kind::Word);
    let plural = before.is_some_and(|t| t.text.ends_with('s'));
    let apostrophe = |input: &mut Input<'_>| {
        if !behind_word {
            return Err(EmptyError);
        }
        alt((possessive, |i: &mut Input<'_>| if plural { plural_possessive(i) } else { Err(EmptyError) }))
            .parse_next(input)
    };
    let quotation = |input: &mut Input<'_>| if behind_word { Err(EmptyError) } else { quoted(input) };
    // Within a fraction or a choice, such as `1/2` and `and/or`, no path begins.
    let behind_text = before.is_some_and(|t| !matches!(t.kind, Kind::Mark(_)));
    let path = |input: &mut Input<'_>| if behind_text { Err(EmptyError) } else { file(input) };
    let mark = any.map(|c: char| (Kind::Mark(c), c.to_string()));
    alt((literal_color, path, apostrophe, quotation, number, plain_word, mark)).with_span().parse_next(input)
}

/// Parses a path up to a space, without the marks of the sentence behind it.
fn file(input: &mut Input<'_>) -> Outcome<(Kind, String)> {
    let start = input.checkpoint();
    let inside = |c: char| !c.is_whitespace() && !"\"'“”‘’„«»`()<>|,;!?".contains(c);
    let text: &str = take_while(1..=MAX_PATH, inside).parse_next(input)?;
    let path = text.trim_end_matches(['.', ':']);
    input.reset(&start);
    if !is_file(path) {
        return Err(EmptyError);
    }
    let length = path.chars().count();
    let path: &str = take_while(length..=length, inside).parse_next(input)?;
    Ok((Kind::File, path.to_owned()))
}

fn literal_color(input: &mut Input<'_>) -> Outcome<(Kind, String)> {
    let hexadecimal = ('#', take_while(3..=8, |c: char| c.is_ascii_hexdigit())).take();
    let function = (
        alt(("rgba", "rgb", "hsla", "hsl", "hwb", "oklch", "oklab", "lab", "lch")),
        multispace0,
        '(',
        take_while(1..=64, |c: char| c.is_ascii_alphanumeric() || " .,%/-+".contains(c)),
        ')',
    )
        .take();
    let text = terminated(alt((hexadecimal, function)), word_end).parse_next(input)?;
    let color = csscolorparser::parse(text).map_err(|_| EmptyError)?;
    let rgb = [color.r, color.g, color.b].map(|c| c.clamp(0.0, 1.0));
    if rgb.iter().all(|c| c.is_finite()) { Ok((Kind::Color(rgb), text.to_lowercase())) } else { Err(EmptyError) }
}

/// Succeeds if no letter or digit follows.
fn word_end(input: &mut Input<'_>) -> Outcome<()> {
    match input.peek_token() {
        Some(c) if c.is_alphanumeric() => Err(EmptyError),
        _ => Ok(()),
    }
}

fn quoted(input: &mut Input<'_>) -> Outcome<(Kind, String)> {
    let open: char = one_of(['"', '\'', '\u{201c}', '\u{201e}', '\u{2018}', '\u{00ab}', '`']).parse_next(input)?;
    let close: &[char] = match open {
        '"' => &['"'],
        '\'' => &['\''],
        '\u{2018}' => &['\u{2019}'],
        '\u{00ab}' => &['\u{00bb}'],
        '`' => &['`', '\''],
        _ => &['\u{201c}', '\u{201d}', '"'],
    };
    let text = take_while(1..=256, |c: char| !close.contains(&c) && c != '\n').parse_next(input)?;
    one_of(close).parse_next(input)?;
    word_end.parse_next(input)?;
    let text: &str = text;
    if text.trim().is_empty() { Err(EmptyError) } else { Ok((Kind::Quoted, text.trim().to_owned())) }
}

fn number(input: &mut Input<'_>) -> Outcome<(Kind, String)> {
    let text: &str = alt(((digit1, opt(('.', digit1))).take(), ('.', digit1, digit0).take())).parse_next(input)?;
    let value: f64 = text.parse().map_err(|_| EmptyError)?;
    if value.is_finite() { Ok((Kind::Number(value), text.to_owned())) } else { Err(EmptyError) }
}

fn is_apostrophe(c: char) -> bool {
    c == '\'' || c == '\u{2019}'
}

/// Parses `'s` after a word.
fn possessive(input: &mut Input<'_>) -> Outcome<(Kind, String)> {
    (one_of(is_apostrophe), one_of(['s', 'S']), word_end).parse_next(input)?;
    Ok((Kind::Word, "'s".to_owned()))
}

/// Parses the apostrophe after a plural.
fn plural_possessive(input: &mut Input<'_>) -> Outcome<(Kind, String)> {
    (one_of(is_apostrophe), word_end).parse_next(input)?;
    Ok((Kind::Word, "'s".to_owned()))
}

fn plain_word(input: &mut Input<'_>) -> Outcome<(Kind, String)> {
    let first: char = any.parse_next(input)?;
    if !first.is_alphabetic() {
        return Err(EmptyError);
    }
    let mut text = String::from(first);
    loop {
        let rest: &str = take_while(0.., |c: char| c.is_alphanumeric()).parse_next(input)?;
        text.push_str(rest);
        // A contraction ("don't") is one token; the possessive is a token of its own.
        let start = input.checkpoint();
        let contraction = opt((one_of(is_apostrophe), take_while(1.., char::is_alphabetic))).parse_next(input)?;
        match contraction {
            Some((_, tail)) if tail != "s" && tail != "S" => {
                text.push('\'');
                text.push_str(tail);
            }
            _ => {
                input.reset(&start);
                break;
            }
        }
    }
    Ok((Kind::Word, text.to_lowercase()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(source: &str) -> Vec<String> {
        tokens(source).into_iter().map(|t| t.text).collect()
    }

    #[test]
    fn words_numbers_and_marks_are_tokens() {
        assert_eq!(texts("Fade it to 20%, please!"), ["fade", "it", "to", "20", "%", ",", "please", "!"]);
        assert_eq!(
            texts("the sac's semi-transparent vessel_1"),
            ["the", "sac", "'s", "semi", "transparent", "vessel", "1"]
        );
        assert_eq!(texts("don't zoom 2x - .5"), ["don't", "zoom", "2", "x", "-", ".5"]);
        assert_eq!(texts("Größe des Äderchens"), ["größe", "des", "äderchens"]);
    }

    #[test]
    fn colours_and_quotes_are_tokens() {
        let all = tokens("paint it #ff8800 or rgb(0, 128, 255)");
        assert_eq!(all[2].kind, Kind::Color([1.0, f32::from(0x88_u8) / 255.0, 0.0]));
        assert_eq!(all[4].kind, Kind::Color([0.0, 128.0 / 255.0, 1.0]));
        let all = tokens("label it 'Left Root' now");
        assert_eq!((all[2].kind.clone(), all[2].text.as_str()), (Kind::Quoted, "Left Root"));
        assert_eq!(
            texts("the vessels' hue and the pots' hue"),
            ["the", "vessels", "'s", "hue", "and", "the", "pots", "'s", "hue"]
        );
        assert_eq!(texts("call it 'left roots'"), ["call", "it", "left roots"]);
    }

    #[test]
    fn files_are_one_token_and_sentences_are_not() {
        let all = tokens("save it as ~/Hearts/Left_Sac.compressed.ply, then open scan-2.NII.gz.");
        assert_eq!((all[3].kind.clone(), all[3].text.as_str()), (Kind::File, "~/Hearts/Left_Sac.compressed.ply"));
        assert_eq!(texts("open scan-2.NII.gz."), ["open", "scan-2.NII.gz", "."]);
        assert_eq!(tokens("open ~/hearts")[1].kind, Kind::File);
        for said in
            ["hide it.Make it red", "1/2", "and/or", "/", "~/ x", "zoom 2.5x", "opacity .5", ".ply", "e.g. the sac"]
        {
            assert!(tokens(said).iter().all(|t| t.kind != Kind::File), "{said}");
        }
    }

    #[test]
    fn offsets_are_character_boundaries() {
        let source = "Größe 3 “Ä b”";
        for token in tokens(source) {
            assert!(source.get(token.start..token.end).is_some(), "{token:?}");
        }
    }

    #[test]
    fn inflections_share_a_lemma() {
        for (a, b) in [("leaves", "leaf"), ("vessels", "vessel"), ("hiding", "hide"), ("nuclei", "nucleus")] {
            assert_eq!(lemma(a), lemma(b));
        }
    }
}
