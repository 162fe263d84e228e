//! Words, lines and blocks of numbers of a legacy VTK file.

use crate::read::decode::{Packing, Text, TextFailure, Voxels};
use crate::read::error::ReadError;
use crate::read::source::Source;
use crate::scalars::{ScalarType, Scalars};

pub(super) const REMEDY: &str = "repair the file, or write it again";

/// A place in the bytes of a file, and the encoding of its numbers.
#[derive(Clone, Copy)]
pub(super) struct Cursor<'a> {
    pub(super) source: Source<'a>,
    bytes: &'a [u8],
    at: usize,
    pub(super) is_binary: bool,
}

/// How a file stores the entries of an array.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Number(ScalarType),
    /// Eight entries in a byte, the first one in its highest bit.
    Bits,
    /// Texts, each with its length or on its own line.
    Texts,
}

/// A block of numbers in a file, not yet decoded.
#[derive(Debug, Clone)]
pub(super) struct Block {
    place: String,
    pub(super) kind: Kind,
    pub(super) entries: usize,
    pub(super) components: usize,
    start: usize,
    end: usize,
}

impl Kind {
    /// The type of a name in a file.
    pub(super) fn of_name(name: &str, is_binary: bool) -> Option<Self> {
        let name = name.to_ascii_lowercase();
        Some(match name.as_str() {
            "bit" if is_binary => Self::Bits,
            "bit" | "unsigned_char" => Self::Number(ScalarType::U8),
            "char" | "signed_char" => Self::Number(ScalarType::I8),
            "unsigned_short" => Self::Number(ScalarType::U16),
            "short" => Self::Number(ScalarType::I16),
            "unsigned_int" => Self::Number(ScalarType::U32),
            "int" => Self::Number(ScalarType::I32),
            // Of eight bytes, as everywhere but on Windows.
            "unsigned_long" => Self::Number(ScalarType::U64),
            "long" => Self::Number(ScalarType::I64),
            // VTK writes this type as int, whatever its size in memory.
            "vtkidtype" if is_binary => Self::Number(ScalarType::I32),
            "vtkidtype" => Self::Number(ScalarType::I64),
            "float" => Self::Number(ScalarType::F32),
            "double" => Self::Number(ScalarType::F64),
            "string" | "utf8_string" => Self::Texts,
            name => Self::Number(name.strip_prefix("vtktype").and_then(ScalarType::from_name)?),
        })
    }
}

impl<'a> Cursor<'a> {
    /// The first byte of a file.
    pub(super) fn new(source: Source<'a>, bytes: &'a [u8]) -> Self {
        Self { source, bytes, at: 0, is_binary: false }
    }

    fn rest(&self) -> &'a [u8] {
        self.bytes.get(self.at..).unwrap_or_default()
    }

    /// The place, for an error: its line, or its byte in a file with binary numbers.
    pub(super) fn place(&self) -> String {
        self.place_of(self.at)
    }

    fn place_of(&self, at: usize) -> String {
        if self.is_binary {
            return format!("byte {at}");
        }
        let before = self.bytes.get(..at).unwrap_or(self.bytes);
        format!("line {}", 1 + before.iter().filter(|&&b| b == b'\n').count())
    }

    /// An error here.
    pub(super) fn wrong(&self, what: impl Into<String>) -> ReadError {
        self.source.format(self.place(), what, REMEDY)
    }

    /// Goes to the next word, or to the end.
    pub(super) fn skip_spaces(&mut self) {
        let rest = self.rest();
        self.at += rest.iter().position(|b| !b.is_ascii_whitespace()).unwrap_or(rest.len());
    }

    /// The next word, on this line or a later one.
    pub(super) fn word(&mut self) -> Option<&'a [u8]> {
        self.skip_spaces();
        let rest = self.rest();
        let length = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        self.at += length;
        rest.get(..length).filter(|word| !word.is_empty())
    }

    /// Takes the next word if it is this keyword in any case. It looks no further than the keyword is long.
    pub(super) fn takes(&mut self, keyword: &str) -> bool {
        let rest = self.rest();
        let Some(start) = rest.iter().position(|b| !b.is_ascii_whitespace()) else { return false };
        let end = start + keyword.len();
        let is_same = rest.get(start..end).is_some_and(|word| word.eq_ignore_ascii_case(keyword.as_bytes()));
        let is_whole = rest.get(end).is_none_or(u8::is_ascii_whitespace);
        if is_same && is_whole {
            self.at += end;
        }
        is_same && is_whole
    }

    /// A word of the header of `keyword`.
    fn word_of(&mut self, keyword: &str) -> Result<&'a [u8], ReadError> {
        let word = self.word();
        word.ok_or_else(|| self.source.format(keyword, "the file ends within it", "fetch the file again"))
    }

    /// A name in the header of `keyword`.
    pub(super) fn name(&mut self, keyword: &str) -> Result<String, ReadError> {
        self.word_of(keyword).map(decoded)
    }

    /// A whole number, 0 or above, in the header of `keyword`.
    pub(super) fn count(&mut self, keyword: &str) -> Result<usize, ReadError> {
        let word = self.word_of(keyword)?;
        let number = std::str::from_utf8(word).ok().and_then(|word| word.parse().ok());
        number.ok_or_else(|| self.wrong(format!("{keyword}: `{}` is not a whole number, 0 or above", shown(word))))
    }

    /// A number in the header of `keyword`.
    pub(super) fn number(&mut self, keyword: &str) -> Result<f64, ReadError> {
        let word = self.word_of(keyword)?;
        let number = std::str::from_utf8(word).ok().and_then(|word| word.parse().ok());
        number.ok_or_else(|| self.wrong(format!("{keyword}: `{}` is not a number", shown(word))))
    }

    /// A type in the header of `keyword`.
    pub(super) fn kind(&mut self, keyword: &str) -> Result<Kind, ReadError> {
        let word = self.word_of(keyword)?;
        Kind::of_name(&String::from_utf8_lossy(word), self.is_binary)
            .ok_or_else(|| self.wrong(format!("{keyword}: `{}` is not a type of numbers", shown(word))))
    }

    /// The rest of this line without its end.
    pub(super) fn rest_of_line(&mut self) -> &'a [u8] {
        let rest = self.rest();
        let length = rest.iter().position(|&b| b == b'\n').unwrap_or(rest.len());
        self.at += length;
        rest.get(..length).unwrap_or_default()
    }

    /// The rest of this line. The next line begins after it.
    pub(super) fn line(&mut self) -> &'a [u8] {
        let line = self.rest_of_line();
        self.at = (self.at + 1).min(self.bytes.len());
        line
    }

    /// Whether nothing is left.
    pub(super) fn is_at_end(&self) -> bool {
        self.at >= self.bytes.len()
    }

    /// Skips the lines up to the next empty one.
    pub(super) fn skip_paragraph(&mut self) {
        while !self.is_at_end() && !self.line().trim_ascii().is_empty() {}
    }

    /// The block of an array, which begins after this line. `place` names it in errors. Nothing is decoded.
    pub(super) fn block(
        &mut self,
        place: String,
        kind: Kind,
        entries: usize,
        components: usize,
    ) -> Result<Block, ReadError> {
        let expected = entries.checked_mul(components);
        let source = self.source;
        let short = |found: usize| {
            let what = format!("expected {entries} x {components} numbers, found {found}");
            source.format(&place, what, "correct the sizes or complete the data")
        };
        if self.is_binary || kind == Kind::Texts {
            self.line();
        }
        let start = self.at;
        let left = self.rest().len();
        // Every entry takes at least a bit.
        let count = expected.filter(|n| n.div_ceil(8) <= left).ok_or_else(|| short(0))?;
        let found = match (kind, self.is_binary) {
            (Kind::Texts, true) => self.skip_texts(count),
            (Kind::Texts, false) => self.skip_lines(count),
            (Kind::Bits, _) => {
                self.at += count.div_ceil(8);
                count
            }
            (Kind::Number(scalar), true) => {
                let found = count.min(left / scalar.bytes());
                self.at += found * scalar.bytes();
                found
            }
            (Kind::Number(_), false) => (0..count).take_while(|_| self.word().is_some()).count(),
        };
        if found < count {
            return Err(short(found));
        }
        Ok(Block { place, kind, entries, components, start, end: self.at })
    }

    /// Skips lines, and returns their number.
    fn skip_lines(&mut self, count: usize) -> usize {
        let mut found = 0;
        while found < count && !self.is_at_end() {
            self.line();
            found += 1;
        }
        found
    }

    /// Skips texts that stand after their lengths, and returns their number. The top bits of a length tell how many bytes it has.
    fn skip_texts(&mut self, count: usize) -> usize {
        let skip = |cursor: &mut Self| {
            let first = *cursor.rest().first()?;
            let length_bytes = [8, 4, 2, 1].get(usize::from(first >> 6)).copied()?;
            let length = cursor.rest().get(1..length_bytes)?;
            let length = length
                .iter()
                .try_fold(usize::from(first & 0x3f), |n, &b| Some(n.checked_mul(256)? | usize::from(b)))?;
            let end = cursor.at.checked_add(length_bytes)?.checked_add(length)?;
            cursor.at = Some(end).filter(|end| *end <= cursor.bytes.len())?;
            Some(())
        };
        (0..count).take_while(|_| skip(self).is_some()).count()
    }

    /// The numbers of a block.
    pub(super) fn numbers(&self, block: &Block) -> Result<Scalars, ReadError> {
        let Block { place, kind, entries, components, start, end } = block;
        let bytes = self.bytes.get(*start..*end).unwrap_or_default();
        let scalar = match kind {
            Kind::Number(scalar) => *scalar,
            Kind::Bits => {
                let bit = |i: usize| bytes.get(i / 8).map(|byte| byte >> (7 - i % 8) & 1);
                return Ok((0..entries * components).filter_map(bit).collect::<Vec<u8>>().into());
            }
            Kind::Texts => return Err(self.source.format(place, "texts in place of numbers", REMEDY)),
        };
        let dims = [*components, *entries, 1];
        if self.is_binary {
            let voxels = Voxels { dims, scalar, big_endian: true, packing: Packing::Plain, remedy: REMEDY };
            return voxels.read(self.source, bytes, bytes.len() as u64);
        }
        let bytes_needed = self.source.voxel_bytes(dims, scalar)?;
        let count = (bytes_needed / scalar.bytes() as u64) as usize;
        let text = std::str::from_utf8(bytes).map_err(|e| {
            let place = format!("{} of {place}", self.place_of(start + e.valid_up_to()));
            self.source.format(place, "a byte that is no text", REMEDY)
        })?;
        Scalars::decode(scalar, Text { text, count }).map_err(|failure| match failure {
            TextFailure::Word(at, word) => {
                let place = format!("{} of {place}", self.place_of(start + place_of_word(text, at)));
                let what = format!("`{}` is not a value of type {}", shown(word.as_bytes()), scalar.name());
                self.source.format(place, what, "correct the number or the type")
            }
            TextFailure::Count(found) => {
                let what = format!("expected {count} numbers, found at least {found}");
                self.source.format(place, what, "separate numbers by white space only")
            }
        })
    }

    /// The numbers of a block as indices.
    pub(super) fn indices(&self, block: &Block) -> Result<Vec<u64>, ReadError> {
        let wrong = |(at, value)| self.source.format(&block.place, format!("entry {at} is {value}"), REMEDY);
        self.numbers(block)?.indices().map_err(wrong)
    }
}

/// The byte of word `number` from 1, as [`Text`] counts them.
fn place_of_word(text: &str, number: usize) -> usize {
    let words = text.split(|c: char| c.is_ascii_whitespace() || c == ',').filter(|w| !w.is_empty());
    words.skip(number.saturating_sub(1)).map(|word| word.as_ptr() as usize - text.as_ptr() as usize).next().unwrap_or(0)
}

/// The first characters of a word, for an error.
pub(super) fn shown(word: &[u8]) -> String {
    String::from_utf8_lossy(word.get(..word.len().min(60)).unwrap_or_default()).chars().take(40).collect()
}

/// A name without VTK's encoding of its characters, such as `%20` for a space.
fn decoded(name: &[u8]) -> String {
    let mut bytes = Vec::with_capacity(name.len());
    let mut rest = name;
    while let Some((&first, after)) = rest.split_first() {
        let code = after.get(..2).and_then(|code| std::str::from_utf8(code).ok());
        let code = code.filter(|_| first == b'%').and_then(|code| u8::from_str_radix(code, 16).ok());
        bytes.push(code.unwrap_or(first));
        rest = after.get(if code.is_some() { 2 } else { 0 }..).unwrap_or_default();
    }
    String::from_utf8_lossy(&bytes).into_owned()
}
