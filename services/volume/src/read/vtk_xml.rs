//! VTK's XML files: the elements, arrays and encodings that all kinds share
//! (<https://docs.vtk.org/en/latest/design_documents/VTKFileFormats.html#xml-file-formats>).
//!
//! Arrays are in the formats `ascii`, `binary` (base64) and `appended` (raw or base64). The data are plain or in zlib blocks, with
//! 32- or 64-bit headers.

use std::borrow::Cow;
use std::io::Read;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use quick_xml::XmlVersion;
use quick_xml::events::{BytesStart, Event};
use quick_xml::reader::Reader;

use crate::scalars::{ScalarType, Scalars};

use super::decode::{Packing, Voxels, read_text};
use super::error::{ActualSize, ReadError};
use super::mesh_data::Quantity;
use super::source::Source;

const REMEDY: &str = "correct the sizes or the type, or fetch the file again";

/// A part of a file with arrays.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Section {
    /// Values at points.
    PointData,
    /// Values of cells.
    CellData,
    /// Positions of the points.
    Points,
    /// Points of the cells, and their shapes.
    Cells,
}

impl Section {
    fn of_name(name: &str) -> Option<Self> {
        match name {
            "PointData" => Some(Self::PointData),
            "CellData" => Some(Self::CellData),
            "Points" => Some(Self::Points),
            "Cells" => Some(Self::Cells),
            _ => None,
        }
    }
}

/// The structure of a file. The data are still encoded.
#[derive(Default)]
pub(super) struct Document {
    big_endian: bool,
    wide_headers: bool,
    compressor: Option<String>,
    /// The element of the file's kind, such as `ImageData`.
    pub(super) data_set: Attributes,
    /// Its pieces.
    pub(super) pieces: Vec<Attributes>,
    /// Name of the active scalars of the points, and of the cells.
    pub(super) point_scalars: Option<String>,
    pub(super) cell_scalars: Option<String>,
    pub(super) arrays: Vec<Array>,
    /// Encoding of the appended section, its first byte after `_`, and its end.
    appended: Option<(String, usize, usize)>,
}

/// The attributes of an element, as text.
#[derive(Debug, Default)]
pub(super) struct Attributes(Vec<(String, String)>);

/// One array.
pub(super) struct Array {
    /// Number of its piece, from 0.
    pub(super) piece: usize,
    pub(super) section: Section,
    pub(super) name: String,
    kind: String,
    pub(super) components: usize,
    format: String,
    offset: Option<usize>,
    /// Byte range of inline data.
    inline: (usize, usize),
}

impl Attributes {
    pub(super) fn of(source: Source<'_>, element: &BytesStart<'_>, at: usize) -> Result<Self, ReadError> {
        let wrong = |what: String| source.format(format!("byte {at}"), what, "repair the XML");
        // Without checks for duplicates: they compare each attribute with all before it.
        let mut attributes = element.attributes();
        let pairs = attributes.with_checks(false).map(|attribute| {
            let attribute = attribute.map_err(|e| wrong(e.to_string()))?;
            let value = attribute.normalized_value(XmlVersion::Implicit1_0).map_err(|e| wrong(e.to_string()))?;
            Ok((attribute.key.as_ref().to_owned(), value.into_owned()))
        });
        pairs.collect::<Result<_, _>>().map(Self)
    }

    /// The first value of a key.
    pub(super) fn get(&self, key: &str) -> Option<&str> {
        self.0.iter().find(|(name, _)| name == key).map(|(_, value)| value.as_str())
    }

    fn text(&self, key: &str) -> String {
        self.get(key).unwrap_or_default().to_owned()
    }

    /// The numbers of a key, separated by white space.
    pub(super) fn numbers(&self, source: Source<'_>, key: &str) -> Result<Option<Vec<f64>>, ReadError> {
        let Some(text) = self.get(key) else { return Ok(None) };
        let number = |word: &str| {
            word.parse::<f64>().map_err(|_| source.format(key, format!("`{word}` is not a number"), "correct it"))
        };
        text.split_whitespace().map(number).collect::<Result<_, _>>().map(Some)
    }

    /// The count of a key: a whole number.
    pub(super) fn count(&self, source: Source<'_>, key: &str) -> Result<usize, ReadError> {
        let text = self.get(key).unwrap_or_default();
        text.trim()
            .parse()
            .map_err(|_| source.format(key, format!("`{text}` is not a count"), "give a whole number, 0 or above"))
    }
}

impl Document {
    /// The arrays of a piece.
    pub(super) fn arrays_of(&self, piece: usize) -> &[Array] {
        let start = self.arrays.partition_point(|array| array.piece < piece);
        let end = self.arrays.partition_point(|array| array.piece <= piece);
        self.arrays.get(start..end).unwrap_or_default()
    }
}

/// Whether the first bytes of a file are of VTK's XML, of this kind.
pub(super) fn sniff(first: &[u8], kind: &str) -> bool {
    let holds = |text: &str| first.windows(text.len()).any(|w| w == text.as_bytes());
    holds("<VTKFile") && holds(&format!("\"{kind}\""))
}

impl Document {
    /// Parses a file of one kind, such as `ImageData`.
    pub(super) fn parse(source: Source<'_>, bytes: &[u8], kind: &str) -> Result<Self, ReadError> {
        let mut document = Self::default();
        let mut reader = Reader::from_reader(bytes);
        let mut section = None;
        let mut is_vtk = false;
        loop {
            let event = reader.read_event().map_err(|e| {
                source.format(format!("byte {}", reader.error_position()), e.to_string(), "repair the XML")
            })?;
            let after = reader.buffer_position() as usize;
            let (element, is_empty) = match &event {
                Event::Start(e) => (e, false),
                Event::Empty(e) => (e, true),
                Event::End(e) if Section::of_name(e.name().as_ref()).is_some() => {
                    section = None;
                    continue;
                }
                Event::Eof => break,
                _ => continue,
            };
            let attributes = || Attributes::of(source, element, after);
            match element.name().as_ref() {
                "VTKFile" => {
                    is_vtk = true;
                    let own = attributes()?;
                    if own.text("type") != kind {
                        let what = format!("a VTKFile of type `{}`", own.text("type"));
                        return Err(source.format("VTKFile", what, format!("give a file of type {kind}")));
                    }
                    document.big_endian = own.get("byte_order") == Some("BigEndian");
                    document.wide_headers = own.get("header_type") == Some("UInt64");
                    document.compressor = own.get("compressor").filter(|c| !c.is_empty()).map(str::to_owned);
                }
                "Piece" => document.pieces.push(attributes()?),
                "DataArray" => {
                    if let Some(section) = section {
                        let own = attributes()?;
                        let end = bytes[after..].iter().position(|&b| b == b'<').map_or(bytes.len(), |n| after + n);
                        document.arrays.push(Array {
                            piece: document.pieces.len().saturating_sub(1),
                            section,
                            name: own.text("Name"),
                            kind: own.text("type"),
                            components: own.get("NumberOfComponents").and_then(|n| n.trim().parse().ok()).unwrap_or(1),
                            format: own.text("format"),
                            offset: own.get("offset").and_then(|n| n.trim().parse().ok()),
                            inline: if is_empty { (after, after) } else { (after, end) },
                        });
                    }
                }
                "AppendedData" => {
                    // The data after the underscore may be binary: the XML ends here.
                    let encoding = attributes()?.text("encoding");
                    let underscore = bytes[after..].iter().take(4096).position(|&b| b == b'_').ok_or_else(|| {
                        source.format("AppendedData", "no `_` before the data", "fetch the file again")
                    })?;
                    let start = after + underscore + 1;
                    let section = bytes.get(start..).filter(|_| encoding == "base64").unwrap_or_default();
                    let end = section.iter().position(|&b| b == b'<').map_or(bytes.len(), |n| start + n);
                    document.appended = Some((encoding, start, end));
                    break;
                }
                name if name == kind => document.data_set = attributes()?,
                name if !is_empty => {
                    let Some(named) = Section::of_name(name) else { continue };
                    section = Some(named);
                    match named {
                        Section::PointData => document.point_scalars = attributes()?.get("Scalars").map(str::to_owned),
                        Section::CellData => document.cell_scalars = attributes()?.get("Scalars").map(str::to_owned),
                        Section::Points | Section::Cells => {}
                    }
                }
                _ => {}
            }
        }
        // Of one piece after the other, as they stand in the file.
        if is_vtk { Ok(document) } else { Err(source.format("XML", "no VTKFile element", "give a VTK XML file")) }
    }
}

impl Array {
    /// The quantity that it holds.
    pub(super) fn quantity(&self) -> Quantity {
        let of_cells = self.section == Section::CellData;
        Quantity { name: self.name.clone(), components: self.components, of_cells }
    }

    /// The values of the array, as many as `dims` says.
    pub(super) fn scalars(
        &self,
        source: Source<'_>,
        bytes: &[u8],
        document: &Document,
        dims: [usize; 3],
    ) -> Result<Scalars, ReadError> {
        let place = format!("DataArray `{}`", self.name);
        let scalar = ScalarType::from_vtk_name(&self.kind).ok_or_else(|| {
            source.format(&place, format!("type `{}`", self.kind), "use Int8 to UInt64, Float32 or Float64")
        })?;
        let expected = source.voxel_bytes(dims, scalar)?;
        let inline = &bytes[self.inline.0..self.inline.1];
        let blocks = Blocks { source, place: &place, wide: document.wide_headers, big_endian: document.big_endian };
        let is_packed = document.compressor.is_some();
        let base64 = |text: &[u8]| -> Result<Vec<u8>, ReadError> {
            let decode = |most: u64| decode_base64(source, &place, text, most);
            // Only what the array takes: all arrays of a file may stand in the same section.
            let size = if is_packed { blocks.packed_size(decode)? } else { expected.saturating_add(blocks.word()) };
            decode(size)
        };
        let data: Cow<'_, [u8]> = match self.format.as_str() {
            "ascii" => {
                let text = std::str::from_utf8(inline).map_err(|e| source.format(&place, e.to_string(), REMEDY))?;
                return read_text(source, text, dims, scalar);
            }
            "binary" => base64(inline)?.into(),
            "appended" => {
                let (encoding, start, end) = document.appended.as_ref().ok_or_else(|| {
                    source.format(&place, "the file has no AppendedData section", "fetch the file again")
                })?;
                let offset = self.offset.ok_or_else(|| source.format(&place, "no offset", "fetch the file again"))?;
                let section = start.checked_add(offset).and_then(|at| bytes.get(at..*end)).ok_or_else(|| {
                    source.format(&place, format!("offset {offset} lies past the end of the file"), REMEDY)
                })?;
                match encoding.as_str() {
                    "raw" => Cow::Borrowed(section),
                    "base64" => base64(section)?.into(),
                    other => {
                        return Err(source.format("AppendedData", format!("encoding `{other}`"), "use raw or base64"));
                    }
                }
            }
            other => return Err(source.format(&place, format!("format `{other}`"), "use ascii, binary or appended")),
        };
        let voxels = Voxels { dims, scalar, big_endian: document.big_endian, packing: Packing::Plain, remedy: REMEDY };
        let short = |found| voxels.wrong_size(source, expected, found);
        match document.compressor.as_deref() {
            None => {
                let (size, data) = blocks.number(&data)?;
                if size != expected {
                    return Err(short(ActualSize::Bytes(size)));
                }
                let stored = data.get(..size as usize).ok_or_else(|| short(ActualSize::Bytes(data.len() as u64)))?;
                voxels.read(source, stored, size)
            }
            Some("vtkZLibDataCompressor") => {
                // Types of cells are almost all equal, so the size of the whole file is what counts.
                source.check_expanded(expected, bytes.len() as u64)?;
                let plain = blocks.inflate(&data, expected)?;
                voxels.read(source, plain.as_slice(), plain.len() as u64)
            }
            Some(other) => Err(source.format(
                "VTKFile",
                format!("compressor `{other}`"),
                "write it with zlib or without compression",
            )),
        }
    }
}

/// The length headers before binary data.
struct Blocks<'a> {
    source: Source<'a>,
    place: &'a str,
    wide: bool,
    big_endian: bool,
}

impl Blocks<'_> {
    /// One header number and the rest.
    fn number<'d>(&self, data: &'d [u8]) -> Result<(u64, &'d [u8]), ReadError> {
        let cut = || self.source.format(self.place, "the data break off within their header", REMEDY);
        if self.wide {
            let (head, rest) = data.split_first_chunk::<8>().ok_or_else(cut)?;
            Ok((if self.big_endian { u64::from_be_bytes(*head) } else { u64::from_le_bytes(*head) }, rest))
        } else {
            let (head, rest) = data.split_first_chunk::<4>().ok_or_else(cut)?;
            Ok((u64::from(if self.big_endian { u32::from_be_bytes(*head) } else { u32::from_le_bytes(*head) }), rest))
        }
    }

    /// Bytes of a header number.
    fn word(&self) -> u64 {
        if self.wide { 8 } else { 4 }
    }

    /// The size of zlib blocks with their header, by `decode`, which gives the first bytes of the data.
    fn packed_size(&self, decode: impl Fn(u64) -> Result<Vec<u8>, ReadError>) -> Result<u64, ReadError> {
        let (count, _) = self.number(&decode(self.word())?)?;
        let header = count.saturating_add(3).saturating_mul(self.word());
        let head = decode(header)?;
        let mut sizes = head.get(3 * self.word() as usize..).unwrap_or_default();
        let mut size = header;
        for _ in 0..count {
            let (own, rest) = self.number(sizes)?;
            size = size.saturating_add(own);
            sizes = rest;
        }
        Ok(size)
    }

    /// Joins zlib blocks: `[blocks][block size][last block size][compressed sizes…]`, then the blocks. Stops one byte after
    /// `expected`: that byte shows that the data are too long.
    fn inflate(&self, data: &[u8], expected: u64) -> Result<Vec<u8>, ReadError> {
        let (count, rest) = self.number(data)?;
        let (_, rest) = self.number(rest)?;
        let (_, mut sizes) = self.number(rest)?;
        // Each block holds a byte at least.
        let header = count.checked_mul(self.word()).filter(|_| count <= expected.max(1));
        let mut blocks = header.and_then(|n| sizes.get(n as usize..)).ok_or_else(|| {
            self.source.format(self.place, format!("{count} blocks do not fit into the data"), REMEDY)
        })?;
        let mut plain = Vec::new();
        for block in 0..count {
            let (size, next) = self.number(sizes)?;
            sizes = next;
            let Some((packed, after)) = blocks.split_at_checked(size as usize) else {
                let what = format!("block {block} of {count} has {} of {size} bytes", blocks.len());
                return Err(self.source.format(self.place, what, REMEDY));
            };
            blocks = after;
            let room = (expected + 1).saturating_sub(plain.len() as u64);
            flate2::read::ZlibDecoder::new(packed)
                .take(room)
                .read_to_end(&mut plain)
                .map_err(|e| self.source.format(self.place, format!("block {block} of {count}: {e}"), REMEDY))?;
        }
        Ok(plain)
    }
}

/// Decodes base64 of one or more padded parts: VTK pads the header and the data separately. It stops at `most` bytes, or up to
/// two after them.
fn decode_base64(source: Source<'_>, place: &str, text: &[u8], most: u64) -> Result<Vec<u8>, ReadError> {
    /// Characters that are decoded at once: whole groups of four.
    const PIECE: u64 = 1 << 16;
    let mut clean = text.iter().copied().filter(|b| !b.is_ascii_whitespace()).peekable();
    let mut out = Vec::new();
    let mut piece = Vec::new();
    while (out.len() as u64) < most && clean.peek().is_some() {
        piece.clear();
        let wanted = (most - out.len() as u64).div_ceil(3).saturating_mul(4).min(PIECE) as usize;
        while piece.len() < wanted
            && let Some(character) = clean.next()
        {
            piece.push(character);
            if character == b'=' {
                while let Some(padding) = clean.next_if_eq(&b'=') {
                    piece.push(padding);
                }
                break;
            }
        }
        STANDARD.decode_vec(&piece, &mut out).map_err(|e| source.format(place, format!("base64: {e}"), REMEDY))?;
    }
    Ok(out)
}
