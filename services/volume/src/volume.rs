//! A volume: a grid and its values, as read.

use glam::DVec3;

use crate::field::Field;
use crate::grid::{Grid, GridError};
use crate::label_table::LabelTable;
use crate::scalars::Scalars;
use crate::world_frame::{LengthUnit, WorldFrame};

/// A scalar volume in the type the file had.
#[derive(Debug, Clone, PartialEq)]
pub struct Volume {
    grid: Grid,
    scalars: Scalars,
    variable: Option<String>,
    frame: WorldFrame,
    labels: LabelTable,
    notes: Vec<String>,
}

/// The number of values does not match the grid.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{values} values do not fill {} x {} x {} voxels", .dims[0], .dims[1], .dims[2])]
pub struct ValueCount {
    /// Number of values.
    pub values: usize,
    /// Voxels of the grid.
    pub dims: [usize; 3],
}

impl Volume {
    /// A volume of `scalars` on `grid`. `variable` is the name of the quantity, if the file has one.
    ///
    /// # Errors
    /// [`ValueCount`] if the lengths differ.
    pub fn new(grid: Grid, scalars: Scalars, variable: Option<String>) -> Result<Self, ValueCount> {
        if scalars.len() == grid.len() {
            let (frame, labels) = (WorldFrame::default(), LabelTable::default());
            Ok(Self { grid, scalars, variable, frame, labels, notes: Vec::new() })
        } else {
            Err(ValueCount { values: scalars.len(), dims: grid.dims() })
        }
    }

    /// The same volume in a world frame that its file tells of.
    #[must_use]
    pub fn in_frame(self, frame: WorldFrame) -> Self {
        Self { frame, ..self }
    }

    /// The same volume with names and colours of its values, where these are labels.
    #[must_use]
    pub fn with_labels(self, labels: LabelTable) -> Self {
        Self { labels, ..self }
    }

    /// The same volume with what its reader has to tell a person: a line each.
    #[must_use]
    pub(crate) fn with_notes(self, notes: Vec<String>) -> Self {
        Self { notes, ..self }
    }

    /// What a person should know of the file: what was left out or chosen, a line each. No names of people are in them.
    #[must_use]
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// The same values with other lengths between voxels, in millimetres along x, y and z: for files without spacing.
    ///
    /// # Errors
    /// [`GridError::Spacing`] unless all are finite and above 0.
    pub fn with_spacing(self, spacing: DVec3) -> Result<Self, GridError> {
        let grid = Grid::new(self.grid.dims(), spacing, self.grid.origin(), self.grid.direction())?;
        let frame = WorldFrame { unit: Some(LengthUnit::Millimetre), ..self.frame };
        Ok(Self { grid, frame, ..self })
    }

    /// The world frame, as far as the file tells it.
    #[must_use]
    pub fn frame(&self) -> WorldFrame {
        self.frame
    }

    /// Names and colours of the values, where the file tells them: those of the segments of a label map.
    #[must_use]
    pub fn labels(&self) -> &LabelTable {
        &self.labels
    }

    /// The grid of the voxels.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Values, x fastest.
    #[must_use]
    pub fn scalars(&self) -> &Scalars {
        &self.scalars
    }

    /// Name of the quantity, if the file has one.
    #[must_use]
    pub fn variable(&self) -> Option<&str> {
        self.variable.as_deref()
    }

    /// The values in f32, ready for sampling. For types that f32 cannot hold exactly, the field stores the difference from
    /// the least value. The subtraction is in f64, so small differences on a large offset survive.
    #[must_use]
    pub fn to_field(&self) -> Field {
        let (values, offset, range) = self.scalars.narrowed();
        Field::from_parts(self.grid.clone(), values, offset, range)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_differences_on_a_large_offset_survive_the_narrowing() {
        let values: Vec<u32> = (0..8).map(|i| 4_000_000_000 + i).collect();
        let naive: Vec<f32> = values.iter().map(|&x| x as f32).collect();
        assert!(naive.iter().all(|x| *x == naive[0]), "f32 alone cannot separate them");
        let volume = Volume::new(Grid::unit([2, 2, 2]).unwrap(), values.into(), None).unwrap();
        let field = volume.to_field();
        for i in 0..8 {
            assert_eq!(field.raw(i), 4_000_000_000.0 + i as f64);
        }
    }

    #[test]
    fn a_given_spacing_makes_millimetres() {
        let volume = Volume::new(Grid::unit([2, 2, 2]).unwrap(), vec![0_u8; 8].into(), None).unwrap();
        assert_eq!(volume.frame(), WorldFrame::default());
        let spaced = volume.clone().with_spacing(DVec3::new(0.5, 0.5, 1.25)).unwrap();
        assert_eq!(spaced.grid().spacing(), DVec3::new(0.5, 0.5, 1.25));
        assert_eq!(spaced.frame().unit, Some(LengthUnit::Millimetre));
        assert_eq!(spaced.grid().to_world(DVec3::ONE), DVec3::new(0.5, 0.5, 1.25));
        for bad in [DVec3::new(0.0, 1.0, 1.0), DVec3::new(1.0, -1.0, 1.0), DVec3::splat(f64::NAN)] {
            assert!(volume.clone().with_spacing(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn values_must_fill_the_grid() {
        let error = Volume::new(Grid::unit([2, 2, 2]).unwrap(), vec![0_u8; 7].into(), None).unwrap_err();
        assert_eq!(error.to_string(), "7 values do not fill 2 x 2 x 2 voxels");
    }
}
