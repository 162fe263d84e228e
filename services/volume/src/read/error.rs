//! Errors of reading and writing volume files.

use std::fmt;
use std::io;
use std::path::PathBuf;

use crate::grid::GridError;
use crate::scalars::ScalarType;

/// The number of bytes that a file holds in place of the expected one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ActualSize {
    /// Exactly this many bytes.
    Bytes(u64),
    /// More than the expected number; decoding stopped there.
    MoreThan(u64),
    /// The compressed data cannot hold more than this.
    AtMost(u64),
}

impl fmt::Display for ActualSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bytes(n) => write!(f, "found {n}"),
            Self::MoreThan(n) => write!(f, "found more than {n}"),
            Self::AtMost(n) => write!(f, "found compressed data that holds at most {n}"),
        }
    }
}

/// A volume file could not be read.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The file is absent, is not a regular file, or cannot be read.
    #[error("{}: {source}", .path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
    /// The file holds more or fewer voxels than its header or name says.
    #[error(
        "{}: expected {expected} bytes of voxels for {} x {} x {} {}, {found}; {remedy}",
        .path.display(), .dims[0], .dims[1], .dims[2], .scalar.name()
    )]
    Size {
        /// The file with the data.
        path: PathBuf,
        /// Voxels along x, y and z.
        dims: [usize; 3],
        /// Type of the voxels.
        scalar: ScalarType,
        /// Expected bytes.
        expected: u64,
        /// Bytes in the file.
        found: ActualSize,
        /// How to correct it.
        remedy: &'static str,
    },
    /// A name, header or data section is malformed or not supported.
    #[error("{}: {place}: {what}; {remedy}", .path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// The place in the file.
        place: String,
        /// The problem.
        what: String,
        /// How to correct it.
        remedy: String,
    },
    /// The voxels would take more memory than the limit.
    #[error("{}: {bytes} bytes of voxels exceed the limit of {limit}; reduce the volume first", .path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Bytes of all voxels.
        bytes: u64,
        /// The limit in force.
        limit: u64,
    },
    /// Compressed voxels would expand to more than the limit for a file of this size.
    #[error(
        "{}: {bytes} bytes of voxels in {stored} compressed bytes exceed the limit of {limit}; {remedy}", .path.display()
    )]
    Expanded {
        /// The file.
        path: PathBuf,
        /// Bytes of all voxels.
        bytes: u64,
        /// Bytes of the compressed data.
        stored: u64,
        /// The limit in force.
        limit: u64,
        /// How to allow it.
        remedy: String,
    },
    /// Spacing, origin or axes do not form a grid.
    #[error("{}: {source}", .path.display())]
    Grid {
        /// The file.
        path: PathBuf,
        /// The problem.
        source: GridError,
    },
}

/// A volume file could not be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// The writer reported an error.
    #[error("{}: {source}", .path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The error of the writer.
        source: io::Error,
    },
    /// No format with this ending can be written.
    #[error("{}: file name: no volume format that can be written; give a name that ends with .raw", .path.display())]
    Ending {
        /// The file.
        path: PathBuf,
    },
    /// The name of a raw file does not carry the size and type of the volume.
    #[error("{}: file name: it does not describe the volume; end it with {ending}", .path.display())]
    Name {
        /// The file.
        path: PathBuf,
        /// The ending that describes the volume.
        ending: String,
    },
}
