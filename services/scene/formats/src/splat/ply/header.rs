//! The header: `ply`, `format`, `comment`, `element`, `property`, `end_header`.

use std::collections::HashSet;

use super::Scalar;
use crate::splat::problem::Problem;

/// Longest header that is read; a scene of 62 columns takes about two thousand bytes.
pub(crate) const MAX_HEADER: usize = 1 << 20;
/// Most properties of one element.
const MAX_PROPERTIES: usize = 4096;
/// Most elements.
const MAX_ELEMENTS: usize = 64;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

#[derive(Debug, Clone)]
pub(crate) struct Header {
    pub(crate) encoding: Encoding,
    pub(crate) comments: Vec<String>,
    pub(crate) elements: Vec<Element>,
    /// Bytes of the header with its last line end.
    pub(crate) length: usize,
    /// Lines of the header.
    pub(crate) lines: usize,
}

#[derive(Debug, Clone)]
pub(crate) struct Element {
    pub(crate) name: String,
    pub(crate) count: u64,
    pub(crate) properties: Vec<Property>,
}

#[derive(Debug, Clone)]
pub(crate) struct Property {
    pub(crate) name: String,
    pub(crate) kind: Kind,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Scalar(Scalar),
    List { count: Scalar, item: Scalar },
}

const TYPES: &str = "PLY knows char uchar short ushort int uint float double";

impl Header {
    /// Parses the header at the start of a file.
    pub(crate) fn parse(bytes: &[u8]) -> Result<Self, Problem> {
        let mut lines = Lines { rest: bytes.get(..MAX_HEADER.min(bytes.len())).unwrap_or(bytes), number: 0, length: 0 };
        if lines.next().as_deref() != Some("ply") {
            return Err(Problem::new("header line 1", "it is not `ply`", "give a PLY file"));
        }
        let mut header = Self { encoding: Encoding::Ascii, comments: vec![], elements: vec![], length: 0, lines: 0 };
        let mut encoding = None;
        // The properties of the last element.
        let mut names: HashSet<String> = HashSet::new();
        loop {
            let Some(line) = lines.next() else {
                return Err(Problem::new(
                    format!("header line {}", lines.number + 1),
                    "the header has no `end_header`",
                    "the file is cut off or no PLY: write it again",
                ));
            };
            let place = || format!("header line {}", lines.number);
            let mut words = line.split_ascii_whitespace();
            match words.next() {
                None | Some("obj_info") => {}
                Some("comment") => header.comments.push(line.get(7..).unwrap_or_default().trim().to_owned()),
                Some("format") => {
                    encoding = Some(match words.next() {
                        Some("ascii") => Encoding::Ascii,
                        Some("binary_little_endian") => Encoding::LittleEndian,
                        Some("binary_big_endian") => Encoding::BigEndian,
                        other => {
                            let what = format!("unknown format `{}`", printable(other.unwrap_or_default()));
                            return Err(Problem::new(place(), what, "use ascii or binary_little_endian"));
                        }
                    });
                }
                Some("element") => {
                    let element = element(&mut words, &header.elements).map_err(|e| e.at(place()))?;
                    header.elements.push(element);
                    names.clear();
                }
                Some("property") => {
                    let Some(element) = header.elements.last_mut() else {
                        return Err(Problem::new(place(), "a property before any element", "write the header again"));
                    };
                    let property = property(&mut words).map_err(|e| e.at(place()))?;
                    if !names.insert(property.name.clone()) {
                        let (name, of) = (printable(&property.name), printable(&element.name));
                        let what = format!("a second property `{name}` of element {of}");
                        return Err(Problem::new(place(), what, "rename or remove one of them"));
                    }
                    if element.properties.len() == MAX_PROPERTIES {
                        return Err(Problem::new(
                            place(),
                            format!("more than {MAX_PROPERTIES} properties"),
                            "split the element",
                        ));
                    }
                    element.properties.push(property);
                }
                Some("end_header") => break,
                Some(word) => {
                    let what = format!("unknown keyword `{}`", printable(word));
                    return Err(Problem::new(
                        place(),
                        what,
                        "PLY headers have format, comment, element, property, end_header",
                    ));
                }
            }
        }
        header.encoding = encoding.ok_or_else(|| {
            Problem::new("header", "there is no `format` line", "add `format binary_little_endian 1.0`")
        })?;
        header.length = lines.length;
        header.lines = lines.number;
        Ok(header)
    }
}

/// A problem whose line is not known yet.
struct Nowhere {
    what: String,
    remedy: &'static str,
}

impl Nowhere {
    fn at(self, place: String) -> Problem {
        Problem::new(place, self.what, self.remedy)
    }
}

fn element<'a>(words: &mut impl Iterator<Item = &'a str>, before: &[Element]) -> Result<Element, Nowhere> {
    let name = words.next().unwrap_or_default();
    let count = words.next().unwrap_or_default();
    if name.is_empty() || before.iter().any(|e| e.name == name) || before.len() == MAX_ELEMENTS {
        let what = format!("element `{}` has no name, a name twice, or is one too many", printable(name));
        return Err(Nowhere { what, remedy: "give each element its own name" });
    }
    let Ok(count) = count.parse() else {
        let what = format!("`{}` is no number of rows of element {}", printable(count), printable(name));
        return Err(Nowhere { what, remedy: "write `element NAME COUNT`" });
    };
    Ok(Element { name: name.to_owned(), count, properties: vec![] })
}

fn property<'a>(words: &mut impl Iterator<Item = &'a str>) -> Result<Property, Nowhere> {
    let scalar = |word: Option<&str>| {
        let word = word.unwrap_or_default();
        Scalar::named(word)
            .ok_or_else(|| Nowhere { what: format!("unknown type `{}`", printable(word)), remedy: TYPES })
    };
    let first = words.next();
    let kind = match first {
        Some("list") => Kind::List { count: scalar(words.next())?, item: scalar(words.next())? },
        other => Kind::Scalar(scalar(other)?),
    };
    match words.next() {
        Some(name) => Ok(Property { name: name.to_owned(), kind }),
        None => Err(Nowhere { what: "a property without a name".to_owned(), remedy: "write `property TYPE NAME`" }),
    }
}

/// The start of a word that a message quotes.
pub(super) fn printable(word: &str) -> String {
    let start: String = word.chars().take(40).collect();
    sg_input::printable(&start).into_owned()
}

struct Lines<'a> {
    rest: &'a [u8],
    number: usize,
    length: usize,
}

impl Lines<'_> {
    /// The next line without its end, or nothing if no line end follows.
    fn next(&mut self) -> Option<String> {
        let end = self.rest.iter().position(|&b| b == b'\n')?;
        let (line, rest) = self.rest.split_at_checked(end + 1)?;
        self.rest = rest;
        self.number += 1;
        self.length += line.len();
        Some(String::from_utf8_lossy(line).trim_end_matches(['\n', '\r']).to_owned())
    }
}
