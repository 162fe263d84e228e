//! The interface of a volume format, and its row in the table of formats.

use std::io::Write;
use std::path::Path;

use crate::dataset::Dataset;
use crate::volume::Volume;

use super::error::{ReadError, WriteError};
use super::source::Source;

/// A file format of volumes. A format is a type without values; [`Format::of`] turns it into a row of the table.
pub(super) trait VolumeFormat {
    /// What its files hold.
    type Data: Into<Dataset>;

    /// Name in help and messages.
    const NAME: &'static str;
    /// Endings of file names with their dot, in lower case.
    const ENDINGS: &'static [&'static str];
    /// Whether voxels may lie in other files beside it.
    const READS_BESIDE: bool = false;
    /// Whether a file can hold several quantities with names.
    const HAS_VARIABLES: bool = false;
    /// Whether a folder can hold several series.
    const HAS_SERIES: bool = false;

    /// Whether a file is of this format although its name has no known ending. `name` is the file name in lower case;
    /// `first` holds the first bytes of the file, at most [`SNIFFED_BYTES`].
    fn sniff(name: &str, first: &[u8]) -> bool;

    /// Reads a data set within the limits of `source`.
    fn read(source: Source<'_>) -> Result<Self::Data, ReadError>;

    /// Writes a volume to `writer`. The name of `path` may be part of the format. The default refuses.
    fn write(path: &Path, _volume: &Volume, _writer: &mut dyn Write) -> Result<(), WriteError> {
        Err(WriteError::Ending { path: path.to_owned() })
    }
}

/// Bytes from the start of a file that [`VolumeFormat::sniff`] gets.
pub(super) const SNIFFED_BYTES: u64 = 1024;

/// A row in the table of volume formats.
#[derive(Debug, Clone, Copy)]
pub struct Format {
    name: &'static str,
    endings: &'static [&'static str],
    reads_beside: bool,
    has_variables: bool,
    has_series: bool,
    sniff: fn(&str, &[u8]) -> bool,
    read: fn(Source<'_>) -> Result<Dataset, ReadError>,
    write: fn(&Path, &Volume, &mut dyn Write) -> Result<(), WriteError>,
}

impl Format {
    /// The row of a format.
    pub(super) const fn of<F: VolumeFormat>() -> Self {
        let (name, endings, reads_beside) = (F::NAME, F::ENDINGS, F::READS_BESIDE);
        let read = |source: Source<'_>| F::read(source).map(Into::into);
        let (has_variables, has_series) = (F::HAS_VARIABLES, F::HAS_SERIES);
        Self { name, endings, reads_beside, has_variables, has_series, sniff: F::sniff, read, write: F::write }
    }

    /// Name of the format.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        self.name
    }

    /// Endings of file names with their dot, in lower case.
    #[must_use]
    pub const fn endings(&self) -> &'static [&'static str] {
        self.endings
    }

    /// Whether voxels may lie in other files beside it.
    pub(super) const fn reads_beside(&self) -> bool {
        self.reads_beside
    }

    /// Whether a file can hold several quantities with names.
    pub(super) const fn has_variables(&self) -> bool {
        self.has_variables
    }

    /// Whether a folder can hold several series.
    pub(super) const fn has_series(&self) -> bool {
        self.has_series
    }

    /// Whether a file name in lower case has an ending of this format.
    pub(super) fn has_ending(&self, name: &str) -> bool {
        self.endings.iter().any(|ending| name.ends_with(ending))
    }

    pub(super) fn sniff(&self, name: &str, first: &[u8]) -> bool {
        (self.sniff)(name, first)
    }

    pub(super) fn read(&self, source: Source<'_>) -> Result<Dataset, ReadError> {
        (self.read)(source)
    }

    pub(super) fn write(&self, path: &Path, volume: &Volume, writer: &mut dyn Write) -> Result<(), WriteError> {
        (self.write)(path, volume, writer)
    }
}
