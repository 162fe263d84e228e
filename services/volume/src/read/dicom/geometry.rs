//! The grid of a series: slices in the order of their places along the normal of the planes.

use glam::{DMat3, DVec3};

use crate::grid::Grid;

use super::super::error::ReadError;
use super::super::source::Source;
use super::elements::Frame;
use super::series::SeriesFile;

/// Part of the median distance by which others may differ.
const UNEVEN: f64 = 0.01;
/// Millimetres by which distances may differ whatever the median is: positions are rounded.
const ROUNDED: f64 = 0.02;
/// Most by which two directions of one plane may differ, and the cosine between rows and columns.
const TURNED: f64 = 1e-3;
/// Shift of neighbouring slices within their planes, as a part of their distance, from which a note tells of it.
const TILTED: f64 = 0.01;

/// One slice: a frame of a file.
#[derive(Debug, Clone, Copy)]
pub(super) struct Slice {
    /// Its file, and its frame there.
    pub(super) file: usize,
    pub(super) frame: usize,
    pub(super) values: Frame,
    position: DVec3,
    /// Place along the normal.
    along: f64,
}

/// The slices in their order, and their grid.
pub(super) struct Stack {
    pub(super) slices: Vec<Slice>,
    pub(super) grid: Grid,
    /// Degrees by which the stack leans from the normal, if it does.
    pub(super) tilt: Option<f64>,
}

/// The plane of all slices.
#[derive(Debug, Clone, Copy)]
struct Plane {
    row: DVec3,
    column: DVec3,
    /// Lengths between rows and between columns.
    spacing: [f64; 2],
}

/// Sorts the frames of a series and finds their grid.
pub(super) fn stack(source: Source<'_>, files: &[SeriesFile]) -> Result<Stack, ReadError> {
    let Some(first) = files.first() else { return Err(source.format("folder", "no slice", "give another folder")) };
    let (rows, columns) = (first.attributes.rows, first.attributes.columns);
    let plane = plane(first.source(source), first.attributes.frame(0))?;
    let normal = plane.row.cross(plane.column);
    let mut slices = Vec::new();
    for (index, file) in files.iter().enumerate() {
        let own = file.source(source);
        if (file.attributes.rows, file.attributes.columns) != (rows, columns) {
            let what = format!(
                "{columns} x {rows} voxels in {}, and {} x {} here",
                first.name(),
                file.attributes.columns,
                file.attributes.rows
            );
            return Err(own.format("Rows and Columns", what, "move the file to another folder"));
        }
        for frame in 0..file.attributes.frames() {
            let values = file.attributes.frame(frame);
            plane.check(own, values, &first.name())?;
            let position = values.position.ok_or_else(|| {
                let way = "save the series as NRRD from 3D Slicer";
                own.format("ImagePositionPatient", "no place of the slice in the patient", way)
            })?;
            let position = DVec3::from_array(position);
            slices.push(Slice { file: index, frame, values, position, along: position.dot(normal) });
        }
    }
    slices.sort_by(|a, b| a.along.total_cmp(&b.along));
    let step = step(source, files, &slices)?;
    let step = match (step, slices.first()) {
        (Some(step), _) => step,
        // A single slice is as thick as it says.
        (None, Some(slice)) => normal * thickness(first, slice),
        (None, None) => normal,
    };
    let origin = slices.first().map_or(DVec3::ZERO, |slice| slice.position);
    let [between_rows, between_columns] = plane.spacing;
    let spacing = DVec3::new(between_columns, between_rows, step.length());
    let direction = DMat3::from_cols(plane.row, plane.column, step);
    let grid = Grid::new([columns, rows, slices.len()], spacing, origin, direction).map_err(|e| source.grid(e))?;
    let lean = step.angle_between(normal);
    let tilt = (lean.tan().abs() > TILTED).then(|| lean.to_degrees());
    Ok(Stack { slices, grid, tilt })
}

fn plane(source: Source<'_>, frame: Frame) -> Result<Plane, ReadError> {
    let way = "save the series as NRRD from 3D Slicer";
    let Some([a, b, c, d, e, f]) = frame.orientation else {
        return Err(source.format("ImageOrientationPatient", "no directions of rows and columns", way));
    };
    let (row, column) = (DVec3::new(a, b, c), DVec3::new(d, e, f));
    let is_unit = |direction: DVec3| (direction.length() - 1.0).abs() < TURNED;
    if !is_unit(row) || !is_unit(column) || row.dot(column).abs() > TURNED {
        let what = "rows and columns without a right angle between them";
        return Err(source.format("ImageOrientationPatient", what, way));
    }
    let Some(spacing) = frame.spacing else {
        return Err(source.format("PixelSpacing", "no lengths between rows and columns", way));
    };
    if spacing.iter().any(|&length| length <= 0.0) {
        return Err(source.format("PixelSpacing", "a length that is not above 0", way));
    }
    Ok(Plane { row: row.normalize(), column: column.normalize(), spacing })
}

impl Plane {
    /// Refuses a slice in another plane or with another spacing.
    fn check(&self, source: Source<'_>, frame: Frame, first: &str) -> Result<(), ReadError> {
        let own = plane(source, frame)?;
        let way = "move the file to another folder";
        if own.row.distance(self.row) > TURNED || own.column.distance(self.column) > TURNED {
            let what = format!("a plane in another direction than that of {first}");
            return Err(source.format("ImageOrientationPatient", what, way));
        }
        let differs = |(a, b): (f64, f64)| (a - b).abs() > 1e-3 * b;
        if own.spacing.into_iter().zip(self.spacing).any(differs) {
            return Err(source.format("PixelSpacing", format!("another spacing than that of {first}"), way));
        }
        Ok(())
    }
}

/// Length of a single slice along its normal.
fn thickness(file: &SeriesFile, slice: &Slice) -> f64 {
    let known = [file.attributes.slice_spacing, slice.values.thickness];
    known.into_iter().flatten().find(|length| *length > 0.0).unwrap_or(1.0)
}

/// The way from a slice to the next one; `None` for a single slice. The mean of even distances: that puts the last slice in its
/// place, too.
fn step(source: Source<'_>, files: &[SeriesFile], slices: &[Slice]) -> Result<Option<DVec3>, ReadError> {
    let (Some(first), Some(last)) = (slices.first(), slices.last()) else { return Ok(None) };
    let pairs: Vec<(&Slice, &Slice)> = slices.iter().zip(slices.iter().skip(1)).collect();
    let mut gaps: Vec<f64> = pairs.iter().map(|(a, b)| b.along - a.along).collect();
    gaps.sort_by(f64::total_cmp);
    let Some(&median) = gaps.get(gaps.len() / 2) else { return Ok(None) };
    let name = |slice: &Slice| match files.get(slice.file) {
        Some(file) if file.attributes.frames() > 1 => format!("frame {} of {}", slice.frame + 1, file.name()),
        Some(file) => file.name(),
        None => String::new(),
    };
    let slack = (UNEVEN * median).max(ROUNDED.min(0.25 * median));
    if let Some((a, b)) = pairs.iter().find(|(a, b)| b.along - a.along <= slack.max(1e-6)) {
        let what = format!("{} and {} are at the same place", name(a), name(b));
        return Err(source.format("slices", what, "give a folder with one time, echo or reconstruction"));
    }
    let mean = (last.position - first.position) / pairs.len() as f64;
    for (a, b) in &pairs {
        let gap = b.along - a.along;
        let missing = (gap / median).round();
        if missing >= 2.0 && (gap - missing * median).abs() <= missing * slack {
            let count = missing - 1.0;
            let what = format!("{count} missing between {} and {}", name(a), name(b));
            return Err(source.format("slices", what, "add the missing files"));
        }
        if (gap - median).abs() > slack {
            let what =
                format!("{gap:.3} mm between {} and {}, and {median:.3} mm between most others", name(a), name(b));
            let way = "resample the series to even distances in 3D Slicer and save it as NRRD";
            return Err(source.format("slices", what, way));
        }
    }
    // The distances are even by now; the rest is a shift within the planes.
    if let Some((a, b)) = pairs.iter().find(|(a, b)| (b.position - a.position - mean).length() > 3.0 * slack) {
        let what = format!("{} and {} are shifted against each other", name(a), name(b));
        return Err(source.format("slices", what, "move files of another series to another folder"));
    }
    Ok(Some(mean))
}
