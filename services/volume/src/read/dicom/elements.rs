//! The elements of one DICOM file: <https://dicom.nema.org/medical/dicom/current/output/html/part10.html>.
//!
//! The parser takes the attributes that place and scale voxels, and steps over all others without a look. So names, dates,
//! institutions and descriptions never reach the rest of the reader. Nested sequences have a stack of their own: the depth of a
//! file takes no depth of calls.

use std::io::{self, Read as _};

use sg_input::limits;

use super::MAX_SLICES;

/// Place of the magic, after a preamble of any content.
pub(super) const MAGIC: (usize, &[u8]) = (128, b"DICM");
/// Most sequences and items inside each other.
const MAX_DEPTH: usize = 64;
/// The length of what ends with a delimiter.
const UNDEFINED: u32 = u32::MAX;

const META_GROUP: u32 = 0x0002;
const STORED_CLASS: u32 = 0x0002_0002;
const TRANSFER_SYNTAX: u32 = 0x0002_0010;
const GANTRY_TILT: u32 = 0x0018_1120;
const SLICE_THICKNESS: u32 = 0x0018_0050;
const SLICE_SPACING: u32 = 0x0018_0088;
const SERIES: u32 = 0x0020_000E;
const POSITION: u32 = 0x0020_0032;
const ORIENTATION: u32 = 0x0020_0037;
const SAMPLES: u32 = 0x0028_0002;
const PHOTOMETRIC: u32 = 0x0028_0004;
const FRAMES: u32 = 0x0028_0008;
const ROWS: u32 = 0x0028_0010;
const COLUMNS: u32 = 0x0028_0011;
const PIXEL_SPACING: u32 = 0x0028_0030;
const BITS_ALLOCATED: u32 = 0x0028_0100;
const BITS_STORED: u32 = 0x0028_0101;
const HIGH_BIT: u32 = 0x0028_0102;
const REPRESENTATION: u32 = 0x0028_0103;
const PADDING: u32 = 0x0028_0120;
const PADDING_LIMIT: u32 = 0x0028_0121;
const WINDOW_CENTER: u32 = 0x0028_1050;
const WINDOW_WIDTH: u32 = 0x0028_1051;
const INTERCEPT: u32 = 0x0028_1052;
const SLOPE: u32 = 0x0028_1053;
const MODALITY_LUT: u32 = 0x0028_3000;
const SHARED_GROUPS: u32 = 0x5200_9229;
const FRAME_GROUPS: u32 = 0x5200_9230;
const FLOAT_PIXELS: u32 = 0x7FE0_0008;
const DOUBLE_PIXELS: u32 = 0x7FE0_0009;
const PIXELS: u32 = 0x7FE0_0010;
const ITEM: u32 = 0xFFFE_E000;
const ITEM_END: u32 = 0xFFFE_E00D;
const SEQUENCE_END: u32 = 0xFFFE_E0DD;

/// Functional groups of frames: position, orientation, measures, rescaling and window.
const GROUPS: [u32; 5] = [0x0020_9113, 0x0020_9116, 0x0028_9110, 0x0028_9145, 0x0028_9132];

/// A file that cannot be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Fault {
    /// The bytes end within an element.
    Cut,
    /// What is wrong, and a way. Never a text of the file.
    Wrong(&'static str, &'static str),
    /// The data would expand to more than this many bytes.
    Expands(u64),
}

const REPAIR: &str = "fetch the file again";

/// How the voxels of a file are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Packing {
    Plain,
    RunLengths,
    Jpeg,
    /// Not read; what it is.
    Unread(&'static str),
}

/// How elements are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Encoding {
    explicit: bool,
    big_endian: bool,
}

const EXPLICIT: Encoding = Encoding { explicit: true, big_endian: false };
const IMPLICIT: Encoding = Encoding { explicit: false, big_endian: false };

/// The head of a file.
#[derive(Debug, Clone, Copy)]
pub(super) struct Head {
    encoding: Encoding,
    pub(super) packing: Packing,
    deflated: bool,
    /// Place of the first element behind the head.
    start: usize,
    /// Whether the file lists others: a DICOMDIR.
    pub(super) is_directory: bool,
}

/// What places and scales one frame.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Frame {
    pub(super) position: Option<[f64; 3]>,
    pub(super) orientation: Option<[f64; 6]>,
    /// Lengths between rows and between columns.
    pub(super) spacing: Option<[f64; 2]>,
    pub(super) thickness: Option<f64>,
    pub(super) slope: Option<f64>,
    pub(super) intercept: Option<f64>,
    pub(super) window_center: Option<f64>,
    pub(super) window_width: Option<f64>,
}

impl Frame {
    /// These values, and those of `other` in place of missing ones.
    pub(super) fn or(self, other: Self) -> Self {
        Self {
            position: self.position.or(other.position),
            orientation: self.orientation.or(other.orientation),
            spacing: self.spacing.or(other.spacing),
            thickness: self.thickness.or(other.thickness),
            slope: self.slope.or(other.slope),
            intercept: self.intercept.or(other.intercept),
            window_center: self.window_center.or(other.window_center),
            window_width: self.window_width.or(other.window_width),
        }
    }
}

/// Meaning of the stored values.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) enum Photometric {
    /// High values are bright.
    #[default]
    Monochrome2,
    /// Low values are bright.
    Monochrome1,
    /// Colours, or indices into a palette.
    Color,
}

/// The place of the voxels in the data set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Pixels {
    /// Place of the first byte behind the element's head.
    pub(super) start: usize,
    /// Bytes; `None` for fragments up to a delimiter.
    pub(super) length: Option<usize>,
}

/// The attributes of a file.
#[derive(Clone, Default)]
pub(super) struct Attributes {
    /// Tells series apart. It stays inside the reader.
    pub(super) series: Vec<u8>,
    pub(super) rows: usize,
    pub(super) columns: usize,
    pub(super) frame_count: Option<usize>,
    pub(super) samples: Option<u16>,
    pub(super) photometric: Photometric,
    pub(super) bits_allocated: u16,
    pub(super) bits_stored: Option<u16>,
    pub(super) high_bit: Option<u16>,
    pub(super) signed: bool,
    /// Stored values of places without data: one, or a range.
    pub(super) padding: Option<u16>,
    pub(super) padding_limit: Option<u16>,
    pub(super) gantry_tilt: Option<f64>,
    pub(super) slice_spacing: Option<f64>,
    pub(super) has_modality_lut: bool,
    pub(super) has_float_pixels: bool,
    pub(super) big_endian: bool,
    pub(super) pixels: Option<Pixels>,
    /// Of the whole file.
    pub(super) top: Frame,
    /// Of all frames.
    pub(super) shared: Frame,
    /// Of single frames.
    pub(super) frames: Vec<Frame>,
}

impl Attributes {
    /// Number of frames.
    pub(super) fn frames(&self) -> usize {
        self.frame_count.unwrap_or(1)
    }

    /// What places and scales frame `k`.
    pub(super) fn frame(&self, k: usize) -> Frame {
        self.frames.get(k).copied().unwrap_or_default().or(self.shared).or(self.top)
    }
}

/// A sequence or an item that is open.
#[derive(Debug, Clone, Copy)]
struct Level {
    /// Tag of a sequence; [`ITEM`].
    tag: u32,
    /// Place of its end; `None` up to a delimiter.
    end: Option<usize>,
    encoding: Encoding,
}

struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Cursor<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], Fault> {
        let end = self.at.checked_add(count).ok_or(Fault::Cut)?;
        let taken = self.bytes.get(self.at..end).ok_or(Fault::Cut)?;
        self.at = end;
        Ok(taken)
    }

    fn u16(&mut self, encoding: Encoding) -> Result<u16, Fault> {
        Ok(short(self.take(2)?, encoding.big_endian).unwrap_or_default())
    }

    fn u32(&mut self, encoding: Encoding) -> Result<u32, Fault> {
        let (first, second) = (u32::from(self.u16(encoding)?), u32::from(self.u16(encoding)?));
        Ok(if encoding.big_endian { first << 16 | second } else { second << 16 | first })
    }

    fn tag(&mut self, encoding: Encoding) -> Result<u32, Fault> {
        let (group, element) = (self.u16(encoding)?, self.u16(encoding)?);
        Ok(u32::from(group) << 16 | u32::from(element))
    }

    /// The type and the length of the element behind its tag.
    fn kind(&mut self, encoding: Encoding) -> Result<([u8; 2], u32), Fault> {
        if !encoding.explicit {
            return Ok(([0; 2], self.u32(encoding)?));
        }
        let kind = match self.take(2)? {
            &[a, b] => [a, b],
            _ => return Err(Fault::Cut),
        };
        match &kind {
            b"OB" | b"OD" | b"OF" | b"OL" | b"OV" | b"OW" | b"SQ" | b"SV" | b"UC" | b"UN" | b"UR" | b"UT" | b"UV" => {
                self.take(2)?;
                Ok((kind, self.u32(encoding)?))
            }
            [b'A'..=b'Z', b'A'..=b'Z'] => Ok((kind, u32::from(self.u16(encoding)?))),
            _ => Err(Fault::Wrong("an element without a type", REPAIR)),
        }
    }
}

/// Whether a file starts as DICOM files do.
pub(super) fn has_magic(start: &[u8]) -> bool {
    start.get(MAGIC.0..).is_some_and(|bytes| bytes.starts_with(MAGIC.1))
}

/// Reads the head of a file with the magic.
pub(super) fn head(bytes: &[u8]) -> Result<Head, Fault> {
    let mut cursor = Cursor { bytes, at: MAGIC.0 + MAGIC.1.len() };
    let (mut syntax, mut is_directory) = (None, false);
    loop {
        let start = cursor.at;
        if cursor.bytes.len() == start {
            return Err(Fault::Cut);
        }
        let tag = cursor.tag(EXPLICIT)?;
        if tag >> 16 != META_GROUP {
            let wrong =
                Fault::Wrong("its head names no transfer syntax", "save it anew with the program that wrote it");
            let (encoding, packing, deflated) = syntax.ok_or(wrong)?;
            return Ok(Head { encoding, packing, deflated, start, is_directory });
        }
        let (_, length) = cursor.kind(EXPLICIT)?;
        let value = cursor.take(length as usize)?;
        match tag {
            TRANSFER_SYNTAX => syntax = Some(transfer_syntax(trimmed(value))),
            STORED_CLASS => is_directory = trimmed(value) == b"1.2.840.10008.1.3.10",
            _ => {}
        }
        // The data set of a packed file begins right behind the head, and no tag stands there.
        if let Some((encoding, packing, true)) = syntax
            && cursor.bytes.get(cursor.at..cursor.at.saturating_add(2)).is_some_and(|next| next != [2, 0])
        {
            return Ok(Head { encoding, packing, deflated: true, start: cursor.at, is_directory });
        }
    }
}

/// Encoding, packing of the voxels, and whether the data set is packed, of a transfer syntax.
fn transfer_syntax(name: &[u8]) -> (Encoding, Packing, bool) {
    let unread = |what| (EXPLICIT, Packing::Unread(what), false);
    let Some(rest) = name.strip_prefix(b"1.2.840.10008.1.2") else {
        return unread("a private transfer syntax");
    };
    match rest {
        b"" => (IMPLICIT, Packing::Plain, false),
        b".1" => (EXPLICIT, Packing::Plain, false),
        b".2" => (Encoding { big_endian: true, ..EXPLICIT }, Packing::Plain, false),
        b".1.99" => (EXPLICIT, Packing::Plain, true),
        b".5" => (EXPLICIT, Packing::RunLengths, false),
        b".4.50" | b".4.51" | b".4.57" | b".4.70" => (EXPLICIT, Packing::Jpeg, false),
        b".4.80" | b".4.81" => unread("voxels in JPEG-LS, which is not read"),
        b".4.90" | b".4.91" | b".4.92" | b".4.93" => unread("voxels in JPEG 2000, which is not read"),
        [b'.', b'4', b'.', b'2', b'0', ..] => unread("voxels in HTJ2K, which is not read"),
        _ => unread("a transfer syntax that is not read"),
    }
}

/// The data set behind the head: that of the file, or of a packed file the unpacked one, which then stands in `unpacked`.
pub(super) fn data_set<'a>(head: &Head, bytes: &'a [u8], unpacked: &'a mut Vec<u8>) -> Result<&'a [u8], Fault> {
    let packed = bytes.get(head.start..).ok_or(Fault::Cut)?;
    if !head.deflated {
        return Ok(packed);
    }
    let most = limits::expanded(packed.len() as u64);
    let decoder = flate2::read::DeflateDecoder::new(packed);
    let wrong = |error: io::Error| match error.kind() {
        io::ErrorKind::UnexpectedEof => Fault::Cut,
        _ => Fault::Wrong("the packed elements are damaged", REPAIR),
    };
    decoder.take(most.saturating_add(1)).read_to_end(unpacked).map_err(wrong)?;
    if unpacked.len() as u64 > most { Err(Fault::Expands(most)) } else { Ok(unpacked) }
}

/// Reads the attributes up to the voxels, or up to the end of the bytes where no element is cut.
pub(super) fn attributes(head: &Head, bytes: &[u8]) -> Result<Attributes, Fault> {
    let cursor = Cursor { bytes, at: 0 };
    let found = Attributes { big_endian: head.encoding.big_endian, ..Attributes::default() };
    Parser { cursor, encoding: head.encoding, levels: Vec::new(), found }.read()
}

struct Parser<'a> {
    cursor: Cursor<'a>,
    encoding: Encoding,
    levels: Vec<Level>,
    found: Attributes,
}

impl Parser<'_> {
    fn read(mut self) -> Result<Attributes, Fault> {
        loop {
            self.close_ended()?;
            let encoding = self.levels.last().map_or(self.encoding, |level| level.encoding);
            if self.cursor.at == self.cursor.bytes.len() {
                return if self.levels.is_empty() { Ok(self.found) } else { Err(Fault::Cut) };
            }
            let tag = self.cursor.tag(encoding)?;
            match tag {
                ITEM => self.open_item(encoding)?,
                ITEM_END | SEQUENCE_END => self.close(tag, encoding)?,
                PIXELS if self.levels.is_empty() => {
                    let (_, length) = self.cursor.kind(encoding)?;
                    let length = (length != UNDEFINED).then_some(length as usize);
                    self.found.pixels = Some(Pixels { start: self.cursor.at, length });
                    return Ok(self.found);
                }
                _ => self.element(tag, encoding)?,
            }
        }
    }

    /// Closes what ends here by its length.
    fn close_ended(&mut self) -> Result<(), Fault> {
        while let Some(end) = self.levels.last().and_then(|level| level.end) {
            if end > self.cursor.at {
                break;
            }
            if end < self.cursor.at {
                return Err(Fault::Wrong("an element that is longer than the sequence around it", REPAIR));
            }
            self.levels.pop();
        }
        Ok(())
    }

    fn open(&mut self, tag: u32, length: u32, encoding: Encoding) -> Result<(), Fault> {
        if self.levels.len() >= MAX_DEPTH {
            return Err(Fault::Wrong("sequences in sequences, over 32 deep", REPAIR));
        }
        let end = (length != UNDEFINED).then(|| self.cursor.at.saturating_add(length as usize));
        self.levels.push(Level { tag, end, encoding });
        Ok(())
    }

    fn open_item(&mut self, encoding: Encoding) -> Result<(), Fault> {
        let length = self.cursor.u32(encoding)?;
        let Some(sequence) = self.levels.last().filter(|level| level.tag != ITEM).copied() else {
            return Err(Fault::Wrong("an item outside of a sequence", REPAIR));
        };
        if sequence.tag == FRAME_GROUPS && self.levels.len() == 1 {
            if self.found.frames.len() >= MAX_SLICES {
                return Err(Fault::Wrong("more frames than the limit of 10,000", "divide it"));
            }
            self.found.frames.push(Frame::default());
        }
        self.open(ITEM, length, sequence.encoding)
    }

    fn close(&mut self, tag: u32, encoding: Encoding) -> Result<(), Fault> {
        self.cursor.u32(encoding)?;
        match self.levels.pop() {
            Some(level) if level.end.is_none() && (level.tag == ITEM) == (tag == ITEM_END) => Ok(()),
            _ => Err(Fault::Wrong("an end without a beginning", REPAIR)),
        }
    }

    fn element(&mut self, tag: u32, encoding: Encoding) -> Result<(), Fault> {
        if self.levels.last().is_some_and(|level| level.tag != ITEM) {
            return Err(Fault::Wrong("an element outside of an item", REPAIR));
        }
        let (kind, length) = self.cursor.kind(encoding)?;
        let is_wanted = match self.levels.len() {
            0 => matches!(tag, SHARED_GROUPS | FRAME_GROUPS),
            2 => GROUPS.contains(&tag),
            _ => false,
        };
        let is_top = self.levels.is_empty();
        self.found.has_modality_lut |= is_top && tag == MODALITY_LUT;
        self.found.has_float_pixels |= is_top && matches!(tag, FLOAT_PIXELS | DOUBLE_PIXELS);
        // A sequence of known length that nobody wants is stepped over like any other value.
        if length == UNDEFINED || is_wanted {
            let inside = if &kind == b"UN" { IMPLICIT } else { encoding };
            return self.open(tag, length, inside);
        }
        let value = self.cursor.take(length as usize)?;
        if is_top {
            self.keep_of_file(tag, value, encoding)?;
        }
        match self.frame() {
            Some(frame) => keep_of_frame(frame, tag, value),
            None => Ok(()),
        }
    }

    /// The frame that the open levels describe.
    fn frame(&mut self) -> Option<&mut Frame> {
        match self.levels.as_slice() {
            [] => Some(&mut self.found.top),
            [outer, _, group, _] if GROUPS.contains(&group.tag) => match outer.tag {
                SHARED_GROUPS => Some(&mut self.found.shared),
                FRAME_GROUPS => self.found.frames.last_mut(),
                _ => None,
            },
            _ => None,
        }
    }

    fn keep_of_file(&mut self, tag: u32, value: &[u8], encoding: Encoding) -> Result<(), Fault> {
        let found = &mut self.found;
        let number = || short(value, encoding.big_endian);
        match tag {
            SERIES => found.series = trimmed(value).to_vec(),
            ROWS => found.rows = usize::from(number().unwrap_or_default()),
            COLUMNS => found.columns = usize::from(number().unwrap_or_default()),
            SAMPLES => found.samples = number(),
            BITS_ALLOCATED => found.bits_allocated = number().unwrap_or_default(),
            BITS_STORED => found.bits_stored = number(),
            HIGH_BIT => found.high_bit = number(),
            REPRESENTATION => found.signed = number() == Some(1),
            PADDING => found.padding = number(),
            PADDING_LIMIT => found.padding_limit = number(),
            PHOTOMETRIC => {
                found.photometric = match trimmed(value) {
                    b"MONOCHROME2" | b"" => Photometric::Monochrome2,
                    b"MONOCHROME1" => Photometric::Monochrome1,
                    _ => Photometric::Color,
                }
            }
            FRAMES => {
                let count = numbers::<1>(value)?.map(|[count]| count);
                if count.is_some_and(|count| count.fract() != 0.0 || !(1.0..=MAX_SLICES as f64).contains(&count)) {
                    return Err(Fault::Wrong(
                        "its number of frames is not a whole number from 1 to 10,000",
                        "divide it",
                    ));
                }
                found.frame_count = count.map(|count| count as usize);
            }
            GANTRY_TILT => found.gantry_tilt = numbers::<1>(value).ok().flatten().map(|[tilt]| tilt),
            SLICE_SPACING => found.slice_spacing = numbers::<1>(value).ok().flatten().map(|[length]| length),
            _ => {}
        }
        Ok(())
    }
}

/// Takes a value that places or scales a frame.
fn keep_of_frame(frame: &mut Frame, tag: u32, value: &[u8]) -> Result<(), Fault> {
    // Of several windows or thicknesses the first one counts.
    let first = |value: &[u8]| numbers::<1>(value.split(|&b| b == b'\\').next().unwrap_or_default());
    let one = |value: &[u8]| Ok(numbers::<1>(value)?.map(|[number]| number));
    match tag {
        POSITION => frame.position = numbers(value)?,
        ORIENTATION => frame.orientation = numbers(value)?,
        PIXEL_SPACING => frame.spacing = numbers(value)?,
        SLICE_THICKNESS => frame.thickness = first(value).ok().flatten().map(|[length]| length),
        SLOPE => frame.slope = one(value)?,
        INTERCEPT => frame.intercept = one(value)?,
        WINDOW_CENTER => frame.window_center = first(value).ok().flatten().map(|[center]| center),
        WINDOW_WIDTH => frame.window_width = first(value).ok().flatten().map(|[width]| width),
        _ => {}
    }
    Ok(())
}

/// A value without the spaces and zeros that fill it up.
fn trimmed(value: &[u8]) -> &[u8] {
    let value = value.trim_ascii();
    let end = value.iter().rposition(|&b| b != 0 && b != b' ').map_or(0, |last| last + 1);
    value.get(..end).unwrap_or_default()
}

fn short(value: &[u8], big_endian: bool) -> Option<u16> {
    let bytes = *value.first_chunk::<2>()?;
    Some(if big_endian { u16::from_be_bytes(bytes) } else { u16::from_le_bytes(bytes) })
}

/// `N` numbers as text; `None` for an empty value.
fn numbers<const N: usize>(value: &[u8]) -> Result<Option<[f64; N]>, Fault> {
    let value = trimmed(value);
    if value.is_empty() {
        return Ok(None);
    }
    let wrong = Fault::Wrong("a position, orientation, spacing, rescaling or frame count that is no number", REPAIR);
    let mut found = [0.0; N];
    let mut words = value.split(|&b| b == b'\\');
    for number in &mut found {
        let word = words.next().and_then(|word| std::str::from_utf8(word).ok()).ok_or(wrong)?;
        *number = word.trim().parse().ok().filter(|number: &f64| number.is_finite()).ok_or(wrong)?;
    }
    if words.next().is_some() { Err(wrong) } else { Ok(Some(found)) }
}
