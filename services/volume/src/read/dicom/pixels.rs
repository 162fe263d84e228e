//! The stored values of one frame: plain, run lengths or JPEG.

use std::ops::RangeInclusive;

use jpeg_decoder::{Decoder, PixelFormat};

use super::elements::{Attributes, Fault, Packing, Photometric};

const ITEM: [u8; 4] = [0xFE, 0xFF, 0x00, 0xE0];
const SEQUENCE_END: [u8; 4] = [0xFE, 0xFF, 0xDD, 0xE0];
const REPAIR: &str = "fetch the file again";

/// The voxels of a file.
pub(super) struct FrameData<'a> {
    attributes: &'a Attributes,
    packing: Packing,
    /// Bytes of each frame; fragments are joined by [`FrameData::frame`].
    parts: Vec<Vec<&'a [u8]>>,
}

impl<'a> FrameData<'a> {
    /// The voxels in `data`, the data set of `attributes`.
    pub(super) fn of(attributes: &'a Attributes, packing: Packing, data: &'a [u8]) -> Result<Self, Fault> {
        let Some(pixels) = attributes.pixels else { return Err(Fault::Wrong("no voxels", "leave the file out")) };
        let behind = data.get(pixels.start..).ok_or(Fault::Cut)?;
        let parts = match (packing, pixels.length) {
            (Packing::Plain, Some(length)) => plain_frames(attributes, behind.get(..length).ok_or(Fault::Cut)?)?,
            (Packing::RunLengths | Packing::Jpeg, None) => fragments_of_frames(behind, attributes.frames())?,
            _ => return Err(Fault::Wrong("voxels that do not fit its transfer syntax", REPAIR)),
        };
        Ok(Self { attributes, packing, parts })
    }

    /// The stored values of frame `k`, rows of columns.
    pub(super) fn frame(&self, k: usize) -> Result<Vec<i64>, Fault> {
        let parts = self.parts.get(k).ok_or(Fault::Cut)?;
        let joined;
        let bytes: &[u8] = match parts.as_slice() {
            [one] => one,
            several => {
                joined = several.concat();
                &joined
            }
        };
        let layout = Layout::of(self.attributes);
        match self.packing {
            Packing::Plain => Ok(layout.values(bytes, self.attributes.big_endian)),
            Packing::RunLengths => Ok(layout.values(&run_lengths(self.attributes, bytes)?, false)),
            Packing::Jpeg => jpeg(self.attributes, layout, bytes),
            Packing::Unread(what) => Err(Fault::Wrong(what, "unpack it with `gdcmconv --raw`")),
        }
    }
}

/// Values of one frame.
fn count(attributes: &Attributes) -> usize {
    attributes.rows.saturating_mul(attributes.columns)
}

fn bytes_of_value(attributes: &Attributes) -> usize {
    usize::from(attributes.bits_allocated / 8)
}

fn plain_frames<'a>(attributes: &Attributes, bytes: &'a [u8]) -> Result<Vec<Vec<&'a [u8]>>, Fault> {
    let size = count(attributes).saturating_mul(bytes_of_value(attributes)).max(1);
    // An odd number of bytes is filled up to an even one.
    if bytes.len() / size < attributes.frames() {
        return Err(Fault::Wrong("fewer voxels than its rows, columns and frames say", REPAIR));
    }
    Ok(bytes.chunks_exact(size).take(attributes.frames()).map(|frame| vec![frame]).collect())
}

/// The fragments of each frame: a table of offsets, then the fragments.
fn fragments_of_frames(bytes: &[u8], frames: usize) -> Result<Vec<Vec<&[u8]>>, Fault> {
    let mut fragments = Vec::new();
    let mut table: Option<&[u8]> = None;
    let (mut rest, mut offset) = (bytes, 0_u64);
    loop {
        let (head, behind) = rest.split_first_chunk::<8>().ok_or(Fault::Cut)?;
        let [a, b, c, d, length @ ..] = *head;
        if [a, b, c, d] == SEQUENCE_END {
            break;
        }
        if [a, b, c, d] != ITEM {
            return Err(Fault::Wrong("voxels that are no fragments", REPAIR));
        }
        let length = u32::from_le_bytes(length) as usize;
        let (fragment, behind) = behind.split_at_checked(length).ok_or(Fault::Cut)?;
        rest = behind;
        if table.is_none() {
            table = Some(fragment);
        } else {
            fragments.push((offset, fragment));
            offset = offset.saturating_add(8 + length as u64);
        }
    }
    if frames == 1 {
        return Ok(vec![fragments.into_iter().map(|(_, fragment)| fragment).collect()]);
    }
    if fragments.len() == frames {
        return Ok(fragments.into_iter().map(|(_, fragment)| vec![fragment]).collect());
    }
    let starts: Vec<u64> = table
        .unwrap_or_default()
        .chunks_exact(4)
        .filter_map(|bytes| bytes.first_chunk::<4>())
        .map(|bytes| u64::from(u32::from_le_bytes(*bytes)))
        .collect();
    if starts.len() != frames || !starts.is_sorted() {
        return Err(Fault::Wrong("fragments that belong to no frame", "unpack it with `gdcmconv --raw`"));
    }
    let mut parts = vec![Vec::new(); frames];
    for (offset, fragment) in fragments {
        let frame = starts.partition_point(|start| *start <= offset).saturating_sub(1);
        if let Some(part) = parts.get_mut(frame) {
            part.push(fragment);
        }
    }
    Ok(parts)
}

/// Where the bits of a value lie.
#[derive(Debug, Clone, Copy)]
struct Layout {
    bytes: usize,
    stored: u32,
    shift: u32,
    signed: bool,
}

impl Layout {
    /// The bits are checked before ([`check`]).
    fn of(attributes: &Attributes) -> Self {
        let stored = attributes.bits_stored.unwrap_or(attributes.bits_allocated);
        let high = attributes.high_bit.unwrap_or(stored.saturating_sub(1));
        Self {
            bytes: bytes_of_value(attributes),
            stored: u32::from(stored),
            shift: u32::from((high + 1).saturating_sub(stored)),
            signed: attributes.signed,
        }
    }

    /// The value of the bits of a word.
    fn value(self, word: u64) -> i64 {
        // Of 64 bits the wanted ones go to the upper end, and back with their sign or without.
        let up = 64_u32.saturating_sub(self.stored);
        let upper = (word >> self.shift) << up;
        if self.signed { (upper as i64) >> up } else { (upper >> up) as i64 }
    }

    fn values(self, bytes: &[u8], big_endian: bool) -> Vec<i64> {
        let word = |bytes: &[u8]| {
            let add = |word: u64, byte: &u8| word << 8 | u64::from(*byte);
            if big_endian { bytes.iter().fold(0, add) } else { bytes.iter().rev().fold(0, add) }
        };
        bytes.chunks_exact(self.bytes.max(1)).map(|bytes| self.value(word(bytes))).collect()
    }

    /// The value of a word of two bytes in the head of a file.
    fn of_padding(self, word: u16) -> i64 {
        if self.signed { i64::from(word.cast_signed()) } else { i64::from(word) }
    }
}

/// The stored values of places without data.
pub(super) fn padding(attributes: &Attributes) -> Option<RangeInclusive<i64>> {
    let layout = Layout::of(attributes);
    let first = layout.of_padding(attributes.padding?);
    let last = attributes.padding_limit.map_or(first, |limit| layout.of_padding(limit));
    Some(first.min(last)..=first.max(last))
}

/// Refuses voxels of another kind than one number of 8, 16 or 32 bits.
pub(super) fn check(attributes: &Attributes, packing: Packing) -> Result<(), Fault> {
    let wrong = |what, way| Err(Fault::Wrong(what, way));
    let allocated = attributes.bits_allocated;
    let stored = attributes.bits_stored.unwrap_or(allocated);
    let high = attributes.high_bit.unwrap_or(stored.saturating_sub(1));
    if let Packing::Unread(what) = packing {
        return wrong(what, "unpack it with `gdcmconv --raw`");
    }
    if attributes.has_float_pixels {
        return wrong("voxels of floating point", "save it as NRRD from 3D Slicer");
    }
    if attributes.samples.is_some_and(|samples| samples != 1) || attributes.photometric == Photometric::Color {
        return wrong(
            "a colour picture, where one number for each voxel is needed",
            "leave it out, or convert it to grey",
        );
    }
    if attributes.rows == 0 || attributes.columns == 0 {
        return wrong("no rows or columns", REPAIR);
    }
    if !matches!(allocated, 8 | 16 | 32) {
        return wrong("voxels of other than 8, 16 or 32 bits", "save it as NRRD from 3D Slicer");
    }
    if stored == 0 || stored > allocated || high >= allocated || high + 1 < stored {
        return wrong("stored bits that do not fit the allocated ones", REPAIR);
    }
    if attributes.has_modality_lut {
        return wrong("a table for its values in place of a slope", "save it as NRRD from 3D Slicer");
    }
    if attributes.big_endian && allocated == 8 {
        return wrong("bytes in words of big-endian order", "convert it with `gdcmconv --raw`");
    }
    Ok(())
}

/// Unpacks run lengths: one segment for each byte of a value, the highest byte first.
fn run_lengths(attributes: &Attributes, bytes: &[u8]) -> Result<Vec<u8>, Fault> {
    let (count, width) = (count(attributes), bytes_of_value(attributes));
    let wrong = Fault::Wrong("run lengths that do not fill the picture", REPAIR);
    let number = |at: usize| {
        let bytes = bytes.get(4 * at..)?.first_chunk::<4>()?;
        Some(u32::from_le_bytes(*bytes) as usize)
    };
    if number(0) != Some(width) {
        return Err(wrong);
    }
    // Two bytes hold 128 at most.
    if count > bytes.len().saturating_mul(64) {
        return Err(wrong);
    }
    let mut values = vec![0; count.saturating_mul(width)];
    for segment in 0..width {
        let start = number(1 + segment).ok_or(wrong)?;
        let end = if segment + 1 < width { number(2 + segment).ok_or(wrong)? } else { bytes.len() };
        let packed = bytes.get(start..end).ok_or(wrong)?;
        let places = values.iter_mut().skip(width - 1 - segment).step_by(width);
        if !unpack(packed, places) {
            return Err(wrong);
        }
    }
    Ok(values)
}

/// Unpacks PackBits into all places; `false` if there are fewer bytes.
fn unpack<'a>(mut packed: &[u8], mut places: impl Iterator<Item = &'a mut u8>) -> bool {
    let Some(mut place) = places.next() else { return true };
    while let Some((&code, rest)) = packed.split_first() {
        packed = rest;
        let (length, is_run) = match code {
            0..=127 => (usize::from(code) + 1, false),
            128 => continue,
            129..=255 => (257 - usize::from(code), true),
        };
        for _ in 0..length {
            let Some(&byte) = packed.first() else { return false };
            if !is_run {
                packed = packed.get(1..).unwrap_or_default();
            }
            *place = byte;
            match places.next() {
                Some(next) => place = next,
                None => return true,
            }
        }
        if is_run {
            packed = packed.get(1..).unwrap_or_default();
        }
    }
    false
}

fn jpeg(attributes: &Attributes, layout: Layout, bytes: &[u8]) -> Result<Vec<i64>, Fault> {
    let damaged =
        Fault::Wrong("a JPEG that is damaged or of a kind that is not read", "unpack it with `gdcmconv --raw`");
    // The decoder takes memory for the size that the JPEG states, and knows one and three components alone.
    let size = jpeg_size(bytes).ok_or(damaged)?;
    if size != (attributes.rows, attributes.columns) {
        return Err(Fault::Wrong("a JPEG of another size than its rows and columns", REPAIR));
    }
    // A lossless difference takes a bit at least, and a block of 64 values two.
    if count(attributes) > bytes.len().saturating_mul(256) {
        return Err(damaged);
    }
    let mut decoder = Decoder::new(bytes);
    let decoded = decoder.decode().map_err(|_| damaged)?;
    let format = decoder.info().ok_or(damaged)?.pixel_format;
    let words: Vec<u64> = match format {
        PixelFormat::L8 => decoded.iter().map(|&byte| u64::from(byte)).collect(),
        PixelFormat::L16 => decoded
            .chunks_exact(2)
            .filter_map(|bytes| bytes.first_chunk::<2>())
            .map(|bytes| u64::from(u16::from_ne_bytes(*bytes)))
            .collect(),
        PixelFormat::RGB24 | PixelFormat::CMYK32 => return Err(damaged),
    };
    if words.len() != count(attributes) {
        return Err(damaged);
    }
    Ok(words.into_iter().map(|word| layout.value(word)).collect())
}

/// Rows and columns of a JPEG of one component with a precision that the decoder knows.
fn jpeg_size(bytes: &[u8]) -> Option<(usize, usize)> {
    let mut rest = bytes.strip_prefix(&[0xFF, 0xD8])?;
    loop {
        let (&[mark, kind], behind) = rest.split_first_chunk::<2>()?;
        if mark != 0xFF {
            return None;
        }
        // Marks can be filled up with more of their first byte.
        if kind == 0xFF {
            rest = rest.get(1..)?;
            continue;
        }
        let length = usize::from(u16::from_be_bytes(*behind.first_chunk::<2>()?));
        let content = behind.get(2..length)?;
        if matches!(kind, 0xC0..=0xC3) {
            let &[precision, high_rows, low_rows, high_columns, low_columns, components] =
                content.first_chunk::<6>()?;
            let pair = |high, low| usize::from(u16::from_be_bytes([high, low]));
            let is_known = components == 1 && (2..=16).contains(&precision);
            return is_known.then(|| (pair(high_rows, low_rows), pair(high_columns, low_columns)));
        }
        rest = behind.get(length..)?;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_taken_from_their_place_with_their_sign() {
        let of = |stored, high_bit, signed| {
            let bits = Attributes {
                bits_allocated: 16,
                bits_stored: Some(stored),
                high_bit: Some(high_bit),
                signed,
                ..Attributes::default()
            };
            check(&Attributes { rows: 1, columns: 1, ..bits.clone() }, Packing::Plain).unwrap();
            Layout::of(&bits)
        };
        // Bits above those that are stored may hold an overlay.
        assert_eq!(of(12, 11, false).values(&[0xFF, 0xFF, 0x00, 0x10], false), [4095, 0]);
        assert_eq!(of(12, 11, true).values(&[0xFF, 0x0F, 0xFF, 0x07], false), [-1, 2047]);
        assert_eq!(of(12, 15, false).values(&[0xF0, 0xFF], false), [4095]);
        assert_eq!(of(16, 15, true).values(&[0x80, 0x00], true), [-32768]);
        let wide = Attributes { bits_allocated: 32, ..Attributes::default() };
        assert_eq!(Layout::of(&wide).values(&[0xFF; 4], false), [4_294_967_295]);
        assert_eq!(Layout::of(&Attributes { signed: true, ..wide }).values(&[0xFE, 0xFF, 0xFF, 0xFF], false), [-2]);
    }

    #[test]
    fn run_lengths_fill_the_picture_or_are_refused() {
        let mut out = [0_u8; 5];
        assert!(unpack(&[1, 7, 8, 128, 254, 9], out.iter_mut()));
        assert_eq!(out, [7, 8, 9, 9, 9]);
        for short in [&[][..], &[1, 7], &[254], &[0, 1, 253, 9]] {
            assert!(!unpack(short, [0_u8; 6].iter_mut()), "{short:?}");
        }
    }

    #[test]
    fn the_size_of_a_jpeg_is_known_before_it_is_decoded() {
        let start = [0xFF, 0xD8, 0xFF, 0xE0, 0, 4, 1, 2, 0xFF];
        let frame = [0xFF, 0xC3, 0, 11, 16, 0, 3, 0, 4, 1, 1, 0x11, 0];
        assert_eq!(jpeg_size(&[&start[..], &frame].concat()), Some((3, 4)));
        let colored = [0xFF, 0xC3, 0, 11, 16, 0, 3, 0, 4, 3, 1, 0x11, 0];
        for wrong in [&colored[..], &frame[..8], &[], &[0xFF, 0xDA, 0xFF, 0xFF]] {
            assert_eq!(jpeg_size(&[&start[..], wrong].concat()), None);
        }
    }
}
