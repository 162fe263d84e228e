//! Files of volumes and meshes: one table of formats, and reading and writing through it.
//!
//! A new format is one file with a type that implements the crate's `VolumeFormat`, and one row in [`FORMATS`].
//!
//! Every reader compares the size in a header or name with the size of the file *before* it allocates. Memory for
//! compressed data grows only with the decoded bytes, up to [`sg_input::limits::expanded`].

mod decode;
mod dicom;
mod error;
mod format;
mod legacy_vtk;
mod mesh_data;
mod metaimage;
mod nifti;
mod nrrd;
mod raw;
mod series;
mod source;
mod vti;
mod vtk_xml;
mod vtu;

use std::io::Write;
use std::path::Path;

use glam::DVec3;

use crate::dataset::Dataset;
use crate::grid::GridError;
use crate::volume::Volume;

use format::SNIFFED_BYTES;
use sg_input::{file, unreadable};
use source::Source;

pub use dicom::is_dicom;
pub use error::{ActualSize, ReadError, WriteError};
pub use format::Format;
pub use raw::{raw_file_name, write_raw};
pub use series::{MAX_STEPS, SERIES_ENDINGS, SeriesStep, is_series_path, read_series};
pub use source::Limits;

/// The formats that [`read_dataset`] reads.
pub const FORMATS: &[Format] = &[
    Format::of::<raw::Raw>(),
    Format::of::<nrrd::Nrrd>(),
    Format::of::<metaimage::MetaImage>(),
    Format::of::<vti::VtkImageData>(),
    Format::of::<nifti::Nifti>(),
    Format::of::<vtu::VtkUnstructuredGrid>(),
    Format::of::<legacy_vtk::LegacyVtk>(),
    Format::of::<dicom::Dicom>(),
];

/// Endings of the file names that [`read_dataset`] reads, in lower case.
pub const ENDINGS: [&str; ENDING_COUNT] = {
    let mut endings = [""; ENDING_COUNT];
    let (mut row, mut filled) = (0, 0);
    while row < FORMATS.len() {
        let mut i = 0;
        while i < FORMATS[row].endings().len() {
            endings[filled] = FORMATS[row].endings()[i];
            filled += 1;
            i += 1;
        }
        row += 1;
    }
    endings
};

const ENDING_COUNT: usize = {
    let (mut row, mut count) = (0, 0);
    while row < FORMATS.len() {
        count += FORMATS[row].endings().len();
        row += 1;
    }
    count
};

/// One line that lists all formats with their endings, for help texts.
#[must_use]
pub fn formats_help() -> String {
    let row = |format: &Format| format!("{} ({})", format.name(), format.endings().join(", "));
    FORMATS.iter().map(row).collect::<Vec<_>>().join("; ")
}

/// How to read a file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ReadOptions {
    /// The lengths between voxels that a person gives: millimetres along x, y and z, for files without spacing.
    pub spacing: Option<DVec3>,
    /// The quantity to read, of a file that holds several: its name, or `NAME:K` for component K from 0 of a vector (`x`, `y` and
    /// `z` are 0, 1 and 2). The name of a vector alone means its length.
    pub variable: Option<String>,
    /// The quantity to read without [`Self::variable`], if the file has it.
    pub preferred: Option<String>,
    /// The series to read of a folder with several: its number from 1, as a note tells it. Default: that of the named file, or the
    /// one with most voxels.
    pub series: Option<usize>,
    /// Limits on what the file may take.
    pub limits: Limits,
}

/// Reads a data set. The ending of the name selects the format (see [`FORMATS`]). Without a known ending, the first bytes
/// select it. A folder of DICOM slices is one data set. Spacing, origin and orientation keep the file's world frame and length unit.
///
/// # Errors
/// [`ReadError`]: one line with the file, the place in it and a remedy. Also if a spacing is given for a file with its own, or
/// a quantity for a format with one.
pub fn read_dataset(path: &Path, options: &ReadOptions) -> Result<Dataset, ReadError> {
    let source = Source {
        path,
        limits: options.limits,
        variable: options.variable.as_deref(),
        preferred: options.preferred.as_deref(),
        series: options.series,
    };
    if options.spacing.is_some() && !lacks_spacing(path) {
        let what = "a given spacing is for raw volumes, and this format stores its own";
        return Err(source.format("spacing", what, "leave it out"));
    }
    let name = lower_case_name(path);
    // The slices of a series make the only folder that is a volume.
    let is_series = path.is_dir() && is_dicom(path);
    let by_name = FORMATS.iter().find(|f| if is_series { f.has_series() } else { f.has_ending(&name) });
    let format = match by_name {
        Some(format) => Some(format),
        None => {
            let first = file::read_start(path, SNIFFED_BYTES).map_err(|e| source.io(e))?;
            FORMATS.iter().find(|f| f.sniff(&name, &first))
        }
    };
    let Some(format) = format else {
        if let Some(found) = unreadable::recognise(path) {
            return Err(source.format(found.place, found.what(), found.format.remedy));
        }
        let remedy = format!("give one of {}", ENDINGS.join(", "));
        return Err(source.format("file name", "no known volume extension", remedy));
    };
    if source.variable.is_some() && !format.has_variables() {
        let what = format!("a {} file holds one quantity", format.name());
        return Err(source.format("quantity", what, "leave its name out"));
    }
    if source.series.is_some() && !format.has_series() {
        let what = format!("a {} file holds one series", format.name());
        return Err(source.format("--series", what, "leave it out"));
    }
    let read = format.read(source)?;
    match (read, options.spacing) {
        (Dataset::Volume(volume), Some(spacing)) => {
            let refused = |e: GridError| source.format("spacing", e.to_string(), "give three lengths above 0");
            volume.with_spacing(spacing).map(Dataset::Volume).map_err(refused)
        }
        (read, _) => Ok(read),
    }
}

/// Reads a volume: a data set of voxels ([`read_dataset`]).
///
/// # Errors
/// [`ReadError`]; also for a mesh.
pub fn read_volume(path: &Path) -> Result<Volume, ReadError> {
    read_volume_within(path, Limits::default())
}

/// [`read_volume_within`] limits, with the lengths between voxels that a person gives: millimetres along x, y and z, for files
/// without spacing.
///
/// # Errors
/// [`ReadError`]; also if the file has its own spacing, or unless all lengths are finite and above 0.
pub fn read_spaced_volume(path: &Path, spacing: Option<DVec3>, limits: Limits) -> Result<Volume, ReadError> {
    match read_dataset(path, &ReadOptions { spacing, limits, ..ReadOptions::default() })? {
        Dataset::Volume(volume) => Ok(volume),
        Dataset::Mesh(_) => {
            let source = Source { path, limits, variable: None, preferred: None, series: None };
            Err(source.format("content", "a mesh, where voxels are needed", "resample it to an image in ParaView"))
        }
    }
}

/// [`read_volume`] with given limits.
///
/// # Errors
/// [`ReadError`]; also if the volume exceeds the limits.
pub fn read_volume_within(path: &Path, limits: Limits) -> Result<Volume, ReadError> {
    read_spaced_volume(path, None, limits)
}

/// Whether the ending of the name is one of [`ENDINGS`].
#[must_use]
pub fn is_volume_path(path: &Path) -> bool {
    let name = lower_case_name(path);
    FORMATS.iter().any(|format| format.has_ending(&name))
}

/// Whether a path is a volume: a file by the ending of its name, or DICOM slices by their content, in a folder too. A folder with
/// a scene file is a scene.
#[must_use]
pub fn is_volume(path: &Path) -> bool {
    if path.is_dir() {
        !path.join("scene.toml").exists() && is_dicom(path)
    } else {
        is_volume_path(path) || is_dicom(path)
    }
}

/// Whether the name of a volume selects a format without spacing: raw voxels. [`Volume::with_spacing`] gives them one.
#[must_use]
pub fn lacks_spacing(path: &Path) -> bool {
    let name = lower_case_name(path);
    Format::of::<raw::Raw>().has_ending(&name)
}

/// Whether the voxels of a volume may lie in files beside it: NRRD and MetaImage headers by their names, and DICOM slices.
#[must_use]
pub fn reads_beside(path: &Path) -> bool {
    let name = lower_case_name(path);
    let by_name = FORMATS.iter().any(|format| format.reads_beside() && format.has_ending(&name));
    by_name || !path.is_dir() && is_dicom(path)
}

/// Writes a volume in the format that the name of `path` selects. Only raw files can be written: plain, little endian,
/// with the name from [`raw_file_name`].
///
/// # Errors
/// [`WriteError`] for another format or name, or an error of the writer.
pub fn write_volume(path: &Path, volume: &Volume, writer: &mut dyn Write) -> Result<(), WriteError> {
    let name = lower_case_name(path);
    match FORMATS.iter().find(|f| f.has_ending(&name)) {
        Some(format) => format.write(path, volume, writer),
        None => Err(WriteError::Ending { path: path.to_owned() }),
    }
}

/// The last component of a path, as endings are compared with it; empty if there is none.
fn lower_case_name(path: &Path) -> String {
    path.file_name().map(|name| name.to_string_lossy().to_ascii_lowercase()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_gives_every_ending_once() {
        assert!(ENDINGS.contains(&".nii.gz"));
        for ending in ENDINGS {
            assert!(ending.starts_with('.') && ending.to_lowercase() == ending, "{ending}");
            assert_eq!(FORMATS.iter().filter(|f| f.has_ending(&format!("name{ending}"))).count(), 1, "{ending}");
            assert!(formats_help().contains(ending), "{ending}");
            let refused = unreadable::UNREADABLE.iter().find(|f| f.endings.contains(&ending));
            assert!(refused.is_none(), "{ending} can be read: {refused:?}");
        }
    }
}
