//! Colours to names and names to colours, and the distance of colours as people see it.
//!
//! A colour is RGB from 0 to 1. No transfer function is applied, as in stored palettes.
//!
//! ```
//! let (red, words) = sg_color::from_words(&["dark", "red", "vessel"]).unwrap_or_default();
//! assert_eq!(words, 2);
//! assert_eq!(sg_color::name_of(red), "dark red");
//! ```

use std::sync::LazyLock;

use csscolorparser::Color as Css;

/// RGB from 0 to 1.
pub type Color = [f32; 3];

/// The tones of everyday colours. Those of CSS have channels of 0 or 1: light cannot show a shape in them, since every term of the
/// shading is the same colour. "Pure red" is still the colour of CSS, and "bright red" nearly.
const TONES: [(&str, u32); 11] = [
    ("red", 0xd33d3d),
    ("green", 0x3d993d),
    ("blue", 0x3b6fd4),
    ("yellow", 0xe8d042),
    ("orange", 0xe8923a),
    ("purple", 0x8a56b8),
    ("cyan", 0x45c4d6),
    ("aqua", 0x45c4d6),
    ("magenta", 0xcf4fb6),
    ("lime", 0x8fd43d),
    ("brown", 0x96613d),
];

/// Names that CSS lacks. `dark gray` is here because the `darkgray` of CSS is lighter than its `gray`.
const EXTRA: [(&str, u32); 66] = [
    ("dark grey", 0x404040),
    ("dark gray", 0x404040),
    ("mid grey", 0x808080),
    ("mid gray", 0x808080),
    ("amber", 0xffbf00),
    ("apricot", 0xfbceb1),
    ("baby blue", 0x89cff0),
    ("baby pink", 0xf4c2c2),
    ("blood red", 0x8a0303),
    ("blue green", 0x0d98ba),
    ("bone", 0xe3dac9),
    ("bone white", 0xe3dac9),
    ("bordeaux", 0x7b002c),
    ("bottle green", 0x006a4e),
    ("brass", 0xb5a642),
    ("brick red", 0xcb4154),
    ("bronze", 0xcd7f32),
    ("burgundy", 0x800020),
    ("charcoal", 0x36454f),
    ("cherry red", 0xd2042d),
    ("cobalt", 0x0047ab),
    ("cobalt blue", 0x0047ab),
    ("copper", 0xb87333),
    ("cream", 0xfffdd0),
    ("electric blue", 0x7df9ff),
    ("emerald", 0x50c878),
    ("emerald green", 0x50c878),
    ("flesh", 0xffdbac),
    ("golden", 0xffd700),
    ("grass green", 0x4c9a2a),
    ("ice blue", 0xd6ecef),
    ("jade", 0x00a86b),
    ("jet black", 0x0a0a0a),
    ("leaf green", 0x5a8f29),
    ("lemon", 0xfff44f),
    ("lemon yellow", 0xfff44f),
    ("lilac", 0xc8a2c8),
    ("mahogany", 0xc04000),
    ("mauve", 0xe0b0ff),
    ("mint", 0x98ff98),
    ("mint green", 0x98ff98),
    ("moss green", 0x8a9a5b),
    ("mustard", 0xe1ad01),
    ("mustard yellow", 0xe1ad01),
    ("navy blue", 0x000080),
    ("neon green", 0x39ff14),
    ("neon pink", 0xff10f0),
    ("ochre", 0xcc7722),
    ("off white", 0xfaf9f6),
    ("olive green", 0x6b8e23),
    ("peach", 0xffcba4),
    ("petrol", 0x005f6a),
    ("rose", 0xff007f),
    ("ruby", 0xe0115f),
    ("ruby red", 0xe0115f),
    ("rust", 0xb7410e),
    ("sand", 0xc2b280),
    ("sapphire", 0x0f52ba),
    ("scarlet", 0xff2400),
    ("silvery", 0xc0c0c0),
    ("skin tone", 0xffdbac),
    ("sky", 0x87ceeb),
    ("terracotta", 0xe2725b),
    ("ultramarine", 0x3f00ff),
    ("vermilion", 0xe34234),
    ("wine red", 0x722f37),
];

/// Words that modify the next colour.
const MODIFIERS: [(&str, Adjustment); 21] = [
    ("dark", Adjustment::Darker(0.55)),
    ("darker", Adjustment::Darker(0.55)),
    ("deep", Adjustment::Darker(0.7)),
    ("light", Adjustment::Lighter(0.5)),
    ("lighter", Adjustment::Lighter(0.5)),
    ("pale", Adjustment::Lighter(0.65)),
    ("pastel", Adjustment::Lighter(0.6)),
    ("soft", Adjustment::Lighter(0.4)),
    ("bright", Adjustment::Saturated),
    ("vivid", Adjustment::Saturated),
    ("strong", Adjustment::Saturated),
    ("intense", Adjustment::Saturated),
    ("saturated", Adjustment::Saturated),
    ("pure", Adjustment::Pure),
    ("plain", Adjustment::Unchanged),
    ("solid", Adjustment::Unchanged),
    ("medium", Adjustment::Unchanged),
    ("nice", Adjustment::Unchanged),
    ("very", Adjustment::Unchanged),
    ("rich", Adjustment::Unchanged),
    ("really", Adjustment::Unchanged),
];

/// Adjectives that mix the next colour with another one.
const TINTS: [(&str, &str); 11] = [
    ("reddish", "red"),
    ("bluish", "blue"),
    ("greenish", "green"),
    ("yellowish", "yellow"),
    ("brownish", "brown"),
    ("purplish", "purple"),
    ("pinkish", "pink"),
    ("orangish", "orange"),
    ("greyish", "grey"),
    ("grayish", "gray"),
    ("whitish", "white"),
];

/// Names for descriptions, easy to tell apart.
const DESCRIPTIONS: [&str; 34] = [
    "black",
    "white",
    "grey",
    "dark grey",
    "light grey",
    "red",
    "dark red",
    "salmon",
    "coral",
    "pink",
    "deep pink",
    "maroon",
    "orange",
    "gold",
    "yellow",
    "khaki",
    "beige",
    "brown",
    "tan",
    "olive",
    "green",
    "lime",
    "light green",
    "forest green",
    "teal",
    "turquoise",
    "cyan",
    "sky blue",
    "light blue",
    "blue",
    "navy",
    "purple",
    "violet",
    "magenta",
];

#[derive(Debug, Clone, Copy)]
enum Adjustment {
    /// Multiplies each channel by this factor.
    Darker(f32),
    /// Mixes in this share of white.
    Lighter(f32),
    /// Raises brightness and saturation to the maximum of the hue.
    Saturated,
    /// Takes the colour of CSS where a name has a tone of its own.
    Pure,
    /// Leaves the colour as it is.
    Unchanged,
}

/// Largest number of words of a colour.
pub const MAX_WORDS: usize = 5;

/// A colour from three channels, clamped to 0 to 1.
#[must_use]
pub fn from_rgb(channels: [f32; 3]) -> Color {
    channels.map(|c| if c.is_nan() { 0.0 } else { c.clamp(0.0, 1.0) })
}

fn shift(color: Color, by: Adjustment) -> Color {
    let channels = color;
    from_rgb(match by {
        Adjustment::Pure | Adjustment::Unchanged => channels,
        Adjustment::Darker(factor) => channels.map(|c| c * factor),
        Adjustment::Lighter(share) => channels.map(|c| c + (1.0 - c) * share),
        Adjustment::Saturated => {
            let most = channels.iter().copied().fold(0.0, f32::max);
            let least = channels.iter().copied().fold(1.0, f32::min);
            let range = most - least;
            if range < 1e-3 { channels.map(|c| c + (1.0 - c) * 0.5) } else { channels.map(|c| (c - least) / range) }
        }
    })
}

/// A colour by its name without modifiers.
fn named(words: &[&str]) -> Option<Color> {
    let spaced = words.join(" ");
    if let Some((_, hex)) = TONES.iter().chain(&EXTRA).find(|(name, _)| *name == spaced) {
        let [_, red, green, blue] = hex.to_be_bytes();
        return Some([red, green, blue].map(|c| f32::from(c) / 255.0));
    }
    of_css(words)
}

/// A colour by its name in CSS.
fn of_css(words: &[&str]) -> Option<Color> {
    let joined = words.concat();
    // The CSS parser accepts bare hexadecimal digits: "add" would be a colour.
    let plain = joined.bytes().all(|b| b.is_ascii_lowercase()) && !joined.bytes().all(|b| b.is_ascii_hexdigit());
    if !plain || joined == "transparent" {
        return None;
    }
    csscolorparser::parse(&joined).ok().map(|c| [c.r, c.g, c.b])
}

/// The colour at the start of a sequence of lowercase words, and its number of words. The longest name wins.
///
/// It knows the names of CSS, joined or apart, and some more. Everyday names have softer tones than in CSS. Words before them darken, lighten, saturate or mix
/// them ("dark olive green", "pale reddish brown").
#[must_use]
pub fn from_words(words: &[&str]) -> Option<(Color, usize)> {
    for length in (1..=words.len().min(3)).rev() {
        if let Some(color) = words.get(..length).and_then(named) {
            return Some((color, length));
        }
    }
    let (first, rest) = words.split_first()?;
    if let Some((_, by)) = MODIFIERS.iter().find(|(word, _)| word == first) {
        if matches!(by, Adjustment::Pure)
            && let Some(next) = rest.first().filter(|next| TONES.iter().any(|(name, _)| name == *next))
        {
            return of_css(&[next]).map(|color| (color, 2));
        }
        let (color, length) = from_words(rest)?;
        return Some((shift(color, *by), length + 1));
    }
    let (_, towards) = TINTS.iter().find(|(word, _)| word == first)?;
    let (color, length) = from_words(rest)?;
    let towards = named(&[towards])?;
    let mix = |a: f32, b: f32| 0.65 * a + 0.35 * b;
    let mixed = [mix(color[0], towards[0]), mix(color[1], towards[1]), mix(color[2], towards[2])];
    Some((from_rgb(mixed), length + 1))
}

/// The colour of a whole phrase, for example `forest green`, `#ff8800` or `rgb(255 136 0)`.
#[must_use]
pub fn from_phrase(phrase: &str) -> Option<Color> {
    let lower = phrase.trim().to_lowercase();
    if lower.starts_with('#') || lower.contains('(') {
        return csscolorparser::parse(&lower).ok().map(|c| from_rgb([c.r, c.g, c.b]));
    }
    let words: Vec<&str> = lower.split([' ', '-']).filter(|w| !w.is_empty()).collect();
    from_words(&words).filter(|(_, length)| *length == words.len()).map(|(color, _)| color)
}

/// Whether a word before a colour has no effect.
#[must_use]
pub fn is_emphasis(word: &str) -> bool {
    MODIFIERS.iter().any(|(w, shift)| *w == word && matches!(shift, Adjustment::Unchanged))
}

/// Whether a word is a colour or a modifier of colours.
#[must_use]
pub fn is_word(word: &str) -> bool {
    named(&[word]).is_some() || MODIFIERS.iter().any(|(w, _)| *w == word) || TINTS.iter().any(|(w, _)| *w == word)
}

/// A colour in Oklab (Ottosson 2020): lightness from 0 to 1, then green–red and blue–yellow from about −0.4 to 0.4.
#[must_use]
pub fn oklab(color: Color) -> [f32; 3] {
    let [lightness, green_red, blue_yellow, _] = Css::new(color[0], color[1], color[2], 1.0).to_oklaba();
    [lightness, green_red, blue_yellow]
}

/// Square of the distance of two colours in Oklab.
fn apart(a: [f32; 3], b: [f32; 3]) -> f32 {
    a.iter().zip(&b).map(|(a, b)| (a - b) * (a - b)).sum()
}

/// The colours that a name of [`DESCRIPTIONS`] stands for: the tone of a name and its colour in CSS.
fn colors_of(name: &str) -> impl Iterator<Item = Color> {
    let words: Vec<&str> = name.split(' ').collect();
    let css = of_css(&words).filter(|_| TONES.iter().any(|(tone, _)| *tone == name));
    from_phrase(name).into_iter().chain(css)
}

/// An everyday name with a colour of that name.
struct Described {
    name: &'static str,
    lab: [f32; 3],
    /// Basic names of it, the likeliest first. Empty for colours without hue.
    basic: &'static [&'static str],
}

static DESCRIBED: LazyLock<Vec<Described>> = LazyLock::new(|| {
    let described = |name: &'static str, color: Color| {
        let lab = oklab(color);
        let names = BASIC.iter().find(|(described, _)| *described == name).map_or(&[][..], |(_, names)| names);
        let has_hue = lab[1].hypot(lab[2]) > 1e-3;
        Described { name, lab, basic: if has_hue { names } else { &[] } }
    };
    DESCRIPTIONS.iter().flat_map(|name| colors_of(name).map(|color| described(name, color))).collect()
});

/// The nearest everyday name of a colour, by distance in Oklab.
#[must_use]
pub fn name_of(color: Color) -> &'static str {
    let lab = oklab(color);
    let nearest = DESCRIBED.iter().min_by(|a, b| apart(a.lab, lab).total_cmp(&apart(b.lab, lab)));
    nearest.map_or("grey", |described| described.name)
}

/// Names of [`DESCRIPTIONS`] and the basic colours of English (Berlin and Kay 1969) that people also call them, the first the likeliest.
const BASIC: [(&str, &[&str]); 34] = [
    ("black", &["black"]),
    ("white", &["white"]),
    ("grey", &["grey"]),
    ("dark grey", &["grey", "black"]),
    ("light grey", &["grey", "white"]),
    ("red", &["red"]),
    ("dark red", &["red", "brown"]),
    ("salmon", &["pink", "orange", "red"]),
    ("coral", &["orange", "red", "pink"]),
    ("pink", &["pink"]),
    ("deep pink", &["pink"]),
    ("maroon", &["red", "brown"]),
    ("orange", &["orange"]),
    ("gold", &["yellow", "orange"]),
    ("yellow", &["yellow"]),
    ("khaki", &["yellow", "brown"]),
    ("beige", &["white", "brown"]),
    ("brown", &["brown"]),
    ("tan", &["brown"]),
    ("olive", &["green", "brown"]),
    ("green", &["green"]),
    ("lime", &["green"]),
    ("light green", &["green"]),
    ("forest green", &["green"]),
    ("teal", &["green", "blue"]),
    ("turquoise", &["blue", "green"]),
    ("cyan", &["blue"]),
    ("sky blue", &["blue"]),
    ("light blue", &["blue"]),
    ("blue", &["blue"]),
    ("navy", &["blue"]),
    ("purple", &["purple"]),
    ("violet", &["purple", "pink"]),
    ("magenta", &["pink", "purple"]),
];

/// Names without hue, and the range of lightness in which people use them.
const NEUTRAL: [(&str, f32, f32); 3] = [("black", 0.0, 0.25), ("grey", 0.35, 0.85), ("white", 0.93, 1.0)];
/// What a name that is not the likeliest one adds to a distance in Oklab.
const LESS_LIKELY: f32 = 0.03;
/// How much the saturation of HSV counts against a name without hue: dark colours have little chroma, and are red or blue still.
const SATURATION: f32 = 0.2;
/// How much lightness counts beside hue and chroma: a dark red is still red.
const LIGHTNESS: f32 = 0.5;

/// Least brightest channel at which hue is judged: darker colours are judged as if they were lit.
const LIT: f32 = 0.5;

/// How far a colour is from what people call by a basic name (black, white, grey, red, green, blue, yellow, orange, brown, purple,
/// pink), and from the nearest of all basic names. Both are distances in Oklab in which lightness counts half. Black, grey and white
/// are ranges of lightness without hue. The first distance is infinite for another name.
#[must_use]
pub fn basic_distances(name: &str, color: Color) -> (f32, f32) {
    let [lightness, green_red, blue_yellow] = oklab(color);
    let brightest = color.iter().copied().fold(0.0, f32::max);
    let saturation = if brightest > 0.0 { 1.0 - color.iter().copied().fold(1.0, f32::min) / brightest } else { 0.0 };
    // A black colour has any saturation by rounding.
    let chroma = green_red.hypot(blue_yellow).max(SATURATION * saturation * (brightest / 0.2).min(1.0));
    let (mut own, mut nearest) = (f32::INFINITY, f32::INFINITY);
    for (neutral, least, most) in NEUTRAL {
        let distance = chroma.hypot(LIGHTNESS * (lightness - lightness.clamp(least, most)));
        nearest = nearest.min(distance);
        if neutral == name {
            own = own.min(distance);
        }
    }
    let gain = if brightest > 0.0 { (LIT / brightest).max(1.0) } else { 1.0 };
    let [lightness, green_red, blue_yellow] = oklab(color.map(|c| c * gain));
    for described in DESCRIBED.iter().filter(|d| !d.basic.is_empty()) {
        let [l, a, b] = described.lab;
        let distance = (green_red - a).hypot(blue_yellow - b).hypot(LIGHTNESS * (lightness - l));
        nearest = nearest.min(distance);
        if let Some(place) = described.basic.iter().position(|n| *n == name) {
            own = own.min(distance + if place == 0 { 0.0 } else { LESS_LIKELY });
        }
    }
    (own, nearest)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a test fails by panicking")]
mod tests {
    use super::*;

    fn hex(color: Color) -> String {
        Css::new(color[0], color[1], color[2], 1.0).to_css_hex().to_string()
    }

    #[test]
    fn names_with_and_without_modifiers() {
        for (phrase, expected) in [
            ("red", "#d33d3d"),
            ("pure red", "#ff0000"),
            ("pure white", "#ffffff"),
            ("bright red", "#ff0000"),
            ("blue", "#3b6fd4"),
            ("pure blue", "#0000ff"),
            ("forest green", "#228b22"),
            ("forestgreen", "#228b22"),
            ("Dark Slate Grey", "#2f4f4f"),
            ("dark grey", "#404040"),
            ("light gray", "#d3d3d3"),
            ("#ff8800", "#ff8800"),
            ("#f80", "#ff8800"),
            ("burgundy", "#800020"),
            ("bright green", "#00ff00"),
            ("dark yellow", "#807224"),
            ("very dark red", "#8b0000"),
            ("blue-green", "#0d98ba"),
        ] {
            assert_eq!(from_phrase(phrase).map(hex).as_deref(), Some(expected), "{phrase}");
        }
    }

    #[test]
    fn other_words_are_not_colours() {
        for word in ["fade", "add", "bed", "transparent", "sac", "dark", "reddish", "", "red sac"] {
            assert_eq!(from_phrase(word), None, "{word}");
        }
    }

    #[test]
    fn the_longest_name_wins() {
        let (_, length) = from_words(&["light", "sea", "green", "please"]).unwrap();
        assert_eq!(length, 3);
    }

    #[test]
    fn every_description_is_a_colour_and_describes_itself() {
        for name in DESCRIPTIONS {
            assert_eq!(name_of(from_phrase(name).unwrap()), name);
        }
        assert_eq!(name_of(from_rgb([0.97, 0.02, 0.05])), "red");
        for (tone, _) in TONES.iter().filter(|(tone, _)| DESCRIPTIONS.contains(tone)) {
            let of = |phrase: &str| name_of(from_phrase(phrase).unwrap());
            assert_eq!((of(tone), of(&format!("pure {tone}"))), (*tone, *tone));
        }
    }

    #[test]
    fn basic_names_of_colours() {
        assert!(BASIC.iter().map(|(name, _)| *name).eq(DESCRIPTIONS));
        let is = |name: &str, hex: &str| {
            let (own, nearest) = basic_distances(name, from_phrase(hex).unwrap());
            own <= nearest
        };
        for (name, hex) in [
            ("red", "#e01010"),
            ("blue", "#1838e0"),
            ("white", "#fafafa"),
            ("pink", "#f0a0b8"),
            ("grey", "#808080"),
            ("grey", "#b8b8c0"),
            ("black", "#202020"),
            ("black", "#050004"),
            ("brown", "#6b4423"),
            ("brown", "#3a2618"),
            ("red", "#502020"),
        ] {
            assert!(is(name, hex), "{name} {hex}");
        }
        assert!(
            !is("green", "#e01010")
                && !is("black", "#fafafa")
                && !is("blue", "#a8a8b0")
                && !is("green", "#505860")
                && !is("red", "#6b4423")
                && !is("grey", "#502020")
        );
        assert!(
            is("blue", "#40e0d0") || basic_distances("blue", from_phrase("#40e0d0").unwrap()).0 < 0.05,
            "turquoise"
        );
        assert_eq!(basic_distances("beautiful", [0.0; 3]).0, f32::INFINITY);
    }

    /// Shading shows a shape only in channels that are neither 0 nor 1.
    #[test]
    fn everyday_colours_leave_room_for_light() {
        for (name, _) in TONES {
            for channel in from_phrase(name).unwrap() {
                assert!((0.2..=0.95).contains(&channel), "{name}: {channel}");
            }
        }
    }

    #[test]
    fn every_extra_name_is_reachable() {
        for (name, value) in EXTRA {
            assert_eq!(from_phrase(name).map(hex), Some(format!("#{value:06x}")), "{name}");
        }
    }
}
