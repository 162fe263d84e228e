//! VTK image data (`.vti`): <https://docs.vtk.org/en/latest/design_documents/VTKFileFormats.html#xml-file-formats>.
//!
//! The reader takes one-component arrays in the formats `ascii`, `binary` (base64) and `appended` (raw or base64). The data
//! are plain or in zlib blocks, with 32- or 64-bit headers. The active scalars go before the first one-component array,
//! and point data before cell data.

use std::borrow::Cow;
use std::io::Read;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use glam::{DMat3, DVec3};
use quick_xml::XmlVersion;
use quick_xml::events::{BytesStart, Event};
use quick_xml::reader::Reader;

use crate::grid::Grid;
use crate::scalars::{ScalarType, Scalars};
use crate::volume::Volume;

use super::decode::{Packing, Voxels, read_text};
use super::error::{ActualSize, ReadError};
use super::format::VolumeFormat;
use super::source::Source;

const REMEDY: &str = "correct the extents or the type, or fetch the file again";

/// VTK image data.
pub(super) struct VtkImageData;

impl VolumeFormat for VtkImageData {
    const NAME: &'static str = "VTK image data";
    const ENDINGS: &'static [&'static str] = &[".vti"];

    fn sniff(_name: &str, first: &[u8]) -> bool {
        let holds = |text: &str| first.windows(text.len()).any(|w| w == text.as_bytes());
        holds("<VTKFile") && holds("\"ImageData\"")
    }

    fn read(source: Source<'_>) -> Result<Volume, ReadError> {
        read(source)
    }
}

fn read(source: Source<'_>) -> Result<Volume, ReadError> {
    let (file, length) = source.open()?;
    // A file is never larger than twice its voxels and a header.
    let limit = source.limits.voxel_bytes.saturating_mul(2).saturating_add(1 << 20);
    if length > limit {
        return Err(ReadError::TooLarge { path: source.path.to_owned(), bytes: length, limit });
    }
    let mut bytes = Vec::new();
    bytes.try_reserve_exact(length as usize).map_err(|_| source.io(std::io::ErrorKind::OutOfMemory.into()))?;
    file.take(length).read_to_end(&mut bytes).map_err(|e| source.io(e))?;

    let document = Document::parse(source, &bytes)?;
    let array = document.array(source)?;
    let (dims, grid) = document.image.grid(source, array.of_cells)?;
    let scalars = array.scalars(source, &bytes, &document, dims)?;
    let name = Some(array.name.clone()).filter(|n| !n.is_empty());
    Volume::new(grid, scalars, name).map_err(|e| source.format("voxels", e.to_string(), REMEDY))
}

#[derive(Default)]
struct Document {
    big_endian: bool,
    wide_headers: bool,
    compressor: Option<String>,
    image: Image,
    point_scalars: Option<String>,
    cell_scalars: Option<String>,
    arrays: Vec<Array>,
    /// Encoding of the appended section, and the offset of its first byte after `_`.
    appended: Option<(String, usize)>,
}

#[derive(Default)]
struct Image {
    whole_extent: Option<[i64; 6]>,
    piece_extent: Option<[i64; 6]>,
    pieces: usize,
    origin: DVec3,
    spacing: Option<DVec3>,
    direction: Option<DMat3>,
}

struct Array {
    name: String,
    kind: String,
    components: usize,
    format: String,
    offset: Option<usize>,
    of_cells: bool,
    /// Byte range of inline data.
    inline: (usize, usize),
}

impl Document {
    fn parse(source: Source<'_>, bytes: &[u8]) -> Result<Self, ReadError> {
        let mut document = Self::default();
        let mut reader = Reader::from_reader(bytes);
        let mut section = None;
        let mut seen_root = false;
        loop {
            let event = reader.read_event().map_err(|e| {
                source.format(format!("byte {}", reader.error_position()), e.to_string(), "repair the XML")
            })?;
            let after = reader.buffer_position() as usize;
            let (element, is_empty) = match &event {
                Event::Start(e) => (e, false),
                Event::Empty(e) => (e, true),
                Event::End(e) if matches!(e.name().as_ref(), "PointData" | "CellData") => {
                    section = None;
                    continue;
                }
                Event::Eof => break,
                _ => continue,
            };
            let text = |key| attribute(source, element, key, after);
            match element.name().as_ref() {
                "VTKFile" => {
                    seen_root = true;
                    let kind = text("type")?.unwrap_or_default();
                    if kind != "ImageData" {
                        let what = format!("a VTKFile of type `{kind}`");
                        return Err(source.format("VTKFile", what, "give a file of type ImageData"));
                    }
                    document.big_endian = text("byte_order")?.as_deref() == Some("BigEndian");
                    document.wide_headers = text("header_type")?.as_deref() == Some("UInt64");
                    document.compressor = text("compressor")?.filter(|c| !c.is_empty());
                }
                "ImageData" => {
                    let numbers = |key| numbers_attribute(source, element, key, after);
                    document.image.whole_extent = extent(source, numbers("WholeExtent")?, "WholeExtent")?;
                    if let Some(o) = triple(source, numbers("Origin")?, "Origin")? {
                        document.image.origin = o;
                    }
                    document.image.spacing = triple(source, numbers("Spacing")?, "Spacing")?;
                    document.image.direction = match numbers("Direction")? {
                        None => None,
                        // Row major in the file.
                        Some(d) => {
                            Some(<[f64; 9]>::try_from(d).map(|d| DMat3::from_cols_array(&d).transpose()).map_err(
                                |d| source.format("Direction", format!("{} numbers", d.len()), "give 9 numbers"),
                            )?)
                        }
                    };
                }
                "Piece" => {
                    document.image.pieces += 1;
                    let numbers = numbers_attribute(source, element, "Extent", after)?;
                    document.image.piece_extent = extent(source, numbers, "Extent of a Piece")?;
                }
                "PointData" if !is_empty => {
                    section = Some(false);
                    document.point_scalars = text("Scalars")?;
                }
                "CellData" if !is_empty => {
                    section = Some(true);
                    document.cell_scalars = text("Scalars")?;
                }
                "DataArray" => {
                    if let Some(of_cells) = section {
                        let end = bytes[after..].iter().position(|&b| b == b'<').map_or(bytes.len(), |n| after + n);
                        document.arrays.push(Array {
                            name: text("Name")?.unwrap_or_default(),
                            kind: text("type")?.unwrap_or_default(),
                            components: text("NumberOfComponents")?.and_then(|n| n.trim().parse().ok()).unwrap_or(1),
                            format: text("format")?.unwrap_or_default(),
                            offset: text("offset")?.and_then(|n| n.trim().parse().ok()),
                            of_cells,
                            inline: if is_empty { (after, after) } else { (after, end) },
                        });
                    }
                }
                "AppendedData" => {
                    // The data after the underscore may be binary: the XML ends here.
                    let encoding = text("encoding")?.unwrap_or_default();
                    let underscore = bytes[after..].iter().take(4096).position(|&b| b == b'_').ok_or_else(|| {
                        source.format("AppendedData", "no `_` before the data", "fetch the file again")
                    })?;
                    document.appended = Some((encoding, after + underscore + 1));
                    break;
                }
                _ => {}
            }
        }
        if seen_root { Ok(document) } else { Err(source.format("XML", "no VTKFile element", "give a VTK XML file")) }
    }

    /// The array to read.
    fn array(&self, source: Source<'_>) -> Result<&Array, ReadError> {
        let scalar = |of_cells: bool, active: &Option<String>| {
            let mut of = self.arrays.iter().filter(|a| a.of_cells == of_cells && a.components == 1);
            let named = of.clone().find(|a| active.as_deref() == Some(a.name.as_str()));
            named.or_else(|| of.next())
        };
        scalar(false, &self.point_scalars).or_else(|| scalar(true, &self.cell_scalars)).ok_or_else(|| {
            source.format(
                "PointData",
                format!("no array of one component among {}", self.arrays.len()),
                "store a scalar array (compute a magnitude or a component first)",
            )
        })
    }
}

impl Image {
    fn grid(&self, source: Source<'_>, of_cells: bool) -> Result<([usize; 3], Grid), ReadError> {
        let remedy = "store the image as one piece with its WholeExtent";
        let whole = self.whole_extent.ok_or_else(|| source.format("ImageData", "no WholeExtent", remedy))?;
        if self.pieces > 1 || self.piece_extent.is_some_and(|p| p != whole) {
            return Err(source.format("Piece", "the image is stored in parts", remedy));
        }
        let mut dims = [0_usize; 3];
        let mut first = DVec3::ZERO;
        for k in 0..3 {
            let points = whole[2 * k + 1].checked_sub(whole[2 * k]).and_then(|n| n.checked_add(1));
            let values = points.and_then(|n| if of_cells { n.checked_sub(1) } else { Some(n) });
            dims[k] = values.and_then(|n| usize::try_from(n).ok()).unwrap_or(0);
            first[k] = whole[2 * k] as f64 + if of_cells { 0.5 } else { 0.0 };
        }
        let spacing = self.spacing.unwrap_or(DVec3::ONE);
        let direction = self.direction.unwrap_or(DMat3::IDENTITY);
        let origin = self.origin + direction * (spacing * first);
        let grid = Grid::new(dims, spacing, origin, direction).map_err(|e| source.grid(e))?;
        Ok((dims, grid))
    }
}

impl Array {
    fn scalars(
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
        let data: Cow<'_, [u8]> = match self.format.as_str() {
            "ascii" => {
                let text = std::str::from_utf8(inline).map_err(|e| source.format(&place, e.to_string(), REMEDY))?;
                return read_text(source, text, dims, scalar);
            }
            "binary" => decode_base64(source, &place, inline)?.into(),
            "appended" => {
                let (encoding, start) = document.appended.as_ref().ok_or_else(|| {
                    source.format(&place, "the file has no AppendedData section", "fetch the file again")
                })?;
                let offset = self.offset.ok_or_else(|| source.format(&place, "no offset", "fetch the file again"))?;
                let section = start.checked_add(offset).and_then(|at| bytes.get(at..)).ok_or_else(|| {
                    source.format(&place, format!("offset {offset} lies past the end of the file"), REMEDY)
                })?;
                match encoding.as_str() {
                    "raw" => Cow::Borrowed(section),
                    "base64" => {
                        let end = section.iter().position(|&b| b == b'<').unwrap_or(section.len());
                        decode_base64(source, &place, &section[..end])?.into()
                    }
                    other => {
                        return Err(source.format("AppendedData", format!("encoding `{other}`"), "use raw or base64"));
                    }
                }
            }
            other => return Err(source.format(&place, format!("format `{other}`"), "use ascii, binary or appended")),
        };
        let blocks = Blocks { source, place: &place, wide: document.wide_headers, big_endian: document.big_endian };
        let voxels = Voxels { dims, scalar, big_endian: document.big_endian, packing: Packing::Plain, remedy: REMEDY };
        let short = |found| voxels.wrong_size(source, expected, found);
        match document.compressor.as_deref() {
            None => {
                let (size, data) = blocks.number(&data)?;
                let stored = data.get(..size as usize).ok_or_else(|| short(ActualSize::Bytes(data.len() as u64)))?;
                voxels.read(source, stored, size)
            }
            Some("vtkZLibDataCompressor") => {
                source.check_expanded(expected, data.len() as u64)?;
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

    /// Joins zlib blocks: `[blocks][block size][last block size][compressed sizes…]`, then the blocks. Stops one byte after
    /// `expected`: that byte shows that the data are too long.
    fn inflate(&self, data: &[u8], expected: u64) -> Result<Vec<u8>, ReadError> {
        let (count, rest) = self.number(data)?;
        let (_, rest) = self.number(rest)?;
        let (_, mut sizes) = self.number(rest)?;
        let header = count.checked_mul(if self.wide { 8 } else { 4 });
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

/// Decodes base64 of one or more padded parts: VTK pads the header and the data separately.
fn decode_base64(source: Source<'_>, place: &str, text: &[u8]) -> Result<Vec<u8>, ReadError> {
    let clean: Vec<u8> = text.iter().copied().filter(|b| !b.is_ascii_whitespace()).collect();
    let mut out = Vec::with_capacity(clean.len() / 4 * 3);
    let mut rest = clean.as_slice();
    while !rest.is_empty() {
        let padding = rest.iter().position(|&b| b == b'=');
        let end = padding.map_or(rest.len(), |p| p + rest[p..].iter().take_while(|&&b| b == b'=').count());
        STANDARD
            .decode_vec(&rest[..end], &mut out)
            .map_err(|e| source.format(place, format!("base64: {e}"), REMEDY))?;
        rest = &rest[end..];
    }
    Ok(out)
}

fn attribute(source: Source<'_>, e: &BytesStart<'_>, key: &str, at: usize) -> Result<Option<String>, ReadError> {
    let wrong = |what: String| source.format(format!("byte {at}"), what, "repair the XML");
    // Without checks for duplicates: they compare each attribute with all before it.
    match e.attributes().with_checks(false).find(|a| a.as_ref().map_or(true, |a| a.key.as_ref() == key)).transpose() {
        Err(error) => Err(wrong(error.to_string())),
        Ok(None) => Ok(None),
        Ok(Some(a)) => match a.normalized_value(XmlVersion::Implicit1_0) {
            Ok(value) => Ok(Some(value.into_owned())),
            Err(error) => Err(wrong(error.to_string())),
        },
    }
}

fn numbers_attribute(
    source: Source<'_>,
    e: &BytesStart<'_>,
    key: &str,
    at: usize,
) -> Result<Option<Vec<f64>>, ReadError> {
    let Some(text) = attribute(source, e, key, at)? else { return Ok(None) };
    text.split_whitespace()
        .map(|w| w.parse::<f64>().map_err(|_| source.format(key, format!("`{w}` is not a number"), "correct it")))
        .collect::<Result<_, _>>()
        .map(Some)
}

fn triple(source: Source<'_>, numbers: Option<Vec<f64>>, place: &str) -> Result<Option<DVec3>, ReadError> {
    numbers
        .map(|n| {
            <[f64; 3]>::try_from(n)
                .map(DVec3::from_array)
                .map_err(|n| source.format(place, format!("{} numbers", n.len()), "give 3 numbers"))
        })
        .transpose()
}

fn extent(source: Source<'_>, numbers: Option<Vec<f64>>, place: &str) -> Result<Option<[i64; 6]>, ReadError> {
    let Some(n) = numbers else { return Ok(None) };
    match <[f64; 6]>::try_from(n) {
        Ok(n) if n.iter().all(|x| x.fract() == 0.0 && x.abs() < 1e9) => Ok(Some(n.map(|x| x as i64))),
        _ => Err(source.format(place, "six whole numbers are needed", "give x0 x1 y0 y1 z0 z1")),
    }
}
