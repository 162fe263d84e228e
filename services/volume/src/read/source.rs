//! The input file of a reader and its memory limit.

use std::fs::File;
use std::io::{self, BufReader, Read as _};
use std::path::{Path, PathBuf};

use crate::grid::GridError;
use crate::scalars::ScalarType;

use super::error::ReadError;
use sg_input::{file, limits};

/// Limits of a reader.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Largest size of the decoded voxels in bytes.
    pub voxel_bytes: u64,
    /// Whether a header may name data in its own folder only.
    pub own_folder: bool,
}

impl Default for Limits {
    fn default() -> Self {
        Self { voxel_bytes: 8 << 30, own_folder: false }
    }
}

/// The file that a reader works on, and its limits. It builds the errors.
#[derive(Clone, Copy)]
pub(super) struct Source<'a> {
    pub(super) path: &'a Path,
    pub(super) limits: Limits,
    /// Name of the quantity to read, of a file that holds several.
    pub(super) variable: Option<&'a str>,
    /// The quantity to read without that, if the file has it.
    pub(super) preferred: Option<&'a str>,
    /// Number from 1 of the series to read, of a folder that holds several.
    pub(super) series: Option<usize>,
}

impl Source<'_> {
    /// The last component of the path; empty if there is none.
    pub(super) fn file_name(&self) -> String {
        self.path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default()
    }

    pub(super) fn io(&self, source: io::Error) -> ReadError {
        ReadError::Io { path: self.path.to_owned(), source }
    }

    pub(super) fn format(
        &self,
        place: impl Into<String>,
        what: impl Into<String>,
        remedy: impl Into<String>,
    ) -> ReadError {
        // Names from a file may hold line ends. An error is one line.
        let line =
            |text: String| if text.contains(char::is_control) { text.replace(char::is_control, " ") } else { text };
        let (place, what, remedy) = (line(place.into()), line(what.into()), line(remedy.into()));
        ReadError::Format { path: self.path.to_owned(), place, what, remedy }
    }

    pub(super) fn grid(&self, source: GridError) -> ReadError {
        ReadError::Grid { path: self.path.to_owned(), source }
    }

    /// Opens the file and returns its size in bytes. Only a regular file has a size to check against.
    pub(super) fn open(&self) -> Result<(File, u64), ReadError> {
        let opened = file::open(self.path).map_err(|e| self.io(e))?;
        Ok((opened.file, opened.length))
    }

    /// The whole content of the file. One that gzip or Zstandard has packed is unpacked.
    pub(super) fn unpacked(&self) -> Result<Vec<u8>, ReadError> {
        let (file, length) = self.open()?;
        // The content is never larger than twice its values and a header.
        let limit = self.limits.voxel_bytes.saturating_mul(2).saturating_add(1 << 20);
        let name = self.file_name().to_ascii_lowercase();
        let is_packed = name.ends_with(".gz") || name.ends_with(".zst");
        let most = if is_packed { limits::expanded(length).min(limit) } else { limit };
        let too_large = |bytes| ReadError::TooLarge { path: self.path.to_owned(), bytes, limit: most };
        if length > most {
            return Err(too_large(length));
        }
        let mut bytes = Vec::new();
        let read = if name.ends_with(".gz") {
            flate2::read::MultiGzDecoder::new(file).take(most.saturating_add(1)).read_to_end(&mut bytes)
        } else if name.ends_with(".zst") {
            zstd::stream::read::Decoder::new(file)
                .and_then(|decoder| decoder.take(most.saturating_add(1)).read_to_end(&mut bytes))
        } else {
            bytes.try_reserve_exact(length as usize).map_err(|_| self.io(io::ErrorKind::OutOfMemory.into()))?;
            file.take(length).read_to_end(&mut bytes)
        };
        read.map_err(|e| self.io(e))?;
        if bytes.len() as u64 > most {
            let (path, bytes) = (self.path.to_owned(), bytes.len() as u64);
            return Err(ReadError::Expanded {
                path,
                bytes,
                stored: length,
                limit: most,
                remedy: limits::remedy(2 * bytes),
            });
        }
        Ok(bytes)
    }

    /// The file from its start, and its size in bytes.
    pub(super) fn reader(&self) -> Result<(BufReader<File>, u64), ReadError> {
        let (file, length) = self.open()?;
        Ok((BufReader::with_capacity(1 << 18, file), length))
    }

    /// The path of a file that a header names, from the header's own folder.
    pub(super) fn beside(&self, name: &str) -> Result<PathBuf, ReadError> {
        let folder = self.path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let path = folder.join(name);
        if self.limits.own_folder {
            // Links are followed, as they are when the file is read.
            let [file, folder] = [&path, folder].map(std::fs::canonicalize);
            let file = file.map_err(|source| ReadError::Io { path: path.clone(), source })?;
            if !file.starts_with(folder.map_err(|e| self.io(e))?) {
                let what = format!("names the data {name}, outside the folder of the header");
                return Err(self.format("header", what, "put the data beside the header"));
            }
        }
        Ok(path)
    }

    /// Refuses compressed data that would expand beyond the limit for `stored` bytes.
    pub(super) fn check_expanded(&self, bytes: u64, stored: u64) -> Result<(), ReadError> {
        let limit = limits::expanded(stored);
        if bytes > limit {
            let (path, remedy) = (self.path.to_owned(), limits::remedy(bytes));
            return Err(ReadError::Expanded { path, bytes, stored, limit, remedy });
        }
        Ok(())
    }

    /// Bytes of `dims` voxels of a type, within the limit.
    pub(super) fn voxel_bytes(&self, dims: [usize; 3], scalar: ScalarType) -> Result<u64, ReadError> {
        let bytes = dims.iter().try_fold(scalar.bytes() as u64, |n, &d| n.checked_mul(d as u64)).unwrap_or(u64::MAX);
        let limit = self.limits.voxel_bytes;
        if bytes > limit { Err(ReadError::TooLarge { path: self.path.to_owned(), bytes, limit }) } else { Ok(bytes) }
    }
}
