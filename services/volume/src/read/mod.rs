//! Reading volumes: raw files with their size in the name, NRRD, VTK image data.
//!
//! Every reader compares the sizes a header or a name promises with what the file holds *before* it allocates, and
//! memory for compressed data grows only with what was really decoded.

mod decode;
mod nrrd;
mod raw;
mod vti;

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use crate::grid::GridError;
use crate::scalars::ScalarType;
use crate::volume::Volume;

pub use raw::{raw_file_name, write_raw};

/// What a reader may spend.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Largest size of the decoded voxels in bytes.
    pub voxel_bytes: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self { voxel_bytes: 8 << 30 }
    }
}

/// How many bytes were there where others were expected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Found {
    /// Exactly so many.
    Bytes(u64),
    /// More than expected; decoding stopped there.
    MoreThan(u64),
    /// At most so many can come out of the compressed data.
    AtMost(u64),
}

impl fmt::Display for Found {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bytes(n) => write!(f, "found {n}"),
            Self::MoreThan(n) => write!(f, "found more than {n}"),
            Self::AtMost(n) => write!(f, "found compressed data that holds at most {n}"),
        }
    }
}

/// Why a volume could not be read.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The file is absent, no file, or can't be read.
    #[error("{}: {source}", .path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The file holds more or fewer voxels than promised.
    #[error(
        "{}: expected {expected} bytes of voxels for {} x {} x {} {}, {found}; {remedy}",
        .path.display(), .dims[0], .dims[1], .dims[2], .scalar.name()
    )]
    Size {
        /// The file with the data.
        path: PathBuf,
        /// Promised size.
        dims: [usize; 3],
        /// Promised type.
        scalar: ScalarType,
        /// Promised bytes.
        expected: u64,
        /// What is there.
        found: Found,
        /// What to do.
        remedy: &'static str,
    },
    /// A name, header or data section that can't be understood or is not supported.
    #[error("{}: {place}: {what}; {remedy}", .path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// Where in it.
        place: String,
        /// What is wrong.
        what: String,
        /// What to do.
        remedy: String,
    },
    /// The voxels would take more memory than allowed.
    #[error("{}: {bytes} bytes of voxels exceed the limit of {limit}; reduce the volume first", .path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Bytes of all voxels.
        bytes: u64,
        /// The limit in force.
        limit: u64,
    },
    /// Spacing, origin or axes that make no grid.
    #[error("{}: {source}", .path.display())]
    Grid {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: GridError,
    },
}

/// What names of files end with that [`read_volume`] reads, in small letters.
pub const ENDINGS: [&str; 6] = [".raw", ".raw.gz", ".raw.zst", ".nrrd", ".nhdr", ".vti"];

/// Reads a volume by its extension: `.raw`, `.raw.gz`, `.raw.zst` (the name carries `_XxYxZ_type[_be]`), `.nrrd`,
/// `.nhdr`, `.vti`. Spacing, origin and orientation are kept in the file's physical units.
///
/// # Errors
/// [`ReadError`]: one line that names the file, the place and what to do.
pub fn read_volume(path: &Path) -> Result<Volume, ReadError> {
    read_volume_within(path, Limits::default())
}

/// [`read_volume`] with limits of one's own.
///
/// # Errors
/// [`ReadError`], also where the limits are exceeded.
pub fn read_volume_within(path: &Path, limits: Limits) -> Result<Volume, ReadError> {
    let source = Source { path, limits };
    let name = path.file_name().map(|n| n.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let ends = |suffix: &str| name.ends_with(suffix);
    if ends(".raw") || ends(".raw.gz") || ends(".raw.zst") {
        raw::read(source)
    } else if ends(".nrrd") || ends(".nhdr") {
        nrrd::read(source)
    } else if ends(".vti") {
        vti::read(source)
    } else {
        let hint = format!("give one of {}", ENDINGS.join(", "));
        Err(source.format("file name", "no known volume extension", hint))
    }
}

/// The file being read and what may be spent on it; makes the errors.
#[derive(Clone, Copy)]
struct Source<'a> {
    path: &'a Path,
    limits: Limits,
}

impl Source<'_> {
    fn io(&self, source: io::Error) -> ReadError {
        ReadError::Io { path: self.path.to_owned(), source }
    }

    fn format(&self, place: impl Into<String>, what: impl Into<String>, remedy: impl Into<String>) -> ReadError {
        ReadError::Format { path: self.path.to_owned(), place: place.into(), what: what.into(), remedy: remedy.into() }
    }

    fn grid(&self, source: GridError) -> ReadError {
        ReadError::Grid { path: self.path.to_owned(), source }
    }

    /// Opens the file and tells its size; refuses what is no regular file (a pipe would have no size to check against).
    fn open(&self) -> Result<(std::fs::File, u64), ReadError> {
        let file = std::fs::File::open(self.path).map_err(|e| self.io(e))?;
        let meta = file.metadata().map_err(|e| self.io(e))?;
        if meta.is_file() {
            Ok((file, meta.len()))
        } else {
            Err(self.io(io::Error::new(io::ErrorKind::InvalidInput, "not a regular file")))
        }
    }

    /// Bytes of `dims` voxels of a type, within the limit.
    fn voxel_bytes(&self, dims: [usize; 3], scalar: ScalarType) -> Result<u64, ReadError> {
        let bytes = dims.iter().try_fold(scalar.bytes() as u64, |n, &d| n.checked_mul(d as u64)).unwrap_or(u64::MAX);
        let limit = self.limits.voxel_bytes;
        if bytes > limit { Err(ReadError::TooLarge { path: self.path.to_owned(), bytes, limit }) } else { Ok(bytes) }
    }
}
