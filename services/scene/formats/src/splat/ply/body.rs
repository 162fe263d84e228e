//! The rows after the header as packed little-endian rows, for every encoding.

use std::ops::Range;

use super::Scalar;
use super::header::{Element, Encoding, Header, Kind, Property, printable};
use super::table::{Column, Table};
use crate::splat::problem::Problem;

/// A PLY file in memory.
#[derive(Debug)]
pub(crate) struct PlyFile {
    /// Comment lines without the word `comment`.
    pub(crate) comments: Vec<String>,
    /// Bytes after the last element.
    pub(crate) trailing: usize,
    parts: Vec<Part>,
    data: Vec<u8>,
}

#[derive(Debug)]
struct Part {
    name: String,
    rows: usize,
    stride: usize,
    columns: Vec<Column>,
    range: Range<usize>,
    has_list: bool,
}

impl PlyFile {
    /// The bytes of a file of `length` bytes that [`PlyFile::parse`] needs, from its first [`MAX_HEADER`](super::MAX_HEADER) bytes. Counts in the
    /// header are checked against the length. Bytes after the last element are not needed.
    pub(crate) fn needed(start: &[u8], length: u64) -> Result<u64, Problem> {
        let header = Header::parse(start)?;
        let has_list = |e: &Element| e.properties.iter().any(|p| matches!(p.kind, Kind::List { .. }));
        if header.encoding == Encoding::Ascii || header.elements.iter().any(has_list) {
            return Ok(length);
        }
        let mut at = header.length as u64;
        for element in &header.elements {
            at += row_bytes(element, length.saturating_sub(at))?;
        }
        Ok(at)
    }

    /// Parses the needed bytes of a file of `length` bytes. Counts in the header are checked before memory is allocated.
    pub(crate) fn parse(bytes: Vec<u8>, length: u64) -> Result<Self, Problem> {
        let unread = usize::try_from(length.saturating_sub(bytes.len() as u64)).unwrap_or(usize::MAX);
        let header = Header::parse(&bytes)?;
        let mut parts = Vec::with_capacity(header.elements.len());
        let (data, trailing) = match header.encoding {
            Encoding::Ascii => {
                let mut data = Vec::new();
                let mut lines = TextLines::new(&bytes, &header);
                for element in &header.elements {
                    let start = data.len();
                    read_text(element, &mut lines, &mut data)?;
                    parts.push(part(element, start..data.len())?);
                }
                (data, lines.rest().trim_ascii().len())
            }
            encoding => {
                let mut data = bytes;
                let mut at = header.length;
                for element in &header.elements {
                    let length = binary_length(element, encoding, data.get(at..).unwrap_or_default())?;
                    parts.push(part(element, at..at + length)?);
                    at += length;
                }
                if encoding == Encoding::BigEndian {
                    for part in parts.iter().filter(|p| !p.has_list) {
                        swap_rows(part, &mut data);
                    }
                }
                let trailing = (data.len() - at).saturating_add(unread);
                (data, trailing)
            }
        };
        Ok(Self { comments: header.comments, trailing, parts, data })
    }

    /// The rows of an element whose properties are all scalars.
    pub(crate) fn table(&self, name: &str) -> Result<Option<Table<'_>>, Problem> {
        let Some(part) = self.parts.iter().find(|p| p.name == name) else { return Ok(None) };
        if part.has_list {
            return Err(Problem::new(
                format!("element {name}"),
                "it has a list property",
                "Gaussians have scalar properties only",
            ));
        }
        let data = self.data.get(part.range.clone()).unwrap_or_default();
        Ok(Some(Table::new(&part.name, part.rows, part.stride, &part.columns, data)))
    }

    /// [`PlyFile::table`] of an element that must be there.
    pub(crate) fn required_table(&self, name: &str) -> Result<Table<'_>, Problem> {
        self.table(name)?.ok_or_else(|| {
            Problem::new("header", format!("there is no element `{name}`"), "the file is damaged: write it again")
        })
    }

    /// Whether the file has an element of this name.
    pub(crate) fn has(&self, name: &str) -> bool {
        self.element_names().any(|n| n == name)
    }

    /// Names of the elements in file order.
    pub(crate) fn element_names(&self) -> impl Iterator<Item = &str> {
        self.parts.iter().map(|p| p.name.as_str())
    }
}

fn part(element: &Element, range: Range<usize>) -> Result<Part, Problem> {
    let has_list = element.properties.iter().any(|p| matches!(p.kind, Kind::List { .. }));
    let mut stride = 0;
    let mut columns = Vec::with_capacity(element.properties.len());
    for property in &element.properties {
        if let Kind::Scalar(scalar) = property.kind {
            columns.push(Column { name: property.name.clone(), scalar, offset: stride });
            stride += scalar.size();
        }
    }
    if stride == 0 && !has_list && element.count > 0 {
        return Err(Problem::new(format!("element {}", element.name), "it has rows but no property", "remove it"));
    }
    let rows = usize::try_from(element.count).map_err(|_| too_long(element, "this machine's address space"))?;
    Ok(Part { name: element.name.clone(), rows, stride, columns, range, has_list })
}

fn too_long(element: &Element, than: &str) -> Problem {
    Problem::new(
        format!("element {}", element.name),
        format!("{} rows do not fit {than}", element.count),
        "the file is cut off or its header is wrong: write it again",
    )
}

/// Bytes of an element's rows, checked against the length of the file.
fn binary_length(element: &Element, encoding: Encoding, rest: &[u8]) -> Result<usize, Problem> {
    if element.properties.iter().any(|p| matches!(p.kind, Kind::List { .. })) {
        return list_length(element, encoding, rest);
    }
    row_bytes(element, rest.len() as u64).map(|bytes| usize::try_from(bytes).unwrap_or(usize::MAX))
}

/// Bytes of the rows of an element without lists, of which `have` bytes follow.
fn row_bytes(element: &Element, have: u64) -> Result<u64, Problem> {
    let size = |p: &Property| if let Kind::Scalar(s) = p.kind { s.size() as u64 } else { 0 };
    let stride: u64 = element.properties.iter().map(size).sum();
    match element.count.checked_mul(stride) {
        Some(need) if need <= have => Ok(need),
        _ => Err(Problem::new(
            format!("element {}, row {}", element.name, have / stride.max(1)),
            format!("{} rows of {stride} bytes are announced, only {have} bytes follow", element.count),
            "the file is cut off or its header is wrong: write it again",
        )),
    }
}

/// Bytes of the rows of an element with lists. Such rows have different lengths.
fn list_length(element: &Element, encoding: Encoding, rest: &[u8]) -> Result<usize, Problem> {
    let mut at = 0_usize;
    // Each row takes at least the byte of its list's length, so the file bounds the loop.
    for row in 0..element.count {
        for property in &element.properties {
            let step = match property.kind {
                Kind::Scalar(s) => Some(s.size()),
                Kind::List { count, item } => rest
                    .get(at..)
                    .and_then(|r| list_count(r, count, encoding))
                    .and_then(|n| n.checked_mul(item.size()))
                    .and_then(|n| n.checked_add(count.size())),
            };
            at = step.and_then(|s| at.checked_add(s)).filter(|&a| a <= rest.len()).ok_or_else(|| {
                Problem::new(
                    format!("element {}, row {row}, property {}", element.name, property.name),
                    "the file ends inside it",
                    "the file is cut off: write it again",
                )
            })?;
        }
    }
    Ok(at)
}

fn list_count(bytes: &[u8], scalar: Scalar, encoding: Encoding) -> Option<usize> {
    let mut word = [0_u8; 8];
    let size = scalar.size();
    for (k, byte) in bytes.get(..size)?.iter().enumerate() {
        let to = if encoding == Encoding::BigEndian { size - 1 - k } else { k };
        *word.get_mut(to)? = *byte;
    }
    match scalar {
        Scalar::F32 | Scalar::F64 => None,
        _ => usize::try_from(u64::from_le_bytes(word)).ok(),
    }
}

fn swap_rows(part: &Part, data: &mut [u8]) {
    let Some(rows) = data.get_mut(part.range.clone()) else { return };
    if part.stride == 0 {
        return;
    }
    for row in rows.chunks_exact_mut(part.stride) {
        for column in &part.columns {
            if let Some(value) = row.get_mut(column.offset..column.offset + column.scalar.size()) {
                value.reverse();
            }
        }
    }
}

struct TextLines<'a> {
    bytes: &'a [u8],
    at: usize,
    number: usize,
}

impl<'a> TextLines<'a> {
    fn new(bytes: &'a [u8], header: &Header) -> Self {
        Self { bytes, at: header.length, number: header.lines }
    }

    fn rest(&self) -> &'a [u8] {
        self.bytes.get(self.at..).unwrap_or_default()
    }

    /// The next line that is not blank, with its number in the file.
    fn next(&mut self) -> Option<(usize, &'a [u8])> {
        loop {
            let rest = self.rest();
            if rest.is_empty() {
                return None;
            }
            let end = rest.iter().position(|&b| b == b'\n').unwrap_or(rest.len() - 1) + 1;
            let line = rest.get(..end)?.trim_ascii();
            self.at += end;
            self.number += 1;
            if !line.is_empty() {
                return Some((self.number, line));
            }
        }
    }
}

fn read_text(element: &Element, lines: &mut TextLines<'_>, data: &mut Vec<u8>) -> Result<(), Problem> {
    let skip = element.properties.iter().any(|p| matches!(p.kind, Kind::List { .. }));
    let properties = element.properties.len().max(1) as u64;
    // A value takes a digit and a separator, the last one of the file perhaps no separator.
    if element.count.checked_mul(properties * 2).is_none_or(|need| need > lines.rest().len() as u64 + 1) {
        return Err(too_long(element, "the text that follows"));
    }
    for row in 0..element.count {
        let Some((number, line)) = lines.next() else {
            return Err(Problem::new(
                format!("element {}, row {row}", element.name),
                format!("{} rows are announced, the file ends", element.count),
                "the file is cut off or its header is wrong: write it again",
            ));
        };
        if skip {
            continue;
        }
        let mut words = line.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty());
        for property in &element.properties {
            let Kind::Scalar(scalar) = property.kind else { continue };
            let word = words.next().and_then(|w| std::str::from_utf8(w).ok()).unwrap_or_default();
            if !push_number(word, scalar, data) {
                return Err(Problem::new(
                    format!("line {number}, property {}", property.name),
                    format!("`{}` is no {}", printable(word), scalar.name()),
                    format!("write {} numbers in each row of element {}", element.properties.len(), element.name),
                ));
            }
        }
        if words.next().is_some() {
            return Err(Problem::new(
                format!("line {number}"),
                format!("more than {} numbers", element.properties.len()),
                format!("write one row of element {} a line", element.name),
            ));
        }
    }
    Ok(())
}

fn push_number(word: &str, scalar: Scalar, data: &mut Vec<u8>) -> bool {
    fn put<const N: usize>(data: &mut Vec<u8>, bytes: Option<[u8; N]>) -> bool {
        bytes.is_some_and(|b| {
            data.extend_from_slice(&b);
            true
        })
    }
    match scalar {
        Scalar::I8 => put(data, word.parse::<i8>().ok().map(i8::to_le_bytes)),
        Scalar::U8 => put(data, word.parse::<u8>().ok().map(u8::to_le_bytes)),
        Scalar::I16 => put(data, word.parse::<i16>().ok().map(i16::to_le_bytes)),
        Scalar::U16 => put(data, word.parse::<u16>().ok().map(u16::to_le_bytes)),
        Scalar::I32 => put(data, word.parse::<i32>().ok().map(i32::to_le_bytes)),
        Scalar::U32 => put(data, word.parse::<u32>().ok().map(u32::to_le_bytes)),
        Scalar::F32 => put(data, word.parse::<f32>().ok().map(f32::to_le_bytes)),
        Scalar::F64 => put(data, word.parse::<f64>().ok().map(f64::to_le_bytes)),
    }
}
