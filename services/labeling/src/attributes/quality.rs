//! Words for visual attributes.

use sg_color::Color;

/// A quality that a word names, without its colour words.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Quality {
    /// Large beside the others.
    Large,
    /// Small beside the others.
    Small,
    /// Much longer than wide: filament-like.
    Long,
    /// Small in at least one direction: a filament or a sheet.
    Thin,
    /// The opposite of thin.
    Thick,
    /// Sheet-like.
    Flat,
    /// Ball-like.
    Round,
    /// Higher than wide.
    Tall,
    /// To the left.
    Left,
    /// To the right.
    Right,
    /// At the top.
    Top,
    /// At the bottom.
    Bottom,
    /// At the front.
    Front,
    /// At the back.
    Back,
    /// In the middle.
    Middle,
    /// Lets light through.
    Transparent,
    /// Lets no light through.
    Opaque,
    /// Many Gaussians for its size.
    Dense,
    /// Few Gaussians for its size.
    Sparse,
    /// Of a dark colour.
    Dark,
    /// Of a light colour.
    Bright,
}

impl Quality {
    /// The opposite quality on the same axis of the frame, for places.
    #[must_use]
    pub fn opposite_place(self) -> Option<Self> {
        Some(match self {
            Self::Left => Self::Right,
            Self::Right => Self::Left,
            Self::Top => Self::Bottom,
            Self::Bottom => Self::Top,
            Self::Front => Self::Back,
            Self::Back => Self::Front,
            _ => return None,
        })
    }

    /// Whether the quality is one unit's alone, without a look at the others.
    #[must_use]
    pub fn is_absolute(self) -> bool {
        use Quality::{Bright, Dark, Flat, Long, Opaque, Round, Tall, Thick, Thin, Transparent};
        matches!(self, Long | Thin | Thick | Flat | Round | Tall | Transparent | Opaque | Dark | Bright)
    }
}

/// What a unit must look like.
#[derive(Debug, Clone, PartialEq)]
pub enum Look {
    /// One of the eleven basic colours.
    BasicColor(&'static str),
    /// A colour with a more special name.
    Color(Color),
    /// Another quality.
    Quality(Quality),
}

/// A demand on a unit's look, as a text states it.
#[derive(Debug, Clone, PartialEq)]
pub struct Constraint {
    /// What the unit must look like.
    pub look: Look,
    /// Whether the unit must have most of it: "largest".
    pub superlative: bool,
    /// The words of the text.
    pub words: String,
}

use Quality::{
    Back, Bottom, Bright, Dark, Dense, Flat, Front, Large, Left, Long, Middle, Opaque, Right, Round, Small, Sparse,
    Tall, Thick, Thin, Top, Transparent,
};

/// Words with their quality. Several words are parted by a space.
const PLAIN: [(&str, Quality); 94] = [
    ("large", Large),
    ("big", Large),
    ("huge", Large),
    ("giant", Large),
    ("bigger", Large),
    ("larger", Large),
    ("small", Small),
    ("little", Small),
    ("tiny", Small),
    ("smaller", Small),
    ("minute", Small),
    ("long", Long),
    ("longish", Long),
    ("elongated", Long),
    ("stretched", Long),
    ("tubular", Long),
    ("filament like", Long),
    ("threadlike", Long),
    ("thread like", Long),
    ("linear", Long),
    ("thin", Thin),
    ("slender", Thin),
    ("narrow", Thin),
    ("slim", Thin),
    ("fine", Thin),
    ("thick", Thick),
    ("fat", Thick),
    ("bulky", Thick),
    ("compact", Round),
    ("flat", Flat),
    ("sheet like", Flat),
    ("sheetlike", Flat),
    ("planar", Flat),
    ("round", Round),
    ("spherical", Round),
    ("globular", Round),
    ("ball shaped", Round),
    ("blob like", Round),
    ("tall", Tall),
    ("high", Tall),
    ("upright", Tall),
    ("left", Left),
    ("left hand", Left),
    ("right", Right),
    ("right hand", Right),
    ("top", Top),
    ("upper", Top),
    ("above", Top),
    ("superior", Top),
    ("bottom", Bottom),
    ("lower", Bottom),
    ("below", Bottom),
    ("underneath", Bottom),
    ("inferior", Bottom),
    ("front", Front),
    ("anterior", Front),
    ("ventral", Front),
    ("nearer", Front),
    ("back", Back),
    ("rear", Back),
    ("behind", Back),
    ("posterior", Back),
    ("dorsal", Back),
    ("middle", Middle),
    ("center", Middle),
    ("centre", Middle),
    ("central", Middle),
    ("transparent", Transparent),
    ("translucent", Transparent),
    ("see through", Transparent),
    ("glassy", Transparent),
    ("faint", Transparent),
    ("faded", Transparent),
    ("ghostly", Transparent),
    ("semi transparent", Transparent),
    ("semitransparent", Transparent),
    ("opaque", Opaque),
    ("solid", Opaque),
    ("dense", Dense),
    ("sparse", Sparse),
    ("loose", Sparse),
    ("thinned out", Sparse),
    ("dark", Dark),
    ("darker", Dark),
    ("bright", Bright),
    ("light", Bright),
    ("lighter", Bright),
    ("brighter", Bright),
    ("pale", Bright),
    ("longer", Long),
    ("thinner", Thin),
    ("thicker", Thick),
    ("flatter", Flat),
    ("rounder", Round),
];

/// Superlatives with their quality.
const MOST: [(&str, Quality); 53] = [
    ("largest", Large),
    ("biggest", Large),
    ("greatest", Large),
    ("hugest", Large),
    ("smallest", Small),
    ("littlest", Small),
    ("tiniest", Small),
    ("longest", Long),
    ("most elongated", Long),
    ("thinnest", Thin),
    ("slenderest", Thin),
    ("narrowest", Thin),
    ("thickest", Thick),
    ("fattest", Thick),
    ("flattest", Flat),
    ("roundest", Round),
    ("tallest", Tall),
    ("leftmost", Left),
    ("far left", Left),
    ("furthest left", Left),
    ("farthest left", Left),
    ("rightmost", Right),
    ("far right", Right),
    ("furthest right", Right),
    ("farthest right", Right),
    ("topmost", Top),
    ("uppermost", Top),
    ("highest", Top),
    ("very top", Top),
    ("lowest", Bottom),
    ("lowermost", Bottom),
    ("bottommost", Bottom),
    ("very bottom", Bottom),
    ("foremost", Front),
    ("frontmost", Front),
    ("nearest", Front),
    ("closest", Front),
    ("rearmost", Back),
    ("hindmost", Back),
    ("farthest", Back),
    ("furthest", Back),
    ("far back", Back),
    ("most central", Middle),
    ("innermost", Middle),
    ("most transparent", Transparent),
    ("faintest", Transparent),
    ("most opaque", Opaque),
    ("sparsest", Sparse),
    ("densest", Dense),
    ("darkest", Dark),
    ("brightest", Bright),
    ("lightest", Bright),
    ("palest", Bright),
];

/// Nouns that name a shape, with its quality where it has one. A label with that noun goes first.
const SHAPES: [(&str, Option<Quality>); 34] = [
    ("ball", Some(Round)),
    ("sphere", Some(Round)),
    ("blob", Some(Round)),
    ("globe", Some(Round)),
    ("lump", Some(Round)),
    ("bubble", Some(Round)),
    ("sheet", Some(Flat)),
    ("plane", Some(Flat)),
    ("slab", Some(Flat)),
    ("plate", Some(Flat)),
    ("disc", Some(Flat)),
    ("disk", Some(Flat)),
    ("filament", Some(Long)),
    ("line", Some(Long)),
    ("thread", Some(Long)),
    ("tube", Some(Long)),
    ("rod", Some(Long)),
    ("stick", Some(Long)),
    ("wire", Some(Long)),
    ("strand", Some(Long)),
    ("string", Some(Long)),
    ("cable", Some(Long)),
    ("pole", Some(Long)),
    ("streak", Some(Long)),
    ("cloud", None),
    ("layer", None),
    ("shell", None),
    ("organ", None),
    ("surface", None),
    ("body", None),
    ("volume", None),
    ("mass", None),
    ("spot", None),
    ("bit", None),
];

/// The eleven basic colours of English (Berlin and Kay 1969), and words of the same meaning.
const BASIC: [(&str, &str); 14] = [
    ("black", "black"),
    ("white", "white"),
    ("grey", "grey"),
    ("gray", "grey"),
    ("red", "red"),
    ("green", "green"),
    ("blue", "blue"),
    ("yellow", "yellow"),
    ("orange", "orange"),
    ("brown", "brown"),
    ("purple", "purple"),
    ("violet", "purple"),
    ("pink", "pink"),
    ("crimson", "red"),
];

/// The quality of a shape's noun in singular: the outer `None` is no such noun.
#[must_use]
pub fn shape(noun: &str) -> Option<Option<Quality>> {
    SHAPES.iter().find(|(word, _)| *word == noun).map(|(_, quality)| *quality)
}

/// The place that a word of a label names.
#[must_use]
pub fn place(word: &str) -> Option<Quality> {
    PLAIN.iter().find(|(w, _)| *w == word).map(|(_, q)| *q).filter(|q| q.opposite_place().is_some() || *q == Middle)
}

/// The demand at the start of a sequence of words in lower case, and its number of words.
#[must_use]
pub fn constraint(words: &[&str]) -> Option<(Constraint, usize)> {
    let of = |table: &[(&str, Quality)], length: usize| {
        let text = words.get(..length)?.join(" ");
        let found = table.iter().find(|(w, _)| *w == text)?;
        Some((found.1, text))
    };
    for length in [2, 1] {
        for (table, superlative) in [(MOST.as_slice(), true), (PLAIN.as_slice(), false)] {
            if let Some((quality, text)) = of(table, length) {
                // "dark red" is a colour, "dark" alone a quality.
                let is_tone = matches!(quality, Dark | Bright | Opaque) && !superlative;
                if is_tone && let Some(colored) = color(words).filter(|(_, l)| *l > 1) {
                    return Some(colored);
                }
                return Some((Constraint { look: Look::Quality(quality), superlative, words: text }, length));
            }
        }
    }
    color(words)
}

fn color(words: &[&str]) -> Option<(Constraint, usize)> {
    let (color, length) = sg_color::from_words(words.get(..words.len().min(sg_color::MAX_WORDS))?)?;
    let text = words.get(..length)?.join(" ");
    let basic = BASIC.iter().find(|(w, _)| *w == text).map(|(_, basic)| *basic);
    let look = basic.map_or(Look::Color(color), Look::BasicColor);
    Some((Constraint { look, superlative: false, words: text }, length))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_name_looks() {
        for (text, look, superlative, length) in [
            ("largest red thing", Look::Quality(Large), true, 1),
            ("far left", Look::Quality(Left), true, 2),
            ("see through part", Look::Quality(Transparent), false, 2),
            ("grey one", Look::BasicColor("grey"), false, 1),
            ("violet", Look::BasicColor("purple"), false, 1),
            ("dark one", Look::Quality(Dark), false, 1),
        ] {
            let words: Vec<&str> = text.split(' ').collect();
            let (constraint, taken) = constraint(&words).unwrap();
            assert_eq!((constraint.look, constraint.superlative, taken), (look, superlative, length), "{text}");
        }
        let (dark_red, length) = constraint(&["dark", "red", "one"]).unwrap();
        assert!(matches!(dark_red.look, Look::Color(_)) && length == 2);
        assert_eq!(constraint(&["kidney"]), None);
        assert_eq!(constraint(&[]), None);
    }

    #[test]
    fn no_word_stands_twice_in_a_table() {
        let all: Vec<&str> = PLAIN.iter().chain(&MOST).map(|(w, _)| *w).collect();
        for (at, word) in all.iter().enumerate() {
            assert!(!all[..at].contains(word), "{word}");
        }
    }
}
