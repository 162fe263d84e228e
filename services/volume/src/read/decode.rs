//! Decoding of bytes and text to typed voxels. Memory grows only with the decoded data.

use std::io::{self, Read};

use crate::scalars::{Decode, Scalar, ScalarType, Scalars};

use super::error::{ActualSize, ReadError};
use super::source::Source;

/// Compression of a stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Packing {
    /// None.
    Plain,
    /// gzip.
    Gzip,
    /// zlib, that is deflate with the header of RFC 1950.
    Zlib,
    /// Zstandard.
    Zstd,
}

impl Packing {
    /// The largest number of bytes from one compressed byte: deflate's bound, and 128 KiB from 4 bytes for a zstd block of
    /// one repeated byte.
    fn largest_ratio(self) -> u64 {
        match self {
            Self::Plain => 1,
            Self::Gzip | Self::Zlib => 1032,
            Self::Zstd => 32 * 1024,
        }
    }
}

/// Layout of the voxels in a part of a file.
pub(super) struct Voxels {
    pub(super) dims: [usize; 3],
    pub(super) scalar: ScalarType,
    pub(super) big_endian: bool,
    pub(super) packing: Packing,
    pub(super) remedy: &'static str,
}

impl Voxels {
    /// Reads all voxels from `reader`, which has `available` stored bytes left. The stream must end with the voxels.
    pub(super) fn read(&self, source: Source<'_>, reader: impl Read, available: u64) -> Result<Scalars, ReadError> {
        self.read_after(0, source, reader, available)
    }

    /// [`Voxels::read`] of a stream with `skip` decoded bytes before the first voxel.
    pub(super) fn read_after(
        &self,
        skip: u64,
        source: Source<'_>,
        reader: impl Read,
        available: u64,
    ) -> Result<Scalars, ReadError> {
        let expected = source.voxel_bytes(self.dims, self.scalar)?;
        let wrong = |found| self.wrong_size(source, expected, found);
        let most = available.saturating_mul(self.packing.largest_ratio()).saturating_sub(skip);
        if self.packing == Packing::Plain {
            if available != expected.saturating_add(skip) {
                return Err(wrong(ActualSize::Bytes(most)));
            }
        } else if most < expected {
            return Err(wrong(ActualSize::AtMost(most)));
        } else {
            source.check_expanded(expected.saturating_add(skip), available)?;
        }
        let result = match self.packing {
            Packing::Plain => self.decode(reader, skip, expected),
            Packing::Gzip => self.decode(flate2::read::MultiGzDecoder::new(reader), skip, expected),
            Packing::Zlib => self.decode(flate2::read::ZlibDecoder::new(reader), skip, expected),
            Packing::Zstd => match zstd::stream::read::Decoder::new(reader) {
                Ok(decoder) => self.decode(decoder, skip, expected),
                Err(e) => Err(Failure::Io(e)),
            },
        };
        result.map_err(|failure| match failure {
            Failure::Short(n) => wrong(ActualSize::Bytes(n)),
            Failure::Long => wrong(ActualSize::MoreThan(expected)),
            Failure::Io(e) => source.io(e),
        })
    }

    /// The typed error for a wrong size.
    pub(super) fn wrong_size(&self, source: Source<'_>, expected: u64, found: ActualSize) -> ReadError {
        ReadError::Size {
            path: source.path.to_owned(),
            dims: self.dims,
            scalar: self.scalar,
            expected,
            found,
            remedy: self.remedy,
        }
    }

    fn decode(&self, mut reader: impl Read, skip: u64, expected: u64) -> Result<Scalars, Failure> {
        let mut unread = skip;
        let mut scratch = [0; 4096];
        while unread > 0 {
            let piece = unread.min(scratch.len() as u64) as usize;
            if read_full(&mut reader, &mut scratch[..piece])? < piece {
                return Err(Failure::Short(0));
            }
            unread -= piece as u64;
        }
        let count = (expected / self.scalar.bytes() as u64) as usize;
        Scalars::decode(self.scalar, Binary { reader, count, swap: self.big_endian != cfg!(target_endian = "big") })
    }
}

enum Failure {
    Short(u64),
    Long,
    Io(io::Error),
}

impl From<io::Error> for Failure {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

struct Binary<R> {
    reader: R,
    count: usize,
    swap: bool,
}

impl<R: Read> Decode for Binary<R> {
    type Error = Failure;

    fn decode<T: Scalar>(&mut self) -> Result<Vec<T>, Failure> {
        /// Values of one read. Memory is never further ahead of the data.
        const PIECE: usize = 1 << 22;
        let mut values: Vec<T> = Vec::new();
        while values.len() < self.count {
            let start = values.len();
            let end = self.count.min(start + PIECE);
            values.try_reserve(end - start).map_err(|_| Failure::Io(io::ErrorKind::OutOfMemory.into()))?;
            values.resize(end, T::zeroed());
            let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut values[start..]);
            let got = read_full(&mut self.reader, bytes)?;
            if got < bytes.len() {
                return Err(Failure::Short((start * size_of::<T>() + got) as u64));
            }
        }
        // The end is read strictly: behind the voxels stands the check sum of a compressed stream.
        if has_more(&mut self.reader)? {
            return Err(Failure::Long);
        }
        if self.swap {
            for value in &mut values {
                *value = value.swapped();
            }
        }
        Ok(values)
    }
}

/// Fills `buffer` up to the end of the stream, and returns the filled length. A truncated compressed stream ends there.
pub(super) fn read_full(reader: &mut impl Read, buffer: &mut [u8]) -> io::Result<usize> {
    let mut filled = 0;
    while filled < buffer.len() {
        match reader.read(&mut buffer[filled..]) {
            Ok(0) => break,
            Ok(n) => filled += n,
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            Err(e) if e.kind() == io::ErrorKind::UnexpectedEof => break,
            Err(e) => return Err(e),
        }
    }
    Ok(filled)
}

/// Whether a byte follows. A stream that breaks off is an error here.
fn has_more(reader: &mut impl Read) -> io::Result<bool> {
    loop {
        match reader.read(&mut [0]) {
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            Err(e) if e.kind() == io::ErrorKind::UnexpectedEof => {
                let what = "the compressed data break off before their check sum; fetch the file again";
                return Err(io::Error::new(io::ErrorKind::UnexpectedEof, what));
            }
            read => return read.map(|n| n > 0),
        }
    }
}

/// Numbers written as text, separated by white space (NRRD also by commas).
pub(super) struct Text<'a> {
    pub(super) text: &'a str,
    pub(super) count: usize,
}

/// An error in a text of numbers.
pub(super) enum TextFailure {
    /// A word is not a number of the type: its position from 1, and the word.
    Word(usize, String),
    /// The text has this many numbers; at least, if there are too many.
    Count(usize),
}

impl Decode for Text<'_> {
    type Error = TextFailure;

    fn decode<T: Scalar>(&mut self) -> Result<Vec<T>, TextFailure> {
        // A number takes at least a digit and a separator, so the length of the text bounds the allocation.
        let mut values = Vec::with_capacity(self.count.min(self.text.len() / 2 + 1));
        let words = self.text.split(|c: char| c.is_ascii_whitespace() || c == ',').filter(|w| !w.is_empty());
        for (i, word) in words.enumerate() {
            if i >= self.count {
                return Err(TextFailure::Count(i + 1));
            }
            let value = word.parse().map_err(|_| TextFailure::Word(i + 1, word.chars().take(40).collect()))?;
            values.push(value);
        }
        if values.len() < self.count { Err(TextFailure::Count(values.len())) } else { Ok(values) }
    }
}

/// Reads `dims` numbers of a type from a stream of text. It holds nothing else.
pub(super) fn read_text_stream(
    source: Source<'_>,
    reader: impl Read,
    dims: [usize; 3],
    scalar: ScalarType,
) -> Result<Scalars, ReadError> {
    // The limit of the voxels bounds the text too: a number takes a few dozen characters at most.
    let most = source.voxel_bytes(dims, scalar)?.saturating_mul(32);
    let mut text = String::new();
    reader.take(most.saturating_add(1)).read_to_string(&mut text).map_err(|e| source.io(e))?;
    read_text(source, &text, dims, scalar)
}

/// Reads `dims` numbers of a type from text.
pub(super) fn read_text(
    source: Source<'_>,
    text: &str,
    dims: [usize; 3],
    scalar: ScalarType,
) -> Result<Scalars, ReadError> {
    let count = (source.voxel_bytes(dims, scalar)? / scalar.bytes() as u64) as usize;
    Scalars::decode(scalar, Text { text, count }).map_err(|failure| match failure {
        TextFailure::Word(at, word) => source.format(
            format!("value {at} of the data"),
            format!("`{word}` is not a value of type {}", scalar.name()),
            "correct the number or the type",
        ),
        TextFailure::Count(found) => source.format(
            "ascii data",
            format!(
                "expected {count} numbers for {} x {} x {}, found {}{found}",
                dims[0],
                dims[1],
                dims[2],
                if found > count { "at least " } else { "" }
            ),
            "correct the sizes or complete the data",
        ),
    })
}
