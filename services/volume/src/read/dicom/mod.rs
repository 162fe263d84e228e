//! DICOM series: a folder of slices, one file of it, or one file with many frames.
//!
//! Slices come in the order of their places along the normal of their planes, whatever their names and numbers say. The grid keeps
//! the patient's frame of DICOM: LPS, in millimetres. Its third axis is the way from a slice to the next one, so a tilted gantry
//! gives a leaning grid. Distances may differ from the median by 1 %, or 0.02 mm where that is more; others, missing slices and
//! slices at one place are errors.
//!
//! Stored values become `RescaleSlope · value + RescaleIntercept` of their slice, and those of `PixelPaddingValue` are NaN. Without
//! either they keep their own type. `MONOCHROME1` values stay as they are.
//!
//! Voxels are read plain, deflated, as run lengths, and as baseline or lossless JPEG. Names, dates, numbers and descriptions of people,
//! places and studies stay in the file: no error, note or name of a quantity has any of them.

mod elements;
mod geometry;
mod pixels;
mod series;

use std::path::Path;

use sg_input::{file, limits};

use crate::scalars::{ScalarType, Scalars};
use crate::volume::Volume;
use crate::world_frame::{LengthUnit, PatientFrame, WorldFrame};

use super::error::ReadError;
use super::format::VolumeFormat;
use super::source::Source;
use elements::{Fault, Photometric};
use geometry::Stack;
use pixels::FrameData;
use series::{Found, SeriesFile};

/// Most slices of a folder, and most frames of a file.
const MAX_SLICES: usize = 10_000;
/// Most entries of a folder that [`is_dicom`] looks at.
const ENTRIES: usize = 256;

/// DICOM.
pub(super) struct Dicom;

impl VolumeFormat for Dicom {
    type Data = Volume;

    const NAME: &'static str = "DICOM";
    const ENDINGS: &'static [&'static str] = &[".dcm", ".dicom", ".ima"];
    const READS_BESIDE: bool = true;
    const HAS_SERIES: bool = true;

    fn sniff(_name: &str, first: &[u8]) -> bool {
        elements::has_magic(first)
    }

    fn read(source: Source<'_>) -> Result<Volume, ReadError> {
        let (files, mut notes) = Found::scan(source)?.chosen(source)?;
        for file in &files {
            pixels::check(&file.attributes, file.head.packing).map_err(|wrong| error_of(file.source(source), wrong))?;
        }
        let stack = geometry::stack(source, &files)?;
        notes.extend(notes_of(&files, &stack));
        let scalars = voxels(source, &files, &stack)?;
        let frame = WorldFrame { patient: Some(PatientFrame::Lps), unit: Some(LengthUnit::Millimetre) };
        let volume = Volume::new(stack.grid, scalars, None);
        let volume = volume.map_err(|e| source.format("voxels", e.to_string(), "fetch the files again"))?;
        Ok(volume.in_frame(frame).with_notes(notes))
    }
}

/// Whether a path is a DICOM file, or a folder with one among its first entries.
#[must_use]
pub fn is_dicom(path: &Path) -> bool {
    if !path.is_dir() {
        return series::is_dicom_file(path);
    }
    let Ok(entries) = std::fs::read_dir(path) else { return false };
    entries.take(ENTRIES).flatten().any(|entry| series::is_dicom_file(&entry.path()))
}

/// The error of a file.
fn error_of(source: Source<'_>, fault: Fault) -> ReadError {
    match fault {
        Fault::Cut => source.format("end of the file", "it ends within an element", "fetch the file again"),
        Fault::Wrong(what, remedy) => source.format("content", what, remedy),
        Fault::Expands(most) => {
            let what = format!("packed elements of more than {most} bytes");
            source.format("content", what, limits::remedy(most.saturating_mul(2)))
        }
    }
}

/// What a person should know of the values and their places.
fn notes_of(files: &[SeriesFile], stack: &Stack) -> Vec<String> {
    let mut notes = Vec::new();
    if let Some(tilt) = stack.tilt {
        let gantry = files.first().and_then(|file| file.attributes.gantry_tilt).filter(|tilt| *tilt != 0.0);
        let gantry = gantry.map_or_else(String::new, |tilt| format!(" (gantry tilt {tilt:.1})"));
        notes.push(format!("the slices lean by {tilt:.1} degrees{gantry}, and so does the grid"));
    }
    if files.iter().any(|file| file.attributes.photometric == Photometric::Monochrome1) {
        notes.push("low values are bright in this series (MONOCHROME1); the values stay as they are".to_owned());
    }
    let middle = stack.slices.get(stack.slices.len() / 2).map(|slice| slice.values);
    if let Some((center, width)) = middle.and_then(|values| values.window_center.zip(values.window_width)) {
        let (low, high) = (center - 0.5 * width, center + 0.5 * width);
        notes.push(format!("the series suggests the window {low} to {high}"));
    }
    notes
}

/// Slope and intercept of a slice.
fn rescaling(slope: Option<f64>, intercept: Option<f64>) -> (f64, f64) {
    (slope.unwrap_or(1.0), intercept.unwrap_or(0.0))
}

/// The type of the stored values that holds those of all files.
fn stored_type(files: &[SeriesFile]) -> ScalarType {
    let bits = files.iter().map(|file| file.attributes.bits_allocated).max().unwrap_or(16);
    let signed = files.iter().any(|file| file.attributes.signed);
    let unsigned = files.iter().any(|file| !file.attributes.signed);
    match (bits, signed) {
        // Files of both kinds need a bit more.
        (8, true) if unsigned => ScalarType::I16,
        (8, true) => ScalarType::I8,
        (8, false) => ScalarType::U8,
        (16, true) if unsigned => ScalarType::I32,
        (16, true) => ScalarType::I16,
        (16, false) => ScalarType::U16,
        (_, true) if unsigned => ScalarType::F64,
        (_, true) => ScalarType::I32,
        (_, false) => ScalarType::U32,
    }
}

/// Reads the voxels of all slices, one file after another.
fn voxels(source: Source<'_>, files: &[SeriesFile], stack: &Stack) -> Result<Scalars, ReadError> {
    let is_rescaled =
        stack.slices.iter().any(|slice| rescaling(slice.values.slope, slice.values.intercept) != (1.0, 0.0));
    let has_padding = files.iter().any(|file| file.attributes.padding.is_some());
    let stored = stored_type(files);
    let kind = if is_rescaled || has_padding { stored.scaled() } else { stored };
    let dims = stack.grid.dims();
    let bytes = source.voxel_bytes(dims, kind)?;
    let on_disk = files.iter().fold(0_u64, |sum, file| sum.saturating_add(file.length));
    source.check_expanded(bytes, on_disk)?;
    let count = stack.grid.len();
    let mut values = Values::new(kind, count).ok_or_else(|| source.io(std::io::ErrorKind::OutOfMemory.into()))?;
    let per_slice = dims[0] * dims[1];
    for run in stack.slices.chunk_by(|a, b| a.file == b.file) {
        let Some(file) = run.first().and_then(|slice| files.get(slice.file)) else { continue };
        let own = file.source(source);
        let wrong = |fault: Fault| error_of(own, fault);
        let held = file::read(&file.path, series::most_bytes(source)).map_err(|e| own.io(e))?;
        let mut unpacked = Vec::new();
        let data = elements::data_set(&file.head, &held, &mut unpacked).map_err(wrong)?;
        let frames = FrameData::of(&file.attributes, file.head.packing, data).map_err(wrong)?;
        let padding = pixels::padding(&file.attributes);
        for slice in run {
            let stored = frames.frame(slice.frame).map_err(wrong)?;
            if stored.len() != per_slice {
                let what = "fewer voxels than its rows and columns say";
                return Err(own.format("pixel data", what, "fetch the file again"));
            }
            let (slope, intercept) = rescaling(slice.values.slope, slice.values.intercept);
            values.push(&stored, |value| {
                let is_empty = padding.as_ref().is_some_and(|range| range.contains(&value));
                if is_empty { f64::NAN } else { value as f64 * slope + intercept }
            });
        }
    }
    Ok(values.0)
}

/// Values that are still to come.
struct Values(Scalars);

impl Values {
    /// Room for `count` values of a type; `None` without the memory.
    fn new(kind: ScalarType, count: usize) -> Option<Self> {
        fn room<T>(count: usize) -> Option<Vec<T>> {
            let mut values = Vec::new();
            values.try_reserve_exact(count).ok().map(|()| values)
        }
        Some(Self(match kind {
            ScalarType::U8 => Scalars::U8(room(count)?),
            ScalarType::I8 => Scalars::I8(room(count)?),
            ScalarType::U16 => Scalars::U16(room(count)?),
            ScalarType::I16 => Scalars::I16(room(count)?),
            ScalarType::U32 => Scalars::U32(room(count)?),
            ScalarType::I32 => Scalars::I32(room(count)?),
            ScalarType::U64 => Scalars::U64(room(count)?),
            ScalarType::I64 => Scalars::I64(room(count)?),
            ScalarType::F32 => Scalars::F32(room(count)?),
            ScalarType::F64 => Scalars::F64(room(count)?),
        }))
    }

    /// Appends stored values, those of floating point through `scale`.
    fn push(&mut self, stored: &[i64], scale: impl Fn(i64) -> f64) {
        let stored = stored.iter().copied();
        match &mut self.0 {
            Scalars::U8(values) => values.extend(stored.map(|value| value as u8)),
            Scalars::I8(values) => values.extend(stored.map(|value| value as i8)),
            Scalars::U16(values) => values.extend(stored.map(|value| value as u16)),
            Scalars::I16(values) => values.extend(stored.map(|value| value as i16)),
            Scalars::U32(values) => values.extend(stored.map(|value| value as u32)),
            Scalars::I32(values) => values.extend(stored.map(|value| value as i32)),
            Scalars::U64(values) => values.extend(stored.map(|value| value as u64)),
            Scalars::I64(values) => values.extend(stored),
            Scalars::F32(values) => values.extend(stored.map(|value| scale(value) as f32)),
            Scalars::F64(values) => values.extend(stored.map(scale)),
        }
    }
}
