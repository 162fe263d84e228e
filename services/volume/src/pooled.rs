//! Values of all time steps of a series together, for one transfer function of all.

use glam::{DMat3, DVec3};

use crate::dataset::ScalarFieldRef;
use crate::field::Field;
use crate::grid::{Grid, GridError};
use crate::histogram::{AutomaticError, automatic_transfer_function};
use crate::scalars::ValueRange;
use crate::transfer::TransferFunction;

/// Most values that are kept of all steps.
const MOST_VALUES: usize = 1 << 22;
/// Most values that are kept along each axis of a step, and fewest.
const EDGES: [usize; 2] = [8, 96];

/// The range of the values of a series, and an even part of them.
///
/// Each step keeps the same number of values, at even distances from face to face.
#[derive(Debug, Clone)]
pub struct PooledValues {
    edge: usize,
    /// Kept places along x, y and z, as the first step has them.
    dims: Option<[usize; 3]>,
    kept: Vec<f64>,
    low: f64,
    high: f64,
}

impl PooledValues {
    /// No value yet, of a series of this many steps.
    #[must_use]
    pub fn new(steps: usize) -> Self {
        let each = MOST_VALUES / steps.max(1);
        let edge = (each as f64).cbrt() as usize;
        let [least, most] = EDGES;
        Self {
            edge: edge.clamp(least, most),
            dims: None,
            kept: Vec::new(),
            low: f64::INFINITY,
            high: f64::NEG_INFINITY,
        }
    }

    /// Adds a step. A step of another size is thinned to the places of the first one.
    pub fn add(&mut self, field: ScalarFieldRef<'_>) {
        let even;
        let voxels = match field {
            ScalarFieldRef::Grid(field) => field,
            ScalarFieldRef::Mesh(field) => match field.resampled(self.edge) {
                Ok(resampled) => {
                    even = resampled;
                    &even
                }
                Err(_) => return,
            },
        };
        let range = field.range();
        // The range of a field without finite values is 0 to 0, and says nothing.
        if voxels.values().iter().any(|value| value.is_finite()) {
            self.low = self.low.min(range.low);
            self.high = self.high.max(range.high);
        }
        let own = voxels.grid().dims();
        let dims = *self.dims.get_or_insert_with(|| own.map(|n| n.min(self.edge)));
        // The faces are kept too: they tell the background.
        let place = |k: usize, axis: usize| match dims[axis] {
            1 => own[axis] / 2,
            kept => (k * (own[axis] - 1) + (kept - 1) / 2) / (kept - 1),
        };
        self.kept.reserve(dims.iter().product());
        for z in 0..dims[2] {
            for y in 0..dims[1] {
                for x in 0..dims[0] {
                    self.kept.push(voxels.raw(voxels.grid().index(place(x, 0), place(y, 1), place(z, 2))));
                }
            }
        }
    }

    /// The least and the greatest finite raw value of all steps; `None` without any.
    #[must_use]
    pub fn range(&self) -> Option<[f64; 2]> {
        (self.low <= self.high).then_some([self.low, self.high])
    }

    /// The automatic transfer function of all steps together ([`automatic_transfer_function`]).
    ///
    /// # Errors
    /// [`AutomaticError`] if all values of all steps are equal, or none is finite.
    pub fn automatic_transfer_function(&self, variable: Option<&str>) -> Result<TransferFunction, AutomaticError> {
        let [low, high] = self.range().ok_or(AutomaticError::NoValues)?;
        let field = self.stacked([low, high]).map_err(|_: GridError| AutomaticError::NoValues)?;
        automatic_transfer_function(&field, variable)
    }

    /// The kept values of all steps, one step above the other.
    fn stacked(&self, [low, high]: [f64; 2]) -> Result<Field, GridError> {
        let [x, y, z] = self.dims.unwrap_or([1; 3]);
        let grid =
            Grid::new([x, y, self.kept.len() / (x * y * z).max(1) * z], DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY)?;
        let values: Vec<f32> = self.kept.iter().map(|raw| (raw - low) as f32).collect();
        let non_finite = values.iter().filter(|value| !value.is_finite()).count();
        Ok(Field::from_parts(grid, values, low, ValueRange { low, high, non_finite }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::Volume;

    /// A ball of 200 in noise-free 10s, of this radius.
    fn ball(size: usize, radius: f64, inside: f32) -> Field {
        let grid = Grid::unit([size; 3]).unwrap();
        let middle = DVec3::splat(0.5 * (size as f64 - 1.0));
        let value = |i: usize| if (grid.voxel(i).as_dvec3() - middle).length() < radius { inside } else { 10.0 };
        let values: Vec<f32> = (0..grid.len()).map(value).collect();
        Volume::new(grid, values.into(), None).unwrap().to_field()
    }

    #[test]
    fn one_function_shows_what_single_steps_hide() {
        let (weak, strong) = (ball(24, 7.0, 60.0), ball(24, 7.0, 200.0));
        let empty = ball(24, 0.0, 0.0);
        let mut pool = PooledValues::new(3);
        for field in [&weak, &empty, &strong] {
            pool.add(field.into());
        }
        assert_eq!(pool.range(), Some([10.0, 200.0]));
        let function = pool.automatic_transfer_function(None).unwrap();
        let classifier = function.classifier(ValueRange { low: 10.0, high: 200.0, non_finite: 0 }).unwrap();
        let shown = [10.0, 60.0, 200.0].map(|raw| classifier.opacity(raw) > 0.0);
        assert_eq!(shown, [false, true, true], "{function:?}");
        // In any order.
        let mut again = PooledValues::new(3);
        for field in [&strong, &weak, &empty] {
            again.add(field.into());
        }
        assert_eq!(again.automatic_transfer_function(None).unwrap(), function);
    }

    #[test]
    fn steps_of_other_sizes_and_without_values_are_taken() {
        let mut pool = PooledValues::new(1000);
        pool.add((&ball(40, 9.0, 200.0)).into());
        pool.add((&ball(7, 2.0, 300.0)).into());
        let nothing = Volume::new(Grid::unit([3; 3]).unwrap(), vec![f32::NAN; 27].into(), None).unwrap().to_field();
        pool.add((&nothing).into());
        assert_eq!(pool.range(), Some([10.0, 300.0]));
        assert!(pool.automatic_transfer_function(None).is_ok());
        assert_eq!(PooledValues::new(1).automatic_transfer_function(None), Err(AutomaticError::NoValues));
        let mut alone = PooledValues::new(1);
        alone.add((&nothing).into());
        assert_eq!(alone.range(), None);
        alone.add((&ball(7, 0.0, 0.0)).into());
        assert_eq!(alone.automatic_transfer_function(None), Err(AutomaticError::Constant(10.0)));
    }
}
